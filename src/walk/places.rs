//! Places that light hardly goes between, so that each gets lines of its own, however dim it is.
//!
//! In: patches and their links; flux that each patch has to shoot. Out: the place of each patch; from them, the same flux
//! divided into levels, and the lines for each.
//!
//! Lines go where power is, and a walk ends when what is left is little of all power: of a closed cellar with a lamp, under a
//! square in the sun, with a hundred-thousandth of all power, lines found nothing. It had half of its light, by both halves
//! alike, so that the stated error knew nothing of it. Light adds up, so sources may be walked apart, as groups of lights are:
//! those of places with about as much power per texel together.
//!
//! Surfaces belong to one place if some ray of a few leads from one to the other, or from both out of the scene: a door that is
//! ajar makes one place of two.
//!
//! Limits: a dim place into which bright light finds a way is no place of its own; lines find it by what counts there (`importance`).

use crate::base::random::Stage;
use crate::base::{Progress, Rgb, Sets, Stream, color, parallel};
use crate::patches::{PatchGraph, PatchSurface, Patches};
use crate::trace::Tracer;
use glam::Vec2;

/// Patches per ray, and least rays from a surface that hangs together.
const PATCHES_PER_RAY: usize = 16;
const LEAST_RAYS: usize = 4;
/// Most levels, and power per texel at the top of one over that at its bottom.
const MOST: usize = 8;
const STEP: f64 = 16.0;
/// Share of the lines that are dealt by texels, not by power.
const BY_TEXELS: f64 = 0.5;

/// The place of each patch, by number.
#[must_use]
pub fn places(tracer: &Tracer<'_>, patches: &Patches, graph: &PatchGraph, progress: &Progress) -> Vec<u32> {
    let regions = patches.regions(graph);
    let mut of_region = vec![vec![]; regions.iter().max().map_or(0, |last| *last as usize + 1)];
    for i in (0..patches.len()).filter(|&i| patches.exposed[i] > 0.0) {
        of_region[regions[i] as usize].push(i);
    }
    let outside = of_region.len();
    let mut sets = Sets::new(outside + 1);
    let starts: Vec<(usize, usize)> = of_region
        .iter()
        .flat_map(|region| {
            let rays = (region.len() / PATCHES_PER_RAY).max(region.len().min(LEAST_RAYS));
            (0..rays).map(move |k| (region[k * region.len() / rays], k))
        })
        .collect();
    let met = parallel::map_watched(starts.len(), progress, |s| {
        let (patch, k) = starts[s];
        let mut stream = Stream::new(0, Stage::Walk, patch as u64, k as u64);
        let mut square = || Vec2::new(stream.next_f32(), stream.next_f32());
        let surface = PatchSurface::new(tracer, patches, patch);
        let spot = surface.sample(square());
        match tracer.closest_hit(&surface.cosine_ray(&spot, square())) {
            Some(hit) => patches.seen(&hit).map(|seen| regions[seen.patch] as usize),
            None => Some(outside),
        }
    });
    let met = starts.iter().zip(met).filter_map(|((patch, _), met)| Some((regions[*patch] as usize, met?)));
    met.for_each(|(from, to)| sets.join(from, to));
    let numbers = sets.numbers();
    regions.iter().map(|region| numbers[*region as usize]).collect()
}

/// Some of the flux, and the lines for it.
pub(super) struct Level {
    /// Flux that each patch has to shoot [lm].
    pub(super) unshot: Vec<Rgb>,
    pub(super) lines: u64,
}

/// Power and texels of a place or of a level.
#[derive(Clone, Copy, Default)]
struct Share {
    power: f64,
    texels: f64,
}

impl Share {
    fn and(self, other: Self) -> Self {
        Self { power: self.power + other.power, texels: self.texels + other.texels }
    }

    fn power_per_texel(self) -> f64 {
        self.power / self.texels.max(1.0)
    }
}

/// Divides flux and lines by places, all of one level if they are alike or not known.
pub(super) fn levels(patches: &Patches, places: &[u32], unshot: Vec<Rgb>, lines: u64) -> Vec<Level> {
    let mut of_place = vec![Share::default(); places.iter().max().map_or(0, |last| *last as usize + 1)];
    for (i, place) in places.iter().enumerate().filter(|(i, _)| patches.exposed[*i] > 0.0) {
        let one = Share { power: f64::from(color::mean(unshot[i])), texels: 1.0 };
        of_place[*place as usize] = of_place[*place as usize].and(one);
    }
    let top = of_place.iter().map(|place| place.power_per_texel()).fold(0.0, f64::max);
    let level_of = |place: &Share| {
        let is_of = |k: &usize| place.power_per_texel() * libm::pow(STEP, (*k + 1) as f64) >= top;
        (0..MOST).find(is_of).unwrap_or(MOST - 1)
    };
    let level_of: Vec<usize> = of_place.iter().map(level_of).collect();
    let mut all = [Share::default(); MOST];
    for (place, level) in of_place.iter().zip(&level_of).filter(|(place, _)| place.power > 0.0) {
        all[*level] = all[*level].and(*place);
    }
    let used: Vec<usize> = (0..MOST).filter(|&k| all[k].power > 0.0).collect();
    if used.len() < 2 {
        return vec![Level { unshot, lines }];
    }
    let total = all.iter().fold(Share::default(), |sum, level| sum.and(*level));
    let level = |&level: &usize| {
        let share = (1.0 - BY_TEXELS) * all[level].power / total.power + BY_TEXELS * all[level].texels / total.texels;
        let is_of = |i: usize| level_of[places[i] as usize] == level;
        let unshot = parallel::map(unshot.len(), |i| if is_of(i) { unshot[i] } else { Rgb::ZERO });
        Level { unshot, lines: (lines as f64 * share) as u64 }
    };
    used.iter().map(level).collect()
}
