//! Angles by their cosines and sines, and cones of directions as an axis with the cosine of their opening.
//!
//! Source: bounds of light by cones as in Pharr, Jakob, Humphreys, *Physically Based Rendering*, 4th edition, §3.8.4 and
//! §12.6.3. Where we differ: angles carry their sines along, so that a chain of differences takes no further roots.

use core::f32::consts::PI;
use glam::Vec3;

/// Sine of an angle in [0, π] by its cosine.
pub(super) fn sine(cosine: f32) -> f32 {
    (1.0 - cosine * cosine).max(0.0).sqrt()
}

/// Cosine and sine of max(0, x − y), by those of two angles in [0, π].
pub(super) fn difference((cos_x, sin_x): (f32, f32), (cos_y, sin_y): (f32, f32)) -> (f32, f32) {
    if cos_x >= cos_y { (1.0, 0.0) } else { (cos_x * cos_y + sin_x * sin_y, sin_x * cos_y - cos_x * sin_y) }
}

/// cos max(0, x − y) of two angles in [0, π].
pub(super) fn cos_of_difference(cos_x: f32, cos_y: f32) -> f32 {
    difference((cos_x, sine(cos_x)), (cos_y, sine(cos_y))).0
}

/// The smallest cone around two cones (axis, cosine of the opening).
pub(super) fn union(a: (Vec3, f32), b: (Vec3, f32)) -> (Vec3, f32) {
    let (open_a, open_b) = (libm::acosf(a.1.clamp(-1.0, 1.0)), libm::acosf(b.1.clamp(-1.0, 1.0)));
    let between = libm::acosf(a.0.dot(b.0).clamp(-1.0, 1.0));
    if (between + open_b).min(PI) <= open_a {
        return a;
    }
    if (between + open_a).min(PI) <= open_b {
        return b;
    }
    // A little more than needed, against rounding.
    let open = 0.5 * (open_a + between + open_b) + 1e-3;
    let across = (b.0 - a.0 * a.0.dot(b.0)).normalize_or_zero();
    if open >= PI || across == Vec3::ZERO {
        return (a.0, -1.0);
    }
    let (sin, cos) = libm::sincosf(open - open_a);
    ((a.0 * cos + across * sin).normalize_or_zero(), libm::cosf(open))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::{Stage, Stream};

    fn point(s: &mut Stream, size: f32) -> Vec3 {
        Vec3::new(s.next_f32() - 0.5, s.next_f32() - 0.5, s.next_f32() - 0.5) * size
    }

    #[test]
    fn cones_hold_both() {
        let mut s = Stream::new(4, Stage::Light, 0, 0);
        for _ in 0..2000 {
            let cone = |s: &mut Stream| (point(s, 1.0).normalize(), 1.0 - 2.0 * s.next_f32() * s.next_f32());
            let (a, b) = (cone(&mut s), cone(&mut s));
            let both = union(a, b);
            for (axis, cos) in [a, b] {
                let own = libm::acosf(both.1) - libm::acosf(cos);
                let between = libm::acosf(both.0.dot(axis).clamp(-1.0, 1.0));
                assert!(between <= own + 2e-3 || both.1 <= -1.0, "{a:?} {b:?} {both:?}");
            }
        }
    }

    #[test]
    fn differences_are_those_of_the_angles() {
        let pair = |x: f32| (libm::cosf(x), libm::sinf(x));
        for k in 0..200 {
            let (x, y) = (3.1 * (k as f32 * 0.618_034).fract(), 3.1 * k as f32 / 200.0);
            let (expected, found) = (pair((x - y).max(0.0)), difference(pair(x), pair(y)));
            assert!((found.0 - expected.0).abs() < 1e-6 && (found.1 - expected.1).abs() < 1e-6, "{x} − {y}: {found:?}");
            assert!((cos_of_difference(pair(x).0, pair(y).0) - expected.0).abs() < 1e-5);
        }
    }
}
