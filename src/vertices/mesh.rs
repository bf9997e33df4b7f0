//! The triangles of all parts that receive light, with their places on the lightmap pages.
//!
//! Vertices are numbered part by part, a part's own ones first; [`refine`](super::refine) adds others behind all of
//! them. A vertex that was added remembers its weights over three vertices of the source, so that every attribute of it
//! can be interpolated.

use super::VertexPart;
use crate::atlas::Atlas;
use crate::atlas::NO_CHART;
use crate::base::Rgb;
use crate::patches::NO_PATCH;
use crate::scene::Scene;
use glam::DVec2;
use glam::DVec3;

/// A point of a source triangle: weights over three source vertices of its part, which add up to one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Origin {
    /// Source vertices within the part (= accessor elements).
    pub source: [u32; 3],
    /// Their weights.
    pub weight: [f32; 3],
}

/// A corner that triangles of one part share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vertex {
    pub(super) part: u32,
    pub(super) origin: Origin,
    /// [m]
    pub(super) position: DVec3,
    pub(super) normal: DVec3,
}

/// A triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Element {
    pub(super) corners: [u32; 3],
    /// Places of the corners [texels].
    pub(super) uv: [DVec2; 3],
    /// [`NO_PATCH`] for a triangle without a chart.
    pub(super) page: u32,
    /// [m²]
    pub(super) area: f64,
    /// Its number in the mesh before the last refinement, if it is still the same.
    pub(super) uncut: Option<u32>,
}

/// Triangles and their corners.
#[derive(Debug, Default)]
pub(super) struct Mesh {
    pub(super) vertices: Vec<Vertex>,
    pub(super) elements: Vec<Element>,
    /// Vertices that the source has.
    pub(super) original: usize,
}

impl Origin {
    /// A vertex of the source.
    #[must_use]
    pub fn source(vertex: u32) -> Self {
        Self { source: [vertex; 3], weight: [1.0, 0.0, 0.0] }
    }

    /// It is a vertex of the source itself.
    #[must_use]
    pub fn is_source(&self) -> bool {
        self.weight[0] == 1.0
    }

    /// The vertices that count, with their weights.
    fn terms(&self) -> impl Iterator<Item = (u32, f32)> + '_ {
        self.source.into_iter().zip(self.weight).filter(|(_, w)| *w > 0.0)
    }

    /// Half way between two points of one source triangle.
    pub(super) fn middle(a: &Self, b: &Self) -> Self {
        let mut all: Vec<(u32, f32)> = vec![];
        for (source, weight) in a.terms().chain(b.terms()) {
            match all.iter_mut().find(|(s, _)| *s == source) {
                Some((_, sum)) => *sum += 0.5 * weight,
                None => all.push((source, 0.5 * weight)),
            }
        }
        all.sort_unstable_by_key(|(source, _)| *source);
        let mut out = Self { source: [all.first().map_or(0, |t| t.0); 3], weight: [0.0; 3] };
        for (k, (source, weight)) in all.into_iter().take(3).enumerate() {
            (out.source[k], out.weight[k]) = (source, weight);
        }
        out
    }
}

impl Element {
    /// Where the corners lie on a page that its texels are looked for on.
    pub(super) fn is_charted(&self) -> bool {
        self.page != NO_PATCH
    }

    /// Twice the signed area on the page [texel²].
    pub(super) fn doubled_texels(&self) -> f64 {
        let [a, b, c] = self.uv;
        (b - a).perp_dot(c - a)
    }
}

impl Mesh {
    /// The triangles as the scene has them.
    pub(super) fn new(scene: &Scene, atlas: &Atlas) -> Self {
        let mut mesh = Self::default();
        for ((p, part), charted) in (0..).zip(&scene.parts).zip(&atlas.parts) {
            if !part.receives {
                continue;
            }
            let first = mesh.vertices.len() as u32;
            for (local, v) in (0..).zip(part.vertices.clone()) {
                let at = scene.vertices.position[v as usize].as_dvec3();
                let normal = scene.vertices.normal[v as usize].as_dvec3();
                mesh.vertices.push(Vertex { part: p, origin: Origin::source(local), position: at, normal });
            }
            for (k, t) in part.triangles.clone().enumerate() {
                let corners = scene.triangles[t as usize].map(|v| v - part.vertices.start + first);
                let chart = charted.chart.get(k).copied().unwrap_or(NO_CHART);
                let place = charted.triangles.get(k).filter(|_| chart != NO_CHART);
                let uv = place.map_or([DVec2::ZERO; 3], |c| c.map(|v| charted.uv[v as usize].as_dvec2()));
                let page = place.map_or(NO_PATCH, |_| atlas.charts[chart as usize].page);
                mesh.elements.push(Element { corners, uv, page, area: scene.area(t), uncut: None });
            }
        }
        mesh.original = mesh.vertices.len();
        mesh
    }

    /// Corners' positions [m].
    pub(super) fn positions(&self, element: &Element) -> [DVec3; 3] {
        element.corners.map(|v| self.vertices[v as usize].position)
    }

    /// The result, sorted into parts; `light` gives the value of a vertex of this mesh.
    pub(super) fn parts(&self, scene: &Scene, light: impl Fn(usize) -> Rgb) -> Vec<VertexPart> {
        let mut parts = vec![VertexPart::default(); scene.parts.len()];
        let mut local = vec![0; self.vertices.len()];
        for (v, vertex) in self.vertices.iter().enumerate() {
            let part = &mut parts[vertex.part as usize];
            local[v] = part.origins.len() as u32;
            part.origins.push(vertex.origin);
            part.values.push(light(v));
            part.refined |= v >= self.original;
        }
        for element in &self.elements {
            let part = self.vertices[element.corners[0] as usize].part;
            parts[part as usize].triangles.push(element.corners.map(|v| local[v as usize]));
        }
        parts
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn middles_of_middles_keep_their_weights() {
        let [a, b, c] = [4, 2, 9].map(Origin::source);
        let ab = Origin::middle(&a, &b);
        assert_eq!((ab.source, ab.weight), ([2, 4, 2], [0.5, 0.5, 0.0]));
        let inner = Origin::middle(&ab, &c);
        assert_eq!((inner.source, inner.weight), ([2, 4, 9], [0.25, 0.25, 0.5]));
        assert_eq!(Origin::middle(&inner, &ab).weight.iter().sum::<f32>(), 1.0);
        assert!(a.is_source() && !ab.is_source() && Origin::middle(&a, &a).is_source());
    }
}
