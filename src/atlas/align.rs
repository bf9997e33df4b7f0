//! Turns a chart so that its long straight edges follow texel rows, and lays it on its longer side.
//!
//! If most of the outline runs in one direction and at right angles to it (walls, floors, also with windows and
//! niches), that direction becomes a row. Otherwise the chart gets the orientation of its smallest bounding rectangle,
//! one side of which lies on an edge of the convex hull.

use super::flatten::Flat;
use super::weld::Surface;
use glam::DVec2;
use std::sync::Arc;

/// Directions told apart within a right angle (0.25° each).
const BINS: usize = 360;

/// Share of the outline in one direction, from which on it counts as rectangular.
const RECTANGULAR: f64 = 0.5;

/// Charts that move as one block on a page: one chart made here, or the kept layout of a node or page. Nodes that place the same
/// meshes in the same size have a block each, all of one piece.
#[derive(Debug, Clone)]
pub(super) struct Piece {
    /// For each block, the parts whose charts it has, ascending; the piece was made of those of the first one.
    pub(super) owners: Arc<[Vec<u32>]>,
    /// For each chart, its part as an index into an entry of `owners`.
    pub(super) parts: Vec<u32>,
    /// Faces, with their charts, in the order of their parts.
    pub(super) faces: Vec<Face>,
    /// Flat position of each corner [m], times the density factor of the part; positive areas for charts made here.
    pub(super) corners: Vec<[DVec2; 3]>,
    /// Of a kept `TEXCOORD_1`, the sides of its page in the units of `corners`, which count from the page's first corner:
    /// it is not cut, and keeps its place on the grid of texels. `None` for charts made here.
    pub(super) page: Option<DVec2>,
}

impl Piece {
    /// Number of blocks.
    pub(super) fn copies(&self) -> usize {
        self.owners.len()
    }

    /// With lengths `scale` times as large: by density, or of a larger copy.
    pub(super) fn scaled(mut self, scale: f64) -> Self {
        self.corners.iter_mut().flatten().chain(&mut self.page).for_each(|p| *p *= scale);
        self
    }

    /// The same charts of other parts.
    pub(super) fn of(self, owners: &Arc<[Vec<u32>]>) -> Self {
        Self { owners: Arc::clone(owners), ..self }
    }
}

/// A triangle of a piece.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    /// Index into an entry of `Piece::owners`.
    pub(super) part: u32,
    /// Triangle within the part.
    pub(super) triangle: u32,
    /// Index into `Piece::parts`.
    pub(super) chart: u32,
}

/// The chart as a piece, turned to the texel rows; each of `owners` is one part.
pub(super) fn piece(surface: &Surface, flat: &Flat, owners: &Arc<[Vec<u32>]>) -> Piece {
    let outline = outline(surface, flat);
    let direction = dominant_direction(&outline).unwrap_or_else(|| {
        let points: Vec<DVec2> = outline.iter().flatten().copied().collect();
        smallest_rectangle(&hull(points))
    });
    let normal = direction.perp();
    let turn = |p: DVec2| DVec2::new(p.dot(direction), p.dot(normal));
    let mut corners: Vec<[DVec2; 3]> = flat.corners.iter().map(|c| c.map(turn)).collect();
    let low = corners.iter().flatten().fold(DVec2::INFINITY, |a, p| a.min(*p));
    let high = corners.iter().flatten().fold(DVec2::NEG_INFINITY, |a, p| a.max(*p));
    let extent = high - low;
    for p in corners.iter_mut().flatten() {
        *p -= low;
        if extent.y > extent.x {
            *p = DVec2::new(p.y, extent.x - p.x);
        }
    }
    let faces = flat.faces.iter().map(|f| Face { part: 0, triangle: *f, chart: 0 }).collect();
    Piece { owners: Arc::clone(owners), parts: vec![0], faces, corners, page: None }
}

/// Edges of the chart that no second face of it uses.
fn outline(surface: &Surface, flat: &Flat) -> Vec<[DVec2; 2]> {
    let mut edges: Vec<(u32, u32, usize, usize)> = Vec::with_capacity(flat.faces.len() * 3);
    for (i, f) in flat.faces.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = surface.edge(*f, k);
            edges.push((a.min(b), a.max(b), i, k));
        }
    }
    edges.sort_unstable();
    edges
        .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .filter(|group| group.len() == 1)
        .map(|group| {
            let (_, _, i, k) = group[0];
            [flat.corners[i][k], flat.corners[i][(k + 1) % 3]]
        })
        .collect()
}

/// Unit vector along which, or across which, most of the outline runs, if there is one.
fn dominant_direction(outline: &[[DVec2; 2]]) -> Option<DVec2> {
    let mut lengths = [0.0; BINS];
    let mut longest: [(f64, DVec2); BINS] = [(0.0, DVec2::X); BINS];
    let mut total = 0.0;
    for [a, b] in outline {
        let edge = *b - *a;
        let length = edge.length();
        if length <= 0.0 {
            continue;
        }
        let angle = libm::atan2(edge.y, edge.x).rem_euclid(core::f64::consts::FRAC_PI_2);
        let bin = ((angle / core::f64::consts::FRAC_PI_2 * BINS as f64).round() as usize) % BINS;
        lengths[bin] += length;
        total += length;
        if length > longest[bin].0 {
            longest[bin] = (length, edge / length);
        }
    }
    let share = |bin: usize| lengths[bin] + lengths[(bin + 1) % BINS] + lengths[(bin + BINS - 1) % BINS];
    let best = (0..BINS).fold(0, |best, bin| if lengths[bin] > lengths[best] { bin } else { best });
    (total > 0.0 && share(best) >= RECTANGULAR * total).then(|| longest[best].1)
}

/// Convex hull, counter-clockwise (Andrew's monotone chain).
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    let mut hull: Vec<DVec2> = Vec::new();
    for pass in 0..2 {
        let start = hull.len();
        for i in 0..points.len() {
            let p = if pass == 0 { points[i] } else { points[points.len() - 1 - i] };
            while hull.len() >= start + 2 {
                let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
                if (b - a).perp_dot(p - b) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
    }
    hull
}

/// Direction of a side of the smallest rectangle around a convex polygon.
fn smallest_rectangle(hull: &[DVec2]) -> DVec2 {
    let mut best = (f64::INFINITY, DVec2::X);
    for i in 0..hull.len() {
        let direction = (hull[(i + 1) % hull.len()] - hull[i]).normalize_or_zero();
        if direction == DVec2::ZERO {
            continue;
        }
        let turned = hull.iter().map(|p| DVec2::new(p.dot(direction), p.perp_dot(direction)));
        let (low, high) =
            turned.fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        let area = (high - low).element_product();
        if area < best.0 {
            best = (area, direction);
        }
    }
    best.1
}
