//! Decoded images with their sampler.
//!
//! Sampling follows glTF 2.0, section 3.8.4: wrap modes in u and v, row 0 at v = 0, texel centres at half-integers.
//! Colours are decoded before they are filtered. There are no mip-maps: a bake asks for points, and averages them
//! itself.

use glam::Vec2;
use glam::Vec4;

/// An 8-bit RGBA image, row 0 = v 0, with wrap modes and filter.
#[derive(Debug, Clone)]
pub struct Texture {
    /// Width [px], ≥ 1.
    pub width: u32,
    /// Height [px], ≥ 1.
    pub height: u32,
    /// Encoded values, row-major.
    pub pixels: Vec<[u8; 4]>,
    /// Wrap mode in u and v.
    pub wrap: [Wrap; 2],
    /// Magnification filter is NEAREST (otherwise bilinear).
    pub nearest: bool,
}

/// What happens outside [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// Tiles.
    Repeat,
    /// Tiles, every second one mirrored.
    Mirror,
    /// Holds the border.
    Clamp,
}

/// Two neighbouring texels along an axis, and the share of the second.
type Pair = (usize, usize, f32);

impl Texture {
    /// Filtered value with colours decoded from sRGB to linear; alpha as stored. Filtering happens on linear values.
    #[must_use]
    pub fn sample_srgb(&self, uv: Vec2) -> Vec4 {
        self.filter(uv, |[r, g, b, a]| {
            let [r, g, b] = [r, g, b].map(|c| SRGB_TO_LINEAR[usize::from(c)]);
            Vec4::new(r, g, b, f32::from(a) / 255.0)
        })
    }

    /// Filtered value of a data texture, no decoding.
    #[must_use]
    pub fn sample_linear(&self, uv: Vec2) -> Vec4 {
        self.filter(uv, |p| Vec4::from_array(p.map(f32::from)) / 255.0)
    }

    /// Filtered alpha; the `w` of the other two at less cost.
    #[must_use]
    pub fn sample_alpha(&self, uv: Vec2) -> f32 {
        self.filter(uv, |p| f32::from(p[3]) / 255.0)
    }

    fn filter<T>(&self, uv: Vec2, decode: impl Fn([u8; 4]) -> T) -> T
    where
        T: Copy + core::ops::Mul<f32, Output = T> + core::ops::Add<Output = T> + core::ops::Sub<Output = T>,
    {
        let (x0, x1, fx) = pair(uv.x, self.width, self.wrap[0], self.nearest);
        let (y0, y1, fy) = pair(uv.y, self.height, self.wrap[1], self.nearest);
        let texel = |x: usize, y: usize| decode(self.pixels[y * self.width as usize + x]);
        if self.nearest {
            return texel(x0, y0);
        }
        // Exact between equal values: an alpha of one must not miss a cutoff of one by rounding.
        let between = |a: T, b: T, share: f32| a + (b - a) * share;
        let row = |y: usize| between(texel(x0, y), texel(x1, y), fx);
        between(row(y0), row(y1), fy)
    }
}

/// The texels around coordinate `t` on an axis of `size` texels. Any `t` is fine, also one that is not finite.
fn pair(t: f32, size: u32, wrap: Wrap, nearest: bool) -> Pair {
    // Folding before scaling keeps the arithmetic exact for large coordinates, and the integers small.
    let folded = match wrap {
        Wrap::Repeat => t - t.floor(),
        Wrap::Clamp => t.clamp(0.0, 1.0),
        Wrap::Mirror => {
            let t = t - 2.0 * (t * 0.5).floor();
            if t > 1.0 { 2.0 - t } else { t }
        }
    };
    let last = size as i32 - 1;
    // Never off by more than one texel; the remainder of a division would take as long as the rest.
    let inside = |i: i32| match wrap {
        Wrap::Repeat if i < 0 => last as usize,
        Wrap::Repeat if i > last => 0,
        Wrap::Repeat => i as usize,
        // The mirror image of the border texel is the border texel.
        Wrap::Mirror | Wrap::Clamp => i.clamp(0, last) as usize,
    };
    if nearest {
        let texel = inside((folded * size as f32).floor() as i32);
        return (texel, texel, 0.0);
    }
    let x = folded * size as f32 - 0.5;
    let low = x.floor();
    let share = if x.is_finite() { x - low } else { 0.0 };
    (inside(low as i32), inside(low as i32 + 1), share)
}

/// sRGB decoding of 8-bit values (IEC 61966-2-1), rounded from double precision. A constant table because a power
/// function per sample would dominate the cost of alpha tests and emission.
#[rustfmt::skip]
pub(super) const SRGB_TO_LINEAR: [f32; 256] = [
    0.0, 0.000303527, 0.000607054, 0.000910581, 0.001214108, 0.001517635, 0.001821162, 0.0021246888, 0.002428216,
    0.0027317428, 0.00303527, 0.0033465358, 0.0036765074, 0.004024717, 0.004391442, 0.0047769533, 0.0051815165,
    0.0056053917, 0.006048833, 0.0065120906, 0.00699541, 0.007499032, 0.008023193, 0.008568126, 0.009134059,
    0.009721218, 0.010329823, 0.010960094, 0.011612245, 0.012286488, 0.0129830325, 0.013702083, 0.014443844,
    0.015208514, 0.015996294, 0.016807375, 0.017641954, 0.01850022, 0.019382361, 0.020288562, 0.02121901, 0.022173885,
    0.023153367, 0.024157632, 0.02518686, 0.026241222, 0.027320892, 0.02842604, 0.029556835, 0.030713445, 0.031896032,
    0.033104766, 0.034339808, 0.035601314, 0.03688945, 0.038204372, 0.039546236, 0.0409152, 0.04231141, 0.04373503,
    0.045186203, 0.046665087, 0.048171826, 0.049706567, 0.051269457, 0.052860647, 0.054480277, 0.05612849, 0.05780543,
    0.059511237, 0.061246052, 0.063010015, 0.064803265, 0.06662594, 0.06847817, 0.070360094, 0.07227185, 0.07421357,
    0.07618538, 0.07818742, 0.08021982, 0.08228271, 0.08437621, 0.08650046, 0.08865558, 0.09084171, 0.093058966,
    0.09530747, 0.09758735, 0.099898726, 0.10224173, 0.104616486, 0.107023105, 0.10946171, 0.11193243, 0.114435375,
    0.116970666, 0.11953843, 0.122138776, 0.12477182, 0.12743768, 0.13013647, 0.13286832, 0.13563333, 0.13843161,
    0.14126329, 0.14412847, 0.14702727, 0.14995979, 0.15292615, 0.15592647, 0.15896083, 0.16202937, 0.1651322,
    0.1682694, 0.17144111, 0.1746474, 0.17788842, 0.18116425, 0.18447499, 0.18782078, 0.19120169, 0.19461784,
    0.19806932, 0.20155625, 0.20507874, 0.20863687, 0.21223076, 0.2158605, 0.2195262, 0.22322796, 0.22696587,
    0.23074006, 0.23455058, 0.23839757, 0.24228112, 0.24620132, 0.25015828, 0.2541521, 0.25818285, 0.26225066,
    0.2663556, 0.2704978, 0.2746773, 0.27889428, 0.28314874, 0.28744084, 0.29177064, 0.29613826, 0.30054379,
    0.3049873, 0.30946892, 0.31398872, 0.31854677, 0.3231432, 0.3277781, 0.33245152, 0.33716363, 0.34191442,
    0.34670407, 0.3515326, 0.35640013, 0.3613068, 0.3662526, 0.3712377, 0.37626213, 0.38132602, 0.38642943,
    0.39157248, 0.39675522, 0.40197778, 0.4072402, 0.4125426, 0.41788507, 0.42326766, 0.4286905, 0.43415365,
    0.43965718, 0.4452012, 0.4507858, 0.45641103, 0.462077, 0.4677838, 0.47353148, 0.47932017, 0.48514995, 0.49102086,
    0.49693298, 0.5028865, 0.50888133, 0.5149177, 0.52099556, 0.5271151, 0.5332764, 0.5394795, 0.54572445, 0.55201143,
    0.5583404, 0.5647115, 0.57112485, 0.57758045, 0.58407843, 0.59061885, 0.59720176, 0.60382736, 0.61049557,
    0.6172066, 0.6239604, 0.63075715, 0.63759685, 0.6444797, 0.65140563, 0.65837485, 0.6653873, 0.67244315, 0.6795425,
    0.6866853, 0.69387174, 0.7011019, 0.70837575, 0.7156935, 0.7230551, 0.73046076, 0.7379104, 0.7454042, 0.7529422,
    0.7605245, 0.76815116, 0.7758222, 0.7835378, 0.7912979, 0.7991027, 0.80695224, 0.8148466, 0.82278574, 0.8307699,
    0.838799, 0.8468732, 0.8549926, 0.8631572, 0.8713671, 0.8796224, 0.8879231, 0.8962694, 0.9046612, 0.91309863,
    0.92158186, 0.9301109, 0.9386857, 0.9473065, 0.9559733, 0.9646863, 0.9734453, 0.9822506, 0.9911021, 1.0,
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::color::srgb_to_linear;

    fn gradient(wrap: Wrap, nearest: bool) -> Texture {
        let pixels = [0u8, 50, 100, 150].map(|v| [v, v, v, v]).to_vec();
        Texture { width: 4, height: 1, pixels, wrap: [wrap, Wrap::Repeat], nearest }
    }

    fn value(texture: &Texture, u: f32) -> f32 {
        texture.sample_linear(Vec2::new(u, 0.5)).x * 255.0
    }

    #[test]
    fn the_table_is_the_transfer_function() {
        for (i, &linear) in SRGB_TO_LINEAR.iter().enumerate() {
            let exact = srgb_to_linear(i as f32 / 255.0);
            assert!((linear - exact).abs() <= 1e-6 * exact.max(1e-3), "{i}: {linear} {exact}");
        }
    }

    #[test]
    fn texel_centres_are_exact_and_between_them_linear() {
        let t = gradient(Wrap::Clamp, false);
        for (u, expected) in [(0.125, 0.0), (0.375, 50.0), (0.875, 150.0), (0.25, 25.0), (0.0, 0.0), (1.0, 150.0)] {
            assert!((value(&t, u) - expected).abs() < 1e-3, "{u}");
        }
    }

    #[test]
    fn wrap_modes() {
        let t = gradient(Wrap::Repeat, false);
        for (u, expected) in [(1.375, 50.0), (-0.625, 50.0), (0.0, 75.0), (1.0, 75.0), (-7.875, 0.0)] {
            assert!((value(&t, u) - expected).abs() < 1e-3, "repeat {u}");
        }
        let t = gradient(Wrap::Mirror, false);
        for (u, expected) in [(1.125, 150.0), (1.375, 100.0), (-0.375, 50.0), (0.0, 0.0), (1.0, 150.0), (2.375, 50.0)] {
            assert!((value(&t, u) - expected).abs() < 1e-3, "mirror {u}");
        }
        let t = gradient(Wrap::Clamp, false);
        assert_eq!((value(&t, -3.0), value(&t, 9.0)), (0.0, 150.0));
    }

    #[test]
    fn nearest_takes_the_texel_that_contains_the_point() {
        let t = gradient(Wrap::Repeat, true);
        for (u, expected) in [(0.0, 0.0), (0.249, 0.0), (0.251, 50.0), (0.999, 150.0), (1.0, 0.0), (-0.001, 150.0)] {
            assert!((value(&t, u) - expected).abs() < 1e-3, "{u}");
        }
    }

    #[test]
    fn colours_are_filtered_after_decoding() {
        let pixels = vec![[0, 0, 0, 0], [255, 255, 255, 255]];
        let t = Texture { width: 2, height: 1, pixels, wrap: [Wrap::Clamp; 2], nearest: false };
        assert!((t.sample_srgb(Vec2::new(0.5, 0.5)) - Vec4::splat(0.5)).abs().max_element() < 1e-6);
        assert_eq!(t.sample_alpha(Vec2::new(0.3, 0.5)), t.sample_srgb(Vec2::new(0.3, 0.5)).w);
    }

    #[test]
    fn row_zero_is_v_zero() {
        let pixels = vec![[10; 4], [200; 4]];
        let t = Texture { width: 1, height: 2, pixels, wrap: [Wrap::Clamp; 2], nearest: true };
        assert_eq!(t.sample_linear(Vec2::new(0.5, 0.1)).x, 10.0 / 255.0);
    }

    #[test]
    fn any_coordinate_gives_a_finite_value() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for nearest in [false, true] {
                for u in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e-30, 1e9, -1e9] {
                    let v = value(&gradient(wrap, nearest), u);
                    assert!((0.0..=150.001).contains(&v), "{wrap:?} {nearest} {u} {v}");
                }
            }
        }
    }
}
