//! Where borders of charts meet in space: of one mesh, or of two that abut, also where their vertices do not.
//!
//! In: borders, and the hierarchies that rays use. Out: for a point of one border, those that pass through it. The
//! triangles around a stretch of points are found by a box, wider than it by the distance at which two places are one.
//!
//! Invariant: borders come in the order of their triangles.

use super::border::Borders;
use super::border::Edge;
use crate::trace::Tracer;
use glam::DVec3;

/// Distance of places that are one, in texel edges: modular pieces are placed by hand.
const NEAR: f64 = 0.01;
/// The same in parts of the largest coordinate: a few rounding steps of an `f32`.
const ROUNDING: f64 = 3e-7;
/// Most distance of places that are one, in median texel edges: texels that are torn apart are everywhere.
const MOST: f64 = 4.0;
/// The same in parts of the largest coordinate: texels as large as the scene do not make one of all its places.
const MOST_OF_ALL: f64 = 1e-3;
/// Borders beside a stretch from which on it is no seam but a knot.
const CROWD: usize = 4096;

/// Finds them.
pub(super) struct Meeting<'a> {
    borders: &'a Borders<'a>,
    /// Of surfaces that cast light and, if there are some that do not, of all.
    tracer: &'a Tracer<'a>,
    rounding: f64,
    most: f64,
}

impl<'a> Meeting<'a> {
    /// The tracer must have all surfaces with charts.
    pub(super) fn new(borders: &'a Borders<'a>, tracer: &'a Tracer<'a>) -> Self {
        let (low, high) = tracer.bounds();
        let reach = f64::from(low.abs().max(high.abs()).max_element());
        Self { borders, tracer, rounding: ROUNDING * reach, most: (MOST * borders.texel).min(MOST_OF_ALL * reach) }
    }

    /// How far apart two places may be that are one, beside an edge [m].
    fn near(&self, edge: &Edge) -> f64 {
        (NEAR * edge.texel()).min(self.most).max(self.rounding)
    }

    /// Edges that may pass through points of a stretch of edge `own`, but for that one.
    pub(super) fn beside(&self, own: &Edge, [from, to]: [DVec3; 2]) -> Vec<Edge> {
        let near = self.near(own);
        let (low, high) = (from.min(to) - near, from.max(to) + near);
        let meets = |edge: &Edge| {
            let [a, b] = edge.ends;
            edge.id() != own.id() && a.min(b).cmple(high).all() && a.max(b).cmpge(low).all()
        };
        let mut found: Vec<Edge> = vec![];
        self.tracer.any_within(low.as_vec3(), high.as_vec3(), |triangle| {
            found.extend(self.borders.edges_of(triangle).filter(meets));
            found.len() >= CROWD
        });
        found.sort_unstable_by_key(Edge::id);
        found
    }

    /// Those of them that pass through a point of edge `own`, with the part of their way at which it lies.
    pub(super) fn through(&self, others: &[Edge], own: &Edge, p: DVec3) -> Vec<(Edge, f32)> {
        let near = self.near(own);
        others.iter().filter_map(|edge| Some((*edge, self.on(edge, near, p)?))).collect()
    }

    /// Part of the way along an edge at which it passes a point that is as near as `near`.
    fn on(&self, edge: &Edge, near: f64, p: DVec3) -> Option<f32> {
        let [a, b] = edge.ends;
        let along = b - a;
        let t = (p - a).dot(along) / along.length_squared();
        let near = self.near(edge).min(near);
        ((0.0..=1.0).contains(&t) && (a + along * t).distance(p) <= near).then_some(t as f32)
    }
}
