//! A baked GLB whose coordinates and texels can be altered, to plant faults.

#![allow(dead_code, reason = "each test crate uses its own part of this file")]

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use texelwalk::output::exr::{ImageF32, read_rgba};

/// A document with its only page, in memory.
#[derive(Clone)]
pub(crate) struct Baked {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
    pub(crate) page: ImageF32,
}

/// Vertices of a primitive that triangles connect, and the box around them on the page [texels].
#[derive(Debug, Clone)]
pub(crate) struct Chart {
    pub(crate) place: (usize, usize),
    pub(crate) vertices: Vec<usize>,
    pub(crate) low: [f32; 2],
    pub(crate) high: [f32; 2],
}

fn word(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

impl Baked {
    pub(crate) fn read(glb: &Path) -> Self {
        let bytes = fs::read(glb).unwrap();
        let length = word(&bytes, 12);
        let json: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        let bin = bytes[28 + length..].to_vec();
        let uri = json["scenes"][0]["extras"]["lightmap"]["pages"][0]["uri"].as_str().unwrap();
        let page = read_rgba(&glb.parent().unwrap().join(uri)).unwrap();
        Self { json, bin, page }
    }

    /// Writes document and page, whatever they hold, and files in place of the previews.
    pub(crate) fn write(&self, folder: &Path) -> PathBuf {
        let mut json = serde_json::to_vec(&self.json).unwrap();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend(((28 + json.len() + self.bin.len()) as u32).to_le_bytes());
        out.extend((json.len() as u32).to_le_bytes());
        out.extend(b"JSON");
        out.extend(&json);
        out.extend((self.bin.len() as u32).to_le_bytes());
        out.extend(b"BIN\0");
        out.extend(&self.bin);
        let path = folder.join("planted.glb");
        fs::write(&path, out).unwrap();
        // The writer of the library refuses what is to be planted here.
        let (width, pixels) = (self.page.width as usize, &self.page.pixels);
        let texel = |x: usize, y: usize| <(f32, f32, f32, f32)>::from(pixels[y * width + x]);
        let uri =
            self.json["textures"].as_array().unwrap().iter().find_map(|t| t["extras"]["lightmap"]["uri"].as_str());
        exr::prelude::write_rgba_file(folder.join(uri.unwrap()), width, self.page.height as usize, texel).unwrap();
        for uri in self.json["images"].as_array().into_iter().flatten().filter_map(|i| i["uri"].as_str()) {
            fs::write(folder.join(uri), b"a preview").unwrap();
        }
        path
    }

    pub(crate) fn node(&self, name: &str) -> usize {
        self.json["nodes"].as_array().unwrap().iter().position(|n| n["name"] == name).unwrap()
    }

    pub(crate) fn primitive(&self, (node, primitive): (usize, usize)) -> &Value {
        let mesh = self.json["nodes"][node]["mesh"].as_u64().unwrap() as usize;
        &self.json["meshes"][mesh]["primitives"][primitive]
    }

    /// Where the elements of a tightly packed accessor begin, and how many there are.
    fn accessor(&self, index: &Value) -> (usize, usize) {
        let accessor = &self.json["accessors"][index.as_u64().unwrap() as usize];
        let view = &self.json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let offset = |v: &Value| v["byteOffset"].as_u64().unwrap_or(0) as usize;
        (offset(accessor) + offset(view), accessor["count"].as_u64().unwrap() as usize)
    }

    fn floats<const N: usize>(&self, accessor: &Value) -> Vec<[f32; N]> {
        let (start, count) = self.accessor(accessor);
        let float = |at: usize| f32::from_le_bytes(self.bin[at..at + 4].try_into().unwrap());
        (0..count).map(|i| core::array::from_fn(|c| float(start + 4 * (i * N + c)))).collect()
    }

    pub(crate) fn positions(&self, place: (usize, usize)) -> Vec<[f32; 3]> {
        self.floats(&self.primitive(place)["attributes"]["POSITION"])
    }

    pub(crate) fn uv(&self, place: (usize, usize)) -> Vec<[f32; 2]> {
        self.floats(&self.primitive(place)["attributes"]["TEXCOORD_1"])
    }

    pub(crate) fn triangles(&self, place: (usize, usize)) -> Vec<[usize; 3]> {
        let indices = &self.primitive(place)["indices"];
        let wide = self.json["accessors"][indices.as_u64().unwrap() as usize]["componentType"] == 5125;
        let (start, count) = self.accessor(indices);
        let index = |i: usize| match wide {
            true => word(&self.bin, start + 4 * i),
            false => usize::from(u16::from_le_bytes(self.bin[start + 2 * i..start + 2 * i + 2].try_into().unwrap())),
        };
        (0..count / 3).map(|t| [0, 1, 2].map(|c| index(3 * t + c))).collect()
    }

    /// Changes the lightmap coordinates of some vertices.
    pub(crate) fn change_uv(
        &mut self,
        place: (usize, usize),
        vertices: &[usize],
        change: impl Fn([f32; 2]) -> [f32; 2],
    ) {
        let accessor = self.primitive(place)["attributes"]["TEXCOORD_1"].clone();
        let (all, (start, _)) = (self.uv(place), self.accessor(&accessor));
        for &v in vertices {
            for (c, value) in change(all[v]).into_iter().enumerate() {
                let at = start + 4 * (2 * v + c);
                self.bin[at..at + 4].copy_from_slice(&value.to_le_bytes());
            }
        }
    }

    /// All charts, in the order of nodes, primitives and vertices.
    pub(crate) fn charts(&self) -> Vec<Chart> {
        let mut charts = vec![];
        let size = [self.page.width as f32, self.page.height as f32];
        for node in 0..self.json["nodes"].as_array().unwrap().len() {
            let Some(mesh) = self.json["nodes"][node]["mesh"].as_u64() else { continue };
            for primitive in 0..self.json["meshes"][mesh as usize]["primitives"].as_array().unwrap().len() {
                let place = (node, primitive);
                let uv: Vec<[f32; 2]> = self.uv(place).into_iter().map(|p| [p[0] * size[0], p[1] * size[1]]).collect();
                for vertices in groups(uv.len(), &self.triangles(place)) {
                    let bound =
                        |c: usize, f: fn(f32, f32) -> f32| vertices.iter().map(|v| uv[*v][c]).reduce(f).unwrap();
                    let (low, high) = ([0, 1].map(|c| bound(c, f32::min)), [0, 1].map(|c| bound(c, f32::max)));
                    charts.push(Chart { place, vertices, low, high });
                }
            }
        }
        charts
    }

    /// Texel of a point on the upward faces of a node at height 0.
    pub(crate) fn texel_of(&self, node: usize, [x, z]: [f32; 2]) -> Option<(usize, usize)> {
        let (positions, uv) = (self.positions((node, 0)), self.uv((node, 0)));
        let at = self.triangles((node, 0)).into_iter().find_map(|t| {
            let [a, b, c] = t.map(|v| positions[v]);
            let (e1, e2, p) = ([b[0] - a[0], b[2] - a[2]], [c[0] - a[0], c[2] - a[2]], [x - a[0], z - a[2]]);
            let area = e1[0] * e2[1] - e1[1] * e2[0];
            let (b1, b2) = ((p[0] * e2[1] - p[1] * e2[0]) / area, (e1[0] * p[1] - e1[1] * p[0]) / area);
            let flat = [a, b, c].iter().all(|p| p[1].abs() < 1e-5) && area < 0.0;
            let inside = flat && b1 >= 0.0 && b2 >= 0.0 && b1 + b2 <= 1.0;
            let mix = |k: usize| uv[t[0]][k] * (1.0 - b1 - b2) + uv[t[1]][k] * b1 + uv[t[2]][k] * b2;
            inside.then(|| [mix(0), mix(1)])
        })?;
        Some(((at[0] * self.page.width as f32) as usize, (at[1] * self.page.height as f32) as usize))
    }

    pub(crate) fn texel(&mut self, (x, y): (usize, usize)) -> &mut [f32; 4] {
        &mut self.page.pixels[y * self.page.width as usize + x]
    }

    /// The nearest distance to a covered texel, up to 3.
    pub(crate) fn distance_to_cover(&self, (x, y): (usize, usize)) -> usize {
        let (width, height) = (self.page.width as i32, self.page.height as i32);
        let covered = |x: i32, y: i32| {
            (0..width).contains(&x) && (0..height).contains(&y) && self.page.pixels[(y * width + x) as usize][3] > 0.0
        };
        let ring = |r: i32| (-r..=r).any(|dy| (-r..=r).any(|dx| covered(x as i32 + dx, y as i32 + dy)));
        (0..3).find(|r| ring(*r)).unwrap_or(3) as usize
    }
}

/// Vertices by connection over triangles, in the order of their first ones.
fn groups(count: usize, triangles: &[[usize; 3]]) -> Vec<Vec<usize>> {
    let mut label: Vec<usize> = (0..count).collect();
    loop {
        let mut changed = false;
        for t in triangles {
            let least = t.iter().map(|v| label[*v]).min().unwrap();
            for v in t {
                changed |= label[*v] != least;
                label[*v] = least;
            }
        }
        if !changed {
            break;
        }
    }
    let used = |v: &usize| triangles.iter().flatten().any(|u| u == v);
    let members = |root: usize| (0..count).filter(|v| label[*v] == root).filter(used).collect::<Vec<_>>();
    (0..count).filter(|v| label[*v] == *v).map(members).filter(|m| !m.is_empty()).collect()
}
