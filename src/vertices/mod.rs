//! [`Lightmap`] → [`VertexLight`]: light as a function that is linear over every triangle, fitted by least squares.
//!
//! In: scene, atlas, patches and the lightmap pages on them. Out: a value for every vertex of the parts that receive
//! light, in the unit of the pages; with [`Settings::subdivide`] also further vertices and triangles.
//!
//! Source: L. Kavan, A. W. Bargteil, P.-P. Sloan, "Least Squares Vertex Baking", EGSR 2011: with φᵢ the hat function of
//! vertex i and f the light, x minimises ∫ (f − Σ xᵢ φᵢ)² over the surface plus a regulariser. Where we differ:
//! * f is the lightmap as a renderer shows it, bilinear over the texels, and the integrals are sums over the pieces of
//!   triangles in texels (`quadrature`); the paper draws random points.
//! * Surface that lies inside other solids has no weight; where a triangle is hidden, its vertices go along with their
//!   neighbours (`system`).
//! * x ≥ 0 is a constraint (`base::nonnegative`): least squares alone goes below zero beside hard shadows.
//! * Vertices of different meshes at one place, with one normal, are one unknown, so there are no seams between
//!   modular pieces (`weld`).
//! * Triangles that fit badly can be cut (`refine`).
//!
//! Invariants (`tests/vertices.rs`): a constant lightmap gives that constant; no value is negative; vertices that share
//! place and normal share their value; the same bits at any thread count.
//!
//! Limits: surfaces that lie wholly inside solids hold zero, as their texels do. Of double-sided surfaces the front is
//! fitted, as in the lightmap. Two surfaces in one plane that meet under a wall between a lit and a dark room share
//! vertices there, so light bleeds over a triangle's length, unless the mesh has vertices on both sides of the wall.

mod bend;
mod mesh;
mod quadrature;
mod refine;
mod system;
mod weld;

pub use crate::scene::Origin;

use crate::atlas::Atlas;
use crate::base::Progress;
use crate::base::Rgb;
use crate::finish::Lightmap;
use crate::patches::Patches;
use crate::scene::Scene;
use mesh::Mesh;
use system::System;

/// Number of the place that each vertex of a scene lies at; vertices at one place, within rounding, share it.
#[must_use]
pub fn places(scene: &Scene) -> Vec<u32> {
    let vertices: Vec<mesh::Vertex> = (0..scene.vertex_count())
        .map(|v| mesh::Vertex {
            part: 0,
            origin: Origin::source(v as u32),
            position: scene.vertex_position(v as u32).as_dvec3(),
            normal: scene.vertex_normal(v as u32).as_dvec3(),
        })
        .collect();
    weld::places(&vertices).0
}

/// How to fit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Settings {
    /// Cut triangles until the error of the fit is at most this part of the mean.
    pub subdivide: Option<f64>,
}

/// Light at vertices.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VertexLight {
    /// One entry per `Scene::parts`; without vertices where a part receives no light.
    pub parts: Vec<VertexPart>,
    /// How good the fit is.
    pub fit: Fit,
}

/// The vertices of one part.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VertexPart {
    /// Where each output vertex comes from. The source's own vertices come first, in their order.
    pub origins: Vec<Origin>,
    /// Output vertices of each triangle, wound like the part's range of triangles.
    pub triangles: Vec<[u32; 3]>,
    /// Light of each output vertex, in the unit of the lightmap.
    pub values: Vec<Rgb>,
    /// There are more vertices than the source has.
    pub refined: bool,
}

/// How well linear light on the triangles stands for the lightmap. Errors are root mean squares over the surface and
/// the channels, relative to the mean light; all zero where there is no light.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Fit {
    /// Vertices of all parts.
    pub vertices: u64,
    /// Values that were solved for.
    pub unknowns: u64,
    /// Triangles of all parts.
    pub triangles: u64,
    /// Of the result.
    pub error: f64,
    /// Of the lightmap's values at the vertices.
    pub error_sampled: f64,
    /// Of mean values over the triangles around each vertex, weighted by area.
    pub error_averaged: f64,
    /// What [`Settings::subdivide`] asks for was reached.
    pub reached: bool,
}

/// Fits light at the vertices to a lightmap. A scene without light gives zeros; one without parts gives nothing.
#[must_use]
pub fn fit(
    scene: &Scene,
    atlas: &Atlas,
    patches: &Patches,
    lightmap: &Lightmap,
    settings: &Settings,
    progress: &Progress,
) -> VertexLight {
    let mut mesh = Mesh::new(scene, atlas);
    let field = quadrature::Field { patches, lightmap };
    let mut system = System::new(&mesh, &field, None);
    let mut values = system.solve(progress);
    let mut reached = true;
    if let Some(target) = settings.subdivide {
        while system.relative_error(&values) > target {
            reached = !progress.cancelled() && refine::refine(&mut mesh, &system.errors(&values));
            if !reached {
                break;
            }
            system = System::new(&mesh, &field, Some(&system));
            values = system.solve(progress);
        }
    }
    let sampled = system.sampled(&mesh, &field);
    let fit = Fit {
        vertices: mesh.vertices.len() as u64,
        unknowns: values.len() as u64,
        triangles: mesh.elements.len() as u64,
        error: system.relative_error(&values),
        error_sampled: system.relative_error(&sampled),
        error_averaged: system.relative_error(&system.averaged()),
        reached,
    };
    let light = |v: usize| values[system.unknown[v] as usize].as_vec3();
    VertexLight { parts: mesh.parts(scene, light), fit }
}
