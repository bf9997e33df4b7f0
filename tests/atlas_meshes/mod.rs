//! Meshes for the atlas tests, and scenes made of them.

use glam::{Vec2, Vec3, Vec4};
use std::collections::HashMap;
use texelwalk::base::Rgb;
use texelwalk::scene::{Alpha, Material, Part, Scene};

/// Vertices and triangles of one part; `uv1` is empty or complete.
#[derive(Default, Clone)]
pub(crate) struct Mesh {
    pub(crate) positions: Vec<Vec3>,
    pub(crate) normals: Vec<Vec3>,
    pub(crate) uv1: Vec<Vec2>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// A flat quad of steps × steps cells with its own vertices.
    pub(crate) fn quad(&mut self, corners: [Vec3; 4], steps: u32) {
        let first = self.positions.len() as u32;
        let normal = (corners[1] - corners[0]).cross(corners[3] - corners[0]).normalize();
        for j in 0..=steps {
            for i in 0..=steps {
                let (u, v) = (i as f32 / steps as f32, j as f32 / steps as f32);
                let low = corners[0].lerp(corners[1], u);
                self.positions.push(low.lerp(corners[3].lerp(corners[2], u), v));
                self.normals.push(normal);
            }
        }
        self.grid(first, steps, steps);
    }

    fn grid(&mut self, first: u32, columns: u32, rows: u32) {
        for j in 0..rows {
            for i in 0..columns {
                let a = first + j * (columns + 1) + i;
                let b = a + columns + 1;
                self.triangles.push([a, a + 1, b + 1]);
                self.triangles.push([a, b + 1, b]);
            }
        }
    }

    /// A box seen from outside.
    pub(crate) fn cuboid(&mut self, low: Vec3, high: Vec3, steps: u32) {
        let p = |x: f32, y: f32, z: f32| low + (high - low) * Vec3::new(x, y, z);
        self.quad([p(0., 0., 0.), p(0., 1., 0.), p(1., 1., 0.), p(1., 0., 0.)], steps);
        self.quad([p(0., 0., 1.), p(1., 0., 1.), p(1., 1., 1.), p(0., 1., 1.)], steps);
        self.quad([p(0., 0., 0.), p(1., 0., 0.), p(1., 0., 1.), p(0., 0., 1.)], steps);
        self.quad([p(0., 1., 0.), p(0., 1., 1.), p(1., 1., 1.), p(1., 1., 0.)], steps);
        self.quad([p(0., 0., 0.), p(0., 0., 1.), p(0., 1., 1.), p(0., 1., 0.)], steps);
        self.quad([p(1., 0., 0.), p(1., 1., 0.), p(1., 1., 1.), p(1., 0., 1.)], steps);
    }

    /// A surface over a grid in the unit square.
    pub(crate) fn surface(columns: u32, rows: u32, at: impl Fn(f32, f32) -> Vec3) -> Self {
        let mut mesh = Self::default();
        for j in 0..=rows {
            for i in 0..=columns {
                mesh.positions.push(at(i as f32 / columns as f32, j as f32 / rows as f32));
            }
        }
        mesh.grid(0, columns, rows);
        mesh.smooth()
    }

    /// Normals averaged over vertices at the same position.
    pub(crate) fn smooth(mut self) -> Self {
        let key = |p: Vec3| p.to_array().map(f32::to_bits);
        let mut sums: HashMap<[u32; 3], Vec3> = HashMap::new();
        for t in &self.triangles {
            let [a, b, c] = t.map(|v| self.positions[v as usize]);
            for p in [a, b, c] {
                *sums.entry(key(p)).or_insert(Vec3::ZERO) += (b - a).cross(c - a);
            }
        }
        let normal = |p: &Vec3| sums.get(&key(*p)).map_or(Vec3::Z, |n| n.normalize_or_zero());
        self.normals = self.positions.iter().map(normal).collect();
        self
    }

    /// Every position mapped; normals stay.
    pub(crate) fn map(mut self, f: impl Fn(Vec3) -> Vec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p = f(*p));
        self
    }
}

/// Closed, radii 2 m and 1 m.
pub(crate) fn torus(columns: u32, rows: u32) -> Mesh {
    use core::f32::consts::TAU;
    Mesh::surface(columns, rows, |u, v| {
        let (u, v) = (TAU * (u % 1.0), TAU * (v % 1.0));
        Vec3::new((2.0 + libm::cosf(v)) * libm::cosf(u), (2.0 + libm::cosf(v)) * libm::sinf(u), libm::sinf(v))
    })
}

/// Closed, radius 1 m, triangles without area at the poles.
pub(crate) fn sphere(columns: u32, rows: u32) -> Mesh {
    use core::f32::consts::{PI, TAU};
    Mesh::surface(columns, rows, |u, v| {
        let (u, r) = (TAU * (u % 1.0), if v == 1.0 { 0.0 } else { libm::sinf(PI * v) });
        Vec3::new(r * libm::cosf(u), r * libm::sinf(u), -libm::cosf(PI * v))
    })
}

/// Smooth hills, 20 m × 20 m.
pub(crate) fn terrain(steps: u32) -> Mesh {
    Mesh::surface(steps, steps, |u, v| Vec3::new(u * 20.0, v * 20.0, libm::sinf(u * 9.0) * libm::cosf(v * 7.0)))
}

/// An open tube.
pub(crate) fn cylinder(columns: u32) -> Mesh {
    Mesh::surface(columns, 1, |u, v| {
        let u = core::f32::consts::TAU * (u % 1.0);
        Vec3::new(libm::cosf(u), libm::sinf(u), v * 2.0)
    })
}

/// 3 m × 2 m × 1 m.
pub(crate) fn one_box() -> Mesh {
    let mut mesh = Mesh::default();
    mesh.cuboid(Vec3::ZERO, Vec3::new(3.0, 2.0, 1.0), 3);
    mesh
}

/// In [−0.5, 0.5].
pub(crate) fn noise(i: usize) -> f32 {
    let x = (i as u32).wrapping_mul(0x9e37_79b9);
    let x = (x ^ (x >> 15)).wrapping_mul(0x2c1b_3c6d);
    (x ^ (x >> 12)) as f32 / u32::MAX as f32 - 0.5
}

/// Moves positions along themselves, those at the same place together.
pub(crate) fn rough(mut mesh: Mesh, height: f32) -> Mesh {
    for p in &mut mesh.positions {
        let bits = p.to_array().map(|x| (x + 0.0).to_bits());
        let seed = bits[0].wrapping_mul(31).wrapping_add(bits[1]).wrapping_mul(31).wrapping_add(bits[2]) as usize;
        *p *= 1.0 + height * noise(seed);
    }
    mesh.smooth()
}

/// A room with boxes and a sphere: charts of many sizes.
pub(crate) fn interior() -> Vec<Mesh> {
    let mut room = Mesh::default();
    room.cuboid(Vec3::ZERO, Vec3::new(8.0, 6.0, 3.0), 1);
    let mut meshes = vec![room];
    for i in 0..60 {
        let low = Vec3::new(noise(4 * i) * 6.0 + 4.0, noise(4 * i + 1) * 4.0 + 3.0, 0.0);
        let size = Vec3::new(1.1 + noise(i + 900), 1.0 + noise(i + 700), 1.2 + noise(i + 800));
        let mut mesh = Mesh::default();
        mesh.cuboid(low, low + size, 1 + i as u32 % 3);
        meshes.push(mesh);
    }
    meshes.push(sphere(48, 24).map(|p| p * 0.4 + Vec3::new(2.0, 2.0, 1.0)));
    meshes
}

/// A quad of 4 m × 2 m with a layout that fills [0.1, 0.9] × [0.1, 0.5].
pub(crate) fn laid_out() -> Mesh {
    let mut mesh = Mesh::default();
    mesh.quad([Vec3::ZERO, Vec3::X * 4.0, Vec3::new(4.0, 2.0, 0.0), Vec3::Y * 2.0], 4);
    mesh.uv1 = mesh.positions.iter().map(|p| Vec2::new(0.1 + p.x * 0.2, 0.1 + p.y * 0.2)).collect();
    mesh
}

/// The same, with tiny triangles that collapse onto the lower and the right border of the layout.
pub(crate) fn laid_out_with_needles() -> Mesh {
    let mut mesh = laid_out();
    let needles: [[(f32, f32); 3]; 2] = [[(0.2, 0.5), (0.3, 0.5), (0.4, 0.5)], [(0.9, 0.2), (0.9, 0.3), (0.9, 0.4)]];
    for needle in needles {
        let first = mesh.positions.len() as u32;
        for (k, (u, v)) in needle.into_iter().enumerate() {
            mesh.positions.push(Vec3::new(k as f32 % 2.0, k as f32 / 2.0, 0.0) * 1e-5);
            mesh.normals.push(Vec3::Z);
            mesh.uv1.push(Vec2::new(u, v));
        }
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh
}

/// Faults that real files have.
pub(crate) fn bad_meshes() -> Vec<(&'static str, Mesh)> {
    let scales = {
        let mut mesh = rough(sphere(20, 10), 0.2).map(|p| p * 1e-3);
        mesh.quad([Vec3::ZERO, Vec3::X * 9.0, Vec3::new(9.0, 9.0, 0.0), Vec3::Y * 9.0], 1);
        mesh
    };
    vec![
        ("four copies", four_copies()),
        ("fan", fan()),
        ("degenerate", degenerate()),
        ("slivers", slivers()),
        ("soup", soup()),
        ("mixed scales", scales),
        ("far away", terrain(24).map(|p| p * 0.2 + Vec3::splat(1e6))),
        ("rough", rough(sphere(24, 12), 0.6)),
    ]
}

/// Every triangle twice, and twice more turned over.
fn four_copies() -> Mesh {
    let mut mesh = one_box();
    mesh.triangles.extend(mesh.triangles.clone());
    mesh.triangles.extend(mesh.triangles.clone().iter().map(|t| [t[0], t[2], t[1]]));
    mesh
}

/// A thousand triangles on one edge.
fn fan() -> Mesh {
    let mut mesh = Mesh { positions: vec![Vec3::ZERO, Vec3::Z], ..Mesh::default() };
    for i in 0..1000u32 {
        let angle = i as f32 * 0.006;
        mesh.positions.push(Vec3::new(libm::cosf(angle), libm::sinf(angle), 0.5));
        mesh.triangles.push([0, 1, i + 2]);
    }
    mesh.smooth()
}

/// Collinear corners, equal indices.
fn degenerate() -> Mesh {
    let mut mesh = one_box();
    let far = mesh.positions.len() as u32;
    mesh.positions.extend([Vec3::X * 9.0, Vec3::X * 10.0, Vec3::X * 11.0]);
    mesh.normals.extend([Vec3::Z; 3]);
    mesh.triangles.extend([[far, far + 1, far + 2], [far, far, far + 1], [0, 0, 0], [0, 1, 0]]);
    mesh
}

/// Needles of 1 m × 0 … 50 µm.
fn slivers() -> Mesh {
    let mut mesh = Mesh::default();
    mesh.quad([Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y], 4);
    for i in 0..50u32 {
        let first = mesh.positions.len() as u32;
        let y = 2.0 + i as f32 * 0.1;
        let tip = Vec3::new(0.5, y + 1e-6 * i as f32, 0.0);
        mesh.positions.extend([Vec3::new(0.0, y, 0.0), Vec3::new(1.0, y, 0.0), tip]);
        mesh.normals.extend([Vec3::Z; 3]);
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh
}

/// Triangles that have nothing to do with each other.
fn soup() -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..1500 {
        mesh.positions.push(Vec3::new(noise(3 * i), noise(3 * i + 1), noise(3 * i + 2)) * 3.0);
    }
    mesh.triangles = (0..500).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    mesh.smooth()
}

/// One part and node per mesh.
pub(crate) fn scene(meshes: &[Mesh]) -> Scene {
    let mut scene = Scene { materials: vec![material()], ..Scene::default() };
    scene.vertices.uv = vec![Vec::new(), Vec::new()];
    for (node, mesh) in meshes.iter().enumerate() {
        let (first, triangle) = (scene.vertices.position.len() as u32, scene.triangles.len() as u32);
        let count = mesh.positions.len();
        scene.vertices.position.extend(&mesh.positions);
        scene.vertices.normal.extend(&mesh.normals);
        scene.vertices.color.extend(vec![Vec4::ONE; count]);
        scene.vertices.uv[0].extend(vec![Vec2::ZERO; count]);
        let has_uv1 = !mesh.uv1.is_empty();
        scene.vertices.uv[1].extend(if has_uv1 { mesh.uv1.clone() } else { vec![Vec2::ZERO; count] });
        scene.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)));
        scene.triangle_part.extend(vec![node as u32; mesh.triangles.len()]);
        scene.parts.push(Part {
            node,
            mesh: node,
            primitive: 0,
            name: format!("node {node}"),
            vertices: first..scene.vertices.position.len() as u32,
            triangles: triangle..scene.triangles.len() as u32,
            material: 0,
            mirrored: false,
            scale: 1.0,
            axes: [1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
            flat: false,
            has_normals: true,
            has_uv1,
            receives: true,
            treatment: texelwalk::scene::Treatment::default(),
        });
    }
    scene
}

fn material() -> Material {
    Material {
        name: "material 0".to_owned(),
        base_color: Vec4::ONE,
        base_color_texture: None,
        metallic: 0.0,
        metallic_texture: None,
        diffuse_texture: None,
        emission: Rgb::ZERO,
        emission_texture: None,
        specular: Vec3::ZERO,
        specular_texture: None,
        transmission: 0.0,
        transmission_texture: None,
        volume: None,
        translucency: None,
        alpha: Alpha::Opaque,
        double_sided: false,
        unlit: false,
        lightmap_uv_set: None,
        lightmap_texture: None,
        normal_map: None,
    }
}
