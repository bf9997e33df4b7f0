//! A second document that shows the lightmap in loaders that know no lightmaps: unlit, base colour = the EXR.
//!
//! In: the finished document, as it goes to disk. Out: `NAME.preview.gltf` or `NAME.preview.glb` beside it. A `.gltf`
//! shares all buffers; a GLB has a copy of the BIN chunk, because nothing else can refer to that of another file. The
//! EXR stays a file beside it: Blender takes an EXR inside a GLB for sRGB.
//!
//! * Materials with `MOZ_lightmap` become `KHR_materials_unlit` with the page on the lightmap's own coordinates; their
//!   name and `doubleSided` stay, all else goes. Other materials and all lights stay as they are.
//! * `COLOR_0` of the primitives that use them is left out: it would multiply the light.
//! * The image names the EXR without a MIME type: glTF allows only PNG and JPEG there, so the type would be an error.
//!   The Khronos validator has one warning per page left, `IMAGE_UNRECOGNIZED_FORMAT`.
//!
//! Limit: not every loader decodes EXR images; three.js needs its `EXRLoader` registered.

use crate::output::Contents;
use crate::output::Error;
use crate::output::names::beside;
use crate::output::splice::Element;
use crate::output::splice::Fault;
use crate::output::splice::Splice;
use crate::output::splice::quoted;
use std::collections::BTreeSet;
use std::path::Path;
use std::path::PathBuf;

const UNLIT: &str = "KHR_materials_unlit";
const LIGHTMAP: &str = "MOZ_lightmap";
/// Bytes of a GLB before its JSON text: header, length and type of the chunk.
const BEFORE_JSON: usize = 20;

/// Path and contents of the preview of a baked document.
///
/// # Errors
/// If `document` is not what `write_gltf` made.
pub fn preview(path: &Path, document: &Contents) -> Result<(PathBuf, Contents), Error> {
    let fail = || Error::invalid(path, "the preview cannot be made from this document");
    let start = document.pieces().next().ok_or_else(fail)?;
    let made = |json: &[u8]| -> Result<Vec<u8>, Error> {
        let json = core::str::from_utf8(json).map_err(|_| fail())?;
        Ok(unlit(json.trim_end()).map_err(|e| Error::invalid(path, e.to_string()))?.into_bytes())
    };
    if !start.starts_with(b"glTF") {
        return Ok((beside(path, "preview.gltf"), made(&start)?.into()));
    }
    let length = start.get(12..16).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes).ok_or_else(fail)?;
    let rest = BEFORE_JSON + length as usize;
    let mut json = made(start.get(BEFORE_JSON..rest).ok_or_else(fail)?)?;
    json.resize(json.len().next_multiple_of(4), b' ');
    let total = document.len() + json.len() - length as usize;
    let size = |bytes: usize| u32::try_from(bytes).map(u32::to_le_bytes).map_err(|_| fail());
    let mut head = start[..BEFORE_JSON].to_vec();
    head[8..12].copy_from_slice(&size(total)?);
    head[12..16].copy_from_slice(&size(json.len())?);
    let mut out = Contents::from([&head, &json, &start[rest..]].concat());
    out.append(document.after_first());
    Ok((beside(path, "preview.glb"), out))
}

/// The JSON text with unlit materials.
fn unlit(json: &str) -> Result<String, Fault> {
    let root = Element::root(json)?;
    let mut splice = Splice::new(json);
    textures(&mut splice, &root);
    let lit = materials(&mut splice, &root);
    for primitive in root.array("meshes").iter().flat_map(|m| m.array("primitives")) {
        let attributes = primitive.get("attributes").filter(|a| a.get("COLOR_0").is_some());
        if let (Some(attributes), true) = (attributes, primitive.index_at("material").is_some_and(|m| lit.contains(&m)))
        {
            let kept = attributes.members().into_iter().filter(|(name, _)| !name.starts_with("COLOR_"));
            let kept: Vec<String> = kept.map(|(name, value)| format!("{}: {}", quoted(&name), value.text())).collect();
            splice.replace(&attributes, format!("{{{}}}", kept.join(", ")));
        }
    }
    super::declare(&mut splice, &root, &[UNLIT])?;
    splice.apply()
}

/// Textures of pages show the EXR.
fn textures(splice: &mut Splice<'_>, root: &Element<'_>) {
    let images = root.array("images");
    for texture in root.array("textures") {
        let Some(exr) = texture.find(&["extras", "lightmap"]).and_then(|l| exr_of(&l)) else { continue };
        let listed = texture.find(&["extensions", "EXT_texture_exr"]).and_then(|e| e.index_at("source"));
        let Some(source) = listed.or_else(|| texture.index_at("source")) else { continue };
        let Some(image) = images.get(source) else { continue };
        splice.replace(image, format!("{{\"uri\": {}}}", quoted(&exr)));
        let sampler = texture.index_at("sampler").map(|s| format!("\"sampler\": {s}, ")).unwrap_or_default();
        splice.replace(&texture, format!("{{{sampler}\"source\": {source}}}"));
    }
}

/// URI of the EXR in a texture's `extras.lightmap`.
fn exr_of(lightmap: &Element<'_>) -> Option<String> {
    let files = lightmap.array("files");
    let is_exr = |file: &&Element<'_>| file.get("format").and_then(|f| f.string()).as_deref() == Some("exr");
    files.iter().find(is_exr).unwrap_or(lightmap).get("uri")?.string()
}

/// Makes materials with a lightmap unlit; returns which these are.
fn materials(splice: &mut Splice<'_>, root: &Element<'_>) -> BTreeSet<usize> {
    let mut lit = BTreeSet::new();
    for (m, material) in root.array("materials").iter().enumerate() {
        let Some(lightmap) = material.find(&["extensions", LIGHTMAP]) else { continue };
        let number = |key| lightmap.index_at(key).unwrap_or(0);
        let (index, set) = (number("index"), number("texCoord"));
        let kept: String = ["name", "doubleSided"]
            .iter()
            .filter_map(|key| Some(format!("\"{key}\": {}, ", material.get(key)?.text())))
            .collect();
        let color = format!("{{\"baseColorTexture\": {{\"index\": {index}, \"texCoord\": {set}}}}}");
        let text = format!("{{{kept}\"pbrMetallicRoughness\": {color}, \"extensions\": {{\"{UNLIT}\": {{}}}}}}");
        splice.replace(material, text);
        lit.insert(m);
    }
    lit
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    fn document(texture: &Value) -> Value {
        json!({
            "asset": {"version": "2.0"}, "extensionsUsed": ["MOZ_lightmap"],
            "materials": [
                {"name": "wall", "doubleSided": true, "emissiveFactor": [1, 1, 1],
                 "extensions": {"MOZ_lightmap": {"index": 0, "texCoord": 1, "intensity": 1}}},
                {"name": "glass"}],
            "meshes": [{"primitives": [
                {"attributes": {"POSITION": 0, "COLOR_0": 1, "TEXCOORD_1": 2}, "material": 0},
                {"attributes": {"POSITION": 0, "COLOR_0": 1}, "material": 1}]}],
            "textures": [texture], "images": [{"uri": "a.png"}, {"uri": "a.exr", "mimeType": "image/x-exr"}]
        })
    }

    #[test]
    fn lit_materials_become_unlit_and_the_rest_stays() {
        let extras = json!({"lightmap": {"uri": "a.hdr", "files": [{"format": "exr", "uri": "a.exr"}]}});
        let plain = document(&json!({"sampler": 0, "source": 0, "extras": extras}));
        let (path, bytes) = preview(Path::new("o/a.gltf"), &plain.to_string().into_bytes().into()).unwrap();
        assert_eq!(path, Path::new("o/a.preview.gltf"));
        let out: Value = serde_json::from_slice(&bytes.to_vec()).unwrap();
        assert_eq!(out["images"][0], json!({"uri": "a.exr"}));
        assert_eq!(out["textures"][0], json!({"sampler": 0, "source": 0}));
        let wall = json!({"name": "wall", "doubleSided": true, "extensions": {UNLIT: {}},
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}});
        assert_eq!(out["materials"], json!([wall, {"name": "glass"}]));
        let primitives = &out["meshes"][0]["primitives"];
        assert_eq!(primitives[0]["attributes"], json!({"POSITION": 0, "TEXCOORD_1": 2}));
        assert_eq!(primitives[1]["attributes"], json!({"POSITION": 0, "COLOR_0": 1}));
        assert_eq!(out["extensionsUsed"], json!(["MOZ_lightmap", UNLIT]));
    }

    #[test]
    fn an_exr_among_the_images_loses_its_type_and_is_taken() {
        let texture = json!({"source": 0, "extensions": {"EXT_texture_exr": {"source": 1}},
            "extras": {"lightmap": {"uri": "a.exr"}}});
        let (_, bytes) = preview(Path::new("a.gltf"), &document(&texture).to_string().into_bytes().into()).unwrap();
        let out: Value = serde_json::from_slice(&bytes.to_vec()).unwrap();
        assert_eq!(out["textures"][0], json!({"source": 1}));
        assert_eq!(out["images"], json!([{"uri": "a.png"}, {"uri": "a.exr"}]));
    }

    #[test]
    fn a_glb_keeps_its_other_chunks_and_right_lengths() {
        let json = document(&json!({"source": 0, "extras": {"lightmap": {"uri": "a.exr"}}})).to_string();
        let padded = format!("{json}{}", " ".repeat(json.len().next_multiple_of(4) - json.len()));
        let chunk = |kind: &[u8], data: &[u8]| [&(data.len() as u32).to_le_bytes(), kind, data].concat();
        let bin = chunk(b"BIN\0", &[1, 2, 3, 4]);
        let body = [chunk(b"JSON", padded.as_bytes()), bin[..8].to_vec()].concat();
        let head = [b"glTF\x02\0\0\0", &(body.len() as u32 + 16).to_le_bytes()[..], &body].concat();
        let mut glb = Contents::from(head.clone());
        glb.promise(4, || vec![1, 2, 3, 4]);
        let (path, out) = preview(Path::new("a.glb"), &glb).unwrap();
        assert_eq!((path.as_path(), out.len()), (Path::new("a.preview.glb"), out.to_vec().len()));
        let out = out.to_vec();
        let word = |at: usize| u32::from_le_bytes(out[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!(word(8), out.len());
        assert_eq!(&out[20 + word(12)..], bin);
        let text: Value = serde_json::from_slice(&out[20..20 + word(12)]).unwrap();
        assert_eq!(text["images"][0]["uri"], "a.exr");
        for wrong in [&head[..15], b"[]", b""] {
            assert!(preview(Path::new("a.glb"), &wrong.to_vec().into()).is_err());
        }
    }
}
