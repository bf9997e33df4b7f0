//! What the manifest says of primitives that were not treated as usual, so that whoever judges the lightmap knows.
//!
//! In: the scene. Out: JSON, or the same as [`Treated`]. Limit: programs that renumber nodes without the manifest make it
//! wrong, as they do its indices of textures.

use crate::scene::{Scene, Treatment};

/// Primitives that were treated alike.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Treated {
    /// Factor of the texels per metre.
    pub density: f32,
    /// They may have a lightmap.
    pub receives: bool,
    /// Others are lit as if they were there.
    pub casts: bool,
    /// Nodes with primitives of their meshes.
    pub parts: Vec<[usize; 2]>,
}

/// `, "treatments": […]` in the order of first appearance, or nothing if all are treated as usual.
pub(super) fn manifest(scene: &Scene) -> String {
    let mut all: Vec<Treated> = vec![];
    for part in &scene.parts {
        let Treatment { density, receives, casts, .. } = part.treatment;
        if (density, receives, casts) == (1.0, true, true) {
            continue;
        }
        let same = |t: &&mut Treated| (t.density, t.receives, t.casts) == (density, receives, casts);
        let place = [part.node, part.primitive];
        match all.iter_mut().find(same) {
            Some(treated) => treated.parts.push(place),
            None => all.push(Treated { density, receives, casts, parts: vec![place] }),
        }
    }
    let text = serde_json::to_string(&all).unwrap_or_default();
    if all.is_empty() { String::new() } else { format!(", \"treatments\": {text}") }
}
