//! The baked glTF with light at its vertices: the input's text with attributes spliced in.
//!
//! In: the scene with its source document, and [`VertexLight`]. Out: the contents of the files to write, the document
//! last. What is added, by [`Attributes`]:
//! * `_LIGHTMAP`, VEC3 float: E/π or E as it is;
//! * `COLOR_0`, VEC4 of normalised 16-bit numbers: E/π over a scale that the whole file shares, times the colour that
//!   was there, because glTF multiplies base colour with it. The scale is in the manifest; without one given it is the
//!   largest value, so that nothing is clamped. `white` beside it: there were no colours (`scene` reads it back);
//! * `KHR_materials_unlit` on the materials, if asked for: plain viewers then show base colour × `COLOR_0`. Materials
//!   that glow stay as they are, because unlit ones do not;
//! * `extras.lightmap` on the scenes that show baked nodes: a manifest that names the attributes;
//! * a mesh per baked node that shares every other accessor, unless its triangles were cut: then all its attributes are
//!   written again with the new vertices behind the old ones (`interpolate`).
//!
//! `MOZ_lightmap` of a former bake goes, with what it alone needs (`former`): viewers would show both. Everything else of
//! the document stays, byte for byte.

use super::Quantity;
use super::append::Append;
use super::container::Container;
use super::former::Former;
use super::former::LIGHTMAP;
use super::former::leave_out_colors;
use super::former::without_light;
use super::interpolate::extended;
use super::leftover::Leftover;
use super::manifests;
use super::material::Assigned;
use super::material::Use;
use super::plan;
use super::plan::Elements;
use super::plan::Instance;
use crate::base::Rgb;
use crate::base::Warned;
use crate::base::Warning;
use crate::output::Error;
use crate::output::Files;
use crate::output::splice::Element;
use crate::output::splice::Fault;
use crate::output::splice::Splice;
use crate::scene::Scene;
use crate::vertices::VertexLight;
use crate::vertices::VertexPart;
use core::f32::consts::FRAC_1_PI;
use std::collections::BTreeMap;

/// Which attributes carry the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attributes {
    /// `_LIGHTMAP`.
    pub lightmap: bool,
    /// `COLOR_0`.
    pub color: bool,
}

/// How to write the document.
#[derive(Debug, Clone)]
pub struct VertexSettings {
    /// Quantity of the light that is given, output file and generator.
    pub common: super::Settings,
    /// Where the light goes.
    pub attributes: Attributes,
    /// Light that `COLOR_0` of 1 stands for [cd/m²]; `None` = the largest of it.
    pub scale: Option<f32>,
    /// Make materials unlit.
    pub unlit: bool,
}

/// Use of a material with vertex light that becomes unlit.
const UNLIT: Use = Use { page: 0, set: 0 };
/// Use of one that loses the lightmap of a former bake.
const PLAIN: Use = Use { page: 1, set: 0 };

/// The contents of the baked document and of the buffers beside it, the document last.
///
/// Warnings: `vertex-color-clamped`, `glb-chunk-dropped`, `scene-extras`.
///
/// # Errors
/// If scene and light do not belong together, or a name cannot be expressed as a URI.
pub fn write_vertex_gltf(
    scene: &Scene,
    light: &VertexLight,
    settings: &VertexSettings,
) -> Result<Warned<Files>, Error> {
    let document = &scene.document;
    let mut warnings = Vec::new();
    if light.parts.len() != scene.parts.len() {
        let message = format!("light of {} parts for {}", light.parts.len(), scene.parts.len());
        return Err(Error::invalid(&document.path, message));
    }
    let fault = |e: Fault| Error::invalid(&document.path, e.to_string());
    let root = Element::root(&document.json).map_err(fault)?;
    let elements = Elements::new(&root);
    let lit = (0..light.parts.len()).filter(|&p| !light.parts[p].triangles.is_empty());
    let instances = plan::instances(scene, &elements, lit.map(|p| (p, p)).collect())?;
    let has_lightmap = |m: &Element<'_>| m.find(&["extensions", LIGHTMAP]).is_some();
    let use_of = |p: &usize| {
        let part = &scene.parts[*p];
        if settings.unlit && !scene.materials[part.material].glows() {
            return vec![Some(UNLIT)];
        }
        let primitive = elements.primitives.get(part.mesh).and_then(|all| all.get(part.primitive));
        let mut materials = primitive.map(plan::materials_of).unwrap_or_default().into_iter().flatten();
        vec![materials.any(|m| elements.materials.get(m).is_some_and(has_lightmap)).then_some(PLAIN)]
    };
    let materials = plan::material_users(&instances, &elements, use_of).assign(elements.materials.len());
    let leftover = Leftover::new(&root, document, &elements, &instances);
    let mut writer = Writer {
        scene,
        light,
        elements: &elements,
        materials: &materials,
        settings,
        scale: settings.scale.unwrap_or_else(|| largest(scene, light, settings)),
        clamped: 0,
        refined: BTreeMap::new(),
        append: Append::new(leftover.views, leftover.accessors),
    };
    let scenes = super::scenes_of(&root, &elements, &instances);
    let former = Former::new(&root, &elements, &materials, scenes, false, leftover);
    let mut splice = Splice::new(&document.json);
    instances.iter().try_for_each(|i| writer.refine(i))?;
    let texts: Result<Vec<String>, Error> = instances.iter().map(|i| writer.mesh(i)).collect();
    super::place_meshes(&mut splice, &root, &elements, &instances, texts?).map_err(fault)?;
    let elsewhere = super::shown_beside(&root, &elements, &former.scenes);
    leave_out_colors(&mut splice, document, &elements, &instances, &elsewhere).map_err(fault)?;
    former.leave_out(&mut splice, &root, &elements).map_err(fault)?;
    if !instances.is_empty() {
        let manifest = writer.manifest();
        manifests(&mut splice, &root, &elements, &former.scenes, &manifest, &mut warnings).map_err(fault)?;
        materials.write(&mut splice, &root, edited).map_err(fault)?;
        if settings.unlit {
            super::declare(&mut splice, &root, &["KHR_materials_unlit"]).map_err(fault)?;
        }
    }
    super::generator(&mut splice, &root, &settings.common.generator).map_err(fault)?;
    if writer.clamped > 0 {
        let message = format!(
            "{} vertices are brighter than the scale {} of COLOR_0 and were clamped; raise --vertex-scale",
            writer.clamped, writer.scale
        );
        warnings.push(Warning::new("vertex-color-clamped", message));
    }
    let container = Container::new(document, &root, &settings.common.output);
    let bytes = container.place(&mut splice, &root, writer.append, &former, &mut warnings)?;
    let output = container.assemble(splice.apply().map_err(fault)?, bytes)?;
    Ok(Warned { output, warnings })
}

/// Factor from stored light to E/π.
fn radiosity(quantity: Quantity) -> f32 {
    match quantity {
        Quantity::Radiosity => 1.0,
        Quantity::Irradiance => FRAC_1_PI,
    }
}

/// Largest light times vertex colour [cd/m²]; 1 in the dark.
fn largest(scene: &Scene, light: &VertexLight, settings: &VertexSettings) -> f32 {
    let factor = radiosity(settings.common.quantity);
    let mut most = 0.0f32;
    for (p, part) in light.parts.iter().enumerate() {
        for v in 0..part.values.len() {
            most = most.max((color(scene, p, part, v).0 * factor).max_element());
        }
    }
    if most > 0.0 { most } else { 1.0 }
}

/// Light times the colour that vertex `v` of part `p` has, and its alpha.
fn color(scene: &Scene, p: usize, part: &VertexPart, v: usize) -> (Rgb, f32) {
    let origin = &part.origins[v];
    let first = scene.parts[p].vertices.start;
    let own = |k: usize| scene.vertex_color(first + origin.source[k]) * origin.weight[k];
    let base = own(0) + own(1) + own(2);
    (base.truncate() * part.values[v], base.w)
}

/// A material without a lightmap, and unlit if that is its use.
fn edited(material: &str, how: Use) -> Result<String, Fault> {
    let plain = plan::without_extension(material, LIGHTMAP)?;
    if how == PLAIN {
        return Ok(plain);
    }
    let root = Element::root(&plain)?;
    let mut splice = Splice::new(&plain);
    splice.set_path(&root, &["extensions", "KHR_materials_unlit"], "{}")?;
    splice.apply()
}

struct Writer<'a> {
    scene: &'a Scene,
    light: &'a VertexLight,
    elements: &'a Elements<'a>,
    materials: &'a Assigned,
    settings: &'a VertexSettings,
    /// Of `COLOR_0` [cd/m²].
    scale: f32,
    /// Vertices above it.
    clamped: u64,
    /// Of parts that get all their vertices anew, the accessors.
    refined: BTreeMap<usize, Refined>,
    append: Append,
}

/// Accessors of a primitive that gets all its vertices anew.
struct Refined {
    /// By attribute.
    attributes: BTreeMap<String, usize>,
    indices: usize,
}

impl Writer<'_> {
    fn manifest(&self) -> String {
        let VertexSettings { common, attributes, .. } = self.settings;
        let mut text = format!("{{\"version\": 1, \"quantity\": \"{}\"", common.quantity.name());
        if attributes.lightmap {
            text += ", \"attribute\": \"_LIGHTMAP\"";
        }
        if attributes.color {
            let scale = serde_json::Value::from(self.scale);
            let primitives = self.scene.document.root.meshes.iter().flat_map(|mesh| &mesh.primitives);
            let white = primitives.into_iter().all(|p| !p.attributes.contains_key("COLOR_0"));
            text += &format!(", \"color\": {{\"attribute\": \"COLOR_0\", \"scale\": {scale}, \"white\": {white}}}");
        }
        text + "}"
    }

    /// Writes the new vertices of an instance, before any light: the next bake takes light from the end.
    fn refine(&mut self, instance: &Instance<usize>) -> Result<(), Error> {
        let fault = |e: Fault| Error::invalid(&self.scene.document.path, e.to_string());
        for (&i, &p) in &instance.baked {
            let primitive = &self.elements.primitives[instance.mesh][i];
            if !self.light.parts[p].refined && !plan::is_compressed(primitive) {
                continue;
            }
            let place = [instance.mesh, i];
            let plain = without_light(primitive.text(), &self.scene.document, place, |_| false).map_err(fault)?;
            let root = Element::root(&plain).map_err(fault)?;
            let mut attributes = BTreeMap::new();
            for (name, element) in root.get("attributes").map(|a| a.members()).unwrap_or_default() {
                if !self.writes(&name) {
                    let accessor = self.interpolated(&name, &element, p)?;
                    attributes.insert(name, accessor);
                }
            }
            let indices = self.indices(p);
            self.refined.insert(p, Refined { attributes, indices });
        }
        Ok(())
    }

    fn mesh(&mut self, instance: &Instance<usize>) -> Result<String, Error> {
        let path = &self.scene.document.path;
        let fault = |e: Fault| Error::invalid(path, e.to_string());
        let text = self.elements.meshes[instance.mesh].text();
        let root = Element::root(text).map_err(fault)?;
        let mut splice = Splice::new(text);
        for (i, primitive) in root.array("primitives").iter().enumerate() {
            let part = instance.baked.get(&i);
            let stays = |name: &str| if part.is_some() { self.writes(name) } else { name == "_LIGHTMAP" };
            let place = [instance.mesh, i];
            let plain = without_light(primitive.text(), &self.scene.document, place, stays).map_err(fault)?;
            if let Some(&part) = part {
                splice.replace(primitive, self.primitive(&plain, part)?);
            } else if plain != primitive.text() {
                splice.replace(primitive, plain);
            }
        }
        splice.apply().map_err(fault)
    }

    fn primitive(&mut self, text: &str, p: usize) -> Result<String, Error> {
        let path = &self.scene.document.path;
        let fault = |e: Fault| Error::invalid(path, e.to_string());
        let plain = plan::uncompressed(text).map_err(fault)?;
        let root = Element::root(&plain).map_err(fault)?;
        let mut splice = Splice::new(&plain);
        if let Some(refined) = self.refined.get(&p) {
            for (name, element) in root.get("attributes").map(|a| a.members()).unwrap_or_default() {
                if let Some(accessor) = refined.attributes.get(&name) {
                    splice.replace(&element, accessor.to_string());
                }
            }
            splice.set(&root, "indices", refined.indices.to_string()).map_err(fault)?;
            if root.index_at("mode").is_some_and(|mode| mode != 4) {
                splice.set(&root, "mode", "4").map_err(fault)?;
            }
        }
        for (name, accessor) in self.light_attributes(p) {
            splice.set_path(&root, &["attributes", name], accessor.to_string()).map_err(fault)?;
        }
        for how in [UNLIT, PLAIN] {
            self.materials.set(&mut splice, &root, how).map_err(fault)?;
        }
        splice.apply().map_err(fault)
    }

    /// The attribute is one that carries the light.
    fn writes(&self, name: &str) -> bool {
        let Attributes { lightmap, color } = self.settings.attributes;
        lightmap && name == "_LIGHTMAP" || color && name == "COLOR_0"
    }

    fn light_attributes(&mut self, p: usize) -> Vec<(&'static str, usize)> {
        let part = &self.light.parts[p];
        let mut out = vec![];
        if self.settings.attributes.lightmap {
            out.push(("_LIGHTMAP", self.append.vectors(part.values.iter().map(Rgb::to_array))));
        }
        if self.settings.attributes.color {
            let factor = radiosity(self.settings.common.quantity) / self.scale;
            let mut clamped = 0;
            let scene = self.scene;
            let colors = (0..part.values.len()).map(|v| {
                let (light, alpha) = color(scene, p, part, v);
                let light = light * factor;
                // The largest value over itself may round to just above 1.
                clamped += u64::from(light.max_element() > 1.0 + f32::EPSILON);
                light.extend(alpha).to_array().map(|x| (x.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16)
            });
            out.push(("COLOR_0", self.append.colors(colors)));
            self.clamped += clamped;
        }
        out
    }

    /// The accessor of an attribute with the added vertices.
    fn interpolated(&mut self, name: &str, element: &Element<'_>, p: usize) -> Result<usize, Error> {
        let part = &self.scene.parts[p];
        let missing = || {
            let message = format!("{}, primitive {}: no usable accessor for {name}", part.name, part.primitive);
            Error::invalid(&self.scene.document.path, message)
        };
        let old = element.index().and_then(|source| self.elements.accessors.get(source)).ok_or_else(missing)?;
        let document = &self.scene.document;
        let data = document.accessor(document.root.attribute(part.mesh, part.primitive, name).ok_or_else(missing)?)?;
        let data = extended(&data, name, &self.light.parts[p].origins).ok_or_else(missing)?;
        let all: Vec<u32> = (0..data.count as u32).collect();
        Ok(self.append.rewritten(old, name, &data, &all))
    }

    /// Triangles in the document's winding.
    fn indices(&mut self, p: usize) -> usize {
        let mirrored = self.scene.parts[p].mirrored;
        let turned = |&[a, b, c]: &[u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
        let list: Vec<u32> = self.light.parts[p].triangles.iter().flat_map(turned).collect();
        self.append.indices(&list)
    }
}
