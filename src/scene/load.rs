//! Puts the parts of the loader in order: container, extensions, buffers, what is compressed, instances, nodes, materials, geometry, images, lights.

use super::Document;
use super::Error;
use super::Rule;
use super::Scene;
use super::Sky;
use super::cameras;
use super::error;
use super::extensions;
use super::footprint::Footprint;
use super::geometry;
use super::group::Groups;
use super::images;
use super::material;
use super::nodes;
use super::punctual;
use super::treat::Treater;
use crate::base::Warned;
use std::path::Path;

/// What to take from the document, and what it cannot say.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Settings {
    /// Index of the scene; `None` = the document's default scene, else scene 0, else all root nodes.
    pub scene: Option<usize>,
    /// Light from infinity; glTF has none.
    pub sky: Sky,
    /// Angular diameter of every sun [rad]; `None` = what the document says in `extras`, else 0.
    pub sun_angle: Option<f32>,
    /// Radius of every point and spot light [m]; `None` = what the document says in `extras`, else 0.
    pub light_radius: Option<f32>,
    /// What to do otherwise with what has certain names; later ones win.
    pub rules: Vec<Rule>,
    /// Most memory that a bake may need for the scene alone [bytes].
    pub memory_limit: Option<u64>,
}

/// Reads a glTF or GLB file, and the buffers and images that it refers to.
///
/// # Errors
/// The file cannot be read, is not valid, or needs what is not supported; see [`Error`].
pub fn load(path: &Path, settings: &Settings) -> Result<Warned<Scene>, Error> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    load_bytes(bytes, path, settings)
}

/// The same for a document that is in memory already; `path` is where its relative references start.
///
/// # Errors
/// As for [`load()`].
pub fn load_bytes(bytes: Vec<u8>, path: &Path, settings: &Settings) -> Result<Warned<Scene>, Error> {
    assemble(bytes, path, settings).map_err(|e| e.in_file(path))
}

fn assemble(bytes: Vec<u8>, path: &Path, settings: &Settings) -> Result<Warned<Scene>, Error> {
    let mut warnings = Vec::new();
    let mut document = Document::parse(bytes, path, &mut warnings)?;
    extensions::check(&document.root, &mut warnings)?;
    document.load_buffers()?;
    document.decompress_views()?;
    document.decompress_primitives()?;
    document.expand_instances()?;
    let mut walk = nodes::walk(&document.root, settings.scene, &mut warnings)?;
    let mut materials = material::read(&document.root, &mut warnings)?;
    let mut footprint = Footprint::of_document(&document, &walk);
    footprint.admit(settings.memory_limit)?;
    let mut geometry = geometry::read(&document, &mut walk, &materials, &mut warnings)?;
    if geometry.triangles.is_empty() {
        return Err(Error::invalid("nothing to bake: the scene has no visible triangles"));
    }
    let mut treater = Treater::new(&document.root, &walk, &settings.rules, &mut warnings);
    let parts_groups = treater.parts(&walk, &mut geometry.parts, &materials, &mut warnings)?;
    let sizes = [settings.sun_angle, settings.light_radius];
    let (lights, lights_groups) = punctual::read(&document.root, &walk, sizes, &mut treater, &mut warnings)?;
    warnings.extend(treater.unused());
    let mut used = vec![false; materials.len()];
    geometry.parts.iter().for_each(|part| used[part.material] = true);
    for (material, _) in materials.iter_mut().zip(used).filter(|(_, used)| !used) {
        material.base_color_texture = None;
        material.metallic_texture = None;
        material.emission_texture = None;
        material.specular_texture = None;
        material.transmission_texture = None;
        material.translucency = None;
    }
    let textures = images::decode(&mut document, &materials, &mut warnings, |pixels| {
        footprint.texture_pixels = pixels;
        footprint.admit(settings.memory_limit)
    })?;
    let cameras = cameras::read(&document.root, &walk, &mut warnings);
    let scene = Scene {
        document,
        vertices: geometry.vertices,
        triangles: geometry.triangles,
        triangle_part: geometry.triangle_part,
        parts: geometry.parts,
        materials,
        textures,
        lights,
        groups: Groups { lights: lights_groups, parts: parts_groups },
        sky: settings.sky,
        environment: None,
        cameras,
        offset: geometry.offset,
        cuts: super::Cuts::default(),
    };
    warnings.iter_mut().for_each(|w| w.message = error::one_line(&w.message));
    Ok(Warned { output: scene, warnings })
}
