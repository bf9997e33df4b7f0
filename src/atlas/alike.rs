//! Which parts are copies of one mesh in one shape, turned, moved and scaled as a whole: they are charted once.
//!
//! In: a scene whose geometry is shared (`Scene::copied`). Out: for each part the first one that is like it, and how many
//! times as large it is.
//!
//! Two placements M and N of a mesh make the same shape if `MᵀM` and `NᵀN` are in proportion and both or none of them
//! mirror. Stretches that differ by less than half of [`SAME`] count as one: a chart's density is off by that share, far
//! below what xatlas spends on flattening a curved piece.
//!
//! Invariant: a part that comes first is like itself; the result depends on the order of parts alone.

use crate::scene::{Placement, Scene};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

/// Triangles of copies from which on they are compared. Below, charting takes little time, and every copy is charted where
/// it stands, so that it makes no difference whether geometry is shared.
const WORTH: usize = 1 << 20;
/// Largest difference of `MᵀM`, over its size.
const SAME: f64 = 0.01;
/// Shapes of a mesh that a placement is compared with. More would cost time where thousands differ, as trees do that are
/// stretched at random.
const MOST_SHAPES: usize = 256;

/// Another part that a part is like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Like {
    /// Index into `Scene::parts`.
    pub(super) part: usize,
    /// Lengths of this part over those of the other.
    pub(super) ratio: f64,
}

/// A shape that was met first at a part.
struct Shape {
    part: usize,
    metric: DMat3,
    size: f64,
}

/// One entry per part: what it is like, `None` if it is the first of its shape or not charted (`is_charted`).
pub(super) fn find(scene: &Scene, is_charted: impl Fn(usize) -> bool) -> Vec<Option<Like>> {
    let mut like = vec![None; scene.parts.len()];
    let copied = scene.copied().filter(|copy| is_charted(copy.part));
    let triangles: usize = copied.map(|copy| scene.parts[copy.part].triangles.len()).sum();
    // Cuts are made in the world, each where something else stands.
    if triangles < WORTH || !scene.cuts.borders.is_empty() {
        return like;
    }
    let mut known: BTreeMap<(u32, usize, bool), Vec<Shape>> = BTreeMap::new();
    for copy in scene.copied().filter(|copy| is_charted(copy.part)) {
        let Some((metric, size)) = shape(copy.placement) else { continue };
        let part = copy.part;
        let key = (copy.stored, scene.parts[part].triangles.len(), copy.placement.mirrored);
        let shapes = known.entry(key).or_default();
        match shapes.iter().find(|shape| distance(&shape.metric, &metric) <= SAME) {
            Some(shape) => like[part] = Some(Like { part: shape.part, ratio: size / shape.size }),
            None if shapes.len() < MOST_SHAPES => shapes.push(Shape { part, metric, size }),
            None => {}
        }
    }
    like
}

/// `MᵀM` of a unit volume, and the edge of the cube that a unit cube has become as large as.
fn shape(placement: &Placement) -> Option<(DMat3, f64)> {
    let m = DMat3::from_mat4(placement.world);
    let size = libm::cbrt(m.determinant().abs());
    let metric = m.transpose() * m * (size * size).recip();
    (size > 0.0 && metric.is_finite()).then_some((metric, size))
}

/// Largest entry of the difference.
fn distance(a: &DMat3, b: &DMat3) -> f64 {
    let columns = [a.x_axis - b.x_axis, a.y_axis - b.y_axis, a.z_axis - b.z_axis];
    columns.into_iter().map(DVec3::abs).fold(0.0, |most, column| most.max(column.max_element()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat4, DQuat};

    fn of(world: DMat4) -> (DMat3, f64) {
        shape(&Placement::new(world)).unwrap()
    }

    #[test]
    fn turned_moved_and_scaled_is_the_same_shape_and_stretched_is_not() {
        let stretch = DMat4::from_scale(DVec3::new(1.0, 1.3, 1.0));
        let turn = DMat4::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -2.0));
        let (first, size) = of(stretch);
        let (turned, larger) =
            of(DMat4::from_translation(DVec3::splat(7.0)) * turn * stretch * DMat4::from_scale(DVec3::splat(2.0)));
        assert!(distance(&first, &turned) < 1e-12 && (larger / size - 2.0).abs() < 1e-12);
        // The mesh lies down first, so it is longer in another direction.
        assert!(distance(&first, &of(stretch * turn).0) > 0.1);
        assert!(distance(&first, &of(DMat4::from_scale(DVec3::new(1.0, 1.32, 1.0))).0) > SAME);
    }
}
