//! Puts the parts of the loader in order: container, extensions, buffers, what is compressed, instances, light in vertex
//! colours, nodes, materials, geometry, images, lights.

use super::Document;
use super::Error;
use super::Instances;
use super::Rule;
use super::Scene;
use super::Sky;
use super::cameras;
use super::error;
use super::extensions;
use super::footprint::Footprint;
use super::geometry;
use super::group::Groups;
use super::image_light;
use super::images;
use super::instances;
use super::lamps;
use super::material;
use super::nodes;
use super::punctual;
use super::reduce;
use super::treat::Treater;
use super::variants;
use crate::base::MemoryLimit;
use crate::base::Warned;
use std::path::Path;

/// What to take from the document, and what it cannot say.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Settings {
    /// Index of the scene; `None` = the document's default scene, else scene 0, else all root nodes.
    pub scene: Option<usize>,
    /// Light from infinity; if there is any, that of `EXT_lights_image_based` is left out.
    pub sky: Sky,
    /// Angular diameter of every sun [rad]; `None` = what the document says in `extras`, else 0.
    pub sun_angle: Option<f32>,
    /// Radius of every point and spot light [m]; `None` = what the document says in `extras`, else 0.
    pub light_radius: Option<f32>,
    /// What to do otherwise with what has certain names; later ones win.
    pub rules: Vec<Rule>,
    /// What meshes get that several nodes place, unless rules or `extras` say otherwise.
    pub instances: Instances,
    /// Store geometry that several nodes place once, where that leaves out so many triangles or more; `None` = from
    /// [`SHARE_FROM`] on. Memory, time, and charts (of copies in one shape those
    /// of the first) depend on it, no light does.
    pub share_from: Option<usize>,
    /// Name of the variant whose materials are taken; `None` = those of the primitives themselves.
    pub variant: Option<String>,
    /// Normal maps bend the normals that light falls on.
    pub normal_maps: bool,
    /// Texels per metre that diffuse reflectance is wanted for: images that serve nothing else are scaled down to a
    /// quarter of a texel. `None` = all images stay as they are.
    pub albedo_density: Option<f32>,
    /// Most memory that a bake may need for the scene alone [bytes].
    pub memory_limit: Option<MemoryLimit>,
}

/// Triangles from which on it is worth it to share them: they take about a gigabyte, and rays among copies take longer.
pub const SHARE_FROM: usize = 1 << 22;

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
    if let Some(variant) = &settings.variant {
        variants::choose(&mut document.root, variant)?;
    }
    document.load_buffers()?;
    document.decompress_views()?;
    document.decompress_primitives()?;
    document.expand_instances()?;
    document.set_baked_colors_aside(settings.scene)?;
    let mut walk = nodes::walk(&document.root, settings.scene, &mut warnings)?;
    let mut materials = material::read(&document.root, settings.normal_maps, &mut warnings)?;
    let mut footprint = Footprint::of_document(&document);
    let mut geometry = geometry::read(&document, &mut walk, &materials, settings, &mut footprint, &mut warnings)?;
    if geometry.triangles.is_empty() {
        return Err(Error::invalid("nothing to bake: the scene has no visible triangles"));
    }
    let profiles = lamps::read(&mut document, &walk, &mut warnings)?;
    let mut treater = Treater::new(&document.root, &walk, settings, &mut warnings);
    let parts_groups = treater.parts(&walk, &mut geometry.parts, &materials, &mut warnings)?;
    let shown = instances::resolve(&mut geometry.parts);
    geometry::check_lit(&geometry.parts)?;
    footprint = footprint.with_lit(&geometry.parts, |p| geometry.copies.is_copied(p));
    footprint.admit(settings.memory_limit)?;
    let sizes = [settings.sun_angle, settings.light_radius];
    let shining = punctual::read(&document.root, &walk, &profiles, sizes, &mut treater, &mut warnings)?;
    warnings.extend(treater.unused());
    let mut used = vec![false; materials.len()];
    geometry.parts.iter().for_each(|part| used[part.material] = true);
    for (material, _) in materials.iter_mut().zip(used).filter(|(_, used)| !used) {
        material.base_color_texture = None;
        material.metallic_texture = None;
        material.emission_texture = None;
        material.specular_texture = None;
        material.transmission_texture = None;
        material.volume = None;
        material.translucency = None;
        material.normal_map = None;
    }
    let uses = |density: f32| reduce::uses(&document.root, &geometry, &materials, density);
    let coarse = settings.albedo_density.map(uses).unwrap_or_default();
    let decoded = images::decode(&mut document, &materials, &coarse, &mut warnings, |pixels| {
        footprint.texture_pixels = pixels.kept;
        footprint.passing_pixels = pixels.passing;
        footprint.admit(settings.memory_limit)
    })?;
    for material in &mut materials {
        material.read_products(&decoded.products);
    }
    let environment = if settings.sky.is_black() { image_light::read(&mut document, settings.scene)? } else { None };
    let cameras = cameras::read(&document.root, &walk, &mut warnings);
    let scene = Scene {
        document,
        vertices: geometry.vertices,
        triangles: geometry.triangles,
        triangle_part: geometry.triangle_part,
        parts: geometry.parts,
        materials,
        textures: decoded.textures,
        lights: shining.lights,
        light_nodes: shining.nodes,
        groups: Groups { lights: shining.groups, parts: parts_groups },
        sky: settings.sky,
        environment,
        cameras,
        offset: geometry.offset,
        copies: geometry.copies,
        shown,
        cuts: super::Cuts::default(),
    };
    warnings.iter_mut().for_each(|w| w.message = error::one_line(&w.message));
    Ok(Warned { output: scene, warnings })
}
