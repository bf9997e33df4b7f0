//! How long a bake takes, from what is known before it begins.
//!
//! In: scene, atlas, settings. Out: [`Time`]. Work is counted in seconds of one core and shared among the threads:
//! charting by triangle, what is done per chart (borders, seams, filling) and per side of a texel, and rays, whose cost
//! grows with the depth of the hierarchy. Rays are those of the first round; a line of the walk has [`BOUNCES`] of them.
//!
//! Factors are least squares of the logarithm over 32 bakes on one kind of machine (two cores of a server, AVX2): nine
//! fixtures by `preview` and `production`, and 19 files of others with 80 to 215,579 triangles. The estimate was within
//! a factor of 2 for 30 of them, of 1.5 for 23; the worst took 2.6 times as long as estimated. That of a copy's triangle
//! is from one bake of 5,000 copies of 9,798.
//!
//! Limits: another machine is not known, nothing but the number of threads is. Scenes with thousands of small emitters
//! take longer and were left out of the fit. What adaptive rays find and what `--target-error`, `--time-limit`, pictures
//! and other outputs add is not in it, nor is reading and decoding the files.

use crate::atlas::Atlas;
use crate::base::parallel;
use crate::memory;
use crate::scene::{Scene, Sky};
use crate::settings::{DirectMode, Settings};

/// Charting and placing a triangle [core seconds].
const PER_TRIANGLE: f64 = 8e-5;
/// Placing a triangle whose charts another part has, too [core seconds].
const PER_COPIED_TRIANGLE: f64 = 1.4e-5;
/// Borders of a chart: links, seams, filling [core seconds].
const PER_CHART: f64 = 1.4e-3;
/// A side of a texel, without its rays [core seconds].
const PER_SIDE: f64 = 5e-5;
/// A ray, for each level of a binary hierarchy [core seconds].
const PER_RAY_AND_LEVEL: f64 = 1e-7;
/// Rays of a line of the walk, in scenes of usual reflectance.
const BOUNCES: f64 = 3.0;

/// How long a bake takes; on another kind of machine another multiple of it.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Time {
    /// From start to end [s].
    pub seconds: f64,
    /// On so many threads.
    pub threads: usize,
}

impl Time {
    /// For a bake of `scene` on `atlas` with as many threads as there are here.
    #[must_use]
    pub(super) fn new(scene: &Scene, atlas: &Atlas, settings: &Settings) -> Self {
        let threads = parallel::threads();
        let triangles = scene.triangle_count() as f64;
        let sides = atlas.covered_texels as f64 * memory::sides(scene);
        let levels = libm::log2(triangles + 2.0);
        let groups = if settings.light_groups { memory::groups(scene) as f64 } else { 1.0 };
        let light = PER_SIDE * sides + PER_RAY_AND_LEVEL * levels * rays(scene, settings, sides);
        let charted: usize = atlas.layouts().0.iter().map(|layout| layout.triangles.len()).sum();
        let placed: usize = atlas.parts.iter().map(|part| part.layout.triangles.len()).sum();
        let geometry = PER_TRIANGLE * charted as f64 + PER_COPIED_TRIANGLE * (placed - charted) as f64;
        let work = geometry + PER_CHART * atlas.charts.len() as f64 + groups * light;
        Self { seconds: work / threads as f64, threads }
    }

    /// For people.
    pub(super) fn words(self) -> String {
        let Self { seconds, threads } = self;
        let about = match seconds {
            ..1.0 => "less than a second".to_owned(),
            ..120.0 => format!("about {seconds:.0} s"),
            _ => format!("about {:.0} minutes", seconds / 60.0),
        };
        format!("{about} on {threads} {}", if threads == 1 { "thread" } else { "threads" })
    }
}

/// Rays of all kinds from so many sides of texels.
fn rays(scene: &Scene, settings: &Settings, sides: f64) -> f64 {
    let finite = scene.parts.iter().any(|part| scene.glows(part));
    let sky = scene.environment.is_some() || scene.sky != Sky::default();
    let kinds = usize::from(finite) + usize::from(sky);
    let direct = match settings.direct {
        DirectMode::Gather => f64::from(settings.direct_samples) * kinds as f64 + scene.lights.len() as f64,
        DirectMode::Shoot => 0.0,
    };
    let lines = settings.lines.map_or(settings.lines_per_texel * sides, |lines| lines as f64);
    sides * (direct + f64::from(settings.gather)) + BOUNCES * lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_have_a_unit_that_fits() {
        let words = |seconds| Time { seconds, threads: 2 }.words();
        assert_eq!(words(0.2), "less than a second on 2 threads");
        assert_eq!(words(41.6), "about 42 s on 2 threads");
        assert_eq!(words(600.0), "about 10 minutes on 2 threads");
        assert_eq!(Time { seconds: 3.0, threads: 1 }.words(), "about 3 s on 1 thread");
    }
}
