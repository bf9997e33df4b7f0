//! What holds for the patches and links of every scene, whatever its geometry.

#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/solve.rs"]
mod solve;
#[path = "support/mod.rs"]
mod support;

use glam::{Affine2, Vec2, Vec3};
use solve::{Stage, load};
use std::collections::BTreeSet;
use std::time::Instant;
use support::{scene_with_material, white};
use texelwalk::atlas::NO_CHART;
use texelwalk::base::random::{Stage as Draws, Stream};
use texelwalk::base::{Progress, Rgb};
use texelwalk::patches::{PatchSurface, Patches};
use texelwalk::scene::{Material, Part, Texture, TextureRef, Wrap};

/// Boxes with normals of their own, smooth legs, textures, sheets with two sides, mirrored instances.
const SCENES: [(&str, f32); 4] = [
    ("office/office.glb", 6.0),
    ("chairs/chairs.glb", 12.0),
    ("fence/fence.gltf", 4.0),
    ("primitives/primitives.gltf", 6.0),
];

#[test]
fn areas_add_up_to_what_was_charted_and_no_texel_has_two_fronts() {
    for (name, density) in SCENES {
        let scene = load(name);
        let stage = Stage::new(&scene, density);
        let (p, atlas) = (&stage.patches, &stage.atlas);
        let charted = |part: usize, t: usize| atlas.parts[part].chart(t) != NO_CHART;
        let of_part = |part: usize| {
            let own = &scene.parts[part];
            (0..own.triangles.len())
                .filter(|&t| charted(part, t))
                .map(|t| scene.area(own.triangles.start + t as u32))
                .fold(0.0, |a, b| a + b)
        };
        let expected = (0..scene.parts.len())
            .filter(|&k| !atlas.parts[k].layout.triangles.is_empty())
            .map(of_part)
            .fold(0.0, |a, b| a + b);
        let found = p.area[..p.front].iter().fold(0.0, |sum, &area| sum + f64::from(area));
        assert!((found / expected - 1.0).abs() < 1e-4, "{name}: {found} of {expected} m²");
        let texels: BTreeSet<u32> = p.texel.iter().copied().collect();
        assert_eq!(texels.len(), p.front, "{name}");
    }
}

#[test]
fn links_are_mutual_and_join_like_with_like() {
    for (name, density) in SCENES {
        let scene = load(name);
        let stage = Stage::new(&scene, density);
        let p = &stage.patches;
        let mut links = 0;
        for i in 0..p.len() {
            let around = stage.graph.neighbors(i);
            assert!(around.len() <= 8 && around.is_sorted_by(|a, b| a < b), "{name}: {around:?}");
            for &j in around {
                let (k, j) = (i as u32, j as usize);
                assert!(stage.graph.neighbors(j).contains(&k), "{name}: {i} and {j}");
                assert_eq!(p.chart(p.front_patch(i)), p.chart(p.front_patch(j)), "{name}");
                assert_eq!(p.is_back(i), p.is_back(j), "{name}");
                links += 1;
            }
        }
        assert!(links > p.len(), "{name}: {links} links of {} patches", p.len());
    }
}

/// Shading normals that are found once for a triangle are those that are found for every point of it.
#[test]
fn normals_that_are_kept_are_those_of_every_point() {
    for (name, density) in SCENES {
        let scene = load(name);
        let stage = Stage::new(&scene, density);
        for i in 0..stage.patches.len() {
            let [kept, anew] =
                [PatchSurface::shaded, PatchSurface::new].map(|make| make(&stage.tracer, &stage.patches, i));
            for k in 0..4 {
                let u = Vec2::new((k as f32 + 0.5) / 4.0, (k as f32 * 0.618_034).fract());
                let spot = kept.sample(u);
                let [a, b] = [&kept, &anew].map(|surface| surface.shading_frame(&spot).n);
                assert!(a.distance(b) < 1e-6, "{name}, patch {i}: {a}, at the point {b}");
            }
        }
    }
}

/// Pictures that repeat once for each look at a texel, and a few times: all looks at one place of them would see one pixel.
#[test]
fn patterns_that_repeat_with_the_texels_have_their_mean() {
    let [o, x, y] = [Vec3::ZERO, Vec3::X * 4.0, Vec3::Z * 4.0];
    let base_color_texture = Some(TextureRef { texture: 0, uv_set: 0, transform: Affine2::IDENTITY });
    let mut scene = scene_with_material(&[[o, x + y, x], [o, y, x + y]], Material { base_color_texture, ..white() });
    let pixels = (0..64).map(|i| if i % 8 < 2 || i / 8 == 3 { [255; 4] } else { [0; 4] }).collect();
    scene.textures.push(Texture { width: 8, height: 8, pixels, wrap: [Wrap::Repeat; 2], nearest: false });
    for repeats in [1.0, 4.0, 8.0, 60.0] {
        scene.vertices.uv[0] = scene.vertices.position.iter().map(|p| Vec2::new(p.x, p.z) * 16.0 * repeats).collect();
        let patches = Stage::new(&scene, 16.0).patches;
        let mean = patches.reflectance.iter().map(|r| f64::from(r.x)).fold(0.0, |a, b| a + b) / patches.len() as f64;
        let expected = 22.0 / 64.0;
        assert!((mean / expected - 1.0).abs() < 0.02, "{repeats} a texel: {mean} of {expected}");
    }
}

/// Seconds that patches of loose leaves in a pot of 40 cm take, each far smaller than a texel.
fn time_of_leaves(count: usize) -> f64 {
    let mut draws = Stream::new(5, Draws::Light, 0, 0);
    let mut point = |reach: f32| Vec3::from_array([0; 3].map(|_| draws.next_f32() * reach));
    let leaves: Vec<[Vec3; 3]> = (0..count)
        .map(|_| {
            let at = point(0.4);
            [0; 3].map(|_| at + point(0.012))
        })
        .collect();
    let mut scene = scene_with_material(&leaves, Material { double_sided: true, ..white() });
    // Leaves of one part would share texels.
    let part = |k: u32| Part { vertices: 3 * k..3 * k + 3, triangles: k..k + 1, ..scene.parts[0].clone() };
    scene.parts = (0..count as u32).map(part).collect();
    scene.triangle_part = (0..count as u32).collect();
    let stage = Stage::new(&scene, 16.0);
    assert!(stage.patches.front >= count && stage.patches.reflectance[0] != Rgb::ZERO);
    let one = || {
        let start = Instant::now();
        let patches = Patches::new(&stage.tracer, &stage.atlas, &Progress::default());
        let seconds = start.elapsed().as_secs_f64();
        assert_eq!(patches.front, stage.patches.front);
        seconds
    };
    one().min(one())
}

/// Each leaf has a texel of its own, in which all others may stand: looked at one by one, four times as many would take
/// sixteen times as long.
#[test]
fn time_grows_with_the_texels_and_not_with_what_stands_in_all_of_them() {
    let [few, many] = [2_500, 10_000].map(time_of_leaves);
    assert!(many < 9.0 * few, "{few} s for 2,500, {many} s for 10,000");
}
