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
use crate::scene::Origin;
use crate::scene::Scene;
use glam::DVec2;
use glam::DVec3;

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

impl Element {
    /// Where the corners lie on a page that its texels are looked for on.
    pub(super) fn is_charted(&self) -> bool {
        self.page != NO_PATCH
    }

    /// Length of the longest edge on the page [texels].
    pub(super) fn longest_texels(&self) -> f64 {
        let [a, b, c] = self.uv;
        a.distance(b).max(b.distance(c)).max(c.distance(a))
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
                let at = scene.vertex_position(v).as_dvec3();
                let normal = scene.vertex_normal(v).as_dvec3();
                mesh.vertices.push(Vertex { part: p, origin: Origin::source(local), position: at, normal });
            }
            for (k, t) in part.triangles.clone().enumerate() {
                let corners = scene.triangle(t).map(|v| v - part.vertices.start + first);
                let place = charted.layout.triangles.get(k);
                let chart = place.map_or(NO_CHART, |_| charted.chart(k));
                let place = place.filter(|_| chart != NO_CHART);
                let uv = place.map_or([DVec2::ZERO; 3], |c| c.map(|v| charted.uv(v).as_dvec2()));
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
