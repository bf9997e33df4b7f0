//! Luminous intensity of a lamp by direction: a table over azimuth and latitude, interpolated bilinearly in the angles.
//!
//! In: knots, candela, and the axes that the angles are counted from. Out: candela in a direction, flux, the cone that
//! holds all light, and directions drawn in proportion to the light, for shooting.
//!
//! A [`Profile`] is all one grid, whatever the photometric type of its file: type C turns about the axis of the lamp, B
//! and A about an axis across it. `ies.rs` lays mirrored halves out, so nothing is symmetric here.
//!
//! A cell of the table is chosen by its flux, and within it a direction uniformly by solid angle. The density that is
//! divided by is that of the choice as it was rounded, so the mean of what is shot is the integral of the
//! interpolated table. Pharr, Jakob, Humphreys, *Physically Based Rendering*, 4th edition, appendix A.5.6.
//!
//! Symbols: a azimuth [rad], b latitude [rad], f candela at the lower and upper edge of a cell.
//!
//! Invariants: knots ascend, at least two each; azimuths span at most a turn; candela are finite and not negative.

use crate::base::distribution::Grid;
use core::f32::consts::TAU;
use glam::{Mat3, Vec2, Vec3};

/// What rounding may leave between a direction and the edge of the table [rad].
const EDGE: f32 = 1e-5;

/// Candela by direction. Directions are in the frame of the lamp, which aims along −z.
#[derive(Debug, Clone)]
pub struct Profile {
    /// Ascending [rad].
    azimuths: Vec<f32>,
    /// Ascending, from −π/2 to π/2 at most [rad].
    latitudes: Vec<f32>,
    /// By latitude, then azimuth [cd].
    candela: Vec<f32>,
    /// Columns: the directions of azimuth 0 and of azimuth 90° at latitude 0, and the pole.
    axes: Mat3,
    cells: Grid,
    flux: f64,
    peak: f32,
    cos_reach: f32,
}

impl Profile {
    /// A table; `candela` has a row of azimuths for each latitude. `None` if it is not as the header says.
    pub(super) fn new(azimuths: Vec<f32>, latitudes: Vec<f32>, candela: Vec<f32>, axes: Mat3) -> Option<Self> {
        let ascends = |knots: &[f32]| knots.len() > 1 && knots.windows(2).all(|w| w[0] < w[1]);
        let sound = ascends(&azimuths)
            && ascends(&latitudes)
            && azimuths[azimuths.len() - 1] - azimuths[0] <= TAU + EDGE
            && candela.len() == azimuths.len() * latitudes.len()
            && candela.iter().all(|c| c.is_finite() && *c >= 0.0);
        if !sound {
            return None;
        }
        let peak = candela.iter().copied().fold(0.0, f32::max);
        let mut profile =
            Self { azimuths, latitudes, candela, axes, cells: Grid::default(), flux: 0.0, peak, cos_reach: 1.0 };
        let (width, height) = (profile.azimuths.len() - 1, profile.latitudes.len() - 1);
        let cells = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        profile.flux = cells().map(|(x, y)| profile.cell_flux(x, y)).fold(0.0, |a, b| a + b);
        profile.cos_reach = cells().map(|(x, y)| profile.cell_reach(x, y)).fold(1.0, f32::min);
        profile.cells = Grid::new(width, height, |x, y| profile.cell_flux(x, y) as f32);
        profile.flux.is_finite().then_some(profile)
    }

    /// Luminous intensity in a unit direction [cd]; 0 where the table says nothing.
    #[must_use]
    pub fn candela(&self, direction: Vec3) -> f32 {
        let local = self.axes.transpose() * direction;
        let latitude = libm::atan2f(local.z, libm::hypotf(local.x, local.y));
        let azimuth = libm::atan2f(local.y, local.x);
        let first = self.azimuths[0];
        let azimuth = if azimuth < first - EDGE { azimuth + TAU } else { azimuth };
        let (Some((x, u)), Some((y, v))) = (locate(&self.azimuths, azimuth), locate(&self.latitudes, latitude)) else {
            return 0.0;
        };
        let row = |y: usize| {
            let [low, high] = [self.at(x, y), self.at(x + 1, y)];
            low + (high - low) * u
        };
        let [low, high] = [row(y), row(y + 1)];
        low + (high - low) * v
    }

    /// Flux in all directions [lm].
    #[must_use]
    pub fn flux(&self) -> f32 {
        self.flux as f32
    }

    /// Largest intensity [cd].
    #[must_use]
    pub fn peak(&self) -> f32 {
        self.peak
    }

    /// Cosine of the angle from the lamp's aim beyond which there is no light.
    #[must_use]
    pub fn cos_reach(&self) -> f32 {
        self.cos_reach
    }

    /// A unit direction by light, and candela over its density per steradian, which is the flux [lm] on average. `None`
    /// if the lamp is dark.
    #[must_use]
    pub fn sample(&self, u: Vec2) -> Option<(Vec3, f32)> {
        let ([x, y], place) = self.cells.sample(u)?;
        let azimuth = self.azimuths[x] + (self.azimuths[x + 1] - self.azimuths[x]) * place.x;
        let [low, high] = [self.latitudes[y], self.latitudes[y + 1]].map(libm::sinf);
        let up = low + (high - low) * place.y;
        let (flat, (sin, cos)) = ((1.0 - up * up).max(0.0).sqrt(), libm::sincosf(azimuth));
        let direction = (self.axes * Vec3::new(flat * cos, flat * sin, up)).normalize();
        let probability = self.cells.probability(x, y);
        let solid_angle = self.solid_angle(x, y) as f32;
        (probability > 0.0).then(|| (direction, self.candela(direction) * solid_angle / probability))
    }

    fn at(&self, x: usize, y: usize) -> f32 {
        self.candela[y * self.azimuths.len() + x]
    }

    fn solid_angle(&self, x: usize, y: usize) -> f64 {
        let [low, high] = [self.latitudes[y], self.latitudes[y + 1]].map(|b| libm::sin(f64::from(b)));
        f64::from(self.azimuths[x + 1] - self.azimuths[x]) * (high - low)
    }

    /// ∫ f(b) cos b db over the cell's latitudes is [f sin b] + slope [cos b]; over azimuths the mean is enough.
    fn cell_flux(&self, x: usize, y: usize) -> f64 {
        let mean = |y: usize| 0.5 * (f64::from(self.at(x, y)) + f64::from(self.at(x + 1, y)));
        let [low, high] = [y, y + 1].map(|y| f64::from(self.latitudes[y]));
        let ((sin_low, cos_low), (sin_high, cos_high)) = (libm::sincos(low), libm::sincos(high));
        let slope = (mean(y + 1) - mean(y)) / (high - low);
        let over = mean(y + 1) * sin_high - mean(y) * sin_low + slope * (cos_high - cos_low);
        (over * f64::from(self.azimuths[x + 1] - self.azimuths[x])).max(0.0)
    }

    /// Least cosine to the aim in a cell that has light, otherwise 1.
    fn cell_reach(&self, x: usize, y: usize) -> f32 {
        let dark =
            [self.at(x, y), self.at(x + 1, y), self.at(x, y + 1), self.at(x + 1, y + 1)].iter().all(|c| *c <= 0.0);
        if dark {
            return 1.0;
        }
        let cosine = |azimuth: f32, latitude: f32| {
            let ((sin_a, cos_a), (sin_b, cos_b)) = (libm::sincosf(azimuth), libm::sincosf(latitude));
            -(self.axes * Vec3::new(cos_b * cos_a, cos_b * sin_a, sin_b)).z
        };
        // Along a latitude the least cosine is at an end, or opposite to the aim's azimuth; along an azimuth at an end, or
        // on the equator. Knots at every 90° of azimuth are what the files have, so ends are enough there.
        let [low, high] = [self.latitudes[y], self.latitudes[y + 1]];
        let latitudes = [low, high, 0.0f32.clamp(low, high)];
        let all = self.azimuths[x..=x + 1].iter().flat_map(|a| latitudes.map(|b| cosine(*a, b)));
        (all.fold(1.0, f32::min) - EDGE).max(-1.0)
    }
}

/// The interval of ascending knots that holds a value, and where in it.
fn locate(knots: &[f32], value: f32) -> Option<(usize, f32)> {
    let last = knots.len() - 1;
    if !(knots[0] - EDGE..=knots[last] + EDGE).contains(&value) {
        return None;
    }
    let k = knots.partition_point(|k| *k <= value).clamp(1, last) - 1;
    Some((k, ((value - knots[k]) / (knots[k + 1] - knots[k])).clamp(0.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::{FRAC_PI_2, PI};

    /// Candela 1 in the lower half, 0 above, with the step from 1 to 0 within a hundredth.
    fn half() -> Profile {
        let latitudes = vec![-FRAC_PI_2, 0.0, 0.01, FRAC_PI_2];
        let candela = [1.0, 1.0, 0.0, 0.0].iter().flat_map(|c| [*c, *c]).collect();
        Profile::new(vec![0.0, TAU], latitudes, candela, Mat3::IDENTITY).unwrap()
    }

    #[test]
    fn flux_is_the_integral_and_draws_have_its_mean() {
        let profile = half();
        let exact = TAU + TAU * 0.005;
        assert!((profile.flux() / exact - 1.0).abs() < 1e-5, "{}", profile.flux());
        let (n, mut sum) = (256, 0.0f64);
        for i in 0..n * n {
            let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
            let (direction, weight) = profile.sample(u).unwrap();
            assert!((direction.length() - 1.0).abs() < 1e-5 && direction.z < 0.011);
            sum += f64::from(weight);
        }
        let mean = sum / f64::from(n * n);
        // The thin ring has 1.3 of the 256 rows of draws.
        assert!((mean / f64::from(exact) - 1.0).abs() < 2e-3, "{mean}");
        assert!((profile.cos_reach() + libm::sinf(0.01)).abs() < 1e-4, "{}", profile.cos_reach());
    }

    #[test]
    fn what_is_no_table_is_refused() {
        let new = |azimuths: &[f32], candela: &[f32]| {
            Profile::new(azimuths.to_vec(), vec![-1.0, 1.0], candela.to_vec(), Mat3::IDENTITY)
        };
        assert!(new(&[0.0, PI], &[1.0; 4]).is_some());
        assert!(new(&[0.0, PI], &[1.0; 3]).is_none());
        assert!(new(&[0.0, 0.0], &[1.0; 4]).is_none());
        assert!(new(&[0.0, 7.0], &[1.0; 4]).is_none());
        assert!(new(&[0.0, PI], &[1.0, 1.0, f32::NAN, 1.0]).is_none());
        assert!(new(&[0.0, PI], &[1.0, 1.0, -1.0, 1.0]).is_none());
        assert!(new(&[0.0, PI], &[0.0; 4]).unwrap().sample(Vec2::splat(0.5)).is_none());
    }
}
