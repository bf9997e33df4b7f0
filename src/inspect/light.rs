//! Punctual lights and the document's environment, with units, and their flux.

use crate::base::Rgb;
use crate::scene::{Light, Scene};
use core::f32::consts::PI;

/// A light.
#[derive(Debug, serde::Serialize)]
pub struct LightFacts {
    /// `sun`, `point`, `spot`, `lamp` (one that was measured) or `image`.
    pub kind: &'static str,
    /// Illuminance [lx] of a sun on a plane that faces it, mean radiance [cd/m²] of an image, intensity [cd] of the
    /// others, which is the largest of a lamp.
    pub value: [f32; 3],
    /// Unit of `value`: `lx`, `cd` or `cd/m2`.
    pub unit: &'static str,
    /// Flux in all directions, without the window of a range [lm]; that of suns and images depends on the scene's size, and
    /// is null.
    pub flux: Option<[f32; 3]>,
    /// Group, if it has a name.
    pub light_group: Option<String>,
}

/// Facts of a light.
pub(super) fn light(scene: &Scene, index: usize) -> LightFacts {
    let (kind, value, unit) = match &scene.lights[index] {
        Light::Sun { illuminance, .. } => ("sun", *illuminance, "lx"),
        Light::Point { intensity, .. } => ("point", *intensity, "cd"),
        Light::Spot { intensity, .. } => ("spot", *intensity, "cd"),
        Light::Profiled { factor, profile, .. } => ("lamp", *factor * profile.peak(), "cd"),
    };
    LightFacts {
        kind,
        value: value.to_array(),
        unit,
        flux: flux(&scene.lights[index]).map(|f| f.to_array()),
        light_group: scene.groups.lights.get(index).cloned().flatten(),
    }
}

/// The light of the document's own environment.
pub(super) fn image(scene: &Scene) -> Option<LightFacts> {
    let mean = scene.environment.as_ref()?.total() / (4.0 * PI);
    Some(LightFacts { kind: "image", value: mean.to_array(), unit: "cd/m2", flux: None, light_group: None })
}

/// ∫ I dω. The intensity of a spot falls as t², t = (cos θ − cos outer)/(cos inner − cos outer), between its cones
/// (`KHR_lights_punctual`, inner and outer cone angles), which gives a third of what full intensity there would.
fn flux(light: &Light) -> Option<Rgb> {
    match light {
        Light::Sun { .. } => None,
        Light::Point { intensity, .. } => Some(*intensity * (4.0 * PI)),
        Light::Profiled { factor, profile, .. } => Some(*factor * profile.flux()),
        Light::Spot { intensity, cos_inner, cos_outer, .. } => {
            Some(*intensity * (2.0 * PI * ((1.0 - cos_inner) + (cos_inner - cos_outer) / 3.0)))
        }
    }
}

impl LightFacts {
    /// One line.
    pub(super) fn line(&self) -> String {
        let triple = |v: [f32; 3]| format!("{:.3} {:.3} {:.3}", v[0], v[1], v[2]);
        let flux = self.flux.map_or(String::new(), |f| format!(" ({} lm)", triple(f)));
        let group = self.light_group.as_ref().map_or(String::new(), |name| format!(", group {name}"));
        format!("{} {} {}{flux}{group}", self.kind, triple(self.value), self.unit)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn the_flux_of_a_spot_is_the_integral_of_its_cones() {
        let (inner, outer) = (0.9f32, 0.5f32);
        let spot = Light::Spot {
            position: Vec3::ZERO,
            direction: Vec3::Z,
            intensity: Rgb::splat(2.0),
            range: f32::INFINITY,
            radius: 0.0,
            cos_inner: inner,
            cos_outer: outer,
        };
        let steps = 100_000;
        let of_cosine = |i: usize| {
            let t = ((i as f64 + 0.5) / f64::from(steps) - f64::from(outer)) / f64::from(inner - outer);
            t.clamp(0.0, 1.0).powi(2)
        };
        let integral: f64 = (0..steps as usize).map(of_cosine).sum::<f64>() / f64::from(steps);
        let expected = 2.0 * 2.0 * core::f64::consts::PI * integral;
        assert!((f64::from(flux(&spot).unwrap().x) - expected).abs() < 1e-3 * expected);
    }
}
