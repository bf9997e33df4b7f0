//! The bake from file to files: the only code that names every stage.
//!
//! In: [`Request`]. Out: files on disk and the [`Report`]. All outputs appear together at the end or not at all.
//!
//! `solve` is one pass of the solver, `refine` makes as many of them as `plan` says; `write` puts results into files.

mod bright;
mod clock;
mod dark;
mod directional;
mod groups;
mod halves;
mod html;
mod layers;
mod outputs;
mod plan;
mod power;
mod refine;
mod sides;
mod solve;
mod thin;
mod treated;
mod write;

use crate::atlas::{self, Atlas};
use crate::base::{Progress, Rgb, Warned, Warning, parallel};
use crate::contacts;
use crate::finish::{self, Errors, Lightmap};
use crate::gather;
use crate::light;
use crate::memory::{self, Estimate};
use crate::output::{self, report};
use crate::patches::{Outlook, PatchGraph, Patches};
use crate::scene::{self, Scene};
use crate::seams::Seams;
use crate::settings::{Preset, Quantity, Settings, SplatMode, Target, UvMode};
use crate::trace::Tracer;
use crate::vertices;
use clock::Clock;
use core::f32::consts::FRAC_1_PI;
use groups::Group;
use halves::Halves;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What to bake, and where to.
#[derive(Debug, Clone)]
pub struct Request {
    /// The document.
    pub input: PathBuf,
    /// A `.glb`, a `.gltf`, or a folder.
    pub output: PathBuf,
    /// How.
    pub settings: Settings,
    /// What the settings started from; the HTML report tells the two apart.
    pub preset: Preset,
    /// Where to write the bake as USD.
    pub usd: Option<PathBuf>,
    /// Where to write the report.
    pub report: Option<PathBuf>,
    /// Where to write the report for people.
    pub html: Option<PathBuf>,
    /// Where to write the depfile.
    pub depfile: Option<PathBuf>,
    /// Further files that were read, for the depfile.
    pub also_read: Vec<PathBuf>,
    /// texelwalk's own program, for outputs that are whole even if this process is killed while it writes them; see
    /// `output::atomic`.
    pub placer: Option<PathBuf>,
}

impl Request {
    /// A document and its lightmaps, and nothing else.
    #[must_use]
    pub fn new(input: PathBuf, output: PathBuf, settings: Settings, preset: Preset) -> Self {
        let [usd, report, html, depfile, placer] = [const { None }; 5];
        Self { input, output, settings, preset, usd, report, html, depfile, also_read: vec![], placer }
    }

    /// Every file that was read for a scene.
    fn inputs(&self, scene: &Scene) -> Vec<PathBuf> {
        scene.document.files_read.iter().chain(&self.also_read).cloned().collect()
    }
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
    /// It needs more memory than it may have.
    #[error("{0}")]
    Memory(String),
    /// The results cannot be written.
    #[error(transparent)]
    Output(#[from] output::Error),
    /// There are no pictures for the report.
    #[error(transparent)]
    Html(#[from] crate::html::Error),
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

/// Light of the front patches, shared between neighbours, and how it was found.
#[derive(Debug, Default)]
struct Solution {
    halves: Halves,
    /// Irradiance by each group, if there are several; `halves` are their sum [lx].
    groups: Vec<Vec<Rgb>>,
    /// Of what shadow rays found and of the rest; see `finish::share`.
    errors: [Errors; 2],
    power: report::Walk,
    gather_rays: u64,
    shadow_rays: u64,
    refinement: report::Refinement,
    warnings: Vec<Warning>,
}

/// Bakes.
///
/// # Errors
/// [`Error`]; then no output was touched.
pub fn bake(request: &Request, observer: &dyn Observer, progress: Arc<Progress>) -> Result<Outcome, Error> {
    let settings = &request.settings;
    outputs::check_early(request)?;
    let mut clock = Clock::new(observer, progress);
    let loaded = clock.timed("load", |_| load(&request.input, settings))??;
    let (mut scene, mut warnings) = (loaded.output, loaded.warnings);
    if settings.cut_contacts {
        scene = clock.timed("contacts", |_| contacts::cut(scene, &contacts_settings(settings)))?;
    }
    let tracer = clock.timed("trace", |_| Tracer::new(&scene))?;
    let how = atlas::Settings { cancel: Some(clock.progress.cancel_flag()), ..settings.atlas() };
    let charted = clock.timed("atlas", |_| atlas::build(&tracer, &how))??;
    let atlas = charted.output;
    warnings.extend(charted.warnings);
    let lights = light::moved(&tracer);
    let unsaid = scene.missing_materials().into_iter().chain(scene.metals_by_default());
    let unsaid = unsaid.chain(scene.nothing_lit()).chain(scene.coarse_coordinates(atlas.texels_per_meter));
    warnings.extend(unsaid.chain(light::lost(&tracer, &lights)));
    admit(&scene, &atlas, settings)?;
    let groups = groups::groups(&scene, &lights, settings.light_groups);
    let group_names: Vec<&str> = groups.iter().map(|group| group.name.as_str()).collect();
    let group_names = if settings.light_groups { &group_names[..] } else { &[] };
    outputs::check(request, &request.inputs(&scene), atlas.pages, group_names)?;
    let mut patches = clock.timed("patches", |progress| Patches::new(&tracer, &atlas, progress))?;
    let tracer = tracer.with_sides(patches.sides_of_walls());
    let turned = sides::turn(&tracer, &lights, &atlas, &mut patches, settings, &mut clock)?;
    warnings.extend(turned.warnings);
    let (graph, ways, outlook) =
        clock.timed("links", |progress| links(&tracer, &mut patches, turned.graph, settings, progress))?;
    let facts = write::Facts { request, tracer: &tracer, scene: &scene, atlas: &atlas, patches: &patches };
    let seams = clock.timed("seams", |progress| Seams::new(&tracer, &atlas, &patches, progress))?;
    let openness = if settings.wants_openness() {
        let distance = settings.ao_distance.unwrap_or(Settings::AO_DISTANCE);
        clock.timed("openness", |progress| gather::openness(&tracer, &patches, distance, settings.seed, progress))?
    } else {
        vec![]
    };
    let setup = solve::Setup {
        settings,
        tracer: &tracer,
        patches: &patches,
        graph: &graph,
        ways,
        outlook: outlook.as_ref(),
        openness: &openness,
    };
    let finished = |solution: &Solution, progress: &Progress| {
        let mut results = results(&setup, &groups, &atlas, &seams, solution, progress);
        if request.html.is_some() {
            results.noise = layers::relative_error(&setup, solution);
        }
        results
    };
    let fitted = |results: &mut write::Results, progress: &Progress| {
        let how = vertices::Settings { subdivide: settings.subdivide };
        results.vertices = Some(vertices::fit(&scene, &atlas, &patches, &results.lightmap, &how, progress));
    };
    let to_vertices = settings.target == Target::Vertex;
    let rehearse = |solution: &Solution| {
        let mut results = finished(solution, &Progress::default());
        if to_vertices {
            fitted(&mut results, &Progress::default());
        }
        facts.pictures(&results)?;
        facts.encode(&results).map(|_| ())
    };
    let mut solution = refine::refine(&setup, &groups, &mut clock, &rehearse)?;
    warnings.append(&mut solution.warnings);
    let light = solution.halves.irradiance();
    warnings.extend(dark::warning(&scene, &light));
    warnings.extend(dark::undefined(&light));
    if !to_vertices {
        warnings.extend(thin::warnings(&tracer, &atlas, &patches, &light, settings.cut_contacts));
    }
    let mut results = clock.timed("finish", |progress| finished(&solution, progress))?;
    if to_vertices {
        clock.timed("vertices", |progress| fitted(&mut results, progress))?;
    } else {
        warnings.extend(bright::warning(&results, settings.quantity));
    }
    facts.write(&solution, results, warnings, &mut clock)
}

/// What light of the patches flows over, that of the front ones where it is worth holding, and what they look at.
fn links(
    tracer: &Tracer<'_>,
    patches: &mut Patches,
    known: Option<PatchGraph>,
    settings: &Settings,
    progress: &Progress,
) -> (PatchGraph, Option<finish::Ways>, Option<Outlook>) {
    patches.find_overlaid(tracer, progress);
    let graph = known.unwrap_or_else(|| PatchGraph::new(patches, tracer, progress));
    let ways = solve::held_ways(settings, patches, &graph);
    let outlook = (settings.splat == SplatMode::Share).then(|| Outlook::find(tracer, patches, progress));
    (graph, ways, outlook)
}

/// The document, and the environment that the settings name.
fn load(input: &Path, settings: &Settings) -> Result<Warned<Scene>, scene::Error> {
    let how = scene::Settings {
        scene: settings.scene,
        sky: settings.sky(),
        sun_angle: settings.sun_angle.map(f32::to_radians),
        light_radius: settings.light_radius,
        rules: settings.rules.clone(),
        instances: settings.scene_instances(),
        share_from: None,
        variant: settings.variant.clone(),
        normal_maps: settings.normal_maps,
        albedo_density: Some(settings.texels_per_meter),
        memory_limit: memory::limit(settings),
    };
    let mut loaded = scene::load(input, &how)?;
    loaded.output.own_colors()?;
    loaded.warnings.extend(treated::warning(&loaded.output, settings));
    if let Some(path) = &settings.environment {
        let (factor, rotation) = (settings.environment_intensity, settings.environment_rotation.to_radians());
        let map = scene::Environment::load(path, factor, rotation)?;
        loaded.output.environment = Some(map.output);
        loaded.warnings.extend(map.warnings);
        loaded.output.document.files_read.push(path.clone());
    }
    Ok(loaded)
}

/// Refuses what needs more memory than it may have.
fn admit(scene: &Scene, atlas: &Atlas, settings: &Settings) -> Result<(), Error> {
    let refusal = Estimate::new(scene, atlas, settings).refusal(memory::limit(settings), scene);
    refusal.map_or(Ok(()), |why| Err(Error::Memory(why)))
}

fn contacts_settings(settings: &Settings) -> contacts::Settings {
    let keep_uv = settings.uv == UvMode::Keep;
    contacts::Settings { texels_per_meter: settings.texels_per_meter, keep_uv }
}

impl Solution {
    /// Root mean square of the error over the mean, all channels and covered texels alike: noise of direct light, walk
    /// and gather, and bias of sharing.
    fn estimated_nrmse(&self, patches: &Patches) -> Option<f64> {
        self.nrmse_of(patches, f32::INFINITY)
    }

    /// The same without the hundredth of the texels that is brightest: few of them can outweigh all others.
    fn estimated_nrmse_99(&self, patches: &Patches) -> Option<f64> {
        let mut light = parallel::map_light(patches.front, |i| self.halves.at(i).element_sum());
        let k = (light.len() * 99).div_ceil(100).checked_sub(1)?;
        let brightest = *light.select_nth_unstable_by(k, f32::total_cmp).1;
        self.nrmse_of(patches, brightest)
    }

    /// Of the texels that are no brighter than this, sum of the channels [lx].
    fn nrmse_of(&self, patches: &Patches, most: f32) -> Option<f64> {
        let light = |i: usize| self.halves.at(i).element_sum();
        let counts = |i: usize| light(i) <= most;
        let sum =
            |of: &(dyn Fn(usize) -> f64 + Sync)| parallel::sum(patches.front, |i| if counts(i) { of(i) } else { 0.0 });
        let (total, n) = (sum(&|i| f64::from(light(i))), 3.0 * sum(&|_| 1.0));
        let error: f64 = self.errors.iter().map(|errors| errors.sum_of(counts)).fold(0.0, |a, b| a + b);
        (total > 0.0).then(|| (error / n).sqrt() / (total / n))
    }
}

/// Puts light on pages: the sum of all groups, each group, and what else is asked for.
fn results(
    setup: &solve::Setup<'_>,
    groups: &[Group],
    atlas: &Atlas,
    seams: &Seams,
    solution: &Solution,
    progress: &Progress,
) -> write::Results {
    let settings = setup.settings;
    let factor = stored(settings.quantity);
    let whole = solution.halves.irradiance();
    let unstitched = on_pages(setup, atlas.pages, &whole, factor);
    let step_before = seams.steps(setup.patches, &unstitched);
    let stitcher = seams.stitcher(setup.patches, &unstitched, progress);
    let stitched = |mut lightmap: Lightmap| {
        if let Some(stitcher) = &stitcher {
            stitcher.stitch(&mut lightmap, progress);
            finish::refill(setup.patches, &mut lightmap, settings.mips, settings.padding, stitcher.texels());
        }
        lightmap
    };
    let finish = |values: &[Rgb]| stitched(on_pages(setup, atlas.pages, values, factor));
    let finished: Vec<Lightmap> = solution.groups.iter().map(|values| lit(finish(values))).collect();
    let lightmap = if finished.is_empty() { lit(stitched(unstitched)) } else { sum(&finished) };
    // A single group is the whole; it gets its file all the same where groups are asked for.
    let maps = if finished.is_empty() { vec![lightmap.clone(); usize::from(settings.light_groups)] } else { finished };
    let vectors = solution.halves.light_vectors();
    write::Results {
        directional: directional::textures(setup, &vectors, &lightmap, factor, stitcher.as_ref()),
        groups: groups.iter().zip(maps).map(|(group, map)| (group.name.clone(), map)).collect(),
        aovs: layers::layers(setup, atlas.pages, solution, factor, &finish),
        steps: [step_before, seams.steps(setup.patches, &lightmap)],
        lightmap,
        vertices: None,
        noise: vec![],
    }
}

/// The light of all lightmaps, which cover the same texels. None of them gives no pages.
fn sum(lightmaps: &[Lightmap]) -> Lightmap {
    let Some((first, others)) = lightmaps.split_first() else { return Lightmap::default() };
    let mut sum = first.clone();
    for page in others.iter().flat_map(|lightmap| lightmap.pages.iter().enumerate()) {
        for (to, from) in sum.pages[page.0].pixels.iter_mut().zip(&page.1.pixels) {
            (0..3).for_each(|c| to[c] += from[c]);
        }
    }
    sum
}

/// Light without what is less than none: flow that takes many steps at once can leave a channel just below it beside a
/// much brighter texel.
fn lit(mut lightmap: Lightmap) -> Lightmap {
    for pixel in lightmap.pages.iter_mut().flat_map(|page| &mut page.pixels) {
        (0..3).for_each(|c| pixel[c] = pixel[c].max(0.0));
    }
    lightmap
}

/// What is stored for an irradiance of 1 lx.
fn stored(quantity: Quantity) -> f32 {
    match quantity {
        Quantity::Radiosity => FRAC_1_PI,
        Quantity::Irradiance => 1.0,
    }
}

/// Values of the front patches, times `factor`, on pages with filled borders.
fn on_pages(setup: &solve::Setup<'_>, pages: u32, values: &[Rgb], factor: f32) -> Lightmap {
    let mut lightmap = finish::assemble(setup.patches, pages, values, factor);
    finish::fill(setup.patches, &mut lightmap, setup.settings.mips, setup.settings.padding);
    finish::fill_hidden(setup.patches, &mut lightmap, &[]);
    lightmap
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 198 texels of 10 lx, off by 0.1, and two of 1,000 lx, off by 600.
    fn a_lamp_among_walls() -> (Patches, Solution) {
        let light: Vec<Rgb> = (0..200).map(|i| Rgb::splat(if i < 2 { 1000.0 } else { 10.0 })).collect();
        let off = |i: usize| if i < 2 { 600.0f32 } else { 0.1 };
        let errors = Errors { noise: (0..200).map(|i| 3.0 * off(i) * off(i)).collect(), bias: vec![0.0; 200] };
        let dark = [vec![Rgb::ZERO; 200], vec![Rgb::ZERO; 200]];
        let halves = Halves { direct: [light.clone(), light], indirect: dark, ..Halves::default() };
        let mut patches = Patches::default();
        patches.front = 200;
        (patches, Solution { halves, errors: [errors, Errors::default()], ..Solution::default() })
    }

    #[test]
    fn few_bright_texels_decide_one_figure_and_not_the_other() {
        let (patches, solution) = a_lamp_among_walls();
        assert!((solution.estimated_nrmse(&patches).unwrap() - 60.0 / 19.9).abs() < 1e-3);
        assert!((solution.estimated_nrmse_99(&patches).unwrap() - 0.01).abs() < 1e-6);
        let nothing = Solution::default();
        assert_eq!(
            (nothing.estimated_nrmse(&Patches::default()), nothing.estimated_nrmse_99(&Patches::default())),
            (None, None)
        );
    }
}
