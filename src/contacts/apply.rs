//! The cut scene: vertices on edges and in triangles, with their attributes, and the triangles between them.

use super::arrange::Shape;
use super::mesh::{GRID, Mesh};
use crate::base::parallel;
use crate::scene::{Copies, Cuts, Origin, Scene, Vertices};
use core::ops::{Add, Mul};
use std::collections::BTreeMap;

/// Vertices and triangles of every part.
pub(super) struct Plan {
    parts: Vec<PartPlan>,
    cut: u64,
    made: u64,
    continued: u64,
}

#[derive(Default)]
struct PartPlan {
    /// The part's own vertices, then those that are added.
    origins: Vec<Origin>,
    triangles: Vec<[u32; 3]>,
    borders: Vec<[u32; 2]>,
    added: bool,
}

/// What is to be done to each part.
pub(super) fn plan(mesh: &Mesh<'_>, shapes: &[Option<Shape>], continued: u64) -> Plan {
    let parts = parallel::map(mesh.scene.parts.len(), |p| part_plan(mesh, shapes, p));
    let cut: Vec<&Shape> = shapes.iter().flatten().filter(|s| s.triangles.len() > 1).collect();
    let made = cut.iter().map(|s| s.triangles.len() as u64).sum();
    Plan { parts, cut: cut.len() as u64, made, continued }
}

fn part_plan(mesh: &Mesh<'_>, shapes: &[Option<Shape>], p: usize) -> PartPlan {
    let part = &mesh.scene.parts[p];
    let mut plan =
        PartPlan { origins: (0..part.vertices.len() as u32).map(Origin::source).collect(), ..PartPlan::default() };
    let mut on_edges: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    for t in part.triangles.clone() {
        let own = mesh.scene.triangle(t).map(|v| v - part.vertices.start);
        let Some(shape) = &shapes[t as usize] else {
            plan.triangles.push(own);
            continue;
        };
        let numbers: Vec<u32> =
            shape.points.iter().map(|steps| plan.vertex(mesh, t, own, *steps, &mut on_edges)).collect();
        let number = |k: u32| numbers[k as usize];
        plan.triangles.extend(shape.triangles.iter().map(|t| t.map(number)));
        plan.borders.extend(shape.borders.iter().map(|b| b.map(number)));
    }
    plan.added = plan.origins.len() > part.vertices.len();
    plan
}

impl PartPlan {
    /// The vertex at a point of a triangle, new where there is none.
    fn vertex(
        &mut self,
        mesh: &Mesh<'_>,
        triangle: u32,
        own: [u32; 3],
        steps: [u32; 3],
        on_edges: &mut BTreeMap<[u32; 3], u32>,
    ) -> u32 {
        if let Some(corner) = steps.iter().position(|s| *s == GRID) {
            return own[corner];
        }
        let next = self.origins.len() as u32;
        let weight = |steps: u32| steps as f32 / GRID as f32;
        let Some(side) = (0..3).find(|&k| steps[(k + 2) % 3] == 0) else {
            self.origins.push(Origin { source: own, weight: steps.map(weight) });
            return next;
        };
        let ([a, b], from) = (mesh.ends(triangle, side), steps[(side + 1) % 3]);
        let (v, w) = (own[side], own[(side + 1) % 3]);
        // In the order of the places, so that all triangles at the edge add up the same terms in the same order.
        let (low, high, from) = if a < b { (v, w, from) } else { (w, v, GRID - from) };
        let vertex = *on_edges.entry([low, high, from]).or_insert(next);
        if vertex == next {
            self.origins.push(Origin { source: [low, high, low], weight: [weight(GRID - from), weight(from), 0.0] });
        }
        vertex
    }
}

/// The scene as planned.
pub(super) fn apply(mut scene: Scene, plan: Plan) -> Scene {
    let Plan { parts, cut, made, continued } = plan;
    let source: Vec<Vertices> = scene.parts.iter().map(|part| scene.vertices_of(part)).collect();
    scene.vertices = Vertices { uv: vec![vec![]; scene.vertices.uv.len()], ..Vertices::default() };
    scene.copies = Copies::default();
    scene.triangles = vec![];
    scene.triangle_part = vec![];
    let mut cuts = Cuts { cut, made, continued, ..Cuts::default() };
    for (p, part_plan) in (0u32..).zip(parts) {
        let part = &mut scene.parts[p as usize];
        let (first, first_triangle) = (scene.vertices.position.len() as u32, scene.triangles.len() as u32);
        add(&mut scene.vertices, &source[p as usize], &part_plan.origins);
        scene.triangles.extend(part_plan.triangles.iter().map(|t| t.map(|v| v + first)));
        scene.triangle_part.resize(scene.triangles.len(), p);
        part.vertices = first..scene.vertices.position.len() as u32;
        part.triangles = first_triangle..scene.triangles.len() as u32;
        cuts.borders.extend(part_plan.borders.iter().map(|&[a, b]| [a.min(b) + first, a.max(b) + first]));
        cuts.origins.push(if part_plan.added { part_plan.origins } else { vec![] });
    }
    cuts.borders.sort_unstable();
    cuts.borders.dedup();
    scene.cuts = cuts;
    scene
}

fn add(out: &mut Vertices, source: &Vertices, origins: &[Origin]) {
    for origin in origins {
        out.position.push(at(origin, &source.position));
        let normal = at(origin, &source.normal);
        out.normal.push(if origin.is_source() { normal } else { normal.normalize_or_zero() });
        out.color.push(at(origin, &source.color));
        for (set, from) in out.uv.iter_mut().zip(&source.uv) {
            set.push(at(origin, from));
        }
    }
}

/// An attribute at a point of a source triangle.
fn at<T: Copy + Add<Output = T> + Mul<f32, Output = T>>(origin: &Origin, values: &[T]) -> T {
    let [a, b, c] = origin.source.map(|v| values[v as usize]);
    if origin.is_source() { a } else { a * origin.weight[0] + b * origin.weight[1] + c * origin.weight[2] }
}
