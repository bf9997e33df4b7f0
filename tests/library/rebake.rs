//! What was baked is baked again: its layout is kept, on texels of the same shape, and pages of the same size.

use crate::quads::{Baked, Quad, Scene, bake_file, bake_fixture, grey};
use glam::Vec3;
use std::fs;

const OPTIONS: [&str; 8] = ["--texels-per-meter", "10", "--gather", "2", "--lines", "1000", "--aov", "position"];

/// Mean distances from texels to the ones on their right and below [m].
fn steps(baked: &Baked) -> [f32; 2] {
    let page = baked.page("lightmap0.exr");
    let width = baked.width("lightmap0.exr");
    let [x, y, z] = ["position.X", "position.Y", "position.Z"].map(|name| baked.layer(name));
    let at = |i: usize| Vec3::new(x[i], y[i], z[i]);
    [1, width].map(|step| {
        let both = |i: &usize| page[*i][3] > 0.0 && page[i + step][3] > 0.0 && (i + step) % width >= i % width;
        let pairs = (0..page.len() - step).filter(both);
        let distances: Vec<f32> = pairs.map(|i| at(i).distance(at(i + step))).collect();
        assert!(distances.len() > 500);
        distances.iter().sum::<f32>() / distances.len() as f32
    })
}

#[test]
fn texels_of_a_page_that_is_not_square_stay_square() {
    let long = Quad::new([0.0; 3], [0.0, 0.0, 1.5], [12.0, 0.0, 0.0], grey(0.5));
    let first = Scene { quads: vec![long], lights: vec![] }.bake(&OPTIONS);
    let again = bake_file(&first.path("out.gltf"), &[&OPTIONS[..], &["--uv", "keep"]].concat());
    let pages = [&first, &again].map(|baked| baked.report["atlas"].clone());
    assert_eq!(pages[0]["texels"], pages[1]["texels"]);
    let [wide, high] = [0, 1].map(|k| pages[0]["page_size"][k].as_f64().unwrap());
    assert!((wide / high).ln().abs() > 1.0, "{wide} × {high}: the first page is long");
    for step in [steps(&first), steps(&again)].as_flattened() {
        assert!((step - 0.1).abs() < 1e-3, "{step} m from texel to texel");
    }
}

/// Bakes a fixture, and what came of it, with `options`; both have the same pages.
fn stays(name: &str, options: &[&str]) -> [Baked; 2] {
    let options = [&["--gather", "2", "--lines", "1000", "--aov", "position"], options].concat();
    let first = bake_fixture(name, &options);
    let again = bake_file(&first.path("out.gltf"), &options);
    assert_eq!(first.report["atlas"], again.report["atlas"], "{name} {options:?}");
    for page in 0..first.report["atlas"]["pages"].as_u64().unwrap() {
        let page = format!("lightmap{page}.exr");
        let [before, after] = [&first, &again].map(|baked| baked.page(&page));
        assert!(before.iter().zip(&after).all(|(a, b)| (a[3] > 0.0) == (b[3] > 0.0)), "{page} of {name}");
    }
    [first, again]
}

#[test]
fn a_scene_keeps_its_pages_and_their_mip_levels() {
    for options in [&["--texels-per-meter", "6"][..], &["--texels-per-meter", "6", "--mips", "3", "--padding", "6"]] {
        let [first, again] = stays("office/office.glb", options);
        let [before, after] =
            [&first, &again].map(|baked| ["X", "Y", "Z"].map(|c| baked.layer(&format!("position.{c}"))));
        let covered = first.page("lightmap0.exr");
        for (i, texel) in covered.iter().enumerate().filter(|(_, texel)| texel[3] > 0.0) {
            let moved = (0..3).map(|k| (before[k][i] - after[k][i]).abs()).fold(0.0, f32::max);
            assert!(moved < 1e-3, "{moved} m at texel {i}, {texel:?}");
        }
        assert!(
            first.names().contains(&"out.lightmap.bin".into()) && !again.names().contains(&"out.lightmap.bin".into())
        );
    }
}

#[test]
fn a_scene_of_several_pages_keeps_each_of_them() {
    let several = &["--texels-per-meter", "6", "--page-size", "96"];
    let [first, _] = stays("office/office.glb", several);
    assert!(first.report["atlas"]["pages"].as_u64() > Some(1));
    // On fewer pages than the density needs.
    stays("office/office.glb", &["--texels-per-meter", "16", "--page-size", "256", "--max-pages", "2", "--mips", "2"]);
}

#[test]
fn objects_of_other_densities_stay_on_the_page() {
    let home = tempfile::tempdir().unwrap();
    let rules = home.path().join("rules.toml");
    let of = |node: &str, factor: f64| format!("[[rules]]\nnodes = [\"{node}\"]\ndensity = {factor:?}\n");
    fs::write(&rules, of("Floor", 2.0) + &of("Desk*", 0.5)).unwrap();
    stays("office/office.glb", &["--texels-per-meter", "6", "--config", rules.to_str().unwrap()]);
}
