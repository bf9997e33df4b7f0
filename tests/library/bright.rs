//! Light that is brighter than half floats hold is told, with the pages and texels where it is; what fits is not.

use crate::quads::{Baked, Quad, Scene, grey};
use glam::Vec3;
use serde_json::json;

/// Two floors of 2 × 2 m, the second one in the shadow of a lid; the sun stands overhead.
fn baked(lux: f64, options: &[&str]) -> Baked {
    let floor = |low: f32| Quad::floor(low, 2.0, grey(0.0));
    let mut lid = Quad::floor(7.5, 3.0, grey(0.0));
    lid.lift(1.0);
    let sun = json!({"type": "directional", "intensity": lux});
    let scene = Scene { quads: vec![floor(0.0), floor(8.0), lid], lights: vec![] }.with(sun, Vec3::ZERO, Vec3::Y);
    scene.bake(&[&["--preset", "preview", "--texels-per-meter", "4", "--gather", "0"], options].concat())
}

fn told(baked: &Baked) -> Vec<String> {
    let warnings = baked.report["warnings"].as_array().unwrap().iter().filter(|w| w["code"] == "clipped");
    warnings.map(|w| w["message"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn what_half_floats_cannot_hold_is_told_once() {
    let irradiance = baked(120_000.0, &["--quantity", "irradiance"]);
    let [message] = &told(&irradiance)[..] else { panic!("{:?}", irradiance.report["warnings"]) };
    let pixels = irradiance.page("lightmap0.exr");
    let clipped = pixels.iter().filter(|p| p[3] > 0.0 && p[0] == 65504.0).count();
    assert!(clipped >= 64, "{clipped}");
    for part in [&format!("{clipped} of page 0"), "would be 120000", "--quantity radiosity", "--aov direct,indirect"] {
        assert!(message.contains(part), "{message}");
    }
    // The layers that it names hold all of it.
    let layers = baked(120_000.0, &["--quantity", "irradiance", "--aov", "direct"]);
    let most = layers.layer("direct.R").into_iter().fold(0.0, f32::max);
    assert!((most / 120_000.0 - 1.0).abs() < 1e-3, "{most}");
}

#[test]
fn what_fits_is_not_told_and_advice_helps() {
    // 120,000 over π.
    assert_eq!(told(&baked(120_000.0, &[])), Vec::<String>::new());
    assert_eq!(told(&baked(65_000.0, &["--quantity", "irradiance"])), Vec::<String>::new());
    assert_eq!(told(&baked(120_000.0, &["--quantity", "irradiance", "--target", "vertex"])), Vec::<String>::new());
    let [message] = &told(&baked(300_000.0, &["--quantity", "irradiance"]))[..] else { panic!() };
    assert!(!message.contains("--quantity radiosity") && message.contains("intensity"), "{message}");
}
