//! The lightmaps of a baked document, as its materials refer to them.
//!
//! A material's `MOZ_lightmap` names a texture, whose `extras.lightmap.uri` is the page, an EXR unless `files` beside it
//! lists formats; then the most exact one is read. Texel × `intensity` is irradiance. The PNG of the texture is not
//! used: it is clamped.

use crate::base::Rgb;
use crate::output::Error;
use crate::output::exr::ImageF32;
use crate::output::formats;
use crate::output::splice::Element;
use crate::scene::Document;
use crate::scene::Scene;
use glam::Vec2;
use std::collections::BTreeMap;

/// Pages, and what every material does with them.
#[derive(Debug, Default)]
pub struct Lightmaps {
    pages: Vec<ImageF32>,
    /// By material of the document.
    materials: Vec<Option<Lightmap>>,
}

/// A material's lightmap.
#[derive(Debug, Clone, Copy)]
struct Lightmap {
    page: usize,
    uv_set: usize,
    /// Irradiance of a texel of 1 [lx].
    intensity: f32,
}

impl Lightmaps {
    /// Reads the pages that a document refers to. Without any the result is empty.
    ///
    /// # Errors
    /// If a page cannot be read, or a reference is broken.
    pub fn load(document: &Document) -> Result<Self, Error> {
        let fail = |message: String| Error::invalid(&document.path, message);
        let root = Element::root(&document.json).map_err(|e| fail(e.to_string()))?;
        let textures = root.array("textures");
        let mut by_texture: BTreeMap<usize, usize> = BTreeMap::new();
        let mut out = Self::default();
        for (m, material) in root.array("materials").iter().enumerate() {
            let Some(extension) = material.find(&["extensions", "MOZ_lightmap"]) else {
                out.materials.push(None);
                continue;
            };
            let texture = extension.index_at("index").unwrap_or(usize::MAX);
            let page = match by_texture.get(&texture) {
                Some(&page) => page,
                None => {
                    let named = textures.get(texture).and_then(|t| t.find(&["extras", "lightmap"]));
                    let (path, coding) = named.and_then(|named| formats::most_exact(&document.path, &named)).ok_or_else(|| {
                        fail(format!(
                            "the lightmap of material {m} names no EXR file; bake the document with texelwalk, or put its \
                             URI into extras.lightmap.uri of texture {texture}"
                        ))
                    })?;
                    out.pages.push(formats::read(&path, coding)?);
                    by_texture.insert(texture, out.pages.len() - 1);
                    out.pages.len() - 1
                }
            };
            let intensity = extension.get("intensity").and_then(|i| i.text().parse().ok()).unwrap_or(1.0);
            let uv_set = extension.index_at("texCoord").unwrap_or(0);
            out.materials.push(Some(Lightmap { page, uv_set, intensity }));
        }
        Ok(out)
    }

    /// Lightmaps that are in memory already: `materials` has (page, texture coordinate set, intensity) by material.
    #[must_use]
    pub fn new(pages: Vec<ImageF32>, materials: &[Option<(usize, usize, f32)>]) -> Self {
        let lightmap = |&(page, uv_set, intensity): &(usize, usize, f32)| Lightmap { page, uv_set, intensity };
        Self { pages, materials: materials.iter().map(|m| m.as_ref().map(lightmap)).collect() }
    }

    /// No material has one.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pages.is_empty()
    }

    /// Irradiance [lx] at a point of a triangle; `None` without a lightmap.
    #[must_use]
    pub fn irradiance(&self, scene: &Scene, triangle: u32, b: Vec2) -> Option<Rgb> {
        let (lightmap, page) = self.of(scene, triangle)?;
        let [p0, p1, p2] = self.texels(scene, triangle)?;
        Some(bilinear(page, p0 * (1.0 - b.x - b.y) + p1 * b.x + p2 * b.y) * lightmap.intensity)
    }

    /// Lightmap position of a triangle's corners [texels]; `None` without a lightmap.
    #[must_use]
    pub fn texels(&self, scene: &Scene, triangle: u32) -> Option<[Vec2; 3]> {
        let (lightmap, page) = self.of(scene, triangle)?;
        let set = scene.vertices.uv.get(lightmap.uv_set)?;
        let size = Vec2::new(page.width as f32, page.height as f32);
        Some(scene.triangles[triangle as usize].map(|v| set[v as usize] * size))
    }

    fn of(&self, scene: &Scene, triangle: u32) -> Option<(Lightmap, &ImageF32)> {
        let part = scene.part(triangle);
        let lightmap = (*self.materials.get(part.material)?)?;
        let has_set = lightmap.uv_set != 1 || part.has_uv1;
        Some((lightmap, self.pages.get(lightmap.page)?)).filter(|_| has_set)
    }
}

/// Bilinear value at a position in texels; centres are at halves, the border holds beyond the edge.
fn bilinear(page: &ImageF32, at: Vec2) -> Rgb {
    if page.pixels.is_empty() || !at.is_finite() {
        return Rgb::ZERO;
    }
    let corner = at - 0.5;
    let floor = corner.floor();
    let f = corner - floor;
    let texel = |dx: f32, dy: f32| {
        let x = (floor.x + dx).clamp(0.0, (page.width - 1) as f32) as usize;
        let y = (floor.y + dy).clamp(0.0, (page.height - 1) as f32) as usize;
        let [r, g, b, _] = page.pixels[y * page.width as usize + x];
        Rgb::new(r, g, b)
    };
    let top = texel(0.0, 0.0) * (1.0 - f.x) + texel(1.0, 0.0) * f.x;
    let bottom = texel(0.0, 1.0) * (1.0 - f.x) + texel(1.0, 1.0) * f.x;
    top * (1.0 - f.y) + bottom * f.y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bilinear_is_exact_at_centres_linear_between_and_holds_the_border() {
        let pixels = (0..6).map(|i| [i as f32, 0.0, 10.0 * i as f32, 0.0]).collect();
        let page = ImageF32 { width: 3, height: 2, pixels, has_alpha: true };
        let red = |x: f32, y: f32| bilinear(&page, Vec2::new(x, y)).x;
        assert_eq!((red(0.5, 0.5), red(2.5, 1.5)), (0.0, 5.0));
        assert!((red(1.0, 0.5) - 0.5).abs() < 1e-6 && (red(1.5, 1.0) - 2.5).abs() < 1e-6);
        assert_eq!((red(-3.0, 0.0), red(99.0, 99.0), red(0.0, 1.9)), (0.0, 5.0, 3.0));
        assert_eq!(bilinear(&page, Vec2::new(f32::NAN, 0.0)), Rgb::ZERO);
    }
}
