//! Materials as diffuse light sees them: reflectance, emission, alpha, sides.
//!
//! Source: glTF 2.0, section 3.9; `KHR_materials_emissive_strength`, `KHR_materials_unlit`, `KHR_texture_transform`;
//! `optics` has the extensions about reflection and transmission.
//!
//! The rotation of `KHR_texture_transform`: the extension's GLSL listing, read as the column-major code that it is,
//! turns the other way than its own text and its own example say, and than viewers do (KhronosGroup/glTF#1563). We
//! follow the example: u' = u·cos + v·sin, v' = −u·sin + v·cos, after the scale and before the offset.

use super::Error;
use super::Part;
use super::Scene;
use super::Volume;
use super::primitive::MAX_UV_SETS;
use super::schema::MaterialEntry;
use super::schema::Root;
use super::schema::SpecularGlossiness;
use super::schema::TextureInfo;
use super::schema::label;
use crate::base::Rgb;
use crate::base::Warning;
use glam::Affine2;
use glam::Mat2;
use glam::Vec2;
use glam::Vec4;
use serde::Deserialize;
use std::collections::BTreeSet;

/// A glTF material, reduced to what a diffuse bake uses. Factors are linear.
#[derive(Debug, Clone)]
pub struct Material {
    /// Name in the document, or `material 3`.
    pub name: String,
    /// Base colour factor, alpha in w.
    pub base_color: Vec4,
    /// Multiplies `base_color` (sRGB encoded).
    pub base_color_texture: Option<TextureRef>,
    /// Metallic factor.
    pub metallic: f32,
    /// Blue channel multiplies `metallic` (linear).
    pub metallic_texture: Option<TextureRef>,
    /// Multiplies the factor of `base_color` (sRGB encoded): base colour and what metalness or specular colours leave of
    /// it in one texture, for reflectance instead of theirs; only where images were scaled down.
    pub diffuse_texture: Option<TextureRef>,
    /// Specular factor of a material that has a texture of specular colours; else black.
    pub specular: Rgb,
    /// Multiplies `specular` (sRGB encoded).
    pub specular_texture: Option<TextureRef>,
    /// Share of the light that passes, tinted by the base colour; 0 for all but `KHR_materials_transmission`.
    pub transmission: f32,
    /// Red channel multiplies `transmission` (linear).
    pub transmission_texture: Option<TextureRef>,
    /// What the light that passes loses inside; only with `transmission`.
    pub volume: Option<Volume>,
    /// Light that leaves on the other side.
    pub translucency: Option<Translucency>,
    /// Emissive factor times strength [cd/m²].
    pub emission: Rgb,
    /// Multiplies `emission` (sRGB encoded).
    pub emission_texture: Option<TextureRef>,
    /// Bends the normal that light falls on; only where that is wanted.
    pub normal_map: Option<NormalMap>,
    /// What alpha does.
    pub alpha: Alpha,
    /// Both sides are lit; otherwise the back absorbs.
    pub double_sided: bool,
    /// `KHR_materials_unlit`: blocks light, reflects and emits none.
    pub unlit: bool,
    /// Index into `Vertices::uv` that `MOZ_lightmap` reads.
    pub lightmap_uv_set: Option<usize>,
    /// Index of the texture that it reads: one for each page.
    pub lightmap_texture: Option<usize>,
}

/// A normal map.
#[derive(Debug, Clone, Copy)]
pub struct NormalMap {
    /// Normals as colours (linear).
    pub texture: TextureRef,
    /// Multiplies red and green; any finite number.
    pub scale: f32,
}

/// `KHR_materials_diffuse_transmission`.
#[derive(Debug, Clone)]
pub struct Translucency {
    /// Share of the scattered light that leaves on the other side, > 0.
    pub factor: f32,
    /// Alpha multiplies `factor` (linear).
    pub factor_texture: Option<TextureRef>,
    /// Colour of that light.
    pub color: Rgb,
    /// Multiplies `color` (sRGB encoded).
    pub color_texture: Option<TextureRef>,
}

/// Alpha mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Alpha {
    /// Alpha is ignored.
    Opaque,
    /// Points with alpha below the cut-off do not exist.
    Mask(f32),
    /// Passes light with probability 1 − alpha.
    Blend,
}

/// A use of a texture.
#[derive(Debug, Clone, Copy)]
pub struct TextureRef {
    /// Index into `Scene::textures`.
    pub texture: usize,
    /// Index into `Vertices::uv`; always valid.
    pub uv_set: usize,
    /// `KHR_texture_transform`: texture uv = transform × mesh uv.
    pub transform: Affine2,
}

impl Alpha {
    /// What it leaves of the surface, in [0, 1].
    #[must_use]
    pub fn coverage(self, alpha: f32) -> f32 {
        match self {
            Self::Opaque => 1.0,
            Self::Mask(cutoff) => f32::from(u8::from(alpha >= cutoff)),
            Self::Blend => alpha.clamp(0.0, 1.0),
        }
    }
}

impl Material {
    /// It stops all light everywhere.
    #[must_use]
    pub fn is_opaque(&self) -> bool {
        self.alpha == Alpha::Opaque && self.transmission == 0.0
    }

    /// Light that falls on either side takes part.
    #[must_use]
    pub fn is_two_sided(&self) -> bool {
        self.double_sided || self.translucency.is_some()
    }

    /// A texture makes what it does with light differ from point to point.
    #[must_use]
    pub fn varies(&self) -> bool {
        self.textures().count() > usize::from(self.normal_map.is_some())
    }

    /// It sends out light; where, its texture says.
    #[must_use]
    pub fn glows(&self) -> bool {
        !self.unlit && self.emission.max_element() > 0.0
    }

    /// Takes the product of two textures for diffuse reflectance, where the second one holds that.
    pub(super) fn read_products(&mut self, products: &BTreeSet<usize>) {
        let second = self.metallic_texture.or(self.specular_texture);
        self.diffuse_texture = second.filter(|r| products.contains(&r.texture));
    }

    /// The textures that it uses.
    pub(super) fn textures(&self) -> impl Iterator<Item = &TextureRef> {
        let color = [&self.base_color_texture, &self.metallic_texture, &self.emission_texture];
        let through = self.translucency.iter().flat_map(|t| [&t.factor_texture, &t.color_texture]);
        let inside = self.volume.iter().map(|v| &v.thickness_texture);
        let all = color.into_iter().chain([&self.specular_texture, &self.transmission_texture]);
        all.chain(through).chain(inside).flatten().chain(self.normal_map.iter().map(|map| &map.texture))
    }

    /// The texture coordinates that it uses.
    pub(super) fn uv_sets(&self) -> impl Iterator<Item = usize> {
        self.textures().map(|t| t.uv_set).chain(self.lightmap_uv_set)
    }
}

/// All materials of the document, then the default one. Textures that cannot matter are left out: their factor is zero,
/// or the material is unlit (its base colour stays, for pictures of it). Normal maps are read if they are wanted.
pub(super) fn read(root: &Root, normal_maps: bool, warnings: &mut Vec<Warning>) -> Result<Vec<Material>, Error> {
    let mut materials = Vec::with_capacity(root.materials.len() + 1);
    for (index, entry) in root.materials.iter().enumerate() {
        let name = label(entry.name.as_deref(), "material", index);
        let context = format!("material {index} \"{name}\"");
        let mut material = convert(entry, name, root, warnings).map_err(|e| e.within(&context))?;
        if normal_maps && !material.unlit {
            material.normal_map = normal_map(entry, root).map_err(|e| e.within(&context))?;
        }
        materials.push(material);
    }
    materials.push(convert(&MaterialEntry::default(), "default material".to_owned(), root, warnings)?);
    Ok(materials)
}

impl Scene {
    /// Warns of surface that is lit and has no material: by glTF's defaults that is metal, which reflects no diffuse light,
    /// and shows none of its lightmap in viewers. Models that get their looks from a program often come that way.
    #[must_use]
    pub fn missing_materials(&self) -> Option<Warning> {
        let default = self.materials.len().checked_sub(1)?;
        let mut without = self.parts.iter().filter(|part| part.receives && part.material == default);
        let first = without.next()?;
        let others = match without.count() {
            0 => " has".to_owned(),
            n => format!(" and {n} more primitives have"),
        };
        let what = format!(
            "{}, primitive {}{others} no material; by glTF's defaults that is metal, which reflects no diffuse light and \
             shows none of its lightmap; use one with metallicFactor 0",
            first.name, first.primitive
        );
        Some(Warning::new("no-material", what).at(&first.name))
    }

    /// Warns of materials of lit surface that are metal only because nothing says what they are: glTF's default for
    /// metalness is 1. Where somebody wrote that, or a texture of it, nobody is told, nor of what glows.
    pub fn metals_by_default(&self) -> impl Iterator<Item = Warning> + '_ {
        let unsaid = |&index: &usize| {
            let (material, Some(entry)) = (&self.materials[index], self.document.root.materials.get(index)) else {
                return false;
            };
            let pbr = &entry.pbr_metallic_roughness;
            let says = pbr.metallic_factor.is_some() || pbr.metallic_roughness_texture.is_some();
            !(says || entry.extensions.specular_glossiness.is_some() || material.unlit || material.glows())
        };
        (0..self.materials.len()).filter(unsaid).filter_map(|index| {
            let part = self.parts.iter().find(|part| part.receives && part.material == index)?;
            let what = format!(
                "material {} of {} does not say how metallic it is; by glTF's default that is wholly, so it reflects no \
                 diffuse light and shows none of its lightmap; give it a metallicFactor, 0 for what is no metal",
                self.materials[index].name, part.name
            );
            Some(Warning::new("metal-by-default", what).at(&part.name))
        })
    }

    /// Warns that no lightmap comes of the scene because what could have one is unlit: models whose light is in their
    /// textures already often come that way. Where rules or the document want none, nobody is told.
    #[must_use]
    pub fn nothing_lit(&self) -> Option<Warning> {
        let unlit = |part: &&Part| part.treatment.receives && self.materials[part.material].unlit;
        let first = self.parts.iter().find(unlit).filter(|_| self.parts.iter().all(|part| !part.receives))?;
        let what = format!(
            "nothing gets a lightmap: {} of {} primitives have unlit materials (KHR_materials_unlit), which show none, and no \
             other can have one; take the extension from what is to be lit",
            self.parts.iter().filter(unlit).count(),
            self.parts.len()
        );
        Some(Warning::new("nothing-lit", what).at(&first.name))
    }
}

fn convert(entry: &MaterialEntry, name: String, root: &Root, warnings: &mut Vec<Warning>) -> Result<Material, Error> {
    let specular = entry.extensions.specular_glossiness.as_ref();
    let metal = specular.map(SpecularGlossiness::as_metal);
    let pbr = metal.as_ref().unwrap_or(&entry.pbr_metallic_roughness);
    let base_color = Vec4::from_array(pbr.base_color_factor);
    let strength = entry.extensions.emissive_strength.as_ref().map_or(1.0, |e| e.emissive_strength);
    let emission = Rgb::from_array(entry.emissive_factor) * strength;
    if !(emission.is_finite() && emission.min_element() >= 0.0) {
        return Err(Error::invalid(format!("its emission {emission} is negative or not finite")));
    }
    let metallic = pbr.metallic_factor.unwrap_or(1.0);
    let textured = specular.filter(|s| s.specular_glossiness_texture.is_some());
    let specular = Rgb::from_array(textured.map_or([0.0; 3], |s| s.specular_factor));
    let unlit = entry.extensions.unlit.is_some();
    let transmission = entry.extensions.transmission.as_ref().filter(|_| !unlit);
    let passing = transmission.map_or(0.0, |t| t.transmission_factor);
    if !(in_unit(metallic)
        && in_unit(passing)
        && specular.to_array().into_iter().all(in_unit)
        && base_color.to_array().into_iter().all(in_unit))
    {
        let what = format!("material {name}: its base colour or another factor is outside [0, 1] and was clamped");
        warnings.push(Warning::new("factor-out-of-range", what));
    }
    let (base_color, metallic, passing) = (clamp_unit(base_color), metallic.clamp(0.0, 1.0), passing.clamp(0.0, 1.0));
    let alpha = match entry.alpha_mode.as_str() {
        "OPAQUE" => Alpha::Opaque,
        "MASK" => Alpha::Mask(entry.alpha_cutoff),
        "BLEND" => Alpha::Blend,
        other => {
            let what = format!("material {name}: alpha mode {other:?} does not exist; OPAQUE was used");
            warnings.push(Warning::new("bad-alpha-mode", what));
            Alpha::Opaque
        }
    };
    let color_matters = alpha != Alpha::Opaque || base_color.truncate() != Rgb::ZERO;
    let texture = |info: &Option<TextureInfo>, matters: bool| match info {
        Some(info) if matters => texture_ref(info, root).map(Some),
        _ => Ok(None),
    };
    Ok(Material {
        name,
        base_color,
        base_color_texture: texture(&pbr.base_color_texture, color_matters)?,
        metallic,
        diffuse_texture: None,
        metallic_texture: texture(&pbr.metallic_roughness_texture, metallic > 0.0 && !unlit)?,
        specular: specular.clamp(Rgb::ZERO, Rgb::ONE),
        specular_texture: match textured {
            Some(s) => texture(&s.specular_glossiness_texture, specular != Rgb::ZERO && !unlit)?,
            None => None,
        },
        transmission: passing,
        transmission_texture: match transmission {
            Some(t) => texture(&t.transmission_texture, passing > 0.0)?,
            None => None,
        },
        volume: match entry.extensions.volume.as_ref().filter(|_| passing > 0.0) {
            Some(v) => match v.volume() {
                Some(volume) => Some(Volume { thickness_texture: texture(&v.thickness_texture, true)?, ..volume }),
                None => None,
            },
            None => None,
        },
        translucency: entry.extensions.diffuse_transmission.as_ref().filter(|_| !unlit).map_or(Ok(None), |d| {
            let factor = d.diffuse_transmission_factor.clamp(0.0, 1.0);
            let color = Rgb::from_array(d.diffuse_transmission_color_factor).clamp(Rgb::ZERO, Rgb::ONE);
            let factor_texture = texture(&d.diffuse_transmission_texture, factor > 0.0)?;
            let color_texture = texture(&d.diffuse_transmission_color_texture, factor > 0.0)?;
            Ok((factor > 0.0).then_some(Translucency { factor, factor_texture, color, color_texture }))
        })?,
        emission,
        emission_texture: texture(&entry.emissive_texture, emission != Rgb::ZERO && !unlit)?,
        normal_map: None,
        alpha,
        double_sided: entry.double_sided,
        unlit,
        lightmap_uv_set: entry.extensions.lightmap.as_ref().map(|l| l.tex_coord).filter(|&set| set < MAX_UV_SETS),
        lightmap_texture: entry.extensions.lightmap.as_ref().and_then(|l| l.index),
    })
}

fn normal_map(entry: &MaterialEntry, root: &Root) -> Result<Option<NormalMap>, Error> {
    let Some(value) = &entry.normal_texture else { return Ok(None) };
    let wrong = |why: &str| Error::invalid(format!("its normalTexture is wrong: {why}"));
    let info = TextureInfo::deserialize(value).map_err(|e| wrong(&e.to_string()))?;
    let scale = match value.get("scale") {
        None => 1.0,
        Some(scale) => scale.as_f64().ok_or_else(|| wrong("its scale is no number"))? as f32,
    };
    if !scale.is_finite() {
        return Err(wrong("its scale is not finite"));
    }
    let texture = texture_ref(&info, root)?;
    Ok((scale != 0.0).then_some(NormalMap { texture, scale }))
}

fn in_unit(value: f32) -> bool {
    (0.0..=1.0).contains(&value)
}

fn clamp_unit(color: Vec4) -> Vec4 {
    color.clamp(Vec4::ZERO, Vec4::ONE)
}

fn texture_ref(info: &TextureInfo, root: &Root) -> Result<TextureRef, Error> {
    let have = root.textures.len();
    let texture = info.index.filter(|&t| t < have).ok_or_else(|| match info.index {
        Some(index) => Error::invalid(format!("texture {index} does not exist, there are {have}")),
        None => Error::invalid("a texture reference has no index"),
    })?;
    let extension = info.extensions.transform.as_ref();
    let uv_set = extension.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
    if uv_set >= MAX_UV_SETS {
        return Err(Error::unsupported(format!("uses TEXCOORD_{uv_set}; only the first {MAX_UV_SETS} can be read")));
    }
    let transform = match extension {
        None => Affine2::IDENTITY,
        Some(t) => {
            let (sin, cos) = libm::sincosf(t.rotation);
            let [x, y] = t.scale;
            let linear = Mat2::from_cols(Vec2::new(cos, -sin) * x, Vec2::new(sin, cos) * y);
            Affine2::from_mat2_translation(linear, Vec2::from_array(t.offset))
        }
    };
    if !transform.is_finite() {
        return Err(Error::invalid("its KHR_texture_transform is not finite"));
    }
    Ok(TextureRef { texture, uv_set, transform })
}
