//! Punctual lights as seen from a point: direction, illuminance on a facing plane, and the point to aim a shadow ray at.
//!
//! Source: the glTF extension `KHR_lights_punctual`, "Range Property" and "Inner and Outer Cone Angles" (the reference
//! code, with its squared cone falloff).

use crate::base::{Frame, Rgb, warp};
use crate::scene::Light;
use glam::{Vec2, Vec3};

/// A light seen from a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// From the point to the light; its length matters where `far` is false.
    pub(super) toward: Vec3,
    /// The light is infinitely far away.
    pub(super) far: bool,
    /// Illuminance on a plane that faces it [lx], without shadows.
    pub(super) illuminance: Rgb,
}

/// The light has a size, so its shadows have penumbrae.
pub(super) fn is_soft(light: &Light) -> bool {
    match *light {
        Light::Sun { angle, .. } => angle > 0.0,
        Light::Point { radius, .. } | Light::Spot { radius, .. } => radius > 0.0,
    }
}

/// The light from `position`; `u` picks a point of a light with a size. `None` outside its range or cone.
pub(super) fn seen_from(light: &Light, position: Vec3, u: Vec2) -> Option<Seen> {
    match *light {
        Light::Sun { direction, illuminance, angle } => {
            let toward = if angle > 0.0 {
                Frame::from_normal(-direction).to_world(warp::square_to_cone(u, libm::cosf(angle / 2.0)))
            } else {
                -direction
            };
            Some(Seen { toward, far: true, illuminance })
        }
        Light::Point { position: at, intensity, range, radius } => point(at, radius, range, position, u)
            .map(|(toward, factor)| Seen { toward, far: false, illuminance: intensity * factor }),
        Light::Spot { position: at, direction, intensity, range, radius, cos_inner, cos_outer } => {
            let (toward, factor) = point(at, radius, range, position, u)?;
            let cos = direction.dot(-toward.normalize_or_zero());
            let cone = ((cos - cos_outer) / (cos_inner - cos_outer).max(0.001)).clamp(0.0, 1.0);
            (cone > 0.0).then_some(Seen { toward, far: false, illuminance: intensity * (factor * cone * cone) })
        }
    }
}

/// Vector to a point of the glowing sphere that faces the receiver, and window/d².
fn point(at: Vec3, radius: f32, range: f32, position: Vec3, u: Vec2) -> Option<(Vec3, f32)> {
    let center = at - position;
    let distance_squared = center.length_squared();
    if distance_squared <= 0.0 {
        return None;
    }
    let window = if range.is_finite() {
        let ratio = distance_squared / (range * range);
        (1.0 - ratio * ratio).clamp(0.0, 1.0)
    } else {
        1.0
    };
    if window <= 0.0 {
        return None;
    }
    let mut toward = center;
    if radius > 0.0 && distance_squared > radius * radius {
        let disk = warp::square_to_disk(u) * radius;
        let frame = Frame::from_normal(center.normalize());
        toward += frame.s * disk.x + frame.t * disk.y;
    }
    Some((toward, window / distance_squared))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spot_follows_the_reference_code_of_the_extension() {
        let (inner, outer) = (0.3f32, 0.6f32);
        let light = Light::Spot {
            position: Vec3::Z,
            direction: -Vec3::Z,
            intensity: Rgb::ONE,
            range: f32::INFINITY,
            radius: 0.0,
            cos_inner: libm::cosf(inner),
            cos_outer: libm::cosf(outer),
        };
        for (angle, relative) in
            [(0.2f32, 1.0), (0.37, 0.677_342), (0.43, 0.413_841), (0.49, 0.192_227), (0.55, 0.043_741)]
        {
            let p = Vec3::new(libm::tanf(angle), 0.0, 0.0);
            let seen = seen_from(&light, p, Vec2::ZERO).unwrap();
            let distance_squared = 1.0 + p.x * p.x;
            assert!((seen.illuminance.x * distance_squared - relative).abs() < 1e-4, "at {angle}");
        }
        assert!(seen_from(&light, Vec3::new(1.0, 0.0, 0.0), Vec2::ZERO).is_none());
    }

    #[test]
    fn range_window_of_the_extension() {
        let light = Light::Point { position: Vec3::ZERO, intensity: Rgb::ONE, range: 2.0, radius: 0.0 };
        let at =
            |d: f32| seen_from(&light, Vec3::new(d, 0.0, 0.0), Vec2::ZERO).map_or(0.0, |s| s.illuminance.x * d * d);
        assert!((at(1.0) - (1.0 - 1.0 / 16.0)).abs() < 1e-6);
        assert_eq!(at(2.0), 0.0);
        assert_eq!(at(3.0), 0.0);
    }
}
