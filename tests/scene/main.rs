//! Loading: small documents whose scenes are known exactly.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

#[path = "../support/gltf_builder.rs"]
mod builder;
mod geometry;
mod materials;
mod reduce;
mod tree;

use builder::Builder;
use builder::data_uri;
use builder::png;
use builder::words;
use glam::Vec2;
use glam::Vec3;
use glam::Vec4;
use serde_json::Value;
use serde_json::json;
use std::path::Path;
use texelwalk::base::Warned;
use texelwalk::scene;
use texelwalk::scene::Alpha;
use texelwalk::scene::Light;
use texelwalk::scene::Projection;
use texelwalk::scene::Scene;
use texelwalk::scene::Settings;

const NONE: Settings = Settings {
    scene: None,
    sky: scene::Sky { zenith: Vec3::ZERO, horizon: Vec3::ZERO, ground: Vec3::ZERO },
    sun_angle: None,
    light_radius: None,
    rules: vec![],
    instances: scene::Instances::Unique,
    share_from: None,
    variant: None,
    normal_maps: false,
    albedo_density: None,
    memory_limit: None,
};

fn load_with(b: &Builder, settings: &Settings) -> Warned<Scene> {
    let gltf = scene::load_bytes(b.gltf(), Path::new("a.gltf"), settings).unwrap();
    let glb = scene::load_bytes(b.glb(&[]), Path::new("a.glb"), settings).unwrap();
    assert_eq!(gltf.output.vertices.position, glb.output.vertices.position, "both containers hold the same scene");
    assert_eq!(gltf.output.triangles, glb.output.triangles);
    check(&glb.output);
    glb
}

/// Loads a document that must give no warnings.
fn load(b: &Builder) -> Scene {
    let loaded = load_with(b, &NONE);
    assert_eq!(loaded.warnings, []);
    loaded.output
}

fn codes(b: &Builder) -> Vec<&'static str> {
    load_with(b, &NONE).warnings.iter().map(|w| w.code).collect()
}

/// The invariants that every scene keeps.
fn check(scene: &Scene) {
    let v = &scene.vertices;
    let count = v.position.len();
    assert!(v.normal.len() == count && v.color.len() == count && v.uv.len() >= 2);
    assert!(v.uv.iter().all(|set| set.len() == count && set.iter().all(|uv| uv.is_finite())));
    assert!(v.normal.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
    assert!(v.position.iter().all(|p| p.is_finite()));
    assert_eq!(scene.triangles.len(), scene.triangle_part.len());
    assert_eq!(scene.materials.len(), scene.document.root.materials.len() + 1);
    assert_eq!(scene.textures.len(), scene.document.root.textures.len());
    let (mut vertex, mut triangle) = (0, 0);
    for (index, part) in scene.parts.iter().enumerate() {
        assert_eq!((part.vertices.start, part.triangles.start), (vertex, triangle));
        (vertex, triangle) = (part.vertices.end, part.triangles.end);
        for t in part.triangles.clone() {
            assert_eq!(scene.triangle_part[t as usize] as usize, index);
            assert!(scene.triangles[t as usize].iter().all(|v| part.vertices.contains(v)));
        }
        assert!(part.material < scene.materials.len());
    }
    assert_eq!((vertex as usize, triangle as usize), (count, scene.triangles.len()));
}

fn near(a: Vec3, b: Vec3) -> bool {
    (a - b).length() < 1e-5
}
