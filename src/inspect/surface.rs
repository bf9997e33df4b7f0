//! Parts and materials as light sees them.
//!
//! The flux of a part is that of the pictures where it shows them. Materials have means over whole textures, whatever
//! coordinates show of them: of emission that of all texels, of others, and of what alpha leaves, that of [`LOOKS`] spread
//! points, filtered. Textures that lie alike are looked at in the same points, so that means of products are that;
//! others in points of their own, as if nothing tied them together. Vertex colours, alpha and translucency are left out.

use crate::atlas::{Atlas, NO_CHART};
use crate::base::Rgb;
use crate::base::low_discrepancy::Sequence;
use crate::scene::{Alpha, Material, Picture, Scene, Texture, TextureRef};
use glam::{DVec3, Vec2, Vec4};

/// Points on a texture.
const LOOKS: u32 = 4096;

/// One primitive as placed by one node.
#[derive(Debug, serde::Serialize)]
pub struct PartFacts {
    /// Name of the node.
    pub node: String,
    /// Index of the mesh and of the primitive in it.
    pub mesh: [usize; 2],
    /// Triangles.
    pub triangles: usize,
    /// World area [m²].
    pub area: f64,
    /// Charts.
    pub charts: usize,
    /// Area of its charts on the pages [texels].
    pub texels: f64,
    /// Name of the material.
    pub material: String,
    /// Which UVs: `kept`, `charted`, or `none` for what receives no light.
    pub uv: &'static str,
    /// The document's `TEXCOORD_1` as a lightmap layout: `usable`, or what is wrong with it; null where there is none.
    pub existing_uv: Option<String>,
    /// Flux that it emits, by all texels that it shows [lm]; both sides of a double-sided part.
    pub flux: [f64; 3],
    /// Factor of the texels per metre, by rules or `extras`.
    pub density: f32,
    /// It gets a lightmap.
    pub receives: bool,
    /// Others are lit as if it were there.
    pub casts: bool,
    /// Factor of the light that it emits.
    pub emission: f32,
    /// Group of what it emits, if that has a name.
    pub light_group: Option<String>,
}

/// One material as light sees it.
#[derive(Debug, serde::Serialize)]
pub struct MaterialFacts {
    /// Its name.
    pub name: String,
    /// Factor of the diffuse reflectance, textures left out.
    pub reflectance: [f32; 3],
    /// Mean diffuse reflectance, all textures included.
    pub mean_reflectance: [f32; 3],
    /// Emitted radiance, textures left out [cd/m²].
    pub emission: [f32; 3],
    /// The same times the mean of the texture [cd/m²].
    pub mean_emission: [f32; 3],
    /// Both sides are lit.
    pub double_sided: bool,
    /// `opaque`, `mask` or `blend`.
    pub alpha: &'static str,
    /// Blocks light and receives none.
    pub unlit: bool,
}

/// Facts of a part; `existing_uv` is what the atlas says of its layout, `flux` what it emits [lm].
pub(super) fn part(scene: &Scene, atlas: &Atlas, index: usize, existing_uv: Option<String>, flux: DVec3) -> PartFacts {
    let (part, charted) = (&scene.parts[index], &atlas.parts[index]);
    let material = &scene.materials[part.material];
    let mut charts: Vec<u32> = charted.charts().filter(|&c| c != NO_CHART).collect();
    charts.sort_unstable();
    charts.dedup();
    let on_page = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| charted.uv(v).as_dvec2());
        0.5 * (b - a).perp_dot(c - a).abs()
    };
    let in_charts = charted.layout.triangles.iter().zip(charted.charts()).filter(|(_, c)| *c != NO_CHART);
    let area = part.triangles.clone().map(|t| scene.area(t)).fold(0.0, |a, b| a + b);
    PartFacts {
        node: part.name.clone(),
        mesh: [part.mesh, part.primitive],
        triangles: part.triangles.len(),
        area,
        charts: charts.len(),
        texels: in_charts.map(|(t, _)| on_page(t)).fold(0.0, |a, b| a + b),
        material: material.name.clone(),
        uv: match (part.receives, charted.kept) {
            (false, _) => "none",
            (true, true) => "kept",
            (true, false) => "charted",
        },
        existing_uv,
        flux: flux.to_array(),
        density: part.treatment.density,
        receives: part.receives,
        casts: part.treatment.casts,
        emission: part.treatment.emission,
        light_group: scene.groups.parts.get(index).cloned().flatten(),
    }
}

impl PartFacts {
    /// What is not as usual, as words to put behind a row.
    pub(super) fn notes(&self) -> String {
        let mut notes = vec![];
        if self.density != 1.0 {
            notes.push(format!("density ×{}", self.density));
        }
        if !self.casts {
            notes.push("casts no light".to_owned());
        }
        if self.emission != 1.0 {
            notes.push(format!("emission ×{}", self.emission));
        }
        notes.extend(self.light_group.iter().map(|group| format!("group {group}")));
        if self.uv == "charted" {
            notes.extend(self.existing_uv.iter().map(|why| format!("TEXCOORD_1: {why}")));
        }
        if notes.is_empty() { String::new() } else { format!("  [{}]", notes.join(", ")) }
    }
}

/// Facts of a material.
pub(super) fn material(scene: &Scene, index: usize) -> MaterialFacts {
    let m = &scene.materials[index];
    let factor = m.base_color.truncate() * ((1.0 - m.metallic) * (1.0 - m.transmission));
    MaterialFacts {
        name: m.name.clone(),
        reflectance: factor.to_array(),
        mean_reflectance: mean_reflectance(scene, m).to_array(),
        emission: m.emission.to_array(),
        mean_emission: mean_emission(scene, m).to_array(),
        double_sided: m.double_sided,
        alpha: match m.alpha {
            Alpha::Opaque => "opaque",
            Alpha::Mask(_) => "mask",
            Alpha::Blend => "blend",
        },
        unlit: m.unlit,
    }
}

/// Radiance that a material emits on the mean, of what its alpha leaves of it [cd/m²].
fn mean_emission(scene: &Scene, material: &Material) -> Rgb {
    let texture = |r: &Option<TextureRef>| r.as_ref().and_then(|r| scene.textures.get(r.texture));
    if let (Alpha::Opaque, Some(glow)) = (material.alpha, texture(&material.emission_texture)) {
        return material.emission * Picture::new(glow).mean();
    }
    let (glow, cover) = (texture(&material.emission_texture), texture(&material.base_color_texture));
    material.emission
        * mean_over(|[x, y, ..]| {
            let uv = Vec2::new(x, y);
            let alpha = material.base_color.w * cover.map_or(1.0, |texture| texture.sample_alpha(uv));
            let color = glow.map_or(Vec4::ONE, |texture| texture.sample_srgb(uv));
            color * material.alpha.coverage(alpha)
        })
        .truncate()
}

/// Mean diffuse reflectance of what is not transparent by its alpha.
fn mean_reflectance(scene: &Scene, material: &Material) -> Rgb {
    let look = |r: &Option<TextureRef>, at: &dyn Fn(&TextureRef) -> Vec2, read: fn(&Texture, Vec2) -> Vec4| {
        let texture = r.as_ref().and_then(|r| Some((scene.textures.get(r.texture)?, at(r))));
        texture.map_or(Vec4::ONE, |(texture, uv)| read(texture, uv)).truncate()
    };
    let lead = [&material.diffuse_texture, &material.base_color_texture, &material.metallic_texture];
    let lead = lead.into_iter().flatten().next();
    let mean = mean_over(|[x, y, z, w]| {
        let is_lead = |r: &TextureRef| lead.is_none_or(|l| (l.uv_set, l.transform) == (r.uv_set, r.transform));
        let at = |r: &TextureRef| if is_lead(r) { Vec2::new(x, y) } else { Vec2::new(z, w) };
        let passing = material.transmission * look(&material.transmission_texture, &at, Texture::sample_linear).x;
        let left = if material.diffuse_texture.is_some() {
            look(&material.diffuse_texture, &at, Texture::sample_srgb)
        } else {
            let metal = material.metallic * look(&material.metallic_texture, &at, Texture::sample_linear).z;
            let mirror = material.specular * look(&material.specular_texture, &at, Texture::sample_srgb);
            let color = look(&material.base_color_texture, &at, Texture::sample_srgb);
            color * ((1.0 - metal) * (1.0 - mirror.max_element()))
        };
        (left * (1.0 - passing)).extend(1.0)
    });
    material.base_color.truncate() * mean.truncate()
}

/// Mean over whole pictures: of two places each, which have nothing to do with each other.
fn mean_over(value: impl Fn([f32; 4]) -> Vec4) -> Vec4 {
    let sequence = Sequence::new(0);
    (0..LOOKS).map(|k| value(sequence.point(k))).fold(Vec4::ZERO, |a, b| a + b) / LOOKS as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Wrap;

    #[test]
    fn the_mean_of_a_texture_is_linear() {
        let pixels = vec![[255, 0, 0, 255], [0, 0, 188, 255]];
        let texture = Texture { width: 2, height: 1, pixels, wrap: [Wrap::Repeat; 2], nearest: true };
        // 188 of sRGB is half of the light.
        let mean = mean_over(|[x, y, ..]| texture.sample_srgb(Vec2::new(x, y)));
        assert!((mean - Vec4::new(0.5, 0.0, 0.2514, 1.0)).abs().max_element() < 1e-3);
    }
}
