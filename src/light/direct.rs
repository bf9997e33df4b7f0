//! Direct irradiance by shadow rays from every patch, as two halves that share no random number.
//!
//! Lights without size are exact ([`hard`](super::hard)), in both halves alike, but for edges of shadows. Everything
//! else is sampled, in three kinds that get rays of their own: each sun with a size and each light whose shadow has an
//! edge here; one of all lights and surfaces at a finite distance; one direction to sky and environment. The first
//! round gives every texel a share of its samples; [`allot`](super::allot) says which get more, and how many, in the
//! rounds that follow. A half's points are one low-discrepancy sequence that later rounds go on with.
//!
//! Tried: the shadow rays of a patch traced together (`trace::Rays`), up to 128 at a time: 7 to 12 % slower in office and
//! cornell. What each ray would bring has to be kept until it is answered.
//!
//! Invariants: same bits at any thread count; hidden patches get nothing; both halves get the same number of samples.

use super::allot::{self, Allotment, Judges};
use super::common::Common;
use super::hard::{self, Hard};
use super::lit::Lit;
use super::look::{Look, Place};
use super::neighbors::Neighbors;
use super::openings::Openings;
use super::slope::Moments;
use super::unhidden::Unhidden;
use super::{Emitters, Settings};
use crate::base::low_discrepancy::Sequence;
use crate::base::random::{Stage, Stream, mix};
use crate::base::{LightVector, Progress, Rgb, parallel};
use crate::patches::{Dimness, Outlook, Patches};
use crate::trace::Tracer;
use glam::Vec2;

/// Fractional part of the golden ratio: its multiples spread the choice of emitter against the other dimensions.
pub(super) const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Patches whose new estimates are held beside the old ones: of all of a page of 8.8 million texels at once they took 0.9 GiB.
const AT_ONCE: usize = 1 << 18;

/// Direct light of all patches, fronts and backs.
#[derive(Debug, Default)]
pub struct Direct {
    /// Irradiance by two independent halves of the samples [lx]; the result is their mean.
    pub halves: [Vec<Rgb>; 2],
    /// Part of the halves that the final gather finds, too: light of the sky (see [`Emitters::gathered_sky`]).
    pub gathered: [Vec<Rgb>; 2],
    /// How the halves change over the texel, without that part: mean of the channels [lx per texel].
    pub slopes: [Vec<Vec2>; 2],
    /// Light vectors without that part, mean of the halves [lx]; empty if they are not wanted.
    pub vectors: Vec<LightVector>,
    /// Shadow rays that were shot.
    pub rays: u64,
}

/// What is sampled with rays of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Each sun with a size, and each light without size whose shadow has an edge here.
    Each,
    /// One of the lights and surfaces at a finite distance.
    Finite,
    /// Sky and environment.
    Infinity,
}

/// Estimates of one kind for one patch.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Estimate {
    /// Means of the halves [lx].
    pub(super) halves: [Rgb; 2],
    /// Part of them that the final gather finds, too.
    pub(super) gathered: [Rgb; 2],
    /// Slopes of the halves without that part [lx per texel], by the samples of the last round alone: most of them.
    slopes: [Vec2; 2],
    /// Samples of each half; 0 where there is nothing to sample.
    pub(super) samples: u32,
}

struct Layer {
    kind: Kind,
    estimates: Vec<Estimate>,
    /// What the estimates are made of where light has a closed form; empty if it has none.
    unhidden: Vec<Unhidden>,
    /// Light vectors without what the gather finds [lx]; empty if they are not wanted.
    vectors: Vec<LightVector>,
}

struct Context<'a, L> {
    look: L,
    emitters: &'a Emitters,
    patches: &'a Patches,
    hard: Hard,
    common: Common,
    openings: &'a Openings,
    settings: &'a Settings,
}

/// Sum of the samples of one half, and the slope over the texel.
type Half = (Lit, Vec2);

/// Both halves, and the light if nothing were in between, if it was asked for and is known.
type Sums = ([Half; 2], Option<Rgb>);

/// Direct light of every patch; without an outlook, all is judged as in the brightest place.
#[must_use]
pub fn direct(
    tracer: &Tracer<'_>,
    patches: &Patches,
    emitters: &Emitters,
    (openings, outlook): (&Openings, Option<&Outlook>),
    settings: &Settings,
    progress: &Progress,
) -> Direct {
    let unused = Look::new(tracer, patches, emitters, settings.directional);
    let look = || unused.clone();
    let neighbors = Neighbors::new(patches);
    let hard = hard::hard(&look, &neighbors, progress);
    let mut rays = hard.rays;
    let common = if emitters.are_many() { Common::find(&look, patches, emitters, progress) } else { Common::default() };
    let context = Context { look, emitters, patches, hard, common, openings, settings };
    let mut layers = vec![];
    for kind in [Kind::Each, Kind::Finite, Kind::Infinity] {
        let first = |i: usize| match kind {
            Kind::Each if context.has_edge(i) => allot::first_at_edge(settings.samples),
            _ => allot::first_samples(settings.samples, kind == Kind::Each),
        };
        let list: Vec<Allotment> =
            (0..patches.len()).filter(|&i| context.has(kind, i)).map(|i| (i as u32, first(i))).collect();
        if !list.is_empty() {
            let vectors = if settings.directional { patches.len() } else { 0 };
            let (estimates, vectors) =
                (parallel::map_light(patches.len(), |_| Estimate::default()), vec![LightVector::default(); vectors]);
            let is_even = kind == Kind::Finite && !emitters.even_pieces().is_empty();
            let unhidden = vec![Unhidden::default(); if is_even { patches.len() } else { 0 }];
            let mut layer = Layer { kind, estimates, unhidden, vectors };
            rays += context.extend(&mut layer, &list, progress);
            layers.push(layer);
        }
    }
    let mut dimness = Dimness::default();
    for rounds in 0..allot::ROUNDS {
        let estimates: Vec<(&[Estimate], Kind)> = layers.iter().map(|l| (l.estimates.as_slice(), l.kind)).collect();
        let visible = allot::visible(&context.hard.irradiance, &estimates);
        if rounds == 0 {
            dimness = outlook.map_or_else(Dimness::default, |outlook| outlook.dimness(patches, &visible));
        }
        let judges = Judges { neighbors: &neighbors, openings, visible: &visible, dimness: &dimness };
        let wanted = allot::wanted(&estimates, &judges, settings.samples, rounds);
        if wanted.iter().all(Vec::is_empty) || progress.cancelled() {
            break;
        }
        for (layer, list) in layers.iter_mut().zip(&wanted) {
            rays += context.extend(layer, list, progress);
        }
    }
    let Hard { irradiance, slope, mut vectors, .. } = context.hard;
    let n = patches.len();
    let halves = [0, 1].map(|h| {
        parallel::map_light(n, |i| layers.iter().fold(irradiance[i], |sum, layer| sum + layer.estimates[i].halves[h]))
    });
    let slopes = [0, 1].map(|h| {
        parallel::map_light(n, |i| layers.iter().fold(slope[i], |sum, layer| sum + layer.estimates[i].slopes[h]))
    });
    let sky = layers.iter().find(|l| l.kind == Kind::Infinity);
    let gathered = |h: usize| parallel::map(n, |i| sky.map_or(Rgb::ZERO, |layer| layer.estimates[i].gathered[h]));
    for layer in &layers {
        vectors.iter_mut().zip(&layer.vectors).for_each(|(sum, own)| *sum += *own);
    }
    Direct { halves, gathered: [gathered(0), gathered(1)], slopes, vectors, rays }
}

impl<'a, L: Fn() -> Look<'a> + Sync> Context<'a, L> {
    fn has(&self, kind: Kind, patch: usize) -> bool {
        self.patches.exposed[patch] > 0.0
            && match kind {
                Kind::Each => !self.emitters.suns.is_empty() || self.hard.edges[patch] != 0,
                Kind::Finite => self.emitters.has_finite(),
                Kind::Infinity => !self.emitters.infinity.is_black(),
            }
    }

    /// The edge of a shadow is known to cut the patch.
    fn has_edge(&self, patch: usize) -> bool {
        self.hard.edges[patch] != 0 && !(self.look)().has_relief(patch)
    }

    /// Gives patches of a list as many samples per half as it says; the number of rays.
    fn extend(&self, layer: &mut Layer, list: &[Allotment], progress: &Progress) -> u64 {
        list.chunks(AT_ONCE).map(|some| self.extend_some(layer, some, progress)).sum()
    }

    /// The same for a part of a list.
    fn extend_some(&self, layer: &mut Layer, list: &[Allotment], progress: &Progress) -> u64 {
        let old = &layer.estimates;
        let more = parallel::map_watched(list.len(), progress, |k| {
            let (patch, samples) = (list[k].0 as usize, list[k].1);
            let mut look = (self.look)();
            let before = old[patch];
            let (sums, all) = self.sums(&mut look, layer.kind, patch, before.samples..samples);
            let mean = |mean: Rgb, sum: Rgb| (mean * before.samples as f32 + sum) / samples as f32;
            let closed = layer.unhidden.get(patch).filter(|_| self.openings.glow(patch).is_none());
            let unhidden = closed.map(|known| Unhidden {
                all: all.unwrap_or(known.all),
                would: [0, 1].map(|h| mean(known.would[h], sums[h].0.unhidden)),
                arrived: [0, 1].map(|h| mean(known.arrived[h], sums[h].0.all)),
            });
            let halves = [0, 1].map(|h| match &unhidden {
                Some(known) => known.light(h, samples),
                None => mean(before.halves[h], sums[h].0.all),
            });
            let gathered = [0, 1].map(|h| mean(before.gathered[h], sums[h].0.gathered));
            let vector = layer.vectors.get(patch).map(|&mean| {
                let sum = (sums[0].0.vector + sums[1].0.vector) * 0.5;
                (mean * before.samples as f32 + sum) * (samples as f32).recip()
            });
            (Estimate { halves, gathered, slopes: sums.map(|half| half.1), samples }, unhidden, vector, look.rays)
        });
        let mut rays = 0;
        for (&(patch, _), (estimate, unhidden, vector, own)) in list.iter().zip(more) {
            layer.estimates[patch as usize] = estimate;
            if let Some(unhidden) = unhidden {
                layer.unhidden[patch as usize] = unhidden;
            }
            if let Some(vector) = vector {
                layer.vectors[patch as usize] = vector;
            }
            rays += own;
        }
        rays
    }

    fn sums(&self, look: &mut Look<'a>, kind: Kind, patch: usize, range: core::ops::Range<u32>) -> Sums {
        match kind {
            Kind::Each => {
                let edges = self.hard.edges[patch];
                let hard = self.emitters.hard.iter().enumerate().filter(|(k, _)| edges >> k & 1 == 1).map(|(_, l)| l);
                let lights: Vec<_> = hard.chain(&self.emitters.suns).collect();
                let sums = self.sampled(look, kind, patch, range, |look, place, _, u| {
                    lights.iter().map(|l| look.light(place, l, u)).fold(Lit::default(), |a, b| a + b)
                });
                (sums, None)
            }
            Kind::Finite => {
                let (site, opening) = (look.site(patch), self.openings.glow(patch));
                let mut cut = self.common.cut(self.emitters, patch, &site);
                if cut.is_empty() {
                    return Sums::default();
                }
                let known = Unhidden::is_needed(range.clone()) && !cut.is_close && opening.is_none();
                let all = (known && !self.emitters.even_pieces().is_empty()).then(|| look.unhidden(patch, &site));
                let finite =
                    |look: &mut Look<'a>, place: &Place, pick, u| look.finite(place, &mut cut, pick, u, opening);
                (self.sampled(look, kind, patch, range, finite), all)
            }
            Kind::Infinity => {
                let rays = self.settings.gather_rays;
                let opening = self.openings.sky(patch);
                let sky = |look: &mut Look<'a>, place: &Place, pick, u| look.infinity(place, opening, pick, u, rays);
                (self.sampled(look, kind, patch, range, sky), None)
            }
        }
    }

    /// Sums of `f` over a range of the points of both halves.
    fn sampled(
        &self,
        look: &mut Look<'a>,
        kind: Kind,
        patch: usize,
        range: core::ops::Range<u32>,
        mut f: impl FnMut(&mut Look<'a>, &Place, f64, Vec2) -> Lit,
    ) -> [Half; 2] {
        let surface = look.patch_surface(patch);
        [0, 1].map(|half| {
            let key = (Stage::Light as u64) << 48 | (kind as u64) << 40 | half << 36;
            let key = mix(self.settings.seed ^ mix(key).wrapping_add(patch as u64));
            let sequence = Sequence::new(key);
            let offset = Stream::new(key, Stage::Light, half, 0).next_f64();
            let (mut sum, mut moments) = (Lit::default(), Moments::default());
            for k in range.clone() {
                let [u, v, x, y] = sequence.point(k);
                let spot = surface.sample(Vec2::new(x, y));
                let place = look.spot(&surface, &spot);
                let pick = (offset + f64::from(k) * GOLDEN).fract();
                let seen = f(look, &place, pick, Vec2::new(u, v));
                sum = sum + seen;
                moments.add(seen.own(), spot.within, 1.0);
            }
            (sum, moments.slope())
        })
    }
}
