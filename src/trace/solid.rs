//! Whether a ray leaves a solid that it began in: somewhere on its way it has met more backs than fronts.
//!
//! In: [`Tracer`] and a ray. Out: yes or no. Where solids go through each other, as walls do at the corners of a room, the
//! nearest hit alone does not say that a point lies in one of them.
//!
//! What lies behind does not matter: the walls of a room around a solid show their fronts to a ray that has left the solid.
//! Double-sided and transparent surfaces do not count: they bound no solid. Where a back lies on a front, a wall may stand
//! on a floor, and the ray began in the wall; or two rooms lie wall to wall, and it began in one of them.
//!
//! A sheet that goes through a solid, as the ground does through a wall, hides that a ray leaves it. What closed surfaces
//! say is said whatever the sheets do: walls that go into the ground sent rays through it, so 6 of 8 said nothing, and a
//! millimetre from such walls 6 % of the light outside was seen inside.
//!
//! Triangles that are there twice, once for each side, do not count: they are sheets with two sides.
//!
//! Limits: of solids that are not closed, a sheet hides what it goes through.

use super::{Closed, Ray, Ray3, Tracer};
use crate::scene::Scene;

/// Surfaces on the way of a ray from which on it says nothing: with a thousand faces in one plane, each of their texels
/// took 5 ms, and one texel of all of them 11 s.
const MOST: usize = 256;

/// Relative difference of distances up to which surfaces lie on each other, but for the rounding of their corners.
const TOGETHER: f32 = 16.0 * f32::EPSILON;

/// Triangles at one distance from which on they are not compared with each other.
pub(super) const MOST_TOGETHER: usize = 16;

impl Tracer<'_> {
    /// Of single-sided opaque surfaces with 0 < t < `t_max`, the nearest so many hold more backs than fronts, for some
    /// number of them. `None` if faces that lie on each other decide it, or for [`MOST`] of them and more. `Some(false)` for
    /// rays without direction.
    #[must_use]
    pub fn leaves_solid(&self, ray: &Ray, closed: &Closed) -> Option<bool> {
        let (mut met, around) = self.bounds_met(ray, closed)?;
        if around > 0 {
            return Some(true);
        }
        let fronts_first = leaves(&mut met, 1);
        let agree = leaves(&mut met, -1) == fronts_first || {
            // Both sides of a sheet change nothing where fronts come first.
            let sheets: Vec<u32> =
                met.chunk_by(|a, b| a.0 == b.0).flat_map(|level| sheets(self.scene, level)).collect();
            met.retain(|m| !sheets.contains(&m.2));
            leaves(&mut met, -1) == fronts_first
        };
        agree.then_some(fronts_first)
    }

    /// The same, but faces that lie on each other count together, so that walls between rooms and solids that touch change
    /// nothing: only the outermost ones tell which they are. `None` for [`MOST`] surfaces and more.
    #[must_use]
    pub fn leaves_solids_together(&self, ray: &Ray, closed: &Closed) -> Option<bool> {
        let (mut met, around) = self.bounds_met(ray, closed)?;
        met.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut sum = 0;
        let levels = met.chunk_by(|a, b| b.0 - a.0 <= TOGETHER * b.0);
        Some(
            around > 0
                || levels.map(|level| level.iter().map(|m| m.1).sum::<i32>()).any(|side| {
                    sum += side;
                    sum > 0
                }),
        )
    }

    /// The single-sided opaque surfaces on the way of a ray, and how many more backs than fronts of closed ones.
    fn bounds_met(&self, ray: &Ray, closed: &Closed) -> Option<(Vec<Met>, i32)> {
        let (mut met, mut around) = (vec![], 0);
        self.each_crossed(&Ray3::from(ray), |c| {
            if !c.transparent && !self.scene.material(c.triangle).is_two_sided() {
                let side = if c.front { -1 } else { 1 };
                around += if closed.holds(c.triangle) { side } else { 0 };
                met.push((c.t, side, c.triangle));
            }
            met.len() < MOST
        });
        (met.len() < MOST).then_some((met, around))
    }
}

/// What a ray meets: distance, +1 for a back and −1 for a front, triangle.
type Met = (f32, i32, u32);

/// Some number of the nearest hold more backs than fronts; at equal distances fronts come first if `order` is 1, backs if it
/// is −1.
fn leaves(met: &mut [Met], order: i32) -> bool {
    met.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((order * a.1).cmp(&(order * b.1))));
    let mut sum = 0;
    met.iter().any(|(_, side, _)| {
        sum += side;
        sum > 0
    })
}

/// Of a few triangles at one distance, those of which both sides are there.
fn sheets(scene: &Scene, level: &[Met]) -> Vec<u32> {
    if level.len() < 2 || level.len() > MOST_TOGETHER {
        return vec![];
    }
    let has_other = |a: &&Met| level.iter().any(|b| a.1 != b.1 && are_sides(scene, a.2, b.2));
    level.iter().filter(has_other).map(|a| a.2).collect()
}

/// Two triangles are the same but for the side that is their front: a sheet with two sides, not two solids face to face.
pub(super) fn are_sides(scene: &Scene, a: u32, b: u32) -> bool {
    let ([p, q, r], other) = (scene.corners(a), scene.corners(b));
    [[p, r, q], [q, p, r], [r, q, p]].contains(&other)
}
