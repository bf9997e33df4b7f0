//! A bake as one HTML page for people: pictures with and without the light, lightmap pages, heat maps, figures, warnings.
//!
//! In: what was baked ([`Subject`]), then the report. Out: the bytes of a page that needs no other file and no network:
//! pictures are data URIs, style and script are inline. It comes in two steps, because the report has the time that the
//! pictures take: [`pictures`], then [`page`].
//!
//! `views` and `groups` take pictures of the scene, `maps` those of lightmap pages, `scale` has colours with their
//! numbers; `document` puts them and the `tables` into `template.html`, through `markup`, which escapes all text.
//!
//! Invariants: the page depends on the thread count, the clock and the machine only between the comments `measured`
//! and `/measured`. Every text of the document is escaped. Whatever a colour tells stands beside it as a number.
//!
//! Limits: three cameras, six lightmap pages and twelve groups of lights are shown; the page says so where there are
//! more. Pictures see the sky, not an environment map, as those of `render`.

mod cut;
mod document;
mod groups;
mod maps;
mod markup;
mod scale;
mod tables;
mod views;

pub use document::{Change, Facts, page};
pub use maps::DIM;

use crate::atlas::{Atlas, NO_CHART};
use crate::finish::{Lightmap, Page};
use crate::output::exr::ImageF32;
use crate::output::{self, jpeg, png};
use crate::patches::Patches;
use crate::render::{self, Lightmaps, Place};
use crate::scene::Scene;
use crate::trace::Tracer;
use crate::vertices::VertexLight;
use std::path::Path;

/// What was baked.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// Where the page will go, for messages.
    pub path: &'a Path,
    /// The scene.
    pub tracer: &'a Tracer<'a>,
    /// Where it lies on pages.
    pub atlas: &'a Atlas,
    /// Its texels.
    pub patches: &'a Patches,
    /// The light on pages.
    pub lightmap: &'a Lightmap,
    /// The light of groups of lights, by their names.
    pub groups: &'a [(String, Lightmap)],
    /// The light at vertices, if that is what is written.
    pub vertices: Option<&'a VertexLight>,
    /// Standard error of each front patch, as a part of its light, or of [`DIM`] of the mean where it is darker.
    pub noise: &'a [f32],
    /// Irradiance of a stored value of 1 [lx].
    pub intensity: f32,
}

/// Why there are no pictures.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The scene cannot be seen.
    #[error("the pictures of the HTML report cannot be taken: {0}")]
    Render(#[from] render::Error),
    /// A picture cannot be encoded.
    #[error(transparent)]
    Output(#[from] output::Error),
}

/// A picture that a page can hold.
#[derive(Debug, Clone)]
struct Image {
    /// `image/png` or `image/jpeg`.
    mime: &'static str,
    bytes: Vec<u8>,
    /// Width and height [px].
    size: [u32; 2],
}

/// All pictures of a page.
#[derive(Debug, Default)]
pub struct Pictures {
    views: Vec<views::ViewPictures>,
    /// Cameras of the document.
    cameras: usize,
    maps: maps::Maps,
    groups: Vec<groups::GroupPicture>,
}

/// Takes the pictures of a bake. A pure function of the subject.
///
/// # Errors
/// If a picture cannot be encoded.
pub fn pictures(subject: &Subject<'_>) -> Result<Pictures, Error> {
    let scene = subject.tracer.scene();
    let cameras = scene.cameras.len();
    if let Some(light) = subject.vertices {
        let cut = cut::scene(scene, light);
        let lit = Lightmaps::at_vertices(cut::irradiance(light, subject.intensity));
        let tracer = cut.as_ref().map(Tracer::of_all);
        let views = views::views(subject, tracer.as_ref().unwrap_or(subject.tracer), &lit)?;
        return Ok(Pictures { views, cameras, ..Pictures::default() });
    }
    let lit = placed(subject, subject.lightmap);
    let views = views::views(subject, subject.tracer, &lit)?;
    let density = render::median_density(scene, &lit);
    drop(lit);
    let groups = match views.first() {
        Some(view) => groups::groups(subject, view.exposure)?,
        None => vec![],
    };
    let maps = maps::maps(subject, density)?;
    Ok(Pictures { views, cameras, maps, groups })
}

/// A lightmap on the scene that it was baked for.
fn placed(subject: &Subject<'_>, lightmap: &Lightmap) -> Lightmaps {
    let image =
        |page: &Page| ImageF32 { width: page.width, height: page.height, pixels: page.pixels.clone(), has_alpha: true };
    let pages = lightmap.pages.iter().map(image).collect();
    Lightmaps::placed(pages, places(subject.tracer.scene(), subject.atlas), subject.intensity)
}

fn places(scene: &Scene, atlas: &Atlas) -> Vec<Option<Place>> {
    let mut places = vec![None; scene.triangle_count()];
    for (part, charted) in scene.parts.iter().zip(&atlas.parts) {
        for ((t, corners), chart) in part.triangles.clone().zip(&charted.layout.triangles).zip(charted.charts()) {
            if chart != NO_CHART {
                let page = atlas.charts[chart as usize].page;
                places[t as usize] = Some(Place { page, chart, corners: corners.map(|v| charted.uv(v)) });
            }
        }
    }
    places
}

/// With smooth colours.
fn photo(path: &Path, size: [u32; 2], pixels: &[[f32; 3]]) -> Result<Image, Error> {
    Ok(Image { mime: "image/jpeg", bytes: jpeg::picture(path, size, pixels)?, size })
}

/// With few colours.
fn drawing(path: &Path, size: [u32; 2], pixels: &[[f32; 3]]) -> Result<Image, Error> {
    Ok(Image { mime: "image/png", bytes: png::picture(path, size, pixels)?, size })
}
