//! The layer to open: the others as sublayers, and the light as emission of the materials that have it.

use super::Bake;
use super::Baked;
use super::paths::BAKED;
use super::text::Text;
use super::text::tuple;
use crate::base::Rgb;
use crate::base::color::srgb_to_linear;
use crate::output::Error;
use crate::output::gltf::Quantity;
use crate::scene::Material;
use crate::scene::Scene;
use crate::scene::TextureRef;
use core::f32::consts::FRAC_1_PI;
use glam::DVec3;
use std::path::Path;

/// The layer; `below` are its sublayers, the strongest first.
pub(super) fn layer(bake: &Bake<'_>, below: &[&Path]) -> Result<Vec<u8>, Error> {
    let below: Vec<String> = below.iter().map(|file| bake.asset(file)).collect::<Result<_, _>>()?;
    let mut metadata = bake.metadata("the light of the lightmap layer, shown as emission");
    metadata.push(format!("subLayers = [{}]", below.join(", ")));
    let mut text = Text::layer(&metadata);
    text.prim("over \"World\"", &[], |text| {
        text.prim(&format!("over \"{BAKED}\""), &[], |text| {
            bake.baked_materials().into_iter().for_each(|baked| material(bake, text, baked));
        });
    });
    Ok(text.into_bytes())
}

fn material(bake: &Bake<'_>, text: &mut Text, baked: Baked) {
    let name = bake.baked_name(baked);
    let path = format!("/World/{BAKED}/{name}");
    let source = &bake.scene.materials[baked.0];
    // A texture's emission cannot be added to the light.
    let keeps_emission = source.emission_texture.is_some() || baked.1.is_none() && source.glows();
    if keeps_emission {
        return;
    }
    text.prim(&format!("over \"{name}\""), &[], |text| {
        if baked.1.is_some() {
            let reflected = reflectance(bake.scene, source) * radiosity(bake.settings.quantity);
            text.prim("over \"Lightmap\"", &[], |text| {
                text.line(format!("float4 inputs:bias = {}", tuple(&source.emission.extend(0.0).to_array())));
                text.line(format!("float4 inputs:scale = {}", tuple(&reflected.extend(1.0).to_array())));
            });
        }
        let output = if baked.1.is_some() { "Lightmap.outputs:rgb" } else { "VertexLight.outputs:result" };
        text.prim("over \"Surface\"", &[], |text| {
            text.line("color3f inputs:diffuseColor = (0, 0, 0)");
            if source.base_color_texture.is_some() {
                text.line("color3f inputs:diffuseColor.connect = None");
            }
            text.line(format!("color3f inputs:emissiveColor.connect = <{path}/{output}>"));
            // Blender reads no specular colour, but reflects nothing either if light is not refracted.
            text.line("float inputs:ior = 1");
            text.line("float inputs:metallic = 0");
            if source.metallic_texture.is_some() {
                text.line("float inputs:metallic.connect = None");
            }
            text.line("color3f inputs:specularColor = (0, 0, 0)");
            text.line("int inputs:useSpecularWorkflow = 1");
        });
    });
}

/// Mean diffuse reflectance: factors times the means of the textures.
fn reflectance(scene: &Scene, material: &Material) -> Rgb {
    let pixels = |texture: &TextureRef| scene.textures[texture.texture].pixels.as_slice();
    if let Some(diffuse) = &material.diffuse_texture {
        return material.base_color.truncate() * mean(pixels(diffuse), srgb_to_linear);
    }
    let color = material.base_color_texture.as_ref().map_or(Rgb::ONE, |t| mean(pixels(t), srgb_to_linear));
    let metal = material.metallic_texture.as_ref().map_or(1.0, |t| mean(pixels(t), |stored| stored).z);
    material.base_color.truncate() * color * (1.0 - material.metallic * metal)
}

/// Mean colour of decoded pixels.
fn mean(pixels: &[[u8; 4]], decode: impl Fn(f32) -> f32) -> Rgb {
    let decoded: Vec<f64> = (0..=255u8).map(|stored| f64::from(decode(f32::from(stored) / 255.0))).collect();
    let add = |sum: DVec3, p: &[u8; 4]| {
        sum + DVec3::new(decoded[p[0] as usize], decoded[p[1] as usize], decoded[p[2] as usize])
    };
    (pixels.iter().fold(DVec3::ZERO, add) / (pixels.len() as f64).max(1.0)).as_vec3()
}

/// Factor from what is stored to E/π.
fn radiosity(quantity: Quantity) -> f32 {
    match quantity {
        Quantity::Radiosity => 1.0,
        Quantity::Irradiance => FRAC_1_PI,
    }
}
