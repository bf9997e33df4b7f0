//! The plane that fits values over a surface best, by least squares.
//!
//! Symbols: d  offset of a point from where the plane is held.

use glam::Vec2;

/// Slope of the plane for Σ d.x², Σ d.x d.y, Σ d.y² and Σ d·value [value per unit of d].
///
/// `ridge`, relative to the squared offsets, keeps the slope across a line of points at 0. No points give 0.
#[must_use]
pub fn slope([xx, xy, yy]: [f32; 3], value_offset: Vec2, ridge: f32) -> Vec2 {
    let ridge = ridge * (xx + yy);
    let (xx, yy) = (xx + ridge, yy + ridge);
    let determinant = xx * yy - xy * xy;
    if determinant <= 0.0 {
        return Vec2::ZERO;
    }
    Vec2::new(value_offset.x * yy - value_offset.y * xy, value_offset.y * xx - value_offset.x * xy) / determinant
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(points: &[(f32, f32)]) -> Vec2 {
        let (mut products, mut sum) = ([0.0; 3], Vec2::ZERO);
        for &(x, y) in points {
            products = [products[0] + x * x, products[1] + x * y, products[2] + y * y];
            sum += Vec2::new(x, y) * (0.3 * x - 0.2 * y);
        }
        slope(products, sum, 1e-2)
    }

    #[test]
    fn a_plane_is_found_again() {
        let found = of(&[(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.4, -0.9), (1.1, 1.0)]);
        assert!((found - Vec2::new(0.3, -0.2)).length() < 0.01, "{found}");
    }

    #[test]
    fn along_a_line_the_slope_across_is_nothing() {
        let found = of(&[(1.0, 0.0), (-1.0, 0.0)]);
        assert!((found.x - 0.3).abs() < 0.01 && found.y.abs() < 1e-6, "{found}");
        assert_eq!(of(&[]), Vec2::ZERO);
    }
}
