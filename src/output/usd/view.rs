//! The layer to open: the others as sublayers, and the light as emission of the materials that have it.

use super::Bake;
use super::Baked;
use super::paths::BAKED;
use super::text::Text;
use super::text::tuple;
use crate::base::Rgb;
use crate::output::Error;
use crate::output::gltf::Quantity;
use crate::scene::Material;
use core::f32::consts::FRAC_1_PI;
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
            let reflected = reflectance(source) * radiosity(bake.settings.quantity);
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
            text.line("color3f inputs:specularColor = (0, 0, 0)");
            text.line("int inputs:useSpecularWorkflow = 1");
        });
    });
}

/// Diffuse reflectance as far as it has no texture.
fn reflectance(material: &Material) -> Rgb {
    let metallic = if material.metallic_texture.is_some() { 0.0 } else { material.metallic };
    material.base_color.truncate() * (1.0 - metallic)
}

/// Factor from what is stored to E/π.
fn radiosity(quantity: Quantity) -> f32 {
    match quantity {
        Quantity::Radiosity => 1.0,
        Quantity::Irradiance => FRAC_1_PI,
    }
}
