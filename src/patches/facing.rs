//! What lies on a texel face to face: the underside of a crate on the floor.
//!
//! In: triangles near a texel that face it. Out: which of its points another surface lies on.
//!
//! Where one triangle lies on the four corners of a rectangle of cells, it lies on all of them: it is convex, and its
//! distance is linear. So a texel below a wall is asked about four points, not sixty-four.

use super::SurfacePoint;
use super::cells::MASK_GRID;
use crate::trace::{Ground, Tracer};
use core::ops::Range;
use glam::Vec3;

/// Triangles up to which their boxes are kept.
const MOST_FACING: usize = 16;
const SIDE: usize = MASK_GRID as usize;

/// Where something may lie on a texel face to face.
pub(super) enum Facing {
    /// In boxes, from lowest to highest coordinates [m].
    In(Vec<[Vec3; 2]>),
    Anywhere,
}

impl Facing {
    /// Nothing lies on the texel.
    pub(super) fn is_nowhere(&self) -> bool {
        matches!(self, Self::In(boxes) if boxes.is_empty())
    }

    /// Adds a triangle; `pad` is a bound of rounding [m].
    pub(super) fn add(&mut self, corners: [Vec3; 3], pad: f32) {
        let [a, b, c] = corners;
        match self {
            Self::In(boxes) if boxes.len() < MOST_FACING => {
                boxes.push([a.min(b).min(c) - pad, a.max(b).max(c) + pad]);
            }
            _ => *self = Self::Anywhere,
        }
    }

    /// Another surface lies on a point of a single-sided one.
    pub(super) fn seals(&self, tracer: &Tracer<'_>, point: SurfacePoint) -> bool {
        let scene = tracer.scene();
        let ground = || Ground::new(scene.corners(point.triangle));
        self.may_seal(tracer, point.triangle) && self.by(tracer, &ground(), point).is_some()
    }

    /// [`Facing::seals`] for points of one triangle, row by row.
    pub(super) fn seal(&self, tracer: &Tracer<'_>, points: &[SurfacePoint]) -> Vec<bool> {
        let mut sealed = vec![false; points.len()];
        let Some(first) = points.first().filter(|point| self.may_seal(tracer, point.triangle)) else { return sealed };
        let ground = Ground::new(tracer.scene().corners(first.triangle));
        if points.len() < SIDE * SIDE {
            sealed.iter_mut().zip(points).for_each(|(s, point)| *s = self.by(tracer, &ground, *point).is_some());
            return sealed;
        }
        let mut known = vec![None; points.len()];
        let mut by = |k: usize| *known[k].get_or_insert_with(|| self.by(tracer, &ground, points[k]));
        fill(&mut by, &mut sealed, [0..SIDE, 0..SIDE]);
        sealed
    }

    /// Anything may lie on a triangle.
    fn may_seal(&self, tracer: &Tracer<'_>, triangle: u32) -> bool {
        !self.is_nowhere() && !tracer.scene().material(triangle).double_sided
    }

    /// The triangle that lies on a point.
    fn by(&self, tracer: &Tracer<'_>, ground: &Ground, point: SurfacePoint) -> Option<u32> {
        if let Self::In(boxes) = self {
            let position = tracer.scene().position(point.triangle, point.b);
            let holds = |[low, high]: &[Vec3; 2]| low.cmple(position).all() && high.cmpge(position).all();
            boxes.iter().any(holds).then_some(())?;
        }
        tracer.sealed_by(ground, point.triangle, point.b)
    }
}

/// Sets which cells of a rectangle of columns and rows are sealed, `by` which triangle.
fn fill(by: &mut impl FnMut(usize) -> Option<u32>, sealed: &mut [bool], [columns, rows]: [Range<usize>; 2]) {
    let corners = [
        (columns.start, rows.start),
        (columns.end - 1, rows.end - 1),
        (columns.end - 1, rows.start),
        (columns.start, rows.end - 1),
    ];
    let [first, ..] = corners.map(|(x, y)| y * SIDE + x);
    let one = by(first);
    let alike = one.is_some() && corners.into_iter().all(|(x, y)| by(y * SIDE + x) == one);
    if alike || columns.len() == 1 {
        for row in rows {
            sealed[row * SIDE..][columns.clone()].fill(one.is_some());
        }
        return;
    }
    let halves = |range: &Range<usize>| {
        let middle = usize::midpoint(range.start, range.end);
        [range.start..middle, middle..range.end]
    };
    for row in halves(&rows) {
        halves(&columns).into_iter().for_each(|column| fill(by, sealed, [column, row.clone()]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_are_filled_as_points_one_by_one() {
        // Two triangles along a diagonal, a hole in one of them, and nothing.
        let covers: [fn(usize, usize) -> Option<u32>; 4] = [
            |x, y| Some(u32::from(x > y)),
            |x, y| (x + 2 * y < 9).then_some(7),
            |x, _| (x == 3).then_some(1),
            |_, _| None,
        ];
        for cover in covers {
            let mut asked = 0;
            let mut sealed = vec![false; SIDE * SIDE];
            let mut by = |k: usize| {
                asked += 1;
                cover(k % SIDE, k / SIDE)
            };
            fill(&mut by, &mut sealed, [0..SIDE, 0..SIDE]);
            let wanted: Vec<bool> = (0..SIDE * SIDE).map(|k| cover(k % SIDE, k / SIDE).is_some()).collect();
            assert_eq!(sealed, wanted, "after {asked} questions");
        }
        let mut asked = 0;
        let mut all = |_: usize| {
            asked += 1;
            Some(5)
        };
        fill(&mut all, &mut [false; SIDE * SIDE], [0..SIDE, 0..SIDE]);
        assert!(asked <= 8, "{asked} questions");
    }
}
