//! What a document says of its pages twice, and the files that it names.
//!
//! In: the document. Out: sentences about files that are not there, whether readers of a lightmap need them or what falls back
//! to them (the PNG that loaders see which know no `extras.lightmap`), and about materials and textures that say something
//! else than the manifest.
//!
//! Limits: a picture that is there is not looked into unless it is the page that is checked.

use crate::output::gltf::Quantity;
use crate::output::names;
use crate::output::splice::Element;
use std::path::Path;

/// Relative difference up to which two factors are the same: what writers round to.
const ROUNDING: f64 = 1e-3;

/// Files that a texture of a page names and that are missing.
pub(super) fn missing(document: &Path, root: &Element<'_>, texture: usize) -> Vec<String> {
    let textures = root.array("textures");
    let Some(named) = textures.get(texture) else { return vec![] };
    let images = root.array("images");
    let extensions = named.get("extensions").map(|e| e.members()).unwrap_or_default();
    let sources = core::iter::once(*named).chain(extensions.into_iter().map(|(_, extension)| extension));
    let shown = sources.filter_map(|user| images.get(user.index_at("source")?)?.get("uri")?.string());
    let mut uris: Vec<String> = shown.chain(light(named)).collect();
    uris.sort_unstable();
    uris.dedup();
    let absent = |uri: &String| names::local_path(document, uri).is_some_and(|path| !path.is_file());
    uris.retain(absent);
    uris.iter().map(|uri| format!("{uri} is missing, which texture {texture} names")).collect()
}

/// URIs in `extras.lightmap` of a texture.
fn light(texture: &Element<'_>) -> Vec<String> {
    let Some(lightmap) = texture.find(&["extras", "lightmap"]) else { return vec![] };
    let files = lightmap.array("files");
    let pages = core::iter::once(lightmap).chain(files).filter_map(|file| file.get("uri")?.string());
    let directional = lightmap.get("directional").map(|d| d.members()).unwrap_or_default();
    let by_normal = directional.iter().filter(|(key, _)| key != "mode" && key != "decode");
    pages.chain(by_normal.filter_map(|(_, uri)| uri.string())).collect()
}

/// Where materials and textures contradict the manifest.
pub(super) fn contradictions(root: &Element<'_>, manifest: &Element<'_>) -> Vec<String> {
    let pages = manifest.array("pages");
    let textures = root.array("textures");
    let mut faults = intensities(root, manifest, &pages);
    for page in &pages {
        let Some(texture) = page.index_at("texture") else { continue };
        let named = textures.get(texture).and_then(|t| t.find(&["extras", "lightmap"]));
        let Some(named) = named else { continue };
        let uri = |of: &Element<'_>| of.get("uri").and_then(|uri| uri.string());
        if let (Some(a), Some(b)) = (uri(page), uri(&named))
            && a != b
        {
            faults.push(format!("texture {texture} names {b}, the manifest {a}"));
        }
        faults.extend(scales(page, &named, texture));
    }
    faults
}

/// Materials whose factor from texels to irradiance is not that of the manifest's quantity.
fn intensities(root: &Element<'_>, manifest: &Element<'_>, pages: &[Element<'_>]) -> Vec<String> {
    let said = manifest.get("quantity").and_then(|q| q.string());
    let quantity = [Quantity::Radiosity, Quantity::Irradiance].into_iter().find(|q| said.as_deref() == Some(q.name()));
    let Some((quantity, expected)) = quantity.and_then(|q| Some((q, q.intensity().parse().ok()?))) else {
        return vec![];
    };
    let of_pages: Vec<usize> = pages.iter().filter_map(|page| page.index_at("texture")).collect();
    let wrong = |(m, material): (usize, &Element<'_>)| {
        let lightmap = material.find(&["extensions", "MOZ_lightmap"])?;
        let intensity = number(&lightmap, "intensity").unwrap_or(1.0);
        let shows = lightmap.index_at("index").is_some_and(|texture| of_pages.contains(&texture));
        let name = || material.get("name").and_then(|n| n.string()).unwrap_or_else(|| format!("material {m}"));
        (shows && differ(intensity, expected)).then(|| (name(), intensity))
    };
    let all: Vec<(String, f64)> = root.array("materials").iter().enumerate().filter_map(wrong).collect();
    let Some((first, intensity)) = all.first() else { return vec![] };
    let others = if all.len() > 1 { format!(" and {} more", all.len() - 1) } else { String::new() };
    vec![format!(
        "{first}{others} has an intensity of {intensity}, the quantity of the manifest is {}, so it should be {expected:.6}",
        quantity.name()
    )]
}

/// Files of a page whose scale is not that of the manifest.
fn scales(page: &Element<'_>, texture: &Element<'_>, index: usize) -> Vec<String> {
    let format = |file: &Element<'_>| file.get("format").and_then(|f| f.string());
    let own = texture.array("files");
    let wrong = |file: &Element<'_>| {
        let name = format(file)?;
        let other = own.iter().find(|other| format(other).as_ref() == Some(&name))?;
        let [said, is] = [file, other].map(|file| number(file, "scale").unwrap_or(1.0));
        differ(said, is).then(|| format!("texture {index} has a scale of {is} for {name}, the manifest {said}"))
    };
    page.array("files").iter().filter_map(wrong).collect()
}

fn number(of: &Element<'_>, key: &str) -> Option<f64> {
    of.get(key)?.text().parse().ok()
}

fn differ(a: f64, b: f64) -> bool {
    let off = (a - b).abs();
    off.is_nan() || off > ROUNDING * a.abs().max(b.abs())
}
