//! The baked glTF: the input's text with lightmap coordinates, materials and textures spliced in.
//!
//! In: the scene with its source document, the atlas, the names of the pages' files. Out: the contents of the files to
//! write, the document last. What is added:
//! * `MOZ_lightmap` on materials (`index`, `texCoord`, `intensity`): a texel times `intensity` is irradiance;
//! * a texture per page, whose core image is the PNG preview and whose `extras.lightmap.uri` is the EXR, because a
//!   texture without a core image, or an EXR among the images, makes loaders refuse the file;
//! * `extras.lightmap` on the scenes that show baked nodes: a manifest of the pages, with the number of mip levels that
//!   loaders can make from them without mixing charts, and with what rules did to primitives (`treated`); a document
//!   without scenes gets one of all its nodes, which is what was baked;
//! * with light by normal, `directional` beside each of these URIs (see `output::directional`);
//! * with formats other than the plain EXR, `files` beside each of these URIs (see `formats`); with `--exr-image` the EXR
//!   among the images, too, behind `EXT_texture_exr` of the texture;
//! * a mesh per baked node that shares every accessor but its lightmap coordinates (`mesh`);
//! * lightmap coordinates as floats, or as normalised 16-bit integers, which core glTF has: then they are up to a
//!   131,070th of the page's side off, 1/64 texel at 2048, 1/8 texel at 16,384;
//! * `TEXCOORD_0` of zeros where there is none, since numbered attributes must not leave gaps.
//!
//! Vertex light goes another way with the same parts: `vertex`.
//!
//! Instances of `EXT_mesh_gpu_instancing` were made nodes of before (`scene`). Nothing is renumbered, nothing taken away but
//! what a former bake has left (`former`); every byte of the JSON outside of these places stays.
//!
//! Known limits: animations that point into a material do not reach its copies for further pages. With `extras` of a
//! scene that is no object there is no place for the manifest; the textures still name the EXR files.

mod append;
mod container;
mod former;
mod interpolate;
mod leftover;
mod material;
mod mesh;
mod plan;
mod preview;
mod treated;
mod vertex;

pub use preview::preview;
pub use treated::Treated;
pub use vertex::Attributes;
pub use vertex::VertexSettings;
pub use vertex::write_vertex_gltf;

use super::Error;
use super::Files;
use super::directional;
use super::names::PageFiles;
use super::names::parent;
use super::names::relative_uri;
use super::splice::Element;
use super::splice::Fault;
use super::splice::Splice;
use super::splice::quoted;
use crate::atlas::Atlas;
use crate::base::Warned;
use crate::base::Warning;
use crate::scene::Scene;
use append::Append;
use container::Container;
use former::Former;
use former::leave_out_colors;
use leftover::Leftover;
use material::Use;
use material::with_lightmap;
use mesh::Meshes;
use plan::Baked;
use plan::Elements;
use plan::Instance;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// What a lightmap texel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Quantity {
    /// E/π: radiance of a white diffuse surface [cd/m²].
    #[default]
    Radiosity,
    /// E [lx].
    Irradiance,
}

impl Quantity {
    /// Its name in files and options.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Radiosity => "radiosity",
            Self::Irradiance => "irradiance",
        }
    }

    /// Factor from texel to irradiance, as JSON.
    #[must_use]
    pub const fn intensity(self) -> &'static str {
        match self {
            Self::Radiosity => "3.141592653589793",
            Self::Irradiance => "1",
        }
    }
}

/// How to write the document.
#[derive(Debug, Clone)]
pub struct Settings {
    /// What the lightmap holds.
    pub quantity: Quantity,
    /// The file to write; `.glb` makes a GLB, anything else JSON with files beside it.
    pub output: PathBuf,
    /// Name and version of the program, added to `asset.generator`.
    pub generator: String,
    /// Write lightmap coordinates as normalised 16-bit integers.
    pub quantize_uv: bool,
}

/// The contents of the baked document and of the buffers beside it, the document last.
///
/// Warnings: `lightmap-uv-set`, `renumbered-vertices`, `glb-chunk-dropped`, `scene-extras`.
///
/// # Errors
/// If scene, atlas and pages do not belong together, or a name cannot be expressed as a URI.
pub fn write_gltf(
    scene: &Scene,
    atlas: &Atlas,
    pages: &[PageFiles],
    settings: &Settings,
) -> Result<Warned<Files>, Error> {
    let document = &scene.document;
    let mut warnings = Vec::new();
    if pages.len() != atlas.pages as usize {
        return Err(Error::invalid(&document.path, format!("{} files for {} pages", pages.len(), atlas.pages)));
    }
    let fault = |e: Fault| Error::invalid(&document.path, e.to_string());
    let root = Element::root(&document.json).map_err(fault)?;
    let elements = Elements::new(&root);
    let instances = plan::lightmapped(scene, atlas, &elements, &mut warnings)?;
    let materials = plan::material_users(&instances, &elements, Baked::uses).assign(elements.materials.len());
    let scenes = scenes_of(&root, &elements, &instances);
    let leftover = Leftover::new(&root, document, &elements, &instances);
    let append = Append::new(leftover.views, leftover.accessors);
    let former = Former::new(&root, &elements, &materials, scenes, !instances.is_empty(), leftover);
    let mut meshes = Meshes::new(scene, atlas, &elements, &materials, append);
    meshes.quantize_uv = settings.quantize_uv;
    let mut splice = Splice::new(&document.json);

    let texts: Result<Vec<String>, Error> = instances.iter().map(|i| meshes.mesh(i, &mut warnings)).collect();
    place_meshes(&mut splice, &root, &elements, &instances, texts?).map_err(fault)?;
    let elsewhere = shown_beside(&root, &elements, &former.scenes);
    leave_out_colors(&mut splice, document, &elements, &instances, &elsewhere).map_err(fault)?;
    former.leave_out(&mut splice, &root, &elements).map_err(fault)?;
    if !instances.is_empty() {
        let uris = PageUris::new(pages, settings)?;
        let first_texture = former.textures;
        let edit = |text: &str, l: Use| with_lightmap(text, first_texture + l.page as usize, l.set, settings.quantity);
        materials.write(&mut splice, &root, edit).map_err(fault)?;
        textures(&mut splice, &root, &uris, &former).map_err(fault)?;
        let manifest = manifest(scene, atlas, &uris, first_texture, settings.quantity);
        manifests(&mut splice, &root, &elements, &former.scenes, &manifest, &mut warnings).map_err(fault)?;
    }
    generator(&mut splice, &root, &settings.generator).map_err(fault)?;
    let container = Container::new(document, &root, &settings.output);
    let bytes = container.place(&mut splice, &root, meshes.append, &former, &mut warnings)?;
    let output = container.assemble(splice.apply().map_err(fault)?, bytes)?;
    Ok(Warned { output, warnings })
}

/// Puts the mesh of every instance into the document: in the place of its source, or behind the others.
fn place_meshes<B>(
    splice: &mut Splice<'_>,
    root: &Element<'_>,
    elements: &Elements<'_>,
    instances: &[Instance<B>],
    texts: Vec<String>,
) -> Result<(), Fault> {
    let mut added = Vec::new();
    for (instance, text) in instances.iter().zip(texts) {
        if instance.in_place {
            splice.replace(&elements.meshes[instance.mesh], text);
        } else {
            let index = elements.meshes.len() + added.len();
            for &node in core::iter::once(&instance.node).chain(&instance.also) {
                splice.set(&elements.nodes[node], "mesh", index.to_string())?;
            }
            added.push(text);
        }
    }
    splice.append_at(root, "meshes", added)
}

/// How the document refers to a page.
struct PageUri {
    name: String,
    /// The lightmap.
    uri: String,
    png: String,
    /// `, "files": […], "directional": {…}`, or nothing.
    files: String,
    /// The EXR, if it is to be among the images.
    image: Option<String>,
}

/// URIs of the pages' files from the document's folder.
struct PageUris {
    pages: Vec<PageUri>,
}

impl PageUris {
    fn new(pages: &[PageFiles], settings: &Settings) -> Result<Self, Error> {
        let folder = parent(&settings.output);
        let page = |page: &PageFiles| {
            let files: Vec<String> = page.files.iter().map(|f| f.json(folder)).collect::<Result<_, Error>>()?;
            let image = page.files.iter().find(|f| f.image).map(|f| relative_uri(folder, &f.path)).transpose()?;
            Ok(PageUri {
                name: page.exr.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
                uri: relative_uri(folder, page.files.first().map_or(&page.exr, |f| &f.path))?,
                png: relative_uri(folder, &page.png)?,
                files: listed(&files) + &directional::json(&page.directional, folder)?,
                image,
            })
        };
        Ok(Self { pages: pages.iter().map(page).collect::<Result<_, Error>>()? })
    }
}

/// The files of a page, if there are others than its EXR.
fn listed(files: &[String]) -> String {
    if files.is_empty() { String::new() } else { format!(", \"files\": [{}]", files.join(", ")) }
}

/// Sampler, images and textures of the pages, and the name of the extension.
fn textures(splice: &mut Splice<'_>, root: &Element<'_>, uris: &PageUris, former: &Former) -> Result<(), Fault> {
    let (sampler, first_image) = (former.samplers, former.images);
    let (mut images, mut textures) = (Vec::new(), Vec::new());
    for PageUri { name, uri, png, files, image } in &uris.pages {
        let source = first_image + images.len();
        images.push(format!("{{\"name\": {}, \"uri\": {}}}", quoted(&format!("{name}.preview")), quoted(png)));
        let mut extension = String::new();
        if let Some(exr) = image {
            extension = format!("\"extensions\": {{\"EXT_texture_exr\": {{\"source\": {}}}}}, ", source + 1);
            let (name, exr) = (quoted(name), quoted(exr));
            images.push(format!("{{\"name\": {name}, \"uri\": {exr}, \"mimeType\": \"image/x-exr\"}}"));
        }
        textures.push(format!(
            "{{\"name\": {}, \"sampler\": {sampler}, \"source\": {source}, {extension}\"extras\": {{\"lightmap\": {{\"uri\": {}{files}}}}}}}",
            quoted(name),
            quoted(uri)
        ));
    }
    // LINEAR for minification too: a sampler cannot say at which mip level to stop, and charts mix from some level on.
    // CLAMP_TO_EDGE in both directions.
    let linear = "{\"magFilter\": 9729, \"minFilter\": 9729, \"wrapS\": 33071, \"wrapT\": 33071}";
    splice.append_at(root, "samplers", vec![linear.to_owned()])?;
    splice.append_at(root, "images", images)?;
    splice.append_at(root, "textures", textures)?;
    let exr_image = uris.pages.iter().any(|p| p.image.is_some());
    declare(splice, root, if exr_image { &["MOZ_lightmap", "EXT_texture_exr"] } else { &["MOZ_lightmap"] })
}

/// Names extensions in `extensionsUsed`.
fn declare(splice: &mut Splice<'_>, root: &Element<'_>, extensions: &[&str]) -> Result<(), Fault> {
    let known: Vec<String> = root.array("extensionsUsed").iter().filter_map(Element::string).collect();
    let new: Vec<String> = extensions.iter().filter(|e| !known.iter().any(|k| k == *e)).map(|e| quoted(e)).collect();
    if new.is_empty() { Ok(()) } else { splice.append_at(root, "extensionsUsed", new) }
}

fn manifest(scene: &Scene, atlas: &Atlas, uris: &PageUris, first_texture: usize, quantity: Quantity) -> String {
    let [width, height] = atlas.page_size;
    let page = |(i, page): (usize, &PageUri)| {
        let (uri, texture, files) = (quoted(&page.uri), first_texture + i, &page.files);
        format!("{{\"uri\": {uri}, \"texture\": {texture}, \"width\": {width}, \"height\": {height}{files}}}")
    };
    let pages: Vec<String> = uris.pages.iter().enumerate().map(page).collect();
    format!(
        "{{\"version\": 1, \"quantity\": \"{}\", \"texCoord\": 1, \"mipLevels\": {}, \"pages\": [{}]{}}}",
        quantity.name(),
        atlas.mips,
        pages.join(", "),
        treated::manifest(scene)
    )
}

/// Scenes that show a baked node.
fn scenes_of<B>(root: &Element<'_>, elements: &Elements<'_>, instances: &[Instance<B>]) -> BTreeSet<usize> {
    let baked: BTreeSet<usize> = instances.iter().map(|i| i.node).collect();
    let shows = |scene: &Element<'_>| !nodes_of(scene, elements).is_disjoint(&baked);
    root.array("scenes").iter().enumerate().filter(|(_, scene)| shows(scene)).map(|(i, _)| i).collect()
}

/// Nodes that other scenes than these show.
fn shown_beside(root: &Element<'_>, elements: &Elements<'_>, scenes: &BTreeSet<usize>) -> BTreeSet<usize> {
    let all = root.array("scenes");
    let others = all.iter().enumerate().filter(|(i, _)| !scenes.contains(i));
    others.flat_map(|(_, scene)| nodes_of(scene, elements)).collect()
}

/// All nodes of a scene.
fn nodes_of(scene: &Element<'_>, elements: &Elements<'_>) -> BTreeSet<usize> {
    let mut seen = BTreeSet::new();
    let mut open: Vec<usize> = scene.array("nodes").iter().filter_map(Element::index).collect();
    while let Some(node) = open.pop() {
        if seen.insert(node) {
            let children = elements.nodes.get(node).map(|n| n.array("children")).unwrap_or_default();
            open.extend(children.iter().filter_map(Element::index));
        }
    }
    seen
}

/// Puts the manifest into the scenes that show a baked node.
fn manifests(
    splice: &mut Splice<'_>,
    root: &Element<'_>,
    elements: &Elements<'_>,
    shown: &BTreeSet<usize>,
    manifest: &str,
    warnings: &mut Vec<Warning>,
) -> Result<(), Fault> {
    if root.array("scenes").is_empty() {
        return lone_scene(splice, root, elements, manifest);
    }
    let scenes = root.array("scenes");
    for &i in shown {
        let scene = &scenes[i];
        if scene.get("extras").is_some_and(|e| !e.is_object()) {
            let message =
                format!("the extras of scene {i} are no object; the description of the lightmap was left out");
            warnings.push(Warning::new("scene-extras", message));
            continue;
        }
        splice.set_path(scene, &["extras", "lightmap"], manifest)?;
    }
    Ok(())
}

/// A scene of all nodes that are nobody's children, with the manifest.
fn lone_scene(
    splice: &mut Splice<'_>,
    root: &Element<'_>,
    elements: &Elements<'_>,
    manifest: &str,
) -> Result<(), Fault> {
    let children: BTreeSet<usize> =
        elements.nodes.iter().flat_map(|n| n.array("children")).filter_map(|c| c.index()).collect();
    let roots: Vec<String> =
        (0..elements.nodes.len()).filter(|n| !children.contains(n)).map(|n| n.to_string()).collect();
    let scene = format!("{{\"nodes\": [{}], \"extras\": {{\"lightmap\": {manifest}}}}}", roots.join(", "));
    splice.append_at(root, "scenes", vec![scene])?;
    splice.set_path(root, &["scene"], "0")
}

fn generator(splice: &mut Splice<'_>, root: &Element<'_>, ours: &str) -> Result<(), Fault> {
    let old = root.find(&["asset", "generator"]).and_then(|g| g.string()).filter(|g| !g.is_empty());
    match old {
        Some(old) if old.ends_with(ours) => Ok(()),
        Some(old) => splice.set_path(root, &["asset", "generator"], quoted(&format!("{old}; {ours}"))),
        None => splice.set_path(root, &["asset", "generator"], quoted(ours)),
    }
}
