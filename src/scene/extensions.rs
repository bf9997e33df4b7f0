//! Which extensions are understood, which do not matter to diffuse light, and which stop a bake.
//!
//! A required extension must be understood or without effect on diffuse light, else the document is unsupported. An
//! optional one that is neither gives the warning `unsupported-extension`; `output` carries it through unchanged.

use super::Error;
use super::schema::Root;
use crate::base::Warning;

/// Read and honoured.
const IMPLEMENTED: [&str; 21] = [
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "MSFT_lod",
    "MSFT_texture_dds",
];

/// Without effect on what a diffuse bake computes: specular lobes and coats, metadata, behaviour at run time, and the
/// lightmap that a bake replaces. (A coat or sheen takes a little light from the diffuse lobe; renderers differ in how
/// much, and Blender's DIFFUSE bake counts none of it.)
const NEUTRAL: [&str; 19] = [
    "CESIUM_primitive_outline",
    "EXT_mesh_manifold",
    "EXT_mesh_primitive_edge_visibility",
    "GODOT_single_root",
    "KHR_animation_pointer",
    "KHR_audio_emitter",
    "KHR_interactivity",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MOZ_lightmap",
];

/// What to do about extensions that people meet.
const ADVICE: [(&str, &str); 1] =
    [("EXT_texture_avif", "bake the version of the file that still has PNG or JPEG textures")];

/// Refuses a document that requires what is not understood; warns about the rest.
pub(super) fn check(root: &Root, warnings: &mut Vec<Warning>) -> Result<(), Error> {
    let known = |name: &str| IMPLEMENTED.contains(&name) || NEUTRAL.contains(&name);
    if let Some(name) = root.extensions_required.iter().find(|name| !known(name)) {
        let advice = advice(name).unwrap_or("export the file without it");
        return Err(Error::unsupported(format!("the required extension {name} is not supported; {advice}")));
    }
    for (i, name) in root.extensions_used.iter().enumerate() {
        if !known(name) && !root.extensions_used[..i].contains(name) {
            let advice = advice(name).map_or(String::new(), |a| format!("; if it matters, {a}"));
            let what = format!("the extension {name} is not understood: the bake ignores it and keeps it{advice}");
            warnings.push(Warning::new("unsupported-extension", what));
        }
    }
    Ok(())
}

fn advice(name: &str) -> Option<&'static str> {
    ADVICE.iter().find(|(known, _)| *known == name).map(|(_, advice)| *advice)
}
