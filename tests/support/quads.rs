//! Scenes of quads as glTF documents, and bakes of them by the program.

#![allow(dead_code, reason = "each test program uses its own part of this file")]

use base64::Engine;
use exr::prelude::{ReadChannels, ReadLayers};
use glam::{Quat, Vec3};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use texelwalk::output::exr::read_rgba;

/// A rectangle with its front toward `u` × `v`.
#[derive(Clone)]
pub(crate) struct Quad {
    corner: Vec3,
    u: Vec3,
    v: Vec3,
    shading: Option<Vec3>,
    material: Value,
}

/// Quads, and lights with their place and the direction that they shine from.
pub(crate) struct Scene {
    pub(crate) quads: Vec<Quad>,
    pub(crate) lights: Vec<(Value, Vec3, Vec3)>,
}

/// A bake in a folder of its own.
pub(crate) struct Baked {
    home: tempfile::TempDir,
    pub(crate) report: Value,
}

pub(crate) fn grey(reflectance: f32) -> Value {
    json!({"pbrMetallicRoughness": {"baseColorFactor": [reflectance, reflectance, reflectance, 1.0], "metallicFactor": 0}})
}

pub(crate) fn black() -> Value {
    grey(0.0)
}

pub(crate) fn glowing(radiance: [f32; 3]) -> Value {
    let mut material = black();
    let most = radiance.iter().fold(0.0f32, |a, b| a.max(*b));
    material["emissiveFactor"] = json!(radiance.map(|v| v / most));
    material["extensions"] = json!({"KHR_materials_emissive_strength": {"emissiveStrength": most}});
    material
}

impl Quad {
    pub(crate) fn new(corner: [f32; 3], u: [f32; 3], v: [f32; 3], material: Value) -> Self {
        let [corner, u, v] = [corner, u, v].map(Vec3::from_array);
        Self { corner, u, v, shading: None, material }
    }

    /// A square in y = 0 that faces up.
    pub(crate) fn floor(low: f32, edge: f32, material: Value) -> Self {
        Self::new([low, 0.0, low], [0.0, 0.0, edge], [edge, 0.0, 0.0], material)
    }

    /// The six sides of a box that face inward, the floor first.
    pub(crate) fn room(low: [f32; 3], size: [f32; 3], material: Value) -> Vec<Self> {
        let (low, size) = (Vec3::from_array(low), Vec3::from_array(size));
        let axes = [Vec3::X * size.x, Vec3::Y * size.y, Vec3::Z * size.z];
        let side = |k: usize, from: Vec3, inward: Vec3| {
            Self { corner: from, u: axes[(k + 1) % 3], v: axes[(k + 2) % 3], shading: None, material: material.clone() }
                .facing(inward)
        };
        [1, 0, 2].into_iter().flat_map(|k| [side(k, low, axes[k]), side(k, low + axes[k], -axes[k])]).collect()
    }

    /// Turned so that its front is on this side.
    pub(crate) fn facing(mut self, side: Vec3) -> Self {
        if self.u.cross(self.v).dot(side) < 0.0 {
            (self.u, self.v) = (self.v, self.u);
        }
        self
    }

    /// Turned about the origin.
    pub(crate) fn turned(self, by: Quat) -> Self {
        Self { corner: by * self.corner, u: by * self.u, v: by * self.v, ..self }
    }

    /// The same rectangle with its front on the other side, and cut along the other diagonal.
    pub(crate) fn other_side(self) -> Self {
        Self { corner: self.corner + self.u, u: -self.u, ..self }
    }

    /// Moves it up.
    pub(crate) fn lift(&mut self, by: f32) {
        self.corner.y += by;
    }

    /// Its centre.
    pub(crate) fn middle(&self) -> Vec3 {
        self.corner + (self.u + self.v) / 2.0
    }

    /// With this normal at all of its vertices.
    pub(crate) fn shaded(mut self, normal: Vec3) -> Self {
        self.shading = Some(normal);
        self
    }
}

impl Scene {
    /// With one light more, at a place, that shines from a direction.
    pub(crate) fn with(mut self, light: Value, at: Vec3, from: Vec3) -> Self {
        self.lights.push((light, at, from));
        self
    }

    /// As glTF, all in one scene.
    pub(crate) fn document(&self) -> Value {
        let (mut bytes, mut views, mut accessors) = (vec![], vec![], vec![]);
        let mut add = |data: Vec<u8>, accessor: Value| {
            views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": data.len()}));
            bytes.extend(data);
            accessors.push(accessor);
            accessors.last_mut().unwrap()["bufferView"] = json!(views.len() - 1);
            accessors.len() - 1
        };
        let floats = |v: &[Vec3]| v.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
        let indices: Vec<u8> = [0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect();
        let indices = add(indices, json!({"componentType": 5123, "count": 6, "type": "SCALAR"}));
        let (mut meshes, mut nodes, mut materials) = (vec![], vec![], vec![]);
        for quad in &self.quads {
            let Quad { corner, u, v, .. } = *quad;
            let p = [corner, corner + u, corner + u + v, corner + v];
            let (low, high) = (p.iter().fold(p[0], |a, b| a.min(*b)), p.iter().fold(p[0], |a, b| a.max(*b)));
            let bounds = json!({"componentType": 5126, "count": 4, "type": "VEC3", "min": low.to_array(), "max": high.to_array()});
            let position = add(floats(&p), bounds);
            let normal = quad.shading.unwrap_or_else(|| u.cross(v).normalize());
            let normal = add(floats(&[normal; 4]), json!({"componentType": 5126, "count": 4, "type": "VEC3"}));
            let attributes = json!({"POSITION": position, "NORMAL": normal});
            let primitive = json!({"attributes": attributes, "indices": indices, "material": materials.len()});
            materials.push(quad.material.clone());
            meshes.push(json!({"primitives": [primitive]}));
            nodes.push(json!({"mesh": meshes.len() - 1}));
        }
        for (k, (_, at, from)) in self.lights.iter().enumerate() {
            let turn = Quat::from_rotation_arc(Vec3::Z, from.normalize());
            let extension = json!({"KHR_lights_punctual": {"light": k}});
            nodes.push(json!({"translation": at.to_array(), "rotation": turn.to_array(), "extensions": extension}));
        }
        let lights: Vec<&Value> = self.lights.iter().map(|l| &l.0).collect();
        let uri = base64::engine::general_purpose::STANDARD.encode(&bytes);
        let mut document = json!({
            "asset": {"version": "2.0"},
            "buffers": [{"byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{uri}")}],
            "bufferViews": views, "accessors": accessors, "meshes": meshes, "materials": materials,
            "scenes": [{"nodes": (0..nodes.len()).collect::<Vec<_>>()}], "scene": 0, "nodes": nodes,
            "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_emissive_strength"],
        });
        if !lights.is_empty() {
            document["extensions"] = json!({"KHR_lights_punctual": {"lights": lights}});
        }
        document
    }

    /// Bakes it.
    pub(crate) fn bake(&self, options: &[&str]) -> Baked {
        let home = tempfile::tempdir().unwrap();
        let input = home.path().join("in.gltf");
        fs::write(&input, self.document().to_string()).unwrap();
        bake(home, &input, options)
    }
}

/// Bakes a file of `fixtures`.
pub(crate) fn bake_fixture(name: &str, options: &[&str]) -> Baked {
    let input = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name);
    bake_file(&input, options)
}

/// Bakes a file anywhere.
pub(crate) fn bake_file(input: &Path, options: &[&str]) -> Baked {
    bake(tempfile::tempdir().unwrap(), input, options)
}

fn bake(home: tempfile::TempDir, input: &Path, options: &[&str]) -> Baked {
    let out = home.path().join("baked");
    fs::create_dir(&out).unwrap();
    let report = home.path().join("report.json");
    let mut command = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    command.arg("bake").arg(input).arg("-o").arg(out.join("out.gltf")).arg("--report").arg(&report);
    let output = command.arg("-q").args(options).stdin(Stdio::null()).output().unwrap();
    assert!(output.status.success(), "{options:?}: {}", String::from_utf8_lossy(&output.stderr));
    let report = serde_json::from_slice(&fs::read(report).unwrap()).unwrap();
    Baked { home, report }
}

impl Baked {
    /// Where a file of the bake is.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.home.path().join("baked").join(name)
    }

    /// Texels of a page, by the end of its name.
    pub(crate) fn page(&self, name: &str) -> Vec<[f32; 4]> {
        read_rgba(&self.path(&format!("out.{name}"))).unwrap().pixels
    }

    /// Width of a page [texels].
    pub(crate) fn width(&self, name: &str) -> usize {
        read_rgba(&self.path(&format!("out.{name}"))).unwrap().width as usize
    }

    /// A channel of the first file of layers.
    pub(crate) fn layer(&self, name: &str) -> Vec<f32> {
        let read = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
        let image = read.all_attributes().from_file(self.path("out.aov0.exr")).unwrap();
        let channel = image.layer_data.channel_data.list.iter().find(|c| c.name.to_string() == name).unwrap();
        channel.sample_data.values_as_f32().collect()
    }

    /// All files, in order.
    pub(crate) fn names(&self) -> Vec<String> {
        let list = fs::read_dir(self.path("")).unwrap();
        let mut names: Vec<String> = list.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    pub(crate) fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap()
    }

    pub(crate) fn document(&self) -> Value {
        serde_json::from_slice(&self.bytes("out.gltf")).unwrap()
    }
}
