//! What blocks of texels look at, by a few rays each: who matters to whom, and how bright it is around.
//!
//! In: tracer and patches; later, light of each patch. Out: the patches that rays of a block meet, means over blocks, and how much
//! dimmer than the scene it is around each patch.
//!
//! An error shows beside the light that the eye gets used to there: in a room behind a window, that of the room, not that of
//! the sunlit street, which makes the mean of the scene. So effort goes by what is around: half by the light of the block, half
//! by that of the blocks that it looks at, both with a bounce more, as light that comes by reflections alone is not known yet when
//! shadow rays are dealt. Of it [`NARROW`] times count, at most the mean of the scene: within one room, all is as by the mean.
//!
//! Symbols: E light that falls on a patch [lx]   ρ its albedo
//!
//! Invariants: same bits at any thread count.
//!
//! Limits: [`RAYS`] rays for 8 × 8 texels: what is around is roughly known.

use super::{NO_PATCH, PatchSurface, Patches};
use crate::base::random::{Stage, Stream};
use crate::base::{Progress, color, parallel};
use crate::trace::Tracer;
use glam::Vec2;

/// Edge of a block [texels].
const BLOCK: u32 = 8;
/// Rays of a block.
const RAYS: usize = 16;
/// How much dimmer it may be around than in the mean of the scene before that counts.
const NARROW: f32 = 4.0;
/// Least light that is thought to be around, over the mean of the scene.
const LEAST: f32 = 1e-3;

/// What blocks of patches of one chart and side look at.
#[derive(Debug, Default)]
pub struct Outlook {
    /// Where the blocks of each place start, and the end.
    first: Vec<u32>,
    blocks: Vec<Looker>,
}

/// A block.
#[derive(Debug)]
struct Looker {
    chart: u32,
    is_back: bool,
    /// What its rays meet: [`NO_PATCH`] for what leaves the scene.
    met: [u32; RAYS],
}

/// How bright it is around patches, over the mean of the scene.
#[derive(Debug, Default)]
pub struct Dimness<'a> {
    /// By block; `None` where nobody knows.
    known: Option<(&'a Outlook, &'a Patches, Vec<f32>)>,
}

impl Dimness<'_> {
    /// 1, or less where it is far dimmer.
    #[must_use]
    pub fn at(&self, patch: usize) -> f32 {
        let known = |(outlook, patches, dimness): &(&Outlook, &Patches, Vec<f32>)| {
            outlook.block(patches, patch).map(|block| dimness[block])
        };
        self.known.as_ref().and_then(known).unwrap_or(1.0)
    }
}

impl Outlook {
    /// Looks around from all blocks.
    #[must_use]
    pub fn find(tracer: &Tracer<'_>, patches: &Patches, progress: &Progress) -> Self {
        let found = parallel::map_watched(patches.block_places(BLOCK), progress, |place| {
            let look = |side: Vec<u32>| {
                let front = patches.front_patch(side[0] as usize);
                Looker {
                    chart: patches.chart(front),
                    is_back: front != side[0] as usize,
                    met: core::array::from_fn(|k| meet(tracer, patches, side[k * side.len() / RAYS], k)),
                }
            };
            sides(patches, place).into_iter().map(look).collect::<Vec<_>>()
        });
        let mut outlook = Self { first: vec![0], blocks: vec![] };
        for blocks in found {
            outlook.blocks.extend(blocks);
            outlook.first.push(outlook.blocks.len() as u32);
        }
        outlook
    }

    /// Number of blocks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.blocks.len()
    }

    /// Nobody looks around.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// The block of a patch; `None` for one that has no part in light.
    #[must_use]
    pub fn block(&self, patches: &Patches, patch: usize) -> Option<usize> {
        if patches.exposed_area(patch) <= 0.0 {
            return None;
        }
        let front = patches.front_patch(patch);
        let (chart, place) = (patches.chart(front), patches.block_place(front, BLOCK));
        let mut there = *self.first.get(place)? as usize..*self.first.get(place + 1)? as usize;
        there.find(|b| self.blocks[*b].chart == chart && self.blocks[*b].is_back == (front != patch))
    }

    /// Mean of what rays of a block meet; nothing for those that leave the scene.
    pub fn mean_met(&self, block: usize, value: impl Fn(usize) -> f32) -> f32 {
        let met = self.blocks[block].met.iter().filter(|patch| **patch != NO_PATCH);
        met.map(|&patch| value(patch as usize)).sum::<f32>() / RAYS as f32
    }

    /// Mean of each block, by area.
    pub fn means(&self, patches: &Patches, value: impl Fn(usize) -> f32 + Sync) -> Vec<f32> {
        let mean = |side: Vec<u32>| {
            let area = |i: u32| patches.exposed_area(i as usize);
            let (sum, whole) =
                side.iter().fold((0.0, 0.0), |(s, w), &i| (s + area(i) * value(i as usize), w + area(i)));
            sum / whole
        };
        let places = parallel::map(patches.block_places(BLOCK), |place| {
            sides(patches, place).into_iter().map(mean).collect::<Vec<f32>>()
        });
        places.into_iter().flatten().collect()
    }

    /// How bright it is around each patch, over the mean of `light` [lx] in the scene. 1 everywhere in the dark.
    #[must_use]
    pub fn dimness<'a>(&'a self, patches: &'a Patches, light: &[f32]) -> Dimness<'a> {
        let area = |i: usize| f64::from(patches.exposed_area(i));
        let whole = parallel::sum(patches.len(), area);
        let mean =
            (parallel::sum(patches.len(), |i| f64::from(light[i]) * area(i)) / whole.max(f64::MIN_POSITIVE)) as f32;
        if self.is_empty() || mean <= 0.0 {
            return Dimness::default();
        }
        let of_block = self.means(patches, |i| light[i]);
        let block = |i: usize| self.block(patches, i);
        let light_at = |i: usize| block(i).map_or(0.0, |b| of_block[b]);
        let sent = |i: usize| light_at(i) * color::mean(patches.albedo(i));
        let with_bounce = parallel::map(self.len(), |b| of_block[b] + self.mean_met(b, sent));
        let seen = |i: usize| block(i).map_or(0.0, |b| with_bounce[b]);
        let dimness = parallel::map(self.len(), |b| {
            let meets = self.mean_met(b, |_| 1.0);
            let around =
                if meets > 0.0 { 0.5 * (with_bounce[b] + self.mean_met(b, seen) / meets) } else { with_bounce[b] };
            (NARROW * around / mean).clamp(LEAST, 1.0)
        });
        Dimness { known: Some((self, patches, dimness)) }
    }
}

/// Patches that lie in the open, of the blocks at a place: fronts and backs.
fn sides(patches: &Patches, place: usize) -> Vec<Vec<u32>> {
    let mut sides: Vec<Vec<u32>> = vec![];
    for block in patches.blocks_at(place, BLOCK) {
        let open = |i: &u32| patches.exposed_area(*i as usize) > 0.0;
        sides.push(block.iter().map(|(_, i)| *i as u32).filter(open).collect());
        let back = |(_, i): &(u32, usize)| patches.opposite(*i).map(|i| i as u32);
        sides.push(block.iter().filter_map(back).filter(open).collect());
    }
    sides.retain(|side| !side.is_empty());
    sides
}

/// The patch that a ray of another one meets.
fn meet(tracer: &Tracer<'_>, patches: &Patches, patch: u32, k: usize) -> u32 {
    let mut stream = Stream::new(1, Stage::Walk, u64::from(patch), k as u64);
    let mut square = || Vec2::new(stream.next_f32(), stream.next_f32());
    let surface = PatchSurface::new(tracer, patches, patch as usize);
    let spot = surface.sample(square());
    let seen = tracer.closest_hit(&surface.cosine_ray(&spot, square())).and_then(|hit| patches.seen(&hit));
    seen.map_or(NO_PATCH, |seen| seen.patch as u32)
}
