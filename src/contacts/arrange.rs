//! A triangle with lines on it → smaller triangles whose sides follow the lines.
//!
//! Points are corners, the points that the triangle's edges have for all their triangles, ends and crossings of lines.
//! What is nearer to another point or to a line than the tolerance becomes one with it, so that no needles arise. Points
//! are whole numbers of steps of the triangle's weights, so those on edges lie there exactly. The triangulation is
//! constrained Delaunay (crate `spade`: exact predicates), in weights, not in metres: its angles are not the best.
//!
//! Invariants: the triangles fill the source triangle, wound as it is; every point of an edge is a corner of them.

use super::Segment;
use super::mesh::{EdgePoint, EdgePoints, GRID, Mesh};
use super::plane::{along, weights};
use glam::DVec2;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation};
use std::collections::BTreeSet;

/// Lines on one triangle up to which those that continue each other are made one: the search is quadratic.
const MOST_MERGED: usize = 2000;

/// What becomes of a triangle.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shape {
    /// Weights of the source's corners, in steps; the three corners come first.
    pub(super) points: Vec<[u32; 3]>,
    /// Points of each triangle; the source's own where only its border is one.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Pairs of points between which charts end.
    pub(super) borders: Vec<[u32; 2]>,
}

/// Lines with those made one that lie on each other or continue each other.
pub(super) fn merged(lines: &[Segment], tolerance: f64) -> Vec<Segment> {
    if lines.len() > MOST_MERGED {
        return lines.to_vec();
    }
    let mut open = lines.to_vec();
    // Long lines say best where they all lie.
    open.sort_by(|p, q| q[0].distance(q[1]).total_cmp(&p[0].distance(p[1])));
    let mut done: Vec<Segment> = vec![];
    for line in open {
        let mut line = line;
        while let Some(k) = done.iter().position(|other| joins(other, &line, tolerance)) {
            line = union(&done.swap_remove(k), &line);
        }
        done.push(line);
    }
    done
}

fn joins(long: &Segment, line: &Segment, tolerance: f64) -> bool {
    let (base, other) =
        if long[0].distance(long[1]) >= line[0].distance(line[1]) { (long, line) } else { (line, long) };
    let [(s, d), (t, e)] = other.map(|p| along(*base, p));
    let slack = tolerance / base[0].distance(base[1]);
    d <= tolerance && e <= tolerance && s.min(t) <= 1.0 + slack && s.max(t) >= -slack
}

/// From the first to the last of the four ends.
fn union(a: &Segment, b: &Segment) -> Segment {
    let base = if a[0].distance(a[1]) >= b[0].distance(b[1]) { *a } else { *b };
    let mut ends = [a[0], a[1], b[0], b[1]];
    ends.sort_by(|p, q| along(base, *p).0.total_cmp(&along(base, *q).0));
    [ends[0], ends[3]]
}

/// A point of the arrangement.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    /// In the plane [m].
    at: DVec2,
    /// Weights in steps.
    steps: [u32; 3],
}

impl Node {
    /// On a side, some steps from its first corner.
    fn on_side(flat: [DVec2; 3], side: usize, from: u32) -> Self {
        let mut steps = [0; 3];
        (steps[side], steps[(side + 1) % 3]) = (GRID - from, from);
        Self { at: flat[side].lerp(flat[(side + 1) % 3], f64::from(from) / f64::from(GRID)), steps }
    }
}

/// The points of one triangle.
struct Nodes {
    flat: [DVec2; 3],
    tolerance: f64,
    all: Vec<Node>,
}

impl Nodes {
    /// Corners, and points on edges that are there already.
    fn new(flat: [DVec2; 3], tolerance: f64, on_sides: [&[u32]; 3]) -> Self {
        let corner = |k: usize| {
            let mut steps = [0; 3];
            steps[k] = GRID;
            Node { at: flat[k], steps }
        };
        let mut all: Vec<Node> = (0..3).map(corner).collect();
        for (side, points) in on_sides.into_iter().enumerate() {
            all.extend(points.iter().map(|&from| Node::on_side(flat, side, from)));
        }
        Self { flat, tolerance, all }
    }

    fn nearest(&self, p: DVec2, which: impl Fn(&Node) -> bool) -> Option<(usize, f64)> {
        let near = |(k, n): (usize, &Node)| (k, n.at.distance(p));
        self.all.iter().enumerate().filter(|(_, n)| which(n)).map(near).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The number of a point, new if none is near. With `fixed`, edges have all their points.
    fn add(&mut self, p: DVec2, fixed: bool) -> usize {
        let near = |found: Option<(usize, f64)>| found.filter(|(_, d)| *d <= self.tolerance).map(|(k, _)| k);
        if let Some(corner) = near(self.nearest(p, |n| n.steps.contains(&GRID))) {
            return corner;
        }
        let lines = [0, 1, 2].map(|k| along([self.flat[k], self.flat[(k + 1) % 3]], p));
        let side = (0..3).filter(|&k| lines[k].1 <= self.tolerance).min_by(|&a, &b| lines[a].1.total_cmp(&lines[b].1));
        if let Some(side) = side {
            // Clipped lines may end a little beyond a sharp corner, so the foot counts.
            let opposite = (side + 2) % 3;
            let foot = self.flat[side].lerp(self.flat[(side + 1) % 3], lines[side].0.clamp(0.0, 1.0));
            let own = self.nearest(foot, |n| n.steps[opposite] == 0);
            let from = (lines[side].0 * f64::from(GRID)).round().clamp(1.0, f64::from(GRID - 1)) as u32;
            return match own {
                Some((k, distance)) if fixed || distance <= self.tolerance => k,
                _ => self.push(Node::on_side(self.flat, side, from)),
            };
        }
        if let Some(known) = near(self.nearest(p, |_| true)) {
            return known;
        }
        let most = f64::from(GRID - 2);
        let [_, w1, w2] = weights(self.flat, p).map(|w| (w * f64::from(GRID)).round().clamp(1.0, most) as u32);
        let w2 = w2.min(GRID - 1 - w1.min(GRID - 2));
        self.push(Node { at: p, steps: [GRID - w1 - w2, w1, w2] })
    }

    fn push(&mut self, node: Node) -> usize {
        if let Some(same) = self.all.iter().position(|n| n.steps == node.steps) {
            return same;
        }
        self.all.push(node);
        self.all.len() - 1
    }

    /// Numbers of the points along a line between two of them: pairs of neighbours.
    fn chain(&self, from: usize, to: usize) -> Vec<[usize; 2]> {
        let base = [self.all[from].at, self.all[to].at];
        let slack = self.tolerance / base[0].distance(base[1]).max(f64::MIN_POSITIVE);
        let mut on: Vec<(f64, usize)> = vec![(f64::NEG_INFINITY, from), (f64::INFINITY, to)];
        for (k, node) in self.all.iter().enumerate() {
            let (t, distance) = along(base, node.at);
            if k != from && k != to && distance <= self.tolerance && t > -slack && t < 1.0 + slack {
                on.push((t, k));
            }
        }
        on.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        on.windows(2).map(|pair| [pair[0].1, pair[1].1]).collect()
    }

    /// A side that two points lie on.
    fn side_of(&self, pair: [usize; 2]) -> Option<usize> {
        (0..3).find(|&side| pair.iter().all(|&k| self.all[k].steps[(side + 2) % 3] == 0))
    }
}

/// Ends and crossings of lines.
fn marks(lines: &[Segment]) -> Vec<DVec2> {
    let mut marks: Vec<DVec2> = lines.iter().flatten().copied().collect();
    for (k, [a, b]) in lines.iter().enumerate() {
        for [c, d] in &lines[k + 1..] {
            let (u, v) = (*b - *a, *d - *c);
            let area = u.perp_dot(v);
            let (s, t) = ((*c - *a).perp_dot(v) / area, (*c - *a).perp_dot(u) / area);
            if s > 0.0 && s < 1.0 && t > 0.0 && t < 1.0 {
                marks.push(*a + u * s);
            }
        }
    }
    marks
}

/// Points that the lines on a triangle make on its edges.
pub(super) fn edge_points(mesh: &Mesh<'_>, triangle: u32, lines: &[Segment], tolerance: f64) -> Vec<EdgePoint> {
    if lines.is_empty() {
        return vec![];
    }
    let Some((plane, flat)) = mesh.flat(triangle) else { return vec![] };
    let goes_on = [0, 1, 2].map(|side| mesh.goes_on(triangle, side, plane.normal).next().is_some());
    let mut nodes = Nodes::new(flat, tolerance, [&[]; 3]);
    let mut needed = vec![];
    let ends: Vec<[usize; 2]> = lines.iter().map(|line| line.map(|p| nodes.add(p, false))).collect();
    for pair in ends {
        // Along the border of the surface nothing needs to be cut.
        if nodes.side_of(pair).is_none_or(|side| goes_on[side]) {
            needed.extend(pair);
        }
    }
    for mark in marks(lines).into_iter().skip(2 * lines.len()) {
        needed.push(nodes.add(mark, false));
    }
    let mut out = vec![];
    for k in needed {
        let steps = nodes.all[k].steps;
        let side = (0..3).find(|&side| steps[(side + 2) % 3] == 0 && steps[side] > 0 && steps[(side + 1) % 3] > 0);
        if let Some(side) = side {
            let ([a, b], from) = (mesh.ends(triangle, side), steps[(side + 1) % 3]);
            if a != b {
                out.push(if a < b { (a, b, from) } else { (b, a, GRID - from) });
            }
        }
    }
    out
}

/// What becomes of a triangle with lines on it and points on its edges; `None` where it stays as it is.
pub(super) fn shape(
    mesh: &Mesh<'_>,
    points: &EdgePoints,
    triangle: u32,
    lines: &[Segment],
    tolerance: f64,
) -> Option<Shape> {
    if !mesh.is_cut(triangle) {
        return None;
    }
    let on_sides = [0, 1, 2].map(|side| points.on(mesh, triangle, side));
    if lines.is_empty() && on_sides.iter().all(Vec::is_empty) {
        return None;
    }
    let (plane, flat) = mesh.flat(triangle)?;
    let mut nodes = Nodes::new(flat, tolerance, [0, 1, 2].map(|k| on_sides[k].as_slice()));
    let ends: Vec<[usize; 2]> = lines.iter().map(|line| line.map(|p| nodes.add(p, true))).collect();
    marks(lines).into_iter().skip(2 * lines.len()).for_each(|mark| {
        nodes.add(mark, true);
    });
    let goes_on = [0, 1, 2].map(|side| mesh.goes_on(triangle, side, plane.normal).next().is_some());
    let mut pairs: BTreeSet<[usize; 2]> = BTreeSet::new();
    for [from, to] in ends.into_iter().filter(|[from, to]| from != to) {
        for [a, b] in nodes.chain(from, to) {
            if nodes.side_of([a, b]).is_none_or(|side| goes_on[side]) {
                pairs.insert([a.min(b), a.max(b)]);
            }
        }
    }
    if pairs.is_empty() && nodes.all.len() == 3 {
        return None;
    }
    Some(triangulated(&nodes, &pairs))
}

fn triangulated(nodes: &Nodes, pairs: &BTreeSet<[usize; 2]>) -> Shape {
    let points: Vec<[u32; 3]> = nodes.all.iter().map(|n| n.steps).collect();
    let (mut triangles, mut borders) = (vec![], vec![]);
    let mut net: ConstrainedDelaunayTriangulation<Point2<f64>> = ConstrainedDelaunayTriangulation::new();
    // Steps are whole numbers in range, so every point is accepted, at its own place.
    let handles: Vec<_> = points.iter().map(|p| net.insert(Point2::new(f64::from(p[1]), f64::from(p[2])))).collect();
    let handles: Vec<_> = handles.into_iter().flatten().collect();
    if handles.len() == points.len() {
        for &[a, b] in pairs {
            // Rounding may have made two lines cross that met; the one that comes later ends there.
            net.try_add_constraint(handles[a], handles[b]);
        }
        let number = |vertex: usize| vertex as u32;
        for face in net.inner_faces() {
            triangles.push(face.vertices().map(|v| number(v.fix().index())));
        }
        for edge in net.undirected_edges().filter(|e| e.is_constraint_edge()) {
            let [a, b] = edge.vertices().map(|v| number(v.fix().index()));
            borders.push([a.min(b), a.max(b)]);
        }
    }
    if triangles.is_empty() {
        triangles.push([0, 1, 2]);
    }
    triangles.sort_unstable();
    borders.sort_unstable();
    Shape { points, triangles, borders }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOLERANCE: f64 = 1e-4;

    fn corners() -> [DVec2; 3] {
        [DVec2::ZERO, DVec2::new(2.0, 0.0), DVec2::new(0.0, 1.0)]
    }

    fn cut(lines: &[Segment]) -> Shape {
        let mut nodes = Nodes::new(corners(), TOLERANCE, [&[]; 3]);
        let ends: Vec<[usize; 2]> = lines.iter().map(|line| line.map(|p| nodes.add(p, false))).collect();
        marks(lines).into_iter().for_each(|p| {
            nodes.add(p, false);
        });
        let chains = ends.into_iter().filter(|[a, b]| a != b).flat_map(|[a, b]| nodes.chain(a, b));
        triangulated(&nodes, &chains.map(|[a, b]| [a.min(b), a.max(b)]).collect())
    }

    /// Twice the area in steps².
    fn area(shape: &Shape, t: &[u32; 3]) -> i64 {
        let [a, b, c] = t.map(|k| shape.points[k as usize].map(i64::from));
        (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    }

    #[test]
    fn the_pieces_fill_the_triangle_and_follow_the_lines() {
        let line = |a: [f64; 2], b: [f64; 2]| [DVec2::from_array(a), DVec2::from_array(b)];
        for lines in [
            vec![line([0.5, 0.0], [0.5, 0.75])],
            vec![line([0.3, 0.2], [0.9, 0.3]), line([0.6, 0.1], [0.61, 0.5])],
            vec![line([0.0, 0.3], [1.4, 0.3]), line([0.7, 0.0], [0.7, 0.65]), line([0.3, 0.3], [0.9, 0.3])],
            vec![line([0.5, 0.000_05], [1.5, 0.000_02]), line([0.2, 0.2], [0.2, 0.200_05])],
        ] {
            let shape = cut(&lines);
            let whole = i64::from(GRID) * i64::from(GRID);
            assert!(shape.triangles.iter().all(|t| area(&shape, t) > 0), "{lines:?}");
            assert_eq!(shape.triangles.iter().map(|t| area(&shape, t)).sum::<i64>(), whole, "{lines:?}");
            assert!(shape.points.iter().all(|p| p.iter().sum::<u32>() == GRID));
            let sides: BTreeSet<[u32; 2]> =
                shape.triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
            let is_side = |&[a, b]: &[u32; 2]| sides.contains(&[a, b]) || sides.contains(&[b, a]);
            assert!(shape.borders.iter().all(is_side), "{lines:?}");
        }
    }

    #[test]
    fn lines_that_continue_each_other_are_one() {
        let at = |x: f64, y: f64| DVec2::new(x, y);
        let lines = [[at(0.1, 0.2), at(0.4, 0.2)], [at(0.8, 0.2), at(0.4, 0.2)], [at(0.3, 0.200_05), at(0.5, 0.2)]];
        let one = merged(&lines, TOLERANCE);
        assert_eq!(one.len(), 1);
        assert!((one[0][0].distance(one[0][1]) - 0.7).abs() < 1e-9);
        assert_eq!(merged(&[[at(0.1, 0.2), at(0.4, 0.2)], [at(0.41, 0.2), at(0.5, 0.2)]], TOLERANCE).len(), 2);
    }
}
