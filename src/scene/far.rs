//! Scenes, and parts of them, that are far from the origin: f32 resolves less there.
//!
//! In: where primitives are placed. Out: by how much the scene is moved to be near the origin; a warning
//! (`coarse-coordinates`) where parts are so far from one another that moving helps none of them.
//!
//! How near is near enough depends on the size: a scene of 12 cm at 3.9 km had 0.62 of its light, a city has nothing to lose
//! there. So a scene is moved from [`FAR_SIZES`] of its sizes on, where f32 resolves 1/65,536 of it, and from [`FAR`] on in
//! any case.

use super::Scene;
use super::primitive::LocalPrimitive;
use crate::base::{Warning, parallel};
use glam::{DMat4, DVec3};

/// Distance from the world's origin [m] from which on a scene is moved there, and the same in sizes of the scene. What lies
/// beyond the largest coordinate stays, to be refused.
const FAR: f64 = 4096.0;
const FAR_SIZES: f64 = 128.0;
/// Distance of neighbouring coordinates, in texels, from which on the light is off. Of an office of 10 cm it was 0.1 % off
/// at 1/320, 0.3 % at 1/160, and 4 % from 1/80 on.
const COARSE: f32 = 1.0 / 128.0;

/// About the middle of what lies far away, in whole metres: the mean of the first vertices of all parts. `placed` are
/// indices into `locals` with their transforms, `most` is the largest coordinate [m].
pub(super) fn offset(
    placed: impl Iterator<Item = (usize, DMat4)> + Clone,
    locals: &[LocalPrimitive],
    most: f32,
) -> DVec3 {
    let first = |(source, world): (usize, DMat4)| {
        let vertex = locals[source].position.first()?;
        Some(world.transform_point3(vertex.as_dvec3()))
    };
    let (sum, count) = placed.clone().filter_map(first).fold((DVec3::ZERO, 0.0), |(s, n), p| (s + p, n + 1.0));
    let middle = (sum / f64::max(count, 1.0)).round();
    let distance = middle.abs().max_element();
    if distance > 0.0 && distance <= f64::from(most) && (distance > FAR || distance > FAR_SIZES * size(placed, locals))
    {
        middle
    } else {
        DVec3::ZERO
    }
}

/// Largest extent of all that is placed [m].
fn size(placed: impl Iterator<Item = (usize, DMat4)>, locals: &[LocalPrimitive]) -> f64 {
    let boxes = parallel::map(locals.len(), |k| {
        let all = locals[k].position.iter().map(|p| p.as_dvec3());
        all.fold((DVec3::MAX, DVec3::MIN), |(low, high), p| (low.min(p), high.max(p)))
    });
    let corners = placed.filter(|(source, _)| !locals[*source].position.is_empty()).flat_map(|(source, world)| {
        let (low, high) = boxes[source];
        let corner = move |k: u32| {
            let is_high = [0, 1, 2].map(|axis| f64::from(k >> axis & 1));
            world.transform_point3(low + (high - low) * DVec3::from_array(is_high))
        };
        (0..8).map(corner)
    });
    let (low, high) = corners.fold((DVec3::MAX, DVec3::MIN), |(low, high), p| (low.min(p), high.max(p)));
    (high - low).max_element()
}

/// Distance of neighbouring single-precision numbers.
fn spacing(coordinate: f32) -> f32 {
    f32::from_bits(coordinate.abs().to_bits() + 1) - coordinate.abs()
}

impl Scene {
    /// Warns of lit parts whose coordinates are coarse for texels of this density.
    #[must_use]
    pub fn coarse_coordinates(&self, texels_per_meter: f32) -> Option<Warning> {
        let in_texels = |k: usize| {
            let part = &self.parts[k];
            let far = |t: u32| self.corners(t).map(|p| p.abs().max_element()).into_iter().fold(0.0, f32::max);
            let density = texels_per_meter * part.treatment.density;
            let far = if part.receives { part.triangles.clone().map(far).fold(0.0, f32::max) } else { 0.0 };
            spacing(far) * density
        };
        let all = parallel::map(self.parts.len(), in_texels);
        let coarse = all.iter().filter(|&&v| v > COARSE).count();
        let worst = (0..all.len()).max_by(|&i, &j| all[i].total_cmp(&all[j])).filter(|_| coarse > 0)?;
        let what = format!(
            "parts of the scene are so far from one another that single-precision coordinates of {coarse} of {} parts are \
             1/{:.0} of a texel apart or more, 1/{:.0} in the worst case; their light may be off by several percent; bake \
             what lies together as a scene of its own, or use fewer texels per metre",
            all.len(),
            COARSE.recip(),
            all[worst].recip().max(1.0)
        );
        Some(Warning::new("coarse-coordinates", what).at(&self.parts[worst].name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_of_a_number_are_as_far_as_its_exponent_says() {
        for (v, expected) in [(1.0, 1.192_092_9e-7), (-4096.0, 4.882_812_5e-4), (112_000.0, 7.812_5e-3)] {
            assert_eq!(spacing(v), expected, "{v}");
        }
    }
}
