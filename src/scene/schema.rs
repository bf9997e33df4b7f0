//! The parts of a glTF 2.0 document that a bake reads, as typed data.
//!
//! In: JSON text. Out: [`Root`], with the defaults of the specification where a property is missing. Nothing is checked
//! here beyond JSON types: an index may be out of range, a buffer too short. Whoever uses a value checks it.
//!
//! Why not the `gltf` crate: it cannot parse a file that uses `KHR_animation_pointer` (an animation target without a
//! node), refuses documents that require extensions it does not know though they do not touch diffuse light, and
//! panics or returns nothing on quantised accessors. What a bake reads is small, so the schema is our own: unknown
//! properties and extensions are ignored, known extensions are typed.
//!
//! Integers may be written with a zero fraction (`5126.0`; glTF 2.0, section 2.7).

#![allow(missing_docs, reason = "the names are those of the glTF 2.0 specification and its extensions")]

pub use super::animation::Animation;
pub use super::draco::Draco;
pub use super::extras::Own;
pub use super::image_light::{ImageLightList, SceneExtensions};
pub use super::instancing::Instancing;
pub use super::lamps::{NodeProfile, ProfileEntry, ProfileList};
pub use super::levels::Levels;
pub use super::meshopt::{CompressedView, Fallback, Meshopt};
pub use super::optics::{DiffuseTransmission, EmissiveStrength, SpecularGlossiness, Transmission};
pub use super::variants::{Mappings, VariantList};
pub use super::volume::VolumeEntry;
use serde::Deserialize;
use serde::Deserializer;
use serde::de::IgnoredAny;
use serde_json::Value;
use std::collections::BTreeMap;

/// Attribute semantic → accessor index.
pub type Attributes = BTreeMap<String, usize>;

/// A whole document.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Root {
    pub asset: Option<Asset>,
    pub extensions_used: Vec<String>,
    pub extensions_required: Vec<String>,
    #[serde(deserialize_with = "optional")]
    pub scene: Option<usize>,
    pub scenes: Vec<SceneEntry>,
    pub nodes: Vec<Node>,
    pub meshes: Vec<Mesh>,
    pub accessors: Vec<Accessor>,
    pub buffer_views: Vec<BufferView>,
    pub buffers: Vec<Buffer>,
    pub materials: Vec<MaterialEntry>,
    pub textures: Vec<TextureEntry>,
    pub images: Vec<Image>,
    pub samplers: Vec<Sampler>,
    pub cameras: Vec<CameraEntry>,
    pub skins: Vec<Skin>,
    pub animations: Vec<Animation>,
    pub extensions: RootExtensions,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Asset {
    pub version: String,
    pub min_version: Option<String>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct RootExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub lights: Option<LightList>,
    #[serde(rename = "EXT_lights_ies")]
    pub profiles: Option<ProfileList>,
    #[serde(rename = "EXT_lights_image_based")]
    pub image_lights: Option<ImageLightList>,
    #[serde(rename = "KHR_materials_variants")]
    pub variants: Option<VariantList>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct LightList {
    pub lights: Vec<LightEntry>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(default)]
pub struct LightEntry {
    pub name: Option<String>,
    #[serde(rename = "type")]
    pub kind: String,
    pub color: [f32; 3],
    pub intensity: f32,
    pub range: Option<f32>,
    pub spot: Spot,
    pub extras: Value,
}

impl Default for LightEntry {
    fn default() -> Self {
        Self {
            name: None,
            kind: String::new(),
            color: [1.0; 3],
            intensity: 1.0,
            range: None,
            spot: Spot::default(),
            extras: Value::Null,
        }
    }
}

#[derive(Debug, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Spot {
    pub inner_cone_angle: f32,
    pub outer_cone_angle: f32,
}

impl Default for Spot {
    fn default() -> Self {
        Self { inner_cone_angle: 0.0, outer_cone_angle: core::f32::consts::FRAC_PI_4 }
    }
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct SceneEntry {
    pub name: Option<String>,
    #[serde(deserialize_with = "list")]
    pub nodes: Vec<usize>,
    pub extensions: SceneExtensions,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Node {
    pub name: Option<String>,
    #[serde(deserialize_with = "list")]
    pub children: Vec<usize>,
    #[serde(deserialize_with = "optional")]
    pub mesh: Option<usize>,
    #[serde(deserialize_with = "optional")]
    pub camera: Option<usize>,
    #[serde(deserialize_with = "optional")]
    pub skin: Option<usize>,
    pub matrix: Option<[f64; 16]>,
    pub translation: Option<[f64; 3]>,
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
    pub weights: Option<Vec<f32>>,
    pub extensions: NodeExtensions,
    pub extras: Own,
    /// Which instance of `EXT_mesh_gpu_instancing` it stands for; 0 for any other node.
    #[serde(skip)]
    pub instance: usize,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct NodeExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub light: Option<NodeLight>,
    #[serde(rename = "EXT_lights_ies")]
    pub ies: Option<NodeProfile>,
    #[serde(rename = "KHR_node_visibility")]
    pub visibility: Option<Visibility>,
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub instancing: Option<Instancing>,
    #[serde(rename = "MSFT_lod")]
    pub levels: Option<Levels>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct NodeLight {
    #[serde(deserialize_with = "optional")]
    pub light: Option<usize>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(default)]
pub struct Visibility {
    pub visible: bool,
}

impl Default for Visibility {
    fn default() -> Self {
        Self { visible: true }
    }
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Mesh {
    pub name: Option<String>,
    pub primitives: Vec<Primitive>,
    pub weights: Option<Vec<f32>>,
    pub extras: Own,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Primitive {
    #[serde(deserialize_with = "map")]
    pub attributes: Attributes,
    #[serde(deserialize_with = "optional")]
    pub indices: Option<usize>,
    #[serde(deserialize_with = "optional")]
    pub material: Option<usize>,
    #[serde(deserialize_with = "optional")]
    pub mode: Option<usize>,
    #[serde(deserialize_with = "maps")]
    pub targets: Vec<Attributes>,
    pub extensions: PrimitiveExtensions,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub draco: Option<Draco>,
    #[serde(rename = "KHR_materials_variants")]
    pub variants: Option<Mappings>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Accessor {
    #[serde(deserialize_with = "optional")]
    pub buffer_view: Option<usize>,
    #[serde(deserialize_with = "required")]
    pub byte_offset: usize,
    #[serde(deserialize_with = "required")]
    pub component_type: usize,
    pub normalized: bool,
    #[serde(deserialize_with = "required")]
    pub count: usize,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<Sparse>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Sparse {
    #[serde(deserialize_with = "required")]
    pub count: usize,
    pub indices: SparsePart,
    pub values: SparsePart,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct SparsePart {
    #[serde(deserialize_with = "optional")]
    pub buffer_view: Option<usize>,
    #[serde(deserialize_with = "required")]
    pub byte_offset: usize,
    /// Of the indices; the values have the accessor's.
    #[serde(deserialize_with = "required")]
    pub component_type: usize,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct BufferView {
    #[serde(deserialize_with = "optional")]
    pub buffer: Option<usize>,
    #[serde(deserialize_with = "required")]
    pub byte_offset: usize,
    #[serde(deserialize_with = "required")]
    pub byte_length: usize,
    #[serde(deserialize_with = "optional")]
    pub byte_stride: Option<usize>,
    pub extensions: Meshopt<CompressedView>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Buffer {
    pub uri: Option<String>,
    #[serde(deserialize_with = "required")]
    pub byte_length: usize,
    pub extensions: Meshopt<Fallback>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct MaterialEntry {
    pub name: Option<String>,
    pub pbr_metallic_roughness: Pbr,
    pub emissive_factor: [f32; 3],
    pub emissive_texture: Option<TextureInfo>,
    /// Read where it is wanted: what is wrong with it does not matter elsewhere.
    pub normal_texture: Option<Value>,
    pub alpha_mode: String,
    pub alpha_cutoff: f32,
    pub double_sided: bool,
    pub extensions: MaterialExtensions,
    pub extras: Own,
}

impl Default for MaterialEntry {
    fn default() -> Self {
        Self {
            name: None,
            pbr_metallic_roughness: Pbr::default(),
            emissive_factor: [0.0; 3],
            emissive_texture: None,
            normal_texture: None,
            alpha_mode: "OPAQUE".to_owned(),
            alpha_cutoff: 0.5,
            double_sided: false,
            extensions: MaterialExtensions::default(),
            extras: Own::Missing,
        }
    }
}

#[derive(Debug, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Pbr {
    pub base_color_factor: [f32; 4],
    pub base_color_texture: Option<TextureInfo>,
    /// 1 where there is none.
    pub metallic_factor: Option<f32>,
    pub roughness_factor: f32,
    pub metallic_roughness_texture: Option<TextureInfo>,
}

impl Default for Pbr {
    fn default() -> Self {
        Self {
            base_color_factor: [1.0; 4],
            base_color_texture: None,
            metallic_factor: None,
            roughness_factor: 1.0,
            metallic_roughness_texture: None,
        }
    }
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct MaterialExtensions {
    #[serde(rename = "KHR_materials_emissive_strength")]
    pub emissive_strength: Option<EmissiveStrength>,
    #[serde(rename = "KHR_materials_unlit")]
    pub unlit: Option<IgnoredAny>,
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    pub specular_glossiness: Option<SpecularGlossiness>,
    #[serde(rename = "KHR_materials_transmission")]
    pub transmission: Option<Transmission>,
    #[serde(rename = "KHR_materials_volume")]
    pub volume: Option<VolumeEntry>,
    #[serde(rename = "KHR_materials_diffuse_transmission")]
    pub diffuse_transmission: Option<DiffuseTransmission>,
    #[serde(rename = "MOZ_lightmap")]
    pub lightmap: Option<TextureInfo>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct TextureInfo {
    #[serde(deserialize_with = "optional")]
    pub index: Option<usize>,
    #[serde(deserialize_with = "required")]
    pub tex_coord: usize,
    pub extensions: TextureInfoExtensions,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct TextureInfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub transform: Option<TextureTransform>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct TextureTransform {
    pub offset: [f32; 2],
    pub rotation: f32,
    pub scale: [f32; 2],
    #[serde(deserialize_with = "optional")]
    pub tex_coord: Option<usize>,
}

impl Default for TextureTransform {
    fn default() -> Self {
        Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2], tex_coord: None }
    }
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct TextureEntry {
    #[serde(deserialize_with = "optional")]
    pub sampler: Option<usize>,
    #[serde(deserialize_with = "optional")]
    pub source: Option<usize>,
    pub extensions: TextureExtensions,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct TextureExtensions {
    #[serde(rename = "EXT_texture_webp")]
    pub webp: Option<TextureSource>,
    #[serde(rename = "KHR_texture_basisu")]
    pub basisu: Option<TextureSource>,
    #[serde(rename = "MSFT_texture_dds")]
    pub dds: Option<TextureSource>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct TextureSource {
    #[serde(deserialize_with = "optional")]
    pub source: Option<usize>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Image {
    pub name: Option<String>,
    pub uri: Option<String>,
    #[serde(deserialize_with = "optional")]
    pub buffer_view: Option<usize>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Sampler {
    #[serde(deserialize_with = "optional")]
    pub mag_filter: Option<usize>,
    #[serde(deserialize_with = "optional")]
    pub wrap_s: Option<usize>,
    #[serde(deserialize_with = "optional")]
    pub wrap_t: Option<usize>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct CameraEntry {
    pub perspective: Option<Perspective>,
    pub orthographic: Option<Orthographic>,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Perspective {
    pub aspect_ratio: Option<f32>,
    pub yfov: f32,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Orthographic {
    pub xmag: f32,
    pub ymag: f32,
}

#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct Skin {
    #[serde(deserialize_with = "optional")]
    pub inverse_bind_matrices: Option<usize>,
    #[serde(deserialize_with = "list")]
    pub joints: Vec<usize>,
}

impl Root {
    /// Name of a node for messages: its own, or `node 7`.
    #[must_use]
    pub fn node_name(&self, node: usize) -> String {
        label(self.nodes.get(node).and_then(|n| n.name.as_deref()), "node", node)
    }

    /// Name of a primitive for messages: `mesh "Chair", primitive 2`.
    #[must_use]
    pub fn primitive_name(&self, mesh: usize, primitive: usize) -> String {
        match self.meshes.get(mesh).and_then(|m| m.name.as_deref()).filter(|n| !n.is_empty()) {
            Some(name) => format!("mesh {mesh} \"{}\", primitive {primitive}", label(Some(name), "mesh", mesh)),
            None => format!("mesh {mesh}, primitive {primitive}"),
        }
    }

    /// The accessor with the values of a primitive's attribute. The text names another where compressed meshes share it.
    #[must_use]
    pub fn attribute(&self, mesh: usize, primitive: usize, semantic: &str) -> Option<usize> {
        self.meshes.get(mesh)?.primitives.get(primitive)?.attributes.get(semantic).copied()
    }

    /// The lights of `KHR_lights_punctual`.
    #[must_use]
    pub fn lights(&self) -> &[LightEntry] {
        self.extensions.lights.as_ref().map_or(&[], |l| &l.lights)
    }

    /// The files of `EXT_lights_ies`.
    #[must_use]
    pub fn profiles(&self) -> &[ProfileEntry] {
        self.extensions.profiles.as_ref().map_or(&[], |l| &l.lights)
    }
}

/// Longest name in a message, in characters.
const MAX_NAME: usize = 80;

/// `name`, cut if very long, or `kind 7` where it is missing or empty.
pub(super) fn label(name: Option<&str>, kind: &str, index: usize) -> String {
    match name {
        Some(name) if !name.is_empty() => match name.char_indices().nth(MAX_NAME) {
            Some((end, _)) => format!("{}…", &name[..end]),
            None => name.to_owned(),
        },
        _ => format!("{kind} {index}"),
    }
}

/// A non-negative integer, also when it is written as `5.0`.
struct Integer(usize);

impl<'de> Deserialize<'de> for Integer {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl serde::de::Visitor<'_> for Visitor {
            type Value = Integer;
            fn expecting(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                f.write_str("an integer ≥ 0")
            }
            fn visit_u64<E: serde::de::Error>(self, v: u64) -> Result<Integer, E> {
                usize::try_from(v).map(Integer).map_err(|_| E::custom("integer too large"))
            }
            fn visit_f64<E: serde::de::Error>(self, v: f64) -> Result<Integer, E> {
                // Above 2^53 a float no longer names one integer.
                if (0.0..=9_007_199_254_740_992.0).contains(&v) && v.fract() == 0.0 {
                    Ok(Integer(v as usize))
                } else {
                    Err(E::invalid_value(serde::de::Unexpected::Float(v), &self))
                }
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}

pub(super) fn required<'de, D: Deserializer<'de>>(d: D) -> Result<usize, D::Error> {
    Integer::deserialize(d).map(|i| i.0)
}

pub(super) fn optional<'de, D: Deserializer<'de>>(d: D) -> Result<Option<usize>, D::Error> {
    Option::<Integer>::deserialize(d).map(|o| o.map(|i| i.0))
}

fn list<'de, D: Deserializer<'de>>(d: D) -> Result<Vec<usize>, D::Error> {
    Vec::<Integer>::deserialize(d).map(|v| v.into_iter().map(|i| i.0).collect())
}

fn plain(map: BTreeMap<String, Integer>) -> Attributes {
    map.into_iter().map(|(k, i)| (k, i.0)).collect()
}

pub(super) fn map<'de, D: Deserializer<'de>>(d: D) -> Result<Attributes, D::Error> {
    BTreeMap::deserialize(d).map(plain)
}

fn maps<'de, D: Deserializer<'de>>(d: D) -> Result<Vec<Attributes>, D::Error> {
    Vec::deserialize(d).map(|v: Vec<BTreeMap<String, Integer>>| v.into_iter().map(plain).collect())
}
