//! Heat maps in seven steps: the colour of a value, and how many texels have it.
//!
//! Steps and not a ramp, because a reader then finds each colour in the legend, and its number. Steps of density have
//! the hues of `render --overlay density`. Steps of error run from dark to bright, so that they can be told apart
//! without hue (viridis: S. van der Walt, N. Smith, "A Better Default Colormap for Matplotlib", `SciPy` 2015).

use crate::base::color::srgb_to_linear;
use crate::render;

/// Steps of a scale.
pub(super) const STEPS: usize = 7;

/// sRGB of viridis at k/6.
const VIRIDIS: [[u8; 3]; STEPS] =
    [[68, 1, 84], [68, 57, 131], [49, 104, 142], [33, 145, 140], [53, 183, 121], [144, 215, 67], [253, 231, 37]];

/// One step of a legend.
#[derive(Debug, Clone)]
pub(super) struct Share {
    /// Values in it, for people.
    pub(super) label: String,
    /// Linear display colour.
    pub(super) color: [f32; 3],
    /// Part of all texels, in [0, 1].
    pub(super) share: f64,
}

/// A colour for each of seven ranges of a value.
pub(super) struct Scale {
    /// Where steps 1, 2, … begin.
    bounds: [f32; STEPS - 1],
    colors: [[f32; 3]; STEPS],
    /// A bound for people.
    label: fn(f32) -> String,
    unit: &'static str,
}

impl Scale {
    /// Density in steps of a factor of two around the median [texels/m].
    pub(super) fn density(median: f32) -> Self {
        Self {
            bounds: [-2.5f32, -1.5, -0.5, 0.5, 1.5, 2.5].map(|stops| median * libm::exp2f(stops)),
            colors: [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0].map(|stops| render::density_color(stops).to_array()),
            label: |density| super::markup::significant(f64::from(density), 2),
            unit: "texels/m",
        }
    }

    /// Relative error in steps of a factor of two.
    pub(super) fn error() -> Self {
        Self {
            bounds: [0.5, 1.0, 2.0, 4.0, 8.0, 16.0].map(|percent: f32| percent * 0.01),
            colors: VIRIDIS.map(|color| color.map(|c| srgb_to_linear(f32::from(c) / 255.0))),
            label: |error| super::markup::significant(f64::from(error) * 100.0, 2),
            unit: "%",
        }
    }

    fn step(&self, value: f32) -> usize {
        self.bounds.iter().take_while(|&&bound| value >= bound).count()
    }

    /// Linear display colour of a value.
    pub(super) fn color(&self, value: f32) -> [f32; 3] {
        self.colors[self.step(value)]
    }

    /// The legend for these values.
    pub(super) fn legend(&self, values: impl Iterator<Item = f32>) -> Vec<Share> {
        let mut counts = [0u64; STEPS];
        values.for_each(|value| counts[self.step(value)] += 1);
        let all = counts.iter().sum::<u64>().max(1) as f64;
        let share = |k: usize| Share { label: self.range(k), color: self.colors[k], share: counts[k] as f64 / all };
        (0..STEPS).map(share).collect()
    }

    fn range(&self, k: usize) -> String {
        let bound = |k: usize| (self.label)(self.bounds[k]);
        match k {
            0 => format!("below {} {}", bound(0), self.unit),
            _ if k == STEPS - 1 => format!("{} {} or more", bound(k - 1), self.unit),
            _ => format!("{} to {} {}", bound(k - 1), bound(k), self.unit),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_has_one_step_and_shares_add_up() {
        let scale = Scale::error();
        let values = [0.0, 0.004, 0.005, 0.03, 0.15, 0.16, 9.0, f32::INFINITY];
        let legend = scale.legend(values.into_iter());
        let counts: Vec<f64> = legend.iter().map(|s| s.share * 8.0).collect();
        assert_eq!(counts, [2.0, 1.0, 0.0, 1.0, 0.0, 1.0, 3.0]);
        assert_eq!((legend[0].label.as_str(), legend[6].label.as_str()), ("below 0.5 %", "16 % or more"));
        assert_eq!(scale.color(0.17), legend[6].color);
        assert_eq!(Scale::density(16.0).legend([16.0, 16.1].into_iter())[3].share, 1.0);
    }

    #[test]
    fn error_colors_grow_brighter() {
        let luminance = Scale::error().colors.map(|c| crate::base::color::luminance(c.into()));
        assert!(luminance.windows(2).all(|w| w[0] < w[1]));
    }
}
