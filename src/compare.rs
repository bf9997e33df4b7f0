//! How far one lightmap is from another: the figures of `texelwalk compare`.
//!
//! A texel counts where the reference is covered (A > 0, if it has an A channel) and the mask, if there is one, is
//! above 0 in any of R, G, B. With r and t the values of reference and test over the three channels of all texels that
//! count:
//!   MSE = mean (t − r)²      NRMSE = √MSE / mean r      PSNR = 10 log₁₀ (max r)² / MSE [dB]
//!
//! Sums are taken in double precision in a fixed order, so the figures have the same bits at every thread count.

use crate::base::parallel;
use crate::output::exr::ImageF32;

/// The figures of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Comparison {
    /// Texels that counted.
    pub texels: u64,
    /// Mean square error over all channels.
    pub mse: f64,
    /// Root mean square error over the mean of the reference; infinite (`null` in JSON) if only the latter is 0.
    pub nrmse: f64,
    /// Peak signal-to-noise ratio [dB], peak = largest reference value; infinite (`null`) for equal pictures.
    pub psnr: f64,
    /// Largest absolute difference of a channel.
    pub max: f64,
    /// Mean of the test over mean of the reference; 1 if both are 0.
    pub mean_ratio: f64,
    /// Mean of the reference over all channels.
    pub mean_reference: f64,
    /// Mean of the test over all channels.
    pub mean_test: f64,
}

impl Comparison {
    /// JSON with a final line break.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).map_or(String::new(), |s| s + "\n")
    }

    /// A table for people.
    #[must_use]
    pub fn to_text(&self) -> String {
        format!(
            "texels      {}\nMSE         {:.6e}\nNRMSE       {:.6}\nPSNR        {:.2} dB\nmax         {:.6e}\n\
             mean ratio  {:.6}\n",
            self.texels, self.mse, self.nrmse, self.psnr, self.max, self.mean_ratio
        )
    }
}

/// Why two pictures cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// Different sizes.
    #[error("the {which} has {} × {} texels, the reference {} × {}; compare pictures of one size", size[0], size[1], reference[0], reference[1])]
    Size {
        /// `test` or `mask`.
        which: &'static str,
        /// Its width and height.
        size: [u32; 2],
        /// Width and height of the reference.
        reference: [u32; 2],
    },
    /// Coverage and mask leave no texel.
    #[error("no texel counts: the reference covers none of those that the mask lets through")]
    Nothing,
    /// A value that cannot be compared.
    #[error("the {which} has {count} texels that are infinite or not a number, the first at ({x}, {y})")]
    NotFinite {
        /// `reference` or `test`.
        which: &'static str,
        /// How many.
        count: usize,
        /// Column of the first.
        x: usize,
        /// Row of the first.
        y: usize,
    },
}

/// Compares `test` with `reference` where the latter is covered and `mask` is above 0.
///
/// # Errors
/// If sizes differ, no texel counts, or a texel that counts is not finite.
pub fn compare(reference: &ImageF32, test: &ImageF32, mask: Option<&ImageF32>) -> Result<Comparison, Error> {
    let size = [reference.width, reference.height];
    for (which, image) in [("test", Some(test)), ("mask", mask)] {
        if let Some(image) = image.filter(|image| [image.width, image.height] != size) {
            return Err(Error::Size { which, size: [image.width, image.height], reference: size });
        }
    }
    let counts = |i: usize| {
        let covered = !reference.has_alpha || reference.pixels[i][3] > 0.0;
        covered && mask.is_none_or(|mask| mask.pixels[i][..3].iter().any(|&m| m > 0.0))
    };
    let indices: Vec<usize> = (0..reference.pixels.len()).filter(|&i| counts(i)).collect();
    if indices.is_empty() {
        return Err(Error::Nothing);
    }
    for (which, image) in [("reference", reference), ("test", test)] {
        let bad: Vec<usize> =
            indices.iter().copied().filter(|&i| !image.pixels[i][..3].iter().all(|v| v.is_finite())).collect();
        if let Some(&first) = bad.first() {
            let width = size[0].max(1) as usize;
            return Err(Error::NotFinite { which, count: bad.len(), x: first % width, y: first / width });
        }
    }
    Ok(figures(reference, test, &indices))
}

fn figures(reference: &ImageF32, test: &ImageF32, indices: &[usize]) -> Comparison {
    let values = indices.len() as f64 * 3.0;
    let channels = |k: usize, f: &dyn Fn(f64, f64) -> f64| {
        let (r, t) = (reference.pixels[indices[k]], test.pixels[indices[k]]);
        [0, 1, 2].map(|c| f(f64::from(r[c]), f64::from(t[c])))
    };
    let mean = |f: &(dyn Fn(f64, f64) -> f64 + Sync)| {
        parallel::sum(indices.len(), |k| channels(k, &|r, t| f(r, t)).iter().fold(0.0, |a, b| a + b)) / values
    };
    let largest =
        |f: &dyn Fn(f64, f64) -> f64| (0..indices.len()).flat_map(|k| channels(k, f)).fold(f64::NEG_INFINITY, f64::max);
    let mse = mean(&|r, t| (t - r) * (t - r));
    let (mean_reference, mean_test) = (mean(&|r, _| r), mean(&|_, t| t));
    let peak = largest(&|r, _| r).max(0.0);
    Comparison {
        texels: indices.len() as u64,
        mse,
        nrmse: if mse == 0.0 { 0.0 } else { mse.sqrt() / mean_reference.abs() },
        psnr: if mse == 0.0 { f64::INFINITY } else { 10.0 * libm::log10(peak * peak / mse) },
        max: largest(&|r, t| (t - r).abs()),
        mean_ratio: if mean_reference == mean_test { 1.0 } else { mean_test / mean_reference },
        mean_reference,
        mean_test,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(width: u32, pixels: &[[f32; 4]]) -> ImageF32 {
        ImageF32 { width, height: pixels.len() as u32 / width, pixels: pixels.to_vec(), has_alpha: true }
    }

    #[test]
    fn figures_by_hand() {
        let reference = image(2, &[[1.0, 2.0, 3.0, 1.0], [4.0, 2.0, 0.0, 1.0]]);
        let test = image(2, &[[1.5, 2.0, 3.0, 1.0], [4.0, 1.0, 0.0, 0.0]]);
        let c = compare(&reference, &test, None).unwrap();
        assert_eq!(c.texels, 2);
        assert!((c.mse - 1.25 / 6.0).abs() < 1e-12);
        assert!((c.nrmse - (1.25f64 / 6.0).sqrt() / 2.0).abs() < 1e-12);
        assert!((c.psnr - 10.0 * (16.0f64 / (1.25 / 6.0)).log10()).abs() < 1e-9);
        assert!((c.max - 1.0).abs() < 1e-12);
        assert!((c.mean_ratio - 11.5 / 12.0).abs() < 1e-12);
    }

    #[test]
    fn equal_pictures() {
        let a = image(1, &[[0.0, 0.0, 0.0, 1.0]]);
        let c = compare(&a, &a, None).unwrap();
        assert_eq!((c.mse, c.nrmse, c.psnr, c.max, c.mean_ratio), (0.0, 0.0, f64::INFINITY, 0.0, 1.0));
    }

    #[test]
    fn uncovered_and_masked_texels_do_not_count() {
        let reference = image(3, &[[1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 0.0], [1.0, 1.0, 1.0, 1.0]]);
        let test = image(3, &[[1.0, 1.0, 1.0, 1.0], [9.0, f32::NAN, 9.0, 1.0], [2.0, 2.0, 2.0, 1.0]]);
        assert!((compare(&reference, &test, None).unwrap().mse - 0.5).abs() < 1e-12);
        let mask = image(3, &[[0.0, 0.1, 0.0, 1.0], [1.0; 4], [0.0, 0.0, 0.0, 1.0]]);
        assert_eq!(compare(&reference, &test, Some(&mask)).unwrap().mse, 0.0);
        let nothing = image(3, &[[0.0; 4]; 3]);
        assert_eq!(compare(&reference, &test, Some(&nothing)), Err(Error::Nothing));
        // Without an A channel in the reference every texel counts, so the bad one is found.
        let open = ImageF32 { has_alpha: false, ..reference };
        assert_eq!(compare(&open, &test, None), Err(Error::NotFinite { which: "test", count: 1, x: 1, y: 0 }));
    }

    #[test]
    fn sizes_must_agree() {
        let (a, b) = (image(2, &[[1.0; 4]; 4]), image(4, &[[1.0; 4]; 4]));
        assert!(matches!(compare(&a, &b, None), Err(Error::Size { which: "test", .. })));
        assert!(matches!(compare(&a, &a, Some(&b)), Err(Error::Size { which: "mask", .. })));
    }

    #[test]
    fn the_same_bits_at_every_thread_count() {
        let pixels = |k: f32| (0..100_000).map(|i| [(i as f32 * k) % 1.0, k, 0.3, 1.0]).collect::<Vec<_>>();
        let (a, b) = (image(100, &pixels(0.1234)), image(100, &pixels(0.1235)));
        let bits: Vec<u64> = [1, 3, 8]
            .into_iter()
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| compare(&a, &b, None).unwrap().mse.to_bits())
            })
            .collect();
        assert!(bits.windows(2).all(|w| w[0] == w[1]));
    }
}
