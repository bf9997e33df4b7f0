//! Geometry that many parts share: stored once, in the space of its mesh, and placed when it is asked for.
//!
//! In: what `geometry` stored. Out: the triangles and vertices of a [`Scene`] by their ids, whether stored as they are
//! or copied. Ids run through all parts in their order and know nothing of sharing: what they stand for is the same, bit
//! by bit, as if every copy were stored. One exception: vertex normals of primitives without normals (`Part::flat`, which
//! shading does not use) are averaged in the space of the mesh.
//!
//! Memory: 280 bytes per copy, whatever its mesh has.
//!
//! Invariant: without copies, ids are places in `Scene::triangles` and `Scene::vertices`, and nothing is looked up.

use super::{Part, Scene, Vertices};
use crate::base::parallel;
use core::ops::Range;
use glam::{DMat3, DMat4, DVec3, Vec2, Vec3, Vec4};

/// Which parts share geometry; the default is none.
#[derive(Debug, Default)]
pub struct Copies {
    /// One entry per part, or none at all if nothing is shared.
    spans: Vec<Span>,
    /// Triangles and vertices of all parts.
    totals: [u32; 2],
}

/// Where the triangles and vertices of a part are.
#[derive(Debug, Clone)]
struct Span {
    /// Its first triangle and vertex by id.
    first: [u32; 2],
    /// Its first triangle and vertex as stored.
    stored: [u32; 2],
    /// How it is placed; `None` if it is stored where it stands.
    placement: Option<Box<Placement>>,
}

/// From the space of a mesh into the world.
#[derive(Debug, Clone)]
pub struct Placement {
    /// The transform.
    pub world: DMat4,
    /// Its cofactors, with the sign that keeps normals on the front.
    normals: DMat3,
    /// It turns counter-clockwise triangles into clockwise ones.
    pub mirrored: bool,
}

/// A part that shares its geometry.
#[derive(Debug, Clone, Copy)]
pub struct Copied<'a> {
    /// Index into `Scene::parts`.
    pub part: usize,
    /// Its triangles as stored, which tells which other parts share them.
    pub stored: u32,
    /// How it is placed.
    pub placement: &'a Placement,
}

impl Placement {
    /// Of a transform that is not singular.
    #[must_use]
    pub fn new(world: DMat4) -> Self {
        let mirrored = world.determinant() < 0.0;
        let normals = cofactor(world) * if mirrored { -1.0 } else { 1.0 };
        Self { world, normals, mirrored }
    }

    /// World position [m].
    #[must_use]
    #[inline]
    pub fn position(&self, local: Vec3) -> Vec3 {
        self.world.transform_point3(local.as_dvec3()).as_vec3()
    }

    /// Unit normal in the world.
    #[must_use]
    pub fn normal(&self, local: Vec3) -> Vec3 {
        unit(self.normals * local.as_dvec3())
    }
}

/// det(M) · M⁻ᵀ of the linear part; its columns are cross products of M's.
pub(super) fn cofactor(m: DMat4) -> DMat3 {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis].map(|c| c.truncate());
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y))
}

/// Dot products of the axes of a transform: xx, yy, zz, yz, zx, xy.
pub(super) fn axes(m: DMat4) -> [f64; 6] {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis].map(|c| c.truncate());
    [x.dot(x), y.dot(y), z.dot(z), y.dot(z), z.dot(x), x.dot(y)]
}

/// Unit vector, or zero. Scaled first: the length of a huge or tiny vector overflows or vanishes when it is squared.
pub(super) fn unit(n: DVec3) -> Vec3 {
    let n = (n / n.abs().max_element()).normalize_or_zero().as_vec3();
    if n.is_finite() { n } else { Vec3::ZERO }
}

impl Copies {
    /// Appends a part with so many triangles and vertices, stored from `stored` on.
    pub(super) fn push(&mut self, counts: [u32; 2], stored: [u32; 2], placement: Option<Placement>) {
        self.spans.push(Span { first: self.totals, stored, placement: placement.map(Box::new) });
        (0..2).for_each(|k| self.totals[k] += counts[k]);
    }

    pub(super) fn is_copied(&self, part: usize) -> bool {
        self.spans.get(part).is_some_and(|span| span.placement.is_some())
    }

    fn span(&self, id: u32, kind: usize) -> (usize, &Span) {
        // Empty parts have the same first id as the one behind them, which is the last of them.
        let part = self.spans.partition_point(|s| s.first[kind] <= id).saturating_sub(1);
        (part, &self.spans[part])
    }
}

const TRIANGLE: usize = 0;
const VERTEX: usize = 1;
/// Triangles that one thread takes at a time.
const CHUNK: usize = 1 << 16;

impl Scene {
    /// Number of triangles of all parts.
    #[must_use]
    pub fn triangle_count(&self) -> usize {
        if self.copies.spans.is_empty() { self.triangles.len() } else { self.copies.totals[TRIANGLE] as usize }
    }

    /// Number of vertices of all parts.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        if self.copies.spans.is_empty() { self.vertices.position.len() } else { self.copies.totals[VERTEX] as usize }
    }

    /// Vertex ids of a triangle, counter-clockwise seen from the front.
    #[must_use]
    #[inline]
    pub fn triangle(&self, triangle: u32) -> [u32; 3] {
        if self.copies.spans.is_empty() {
            return self.triangles[triangle as usize];
        }
        let (_, span) = self.copies.span(triangle, TRIANGLE);
        span.wound(self.stored_triangle(span, triangle)).map(|v| v - span.stored[VERTEX] + span.first[VERTEX])
    }

    /// Vertex ids of a range of triangles, relative to the first vertex of their part.
    pub fn part_triangles(&self, part: &Part) -> impl Iterator<Item = [u32; 3]> + use<'_> {
        let first = part.vertices.start;
        part.triangles.clone().map(move |t| self.triangle(t).map(|v| v - first))
    }

    /// Index of the part of a triangle.
    #[must_use]
    #[inline]
    pub fn part_index(&self, triangle: u32) -> usize {
        if self.copies.spans.is_empty() {
            return self.triangle_part[triangle as usize] as usize;
        }
        self.copies.span(triangle, TRIANGLE).0
    }

    /// The three corners of a triangle in world space [m].
    #[must_use]
    #[inline]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        let (stored, placement) = self.stored_corners(triangle);
        // Not `array::map`: it is not always inlined.
        let position = |v: u32| self.vertices.position[v as usize];
        let corners = [position(stored[0]), position(stored[1]), position(stored[2])];
        placement.map_or(corners, |placement| corners.map(|p| placement.position(p)))
    }

    /// Size of all surface along the axes [m]; zero without any.
    #[must_use]
    pub fn extent(&self) -> Vec3 {
        let box_of = |(low, high): (Vec3, Vec3), p: Vec3| (low.min(p), high.max(p));
        let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let boxes = parallel::map_chunks(self.triangle_count(), CHUNK, |triangles| {
            triangles.flat_map(|t| self.corners(t as u32)).fold(none, box_of)
        });
        let (low, high) = boxes.into_iter().flat_map(|(low, high)| [low, high]).fold(none, box_of);
        (high - low).max(Vec3::ZERO)
    }

    /// Unit normals at the corners of a triangle.
    #[must_use]
    #[inline]
    pub fn corner_normals(&self, triangle: u32) -> [Vec3; 3] {
        let (stored, placement) = self.stored_corners(triangle);
        let normals = stored.map(|v| self.vertices.normal[v as usize]);
        placement.map_or(normals, |placement| normals.map(|n| placement.normal(n)))
    }

    /// Where the corners of a triangle are stored, and what places them, if they are not stored where they stand.
    #[inline]
    pub(super) fn stored_corners(&self, triangle: u32) -> ([u32; 3], Option<&Placement>) {
        if self.copies.spans.is_empty() {
            return (self.triangles[triangle as usize], None);
        }
        let (_, span) = self.copies.span(triangle, TRIANGLE);
        (span.wound(self.stored_triangle(span, triangle)), span.placement.as_deref())
    }

    /// The same for a vertex.
    #[inline]
    fn stored_vertex(&self, vertex: u32) -> (usize, Option<&Placement>) {
        if self.copies.spans.is_empty() {
            return (vertex as usize, None);
        }
        let (_, span) = self.copies.span(vertex, VERTEX);
        ((vertex - span.first[VERTEX] + span.stored[VERTEX]) as usize, span.placement.as_deref())
    }

    /// World position of a vertex [m].
    #[must_use]
    #[inline]
    pub fn vertex_position(&self, vertex: u32) -> Vec3 {
        let (stored, placement) = self.stored_vertex(vertex);
        let position = self.vertices.position[stored];
        placement.map_or(position, |placement| placement.position(position))
    }

    /// Unit normal of a vertex.
    #[must_use]
    pub fn vertex_normal(&self, vertex: u32) -> Vec3 {
        let (stored, placement) = self.stored_vertex(vertex);
        let normal = self.vertices.normal[stored];
        placement.map_or(normal, |placement| placement.normal(normal))
    }

    /// Linear colour of a vertex.
    #[must_use]
    pub fn vertex_color(&self, vertex: u32) -> Vec4 {
        self.vertices.color[self.stored_vertex(vertex).0]
    }

    /// Texture coordinates of a vertex; `None` without such a set.
    #[must_use]
    pub fn vertex_uv(&self, set: usize, vertex: u32) -> Option<Vec2> {
        self.vertices.uv.get(set)?.get(self.stored_vertex(vertex).0).copied()
    }

    /// The vertices of a part as they stand in the world.
    #[must_use]
    pub fn vertices_of(&self, part: &Part) -> Vertices {
        let all = part.vertices.clone();
        let uv = |set: usize| all.clone().map(|v| self.vertex_uv(set, v).unwrap_or_default()).collect();
        Vertices {
            position: all.clone().map(|v| self.vertex_position(v)).collect(),
            normal: all.clone().map(|v| self.vertex_normal(v)).collect(),
            color: all.clone().map(|v| self.vertex_color(v)).collect(),
            uv: (0..self.vertices.uv.len()).map(uv).collect(),
        }
    }

    /// Parts that share their geometry, in order.
    pub fn copied(&self) -> impl Iterator<Item = Copied<'_>> {
        self.copies.spans.iter().enumerate().filter_map(|(part, span)| {
            let placement = span.placement.as_deref()?;
            Some(Copied { part, stored: span.stored[TRIANGLE], placement })
        })
    }

    /// The part shares its geometry with others.
    #[must_use]
    pub fn is_copied(&self, part: usize) -> bool {
        self.copies.is_copied(part)
    }

    /// Corners of stored triangles, in the space they are stored in, wound as in the document [m].
    #[must_use]
    pub fn stored_positions(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|v| self.vertices.position[v as usize])
    }

    fn stored_triangle(&self, span: &Span, triangle: u32) -> [u32; 3] {
        self.triangles[(triangle - span.first[TRIANGLE] + span.stored[TRIANGLE]) as usize]
    }
}

impl Span {
    /// Copies are stored as the document winds them.
    #[inline]
    fn wound(&self, [a, b, c]: [u32; 3]) -> [u32; 3] {
        if self.placement.as_ref().is_some_and(|p| p.mirrored) { [a, c, b] } else { [a, b, c] }
    }
}

/// Largest product of the sizes of a transform and of its inverse with which geometry is shared: flatter ones leave too
/// few digits to look for hits in the space of the mesh.
const MOST_SKEW: f64 = 1e3;

/// Geometry can be shared under this transform.
pub(super) fn is_shareable(world: DMat4) -> bool {
    let size = |m: DMat4| [m.x_axis, m.y_axis, m.z_axis].iter().map(|c| c.truncate().length_squared()).sum::<f64>();
    let skew = (size(world) * size(world.inverse())).sqrt();
    // Written so that NaN fails.
    world.is_finite() && world.determinant() != 0.0 && skew <= MOST_SKEW
}

/// Ids of a part from its first ones and its counts.
pub(super) fn ids(first: u32, count: usize) -> Range<u32> {
    first..first + count as u32
}
