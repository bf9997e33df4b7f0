//! The bake as OpenUSD: three `.usda` layers that compose.
//!
//! In: the scene, the light on it, the names of the pages' files. Out: for `room.usda`
//! * `room.geometry.usda`: the glTF's meshes and materials (`geometry`, `material`);
//! * `room.lightmap.usda`: `over` prims that add light to any layer with the same prim paths (`paths`) and faces. It
//!   changes no topology, since lightmap coordinates are per corner, and no look (`overlay`);
//! * `room.usda`: both as sublayers, and shows the light (`view`);
//! * images that USD cannot read where they are (`images`).
//!
//! Units: metres, y up, cd/m². Texture coordinates run upwards, v = 1 − v of glTF. Meshes are in world space.
//!
//! Light, by what was baked:
//! * pages: `primvars:st1`, per corner, or the next `stN` that no texture of the material reads; the attribute
//!   `texelwalk:lightmap` names the EXR, on the mesh or, if its faces lie on several pages, on a `GeomSubset` for each;
//!   a material that inherits the source's holds a `UsdUVTexture` named `Lightmap`;
//! * vertices: `primvars:texelwalk:light`, and `primvars:displayColor` = light as E/π times vertex colour.
//!
//! `UsdPreviewSurface` has no input for light and cannot multiply. So only `room.usda` shows it, as emission: the
//! lightmap times base colour × (1 − metallic) plus emission. That is the radiance of diffuse surfaces without
//! textures; of a texture it takes the mean. Light at vertices is shown without base colour. What has a
//! texture of emission shows that and no light; at vertices so does all that glows.
//!
//! Known limits: no cameras, no lights, no animations, no variants; no normal and occlusion maps; vertex colours are data
//! that materials do not read. With cut triangles the overlay fits our geometry layer only. Skinned and morphed meshes
//! stand in the pose that was baked.

mod geometry;
mod images;
mod material;
mod overlay;
mod paths;
mod text;
mod view;

use super::Error;
use super::Files;
use super::gltf::Quantity;
use super::names;
use crate::atlas::Atlas;
use crate::atlas::NO_CHART;
use crate::scene::Material;
use crate::scene::Scene;
use crate::vertices::VertexLight;
use crate::vertices::VertexPart;
use images::Images;
use paths::Paths;
use std::collections::BTreeSet;
use std::path::Path;
use std::path::PathBuf;

/// What was baked.
#[derive(Debug, Clone, Copy)]
pub enum Light<'a> {
    /// To pages; the files that hold them.
    Pages(&'a Atlas, &'a [names::PageFiles]),
    /// To vertices.
    Vertices(&'a VertexLight),
}

/// How to write it.
#[derive(Debug, Clone)]
pub struct Settings {
    /// What is stored.
    pub quantity: Quantity,
    /// The file to write; others go beside it.
    pub output: PathBuf,
    /// Name and version of the program.
    pub generator: String,
}

/// What all layers are made from.
struct Bake<'a> {
    scene: &'a Scene,
    light: Light<'a>,
    settings: &'a Settings,
    paths: Paths,
}

/// A material that also knows of light: of the source, and the page it reads; `None` = at vertices.
type Baked = (usize, Option<u32>);

/// The files of the layers: geometry, light, and `output` that composes them.
#[must_use]
pub fn layers(output: &Path) -> [PathBuf; 3] {
    let beside = |suffix| names::beside(output, suffix);
    [beside("geometry.usda"), beside("lightmap.usda"), output.to_path_buf()]
}

/// The layers and images, the layer that composes the others last.
///
/// # Errors
/// If scene and light do not belong together, or a name cannot be expressed in USD.
pub fn write_usd(scene: &Scene, light: Light<'_>, settings: &Settings) -> Result<Files, Error> {
    let parts = match light {
        Light::Pages(atlas, _) => atlas.parts.len(),
        Light::Vertices(vertices) => vertices.parts.len(),
    };
    if parts != scene.parts.len() {
        let message = format!("{} parts, but light for {parts}", scene.parts.len());
        return Err(Error::invalid(&scene.document.path, message));
    }
    let bake = Bake { scene, light, settings, paths: Paths::new(scene) };
    let images = Images::new(scene, &settings.output)?;
    let [geometry, lightmap, _] = layers(&settings.output);
    let view = view::layer(&bake, &[&lightmap, &geometry])?;
    let mut files = images.files.clone();
    files.push((geometry, geometry::layer(&bake, &images).into()));
    files.push((lightmap, overlay::layer(&bake)?.into()));
    files.push((settings.output.clone(), view.into()));
    Ok(files)
}

impl Bake<'_> {
    /// Metadata of every layer.
    fn metadata(&self, about: &str) -> Vec<String> {
        vec![
            text::string(&format!("{}: {about}", self.settings.generator)),
            "defaultPrim = \"World\"".to_owned(),
            "metersPerUnit = 1".to_owned(),
            "upAxis = \"Y\"".to_owned(),
        ]
    }

    /// Reference to a file from the layers.
    fn asset(&self, file: &Path) -> Result<String, Error> {
        asset(&self.settings.output, file)
    }

    /// Vertices and triangles of part `p` where light made new ones, or holds values for the old ones.
    fn lit_vertices(&self, p: usize) -> Option<&VertexPart> {
        match self.light {
            Light::Vertices(light) => light.parts.get(p).filter(|part| !part.triangles.is_empty()),
            Light::Pages(..) => None,
        }
    }

    /// Page of each triangle of part `p`; `None` if there is no light on the part. Triangles without a chart go along
    /// with the part's first page.
    fn pages(&self, p: usize) -> Option<Vec<u32>> {
        let Light::Pages(atlas, _) = self.light else { return None };
        let page = |c: u32| (c != NO_CHART).then(|| atlas.charts[c as usize].page);
        let charted = &atlas.parts[p];
        let first = charted.charts().filter_map(page).min().filter(|_| self.scene.parts[p].receives)?;
        Some(charted.charts().map(|c| page(c).unwrap_or(first)).collect())
    }

    /// Materials with light that are needed, in order.
    fn baked_materials(&self) -> BTreeSet<Baked> {
        let mut all = BTreeSet::new();
        for (p, part) in self.scene.parts.iter().enumerate() {
            all.extend(self.pages(p).unwrap_or_default().into_iter().map(|page| (part.material, Some(page))));
            all.extend(self.lit_vertices(p).map(|_| (part.material, None)));
        }
        all
    }

    /// Name of a material with light.
    fn baked_name(&self, (material, page): Baked) -> String {
        let name = self.paths.material(material);
        page.map_or_else(|| format!("{name}_vertices"), |page| format!("{name}_page{page}"))
    }
}

fn asset(layer: &Path, file: &Path) -> Result<String, Error> {
    text::asset(&names::relative_path(names::parent(layer), file)?, file)
}

/// Name of the primvar of `TEXCOORD_n`.
fn varname(set: usize) -> String {
    if set == 0 { "st".to_owned() } else { format!("st{set}") }
}

/// Sets that the textures of a material read.
fn texture_sets(material: &Material) -> BTreeSet<usize> {
    let textures = [&material.base_color_texture, &material.metallic_texture, &material.emission_texture];
    textures.into_iter().flatten().map(|t| t.uv_set).collect()
}

/// The set of a material's lightmap.
fn lightmap_set(material: &Material) -> usize {
    let taken = texture_sets(material);
    (1..).find(|set| !taken.contains(set)).unwrap_or(1)
}
