//! [`Scene`] → [`Scene`] with triangles cut along the lines where other surfaces meet them, for `--cut-contacts`.
//!
//! A texel that lies across the foot of a thin wall has one value for both sides of it. Cut along the foot, and charted
//! apart, each side has texels of its own, and so has what lies under the wall. The surface itself stays as it is.
//!
//! Steps: find where opaque surfaces cross a triangle or stand on it with an edge (`find`); put points on edges where all
//! triangles at the edge have them (`mesh`); triangulate (`arrange`); continue the lines of thin walls, around whose ends the
//! floor hangs together, to the border of the floor (`continue_lines`), and triangulate again; give the new vertices their
//! attributes (`apply`).
//!
//! Triangles of parts that receive light are cut, also parts with a lightmap layout of their own, which are charted anew.
//! Only fronts are looked at: what touches a surface from behind does not matter to the light on it.
//!
//! Invariants (`tests/library/cut_contacts.rs`): the surface keeps its place and area; triangles that share an edge share all
//! points on it, bit by bit; without contacts the scene stays as it is; the same result at any number of threads.
//!
//! Limits: lines are continued on plane surfaces alone. Contacts nearer than [`Settings::tolerance`] to an edge or to
//! each other are moved there. Masked and transparent surfaces do not cut.

mod apply;
mod arrange;
mod continue_lines;
mod find;
mod mesh;
mod plane;

use crate::base::parallel;
use crate::scene::Scene;
use crate::trace::Tracer;
use arrange::Shape;
use glam::DVec2;
use mesh::Mesh;

/// Distance up to which surfaces touch, as part of a texel.
const TOLERANCE: f64 = 0.01;
/// The same, at most [m]: gaps that are wider let light through.
const MOST_TOLERANCE: f64 = 1e-4;
/// The same, at least, in parts of the largest coordinate: a few rounding steps of an `f32`.
const ROUNDING: f64 = 1e-6;

/// How to cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Wanted density of the lightmap [texels/m].
    pub texels_per_meter: f32,
    /// Leave parts with a `TEXCOORD_1` alone, because it will be kept.
    pub keep_uv: bool,
}

impl Settings {
    /// Edge of a texel where a part has no density of its own [m].
    fn texel(&self) -> f64 {
        1.0 / f64::from(self.texels_per_meter)
    }

    /// Distance up to which surfaces touch, where coordinates reach up to `reach` [m] and texels are as small as
    /// `texel` [m].
    fn tolerance(texel: f64, reach: f64) -> f64 {
        (TOLERANCE * texel).min(MOST_TOLERANCE).max(ROUNDING * reach)
    }
}

/// A line on a triangle, in the coordinates of its [`plane::Plane`] [m].
type Segment = [DVec2; 2];

/// Cuts the triangles of a scene along contacts. [`Scene::cuts`] of the result says what was done.
#[must_use]
pub fn cut(scene: Scene, settings: &Settings) -> Scene {
    match plan(&scene, settings) {
        Some(plan) => apply::apply(scene, plan),
        None => scene,
    }
}

/// What is to be done; `None` without contacts.
fn plan(scene: &Scene, settings: &Settings) -> Option<apply::Plan> {
    let tracer = Tracer::new(scene);
    let (low, high) = tracer.bounds();
    let densest = scene.parts.iter().filter(|p| p.receives).map(|p| p.treatment.density).fold(0.0, f32::max);
    let texel = settings.texel() / f64::from(if densest > 0.0 { densest } else { 1.0 });
    let tolerance = Settings::tolerance(texel, f64::from(low.abs().max(high.abs()).max_element()));
    let mesh = Mesh::new(scene, settings.keep_uv);
    let count = scene.triangle_count();
    let mut lines: Vec<Vec<Segment>> = parallel::map(count, |t| find::contacts(&tracer, &mesh, t as u32, tolerance));
    if lines.iter().all(Vec::is_empty) {
        return None;
    }
    let mut all = shapes(&mesh, &lines, tolerance);
    let more = continue_lines::continued(&mesh, &all, settings.texel(), tolerance);
    let continued = more.count;
    for (t, line) in more.lines {
        lines[t as usize].push(line);
    }
    if continued > 0 {
        all = shapes(&mesh, &lines, tolerance);
    }
    Some(apply::plan(&mesh, &all, continued))
}

/// Every triangle with its lines; `None` where it stays as it is.
fn shapes(mesh: &Mesh<'_>, lines: &[Vec<Segment>], tolerance: f64) -> Vec<Option<Shape>> {
    let count = lines.len();
    let merged: Vec<Vec<Segment>> = parallel::map(count, |t| arrange::merged(&lines[t], tolerance));
    let proposed = parallel::map(count, |t| arrange::edge_points(mesh, t as u32, &merged[t], tolerance));
    let points = mesh::EdgePoints::new(mesh, proposed.into_iter().flatten().collect(), tolerance);
    parallel::map(count, |t| arrange::shape(mesh, &points, t as u32, &merged[t], tolerance))
}
