//! The solver: direct light, walk and gather, in passes that add to each other.
//!
//! In: [`Setup`] and a [`Budget`] per pass. Out: irradiance of the front patches as two halves that share no random
//! number, not yet shared with neighbours. The first half of the gather reads the first half of the walks, the second
//! the second; their difference estimates the error of the indirect light, and the result is their mean.
//!
//! Rays of the gather that leave the scene see the sky. What of it they find is taken from what shadow rays found (see
//! `light::Direct::gathered`); the walk starts with all that shadow rays found, because it comes first.
//!
//! What patches send on of which the walk knows too little is looked for anew (`gather::settle`).
//!
//! What very bright patches send on is left out of what rays of the gather read, and sampled like lamps (`light::glare`).
//!
//! Every pass has shadow rays and lines of its own, which are averaged with those before, weighted by their number. The
//! gather goes on with its low-discrepancy points, reads the averages, and deals rays by the error of all it has.
//! Passes with gathers of their own had an eighth more error for the same rays (two rooms, 0.25 and 0.4 of
//! `production`).

use super::clock::{Clock, Stop};
use super::halves::Halves;
use super::power;
use crate::base::random::mix;
use crate::base::{LightVector, Progress, Rgb, Stream, color, parallel};
use crate::finish::{self, Along, Errors, Network, Ways};
use crate::gather::{self, Gathered, Openness};
use crate::light::glare::{Glare, Glared, Sent};
use crate::light::{self, Emitters, Openings, shoot};
use crate::output::report;
use crate::patches::{Dimness, Outlook, PatchGraph, Patches, Shine, Tilts};
use crate::settings::{DirectMode, Settings, SplatMode};
use crate::trace::Tracer;
use crate::walk::{self, EmittedLines, Splat, Walk};
use core::f32::consts::{FRAC_1_PI, PI};
use core::ops::{Add, Mul, Sub};
use core::sync::atomic::AtomicU64;
use glam::Vec2;
use std::sync::Arc;

/// Front patches up to which what light flows over is held, and direct and indirect light flow side by side: of more, it
/// would take too much memory.
const FEW: usize = 1 << 17;
/// Rays of the gather for each sample of glare.
const GLARE_RAYS: u32 = 2;
/// Error of the walk, over the light, from which on what white patches send on is looked for anew. With 0.3 and 0.5, a
/// refrigerator had 0.98 and 0.96 of the light in the mean: what seems sure is mostly what has got too little.
const UNSURE: f32 = 0.15;
/// Reflectance of patches that count as white. Light of others is gone before the lines of the walk are.
const WHITE: f32 = 0.8;

/// What all passes have in common.
pub(super) struct Setup<'a> {
    pub(super) settings: &'a Settings,
    pub(super) tracer: &'a Tracer<'a>,
    pub(super) patches: &'a Patches,
    pub(super) graph: &'a PatchGraph,
    /// What light of the front patches flows over; `None` where it is made anew each time, so as not to be held.
    pub(super) ways: Option<Ways>,
    /// What patches look at; `None` where effort is to go by nothing but light.
    pub(super) outlook: Option<&'a Outlook>,
    /// What is open around the front patches, if a layer needs it.
    pub(super) openness: &'a [Openness],
}

/// What light flows over, where it is worth holding.
pub(super) fn held_ways(settings: &Settings, patches: &Patches, graph: &PatchGraph) -> Option<Ways> {
    let holds = settings.splat == SplatMode::Share && patches.front <= FEW;
    holds.then(|| Ways::new(patches, graph, patches.front))
}

impl Setup<'_> {
    /// How bright it is around each patch, over the mean of the light.
    fn dimness(&self, light: &[f32]) -> Dimness<'_> {
        self.outlook.map_or_else(Dimness::default, |outlook| outlook.dimness(self.patches, light))
    }

    /// What light of the first `n` patches flows over.
    pub(super) fn ways(&self, n: usize) -> Ways {
        let held = self.ways.as_ref().filter(|ways| ways.patches() == n);
        held.map_or_else(|| Ways::new(self.patches, self.graph, n), Ways::clone)
    }

    /// Of that around the front patches, the links.
    pub(super) fn network(&self) -> Arc<Network> {
        self.network_of(self.patches.front)
    }

    /// The links of the first `n` patches.
    fn network_of(&self, n: usize) -> Arc<Network> {
        let held = self.ways.as_ref().filter(|ways| ways.patches() == n);
        held.map_or_else(|| Arc::new(Network::new(self.patches, self.graph, n)), Ways::network)
    }
}

/// What one pass may spend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Budget {
    /// Shadow rays per texel and kind of light.
    pub(super) direct_samples: u32,
    /// Lines of the walk.
    pub(super) lines: u64,
    /// Final-gather rays per texel.
    pub(super) gather: u32,
    /// Number of the pass.
    pub(super) pass: u64,
}

/// What the passes so far have found, on all patches.
#[derive(Debug)]
pub(super) struct Solver<'a> {
    emitters: &'a Emitters,
    /// Chooses the random numbers.
    seed: u64,
    /// Irradiance by shadow rays [lx].
    direct: [Vec<Rgb>; 2],
    /// Where light comes in, by the first pass.
    openings: Option<Openings>,
    /// Part of `direct` that the gather finds, too [lx].
    sky: [Vec<Rgb>; 2],
    /// How the rest of it changes over the texel [lx per texel]; empty without shadow rays.
    slopes: [Vec<Vec2>; 2],
    /// Light vectors of the rest [lx]; empty if they are not wanted.
    vectors: Vec<LightVector>,
    /// Irradiance by the walks, straight from the emitters and after reflections [lx].
    walked: [[Vec<Rgb>; 2]; 2],
    /// Patches that are looked at like lamps, by what the first pass found; `None` before its gather.
    glare: Option<Glare>,
    /// Irradiance of the front patches by them.
    glared: Glared,
    gathered: Gathered,
    /// The place of each patch, by the first pass.
    places: Vec<u32>,
    /// About what each patch would still have got after the last walks [lx]; empty where that is negligible.
    left: Vec<f32>,
    /// Samples and lines so far.
    spent: [f64; 2],
    pub(super) power: report::Walk,
    pub(super) shadow_rays: u64,
}

/// What the patches send on.
struct SentOn {
    /// By half [cd/m²].
    radiance: [Vec<Rgb>; 2],
    /// What falls on them [lx], mean of the channels.
    light: Vec<f32>,
    /// How that changes over each texel.
    tilts: Tilts,
    /// Where the walk knows too little.
    unsure: Vec<u32>,
}

impl Budget {
    /// The settings' own budget times `factor`, for pass number `pass`.
    pub(super) fn new(settings: &Settings, patches: &Patches, factor: f64, pass: u64) -> Self {
        let times = |n: u32, least: u32| ((f64::from(n) * factor).round() as u32).max(least);
        Self {
            direct_samples: times(settings.direct_samples, 1),
            lines: ((lines(settings, patches) as f64 * factor) as u64).max(2),
            gather: if settings.gather == 0 { 0 } else { times(settings.gather, 2.min(settings.gather)) },
            pass,
        }
    }

    /// Largest factor that a pass can take: above it, points of low-discrepancy sequences would run out.
    pub(super) fn most(settings: &Settings, patches: &Patches) -> f64 {
        const MOST_DIRECT: f64 = 4096.0;
        const MOST_LINES: f64 = (1u64 << 31) as f64;
        let by_direct = MOST_DIRECT / f64::from(settings.direct_samples);
        let by_lines = MOST_LINES / lines(settings, patches) as f64;
        by_direct.min(by_lines).max(1.0)
    }

    /// Largest sum of factors: the gather has points for so many rays of a texel, some of which get eight times the
    /// mean.
    pub(super) fn most_of_all(settings: &Settings) -> f64 {
        const MOST_GATHER: f64 = 16_384.0;
        (MOST_GATHER / f64::from(settings.gather.max(1))).max(1.0)
    }
}

/// What white patches send on is looked for anew where that helps. Not with a limit of bounces: what is settled is of all
/// of them.
fn settles(setup: &Setup<'_>) -> bool {
    let Setup { settings, patches, .. } = *setup;
    settings.splat == SplatMode::Share && settings.bounces.is_none() && (0..patches.len()).any(|i| is_white(patches, i))
}

/// A patch that takes part in light, lets none pass, and reflects nearly all.
fn is_white(patches: &Patches, i: usize) -> bool {
    let albedo = patches.albedo(i);
    patches.exposed[i] > 0.0 && albedo == patches.reflectance[i] && albedo.max_element() >= WHITE
}

/// Lines of the walk for this many patches.
fn lines(settings: &Settings, patches: &Patches) -> u64 {
    settings.lines.unwrap_or((settings.lines_per_texel * patches.front as f64) as u64).max(2)
}

impl<'a> Solver<'a> {
    /// Darkness, before the first pass.
    pub(super) fn new(setup: &Setup<'_>, emitters: &'a Emitters, seed: u64) -> Self {
        let patches = setup.patches;
        let black = || [0, 1].map(|_| parallel::map_light(patches.len(), |_| Rgb::ZERO));
        Self {
            emitters,
            seed,
            direct: black(),
            openings: None,
            sky: black(),
            slopes: [vec![], vec![]],
            vectors: vec![],
            walked: [black(), black()],
            glare: None,
            glared: Glared::default(),
            gathered: if setup.settings.is_directional() {
                Gathered::directional(patches)
            } else {
                Gathered::new(patches)
            },
            left: vec![],
            spent: [0.0; 2],
            power: report::Walk::default(),
            places: vec![],
            shadow_rays: 0,
        }
    }

    /// Solves once more. After an `Err`, what was found so far is worth nothing.
    pub(super) fn pass(&mut self, setup: &Setup<'_>, budget: &Budget, clock: &mut Clock<'_>) -> Result<(), Stop> {
        let Setup { settings, tracer, patches, graph, .. } = *setup;
        let (emitters, seed) = (self.emitters, self.seed);
        let pass_seed = if budget.pass == 0 { seed } else { mix(seed ^ mix(budget.pass)) };
        if settings.direct == DirectMode::Gather {
            clock.timed("direct", |progress| {
                let (samples, gather_rays) = (budget.direct_samples, gather_rays(settings));
                let how =
                    light::Settings { samples, gather_rays, seed: pass_seed, directional: settings.is_directional() };
                let find = || Openings::find(tracer, patches, emitters, seed, progress);
                let openings = self.openings.get_or_insert_with(find);
                let found = light::direct(tracer, patches, emitters, (openings, setup.outlook), &how, progress);
                self.add_direct(found, budget);
            })?;
        }
        let direct = mean(&self.direct);
        // What casts no light reflects none, and passes on what it gets; of two surfaces in one place one sends light on.
        let sends = |i: usize| patches.is_met(i) && patches.casts(tracer.scene(), i);
        let source = |i: usize| if sends(i) { direct[i] * patches.exposed_area(i) } else { Rgb::ZERO };
        let found = clock.timed("walk", |progress| {
            if self.places.is_empty() && settings.direct == DirectMode::Gather {
                self.places = walk::places(tracer, patches, graph, progress);
            }
            let tilts = (settings.direct == DirectMode::Gather).then(|| self.direct_tilts(setup, &direct));
            [0, 1].map(|half| {
                let seed = mix(pass_seed.wrapping_mul(2).wrapping_add(half));
                let unshot = parallel::map(patches.len(), |i| patches.scattered(i, source));
                let sources = shoot::Sources::new(tracer, emitters, seed);
                let line = |k, n| sources.line(k, n);
                let shot = EmittedLines { flux: sources.flux(), line: &line };
                let emitted = (settings.direct == DirectMode::Shoot).then_some(&shot);
                let how = walk_settings(settings, budget, half, seed);
                let start = walk::Start {
                    unshot,
                    tilts: tilts.as_ref(),
                    places: &self.places,
                    outlook: setup.outlook,
                    emitted,
                };
                walk::walk(tracer, patches, graph, start, &how, progress)
            })
        })?;
        let power_in = [0, 1, 2].map(|c| parallel::sum(patches.len(), |i| f64::from(source(i)[c])));
        self.add_walks(found, (settings.direct == DirectMode::Gather).then_some(power_in), budget);
        if settings.gather > 0 {
            let mut sent_on = self.radiance(setup, &direct, clock)?;
            let rays = gather_rays(settings);
            let openings = self.openings.take().unwrap_or_default();
            let sky = |patch, normal, direction| {
                emitters.gathered_sky(tracer.scene(), (&openings, patch), normal, direction, rays)
            };
            let sky: Option<gather::Sky<'_>> = if rays > 0.0 && emitters.has_sky() { Some(&sky) } else { None };
            self.settle(setup, &mut sent_on, &direct, sky, pass_seed, clock)?;
            let SentOn { radiance, light, tilts, .. } = sent_on;
            let radiance = [radiance[0].as_slice(), radiance[1].as_slice()];
            let sent = Sent { tracer, patches, radiance, tilts: &tilts, seed };
            let glare = self.look_for_glare(setup, budget, &sent, &light, clock)?;
            let viewers = glare.viewers(&sent, emitters, GLARE_RAYS as f32);
            let left_out = |front| viewers.left_out(front);
            let left_out: Option<&(dyn Fn(usize) -> _ + Sync)> = if glare.is_empty() { None } else { Some(&left_out) };
            let probe = light::Probe::new(tracer, patches, emitters);
            let look = |patch, point, random: &mut Stream| probe.at(patch, point, random);
            let anew = gather::Anew { look: &look, glared: &self.glared.halves(), rays: AtomicU64::new(0) };
            // A ray more is a bounce more. What lines of the lights brought is no light that a look at them finds.
            let is_known = settings.bounces.is_some() || settings.direct == DirectMode::Shoot;
            let looks = (!is_known).then_some(&anew);
            let field = gather::Field { tracer, patches, radiance, left_out, tilts: &tilts, sky, anew: looks, seed };
            clock.timed("gather", |progress| self.gather(setup, budget, &field, &light, progress))?;
            self.shadow_rays += anew.rays.into_inner();
            (self.glare, self.openings) = (Some(glare), Some(openings));
        }
        Ok(())
    }

    fn add_direct(&mut self, found: light::Direct, budget: &Budget) {
        let share = grow(&mut self.spent[0], f64::from(budget.direct_samples));
        let (all, new) = (self.direct.iter_mut().chain(&mut self.sky), found.halves.into_iter().chain(found.gathered));
        all.zip(new).for_each(|(all, new)| merge(all, new, share));
        self.slopes.iter_mut().zip(found.slopes).for_each(|(all, new)| merge(all, new, share));
        merge(&mut self.vectors, found.vectors, share);
        self.shadow_rays += found.rays;
    }

    fn add_walks(&mut self, found: [Walk; 2], power_in: Option<[f64; 3]>, budget: &Budget) {
        let share = grow(&mut self.spent[1], budget.lines as f64);
        self.power = power::mean(&self.power, &power::of(&found, power_in), f64::from(share));
        let left = |i: usize| found.iter().map(|walk| walk.left.get(i).copied().unwrap_or(0.0)).sum::<f32>() * 0.5;
        let late = found.iter().map(|walk| walk.left.len()).max().unwrap_or(0);
        self.left = parallel::map_light(late, left);
        let [direct, indirect] = &mut self.walked;
        for (half, walk) in found.into_iter().enumerate() {
            merge(&mut direct[half], walk.direct, share);
            merge(&mut indirect[half], walk.indirect, share);
        }
    }

    /// How direct light changes over the texels.
    fn direct_tilts(&self, setup: &Setup<'_>, direct: &[Rgb]) -> Tilts {
        let sky = mean(&self.sky);
        let all = parallel::map(direct.len(), |i| color::mean(direct[i]));
        let known = parallel::map(direct.len(), |i| color::mean(direct[i] - sky[i]));
        self.tilts(setup, &all, &known)
    }

    fn tilts(&self, setup: &Setup<'_>, all: &[f32], direct: &[f32]) -> Tilts {
        let [a, b] = &self.slopes;
        Tilts::new(setup.patches, setup.graph, &Shine { all, direct, slopes: [a, b] })
    }

    /// What the patches send on by direct light and each half of the walks.
    fn radiance(&self, setup: &Setup<'_>, direct: &[Rgb], clock: &mut Clock<'_>) -> Result<SentOn, Stop> {
        let patches = setup.patches;
        let [straight, reflected] = &self.walked;
        // The sky's light is as noisy: few shadow rays look for what the gather finds.
        let sky = mean(&self.sky);
        let mut smooth = [0, 1].map(|h: usize| parallel::map(patches.len(), |i| reflected[h][i] + self.sky[h][i]));
        let mut around = vec![];
        if setup.settings.splat == SplatMode::Share {
            // The last bounce reads few texels near corners, so the walk's noise would show there as blotches.
            clock.timed("smooth", |_| {
                let [a, b] = &mut smooth;
                let errors = finish::share(patches, setup.ways(patches.len()), [a, b], Along::default());
                if settles(setup) {
                    around = errors.around(&setup.network_of(patches.len()));
                }
            })?;
        }
        let straight = |h: usize, i: usize| direct[i] - sky[i] + straight[h][i];
        let known = parallel::map(patches.len(), |i| color::mean(straight(0, i) + straight(1, i)) * 0.5);
        let all = parallel::map(patches.len(), |i| known[i] + color::mean(smooth[0][i] + smooth[1][i]) * 0.5);
        let radiance = |h: usize| {
            parallel::map(patches.len(), |i| patches.scattered(i, |k| straight(h, k) + smooth[h][k]) * FRAC_1_PI)
        };
        let tilts = self.tilts(setup, &all, &known);
        let unsure = self.unsure(setup, &around, &all);
        Ok(SentOn { radiance: [radiance(0), radiance(1)], light: all, tilts, unsure })
    }

    /// White patches, ascending, of which the walk knows too little by the squared errors `around` them, or because lines
    /// were used up before all of `light` had come.
    fn unsure(&self, setup: &Setup<'_>, around: &[f32], light: &[f32]) -> Vec<u32> {
        let patches = setup.patches;
        if around.is_empty() {
            return vec![];
        }
        let is_unsure = |i: usize| {
            let noisy = around[i] > 3.0 * (UNSURE * light[i]).powi(2);
            is_white(patches, i) && (noisy || self.left.get(i).is_some_and(|left| *left > UNSURE * light[i]))
        };
        (0..patches.len()).filter(|&i| is_unsure(i)).map(|i| i as u32).collect()
    }

    /// Finds anew what unsure patches send on.
    fn settle(
        &mut self,
        setup: &Setup<'_>,
        sent_on: &mut SentOn,
        direct: &[Rgb],
        sky: Option<gather::Sky<'_>>,
        seed: u64,
        clock: &mut Clock<'_>,
    ) -> Result<(), Stop> {
        let Setup { tracer, patches, .. } = *setup;
        let SentOn { radiance, light, tilts, unsure } = sent_on;
        if unsure.is_empty() {
            return Ok(());
        }
        let ([a, b], walked) = (&self.sky, &self.walked[0]);
        let straight = |half: usize, i: usize| direct[i] - (a[i] + b[i]) * 0.5 + walked[half][i];
        let settled = clock.timed("settle", |progress| {
            let radiance = [radiance[0].as_slice(), radiance[1].as_slice()];
            let field = gather::Field { tracer, patches, radiance, left_out: None, tilts, sky, anew: None, seed };
            [0, 1].map(|half| {
                let straight = |i: usize| straight(half, i);
                let may_join = |i: usize| is_white(patches, i);
                let unsure = gather::Unsure { patches: unsure, may_join: &may_join, straight: &straight };
                gather::settle(&field, half, &unsure, progress)
            })
        })?;
        for (radiance, settled) in radiance.iter_mut().zip(&settled) {
            settled.patches.iter().zip(&settled.radiance).for_each(|(&i, sent)| radiance[i as usize] = *sent);
            self.shadow_rays += settled.rays;
        }
        // Where the walk's light ended steeply, slopes of it would show as dark lines: a refrigerator by `preview` had 2.3 %
        // of stated error instead of 1.1.
        for &i in settled.iter().flat_map(|settled| &settled.patches) {
            let i = i as usize;
            let sent = color::mean(radiance[0][i] + radiance[1][i]) * 0.5;
            light[i] = sent * PI / color::mean(patches.reflectance[i]);
        }
        let straight = parallel::map(patches.len(), |i| color::mean(straight(0, i) + straight(1, i)) * 0.5);
        *tilts = self.tilts(setup, light, &straight);
        Ok(())
    }

    /// Light of patches that are as bright as lamps; which they are stays as the first pass found it, so that all passes
    /// leave out the same.
    fn look_for_glare(
        &mut self,
        setup: &Setup<'_>,
        budget: &Budget,
        sent: &Sent<'_>,
        light: &[f32],
        clock: &mut Clock<'_>,
    ) -> Result<Glare, Stop> {
        let glare = match self.glare.take() {
            Some(glare) => glare,
            None if setup.settings.bounces == Some(0) => Glare::default(),
            None => {
                let [a, b] = sent.radiance;
                let both = parallel::map(a.len(), |i| (a[i] + b[i]) * 0.5);
                Glare::new(setup.tracer, setup.patches, &both, light)
            }
        };
        if !glare.is_empty() {
            clock.timed("glare", |progress| self.sample(&glare, setup, budget, sent, progress))?;
        }
        Ok(glare)
    }

    /// Light of such patches by samples: as with rays of the gather, two thirds go where the errors are largest, which are
    /// few texels with a view into a lampshade.
    fn sample(&mut self, glare: &Glare, setup: &Setup<'_>, budget: &Budget, sent: &Sent<'_>, progress: &Progress) {
        let all = budget.gather.div_ceil(2 * GLARE_RAYS);
        let first = first_round(setup.settings, all);
        let sampler = glare.sampler(sent, self.emitters, GLARE_RAYS as f32);
        let shot = self.glared.rays;
        let glared = &mut self.glared;
        sampler.add(glared, |_| first, progress);
        let viewers = glared.viewers();
        if all > first && viewers > 0 && !progress.cancelled() {
            let error = Errors::of_noise(&glared.halves());
            let mean = (all - first) as f32 * viewers as f32 / setup.patches.front as f32;
            let samples = gather::second_round(&error.around(&setup.network()), &Dimness::default(), mean);
            sampler.add(glared, |i| samples[i], progress);
        }
        self.shadow_rays += glared.rays - shot;
    }

    /// The last bounce. With sharing, two thirds of the rays go where the errors are largest after the first third.
    fn gather(
        &mut self,
        setup: &Setup<'_>,
        budget: &Budget,
        field: &gather::Field<'_>,
        light: &[f32],
        progress: &Progress,
    ) {
        let settings = setup.settings;
        let half = if settings.bounces == Some(0) { 0 } else { budget.gather.div_ceil(2) };
        let first = first_round(settings, half);
        self.gathered.add(field, |_| first, progress);
        if half > first && !progress.cancelled() {
            let [mut a, mut b] = self.gathered.halves();
            let error = finish::share(field.patches, setup.ways(a.len()), [&mut a, &mut b], Along::default());
            let rays =
                gather::second_round(&error.around(&setup.network()), &setup.dimness(light), (half - first) as f32);
            self.gathered.add(field, |i| rays[i], progress);
        }
    }

    /// Rays of the gather.
    pub(super) fn gather_rays(&self) -> u64 {
        self.gathered.rays()
    }

    /// Irradiance of all patches without the gather [lx].
    pub(super) fn roughly(&self) -> Vec<Rgb> {
        let [straight, reflected] = &self.walked;
        let half = |h: usize, i: usize| self.direct[h][i] + straight[h][i] + reflected[h][i];
        parallel::map(self.direct[0].len(), |i| (half(0, i) + half(1, i)) * 0.5)
    }

    /// What was found for the front patches.
    pub(super) fn halves(&self, setup: &Setup<'_>) -> Halves {
        let front = setup.patches.front;
        let [straight, reflected] = &self.walked;
        Halves {
            direct: [0, 1]
                .map(|h: usize| parallel::map(front, |i| self.direct[h][i] - self.sky[h][i] + straight[h][i])),
            sky: self.gathered.sky(),
            vectors: [self.vectors.iter().take(front).copied().collect(), self.gathered.vectors()],
            indirect: if setup.settings.gather > 0 {
                let mut halves = self.gathered.halves();
                for (half, glared) in halves.iter_mut().zip(self.glared.halves()) {
                    // Where nobody looked for any, there are none.
                    parallel::update_light(&mut half[..glared.len()], |i, sum| *sum += glared[i]);
                }
                halves
            } else {
                [0, 1].map(|h: usize| reflected[h][..front].to_vec())
            },
        }
    }
}

/// Mean of two halves.
pub(super) fn mean([a, b]: &[Vec<Rgb>; 2]) -> Vec<Rgb> {
    parallel::map(a.len(), |i| (a[i] + b[i]) * 0.5)
}

/// Rays or samples of a half that all texels get alike: with sharing, its error tells where the others go.
fn first_round(settings: &Settings, half: u32) -> u32 {
    if settings.splat == SplatMode::Share { half.div_ceil(3) } else { half }
}

/// Rays of the gather that see the sky, for each sample of direct light.
fn gather_rays(settings: &Settings) -> f32 {
    let gathers = settings.bounces != Some(0) && settings.direct == DirectMode::Gather;
    if gathers { settings.gather as f32 / settings.direct_samples as f32 } else { 0.0 }
}

/// Adds to what was spent; the share that the addition has in all of it.
fn grow(spent: &mut f64, more: f64) -> f32 {
    *spent += more;
    (more / *spent) as f32
}

/// all += (new − all)·share.
fn merge<T>(all: &mut Vec<T>, new: Vec<T>, share: f32)
where
    T: Copy + Send + Sync + Add<Output = T> + Sub<Output = T> + Mul<f32, Output = T>,
{
    *all = if share < 1.0 { parallel::map(new.len(), |i| all[i] + (new[i] - all[i]) * share) } else { new };
}

fn walk_settings(settings: &Settings, budget: &Budget, half: u64, seed: u64) -> walk::Settings {
    walk::Settings {
        splat: match settings.splat {
            SplatMode::Paper => Splat::Paper { alpha: settings.alpha, beta: settings.beta },
            SplatMode::None | SplatMode::Share => Splat::None,
        },
        lines: if half == 0 { budget.lines.div_ceil(2) } else { budget.lines / 2 },
        // The gather is one bounce more.
        bounces: settings.bounces.map(|n| n.saturating_sub(u32::from(settings.gather > 0))),
        low_discrepancy: settings.splat == SplatMode::Share,
        seed,
    }
}
