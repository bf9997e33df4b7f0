//! Sealed rooms on a floor that goes on outside, baked and looked at from inside and outside as an engine would.

#![allow(dead_code, clippy::unwrap_used, reason = "tests; each uses a part of it")]

use crate::gltf_builder::{self, Builder};
use glam::{Mat3, Vec2, Vec3};
use serde_json::json;
use std::path::PathBuf;
use std::sync::Arc;
use texelwalk::bake::{self, Observer, Outcome, Request};
use texelwalk::base::Progress;
use texelwalk::scene::{self, Scene};
use texelwalk::settings::{Options, Preset};
use texelwalk::trace::{Ray, Tracer};

/// A rectangle: corner, edges, front toward u × v.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rect {
    pub(crate) corner: Vec3,
    pub(crate) u: Vec3,
    pub(crate) v: Vec3,
}

/// Things of a scene, each a node of rectangles.
#[derive(Debug, Clone, Default)]
pub(crate) struct Place {
    pub(crate) things: Vec<(String, Vec<Rect>)>,
    /// Foot and height of the upright edges of things [m].
    pub(crate) upright: Vec<(Vec3, f32)>,
    /// Where walls begin and end, along x, y and z [m].
    pub(crate) lines: [Vec<f32>; 3],
    /// Points of view in the dark.
    pub(crate) inside: Vec<Vec3>,
    /// Turn about the up axis [rad], and shift [m], of all of it.
    pub(crate) turn: f32,
    pub(crate) shift: Vec3,
}

/// Illuminance of the sun [lx].
pub(crate) const SUN: f32 = 1000.0;

/// From where the sun shines, before the scene is turned.
pub(crate) fn toward_sun() -> Vec3 {
    Vec3::new(0.45, 1.0, 0.6).normalize()
}

impl Place {
    /// An upward sheet at height 0, or a piece of it.
    pub(crate) fn sheet(&mut self, name: &str, [x0, z0]: [f32; 2], [x1, z1]: [f32; 2]) {
        let rect = Rect { corner: Vec3::new(x0, 0.0, z0), u: Vec3::Z * (z1 - z0), v: Vec3::X * (x1 - x0) };
        self.things.push((name.to_owned(), vec![rect]));
    }

    /// A box with outward fronts.
    pub(crate) fn solid(&mut self, name: &str, low: Vec3, high: Vec3) {
        let d = high - low;
        // Every coordinate of a corner is one of `low` or of `far`, bit by bit, so that the sides close.
        let far = low + d;
        let (x, y, z) = (Vec3::X * d.x, Vec3::Y * d.y, Vec3::Z * d.z);
        let rect = |corner, u, v| Rect { corner, u, v };
        let sides = [
            rect(low, z, y),
            rect(low, x, z),
            rect(low, y, x),
            rect(low.with_x(far.x), y, z),
            rect(low.with_y(far.y), z, x),
            rect(low.with_z(far.z), x, y),
        ];
        self.things.push((name.to_owned(), sides.to_vec()));
        for (x, z) in [(low.x, low.z), (low.x, high.z), (high.x, low.z), (high.x, high.z)] {
            self.upright.push((Vec3::new(x, low.y, z), d.y));
        }
        for (axis, lines) in self.lines.iter_mut().enumerate() {
            lines.extend([low[axis], high[axis]]);
        }
    }

    fn world(&self, p: Vec3) -> Vec3 {
        Mat3::from_rotation_y(self.turn) * p + self.shift
    }

    /// The document, changed at the end: a mesh per thing, four vertices per rectangle.
    pub(crate) fn glb_with(&self, change: impl Fn(&mut Builder)) -> Vec<u8> {
        let mut builder = Builder::new();
        builder.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
        builder.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [
            {"type": "directional", "intensity": SUN, "color": [1.0, 1.0, 1.0]}]}});
        builder.push(
            "materials",
            json!({"pbrMetallicRoughness": {"baseColorFactor": [0.7, 0.7, 0.7, 1.0],
            "metallicFactor": 0.0}}),
        );
        for (name, rects) in &self.things {
            let (mut positions, mut normals, mut indices) = (vec![], vec![], vec![]);
            for (k, rect) in (0u16..).zip(rects) {
                let Rect { corner, u, v } = *rect;
                for p in [corner, corner + u, corner + u + v, corner + v] {
                    positions.extend(self.world(p).to_array());
                    normals.extend((Mat3::from_rotation_y(self.turn) * u.cross(v).normalize()).to_array());
                }
                indices.extend([0, 1, 2, 0, 2, 3].map(|i| 4 * k + i));
            }
            let bound = |f: fn(f32, f32) -> f32| -> Vec<f32> {
                (0..3).map(|c| positions.iter().skip(c).step_by(3).copied().reduce(f).unwrap()).collect()
            };
            let (low, high) = (bound(f32::min), bound(f32::max));
            let position = builder.floats("VEC3", &positions);
            builder.json["accessors"][position]["min"] = json!(low);
            builder.json["accessors"][position]["max"] = json!(high);
            let normal = builder.floats("VEC3", &normals);
            let count = indices.len();
            let index = builder.accessor(5123, "SCALAR", count, &gltf_builder::words(&indices), json!({}));
            let attributes = json!({"POSITION": position, "NORMAL": normal});
            let primitive = json!({"attributes": attributes, "indices": index, "material": 0});
            let mesh = builder.push("meshes", json!({"primitives": [primitive]}));
            builder.push("nodes", json!({"name": name, "mesh": mesh}));
        }
        // A directional light shines along −z.
        let to = Mat3::from_rotation_y(self.turn) * -toward_sun();
        let turn = glam::Quat::from_rotation_arc(Vec3::NEG_Z, to);
        builder.push(
            "nodes",
            json!({"name": "sun", "rotation": turn.to_array(), "extensions": {"KHR_lights_punctual": {"light": 0}}}),
        );
        let nodes: Vec<usize> = (0..=self.things.len()).collect();
        builder.push("scenes", json!({"nodes": nodes}));
        builder.json["scene"] = json!(0);
        change(&mut builder);
        builder.glb(&[])
    }
}

/// A bake on the disk.
pub(crate) struct Baked {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) path: PathBuf,
    pub(crate) source: Scene,
    pub(crate) scene: Scene,
    pub(crate) outcome: Outcome,
}

struct Silent;

impl Observer for Silent {
    fn stage(&self, _: &'static str, _: &Arc<Progress>) {}
    fn done(&self, _: &'static str, _: f64) {}
}

/// Bakes a file of bytes with some options over those of the preview.
pub(crate) fn bake_glb(glb: &[u8], options: &str) -> Baked {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("in.glb");
    std::fs::write(&input, glb).unwrap();
    let options = Options::from_toml(options).unwrap().over(Options::preset(Preset::Preview).unwrap());
    let output = folder.path().join("out.glb");
    let request = Request::new(input.clone(), output, options.settings().unwrap(), Preset::Preview);
    let outcome = bake::bake(&request, &Silent, Arc::new(Progress::default())).unwrap();
    let load = |path: &PathBuf| scene::load(path, &scene::Settings::default()).unwrap().output;
    Baked { path: request.output.clone(), source: load(&input), scene: load(&request.output), outcome, folder }
}

/// What the look-ups found, relative to the sun's light on what it shines at.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Seen {
    /// Brightest point that can be seen from inside.
    pub(crate) dark: f32,
    pub(crate) dark_at: Vec3,
    pub(crate) dark_points: usize,
    /// Least light of a point that the sun shines at, over what the sun gives it.
    pub(crate) lit: f32,
    pub(crate) lit_at: Vec3,
    pub(crate) lit_points: usize,
}

/// Distances from the lines at which is looked [m].
const BESIDE: [f32; 5] = [0.001, 0.003, 0.009, 0.02, 0.045];
/// Light, of what the sun gives, from which on a point is lit as it should be.
pub(crate) const LIT: f32 = 0.97;
/// Points along a side of a rectangle that are even.
const EVEN: usize = 23;
/// Distances at which all that is in the open must be lit as well: no edge of a shadow is near [m].
const AROUND: [f32; 6] = [0.3, 0.2, 0.12, 0.06, 0.02, 0.005];

impl Place {
    /// Bakes it.
    pub(crate) fn bake(&self, options: &str) -> Baked {
        bake_glb(&self.glb_with(|_| ()), options)
    }

    /// Looks at every surface, also a millimetre from all lines.
    pub(crate) fn look(&self, baked: &Baked) -> Seen {
        let tracer = Tracer::new(&baked.scene);
        let mut seen = Seen { lit: f32::INFINITY, ..Seen::default() };
        let sun = Mat3::from_rotation_y(self.turn) * toward_sun();
        let cameras: Vec<Vec3> = self.inside.iter().map(|p| self.world(*p)).collect();
        for rect in self.things.iter().flat_map(|(_, rects)| rects) {
            let normal = Mat3::from_rotation_y(self.turn) * rect.u.cross(rect.v).normalize();
            for a in self.places(rect.corner, rect.u) {
                for b in self.places(rect.corner, rect.v) {
                    let p = self.world(rect.corner + rect.u * a + rect.v * b);
                    let above = p + normal * 2e-4;
                    let Some(value) = look_up(baked, &tracer, p, normal) else { continue };
                    if cameras.iter().any(|c| tracer.segment_clear(*c, above)) {
                        seen.dark_points += 1;
                        if value > seen.dark {
                            (seen.dark, seen.dark_at) = (value, p);
                        }
                    } else if normal.dot(sun) > 0.1 {
                        let share = value / (SUN * normal.dot(sun) * core::f32::consts::FRAC_1_PI);
                        // What is bright enough is in the sun; only for what is not must be known whether it should be.
                        if share < LIT && !self.is_sunny(&tracer, p, normal, sun) {
                            continue;
                        }
                        seen.lit_points += 1;
                        if share < seen.lit {
                            (seen.lit, seen.lit_at) = (share, p);
                        }
                    }
                }
            }
        }
        seen.dark /= SUN * core::f32::consts::FRAC_1_PI;
        seen
    }

    /// Parts of the way along an edge from a corner.
    fn places(&self, corner: Vec3, edge: Vec3) -> Vec<f32> {
        let length = edge.length();
        let mut all: Vec<f32> = (0..EVEN).map(|k| (k as f32 + 0.5) / EVEN as f32).collect();
        let axis = (0..3).find(|k| edge[*k].abs() > 0.999 * length);
        for line in axis.iter().flat_map(|axis| &self.lines[*axis]) {
            let axis = axis.unwrap();
            let at = (line - corner[axis]) / edge[axis];
            all.extend(BESIDE.iter().flat_map(|d| [at - d / length, at + d / length]));
        }
        let clear = |t: f32| {
            let lines =
                axis.iter().flat_map(|axis| self.lines[*axis].iter().map(|l| (l - corner[*axis]) / edge[*axis]));
            lines.map(|at| (at - t).abs() * length).all(|d| d > 9e-4)
        };
        all.retain(|t| *t * length > 9e-4 && (1.0 - *t) * length > 9e-4 && clear(*t));
        all
    }

    /// The sun shines at a point, and on all that is in the open around it.
    fn is_sunny(&self, tracer: &Tracer<'_>, p: Vec3, normal: Vec3, sun: Vec3) -> bool {
        let free = |p: Vec3| !tracer.occluded(&Ray { origin: p + normal * 2e-4, direction: sun, t_max: 1e3 });
        let (s, t) = normal.any_orthonormal_pair();
        free(p)
            && !self.is_near_upright(p)
            && (0..48).all(|k| {
                let (sin, cos) = libm::sincosf(k as f32 * 0.130_9);
                AROUND.iter().all(|r| {
                    let q = p + (s * cos + t * sin) * *r;
                    free(q) || !tracer.segment_clear(p + normal * 2e-4, q + normal * 2e-4)
                })
            })
    }
}

impl Place {
    /// A shadow may begin at an upright edge, and texels there rightly hold a part of it.
    fn is_near_upright(&self, p: Vec3) -> bool {
        self.upright.iter().any(|(foot, height)| {
            let foot = self.world(*foot);
            let on = foot + Vec3::Y * (p.y - foot.y).clamp(0.0, *height);
            on.distance(p) < AROUND[0]
        })
    }
}

/// What an engine reads at a point of the surface; `None` where another surface lies over it.
pub(crate) fn look_up(baked: &Baked, tracer: &Tracer<'_>, p: Vec3, normal: Vec3) -> Option<f32> {
    let hit = tracer.closest_hit(&Ray { origin: p + normal * 4e-4, direction: -normal, t_max: 8e-4 })?;
    let scene = &baked.scene;
    if !hit.front || scene.geometric_normal(hit.triangle).dot(normal) < 0.99 {
        return None;
    }
    let set = &scene.vertices.uv[1];
    let [a, b, c] = scene.triangles[hit.triangle as usize].map(|v| set[v as usize]);
    let uv = a + (b - a) * hit.b.x + (c - a) * hit.b.y;
    Some(bilinear(baked, uv))
}

/// The largest channel of a look-up.
pub(crate) fn bilinear(baked: &Baked, uv: Vec2) -> f32 {
    assert_eq!(baked.outcome.lightmap.pages.len(), 1);
    let page = &baked.outcome.lightmap.pages[0];
    let at = uv * Vec2::new(page.width as f32, page.height as f32) - 0.5;
    let (floor, f) = (at.floor(), at - at.floor());
    let texel = |dx: f32, dy: f32| {
        let x = (floor.x + dx).clamp(0.0, page.width as f32 - 1.0) as usize;
        let y = (floor.y + dy).clamp(0.0, page.height as f32 - 1.0) as usize;
        let [r, g, b, _] = page.pixels[y * page.width as usize + x];
        r.max(g).max(b)
    };
    (texel(0.0, 0.0) * (1.0 - f.x) + texel(1.0, 0.0) * f.x) * (1.0 - f.y)
        + (texel(0.0, 1.0) * (1.0 - f.x) + texel(1.0, 1.0) * f.x) * f.y
}
