//! A scene with the triangles that vertex light cut, because light is linear over those.

use crate::base::Rgb;
use crate::scene::{Part, Scene, Vertices};
use crate::vertices::{Origin, VertexLight, VertexPart};
use core::ops::{Add, Mul};

/// The scene as vertex light needs it; `None` if no triangle was cut, so that it is the one that was baked.
pub(super) fn scene(scene: &Scene, light: &VertexLight) -> Option<Scene> {
    if !light.parts.iter().any(|part| part.refined) {
        return None;
    }
    let mut out = Scene {
        materials: scene.materials.clone(),
        textures: scene.textures.clone(),
        sky: scene.sky,
        cameras: scene.cameras.clone(),
        vertices: Vertices { uv: vec![vec![]; scene.vertices.uv.len()], ..Vertices::default() },
        ..Scene::default()
    };
    for (part, cut) in scene.parts.iter().zip(&light.parts) {
        if cut.origins.is_empty() {
            let origins: Vec<Origin> = (0..part.vertices.end - part.vertices.start).map(Origin::source).collect();
            let triangles = scene.part_triangles(part).collect();
            add(&mut out, scene, part, &VertexPart { origins, triangles, ..VertexPart::default() });
        } else {
            add(&mut out, scene, part, cut);
        }
    }
    Some(out)
}

/// Irradiance at the vertices of every part [lx]; `intensity` is that of a value of 1.
pub(super) fn irradiance(light: &VertexLight, intensity: f32) -> Vec<Vec<Rgb>> {
    light.parts.iter().map(|part| part.values.iter().map(|value| *value * intensity).collect()).collect()
}

fn add(out: &mut Scene, scene: &Scene, part: &Part, cut: &VertexPart) {
    let (first, first_triangle) = (out.vertices.position.len() as u32, out.triangles.len() as u32);
    let source = scene.vertices_of(part);
    for origin in &cut.origins {
        out.vertices.position.push(at(origin, &source.position));
        out.vertices.normal.push(at(origin, &source.normal).normalize_or_zero());
        out.vertices.color.push(at(origin, &source.color));
        for (set, from) in out.vertices.uv.iter_mut().zip(&source.uv) {
            set.push(at(origin, from));
        }
    }
    out.triangles.extend(cut.triangles.iter().map(|t| t.map(|v| v + first)));
    let triangles = first_triangle..out.triangles.len() as u32;
    out.triangle_part.resize(out.triangles.len(), out.parts.len() as u32);
    let vertices = first..out.vertices.position.len() as u32;
    out.parts.push(Part { vertices, triangles, ..part.clone() });
}

/// An attribute at a point of a source triangle.
fn at<T: Copy + Add<Output = T> + Mul<f32, Output = T>>(origin: &Origin, values: &[T]) -> T {
    let [a, b, c] = origin.source.map(|v| values[v as usize]);
    if origin.is_source() { a } else { a * origin.weight[0] + b * origin.weight[1] + c * origin.weight[2] }
}
