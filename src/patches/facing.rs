//! What lies on a texel face to face: the underside of a crate on the floor.
//!
//! In: triangles near a texel that face it. Out: which of its points another surface lies on.
//!
//! Where one triangle lies on the corners of a convex polygon, it lies on all of it: it is convex too, and its distance is
//! linear. So a texel below a wall is asked about four points, not sixty-four.

use super::solids::Solids;
use super::{Patches, SurfacePoint};
use crate::trace::Ground;
use glam::{DVec2, Vec3};

/// Triangles up to which they are kept.
const MOST_FACING: usize = 16;
/// Points up to which there is nothing to gain by asking about their corners first.
const FEW: usize = 4;

/// Where something may lie on a texel face to face.
pub(super) enum Facing {
    /// Over these triangles.
    In(Vec<Face>),
    Anywhere,
}

/// A point of a triangle, and the other triangle that lies on it.
#[derive(Clone, Copy)]
pub(super) struct Contact {
    pub(super) point: SurfacePoint,
    pub(super) by: u32,
}

impl Contact {
    /// Both triangles, the one below first.
    pub(super) fn pair(&self) -> [u32; 2] {
        [self.point.triangle, self.by]
    }
}

/// Where a triangle may lie on something.
pub(super) struct Face {
    /// Lowest and highest coordinates [m].
    bounds: [Vec3; 2],
    corners: [Vec3; 3],
    /// Unit normals of the edges, within the plane and inward.
    inward: [Vec3; 3],
    normal: Vec3,
    /// Bound of rounding, far above the length of the ways that are looked at [m].
    pad: f32,
}

impl Face {
    fn new(corners: [Vec3; 3], pad: f32) -> Self {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let inward = [b - a, c - b, a - c].map(|edge| normal.cross(edge).normalize_or_zero());
        Self { bounds: [a.min(b).min(c) - pad, a.max(b).max(c) + pad], corners, inward, normal, pad }
    }

    /// How far inside of the triangle a point is that it may lie on [m].
    fn holds(&self, point: Vec3) -> Option<f32> {
        let [low, high] = self.bounds;
        let near = low.cmple(point).all()
            && high.cmpge(point).all()
            && (point - self.corners[0]).dot(self.normal).abs() <= self.pad;
        let inside = |k: usize| (point - self.corners[k]).dot(self.inward[k]);
        near.then(|| inside(0).min(inside(1)).min(inside(2))).filter(|inside| *inside >= -self.pad)
    }
}

impl Facing {
    /// Nothing lies on the texel.
    pub(super) fn is_nowhere(&self) -> bool {
        matches!(self, Self::In(faces) if faces.is_empty())
    }

    /// Adds a triangle; `pad` is a bound of rounding [m].
    pub(super) fn add(&mut self, corners: [Vec3; 3], pad: f32) {
        match self {
            Self::In(faces) if faces.len() < MOST_FACING => faces.push(Face::new(corners, pad)),
            _ => *self = Self::Anywhere,
        }
    }

    /// Another surface lies on a point of a single-sided one.
    pub(super) fn seals(&self, solids: Solids<'_>, point: SurfacePoint) -> bool {
        let ground = || Ground::new(solids.tracer.scene().corners(point.triangle));
        self.may_seal(solids, point.triangle) && self.by(solids, &ground(), point).is_some()
    }

    /// Other surfaces lie on all of a front patch, one on what each triangle covers of it: the middle of each, and what lies on
    /// it. If there are none, it may be so as well.
    pub(super) fn seals_all(&self, patches: &Patches, solids: Solids<'_>, patch: usize) -> Option<Vec<Contact>> {
        let fragments = patches.fragments.range(patch);
        let few = fragments.len() <= MOST_FACING && !self.is_nowhere();
        few.then(|| fragments.into_iter().map(|f| self.seals_corners(patches, solids, patch, f)).collect())?
    }

    /// One surface lies on all corners of what a triangle covers of a front patch.
    fn seals_corners(&self, patches: &Patches, solids: Solids<'_>, patch: usize, fragment: usize) -> Option<Contact> {
        let triangle = patches.fragments.triangle(patch, fragment);
        if !self.may_seal(solids, triangle) {
            return None;
        }
        let (map, polygon) = (patches.map(triangle, patch), patches.polygon(patch, fragment));
        let ground = Ground::new(solids.tracer.scene().corners(triangle));
        let at = |corner: &DVec2| SurfacePoint { triangle, b: map.weights(*corner) };
        let mut corners = polygon.corners().iter().map(at);
        let by = self.by(solids, &ground, corners.next()?)?;
        let all = corners.all(|corner| self.by(solids, &ground, corner) == Some(by));
        all.then(|| Contact { point: at(&polygon.centroid()), by })
    }

    /// What lies on points of one triangle, each with its place in the texel.
    pub(super) fn seal(&self, solids: Solids<'_>, points: &[(SurfacePoint, DVec2)]) -> Vec<Option<u32>> {
        let mut sealed = vec![None; points.len()];
        let Some((first, _)) = points.first().filter(|(point, _)| self.may_seal(solids, point.triangle)) else {
            return sealed;
        };
        let ground = Ground::new(solids.tracer.scene().corners(first.triangle));
        let mut known = vec![None; points.len()];
        let ask = |k: usize| solids.sealed_by(&ground, points[k].0);
        let mut by = |k: usize| *known[k].get_or_insert_with(|| ask(k));
        let (place, rows) = (|k: usize| points[k].1, in_rows(points.len(), |k| points[k].1));
        let Self::In(faces) = self else {
            fill(&mut by, &mut sealed, &place, &rows);
            return sealed;
        };
        let position = |k: usize| solids.tracer.scene().position(points[k].0.triangle, points[k].0.b);
        let likely: Vec<Option<usize>> = (0..points.len()).map(|k| deepest(faces, position(k))).collect();
        for face in 0..faces.len() {
            let here: Vec<usize> = rows.iter().copied().filter(|&k| likely[k] == Some(face)).collect();
            fill(&mut by, &mut sealed, &place, &here);
        }
        sealed
    }

    /// Anything may lie on a triangle.
    fn may_seal(&self, solids: Solids<'_>, triangle: u32) -> bool {
        !self.is_nowhere() && !solids.tracer.scene().material(triangle).double_sided
    }

    /// The triangle that lies on a point.
    fn by(&self, solids: Solids<'_>, ground: &Ground, point: SurfacePoint) -> Option<u32> {
        if let Self::In(faces) = self {
            let position = solids.tracer.scene().position(point.triangle, point.b);
            faces.iter().any(|face| face.holds(position).is_some()).then_some(())?;
        }
        solids.sealed_by(ground, point)
    }
}

/// Of those that may lie on a point, the one farthest inside of which it is.
fn deepest(faces: &[Face], point: Vec3) -> Option<usize> {
    let holding = faces.iter().enumerate().filter_map(|(k, face)| Some((k, face.holds(point)?)));
    holding.reduce(|best, next| if next.1 > best.1 { next } else { best }).map(|(k, _)| k)
}

/// Points by rows, then columns.
fn in_rows(n: usize, place: impl Fn(usize) -> DVec2) -> Vec<usize> {
    let mut points: Vec<usize> = (0..n).collect();
    points.sort_by(|&a, &b| {
        let (a, b) = (place(a), place(b));
        a.y.total_cmp(&b.y).then(a.x.total_cmp(&b.x))
    });
    points
}

/// Sets which triangle lies on each of some points, by rows.
fn fill(
    by: &mut impl FnMut(usize) -> Option<u32>,
    sealed: &mut [Option<u32>],
    place: &impl Fn(usize) -> DVec2,
    points: &[usize],
) {
    let each = |sealed: &mut [Option<u32>], by: &mut dyn FnMut(usize) -> Option<u32>| {
        points.iter().for_each(|&k| sealed[k] = by(k));
    };
    if points.len() <= FEW {
        return each(sealed, by);
    }
    let hull = hull(place, points);
    let one = hull.first().and_then(|&k| by(k));
    if one.is_some() && hull.iter().all(|&k| by(k) == one) {
        return each(sealed, &mut |_| one);
    }
    let spread = |axis: usize| {
        let along = |[low, high]: [f64; 2], k: &usize| [low.min(place(*k)[axis]), high.max(place(*k)[axis])];
        points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], along)
    };
    let [columns, rows] = [spread(0), spread(1)];
    let (axis, [low, high]) = if columns[1] - columns[0] > rows[1] - rows[0] { (0, columns) } else { (1, rows) };
    let (near, far): (Vec<usize>, Vec<usize>) = points.iter().partition(|k| place(**k)[axis] < 0.5 * (low + high));
    if near.is_empty() || far.is_empty() {
        return each(sealed, by);
    }
    fill(by, sealed, place, &near);
    fill(by, sealed, place, &far);
}

/// Those of some points, by rows, that have all others between them: A. M. Andrew, "Another efficient algorithm for convex
/// hulls in two dimensions", Information Processing Letters 9(5), 1979.
fn hull(place: &impl Fn(usize) -> DVec2, points: &[usize]) -> Vec<usize> {
    let chain = |points: &mut dyn Iterator<Item = usize>| {
        let mut chain: Vec<usize> = vec![];
        for k in points {
            while let [.., a, b] = chain[..]
                && (place(b) - place(a)).perp_dot(place(k) - place(a)) <= 0.0
            {
                chain.pop();
            }
            chain.push(k);
        }
        chain.pop();
        chain
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(place: &impl Fn(usize) -> DVec2, cover: impl Fn(DVec2) -> Option<u32>, n: usize) -> (Vec<bool>, usize) {
        let (mut asked, mut sealed) = (0, vec![None; n]);
        let mut by = |k: usize| {
            asked += 1;
            cover(place(k))
        };
        fill(&mut by, &mut sealed, place, &in_rows(n, place));
        (sealed.iter().map(Option::is_some).collect(), asked)
    }

    #[test]
    fn cells_are_filled_as_points_one_by_one() {
        // Two triangles along a diagonal, a hole in one of them, and nothing.
        let covers: [fn(DVec2) -> Option<u32>; 4] = [
            |p| Some(u32::from(p.x > p.y)),
            |p| (p.x + 2.0 * p.y < 9.0).then_some(7),
            |p| (p.x == 3.0).then_some(1),
            |_| None,
        ];
        let place = |k: usize| DVec2::new((k % 8) as f64, (k / 8) as f64);
        for cover in covers {
            let wanted: Vec<bool> = (0..64).map(|k| cover(place(k)).is_some()).collect();
            assert_eq!(points(&place, cover, 64).0, wanted);
        }
        let (_, asked) = points(&place, |_| Some(5), 64);
        assert!(asked <= 9, "{asked} questions");
    }

    proptest! {
        #[test]
        fn a_half_plane_seals_what_it_covers(at in prop::collection::vec((0.0f64..1.0, 0.0f64..1.0), 0..64), x in -1.0f64..1.0, y in -1.0f64..1.0) {
            let cover = |p: DVec2| (p.x * x + p.y * y > 0.3 * x).then_some(3);
            let place = |k: usize| DVec2::from(at[k]);
            let wanted: Vec<bool> = (0..at.len()).map(|k| cover(place(k)).is_some()).collect();
            prop_assert_eq!(points(&place, cover, at.len()).0, wanted);
        }
    }
}
