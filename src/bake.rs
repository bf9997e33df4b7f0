//! The bake from file to files: the only code that names every stage.
//!
//! In: [`Request`]. Out: files on disk and the [`Report`]. All outputs appear together at the end or not at all.
//!
//! The walk and the gather run as two halves that share no random number: the first half of the gather reads the first
//! walk, the second the second. Their difference estimates the error of the indirect light; the result is their mean.

mod write;

use crate::atlas::{self, Atlas};
use crate::base::random::mix;
use crate::base::{Progress, Rgb, Warned, parallel};
use crate::finish::{self, Lightmap};
use crate::gather::{self, Gathered};
use crate::light::{self, Emitters, shoot};
use crate::output::{self, report};
use crate::patches::{PatchGraph, Patches};
use crate::scene::{self, Scene};
use crate::settings::{DirectMode, Quantity, Settings, SplatMode};
use crate::trace::Tracer;
use crate::walk::{self, EmittedLines, Splat, Walk};
use core::f32::consts::FRAC_1_PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// What to bake, and where to.
#[derive(Debug, Clone)]
pub struct Request {
    /// The document.
    pub input: PathBuf,
    /// A `.glb`, a `.gltf`, or a folder.
    pub output: PathBuf,
    /// How.
    pub settings: Settings,
    /// Where to write the report.
    pub report: Option<PathBuf>,
    /// Where to write the depfile.
    pub depfile: Option<PathBuf>,
    /// Further files that were read, for the depfile.
    pub also_read: Vec<PathBuf>,
}

/// Why there is no bake.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The document cannot be used.
    #[error(transparent)]
    Scene(#[from] scene::Error),
    /// There is no atlas.
    #[error(transparent)]
    Atlas(#[from] atlas::Error),
    /// The results cannot be written.
    #[error(transparent)]
    Output(#[from] output::Error),
    /// Somebody asked to stop.
    #[error("interrupted; nothing was written")]
    Interrupted,
}

/// Sees a bake go by.
pub trait Observer: Sync {
    /// A stage begins; `progress` tells how far it is.
    fn stage(&self, name: &'static str, progress: &Arc<Progress>);
    /// It ended after this many seconds.
    fn done(&self, name: &'static str, seconds: f64);
}

/// The outcome: the report, and the lightmap that was written.
#[derive(Debug)]
pub struct Outcome {
    /// What the report file holds.
    pub report: report::Report,
    /// Every file written, with its size [bytes].
    pub files: Vec<(PathBuf, u64)>,
    /// Irradiance that was stored, for those who call the library.
    pub lightmap: Lightmap,
}

/// Light of the front patches as two independent solutions [lx].
struct Solution {
    direct: [Vec<Rgb>; 2],
    indirect: [Vec<Rgb>; 2],
    walks: [Walk; 2],
    /// Power that the light sources put on patches.
    power_in: [f64; 3],
    /// Squared error of the mean of the halves, sum over front patches and channels [lx²]; see `finish::share`.
    squared_error: f64,
    gather_rays: u64,
    shadow_rays: u64,
}

/// Runs stages, keeps their times, asks for interruption.
struct Clock<'a> {
    observer: &'a dyn Observer,
    progress: Arc<Progress>,
    stages: Vec<report::Stage>,
}

impl Clock<'_> {
    fn timed<T>(&mut self, name: &'static str, f: impl FnOnce(&Progress) -> T) -> Result<T, Error> {
        self.progress.start(0);
        self.observer.stage(name, &self.progress);
        let start = Instant::now();
        let value = f(&self.progress);
        let seconds = start.elapsed().as_secs_f64();
        self.observer.done(name, seconds);
        self.stages.push(report::Stage { name: name.to_owned(), seconds });
        if self.progress.cancelled() { Err(Error::Interrupted) } else { Ok(value) }
    }
}

/// Bakes.
///
/// # Errors
/// [`Error`]; then no output was touched.
pub fn bake(request: &Request, observer: &dyn Observer, progress: Arc<Progress>) -> Result<Outcome, Error> {
    let settings = &request.settings;
    let mut clock = Clock { observer, progress, stages: vec![] };
    let loaded = clock.timed("load", |_| load(&request.input, settings))??;
    let (scene, mut warnings) = (loaded.output, loaded.warnings);
    let tracer = clock.timed("trace", |_| Tracer::new(&scene))?;
    let flag = clock.progress.cancel_flag();
    let charted = clock.timed("atlas", |_| atlas::build(&scene, &atlas_settings(settings, flag)))??;
    let atlas = charted.output;
    warnings.extend(charted.warnings);
    let patches = clock.timed("patches", |progress| Patches::new(&tracer, &atlas, progress))?;
    let graph = clock.timed("links", |progress| PatchGraph::new(&patches, &tracer, progress))?;
    let mut solution = solve(&mut clock, settings, &tracer, &patches, &graph)?;
    clock.timed("share", |_| share(settings, &patches, &graph, &mut solution))?;
    let lightmap = clock.timed("finish", |_| lightmap(settings, &patches, &atlas, &solution))?;
    let facts = write::Facts { scene: &scene, atlas: &atlas, patches: &patches, solution: &solution, warnings };
    write::write(request, &facts, lightmap, &mut clock)
}

/// The document, and the environment that the settings name.
fn load(input: &Path, settings: &Settings) -> Result<Warned<Scene>, scene::Error> {
    let how = scene::Settings {
        scene: settings.scene,
        sky: settings.sky(),
        sun_angle: settings.sun_angle.map(f32::to_radians),
        light_radius: settings.light_radius,
    };
    let mut loaded = scene::load(input, &how)?;
    if let Some(path) = &settings.environment {
        let (factor, rotation) = (settings.environment_intensity, settings.environment_rotation.to_radians());
        loaded.output.environment = Some(scene::Environment::load(path, factor, rotation)?);
        loaded.output.document.files_read.push(path.clone());
    }
    Ok(loaded)
}

fn atlas_settings(settings: &Settings, cancel: Arc<std::sync::atomic::AtomicBool>) -> atlas::Settings {
    atlas::Settings {
        texels_per_meter: settings.texels_per_meter,
        page_size: settings.page_size,
        max_pages: settings.max_pages,
        padding: settings.padding,
        uv: settings.atlas_uv(),
        time_limit: None,
        cancel: Some(cancel),
    }
}

/// Lines of the walk for this many patches.
fn lines(settings: &Settings, patches: &Patches) -> u64 {
    settings.lines.unwrap_or((settings.lines_per_texel * patches.front as f64) as u64).max(2)
}

fn solve(
    clock: &mut Clock<'_>,
    settings: &Settings,
    tracer: &Tracer<'_>,
    patches: &Patches,
    graph: &PatchGraph,
) -> Result<Solution, Error> {
    let emitters = Emitters::new(tracer.scene());
    let direct = clock.timed("direct", |progress| {
        let samples = light::Settings { samples: settings.direct_samples, seed: settings.seed };
        match settings.direct {
            DirectMode::Gather => light::direct(tracer, patches, &emitters, &samples, progress),
            DirectMode::Shoot => light::Direct { halves: [0, 1].map(|_| vec![Rgb::ZERO; patches.len()]), rays: 0 },
        }
    })?;
    let (halves, shadow_rays) = (&direct.halves, direct.rays);
    let direct: Vec<Rgb> = parallel::map(patches.len(), |i| (halves[0][i] + halves[1][i]) * 0.5);
    let source = |i: usize| direct[i] * patches.exposed_area(i);
    let mut walks = clock.timed("walk", |progress| {
        [0, 1].map(|half| {
            let seed = mix(settings.seed.wrapping_mul(2).wrapping_add(half));
            let unshot = parallel::map(patches.len(), |i| source(i) * patches.reflectance[i]);
            let sources = shoot::Sources::new(tracer, &emitters, seed);
            let line = |k, n| sources.line(k, n);
            let shot = EmittedLines { flux: sources.flux(), line: &line };
            let emitted = (settings.direct == DirectMode::Shoot).then_some(&shot);
            walk::walk(tracer, patches, graph, unshot, emitted, &walk_settings(settings, patches, half, seed), progress)
        })
    })?;
    if settings.splat == SplatMode::Share && settings.gather > 0 {
        // The last bounce reads few texels near corners, so the walk's noise would show there as blotches.
        clock.timed("smooth", |_| {
            let [a, b] = &mut walks;
            finish::share(patches, graph, [&mut a.indirect, &mut b.indirect]);
        })?;
    }
    let (indirect, gather_rays) = if settings.gather > 0 {
        let radiance = [0, 1].map(|h: usize| radiance(patches, &direct, &walks[h]));
        let radiance = [radiance[0].as_slice(), radiance[1].as_slice()];
        let field = gather::Field { tracer, patches, radiance, seed: settings.seed };
        clock.timed("gather", |progress| gather_with(settings, &field, graph, progress))?
    } else {
        ([0, 1].map(|h: usize| walks[h].indirect[..patches.front].to_vec()), 0)
    };
    let shoots = settings.direct == DirectMode::Shoot;
    let gathered_in = [0, 1, 2].map(|c| parallel::sum(patches.len(), |i| f64::from(source(i)[c])));
    let shot_in =
        |c: usize| walks.iter().map(|w| w.ledger.first().map_or(0.0, |b| b.received[c])).fold(0.0, |a, b| a + b);
    let power_in = if shoots { [0, 1, 2].map(|c| 0.5 * shot_in(c)) } else { gathered_in };
    let direct = [0, 1].map(|h| (0..patches.front).map(|i| halves[h][i] + walks[h].direct[i]).collect());
    Ok(Solution { direct, indirect, walks, power_in, squared_error: 0.0, gather_rays, shadow_rays })
}

fn walk_settings(settings: &Settings, patches: &Patches, half: u64, seed: u64) -> walk::Settings {
    let all = lines(settings, patches);
    walk::Settings {
        splat: match settings.splat {
            SplatMode::Paper => Splat::Paper { alpha: settings.alpha, beta: settings.beta },
            SplatMode::None | SplatMode::Share => Splat::None,
        },
        lines: if half == 0 { all.div_ceil(2) } else { all / 2 },
        // The gather is one bounce more.
        bounces: settings.bounces.map(|n| n.saturating_sub(u32::from(settings.gather > 0))),
        low_discrepancy: settings.splat == SplatMode::Share,
        seed,
    }
}

/// The last bounce, and its rays. With sharing, two thirds of the rays go where the first third left the largest errors.
fn gather_with(
    settings: &Settings,
    field: &gather::Field<'_>,
    graph: &PatchGraph,
    progress: &Progress,
) -> ([Vec<Rgb>; 2], u64) {
    let mut gathered = Gathered::new(field.patches);
    let half = if settings.bounces == Some(0) { 0 } else { settings.gather.div_ceil(2) };
    let first = if settings.splat == SplatMode::Share { half.div_ceil(3) } else { half };
    gathered.add(field, |_| first, progress);
    if half > first {
        let [mut a, mut b] = gathered.halves();
        let error = finish::share(field.patches, graph, [&mut a, &mut b]);
        let rays = gather::second_round(&error.around(field.patches, graph), half - first);
        gathered.add(field, |i| rays[i], progress);
    }
    (gathered.halves(), gathered.rays())
}

/// What each patch sends out by direct light and one walk [cd/m²].
fn radiance(patches: &Patches, direct: &[Rgb], walk: &Walk) -> Vec<Rgb> {
    parallel::map(patches.len(), |i| {
        patches.reflectance[i] * (direct[i] + walk.direct[i] + walk.indirect[i]) * FRAC_1_PI
    })
}

/// Lets indirect light flow between linked texels; shot direct light is as noisy and flows too.
fn share(settings: &Settings, patches: &Patches, graph: &PatchGraph, solution: &mut Solution) {
    let shares = settings.splat == SplatMode::Share;
    let flow = |halves: &mut [Vec<Rgb>; 2], noisy: bool| {
        if !(shares && noisy) {
            return finish::Errors::of_noise(halves);
        }
        let [a, b] = halves;
        finish::share(patches, graph, [a, b])
    };
    let indirect = flow(&mut solution.indirect, true);
    let direct = flow(&mut solution.direct, settings.direct == DirectMode::Shoot);
    solution.squared_error = indirect.sum() + direct.sum();
}

impl Solution {
    /// Irradiance by half `h` of the random numbers at front patch `i` [lx].
    fn half(&self, h: usize, i: usize) -> Rgb {
        self.direct[h][i] + self.indirect[h][i]
    }

    /// Irradiance at front patch `i` [lx].
    fn irradiance(&self, i: usize) -> Rgb {
        (self.half(0, i) + self.half(1, i)) * 0.5
    }
}

fn lightmap(settings: &Settings, patches: &Patches, atlas: &Atlas, solution: &Solution) -> Lightmap {
    let factor = match settings.quantity {
        Quantity::Radiosity => FRAC_1_PI,
        Quantity::Irradiance => 1.0,
    };
    let values = parallel::map(patches.front, |i| solution.irradiance(i));
    let mut lightmap = finish::assemble(patches, atlas.pages, &values, factor);
    for page in &mut lightmap.pages {
        finish::dilate(page, settings.padding.max(1));
    }
    lightmap
}
