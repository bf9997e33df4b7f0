//! Warns of a bake that came out black.

use crate::base::{Rgb, Warning};
use crate::scene::Scene;

/// No texel has light; `light` is that of the front patches. Says what the scene could have it from.
pub(super) fn warning(scene: &Scene, light: &[Rgb]) -> Option<Warning> {
    if light.is_empty() || light.iter().any(|l| *l != Rgb::ZERO) {
        return None;
    }
    let lamps = scene.lights.len();
    let glowing = scene.parts.iter().filter(|part| scene.glows(part)).count();
    let sky = if scene.environment.is_some() || !scene.sky.is_black() { " and a sky" } else { "" };
    let what = if lamps + glowing == 0 && sky.is_empty() {
        "the scene has no light: no KHR_lights_punctual, no emissive material, no sky; use --sky or --environment, or add \
         lights to it; all texels are black"
            .to_owned()
    } else {
        format!(
            "all texels are black: no light arrives from what shines ({lamps} punctual light(s), {glowing} emissive \
             primitive(s){sky}); see whether it is closed in, or its colour or intensity is zero"
        )
    };
    Some(Warning::new("no-light", what))
}
