//! A picture of a baked scene, lit by its lightmap alone: the `render` command.
//!
//! In: the baked document as a [`Scene`] and its [`Lightmaps`]. Out: [`Picture`].
//!
//! Through every pixel go n² stratified primary rays. At the first surface that faces the camera (backs of one-sided
//! materials are passed, as viewers cull them) the outgoing radiance is ρ/π · E + emission, where E = texel × intensity
//! is looked up bilinearly on the lightmap's own coordinates; coverage is not looked at, because dilated texels belong
//! to the filter. Unlit materials show their base colour, times light that is at their vertices. What has no lightmap shows only its own emission. Rays that
//! leave the scene meet the sky or, if that is black, a neutral background.
//!
//! Exposure is 2^stops; without it, the log-average luminance of the lit surfaces in view (one ray per pixel) is mapped
//! to [`KEY`]. The tone curve is per channel c(1 + c/W²)/(1 + c) with W = [`WHITE`]: Reinhard, Stark, Shirley,
//! Ferwerda, "Photographic tone reproduction for digital images", SIGGRAPH 2002, eq. (4), there on luminance. Samples
//! are averaged after the curve, so that edges of lamps stay smooth.
//!
//! With [`Settings::linear`] there is neither curve nor exposure nor background: the picture is the mean radiance of a
//! pixel [cd/m²], to be compared with other programs.

mod camera;
mod lightmap;
mod overlay;

pub use camera::{Toward, View};
pub use lightmap::{Lightmaps, Place};
pub use overlay::Overlay;
pub(crate) use overlay::{chart_color, density_color, median_density};

use crate::base::Rgb;
use crate::base::Stream;
use crate::base::color::luminance;
use crate::base::parallel;
use crate::base::random::Stage;
use crate::scene::Scene;
use crate::trace::Hit;
use crate::trace::Ray;
use crate::trace::Tracer;
use camera::Eye;
use overlay::Painter;

/// Value before the tone curve that auto exposure gives the log-average.
pub const KEY: f32 = 0.22;

/// Value before the tone curve that becomes white.
pub const WHITE: f32 = 6.0;

/// Reflectance of every surface where only light is shown.
const PLASTER: Rgb = Rgb::splat(0.7);

/// Linear display value of the neutral background.
pub(crate) const NEUTRAL: f32 = 0.05;

/// Backs that a ray passes before it counts as lost: only broken geometry has more of them in a row.
const MAX_PASSES: usize = 64;

/// How to take the picture.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Width [px].
    pub width: u32,
    /// Height [px].
    pub height: u32,
    /// Rays per pixel; the next square number is used.
    pub samples: u32,
    /// Exposure in stops; `None` = automatic.
    pub exposure: Option<f32>,
    /// Where to stand.
    pub view: View,
    /// What to show.
    pub overlay: Overlay,
    /// Radiance [cd/m²] instead of display values.
    pub linear: bool,
}

impl Default for Settings {
    fn default() -> Self {
        let (view, overlay) = (View::Default, Overlay::None);
        Self { width: 1280, height: 720, samples: 16, exposure: None, view, overlay, linear: false }
    }
}

/// A picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Width [px].
    pub width: u32,
    /// Height [px].
    pub height: u32,
    /// Linear display values in [0, 1], or radiance [cd/m²]; top row first.
    pub pixels: Vec<[f32; 3]>,
    /// Part of each pixel that shows a surface, in [0, 1].
    pub coverage: Vec<f32>,
    /// Exposure that was used [stops].
    pub exposure: f32,
    /// Name of the camera, or `auto`.
    pub camera: String,
}

/// Why there is no picture.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The document has no such camera.
    #[error("there is no camera {index} that can be used; the document has {count}{}", if *count == 0 { ", try --auto" } else { "" })]
    NoCamera {
        /// The number asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A size of zero, or beyond what a picture may have.
    #[error("a picture of {width} × {height} px with {samples} rays per pixel is out of range")]
    Size {
        /// Width [px].
        width: u32,
        /// Height [px].
        height: u32,
        /// Rays per pixel.
        samples: u32,
    },
}

/// Takes the picture.
///
/// # Errors
/// If the camera does not exist or the size is out of range.
pub fn render(scene: &Scene, lightmaps: &Lightmaps, settings: &Settings) -> Result<Picture, Error> {
    let Settings { width, height, samples, .. } = *settings;
    let mut pictures = series(&Tracer::of_all(scene), lightmaps, settings, &[settings.overlay])?;
    pictures.pop().ok_or(Error::Size { width, height, samples })
}

/// One picture for each of `overlays`, by the same rays and with the same exposure; that of the settings is not used.
///
/// # Errors
/// As for [`render`].
pub fn series(
    tracer: &Tracer<'_>,
    lightmaps: &Lightmaps,
    settings: &Settings,
    overlays: &[Overlay],
) -> Result<Vec<Picture>, Error> {
    let Settings { width, height, samples, .. } = *settings;
    let in_range = |n: u32| (1..=32768).contains(&n);
    if !in_range(width) || !in_range(height) || !(1..=65536).contains(&samples) {
        return Err(Error::Size { width, height, samples });
    }
    let shot = Shot { scene: tracer.scene(), lightmaps, tracer };
    let painters: Vec<Painter<'_>> = overlays.iter().map(|&o| Painter::new(shot.scene, lightmaps, o)).collect();
    let aspect = width as f32 / height as f32;
    let eye = camera::eye(&shot, settings.view, aspect)?;
    let size = [width as usize, height as usize];
    let exposure = match settings.exposure {
        _ if settings.linear => 0.0,
        Some(stops) => stops,
        None => shot.auto_exposure(&eye, size, overlays == [Overlay::Light]),
    };
    let factor = libm::exp2f(exposure);
    let value = |seen: &Seen| if settings.linear { seen.radiance() } else { seen.display(factor) };
    let strata = (1..).find(|n| n * n >= samples).unwrap_or(1);
    let rays = (strata * strata) as f32;
    let pixels = parallel::map(size[0] * size[1], |i| {
        let mut shown = vec![(Rgb::ZERO, 0); painters.len()];
        let mut random = Stream::new(0, Stage::Render, i as u64, 0);
        for s in 0..strata * strata {
            let (sx, sy) = ((s % strata) as f32, (s / strata) as f32);
            let dx = (sx + random.next_f32()) / strata as f32;
            let dy = (sy + random.next_f32()) / strata as f32;
            let ray = eye.through(i, size, [dx, dy]);
            let hit = shot.first_hit(&ray);
            for (painter, (sum, surfaces)) in painters.iter().zip(&mut shown) {
                let seen = shot.look(&ray, hit.as_ref(), painter);
                *sum += value(&seen);
                *surfaces += u32::from(!matches!(seen, Seen::Sky(_) | Seen::Nothing));
            }
        }
        shown
    });
    let picture = |k: usize| Picture {
        width,
        height,
        pixels: pixels.iter().map(|shown| (shown[k].0 / rays).to_array()).collect(),
        coverage: pixels.iter().map(|shown| shown[k].1 as f32 / rays).collect(),
        exposure,
        camera: eye.name.clone(),
    };
    Ok((0..painters.len()).map(picture).collect())
}

/// What a ray from the camera shows.
enum Seen {
    /// A lit or glowing surface: reflected light [cd/m²], emission [cd/m²].
    Surface(Rgb, Rgb),
    /// A colour that is meant for the display as it is.
    Painted(Rgb),
    /// The sky [cd/m²].
    Sky(Rgb),
    /// Nothing.
    Nothing,
}

impl Seen {
    /// Linear display value in [0, 1].
    fn display(&self, factor: f32) -> Rgb {
        match *self {
            Self::Surface(reflected, emitted) => tone((reflected + emitted) * factor),
            Self::Sky(radiance) => tone(radiance * factor),
            Self::Painted(color) => color.clamp(Rgb::ZERO, Rgb::ONE),
            Self::Nothing => Rgb::splat(NEUTRAL),
        }
    }

    /// Radiance [cd/m²]; black where there is nothing.
    fn radiance(&self) -> Rgb {
        match *self {
            Self::Surface(reflected, emitted) => reflected + emitted,
            Self::Sky(color) | Self::Painted(color) => color,
            Self::Nothing => Rgb::ZERO,
        }
    }
}

/// A scene with everything that looking at it takes.
struct Shot<'a> {
    scene: &'a Scene,
    lightmaps: &'a Lightmaps,
    tracer: &'a Tracer<'a>,
}

impl Shot<'_> {
    /// The first surface whose visible side the ray meets.
    fn first_hit(&self, ray: &Ray) -> Option<Hit> {
        let mut ray = *ray;
        let mut travelled = 0.0;
        for _ in 0..MAX_PASSES {
            let hit = self.tracer.closest_hit(&ray)?;
            if hit.front || self.scene.material(hit.triangle).double_sided {
                return Some(Hit { t: hit.t + travelled, ..hit });
            }
            travelled += hit.t;
            ray.origin = self.tracer.origin_on(hit.triangle, hit.b, ray.direction);
        }
        None
    }

    /// What is seen where a ray met its first hit.
    fn look(&self, ray: &Ray, hit: Option<&Hit>, painter: &Painter<'_>) -> Seen {
        let Some(hit) = hit else {
            let sky = &self.scene.sky;
            return if sky.is_black() {
                Seen::Nothing
            } else {
                Seen::Sky(sky.radiance(ray.direction.normalize_or_zero()))
            };
        };
        if let Some(color) = painter.color(hit, ray) {
            return Seen::Painted(color);
        }
        self.lit(hit, painter.overlay() == Overlay::Light)
    }

    /// A surface under its baked light; `bare`: as if it were of plaster.
    fn lit(&self, hit: &Hit, bare: bool) -> Seen {
        let base = || self.scene.base_color(hit.triangle, hit.b).truncate();
        let unlit = self.scene.material(hit.triangle).unlit;
        if unlit && !self.lightmaps.is_at_vertices(self.scene, hit.triangle) {
            return Seen::Painted(base());
        }
        let irradiance = self.lightmaps.irradiance(self.scene, hit.triangle, hit.b).unwrap_or(Rgb::ZERO);
        let reflectance = match bare {
            true => PLASTER,
            false if unlit => base(),
            false => self.scene.reflectance(hit.triangle, hit.b),
        };
        let emission = if bare { Rgb::ZERO } else { self.scene.shown_emission(hit.triangle, hit.b) };
        Seen::Surface(reflectance * irradiance * core::f32::consts::FRAC_1_PI, emission)
    }

    /// Stops that map the log-average of what is lit to [`KEY`]; 0 if nothing is.
    fn auto_exposure(&self, eye: &Eye, size: [usize; 2], bare: bool) -> f32 {
        let values = parallel::map(size[0] * size[1], |i| {
            let hit = self.first_hit(&eye.through(i, size, [0.5, 0.5]));
            match hit.map(|hit| self.lit(&hit, bare)) {
                Some(Seen::Surface(reflected, _)) => f64::from(luminance(reflected)),
                _ => 0.0,
            }
        });
        // Unlit corners would pull a logarithm down without end, so everything below a thousandth of the mean is left
        // out.
        let lit = values.iter().filter(|v| **v > 0.0).count() as f64;
        let least = values.iter().fold(0.0, |a, b| a + b) / lit.max(1.0) * 1e-3;
        let (mut sum, mut count) = (0.0, 0.0);
        for value in values.into_iter().filter(|v| v.is_finite() && *v > least) {
            sum += libm::log2(value);
            count += 1.0;
        }
        if count == 0.0 { 0.0 } else { (f64::from(libm::log2f(KEY)) - sum / count) as f32 }
    }
}

/// The tone curve: 0 ↦ 0, [`WHITE`] ↦ 1, clamped beyond.
pub(crate) fn tone(color: Rgb) -> Rgb {
    let c = color.max(Rgb::ZERO);
    (c * (Rgb::ONE + c / (WHITE * WHITE)) / (Rgb::ONE + c)).min(Rgb::ONE)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tone_curve_rises_from_black_to_white() {
        assert_eq!(tone(Rgb::ZERO), Rgb::ZERO);
        assert!((tone(Rgb::splat(WHITE)) - Rgb::ONE).abs().max_element() < 1e-6);
        assert_eq!(tone(Rgb::splat(1e9)), Rgb::ONE);
        assert_eq!(tone(Rgb::splat(-1.0)), Rgb::ZERO);
        let values: Vec<f32> = (0..600).map(|i| tone(Rgb::splat(i as f32 * 0.01)).x).collect();
        assert!(values.windows(2).all(|w| w[0] < w[1]));
    }
}
