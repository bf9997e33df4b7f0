//! Takes over how the primitives were treated, from the manifest that the bake left in `extras.lightmap`: rules of a
//! configuration file are nowhere else in the document.
//!
//! In: the scene as loaded. Out: the same, with density, `receives` and `casts` as baked. Without a manifest the `extras`
//! of the document say what they can.

use crate::output::Error;
use crate::output::gltf::Treated;
use crate::output::splice::Element;
use crate::scene::{Scene, Treatment};
use std::collections::BTreeMap;

/// Treats the scene as its bake did.
///
/// # Errors
/// If the document is no JSON, or the manifest's `treatments` are not what a bake writes.
pub(super) fn adopt(scene: &mut Scene) -> Result<(), Error> {
    let fail = |what: String| Error::invalid(&scene.document.path, what);
    let root = Element::root(&scene.document.json).map_err(|e| fail(e.to_string()))?;
    let scenes = root.array("scenes");
    let Some(manifest) = scenes.iter().find_map(|s| s.find(&["extras", "lightmap"])) else { return Ok(()) };
    let all: Vec<Treated> = match manifest.get("treatments") {
        None => vec![],
        Some(text) => serde_json::from_str(text.text())
            .map_err(|e| fail(format!("extras.lightmap.treatments of its scene cannot be read: {e}")))?,
    };
    let mut by_part = BTreeMap::new();
    for Treated { density, receives, casts, parts } in all {
        if !(density.is_finite() && density > 0.0) {
            return Err(fail(format!("extras.lightmap.treatments of its scene has a density of {density}")));
        }
        let treatment = Treatment { density, receives, casts, ..Treatment::default() };
        by_part.extend(parts.into_iter().map(|part| (part, treatment)));
    }
    for p in 0..scene.parts.len() {
        let place = [scene.parts[p].node, scene.parts[p].primitive];
        scene.treat(p, by_part.get(&place).copied().unwrap_or_default());
    }
    Ok(())
}
