//! Bilinear look-up in a picture, as graphics hardware filters it: centres of pixels lie at halves, and the border
//! holds beyond the edge.

use super::Rgb;
use glam::Vec2;

/// The first three channels at a position in pixels; black in an empty picture and at positions that are no numbers.
#[must_use]
pub fn bilinear(width: u32, height: u32, pixels: &[[f32; 4]], at: Vec2) -> Rgb {
    if pixels.is_empty() || !at.is_finite() {
        return Rgb::ZERO;
    }
    let corner = at - 0.5;
    let floor = corner.floor();
    let f = corner - floor;
    let pixel = |dx: f32, dy: f32| {
        let x = (floor.x + dx).clamp(0.0, (width - 1) as f32) as usize;
        let y = (floor.y + dy).clamp(0.0, (height - 1) as f32) as usize;
        let [r, g, b, _] = pixels[y * width as usize + x];
        Rgb::new(r, g, b)
    };
    let top = pixel(0.0, 0.0) * (1.0 - f.x) + pixel(1.0, 0.0) * f.x;
    let bottom = pixel(0.0, 1.0) * (1.0 - f.x) + pixel(1.0, 1.0) * f.x;
    top * (1.0 - f.y) + bottom * f.y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_at_centres_linear_between_and_the_border_holds() {
        let pixels: Vec<[f32; 4]> = (0..6).map(|i| [i as f32, 0.0, 10.0 * i as f32, 0.0]).collect();
        let red = |x: f32, y: f32| bilinear(3, 2, &pixels, Vec2::new(x, y)).x;
        assert_eq!((red(0.5, 0.5), red(2.5, 1.5)), (0.0, 5.0));
        assert!((red(1.0, 0.5) - 0.5).abs() < 1e-6 && (red(1.5, 1.0) - 2.5).abs() < 1e-6);
        assert_eq!((red(-3.0, 0.0), red(99.0, 99.0), red(0.0, 1.9)), (0.0, 5.0, 3.0));
        assert_eq!(bilinear(3, 2, &pixels, Vec2::new(f32::NAN, 0.0)), Rgb::ZERO);
    }
}
