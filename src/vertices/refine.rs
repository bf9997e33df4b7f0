//! Cuts the triangles that fit worst, without leaving a vertex on an edge that is not cut (T-junction).
//!
//! In: mesh, squared error by triangle. Out: the mesh with more triangles. The triangles that hold [`SHARE`] of the
//! squared error are marked; W. Dörfler, "A Convergent Adaptive Algorithm for Poisson's Equation", SIAM J. Numer. Anal.
//! 33, 1996, shows why this and not a threshold.
//!
//! Edges are cut in the middle, by place: all triangles at an edge are cut, whatever mesh they belong to. A triangle with
//! a cut edge has its longest edge cut as well, until nothing changes; then it is bisected by its longest edge first.
//! M.-C. Rivara, "Algorithms for refining triangular grids suitable for adaptive and multigrid techniques", IJNME 20,
//! 1984: angles never get smaller than half of what they were.
//!
//! Invariants: the surface and its light stay where they are; triangles that share an edge still share all of it.
//! Limits: triangles whose edges are all shorter than [`LEAST_EDGE`] are not cut, and at most [`MOST_ELEMENTS`] are made.

use super::mesh::Element;
use super::mesh::Mesh;
use super::mesh::Vertex;
use super::weld;
use crate::scene::Origin;
use std::collections::BTreeMap;
use std::collections::BTreeSet;

/// Part of the squared error whose triangles are cut. Larger: fewer rounds and more triangles for the same error.
const SHARE: f64 = 0.6;
/// Triangles that can be cut must hold this part of the squared error: less is not worth a round.
const LEAST_SHARE: f64 = 0.01;
/// Triangles with shorter edges only are not cut [texels]: between two texels the lightmap is linear. Not a least area:
/// the cord of a lamp is half a texel wide and 12 long, and held 90 % of a room's squared error.
const LEAST_EDGE: f64 = 1.0;
/// Triangles at which there are enough.
const MOST_ELEMENTS: usize = 8_000_000;

/// Edge between two places, the lower one first.
type Edge = [u32; 2];

/// Refines once; false if nothing could be cut.
pub(super) fn refine(mesh: &mut Mesh, errors: &[f64]) -> bool {
    if mesh.elements.len() >= MOST_ELEMENTS {
        return false;
    }
    let (place, _) = weld::places(&mesh.vertices);
    let edges =
        |e: &Element| [0, 1, 2].map(|k| edge(place[e.corners[k] as usize], place[e.corners[(k + 1) % 3] as usize]));
    let worst = worst(mesh, errors);
    if worst.is_empty() {
        return false;
    }
    let longest: Vec<usize> = mesh.elements.iter().map(|e| longest(mesh, e, &edges(e))).collect();
    let mut users: BTreeMap<Edge, Vec<u32>> = BTreeMap::new();
    for (k, element) in (0..).zip(&mesh.elements) {
        edges(element).into_iter().for_each(|edge| users.entry(edge).or_default().push(k));
    }
    let mut cut: BTreeSet<Edge> = BTreeSet::new();
    let mut open = worst;
    while let Some(k) = open.pop() {
        let own = edges(&mesh.elements[k as usize])[longest[k as usize]];
        if cut.insert(own) {
            open.extend(users[&own].iter().filter(|&&other| other != k));
        }
    }
    // Edges with a new end are none that were there before.
    let is_cut = |a: u32, b: u32| {
        let ends = place.get(a as usize).zip(place.get(b as usize));
        ends.is_some_and(|(&a, &b)| cut.contains(&edge(a, b)))
    };
    let mut cutter = Cutter { vertices: core::mem::take(&mut mesh.vertices), middles: BTreeMap::new() };
    let mut elements = Vec::with_capacity(mesh.elements.len() * 2);
    for ((k, element), &longest) in (0..).zip(&mesh.elements).zip(&longest) {
        cutter.cut(&Element { uncut: Some(k), ..*element }, longest, &is_cut, &mut elements);
    }
    let grown = elements.len() > mesh.elements.len();
    (mesh.vertices, mesh.elements) = (cutter.vertices, elements);
    grown
}

fn edge(a: u32, b: u32) -> Edge {
    [a.min(b), a.max(b)]
}

/// Triangles large enough to be cut that hold [`SHARE`] of the squared error of all such; none if that is next to
/// nothing.
fn worst(mesh: &Mesh, errors: &[f64]) -> Vec<u32> {
    let large = |e: &Element| e.is_charted() && e.longest_texels() >= LEAST_EDGE;
    let mut all: Vec<(f64, u32)> =
        (0..).zip(errors).filter(|(k, _)| large(&mesh.elements[*k as usize])).map(|(k, e)| (*e, k)).collect();
    all.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let can_go = all.iter().fold(0.0, |sum, (e, _)| sum + e);
    if can_go <= LEAST_SHARE * errors.iter().fold(0.0, |sum, e| sum + e) {
        return vec![];
    }
    let enough = SHARE * can_go;
    let mut sum = 0.0;
    let taken = all.into_iter().take_while(|(e, _)| {
        let more = sum < enough && *e > 0.0;
        sum += e;
        more
    });
    taken.map(|(_, k)| k).collect()
}

/// Number of the longest edge; of equal ones the one with the lowest places, so that both sides choose the same.
fn longest(mesh: &Mesh, element: &Element, edges: &[Edge; 3]) -> usize {
    let p = mesh.positions(element);
    // Rounding to single precision: neighbours of other meshes compute their positions a little differently.
    let length = |k: usize| p[k].distance_squared(p[(k + 1) % 3]) as f32;
    let mut best = 0;
    for k in 1..3 {
        let order = length(k).total_cmp(&length(best)).then(edges[best].cmp(&edges[k]));
        if order.is_gt() {
            best = k;
        }
    }
    best
}

/// Makes vertices in the middle of edges and triangles between them.
struct Cutter {
    vertices: Vec<Vertex>,
    /// Ends, by number of the vertex → the vertex between them.
    middles: BTreeMap<[u32; 2], u32>,
}

impl Cutter {
    /// Bisects a triangle by edge `first`, and the halves by the other edges that are cut.
    fn cut(&mut self, element: &Element, first: usize, is_cut: &impl Fn(u32, u32) -> bool, out: &mut Vec<Element>) {
        let corner = |k: usize| element.corners[(first + k) % 3];
        if !is_cut(corner(0), corner(1)) {
            out.push(*element);
            return;
        }
        let uv = |k: usize| element.uv[(first + k) % 3];
        let (middle, uv_middle) = (self.middle(corner(0), corner(1)), (uv(0) + uv(1)) * 0.5);
        let half = |corners, uv| Element { corners, uv, area: 0.5 * element.area, uncut: None, ..*element };
        let halves = [
            half([corner(2), corner(0), middle], [uv(2), uv(0), uv_middle]),
            half([corner(1), corner(2), middle], [uv(1), uv(2), uv_middle]),
        ];
        // What is left of the triangle's own edges comes first in both halves.
        halves.iter().for_each(|half| self.cut(half, 0, is_cut, out));
    }

    fn middle(&mut self, a: u32, b: u32) -> u32 {
        let next = self.vertices.len() as u32;
        let middle = *self.middles.entry(edge(a, b)).or_insert(next);
        if middle == next {
            let [p, q] = [a, b].map(|v| self.vertices[v as usize]);
            let normal = (p.normal + q.normal).normalize_or(p.normal);
            let (position, origin) = ((p.position + q.position) * 0.5, Origin::middle(&p.origin, &q.origin));
            self.vertices.push(Vertex { part: p.part, origin, position, normal });
        }
        middle
    }
}
