//! The triangles of a part as one surface: vertices welded by position, areas, normals, neighbours.
//!
//! Source vertices are split where normals or texture coordinates differ; charts must be able to grow over such splits,
//! so only the position counts here. Edges where shading breaks are `hard`: no chart grows over them, because a texel
//! that lies on both sides would mix two planes that are lit differently.
//!
//! Copies of a triangle (same three positions) go to separate layers, so that each copy is charted and no edge becomes
//! non-manifold because of a copy. Of the other edges with more than two triangles (a wall standing on a floor) the
//! pair that continues straightest is joined. Faces on the two sides of a contact that was cut are no neighbours.

use crate::scene::Part;
use crate::scene::Scene;
use glam::DVec3;
use std::collections::HashMap;

/// No neighbour.
pub(super) const NONE: u32 = u32::MAX;

/// Faces that meet at less than this angle are one smooth surface whatever their normals say (cos 25°).
const FLAT_COS: f64 = 0.906;

/// Faces that meet at more than this angle are never one smooth surface (cos 75°).
const SHARP_COS: f64 = 0.259;

/// Shading normals of the two sides of an edge count as equal above this cosine (18°).
const SAME_NORMAL_COS: f32 = 0.95;

/// Height over longest edge below which the normal of a triangle is noise.
const SLIVER: f64 = 1e-4;

/// A welded part.
#[derive(Debug)]
pub(super) struct Surface {
    /// Welded positions [m].
    pub(super) positions: Vec<DVec3>,
    /// Welded vertices of each triangle of the part.
    pub(super) faces: Vec<[u32; 3]>,
    /// Area [m²].
    pub(super) area: Vec<f64>,
    /// Unit normal; zero for a triangle without area.
    pub(super) normal: Vec<DVec3>,
    /// Face across the edge from corner k to corner k + 1, or [`NONE`].
    pub(super) neighbor: Vec<[u32; 3]>,
    /// Charts may grow over that edge.
    pub(super) soft: Vec<[bool; 3]>,
    /// So thin that the normal means nothing.
    pub(super) sliver: Vec<bool>,
}

/// One side of a triangle, keyed for sorting: (lower vertex, higher vertex, layer, face · 3 + corner).
type HalfEdge = (u32, u32, u32, u32);

impl Surface {
    /// Welds a part of a scene.
    pub(super) fn new(scene: &Scene, part: &Part) -> Self {
        let first = part.vertices.start;
        let source: Vec<[u32; 3]> = scene.part_triangles(part).collect();
        let mut index = HashMap::new();
        let mut positions: Vec<DVec3> = Vec::new();
        let mut faces = Vec::with_capacity(source.len());
        for triangle in &source {
            faces.push(triangle.map(|v| {
                let p = scene.vertex_position(first + v);
                let key = p.to_array().map(|x| (x + 0.0).to_bits());
                *index.entry(key).or_insert_with(|| {
                    positions.push(p.as_dvec3());
                    (positions.len() - 1) as u32
                })
            }));
        }
        let mut surface = Self {
            area: Vec::with_capacity(faces.len()),
            normal: Vec::with_capacity(faces.len()),
            sliver: Vec::with_capacity(faces.len()),
            neighbor: vec![[NONE; 3]; faces.len()],
            soft: vec![[false; 3]; faces.len()],
            positions,
            faces,
        };
        surface.measure();
        surface.connect();
        surface.part_at_borders(scene, part, &source);
        for f in 0..source.len() {
            for k in 0..3 {
                surface.soft[f][k] = surface.is_soft(scene, part, &source, f, k);
            }
        }
        surface
    }

    /// Positions of the corners of a face [m].
    pub(super) fn corners(&self, face: u32) -> [DVec3; 3] {
        self.faces[face as usize].map(|v| self.positions[v as usize])
    }

    /// Vertices of edge k of a face.
    pub(super) fn edge(&self, face: u32, k: usize) -> (u32, u32) {
        let vertices = self.faces[face as usize];
        (vertices[k], vertices[(k + 1) % 3])
    }

    /// Length of edge k of a face [m].
    pub(super) fn edge_length(&self, face: u32, k: usize) -> f64 {
        let (a, b) = self.edge(face, k);
        self.positions[a as usize].distance(self.positions[b as usize])
    }

    fn measure(&mut self) {
        for f in 0..self.faces.len() as u32 {
            let [p0, p1, p2] = self.corners(f);
            let cross = (p1 - p0).cross(p2 - p0);
            let twice_area = cross.length();
            let longest = p0.distance(p1).max(p1.distance(p2)).max(p2.distance(p0));
            let finite = twice_area.is_finite() && p0.is_finite() && p1.is_finite() && p2.is_finite();
            self.area.push(if finite { 0.5 * twice_area } else { 0.0 });
            self.normal.push(if finite { cross.normalize_or_zero() } else { DVec3::ZERO });
            self.sliver.push(twice_area < SLIVER * longest * longest);
        }
    }

    /// For each face, how many faces before it have the same three vertices.
    fn layers(&self) -> Vec<u32> {
        let mut seen: HashMap<[u32; 3], u32> = HashMap::with_capacity(self.faces.len());
        self.faces
            .iter()
            .map(|face| {
                let mut key = *face;
                key.sort_unstable();
                let count = seen.entry(key).or_insert(0);
                *count += 1;
                *count - 1
            })
            .collect()
    }

    fn connect(&mut self) {
        let layers = self.layers();
        let mut edges: Vec<HalfEdge> = Vec::with_capacity(self.faces.len() * 3);
        for f in 0..self.faces.len() as u32 {
            if self.area[f as usize] <= 0.0 {
                continue;
            }
            for k in 0..3 {
                let (a, b) = self.edge(f, k);
                edges.push((a.min(b), a.max(b), layers[f as usize], f * 3 + k as u32));
            }
        }
        edges.sort_unstable();
        for group in edges.chunk_by(|a, b| (a.0, a.1, a.2) == (b.0, b.1, b.2)) {
            match group {
                [_] => {}
                [a, b] => self.join(a.3, b.3),
                fan => self.join_straightest(fan),
            }
        }
    }

    /// No face has a neighbour across an edge where a contact was cut.
    fn part_at_borders(&mut self, scene: &Scene, part: &Part, source: &[[u32; 3]]) {
        if scene.cuts.borders.is_empty() {
            return;
        }
        let first = part.vertices.start;
        let sorted = |(a, b): (u32, u32)| (a.min(b), a.max(b));
        let mut borders = vec![];
        for (f, corners) in (0u32..).zip(source) {
            let cut = |k: &usize| scene.cuts.is_border(corners[*k] + first, corners[(*k + 1) % 3] + first);
            borders.extend((0..3).filter(cut).map(|k| sorted(self.edge(f, k))));
        }
        borders.sort_unstable();
        for f in 0..self.faces.len() as u32 {
            for k in 0..3 {
                if borders.binary_search(&sorted(self.edge(f, k))).is_ok() {
                    self.neighbor[f as usize][k] = NONE;
                }
            }
        }
    }

    /// Makes two half-edges neighbours if their faces wind alike.
    fn join(&mut self, a: u32, b: u32) {
        let (fa, ka, fb, kb) = (a / 3, (a % 3) as usize, b / 3, (b % 3) as usize);
        if self.edge(fa, ka).0 == self.edge(fb, kb).1 && fa != fb {
            self.neighbor[fa as usize][ka] = fb;
            self.neighbor[fb as usize][kb] = fa;
        }
    }

    /// Joins pairs of a non-manifold edge, straightest first. Fans of more than 16 faces stay open: the search is
    /// quadratic.
    fn join_straightest(&mut self, fan: &[HalfEdge]) {
        if fan.len() > 16 {
            return;
        }
        let mut pairs: Vec<(f64, u32, u32)> = Vec::new();
        for (i, a) in fan.iter().enumerate() {
            for b in &fan[i + 1..] {
                let straight = self.normal[(a.3 / 3) as usize].dot(self.normal[(b.3 / 3) as usize]);
                if straight > FLAT_COS {
                    pairs.push((straight, a.3, b.3));
                }
            }
        }
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
        for (_, a, b) in pairs {
            let free = |e: u32| self.neighbor[(e / 3) as usize][(e % 3) as usize] == NONE;
            if free(a) && free(b) {
                self.join(a, b);
            }
        }
    }

    fn is_soft(&self, scene: &Scene, part: &Part, source: &[[u32; 3]], f: usize, k: usize) -> bool {
        let g = self.neighbor[f][k];
        if g == NONE {
            return false;
        }
        let cos = self.normal[f].dot(self.normal[g as usize]);
        if cos > FLAT_COS || self.sliver[f] || self.sliver[g as usize] {
            return true;
        }
        if cos < SHARP_COS || part.flat {
            return false;
        }
        let first = part.vertices.start;
        let (a, b) = self.edge(f as u32, k);
        [a, b].into_iter().all(|welded| {
            let normal = |face: usize| {
                let corner = self.faces[face].iter().position(|v| *v == welded).unwrap_or(0);
                scene.vertex_normal(first + source[face][corner])
            };
            normal(f).dot(normal(g as usize)) > SAME_NORMAL_COS
        })
    }
}
