//! How light changes over a texel: the plane that fits what was found at points of it, by least squares.
//!
//! In: light at points. Out: its slope [lx per texel]. Fewer than three points, or points on a line, say nothing about
//! the slope across, which is then 0.

use crate::base::{Rgb, color, plane};
use glam::Vec2;

/// Added to the squared offsets, relative.
const RIDGE: f32 = 1e-3;

/// Sums over points, offsets from the middle of the texel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    weight: f32,
    light: f32,
    offset: Vec2,
    /// Products of offsets: xx, xy, yy.
    offsets: [f32; 3],
    light_offset: Vec2,
}

impl Moments {
    /// Light [lx] at a point of the texel, `within` from its corner [texels].
    pub(super) fn add(&mut self, light: Rgb, within: Vec2, weight: f32) {
        let (light, d) = (color::mean(light), within - Vec2::splat(0.5));
        self.weight += weight;
        self.light += weight * light;
        self.offset += d * weight;
        self.offsets = [
            self.offsets[0] + weight * d.x * d.x,
            self.offsets[1] + weight * d.x * d.y,
            self.offsets[2] + weight * d.y * d.y,
        ];
        self.light_offset += d * (weight * light);
    }

    /// Slope of the mean of the channels.
    pub(super) fn slope(&self) -> Vec2 {
        if self.weight <= 0.0 {
            return Vec2::ZERO;
        }
        let (light, mean) = (self.light / self.weight, self.offset / self.weight);
        let [xx, xy, yy] = self.offsets.map(|sum| sum / self.weight);
        let products = [xx - mean.x * mean.x, xy - mean.x * mean.y, yy - mean.y * mean.y];
        plane::slope(products, self.light_offset / self.weight - mean * light, RIDGE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(points: &[(f32, f32)], light: impl Fn(Vec2) -> f32) -> Vec2 {
        let mut moments = Moments::default();
        for &(x, y) in points {
            moments.add(Rgb::splat(light(Vec2::new(x, y))), Vec2::new(x, y), 1.0);
        }
        moments.slope()
    }

    #[test]
    fn a_plane_is_found_again_wherever_the_points_are() {
        let slope = of(&[(0.1, 0.2), (0.9, 0.1), (0.4, 0.8), (0.7, 0.9)], |p| 3.0 + 2.0 * p.x - 1.0 * p.y);
        assert!((slope - Vec2::new(2.0, -1.0)).length() < 0.02, "{slope}");
    }

    #[test]
    fn few_points_say_little() {
        assert_eq!(of(&[], |p| p.x), Vec2::ZERO);
        assert!(of(&[(0.3, 0.3)], |_| 5.0).length() < 1e-3);
        let along = of(&[(0.1, 0.5), (0.9, 0.5)], |p| p.x + 7.0);
        assert!((along.x - 1.0).abs() < 0.01 && along.y.abs() < 1e-3, "{along}");
    }
}
