//! The files of the pages: are they there, as the manifest says, used, and lit?
//!
//! In: the document's `extras.lightmap` (the manifest of its scenes) and what the materials refer to. Out: a
//! [`PageFacts`] for every page that triangles lie on, and faults as sentences: `files` about names and factors, `black`
//! about pages without light.

use super::measure::{Kind, Measure, Tally};
use super::subject::Subject;
use super::{black, files};
use crate::atlas::MOST_MIPS;
use crate::output::Error;
use crate::output::splice::Element;
use crate::render::Lightmaps;
use crate::scene::Document;

/// A page that materials use.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PageFacts {
    /// Width [texels].
    pub width: u32,
    /// Height [texels].
    pub height: u32,
    /// Texels that charts touch.
    pub covered: u64,
    /// Their share of the page, in [0, 1].
    pub utilization: f64,
}

/// What the manifest says of a page.
struct Entry {
    texture: Option<usize>,
    size: [Option<usize>; 2],
    uri: String,
}

/// Mip levels that the document says do not mix charts; `None` if it says nothing.
pub(super) fn clean_levels(document: &Document) -> Option<u32> {
    let root = Element::root(&document.json).ok()?;
    let scenes = root.array("scenes");
    let manifest = scenes.iter().find_map(of_scene)?;
    manifest.index_at("mipLevels").map(|levels| (levels as u32).min(MOST_MIPS))
}

/// The manifest of a scene.
fn of_scene<'a>(scene: &Element<'a>) -> Option<Element<'a>> {
    scene.find(&["extras", "lightmap"])
}

fn entries(manifest: Option<&Element<'_>>) -> Vec<Entry> {
    let Some(manifest) = manifest else { return vec![] };
    let entry = |page: &Element<'_>| Entry {
        texture: page.index_at("texture"),
        size: [page.index_at("width"), page.index_at("height")],
        uri: page.get("uri").and_then(|u| u.string()).unwrap_or_default(),
    };
    manifest.array("pages").iter().map(entry).collect()
}

/// Textures that materials use as lightmaps, in the order of [`Lightmaps::pages`].
fn textures(root: &Element<'_>) -> Vec<usize> {
    let mut textures = vec![];
    for material in root.array("materials") {
        let texture = material.find(&["extensions", "MOZ_lightmap"]).and_then(|e| e.index_at("index"));
        if let Some(texture) = texture.filter(|t| !textures.contains(t)) {
            textures.push(texture);
        }
    }
    textures
}

/// Sentences about pages that are not as they should be.
///
/// # Errors
/// If the document is no JSON.
pub(super) fn faults(document: &Document, lightmaps: &Lightmaps) -> Result<Vec<String>, Error> {
    let root = Element::root(&document.json).map_err(|e| Error::invalid(&document.path, e.to_string()))?;
    let manifest = root.array("scenes").iter().find_map(of_scene);
    let used = textures(&root);
    let mut faults: Vec<String> =
        used.iter().flat_map(|texture| files::missing(&document.path, &root, *texture)).collect();
    faults.extend(manifest.iter().flat_map(|manifest| files::contradictions(&root, manifest)));
    for (k, entry) in entries(manifest.as_ref()).into_iter().enumerate() {
        let name = if entry.uri.is_empty() { format!("page {k} of the manifest") } else { entry.uri };
        let Some(page) = entry.texture.and_then(|t| used.iter().position(|u| *u == t)) else {
            faults.push(format!("{name} is used by no material"));
            continue;
        };
        let Some(image) = lightmaps.pages().get(page) else { continue };
        let size = [image.width as usize, image.height as usize];
        let differs = entry.size.iter().zip(size).any(|(said, is)| said.is_some_and(|said| said != is));
        if differs {
            let said = entry.size.map(|s| s.unwrap_or(0));
            faults.push(format!(
                "{name} has {} × {} texels, the manifest says {} × {}",
                size[0], size[1], said[0], said[1]
            ));
        }
    }
    Ok(faults)
}

/// Figures of the pages.
pub(super) fn facts(subject: &Subject<'_>) -> Vec<PageFacts> {
    let mut covered = vec![0u64; subject.lightmaps.pages().len()];
    for i in 0..subject.patches.front {
        covered[subject.patches.page(i) as usize] += 1;
    }
    let fact = |(image, covered): (&crate::output::exr::ImageF32, u64)| PageFacts {
        width: image.width,
        height: image.height,
        covered,
        utilization: covered as f64 / image.pixels.len().max(1) as f64,
    };
    subject.lightmaps.pages().iter().zip(covered).map(fact).collect()
}

/// The measure.
pub(super) fn measure(subject: &Subject<'_>, mut faults: Vec<String>, facts: &[PageFacts]) -> Measure {
    let empty = |(k, _): (usize, &PageFacts)| format!("no triangle lies on page {k}");
    faults.extend(facts.iter().enumerate().filter(|(_, f)| f.covered == 0).map(empty));
    faults.extend(black::faults(subject));
    let mut tally = Tally::default();
    (tally.count, tally.of) = (faults.len() as u64, facts.len() as u64);
    let mut measure = tally.measure(subject, Kind::Page, faults.len() as f64);
    measure.worst = measure.value;
    measure.notes = faults;
    measure
}
