//! Warns of a bake that came out black, all of it or in places.

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

/// Some texels have light that is no number: what documents state is beyond what single precision holds, or there is a
/// fault here. One of them makes all light that is reflected undefined, and what is stored of it is black.
pub(super) fn undefined(light: &[Rgb]) -> Option<Warning> {
    let count = light.iter().filter(|l| l.is_nan()).count();
    let what = || {
        format!(
            "the light of {count} texels is not a number, so they and what they light are wrong; see whether intensities \
             and sizes are sensible, else report it as a fault"
        )
    };
    (count > 0).then(|| Warning::new("undefined-light", what()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_is_told() {
        assert!(undefined(&[Rgb::ONE, Rgb::ZERO]).is_none());
        let warning = undefined(&[Rgb::ONE, Rgb::new(0.0, f32::NAN, 1.0)]).unwrap();
        assert!(warning.message.contains("1 texels"), "{}", warning.message);
    }
}
