//! What a block of texels sees of the sky and of what glows, by direction: even rays first, then more toward openings that they,
//! or those of other blocks, have found.
//!
//! In: texels of a block, the surveys of others. Out: sums of light and rays in [`CELLS`] × [`CELLS`] cells of the hemisphere.
//!
//! One ray for each cell misses a window of a thousandth of the hemisphere from most blocks of a room, but not from all. So who has
//! found one tells those that see him, or lie beside him, where it is: about as far along his ray as others close to that ray were
//! stopped, by the wall that the window is in. Of a room of 4 × 3 × 4 m with a hole of 0.3 m in a wall of 0.2 m, 10 of some 100
//! blocks find out by even rays.
//!
//! Invariants: same bits at any thread count.
//!
//! Limits: what no block's even rays find is not found.

use super::look::Look;
use crate::base::color::{luminance, mean};
use crate::base::distribution::Grid;
use crate::base::low_discrepancy::Sequence;
use crate::base::{Frame, warp};
use crate::patches::PatchSurface;
use crate::trace::{Ray, Tracer};
use core::ops::Range;
use glam::{Vec2, Vec3};

/// Cells of a map along each side of the square that is mapped to the hemisphere, by cosine.
pub(super) const CELLS: u32 = 16;
/// Even rays of a block: one for each cell.
pub(super) const RAYS: u32 = CELLS * CELLS;
/// Even rays for a texel, where that makes fewer.
const RAYS_OF_TEXEL: u32 = 16;
/// Every so many of the even rays tell whom the block sees.
const EVERY: u32 = 16;
/// Share of the sky that is seen, from which on looking for it needs no map.
const MOST: f32 = 0.06;
/// After the first of so many parts of the even rays, a block needs no more that sees more than that by [`SURE`] times: of 64
/// rays, four or more find the sky from four in ten blocks that see 5 % of it.
const FEW: u32 = 4;
const SURE: f32 = 3.0;
/// Rounds of rays toward what was found, for a block of which [`LUCKY`] have found something.
const ROUNDS: u32 = 2;
/// The same for one with fewer.
pub(super) const MOST_ROUNDS: u32 = 8;
/// The same for one with none.
const VAIN_ROUNDS: u32 = 3;
/// Rays that have found something, with which a block knows enough.
const LUCKY: u32 = 64;
/// Most rays of a block that are remembered for having found something, and those of them that others are told.
const FINDS: usize = 16;
const TOLD: usize = 4;
/// How far away an opening is that nothing is beside [m].
const FAR: f32 = 1e6;
/// How far beside an opening rays go, over its distance, round by round in turn.
const SPREAD: [f32; 2] = [0.1, 0.25];

/// Looks around from the texels of a block.
pub(super) struct Survey<'l, 'a> {
    pub(super) look: &'l Look<'a>,
    pub(super) tracer: &'l Tracer<'a>,
    pub(super) texels: &'l [usize],
}

/// What rays of a block found.
#[derive(Debug, Clone)]
pub(super) struct Surveyed {
    /// Of the hemisphere.
    pub(super) frame: Frame,
    /// Sums of the light of the sky and of what glows, by cell; empty for what is not looked for.
    light: [Vec<f32>; 2],
    /// Rays, by cell.
    rays: Vec<u16>,
    /// Distance after which the last ray of each cell that found nothing was stopped [m]; 0 for none.
    stopped: Vec<f32>,
    /// Light of the sky if nothing were in between.
    would: f32,
    /// Patches that some of the even rays met.
    pub(super) met: Vec<u32>,
    /// Rays that found something: where from, and where to.
    finds: Vec<(Vec3, Vec3)>,
    /// The number of all of them.
    lucky: u32,
    sequence: Sequence,
    /// Points of the sequence that are used up.
    used: u32,
    /// Rounds in which rays have followed what was found.
    rounds: u32,
}

impl Surveyed {
    fn new(frame: Frame, wanted: [bool; 2], seed: u64) -> Self {
        let cells = RAYS as usize;
        Self {
            frame,
            light: wanted.map(|wanted| vec![0.0; if wanted { cells } else { 0 }]),
            rays: vec![0; cells],
            stopped: vec![0.0; cells],
            would: 0.0,
            met: vec![],
            finds: vec![],
            lucky: 0,
            sequence: Sequence::new(seed),
            used: 0,
            rounds: 0,
        }
    }

    /// Light by cell, in the mean.
    pub(super) fn means(&self) -> [Vec<f32>; 2] {
        let mean = |(light, rays): (&f32, &u16)| light / f32::from(*rays).max(1.0);
        [0, 1].map(|kind: usize| self.light[kind].iter().zip(&self.rays).map(mean).collect())
    }

    fn cell(&self, direction: Vec3) -> [usize; 2] {
        cell(Vec2::new(self.frame.s.dot(direction), self.frame.t.dot(direction)))
    }

    /// Where the openings are about, by so many of the rays that passed them.
    fn openings(&self, most: usize) -> impl Iterator<Item = Vec3> + '_ {
        let count = self.finds.len().min(most);
        (0..count).map(move |k| {
            let (origin, direction) = self.finds[k * self.finds.len() / count];
            origin + direction * self.distance(self.cell(direction))
        })
    }

    /// How far away others in a cell, or else in those around it, were stopped [m].
    fn distance(&self, [x, y]: [usize; 2]) -> f32 {
        let n = CELLS as usize;
        let at = self.stopped[y * n + x];
        if at > 0.0 {
            return at;
        }
        let [columns, rows] = [x, y].map(|v| v.saturating_sub(1)..(v + 2).min(n));
        let around = rows.flat_map(|y| columns.clone().map(move |x| y * n + x)).map(|k| self.stopped[k]);
        let (sum, count) = around.filter(|d| *d > 0.0).fold((0.0, 0.0f32), |(sum, count), d| (sum + d, count + 1.0));
        if count > 0.0 { sum / count } else { FAR }
    }
}

impl Survey<'_, '_> {
    /// By even rays of the sky and of what glows, if they are wanted; `None` if no map is worth it.
    pub(super) fn even(&self, frame: Frame, wanted: [bool; 2], seed: u64) -> Option<Surveyed> {
        let mut found = Surveyed::new(frame, wanted, seed);
        let all = (RAYS_OF_TEXEL * self.texels.len() as u32).min(RAYS);
        for (some, sure) in [(0..all / FEW, SURE), (all / FEW..all, 1.0)] {
            self.cast(&mut found, some, |u, _| frame.to_world(warp::square_to_cosine_hemisphere(u)));
            if sum(&found.light[0]) > sure * MOST * found.would {
                found.light[0].clear();
            }
            if found.light.iter().all(Vec::is_empty) {
                return None;
            }
        }
        Some(found)
    }

    /// With more rays toward what was found here and by others; `None` if there are enough, or it leads nowhere.
    pub(super) fn follow<'s>(&self, found: &Surveyed, others: impl Iterator<Item = &'s Surveyed>) -> Option<Surveyed> {
        let most = match found.lucky {
            0 => VAIN_ROUNDS,
            1..LUCKY => MOST_ROUNDS,
            _ => ROUNDS,
        };
        if found.rounds >= most {
            return None;
        }
        let own: Vec<Vec3> = found.openings(FINDS).collect();
        let told: Vec<Vec3> = others.flat_map(|other| other.openings(TOLD)).collect();
        let (own, told) = if own.is_empty() {
            (&told, &told)
        } else if told.is_empty() {
            (&own, &own)
        } else {
            (&own, &told)
        };
        if own.is_empty() {
            return None;
        }
        let mut more = Surveyed { rounds: found.rounds + 1, ..found.clone() };
        let spread = SPREAD[found.rounds as usize % SPREAD.len()];
        let count = (RAYS_OF_TEXEL * self.texels.len() as u32).min(RAYS) / ROUNDS;
        self.cast(&mut more, found.used..found.used + count, |u, position| {
            let half = u.x * 2.0;
            let of = if half < 1.0 { own } else { told };
            let place = half.fract() * of.len() as f32;
            let toward = (of[(place as usize).min(of.len() - 1)] - position).normalize_or_zero();
            let beside = warp::square_to_disk(Vec2::new(place.fract(), u.y)) * spread;
            let frame = Frame::from_normal(toward);
            (toward + frame.s * beside.x + frame.t * beside.y).normalize_or_zero()
        });
        Some(more)
    }

    /// Rays from points of all texels, in directions by points of the square and of the surface.
    fn cast(&self, found: &mut Surveyed, rays: Range<u32>, toward: impl Fn(Vec2, Vec3) -> Vec3) {
        let Self { look, tracer, texels } = *self;
        let (scene, first, count) = (tracer.scene(), rays.start, rays.len());
        found.used = rays.end;
        let mut last: Option<(usize, PatchSurface<'_>)> = None;
        for k in rays {
            let [u, v, x, y] = found.sequence.point(k);
            let texel = (k - first) as usize * texels.len() / count;
            let (_, surface) = match &last {
                Some(known) if known.0 == texel => known,
                _ => last.insert((texel, look.patch_surface(texels[texel]))),
            };
            let place = look.spot(surface, &surface.sample(Vec2::new(x, y)));
            let direction = toward(Vec2::new(u, v), place.position);
            let Some((_, origin)) = look.leave(&place, direction) else { continue };
            if found.frame.n.dot(direction) <= 0.0 {
                continue;
            }
            let [x, y] = found.cell(direction);
            let (ray, at) = (Ray { origin, direction, t_max: f32::INFINITY }, y * CELLS as usize + x);
            let light = luminance(scene.light_from_infinity(direction));
            found.would += light;
            found.rays[at] += 1;
            let [sky, glow] = &mut found.light;
            let hit = tracer.closest_hit(&ray);
            let (kind, light) = match hit {
                Some(hit) if !glow.is_empty() => (glow, luminance(look.emitters.glow(scene, direction, &hit))),
                None if !sky.is_empty() => (sky, light),
                _ => (sky, 0.0),
            };
            if light > 0.0 {
                let t_max = hit.map_or(f32::INFINITY, |hit| hit.t);
                kind[at] += light * mean(tracer.tint(&Ray { t_max, ..ray }));
                found.lucky += 1;
                if found.finds.len() < FINDS {
                    found.finds.push((origin, direction));
                }
            } else if let Some(hit) = hit {
                found.stopped[at] = hit.t;
                if k % EVERY == 0 && k < RAYS {
                    found.met.extend(look.patches.seen(&hit).map(|seen| seen.patch as u32));
                }
            }
        }
    }
}

/// The cell of a point of the disc.
pub(super) fn cell(point: Vec2) -> [usize; 2] {
    let at = warp::disk_to_square(point) * CELLS as f32;
    [at.x, at.y].map(|v| (v as usize).min(CELLS as usize - 1))
}

/// A map by what was found, and by a part of what was found in the cells beside.
pub(super) fn map(found: &[f32], beside: f32) -> Grid {
    let n = CELLS as usize;
    Grid::new(n, n, |x, y| {
        let [columns, rows] = [x, y].map(|v| v.saturating_sub(1)..(v + 2).min(n));
        let row = |y: usize| sum(&found[y * n + columns.start..y * n + columns.end]);
        found[y * n + x] + rows.map(row).fold(0.0, |a, b| a + b) * beside
    })
}

fn sum(values: &[f32]) -> f32 {
    values.iter().fold(0.0, |a, b| a + b)
}
