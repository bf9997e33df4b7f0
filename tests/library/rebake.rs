//! What was baked is baked again: its layout is kept, on texels of the same shape.

use crate::quads::{Baked, Quad, Scene, bake_file, grey};
use glam::Vec3;

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
