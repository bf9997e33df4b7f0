//! Images that materials read, as files that USD readers can open.
//!
//! PNG and JPEG files stay where they are and are referred to. Those inside of the document's buffers are copied out,
//! byte for byte. What is WebP, KTX2, DDS or a data URI is decoded once more, since a bake may have scaled it down, and
//! written as PNG.

use super::asset;
use crate::output::Error;
use crate::output::Files;
use crate::output::names;
use crate::scene::Scene;
use image::ImageEncoder;
use image::ImageFormat;
use image::codecs::png::CompressionType;
use image::codecs::png::FilterType;
use image::codecs::png::PngEncoder;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;
use std::path::PathBuf;

/// Where the images are.
#[derive(Debug, Default)]
pub(super) struct Images {
    /// Asset path by texture.
    path: BTreeMap<usize, String>,
    /// Those that have to be written.
    pub(super) files: Files,
}

impl Images {
    /// Of all textures in use; `layer` is the file that refers to them.
    pub(super) fn new(scene: &Scene, layer: &Path) -> Result<Self, Error> {
        let mut images = Self::default();
        let mut done = BTreeMap::<usize, String>::new();
        for material in &scene.materials {
            let used = [&material.base_color_texture, &material.metallic_texture, &material.emission_texture];
            for texture in used.into_iter().flatten().map(|t| t.texture) {
                let entry = &scene.document.root.textures[texture];
                let Some(image) = entry.image() else { continue };
                let path = match done.entry(image) {
                    Entry::Occupied(known) => known.get().clone(),
                    Entry::Vacant(new) => {
                        let path = images.place(scene, image, layer)?;
                        new.insert(path).clone()
                    }
                };
                images.path.insert(texture, path);
            }
        }
        Ok(images)
    }

    /// Asset path of a texture's image.
    pub(super) fn path(&self, texture: usize) -> &str {
        self.path.get(&texture).map_or("@@", String::as_str)
    }

    fn place(&mut self, scene: &Scene, image: usize, layer: &Path) -> Result<String, Error> {
        let document = &scene.document;
        let entry = &document.root.images[image];
        if let Some(file) = entry.uri.as_deref().and_then(|uri| readable(&document.path, uri)) {
            return asset(layer, &file);
        }
        let raw = entry.buffer_view.map(|view| document.buffer_view(view)).transpose()?;
        let format = raw.and_then(|bytes| image::guess_format(bytes).ok());
        let (extension, bytes) = match (format, raw) {
            (Some(ImageFormat::Png), Some(bytes)) => ("png", bytes.to_vec()),
            (Some(ImageFormat::Jpeg), Some(bytes)) => ("jpg", bytes.to_vec()),
            _ => ("png", png(layer, scene, image)?),
        };
        let file = names::beside(layer, &format!("image{image}.{extension}"));
        let path = asset(layer, &file)?;
        self.files.push((file, bytes.into()));
        Ok(path)
    }
}

/// The file that a URI of the document leads to, if its name says that USD readers know its format.
fn readable(document: &Path, uri: &str) -> Option<PathBuf> {
    let known = |p: &PathBuf| {
        let extension = p.extension().unwrap_or_default();
        ["png", "jpg", "jpeg"].iter().any(|e| extension.eq_ignore_ascii_case(e))
    };
    let decoded = names::local_path(document, uri)?;
    [decoded, names::parent(document).join(uri)].into_iter().find(|p| known(p) && p.is_file())
}

fn png(layer: &Path, scene: &Scene, image: usize) -> Result<Vec<u8>, Error> {
    let (width, height, pixels) = scene.decoded_image(image)?;
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Default, FilterType::Adaptive)
        .write_image(pixels.as_flattened(), width, height, image::ExtendedColorType::Rgba8)
        .map_err(|e| Error::invalid(layer, format!("an image of the document cannot be encoded: {e}")))?;
    Ok(out)
}
