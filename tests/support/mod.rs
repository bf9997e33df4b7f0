//! Scenes built by hand, for tests that need geometry and no file.
#![allow(dead_code, reason = "each test program uses a part")]
#![allow(unreachable_pub, reason = "shared by test programs")]

use glam::{DMat3, DVec3, Vec2, Vec3, Vec4};
use texelwalk::base::Stream;
use texelwalk::base::random::Stage;
use texelwalk::scene::{Alpha, Material, Part, Scene};

/// An opaque, white, one-sided material.
pub fn white() -> Material {
    Material {
        name: "white".into(),
        base_color: Vec4::ONE,
        base_color_texture: None,
        metallic: 0.0,
        metallic_texture: None,
        diffuse_texture: None,
        emission: Vec3::ZERO,
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

/// Triangles of one part with one white material; three vertices each.
pub fn scene_from_triangles(triangles: &[[Vec3; 3]]) -> Scene {
    scene_with_material(triangles, white())
}

/// Triangles of one part with the given material; three vertices each, white vertex colours.
pub fn scene_with_material(triangles: &[[Vec3; 3]], material: Material) -> Scene {
    let mut scene = Scene::default();
    for (i, corners) in triangles.iter().enumerate() {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        for &p in corners {
            scene.vertices.position.push(p);
            scene.vertices.normal.push(normal);
            scene.vertices.color.push(Vec4::ONE);
        }
        let first = 3 * i as u32;
        scene.triangles.push([first, first + 1, first + 2]);
        scene.triangle_part.push(0);
    }
    scene.vertices.uv = vec![vec![Vec2::ZERO; 3 * triangles.len()]];
    let n = triangles.len() as u32;
    scene.parts.push(Part {
        node: 0,
        mesh: 0,
        primitive: 0,
        name: "part".into(),
        vertices: 0..3 * n,
        triangles: 0..n,
        material: 0,
        mirrored: false,
        scale: 1.0,
        axes: [1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
        flat: true,
        has_normals: false,
        has_uv1: false,
        receives: true,
        treatment: texelwalk::scene::Treatment::default(),
    });
    scene.materials.push(material);
    scene
}

/// Two parts: triangles with a white material, and triangles with another one.
pub fn scene_of_two(first: &[[Vec3; 3]], second: &[[Vec3; 3]], material: Material) -> Scene {
    let all: Vec<_> = first.iter().chain(second).copied().collect();
    let mut scene = scene_from_triangles(&all);
    let (split, end) = (first.len() as u32, all.len() as u32);
    scene.materials.push(material);
    let part = |range: core::ops::Range<u32>, material: usize| Part {
        vertices: 3 * range.start..3 * range.end,
        triangles: range,
        material,
        ..scene.parts[0].clone()
    };
    scene.parts = vec![part(0..split, 0), part(split..end, 1)];
    scene.triangle_part[split as usize..].fill(1);
    scene
}

/// A fixed-seed stream for a test.
pub fn stream(seed: u64) -> Stream {
    Stream::new(seed, Stage::Render, 0, 0)
}

/// A point of the unit cube around 0.
pub fn point(s: &mut Stream) -> DVec3 {
    DVec3::new(s.next_f64() - 0.5, s.next_f64() - 0.5, s.next_f64() - 0.5)
}

/// A direction, uniform on the sphere.
pub fn direction(s: &mut Stream) -> DVec3 {
    loop {
        let p = point(s) * 2.0;
        if (1e-4..1.0).contains(&p.length_squared()) {
            return p.normalize();
        }
    }
}

/// A rotation that aligns nothing with an axis.
pub fn skew() -> DMat3 {
    DMat3::from_axis_angle(DVec3::new(0.36, 0.48, 0.8), 0.7)
}

/// Applies p → rotation · p · scale + offset in f64, then rounds.
pub fn place(triangles: &[[DVec3; 3]], rotation: DMat3, scale: f64, offset: DVec3) -> Vec<[Vec3; 3]> {
    triangles.iter().map(|t| t.map(|p| (rotation * p * scale + offset).as_vec3())).collect()
}

/// A rectangle of n × m cells of two triangles; front side along u × v.
pub fn grid(corner: DVec3, u: DVec3, v: DVec3, n: usize, m: usize, out: &mut Vec<[DVec3; 3]>) {
    let at = |i: usize, j: usize| corner + u * (i as f64 / n as f64) + v * (j as f64 / m as f64);
    for i in 0..n {
        for j in 0..m {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            out.push([a, b, c]);
            out.push([a, c, d]);
        }
    }
}

/// The six sides of a box, n × n cells each, front sides outward (inward if `inward`).
pub fn cuboid(low: DVec3, high: DVec3, n: usize, inward: bool, out: &mut Vec<[DVec3; 3]>) {
    let e = high - low;
    let axes = [DVec3::X * e.x, DVec3::Y * e.y, DVec3::Z * e.z];
    for k in 0..3 {
        let (u, v) = (axes[(k + 1) % 3], axes[(k + 2) % 3]);
        let (from_low, from_high) = if inward { ([u, v], [v, u]) } else { ([v, u], [u, v]) };
        grid(low, from_low[0], from_low[1], n, n, out);
        grid(low + axes[k], from_high[0], from_high[1], n, n, out);
    }
}

/// A room of 1 × 1 × 1 around 0 with furniture that stands on its floor.
pub fn room(cells: usize) -> Vec<[DVec3; 3]> {
    let mut out = Vec::new();
    cuboid(DVec3::splat(-0.5), DVec3::splat(0.5), cells, true, &mut out);
    for (x, z, w, h) in [(-0.3, -0.3, 0.2, 0.3), (0.1, -0.4, 0.3, 0.15), (0.2, 0.2, 0.05, 0.6), (-0.4, 0.25, 0.1, 0.1)]
    {
        cuboid(DVec3::new(x, -0.5, z), DVec3::new(x + w, -0.5 + h, z + w), 2, false, &mut out);
    }
    out
}

/// A closed sphere-like surface around 0: an octahedron, each side cut into n² triangles, bumpy, radius about 0.5.
pub fn blob(n: usize, bumps: f64) -> Vec<[DVec3; 3]> {
    let radius = |p: DVec3| 0.5 * (1.0 + bumps * (p.x * 17.0).sin() * (p.y * 13.0).cos() * (p.z * 11.0 + 1.0).sin());
    let mut out = Vec::new();
    for side in 0..8 {
        let s = |bit: usize| if side >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let (x, mut y, mut z) = (DVec3::X * s(0), DVec3::Y * s(1), DVec3::Z * s(2));
        if x.cross(y).dot(z) < 0.0 {
            (y, z) = (z, y);
        }
        // Whole numbers are added and then divided, so that neighbours on both sides get the same bits.
        let at = |i: usize, j: usize| {
            let p = x * i as f64 + y * j as f64 + z * (n - i - j) as f64;
            let p = p / p.length();
            p * radius(p)
        };
        for i in 0..n {
            for j in 0..n - i {
                out.push([at(i + 1, j), at(i, j + 1), at(i, j)]);
                if i + j + 2 <= n {
                    out.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
    }
    out
}

/// Triangles of all shapes and sizes that go through each other.
pub fn soup(n: usize, size: f64, seed: u64) -> Vec<[DVec3; 3]> {
    let mut s = stream(seed);
    (0..n)
        .map(|i| {
            let centre = point(&mut s);
            let thin = [1.0, 0.1, 1e-4][i % 3];
            let (a, b) = (point(&mut s) * size, point(&mut s) * size);
            [centre, centre + a, centre + a * s.next_f64() + b * thin]
        })
        .collect()
}
