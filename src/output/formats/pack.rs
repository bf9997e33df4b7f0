//! One texel in 8-bit and 16-bit codes, and back: the formulas of the table in the parent module.
//!
//! In: linear values from 0 to 65504, the format's scale. Out: bytes. Where two bytes fit as well, the one that is
//! nearer in the code's own curve is taken. Double precision and `libm`, so that bytes do not depend on the machine.
//!
//! * RGBM takes the smallest multiplier that holds the largest channel, so that the colour has the most steps.
//! * RGBD takes the largest divisor, a whole number from 1 to 255, for the same reason (Babylon.js, `toRGBD`).
//! * Ties go to even codes: half floats have few more bits than the codes, so ties are common, and a bias would show.
//! * Radiance RGBE has its largest mantissa in [128, 255], the PNG's in [127.5, 255].

/// Largest value of RGBM's code before it is squared.
const RGBM_RANGE: f64 = 8.0;
/// Babylon.js' approximation of the sRGB curve.
const RGBD_GAMMA: f64 = 2.2;

/// A texel as RGBM.
pub(super) fn to_rgbm(rgb: [f64; 3], scale: f64) -> [u8; 4] {
    let roots = rgb.map(|v| libm::sqrt(v / scale) / RGBM_RANGE);
    let a = libm::ceil(largest(roots) * 255.0).clamp(1.0, 255.0);
    let [r, g, b] = roots.map(|v| byte(v * 255.0 / a));
    [r, g, b, a as u8]
}

pub(super) fn from_rgbm([r, g, b, a]: [u8; 4], scale: f64) -> [f64; 3] {
    [r, g, b].map(|c| {
        let root = RGBM_RANGE * unit(a) * unit(c);
        root * root * scale
    })
}

/// A texel as RGBD.
pub(super) fn to_rgbd(rgb: [f64; 3], scale: f64) -> [u8; 4] {
    let values = rgb.map(|v| v / scale);
    let most = largest(values);
    let a = if most > 1.0 { libm::floor(255.0 / most).clamp(1.0, 255.0) } else { 255.0 };
    let [r, g, b] = values.map(|v| byte(libm::pow((v * a / 255.0).min(1.0), 1.0 / RGBD_GAMMA)));
    [r, g, b, a as u8]
}

pub(super) fn from_rgbd([r, g, b, a]: [u8; 4], scale: f64) -> [f64; 3] {
    [r, g, b].map(|c| libm::pow(unit(c), RGBD_GAMMA) / unit(a.max(1)) * scale)
}

/// A texel as RGBE whose mantissas are read as c/255.
pub(super) fn to_rgbe(rgb: [f64; 3]) -> [u8; 4] {
    let (fraction, exponent) = libm::frexp(largest(rgb));
    if fraction == 0.0 {
        return [0; 4];
    }
    let exponent = if fraction == 0.5 { exponent - 1 } else { exponent };
    let [r, g, b] = rgb.map(|v| byte(libm::ldexp(v, -exponent)));
    [r, g, b, (exponent + 128) as u8]
}

pub(super) fn from_rgbe([r, g, b, a]: [u8; 4]) -> [f64; 3] {
    [r, g, b].map(|c| if a == 0 { 0.0 } else { libm::ldexp(unit(c), i32::from(a) - 128) })
}

/// The values that Radiance RGBE can hold which are nearest to a texel's: whole multiples of 2^(e − 8), at most 255 of
/// them.
pub(super) fn radiance(rgb: [f64; 3]) -> [f32; 3] {
    let (_, exponent) = libm::frexp(largest(rgb));
    let whole = |v: f64, exponent: i32| libm::rint(libm::ldexp(v, 8 - exponent));
    let exponent = if whole(largest(rgb), exponent) > 255.0 { exponent + 1 } else { exponent };
    rgb.map(|v| libm::ldexp(whole(v, exponent), exponent - 8) as f32)
}

/// A value as 16 bits.
pub(super) fn to_16(value: f64, scale: f64) -> u16 {
    libm::rint((value / scale).clamp(0.0, 1.0) * 65535.0) as u16
}

pub(super) fn from_16(code: u16, scale: f64) -> f64 {
    f64::from(code) / 65535.0 * scale
}

fn largest([r, g, b]: [f64; 3]) -> f64 {
    r.max(g).max(b)
}

/// Nearest byte of a value in [0, 1].
fn byte(value: f64) -> u8 {
    libm::rint(value.clamp(0.0, 1.0) * 255.0) as u8
}

fn unit(byte: u8) -> f64 {
    f64::from(byte) / 255.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use half::f16;

    /// Every positive half float as the largest channel, with two darker ones.
    fn texels() -> impl Iterator<Item = [f64; 3]> {
        (1..0x7C00).map(|bits| {
            let v = f16::from_bits(bits).to_f64();
            [v * f64::from(bits % 97) / 97.0, v, v * f64::from(bits % 31) / 31.0]
        })
    }

    /// Largest error, as a part of the largest channel, of texels of at least `least`.
    fn worst(least: f64, most: f64, trip: impl Fn([f64; 3]) -> [f64; 3]) -> f64 {
        let error = |t: [f64; 3]| {
            let back = trip(t);
            (0..3).map(|c| (back[c] - t[c]).abs() / t[1]).fold(0.0, f64::max)
        };
        texels().filter(|t| (least..=most).contains(&t[1])).map(error).fold(0.0, f64::max)
    }

    #[test]
    fn errors_are_what_the_header_says() {
        let radiance_error = worst(0.0, 65504.0, |t| radiance(t).map(f64::from));
        assert!(radiance_error <= 1.0 / 255.0 && radiance_error > 1.0 / 300.0, "{radiance_error}");
        let rgbe = worst(0.0, 65504.0, |t| from_rgbe(to_rgbe(t)));
        assert!(rgbe <= 1.0 / 255.0 && rgbe > 1.0 / 300.0, "{rgbe}");
        for scale in [0.25, 1.0, 1024.0] {
            let rgbm = worst(scale / 1000.0, 64.0 * scale, |t| from_rgbm(to_rgbm(t, scale), scale));
            assert!(rgbm <= 1.0 / 127.0 && rgbm > 1.0 / 300.0, "{rgbm}");
            let rgbd = worst(scale, 255.0 * scale, |t| from_rgbd(to_rgbd(t, scale), scale));
            assert!(rgbd <= 1.0 / 150.0 && rgbd > 1.0 / 300.0, "{rgbd}");
            assert!(worst(scale / 100.0, scale / 50.0, |t| from_rgbd(to_rgbd(t, scale), scale)) > 1.0 / 100.0);
        }
    }

    #[test]
    fn sixteen_bits_are_within_half_a_step() {
        for (i, t) in texels().enumerate().filter(|(_, t)| t[1] <= 8.0) {
            let back = from_16(to_16(t[1], 8.0), 8.0);
            assert!((back - t[1]).abs() <= 8.0 / 131_070.0 * (1.0 + 1e-12), "{i}");
        }
    }

    #[test]
    fn extremes_stay_in_range() {
        let (black, top) = ([0.0; 3], [65504.0, 0.0, 0.0]);
        assert_eq!(from_rgbm(to_rgbm(black, 2.0), 2.0), black);
        assert_eq!(from_rgbd(to_rgbd(black, 2.0), 2.0), black);
        assert_eq!(from_rgbe(to_rgbe(black)), black);
        assert_eq!(radiance(black), [0.0; 3]);
        // Above what the scale holds: the largest code.
        assert_eq!(to_rgbm(top, 1.0), [255, 0, 0, 255]);
        assert_eq!(to_rgbd(top, 1.0), [255, 0, 0, 1]);
        assert_eq!(to_16(65504.0, 2.0), 65535);
        assert_eq!(radiance(top), [65536.0, 0.0, 0.0]);
        let tiny = f16::from_bits(1).to_f64();
        assert_eq!(from_rgbe(to_rgbe([tiny, 0.0, 0.0]))[0], tiny);
        assert_eq!(f64::from(radiance([tiny, 0.0, 0.0])[0]), tiny);
    }

    #[test]
    fn a_brighter_texel_is_never_darker_by_more_than_the_error() {
        let mut last = [0.0f64; 3];
        for t in texels() {
            let gray = [t[1]; 3];
            let now = [from_rgbm(to_rgbm(gray, 1024.0), 1024.0)[0], from_rgbe(to_rgbe(gray))[0], {
                from_rgbd(to_rgbd(gray, 512.0), 512.0)[0]
            }];
            for (k, (now, last)) in now.iter().zip(last).enumerate() {
                assert!(*now >= last * (1.0 - 1.0 / 100.0), "{k}: {now} after {last}");
            }
            last = now;
        }
    }
}
