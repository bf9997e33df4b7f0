//! glTF materials as `UsdPreviewSurface`: base colour, metallic, roughness, emission, alpha, each with its texture.
//!
//! Source: glTF 2.0, sections 3.9 and 3.8.4; the `UsdPreviewSurface` specification. Factors become `inputs:scale` of the
//! textures. Emission is in cd/m². Unlit materials send out their base colour.
//!
//! `KHR_texture_transform`, turned upside down with v: `UsdTransform2d` scales, then rotates counter-clockwise, then moves.

use super::Bake;
use super::images::Images;
use super::paths::MATERIALS;
use super::text::Text;
use super::text::number;
use super::text::tuple;
use super::varname;
use crate::scene::Alpha;
use crate::scene::Material;
use crate::scene::TextureRef;
use crate::scene::Wrap;
use glam::Affine2;
use glam::Vec4;

/// A mask's threshold of 0 would mean blending; below a step of 8 bits it hides what a texture stores as 0.
const LEAST_THRESHOLD: f32 = 1.0 / 512.0;

/// Writes material `m` of the scene.
pub(super) fn write(bake: &Bake<'_>, images: &Images, text: &mut Text, m: usize) {
    let material = &bake.scene.materials[m];
    let name = bake.paths.material(m);
    let path = format!("/World/{MATERIALS}/{name}");
    let roughness =
        bake.scene.document.root.materials.get(m).map_or(1.0, |entry| entry.pbr_metallic_roughness.roughness_factor);
    text.prim(&format!("def Material \"{name}\""), &[], |text| {
        text.line(format!("token outputs:surface.connect = <{path}/Surface.outputs:surface>"));
        text.prim("def Shader \"Surface\"", &[], |text| {
            text.line("uniform token info:id = \"UsdPreviewSurface\"");
            surface(text, &path, material, roughness);
            text.line("token outputs:surface");
        });
        let samplers = Samplers { bake, images, path: &path };
        let emission = material.emission.extend(1.0);
        let data = Vec4::new(1.0, roughness, material.metallic, 1.0);
        samplers.write(text, "BaseColor", material.base_color_texture.as_ref(), material.base_color, "sRGB");
        samplers.write(text, "Emission", material.emission_texture.as_ref(), emission, "sRGB");
        samplers.write(text, "MetallicRoughness", material.metallic_texture.as_ref(), data, "raw");
    });
}

/// Inputs of the surface.
fn surface(text: &mut Text, path: &str, material: &Material, roughness: f32) {
    let mut input = |kind: &str, name: &str, texture: Option<&str>, value: String| match texture {
        Some(output) => text.line(format!("{kind} inputs:{name}.connect = <{path}/{output}>")),
        None => text.line(format!("{kind} inputs:{name} = {value}")),
    };
    let color = material.base_color_texture.map(|_| "BaseColor.outputs:rgb");
    let base = tuple(&material.base_color.truncate().to_array());
    if material.unlit {
        input("color3f", "diffuseColor", None, tuple(&[0.0; 3]));
        input("color3f", "emissiveColor", color, base);
    } else {
        let glow = material.emission_texture.map(|_| "Emission.outputs:rgb");
        input("color3f", "diffuseColor", color, base);
        input("color3f", "emissiveColor", glow, tuple(&material.emission.to_array()));
    }
    let metal = material.metallic_texture;
    input("float", "metallic", metal.map(|_| "MetallicRoughness.outputs:b"), number(material.metallic));
    input("float", "roughness", metal.map(|_| "MetallicRoughness.outputs:g"), number(roughness));
    if material.alpha != Alpha::Opaque {
        let alpha = material.base_color_texture.map(|_| "BaseColor.outputs:a");
        input("float", "opacity", alpha, number(material.base_color.w));
    }
    if let Alpha::Mask(cutoff) = material.alpha {
        input("float", "opacityThreshold", None, number(cutoff.max(LEAST_THRESHOLD)));
    }
}

/// Writes textures with what they read.
struct Samplers<'a> {
    bake: &'a Bake<'a>,
    images: &'a Images,
    /// Of the material.
    path: &'a str,
}

impl Samplers<'_> {
    fn write(&self, text: &mut Text, name: &str, texture: Option<&TextureRef>, scale: Vec4, space: &str) {
        let Some(texture) = texture else { return };
        let path = self.path;
        let moved = texture.transform != Affine2::IDENTITY;
        let from = if moved { "Transform" } else { "Uv" };
        text.prim(&format!("def Shader \"{name}\""), &[], |text| {
            text.line("uniform token info:id = \"UsdUVTexture\"");
            text.line(format!("asset inputs:file = {}", self.images.path(texture.texture)));
            text.line(format!("float4 inputs:scale = {}", tuple(&scale.to_array())));
            text.line(format!("token inputs:sourceColorSpace = \"{space}\""));
            text.line(format!("float2 inputs:st.connect = <{path}/{name}{from}.outputs:result>"));
            let wrap = self.bake.scene.textures[texture.texture].wrap;
            for (axis, mode) in ["S", "T"].iter().zip(wrap) {
                text.line(format!("token inputs:wrap{axis} = \"{}\"", wrap_name(mode)));
            }
            text.line("float outputs:a");
            text.line("float outputs:b");
            text.line("float outputs:g");
            text.line("float3 outputs:rgb");
        });
        if moved {
            let (scale, degrees, translation) = transform(&texture.transform);
            text.prim(&format!("def Shader \"{name}Transform\""), &[], |text| {
                text.line("uniform token info:id = \"UsdTransform2d\"");
                text.line(format!("float2 inputs:in.connect = <{path}/{name}Uv.outputs:result>"));
                text.line(format!("float inputs:rotation = {}", number(degrees)));
                text.line(format!("float2 inputs:scale = {}", tuple(&scale)));
                text.line(format!("float2 inputs:translation = {}", tuple(&translation)));
                text.line("float2 outputs:result");
            });
        }
        reader(text, &format!("{name}Uv"), &varname(texture.uv_set));
    }
}

/// A shader that reads texture coordinates.
pub(super) fn reader(text: &mut Text, name: &str, varname: &str) {
    text.prim(&format!("def Shader \"{name}\""), &[], |text| {
        text.line("uniform token info:id = \"UsdPrimvarReader_float2\"");
        text.line(format!("string inputs:varname = \"{varname}\""));
        text.line("float2 outputs:result");
    });
}

fn wrap_name(wrap: Wrap) -> &'static str {
    match wrap {
        Wrap::Repeat => "repeat",
        Wrap::Mirror => "mirror",
        Wrap::Clamp => "clamp",
    }
}

/// Scale, rotation [degrees] and translation that do to (u, 1 − v) what a transform of glTF does to (u, v).
///
/// With u' = a·u + b·v + x and v' = c·u + d·v + y, and s = 1 − v: u' = a·u − b·s + (b + x), s' = −c·u + d·s + (1 − d − y).
fn transform(gltf: &Affine2) -> ([f32; 2], f32, [f32; 2]) {
    let [a, c, b, d] = gltf.matrix2.to_cols_array().map(f64::from);
    let angle = libm::atan2(-c, a);
    let (sin, cos) = libm::sincos(angle);
    let scale = [a * cos - c * sin, b * sin + d * cos];
    let translation = [b + f64::from(gltf.translation.x), 1.0 - d - f64::from(gltf.translation.y)];
    (scale.map(|v| v as f32), angle.to_degrees() as f32, translation.map(|v| v as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat2;
    use glam::Vec2;

    #[test]
    fn transforms_do_the_same_upside_down() {
        for (angle, scale) in [(0.0f32, [1.0, 1.0]), (0.7, [2.0, 3.0]), (-2.0, [-1.5, 0.5]), (1.0, [2.0, -1.0])] {
            let (sin, cos) = libm::sincosf(angle);
            let linear = Mat2::from_cols(Vec2::new(cos, -sin) * scale[0], Vec2::new(sin, cos) * scale[1]);
            let gltf = Affine2::from_mat2_translation(linear, Vec2::new(0.3, -0.2));
            let (scale, degrees, translation) = transform(&gltf);
            for uv in [Vec2::new(0.2, 0.9), Vec2::new(-1.0, 0.4)] {
                let st = Vec2::new(uv.x, 1.0 - uv.y) * Vec2::from_array(scale);
                let st = Mat2::from_angle(degrees.to_radians()) * st + Vec2::from_array(translation);
                let expected = gltf.transform_point2(uv);
                assert!((Vec2::new(st.x, 1.0 - st.y) - expected).abs().max_element() < 1e-5, "{angle} {uv}");
            }
        }
    }
}
