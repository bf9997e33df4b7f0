//! Jumps of light where one surface goes on in another chart, within a mesh and between meshes.
//!
//! Two triangles of opposite sense that share an edge in space, and whose shading normals agree at both of its ends, get
//! the same light along it. Where their lightmap coordinates differ there, the two look-ups should still agree. They are
//! compared at points along the edge that are in sight, in the open on both sides, and see each other, so a wall that
//! stands on the seam takes it out.
//!
//! A step is seen as far as its narrower side is wide, up to a texel: beyond that, interpolation has smoothed it out. So
//! points count by that width, and bevels of a hundredth of a texel, which nobody sees, next to nothing.
//!
//! Limits: only whole edges are matched, not a long one with several short ones beside it.

use super::measure::{Kind, Measure, Tally};
use super::subject::Subject;
use crate::atlas::NO_CHART;
use crate::base::parallel;
use crate::patches::{HEIGHTS, SurfacePoint};
use crate::vertices;
use glam::{Vec2, Vec3};
use rayon::slice::ParallelSliceMut;

/// Cosine between shading normals that are the same: 0.8°. More would let the light differ by the limit.
const SAME_NORMAL: f32 = 0.9999;

/// Cosine between triangles beyond which an edge is a corner whatever its normals say: 75°.
const CORNER: f32 = 0.259;

/// Points per texel along an edge, and least and most per edge. Bakes make the sides agree at other points (`seams`): at
/// those, steps would be smaller than elsewhere.
const PER_TEXEL: f32 = 7.0;
const LEAST: usize = 3;
const MOST: usize = 2048;

/// Triangles at one edge beyond which it is no surface.
const CROWD: usize = 8;

/// How far from the edge the sight lines between both sides start, in texel edges.
const ASIDE: f32 = 0.1;

/// Distance from a texel at which a seam still runs along it [texels].
const BESIDE: f32 = 0.01;

/// Points are taken this far from their edge, so that they lie in their triangle: a share of the way to its middle.
const INSET: f32 = 1e-4;

/// An edge of a triangle: places of its ends, ascending; triangle; number of the edge in it.
type HalfEdge = ([u32; 2], u32, u32);

/// Widths of a side that are told apart [texels]; a seam beside a narrower one is not seen.
const WIDTHS: [f32; 4] = [1.0, 0.5, 0.25, 0.125];

/// Steps along all seams; the value is the 99.9th percentile over their length, times the width in which they are seen.
pub(super) fn measure(subject: &Subject<'_>, seams: &[Seam]) -> Measure {
    let limit = subject.settings.limit(Kind::SeamStep);
    let tallies = parallel::map_chunks(seams.len(), 16, |range| {
        let mut tally = Tally::default();
        for seam in &seams[range] {
            walk(subject, seam, limit, &mut tally);
        }
        tally
    });
    let mut tally = Tally::join(tallies);
    let value = tally.percentile(0.999);
    let mut measure = tally.measure(subject, Kind::SeamStep, value);
    measure.notes.push(format!("{} seams; worst {:.2} %", seams.len(), measure.worst * 100.0));
    measure
}

/// A pair of edges where a surface changes its chart: triangle and edge of either side.
pub(super) type Seam = [(u32, u32); 2];

/// What lies beyond seams, by triangle.
pub(super) struct Beyond(Vec<Seam>);

impl Beyond {
    pub(super) fn new(seams: &[Seam]) -> Self {
        let mut sides: Vec<Seam> = seams.iter().flat_map(|&[a, b]| [[a, b], [b, a]]).collect();
        sides.par_sort_unstable();
        Self(sides)
    }

    /// The brightest light beyond the seams that run through a texel, in the unit of the pages; 0 if none does.
    pub(super) fn brightest(&self, subject: &Subject<'_>, texel: usize) -> f32 {
        let light = |([(own, _), (other, l)], [from, to]): (Seam, [f32; 2])| {
            let flat = subject.flat[own as usize]?;
            let along = (0..=PER_TEXEL as u32).map(|s| from + (to - from) * (s as f32 / PER_TEXEL));
            let at = |a: f32| subject.lightmaps.irradiance(subject.scene, other, on_edge(l, 1.0 - a));
            along.filter_map(at).map(|light| light.max_element() / flat.intensity).reduce(f32::max)
        };
        self.through(subject, texel).filter_map(light).fold(0.0, f32::max)
    }

    /// A seam runs through a texel, or along it.
    pub(super) fn runs_through(&self, subject: &Subject<'_>, texel: usize) -> bool {
        self.through(subject, texel).next().is_some()
    }

    /// Seams that run through a texel, its side first, with the part of the edge that does.
    fn through<'s>(&'s self, subject: &'s Subject<'_>, texel: usize) -> impl Iterator<Item = (Seam, [f32; 2])> + 's {
        let (x, y) = subject.patches.texel_xy(texel);
        let middle = Vec2::new(x as f32, y as f32) + 0.5;
        let of = |triangle: u32| {
            let sides = &self.0[self.0.partition_point(|s| s[0].0 < triangle)..];
            sides.iter().take_while(move |s| s[0].0 == triangle)
        };
        let part = move |seam: &Seam| {
            let (own, k) = seam[0];
            let flat = subject.flat[own as usize]?;
            let ends = [k, (k + 1) % 3].map(|c| flat.uv[c as usize] - middle);
            within(ends, 0.5 + BESIDE).map(|part| (*seam, part))
        };
        subject.patches.pieces(texel).flat_map(move |(t, _)| of(t)).filter_map(part)
    }
}

/// The part of a line between two ends that lies within `reach` of zero along both axes; 0 is the first end, 1 the second.
fn within([from, to]: [Vec2; 2], reach: f32) -> Option<[f32; 2]> {
    let (mut low, mut high) = (0.0f32, 1.0f32);
    for axis in 0..2 {
        let (start, way) = (from[axis], to[axis] - from[axis]);
        if way == 0.0 {
            if start.abs() > reach {
                return None;
            }
            continue;
        }
        let [a, b] = [-reach, reach].map(|end| (end - start) / way);
        (low, high) = (low.max(a.min(b)), high.min(a.max(b)));
    }
    (low <= high).then_some([low, high])
}

/// Pairs of edges where a surface changes its chart.
pub(super) fn find(subject: &Subject<'_>) -> Vec<Seam> {
    let (scene, place) = (subject.scene, vertices::places(subject.scene));
    let mut edges: Vec<HalfEdge> = vec![];
    for (t, triangle) in (0..scene.triangle_count()).map(|t| (t, scene.triangle(t as u32))) {
        if subject.chart[t] == NO_CHART || subject.area[t] <= 0.0 {
            continue;
        }
        for k in 0..3 {
            let (a, b) = (place[triangle[k] as usize], place[triangle[(k + 1) % 3] as usize]);
            if a != b {
                edges.push(([a.min(b), a.max(b)], t as u32, k as u32));
            }
        }
    }
    edges.par_sort_unstable();
    let mut seams = vec![];
    for fan in edges.chunk_by(|a, b| a.0 == b.0).filter(|fan| (2..=CROWD).contains(&fan.len())) {
        let sides: Vec<Side> = fan.iter().map(|&(_, t, k)| Side::new(subject, &place, t, k)).collect();
        let ends: Vec<&Side> = sides.iter().filter(|a| !sides.iter().any(|b| a.goes_on_in(b))).collect();
        for (i, a) in ends.iter().enumerate() {
            seams.extend(ends[i + 1..].iter().filter(|b| a.is_seam(b, subject)).map(|b| [a.edge, b.edge]));
        }
    }
    seams
}

/// A triangle at an edge.
struct Side {
    /// The triangle and the number of the edge in it.
    edge: (u32, u32),
    /// Of its ends, in the order of the triangle: places in space, and classes by place in space and on the page.
    places: [u32; 2],
    corners: [u32; 2],
}

impl Side {
    fn new(subject: &Subject<'_>, place: &[u32], t: u32, k: u32) -> Self {
        let vertices = [k, (k + 1) % 3].map(|c| subject.scene.triangle(t)[c as usize] as usize);
        Self { edge: (t, k), places: vertices.map(|v| place[v]), corners: vertices.map(|v| subject.corner[v]) }
    }

    /// The chart goes on beyond the edge, in that triangle: of two sheets that lie on each other, none ends there.
    fn goes_on_in(&self, other: &Self) -> bool {
        let [a, b] = other.corners;
        self.corners == [b, a]
    }

    /// The surface goes on in that triangle.
    fn is_seam(&self, other: &Self, subject: &Subject<'_>) -> bool {
        let scene = subject.scene;
        let shading = |&Self { edge: (t, k), .. }: &Self, end: usize| {
            scene.shading_normal(t, [Vec2::ZERO, Vec2::X, Vec2::Y][(k as usize + end) % 3])
        };
        let [a, b] = other.places;
        self.places == [b, a]
            && scene.geometric_normal(self.edge.0).dot(scene.geometric_normal(other.edge.0)) > CORNER
            && (0..2).all(|end| shading(self, end).dot(shading(other, 1 - end)) > SAME_NORMAL)
    }
}

/// Barycentric weights of the point at `along` on edge `k` of a triangle.
fn on_edge(k: u32, along: f32) -> Vec2 {
    let mut weights = [INSET / 3.0; 3];
    weights[k as usize] += (1.0 - along) * (1.0 - INSET);
    weights[(k as usize + 1) % 3] += along * (1.0 - INSET);
    Vec2::new(weights[1], weights[2])
}

fn walk(subject: &Subject<'_>, seam: &Seam, limit: f64, tally: &mut Tally) {
    let scene = subject.scene;
    let [(ta, ka), (tb, kb)] = *seam;
    let corners = scene.corners(ta);
    let (from, to) = (corners[ka as usize], corners[(ka as usize + 1) % 3]);
    let length = from.distance(to);
    let edge = subject.texel_edge(ta).min(subject.texel_edge(tb));
    let count = ((PER_TEXEL * length / edge).ceil() as usize).clamp(LEAST, MOST);
    for s in 0..count {
        let along = (s as f32 + 0.5) / count as f32;
        let a = SurfacePoint { triangle: ta, b: on_edge(ka, along) };
        let b = SurfacePoint { triangle: tb, b: on_edge(kb, 1.0 - along) };
        let counts = is_open(subject, a) && is_open(subject, b) && see_each_other(subject, [a, b], to - from, edge);
        let width = || [(a, ka), (b, kb)].map(|(p, k)| width(subject, p, k)).into_iter().fold(1.0, f32::min);
        let width = if counts { width() } else { 0.0 };
        if width == 0.0 || subject.is_hidden(a) {
            continue;
        }
        // In the unit of the pages; two pages may have different ones.
        let intensity = subject.flat[ta as usize].map_or(1.0, |f| f.intensity).max(f32::MIN_POSITIVE);
        let light = |p: SurfacePoint| Some(subject.lightmaps.irradiance(scene, p.triangle, p.b)? / intensity);
        let (Some(left), Some(right)) = (light(a), light(b)) else { continue };
        let step = subject.relative(left, right);
        tally.look(step, limit, || a);
        tally.weigh(step as f32, length / count as f32 * width);
    }
}

/// How wide the chart is beside a point of an edge, at most a texel [texels]; 0 if narrower than is told apart.
fn width(subject: &Subject<'_>, point: SurfacePoint, k: u32) -> f32 {
    let Some(flat) = subject.flat[point.triangle as usize] else { return 0.0 };
    let [a, b, c] = [0, 1, 2].map(|corner| flat.uv[(k as usize + corner) % 3]);
    let across = (b - a).perp();
    let inward = across.normalize_or_zero() * across.dot(c - a).signum();
    let at = flat.at(point.b);
    let goes_on = |width: &&f32| {
        let there = subject.patches.surface_at(flat.page, at + inward * **width);
        there.is_some_and(|(_, p)| subject.chart[p.triangle as usize] == subject.chart[point.triangle as usize])
    };
    WIDTHS.iter().find(goes_on).copied().unwrap_or(0.0)
}

/// The point is not inside another solid.
fn is_open(subject: &Subject<'_>, point: SurfacePoint) -> bool {
    let Some(flat) = subject.flat[point.triangle as usize] else { return false };
    subject.patches.is_open(flat.page, flat.at(point.b))
}

fn see_each_other(subject: &Subject<'_>, points: [SurfacePoint; 2], along: Vec3, edge: f32) -> bool {
    let along = along.normalize_or_zero();
    HEIGHTS.iter().all(|height| {
        let [a, b] = points.map(|p| {
            let normal = subject.scene.geometric_normal(p.triangle);
            let position = subject.scene.position(p.triangle, p.b);
            let corners = subject.scene.corners(p.triangle);
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let aside = normal.cross(along);
            let inward = if aside.dot(middle - position) < 0.0 { -aside } else { aside };
            position + (inward * ASIDE + normal * *height) * edge
        });
        subject.tracer.segment_clear(a, b)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_cut_where_they_leave_a_texel() {
        let cut = |from: [f32; 2], to: [f32; 2]| within([from.into(), to.into()], 0.5);
        assert_eq!(cut([-1.5, 0.0], [2.5, 0.0]), Some([0.25, 0.5]));
        assert_eq!(cut([0.1, 0.2], [-0.3, 0.4]), Some([0.0, 1.0]));
        assert_eq!(cut([-1.0, 0.0], [0.0, 1.0]), Some([0.5, 0.5]));
        assert_eq!((cut([-1.0, 0.1], [0.0, 1.1]), cut([0.6, -1.0], [0.6, 1.0])), (None, None));
    }

    #[test]
    fn points_lie_just_inside_their_edge() {
        let near = |b: Vec2, expected: Vec2| assert!((b - expected).length() < 1e-4 && b.min_element() > 0.0, "{b}");
        near(on_edge(0, 0.25), Vec2::new(0.25, 0.0));
        near(on_edge(1, 0.25), Vec2::new(0.75, 0.25));
        near(on_edge(2, 0.25), Vec2::new(0.0, 0.75));
    }
}
