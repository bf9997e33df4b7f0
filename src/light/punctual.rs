//! Punctual lights as seen from a point: direction, illuminance on a facing plane, and the point to aim a shadow ray
//! at.
//!
//! A light with a radius is a sphere of even radiance, sampled within the cone in which it is seen: above the horizon
//! it gives exactly what the point at its centre gives, I cos θ/d². Its range counts from the centre.
//!
//! Source: the glTF extension `KHR_lights_punctual`, "Range Property" and "Inner and Outer Cone Angles" (the reference
//! code, with its squared cone falloff). Lamps with a profile have its candela in the direction that the light takes,
//! also where they are spheres.

use super::bounds::Bounds;
use super::cone;
use super::piece::FLOOR;
use super::site::Site;
use crate::base::color::luminance;
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

/// A light is on a surface within so much of its largest coordinate: eight steps and more.
pub(super) const ROUNDING: f32 = 1.0 / (1 << 20) as f32;

/// The light has a size, so its shadows have penumbrae.
pub(super) fn is_soft(light: &Light) -> bool {
    match *light {
        Light::Sun { angle, .. } => angle > 0.0,
        Light::Point { radius, .. } | Light::Spot { radius, .. } | Light::Profiled { radius, .. } => radius > 0.0,
    }
}

/// Height over a surface up to which a light without a size stands right on it [m]: there it shines away from it, and does not
/// make a spot as bright as half of its flux on whatever texel is below.
pub(super) fn standing(light: &Light) -> f32 {
    match *light {
        Light::Point { position, radius, .. }
        | Light::Spot { position, radius, .. }
        | Light::Profiled { position, radius, .. }
            if radius <= 0.0 =>
        {
            4.0 * ROUNDING * position.abs().max_element()
        }
        _ => 0.0,
    }
}

/// The light stands within `reach` [m] of a position.
pub(super) fn is_near(light: &Light, position: Vec3, reach: f32) -> bool {
    match *light {
        Light::Sun { .. } => false,
        Light::Point { position: at, .. } | Light::Spot { position: at, .. } | Light::Profiled { position: at, .. } => {
            at.distance_squared(position) < reach * reach
        }
    }
}

/// Largest intensity [cd], or illuminance [lx].
pub(super) fn power(light: &Light) -> Rgb {
    match *light {
        Light::Sun { illuminance, .. } => illuminance,
        Light::Point { intensity, .. } | Light::Spot { intensity, .. } => intensity,
        Light::Profiled { factor, ref profile, .. } => factor * profile.peak(),
    }
}

/// Unit direction from within the disc of a sun, opposite to its light.
pub(super) fn toward_sun(direction: Vec3, angle: f32, u: Vec2) -> Vec3 {
    if angle <= 0.0 {
        return -direction;
    }
    let sin = libm::sinf(angle / 4.0);
    Frame::from_normal(-direction).to_world(warp::square_to_narrow_cone(u, 2.0 * sin * sin))
}

/// The light from `position`; `u` picks a point of a light with a size. `None` outside its range or cone.
pub(super) fn seen_from(light: &Light, position: Vec3, u: Vec2) -> Option<Seen> {
    match *light {
        Light::Sun { direction, illuminance, angle } => {
            Some(Seen { toward: toward_sun(direction, angle, u), far: true, illuminance })
        }
        Light::Point { position: at, intensity, range, radius } => sphere(at, radius, range, position, u)
            .map(|(toward, factor)| Seen { toward, far: false, illuminance: intensity * factor }),
        Light::Spot { position: at, direction, intensity, range, radius, cos_inner, cos_outer } => {
            let (toward, factor) = sphere(at, radius, range, position, u)?;
            let cos = direction.dot(-toward.normalize_or_zero());
            let cone = ((cos - cos_outer) / (cos_inner - cos_outer).max(0.001)).clamp(0.0, 1.0);
            (cone > 0.0).then_some(Seen { toward, far: false, illuminance: intensity * (factor * cone * cone) })
        }
        Light::Profiled { position: at, axes, factor: power, range, radius, ref profile } => {
            let (toward, factor) = sphere(at, radius, range, position, u)?;
            let candela = profile.candela(axes.transpose() * -toward.normalize_or_zero());
            (candela > 0.0).then_some(Seen { toward, far: false, illuminance: power * (candela * factor) })
        }
    }
}

/// The range window of the extension.
pub(super) fn window(range: f32, distance_squared: f32) -> f32 {
    if !range.is_finite() {
        return 1.0;
    }
    let ratio = distance_squared / (range * range);
    (1.0 - ratio * ratio).clamp(0.0, 1.0)
}

/// Vector to the surface of a glowing sphere, uniform in the cone in which it is seen, and solid angle over π radius²
/// (1/d² for a point) times the window. A sphere of intensity I has the radiance I/(π radius²).
fn sphere(at: Vec3, radius: f32, range: f32, position: Vec3, u: Vec2) -> Option<(Vec3, f32)> {
    let center = at - position;
    let distance_squared = center.length_squared();
    let window = window(range, distance_squared);
    if distance_squared <= 0.0 || window <= 0.0 {
        return None;
    }
    if radius <= 0.0 {
        return Some((center, window / distance_squared));
    }
    let radius_squared = radius * radius;
    if distance_squared <= radius_squared {
        // From inside, light comes from everywhere; the sphere itself is nothing that blocks.
        let direction = warp::square_to_sphere(u);
        let along = center.dot(direction);
        let to_surface = along + (along * along + radius_squared - distance_squared).max(0.0).sqrt();
        return Some((direction * to_surface, 4.0 * window / radius_squared));
    }
    let sin_squared = radius_squared / distance_squared;
    let versine = sin_squared / (1.0 + (1.0 - sin_squared).sqrt());
    let local = warp::square_to_narrow_cone(u, versine);
    let across = distance_squared * (local.x * local.x + local.y * local.y);
    let to_surface = distance_squared.sqrt() * local.z - (radius_squared - across).max(0.0).sqrt();
    let direction = Frame::from_normal(center / distance_squared.sqrt()).to_world(local);
    Some((direction * to_surface, 2.0 * versine / radius_squared * window))
}

/// About the illuminance that a point or spot light gives to a site if nothing is in between [lx]; 0 only where it
/// gives none.
pub(super) fn estimate(light: &Light, site: &Site) -> f32 {
    let (at, intensity, range, radius) = match *light {
        Light::Sun { .. } => return 0.0,
        Light::Point { position, intensity, range, radius } => (position, intensity, range, radius),
        Light::Spot { position, intensity, range, radius, .. } => (position, intensity, range, radius),
        Light::Profiled { position, range, radius, .. } => (position, power(light), range, radius),
    };
    let to = at - site.position;
    let distance_squared = to.length_squared();
    let (distance, reach) = (distance_squared.sqrt(), site.radius + radius);
    let nearest = (distance - site.radius).max(0.0);
    if (site.flat && to.dot(site.normal) < -reach) || window(range, nearest * nearest) <= 0.0 {
        return 0.0;
    }
    let toward = to / distance.max(f32::MIN_POSITIVE);
    // Beyond the cone for all of the site?
    let outside = |cos: f32, cos_outer: f32| {
        distance > reach && cone::cos_of_difference(cos, (1.0 - (reach / distance).powi(2)).sqrt()) < cos_outer
    };
    let mut cone = 1.0;
    if let Light::Spot { direction, cos_inner, cos_outer, .. } = *light {
        let cos = direction.dot(-toward);
        if outside(cos, cos_outer) {
            return 0.0;
        }
        let edge = ((cos - cos_outer) / (cos_inner - cos_outer).max(0.001)).clamp(0.0, 1.0);
        cone = (edge * edge).max(FLOOR);
    } else if let Light::Profiled { axes, ref profile, .. } = *light {
        if profile.cos_reach() > -1.0 && outside(axes.z_axis.dot(toward), profile.cos_reach()) {
            return 0.0;
        }
        cone = (profile.candela(axes.transpose() * -toward) / profile.peak().max(f32::MIN_POSITIVE)).max(FLOOR);
    }
    let factor = window(range, distance_squared).max(FLOOR) * cone * site.elevation(toward);
    luminance(intensity) * factor / distance_squared.max(reach * reach)
}

/// Bounds of a point or spot light for the tree.
pub(super) fn bounds(light: &Light) -> Option<Bounds> {
    let (position, range, radius, axis, cos_o, cos_e) = match *light {
        Light::Sun { .. } => return None,
        Light::Point { position, range, radius, .. } => (position, range, radius, Vec3::Z, -1.0, 0.0),
        // All of the cone at full strength, nothing outside.
        Light::Spot { position, range, radius, direction, cos_outer, .. } => {
            (position, range, radius, direction, cos_outer, 1.0)
        }
        Light::Profiled { position, range, radius, axes, ref profile, .. } => {
            (position, range, radius, -axes.z_axis, profile.cos_reach(), 1.0)
        }
    };
    let (low, high) = (position - radius, position + radius);
    Some(Bounds { low, high, axis, cos_o, cos_e, two_sided: false, power: luminance(power(light)), range })
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
