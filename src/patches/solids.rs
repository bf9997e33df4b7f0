//! Which points of surfaces lie in solids, by rays: one by one, and many of a triangle at once.
//!
//! In: points on the front of triangles. Out: whether each lies in a solid.
//!
//! A point lies in one when at least [`HIDDEN_HITS`] of [`PROBES`] rays over its hemisphere meet the back of single-sided
//! surfaces, or more backs than fronts on their way out of the scene.
//!
//! Where nothing can be crossed between two points of a surface, both are in the same solids. So points are joined along
//! segments a little above the surface, or right on it where something lies close over it, and of what is joined the
//! outermost points are asked; if they disagree, as near the mouth of a hollow, all are. Lightmaps of nine scenes had the
//! same bytes as with points asked one by one; in primitives two texels below a sheet differed.

use super::SurfacePoint;
use super::cells::{MASK_GRID, cell_index};
use super::crossable::Crossable;
use super::party::PartyWalls;
use crate::base::{Frame, Sets, warp};
use crate::scene::Material;
use crate::trace::{Closed, Ground, Ray, Tracer};
use glam::{DVec2, Vec2, Vec3};

/// Rays per point. Fewer misjudge points near the mouth of a hollow.
pub(super) const PROBES: u32 = 8;
/// Hits on backs that make a point hidden; one may go astray through a crack.
const HIDDEN_HITS: u32 = 7;
/// Rays that meet a back first in any solid, whatever goes through it; rays of so many must say that it is one.
const LEAST_BACKS: u32 = 3;
/// Points up to which there is nothing to gain by joining them.
const FEW: usize = 6;

/// The solids of a scene.
#[derive(Clone, Copy)]
pub(super) struct Solids<'a> {
    pub(super) tracer: &'a Tracer<'a>,
    pub(super) closed: &'a Closed,
    pub(super) party: &'a PartyWalls,
}

impl Solids<'_> {
    /// [`PartyWalls::sealed_by`].
    pub(super) fn sealed_by(self, ground: &Ground, point: SurfacePoint) -> Option<u32> {
        self.party.sealed_by(self.tracer, ground, point)
    }
}

/// The rays of a point.
struct Probes<'a> {
    solids: Solids<'a>,
    ground: Ground,
    point: SurfacePoint,
}

impl<'a> Probes<'a> {
    fn new(solids: Solids<'a>, point: SurfacePoint) -> Self {
        Self { solids, ground: Ground::new(solids.tracer.scene().corners(point.triangle)), point }
    }

    fn rays(&self) -> impl Iterator<Item = Ray> {
        let frame = Frame::from_normal(self.ground.normal());
        (0..PROBES).map(move |k| {
            let u = Vec2::new((k as f32 + 0.5) / PROBES as f32, (k as f32 * 0.618_034 + 0.3).fract());
            let direction = frame.to_world(warp::square_to_cosine_hemisphere(u));
            let origin = self.solids.tracer.leave(&self.ground, self.point.b, direction);
            Ray { origin, direction, t_max: f32::INFINITY }
        })
    }

    /// What a ray meets first.
    fn meets(&self, ray: &Ray) -> Met {
        let tracer = self.solids.tracer;
        match tracer.closest_side(ray, |triangle| self.solids.party.has_side(triangle)) {
            None => Met::Nothing,
            Some(hit) if !hit.front && bounds_solids(tracer.scene().material(hit.triangle)) => Met::Back,
            Some(_) => Met::Other,
        }
    }
}

/// What a ray meets first.
#[derive(Clone, Copy, PartialEq)]
enum Met {
    Nothing,
    /// The back of a solid.
    Back,
    Other,
}

/// A surface may bound a solid. The inside of a glass or a lampshade is none.
pub(super) fn bounds_solids(material: &Material) -> bool {
    !material.is_two_sided() && material.transmission == 0.0
}

/// How many of the [`PROBES`] rays of a point leave a solid, whatever touches it.
pub(super) fn rays_out(solids: Solids<'_>, point: SurfacePoint) -> u32 {
    let leaves = |ray: &Ray| solids.tracer.leaves_solids_together(ray, solids.closed).unwrap_or(true);
    Probes::new(solids, point).rays().filter(leaves).count() as u32
}

/// The point lies in the open beyond doubt: none of its rays meets a back.
pub(super) fn sees_no_back(solids: Solids<'_>, point: SurfacePoint) -> bool {
    let probes = Probes::new(solids, point);
    !probes.rays().any(|ray| probes.meets(&ray) == Met::Back)
}

/// The point lies in a solid. Rays inside one may first meet the front of another that goes through it, or of a floor
/// that it stands on: then all that they meet is looked at, and rays that say nothing do not count.
pub(super) fn is_inside(solids: Solids<'_>, point: SurfacePoint) -> bool {
    let probes = Probes::new(solids, point);
    let (mut backs, mut misses, mut lost) = (0, 0, 0);
    for ray in probes.rays() {
        let met = probes.meets(&ray);
        *(if met == Met::Back { &mut backs } else { &mut misses }) += 1;
        lost += u32::from(met == Met::Nothing);
        // What meets nothing leaves nothing: so many would end the second look, too.
        if misses > PROBES - LEAST_BACKS || lost > PROBES - HIDDEN_HITS {
            return false;
        }
    }
    if backs >= HIDDEN_HITS {
        return true;
    }
    let (mut leave, mut stay) = (0, 0);
    for ray in probes.rays() {
        match solids.tracer.leaves_solid(&ray, solids.closed) {
            Some(true) => leave += 1,
            Some(false) => stay += 1,
            None => {}
        }
        if stay > PROBES - HIDDEN_HITS {
            return false;
        }
    }
    leave >= LEAST_BACKS
}

/// [`is_inside`] for points of a texel, triangle by triangle and row by row, each with its place in the texel. `height` is
/// that of the segments between them over the surface [m].
pub(super) fn which_inside(
    solids: Solids<'_>,
    over: &Crossable,
    points: &[(SurfacePoint, DVec2)],
    height: f32,
) -> Vec<bool> {
    if points.len() <= FEW {
        return points.iter().map(|point| is_inside(solids, point.0)).collect();
    }
    // Of a row of points, two are the outermost ones along all four diagonals.
    let mut known = vec![None; points.len()];
    let mut ask = |k: usize| *known[k].get_or_insert_with(|| is_inside(solids, points[k].0));
    let joined = join(solids.tracer, over, points, height);
    let mut inside = vec![false; points.len()];
    for first in (0..points.len()).filter(|&k| joined[k] == k) {
        let members = || (first..points.len()).filter(|&k| joined[k] == first);
        let outermost = |along: DVec2| members().max_by(|&a, &b| at(points, a, along).total_cmp(&at(points, b, along)));
        let verdicts = [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)]
            .map(|(x, y)| outermost(DVec2::new(x, y)).map(&mut ask));
        let agree = verdicts[1..].iter().all(|v| *v == verdicts[0]);
        members().for_each(|k| inside[k] = if agree { verdicts[0] == Some(true) } else { ask(k) });
    }
    inside
}

/// How far along a direction the place of a point is.
fn at(points: &[(SurfacePoint, DVec2)], k: usize, along: DVec2) -> f64 {
    points[k].1.dot(along)
}

/// A point of a texel, a little off its triangle.
#[derive(Clone, Copy)]
struct Raised {
    triangle: u32,
    /// So little that only rounding counts [m].
    low: Vec3,
    /// So far that those of two triangles see each other, if nothing lies between [m].
    high: Option<Vec3>,
}

/// For each point the first one that it is joined to, over the sides of cells and from triangle to triangle.
fn join(tracer: &Tracer<'_>, over: &Crossable, points: &[(SurfacePoint, DVec2)], height: f32) -> Vec<usize> {
    const COLUMNS: usize = MASK_GRID as usize;
    let (mut joined, mut raised) = (Sets::new(points.len()), Vec::<Raised>::new());
    let mut last: [Option<usize>; COLUMNS * COLUMNS] = [None; COLUMNS * COLUMNS];
    let mut ground: Option<(u32, Ground)> = None;
    for (k, (point, within)) in points.iter().enumerate() {
        let triangle = point.triangle;
        let (_, ground) = match ground.filter(|(t, _)| *t == triangle) {
            Some(ground) => ground,
            None => *ground.insert((triangle, Ground::new(tracer.scene().corners(triangle)))),
        };
        let this = Raised::new(tracer, over, &ground, *point, height);
        let cell = cell_index(*within, MASK_GRID);
        let beside = (!cell.is_multiple_of(COLUMNS)).then(|| cell - 1);
        for j in [beside, cell.checked_sub(COLUMNS), Some(cell)].into_iter().flatten().filter_map(|cell| last[cell]) {
            if joined.find(j) != joined.find(k) && raised[j].sees(tracer, over, &this) {
                joined.join(j, k);
            }
        }
        raised.push(this);
        last[cell] = Some(k);
    }
    (0..points.len()).map(|k| joined.find(k)).collect()
}

impl Raised {
    fn new(tracer: &Tracer<'_>, over: &Crossable, ground: &Ground, point: SurfacePoint, height: f32) -> Self {
        let low = tracer.leave(ground, point.b, ground.normal());
        let high = low + ground.normal() * height;
        let high = over.is_clear(tracer, [low, high], Some(point.triangle)).then_some(high);
        Self { triangle: point.triangle, low, high }
    }

    /// Nothing can be crossed between two points; where something lies close over them, right on their triangle.
    fn sees(&self, tracer: &Tracer<'_>, over: &Crossable, other: &Self) -> bool {
        match self.high.zip(other.high) {
            Some((from, to)) => over.is_clear(tracer, [from, to], None),
            None => {
                self.triangle == other.triangle && over.is_clear(tracer, [self.low, other.low], Some(self.triangle))
            }
        }
    }
}

/// Two points lie on a triangle, and nothing can be crossed between them at a height above it [m].
pub(super) fn are_joined(tracer: &Tracer<'_>, a: SurfacePoint, b: SurfacePoint, height: f32) -> bool {
    a.triangle == b.triangle && {
        let (over, ground) = (Crossable::anything(), Ground::new(tracer.scene().corners(a.triangle)));
        let [a, b] = [a, b].map(|point| Raised::new(tracer, &over, &ground, point, height));
        a.high.zip(b.high).is_some_and(|(a, b)| tracer.segment_clear(a, b))
    }
}
