//! The lightmaps of a baked document, as its materials refer to them.
//!
//! A material's `MOZ_lightmap` names a texture, whose `extras.lightmap.uri` is the page, an EXR unless `files` beside it
//! lists formats; then the most exact one is read. Texel × `intensity` is irradiance. The PNG of the texture is not
//! used: it is clamped. Light at vertices is the attribute `_LIGHTMAP` of a primitive, in the quantity that
//! `extras.lightmap` of its scene names, or `COLOR_0` times the scale that it names. That is light times the colours of
//! before, which are not known where there were any; then they are left out of the surface, and `_LIGHTMAP` is not used.
//!
//! What was baked just now needs no document: [`Lightmaps::placed`] and [`Lightmaps::at_vertices`].

use crate::base::Rgb;
use crate::base::bilinear::bilinear;
use crate::output::Error;
use crate::output::exr::ImageF32;
use crate::output::formats;
use crate::output::splice::Element;
use crate::scene::Document;
use crate::scene::Part;
use crate::scene::Scene;
use glam::Vec2;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Pages, and what every material does with them.
#[derive(Debug, Default)]
pub struct Lightmaps {
    pages: Vec<ImageF32>,
    /// The files that hold them.
    files_read: Vec<PathBuf>,
    /// By material of the document.
    materials: Vec<Option<Lightmap>>,
    /// Irradiance at vertices by part [lx]; empty for parts without.
    vertices: Vec<Vec<Rgb>>,
    /// By triangle, where no material tells.
    places: Vec<Option<Place>>,
    /// Irradiance of a texel of 1 at those [lx].
    intensity: f32,
}

/// Where a triangle lies on the pages.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Page.
    pub page: u32,
    /// Number of its chart.
    pub chart: u32,
    /// Its corners [texels].
    pub corners: [Vec2; 3],
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
    /// Reads the pages that a scene's document refers to, and light at vertices. Without any the result is empty.
    ///
    /// # Errors
    /// If a page cannot be read, or a reference is broken.
    pub fn load(scene: &Scene) -> Result<Self, Error> {
        let mut lightmaps = Self::load_pages(&scene.document)?;
        lightmaps.load_vertices(scene)?;
        Ok(lightmaps)
    }

    fn load_vertices(&mut self, scene: &Scene) -> Result<(), Error> {
        let fail = |message: String| Error::invalid(&scene.document.path, message);
        let root = Element::root(&scene.document.json).map_err(|e| fail(e.to_string()))?;
        let quantity = |s: &Element<'_>| s.find(&["extras", "lightmap", "quantity"]).and_then(|q| q.string());
        let irradiance = root.array("scenes").iter().find_map(quantity).is_some_and(|q| q == "irradiance");
        let factor = if irradiance { 1.0 } else { core::f32::consts::PI };
        self.vertices = vec![vec![]; scene.parts.len()];
        for (part, values) in scene.parts.iter().zip(&mut self.vertices) {
            if let Some(colors) = colors(scene, part)? {
                *values = colors;
                continue;
            }
            let accessor = scene.document.root.attribute(part.mesh, part.primitive, "_LIGHTMAP");
            let Some(accessor) = accessor else { continue };
            let data = scene.document.accessor(accessor)?;
            if (data.components, data.component_type, data.count) != (3, 5126, part.vertices.len()) {
                return Err(fail(format!("_LIGHTMAP of {} is not three floats for each vertex", part.name)));
            }
            let float = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
            let vector = |b: &[u8]| Rgb::new(float(b), float(&b[4..]), float(&b[8..])) * factor;
            *values = data.bytes.chunks_exact(12).map(vector).collect();
        }
        Ok(())
    }

    fn load_pages(document: &Document) -> Result<Self, Error> {
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
                    out.files_read.push(path);
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
        Self { pages, materials: materials.iter().map(|m| m.as_ref().map(lightmap)).collect(), ..Self::default() }
    }

    /// Pages with a place for every triangle of the scene; a texel of 1 is an irradiance of `intensity` [lx].
    #[must_use]
    pub fn placed(pages: Vec<ImageF32>, places: Vec<Option<Place>>, intensity: f32) -> Self {
        Self { pages, places, intensity, ..Self::default() }
    }

    /// Irradiance at the vertices of every part [lx]; empty for parts without.
    #[must_use]
    pub fn at_vertices(vertices: Vec<Vec<Rgb>>) -> Self {
        Self { vertices, ..Self::default() }
    }

    /// Chart of a triangle, where the atlas has told.
    #[must_use]
    pub fn chart(&self, triangle: u32) -> Option<u32> {
        self.place(triangle).map(|place| place.chart)
    }

    fn place(&self, triangle: u32) -> Option<&Place> {
        self.places.get(triangle as usize)?.as_ref()
    }

    /// No material and no vertex has one.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pages.is_empty() && self.vertices.iter().all(Vec::is_empty)
    }

    /// The pages, in the order in which materials name them first.
    #[must_use]
    pub fn pages(&self) -> &[ImageF32] {
        &self.pages
    }

    /// The files that the pages were read from.
    #[must_use]
    pub fn files_read(&self) -> &[PathBuf] {
        &self.files_read
    }

    /// The pages, to be changed.
    pub fn pages_mut(&mut self) -> &mut [ImageF32] {
        &mut self.pages
    }

    /// Index into [`Lightmaps::pages`] of a triangle's page, and irradiance of a texel of 1 [lx]; `None` without a
    /// lightmap.
    #[must_use]
    pub fn page(&self, scene: &Scene, triangle: u32) -> Option<(usize, f32)> {
        self.of(scene, triangle).map(|(lightmap, _)| (lightmap.page, lightmap.intensity))
    }

    /// Irradiance [lx] at a point of a triangle; `None` without a lightmap.
    #[must_use]
    pub fn irradiance(&self, scene: &Scene, triangle: u32, b: Vec2) -> Option<Rgb> {
        if let Some([e0, e1, e2]) = self.corners(scene, triangle) {
            return Some(e0 * (1.0 - b.x - b.y) + e1 * b.x + e2 * b.y);
        }
        let [p0, p1, p2] = self.texels(scene, triangle)?;
        let at = p0 * (1.0 - b.x - b.y) + p1 * b.x + p2 * b.y;
        let (intensity, page) = match self.place(triangle) {
            Some(place) => (self.intensity, self.pages.get(place.page as usize)?),
            None => self.of(scene, triangle).map(|(lightmap, page)| (lightmap.intensity, page))?,
        };
        Some(bilinear(page.width, page.height, &page.pixels, at) * intensity)
    }

    /// Lightmap position of a triangle's corners [texels]; `None` without a lightmap.
    #[must_use]
    pub fn texels(&self, scene: &Scene, triangle: u32) -> Option<[Vec2; 3]> {
        if let Some(place) = self.place(triangle) {
            return Some(place.corners);
        }
        let (lightmap, page) = self.of(scene, triangle)?;
        let size = Vec2::new(page.width as f32, page.height as f32);
        let [a, b, c] = scene.triangle(triangle).map(|v| scene.vertex_uv(lightmap.uv_set, v));
        Some([a? * size, b? * size, c? * size])
    }

    /// The triangle has light at its corners.
    pub(super) fn is_at_vertices(&self, scene: &Scene, triangle: u32) -> bool {
        self.vertices.get(scene.part_index(triangle)).is_some_and(|values| !values.is_empty())
    }

    /// Irradiance at a triangle's corners [lx].
    fn corners(&self, scene: &Scene, triangle: u32) -> Option<[Rgb; 3]> {
        let part = scene.part_index(triangle);
        let values = self.vertices.get(part).filter(|values| !values.is_empty())?;
        let first = scene.parts[part].vertices.start;
        Some(scene.triangle(triangle).map(|v| values[(v - first) as usize]))
    }

    fn of(&self, scene: &Scene, triangle: u32) -> Option<(Lightmap, &ImageF32)> {
        let part = scene.part(triangle);
        let lightmap = (*self.materials.get(part.material)?)?;
        let has_set = lightmap.uv_set != 1 || part.has_uv1;
        Some((lightmap, self.pages.get(lightmap.page)?)).filter(|_| has_set)
    }
}

/// Irradiance times the vertex colours of before [lx], if a part has that as `COLOR_0` and nothing that is better.
fn colors(scene: &Scene, part: &Part) -> Result<Option<Vec<Rgb>>, Error> {
    let document = &scene.document;
    let Some(color) = &document.baked_color else { return Ok(None) };
    let Some(&accessor) = color.accessors.get(&(part.mesh, part.primitive)) else { return Ok(None) };
    if color.white && document.root.attribute(part.mesh, part.primitive, "_LIGHTMAP").is_some() {
        return Ok(None);
    }
    let data = document.accessor(accessor)?;
    if !(3..=4).contains(&data.components) || data.count != part.vertices.len() {
        let message = format!("COLOR_0 of {} is no colour for each vertex", part.name);
        return Err(Error::invalid(&document.path, message));
    }
    let factor = color.scale * core::f32::consts::PI;
    Ok(Some(data.to_f32().chunks_exact(data.components).map(|c| Rgb::new(c[0], c[1], c[2]) * factor).collect()))
}
