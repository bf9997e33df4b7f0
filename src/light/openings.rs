//! Where light comes in: directions in which blocks of texels see the sky, or a large bright surface, through windows, doors
//! and gaps.
//!
//! In: patches and emitters. Out: for blocks of texels that see little of what shines, a map of the hemisphere that tells
//! in which directions they do. Samples go by it mostly, and by what knows nothing of windows else, so that nothing is
//! left out; the density of the mixture is exact, so the map may be wrong in any way.
//!
//! * The sky has a map where less than [`MOST`] of it is seen.
//! * What glows has one where hardly anything of what could arrive does: behind a window, shadow rays to chosen points of a
//!   large bright surface mostly end at the wall. There one more ray for each of them goes by the map, and the balance
//!   heuristic divides the light between the two (Veach and Guibas, SIGGRAPH 1995, eq. 9).
//!
//! Source: guiding by a table of directions for parts of space, as in Bashford-Rogers, Debattista, Chalmers, "A Significance
//! Cache for Accelerating Global Illumination", CGF 31(6), 2012. Where we differ: the table is of direct light alone, made
//! once, from even rays by cosine and from others around what these find. They are used for nothing else, so that what they
//! find by chance is no bias.
//!
//! Invariants: same bits at any thread count; any map gives the same light in the mean.
//!
//! Limits: an opening that none of a block's rays passes has no part in its map.

use super::Emitters;
use super::direct::GOLDEN;
use super::look::Look;
use crate::base::color::{luminance, mean};
use crate::base::distribution::Grid;
use crate::base::low_discrepancy::Sequence;
use crate::base::random::{Stage, Stream, mix};
use crate::base::{Frame, Progress, Rgb, parallel, warp};
use crate::patches::{PatchSurface, Patches};
use crate::trace::{Ray, Tracer};
use core::f32::consts::PI;
use core::ops::Range;
use glam::{Vec2, Vec3};

/// Edge of a block [texels].
const BLOCK: u32 = 8;
/// Texels of a block from which on it has maps: of fewer, rays for a map cost more than it saves.
const LEAST: usize = 16;
/// Cells of a map along each side of the square that is mapped to the hemisphere, by cosine.
const CELLS: u32 = 16;
/// Rays of a block: one for each cell.
const RAYS: u32 = CELLS * CELLS;
/// Rays after which a block that sees most of the sky needs no more.
const FEW_RAYS: u32 = 64;
/// Share of the sky that is seen, from which on looking for it needs no map.
const MOST: f32 = 0.06;
/// Reflectance from which on the sky has no map. In white rooms with a gap the same rays have to tell how much light comes in
/// and how much goes out (`gather::settle`), or the level is off by what they differ.
const WHITE: f32 = 0.8;
/// Shadow rays to what glows, and the share of their light that arrives, from which on it is not hidden.
const SHADOW_RAYS: u32 = 8;
const LITTLE: f32 = 0.125;
/// Share of the samples that go by the map.
const GUIDED: f32 = 0.75;
/// Samples that go by a map count for so many beside rays of the gather: where they disagree, there will be more.
pub(super) const COUNTED: f32 = 16.0;
/// Weight of a cell beside another in that one's.
const BESIDE: f32 = 0.1;

const NONE: u32 = u32::MAX;

/// Where light comes in, by patch.
#[derive(Debug, Default)]
pub struct Openings {
    blocks: Vec<Block>,
    /// Of each front patch, the number of its block; empty where there is none.
    of: Vec<u32>,
}

/// Maps of a block of texels.
#[derive(Debug)]
struct Block {
    /// Of the hemisphere.
    frame: Frame,
    sky: Option<Grid>,
    glow: Option<Grid>,
}

/// The directions of one kind of light.
#[derive(Debug, Clone, Copy)]
pub(super) struct Opening<'a> {
    frame: &'a Frame,
    grid: &'a Grid,
}

/// What rays of a block find.
struct Found {
    /// Sums of the light, by cell.
    sky: Vec<f32>,
    glow: Vec<f32>,
    /// Rays, by cell.
    rays: Vec<f32>,
    /// Light of the sky if nothing were in between.
    would: f32,
}

/// Looks around from a block.
struct Survey<'l, 'a> {
    look: &'l Look<'a>,
    tracer: &'l Tracer<'a>,
    texels: &'l [usize],
    frame: &'l Frame,
    /// The sky is looked for.
    sees_sky: bool,
    /// What glows is looked for.
    is_hidden: bool,
    seed: u64,
}

impl Openings {
    /// Looks around from all blocks of front patches.
    #[must_use]
    pub fn find(tracer: &Tracer<'_>, patches: &Patches, emitters: &Emitters, seed: u64, progress: &Progress) -> Self {
        if !emitters.has_sky() && emitters.is_empty() {
            return Self::default();
        }
        let unused = Look::new(tracer, patches, emitters, false);
        let found = parallel::map_watched(patches.block_places(BLOCK), progress, |place| {
            let block = |block: &Vec<(u32, usize)>| {
                let texels: Vec<usize> = block.iter().map(|(_, i)| *i).filter(|i| patches.exposed[*i] > 0.0).collect();
                Some((Block::find(&mut unused.clone(), tracer, &texels, seed)?, texels))
            };
            patches.blocks_at(place, BLOCK).iter().filter_map(block).collect::<Vec<_>>()
        });
        let mut openings = Self::default();
        for (block, texels) in found.into_iter().flatten() {
            openings.of.resize(patches.front, NONE);
            texels.into_iter().for_each(|i| openings.of[i] = openings.blocks.len() as u32);
            openings.blocks.push(block);
        }
        openings
    }

    fn block(&self, patch: usize) -> Option<&Block> {
        self.of.get(patch).filter(|k| **k != NONE).map(|k| &self.blocks[*k as usize])
    }

    /// Where a patch sees the sky.
    pub(super) fn sky(&self, patch: usize) -> Option<Opening<'_>> {
        let Block { frame, sky, .. } = self.block(patch)?;
        Some(Opening { frame, grid: sky.as_ref()? })
    }

    /// Where a patch sees what glows.
    pub(super) fn glow(&self, patch: usize) -> Option<Opening<'_>> {
        let Block { frame, glow, .. } = self.block(patch)?;
        Some(Opening { frame, grid: glow.as_ref()? })
    }
}

impl Opening<'_> {
    /// A direction by the map for a `pick` below [`GUIDED`]; otherwise the pick of who chooses else.
    pub(super) fn sample(&self, pick: f32, u: Vec2) -> Result<Vec3, f32> {
        if pick >= GUIDED {
            return Err((pick - GUIDED) / (1.0 - GUIDED));
        }
        let Some(([x, y], place)) = self.grid.sample(u) else { return Err(pick / GUIDED) };
        let square = (Vec2::new(x as f32, y as f32) + place) / CELLS as f32;
        Ok(self.frame.to_world(warp::square_to_cosine_hemisphere(square)))
    }

    /// Density per steradian of a unit direction, if that of who chooses else is `other`; for a share of the light, that of the
    /// map may count several `times`.
    pub(super) fn density(&self, direction: Vec3, other: f32, times: f32) -> f32 {
        let Frame { s, t, n } = *self.frame;
        let cosine = n.dot(direction);
        let own = if cosine > 0.0 {
            let [x, y] = cell(Vec2::new(s.dot(direction), t.dot(direction)));
            self.grid.probability(x, y) * RAYS as f32 * cosine / PI
        } else {
            0.0
        };
        own * (GUIDED * times) + other * (1.0 - GUIDED)
    }
}

/// The cell of a point of the disc.
fn cell(point: Vec2) -> [usize; 2] {
    let at = warp::disk_to_square(point) * CELLS as f32;
    [at.x, at.y].map(|v| (v as usize).min(CELLS as usize - 1))
}

impl Block {
    /// What some texels see, if it is worth a map.
    fn find(look: &mut Look<'_>, tracer: &Tracer<'_>, texels: &[usize], seed: u64) -> Option<Self> {
        if texels.len() < LEAST {
            return None;
        }
        let middle = texels[texels.len() / 2];
        let sees_sky = look.emitters.has_sky() && look.patches.albedo(middle).max_element() < WHITE;
        let is_hidden = is_hidden(look, middle, seed);
        if !sees_sky && !is_hidden {
            return None;
        }
        let normal = texels.iter().map(|i| look.patches.normal[*i]).sum::<Vec3>().try_normalize()?;
        let frame = Frame::from_normal(normal);
        let Found { sky, glow, .. } =
            Survey { look, tracer, texels, frame: &frame, sees_sky, is_hidden, seed }.find()?;
        let [sky, glow] = [sky, glow].map(|found| (sum(&found) > 0.0).then(|| map(&found, 1, BESIDE)));
        Some(Self { frame, sky, glow })
    }
}

/// A map by what was found, and by a part of what was found up to so many cells beside.
fn map(found: &[f32], reach: usize, beside: f32) -> Grid {
    let n = CELLS as usize;
    Grid::new(n, n, |x, y| {
        let [columns, rows] = [x, y].map(|v| v.saturating_sub(reach)..(v + reach + 1).min(n));
        let row = |y: usize| sum(&found[y * n + columns.start..y * n + columns.end]);
        found[y * n + x] + rows.map(row).fold(0.0, |a, b| a + b) * beside
    })
}

fn sum(values: &[f32]) -> f32 {
    values.iter().fold(0.0, |a, b| a + b)
}

impl Survey<'_, '_> {
    /// Light in the mean by cell, of what is worth a map; `None` for none of both.
    fn find(&self) -> Option<Found> {
        let none = || vec![0.0; RAYS as usize];
        let mut found = Found { sky: none(), glow: none(), rays: none(), would: 0.0 };
        let seed = mix(self.seed ^ mix((Stage::Light as u64) << 48 | 1 << 47).wrapping_add(self.texels[0] as u64));
        let sequence = Sequence::new(seed);
        for some in [0..FEW_RAYS, FEW_RAYS..RAYS] {
            self.cast(&mut found, &sequence, some, Some);
            if !self.sees_sky || sum(&found.sky) > MOST * found.would {
                found.sky.fill(0.0);
                if !self.is_hidden {
                    return None;
                }
            }
        }
        let all = [&found.sky, &found.glow].map(|light| sum(light).max(f32::MIN_POSITIVE));
        let both: Vec<f32> = (0..found.rays.len()).map(|k| found.sky[k] / all[0] + found.glow[k] / all[1]).collect();
        if sum(&both) <= 0.0 {
            return None;
        }
        let (near, has_sky) = (map(&both, 2, 1.0), found.sky.iter().any(|light| *light > 0.0));
        self.cast(&mut found, &sequence, RAYS..2 * RAYS, |u| {
            let ([x, y], place) = near.sample(u)?;
            Some((Vec2::new(x as f32, y as f32) + place) / CELLS as f32)
        });
        let Found { sky, glow, rays, .. } = &mut found;
        for light in [&mut *sky, glow] {
            light.iter_mut().zip(&*rays).for_each(|(light, rays)| *light /= rays.max(1.0));
        }
        if !has_sky {
            sky.fill(0.0);
        }
        Some(found)
    }

    /// Rays from points of all texels, in directions by points of the square.
    fn cast(&self, found: &mut Found, sequence: &Sequence, rays: Range<u32>, square: impl Fn(Vec2) -> Option<Vec2>) {
        let Self { look, tracer, texels, frame, .. } = *self;
        let (scene, first, count) = (tracer.scene(), rays.start, rays.len());
        let mut last: Option<(usize, PatchSurface<'_>)> = None;
        for k in rays {
            let [u, v, x, y] = sequence.point(k);
            let Some(square) = square(Vec2::new(u, v)) else { continue };
            let texel = (k - first) as usize * texels.len() / count;
            let (_, surface) = match &last {
                Some(known) if known.0 == texel => known,
                _ => last.insert((texel, look.patch_surface(texels[texel]))),
            };
            let place = look.spot(surface, &surface.sample(Vec2::new(x, y)));
            let local = warp::square_to_cosine_hemisphere(square);
            let direction = frame.to_world(local);
            let Some((_, origin)) = look.leave(&place, direction) else { continue };
            let [x, y] = cell(local.truncate());
            let (ray, at) = (Ray { origin, direction, t_max: f32::INFINITY }, y * CELLS as usize + x);
            let light = luminance(scene.light_from_infinity(direction));
            found.would += light;
            found.rays[at] += 1.0;
            match tracer.closest_hit(&ray) {
                Some(hit) if self.is_hidden => {
                    let glow = luminance(look.emitters.glow(scene, direction, &hit));
                    found.glow[at] += glow * mean(tracer.tint(&Ray { t_max: hit.t, ..ray }));
                }
                Some(_) => {}
                None => found.sky[at] += light * mean(tracer.tint(&ray)),
            }
        }
    }
}

/// Hardly anything arrives of what would if nothing were between a patch and what glows, all of it far away.
fn is_hidden(look: &mut Look<'_>, patch: usize, seed: u64) -> bool {
    if look.emitters.is_empty() {
        return false;
    }
    let mut cut = look.emitters.cut(&look.site(patch));
    if cut.is_empty() || cut.is_close {
        return false;
    }
    let key = mix(seed ^ mix((Stage::Light as u64) << 48 | 1 << 46).wrapping_add(patch as u64));
    let (sequence, offset) = (Sequence::new(key), Stream::new(key, Stage::Light, 0, 0).next_f64());
    let surface = look.patch_surface(patch);
    let (mut would, mut arrived) = (Rgb::ZERO, Rgb::ZERO);
    for k in 0..SHADOW_RAYS {
        let [u, v, x, y] = sequence.point(k);
        let place = look.spot(&surface, &surface.sample(Vec2::new(x, y)));
        let pick = (offset + f64::from(k) * GOLDEN).fract();
        let lit = look.finite(&place, &mut cut, pick, Vec2::new(u, v), None);
        would += lit.unhidden;
        arrived += lit.all;
    }
    mean(arrived) < LITTLE * mean(would)
}
