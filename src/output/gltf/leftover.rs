//! What light at vertices of a former bake leaves at the end of a document when other light takes its place.
//!
//! In: the document, and which primitives get light. Out: how many accessors, buffer views and buffers stay, and how many
//! bytes of the BIN chunk. Without that, every bake in a row adds the light of all vertices, and a `.gltf` names the files
//! of all former ones, in folders that may be gone.
//!
//! An accessor goes if it was light of a primitive that gets other light, and nothing else names it; a view if its accessors
//! go and nothing else names it; a buffer if its views do. Where it is not known what a number means, as within an
//! extension of a primitive, it counts as a name.

use super::former::is_light;
use super::former::numbers;
use super::plan;
use super::plan::Elements;
use super::plan::Instance;
use crate::output::splice::Element;
use crate::output::splice::Fault;
use crate::output::splice::Splice;
use crate::scene::Document;
use std::collections::BTreeSet;

/// Extensions of primitives in which no number is that of an accessor.
const WITHOUT_ACCESSORS: [&str; 2] = ["KHR_materials_variants", plan::DRACO];

/// How much of a document's numbers stays.
pub(super) struct Leftover {
    /// Accessors that stay, from the first on; others follow in their place.
    pub(super) accessors: usize,
    /// The same for buffer views.
    pub(super) views: usize,
    /// The same for buffers.
    pub(super) buffers: usize,
    /// Bytes of the BIN chunk that stay; `None` = all.
    pub(super) bin: Option<usize>,
}

impl Leftover {
    /// For a bake that puts light on the primitives of these instances.
    pub(super) fn new<B>(
        root: &Element<'_>,
        document: &Document,
        elements: &Elements<'_>,
        instances: &[Instance<B>],
    ) -> Self {
        let baked = instances.iter().filter(|i| i.in_place).flat_map(|i| i.baked.keys().map(|p| (i.mesh, *p)));
        let baked: BTreeSet<(usize, usize)> = baked.collect();
        let [mut light, mut named] = [BTreeSet::new(), BTreeSet::new()];
        for (m, primitives) in elements.primitives.iter().enumerate() {
            for (p, primitive) in primitives.iter().enumerate() {
                let goes = |name: &str| baked.contains(&(m, p)) && is_light(document, [m, p], name);
                for (name, accessor) in primitive.get("attributes").map(|a| a.members()).unwrap_or_default() {
                    if goes(&name) { &mut light } else { &mut named }.extend(accessor.index());
                }
                named.extend(["indices", "targets"].iter().filter_map(|key| primitive.get(key)).flat_map(|e| all(&e)));
                for (name, extension) in primitive.get("extensions").map(|e| e.members()).unwrap_or_default() {
                    named.extend(Some(extension).filter(|_| !WITHOUT_ACCESSORS.contains(&&*name)).iter().flat_map(all));
                }
            }
        }
        let others = root.members().into_iter().filter(|(key, _)| key != "meshes" && key != "bufferViews");
        for (_, other) in others {
            for key in ["attributes", "input", "output", "inverseBindMatrices"] {
                named.extend(numbers(&other, key, false));
            }
        }
        let goes: BTreeSet<usize> = light.difference(&named).copied().collect();
        let (views, buffers) = (root.array("bufferViews"), root.array("buffers"));
        let mut left =
            Self { accessors: elements.accessors.len(), views: views.len(), buffers: buffers.len(), bin: None };
        left.accessors = end(left.accessors, |a| goes.contains(&a));
        if left.accessors == elements.accessors.len() {
            return left;
        }
        let mut viewed: BTreeSet<usize> =
            elements.accessors[..left.accessors].iter().flat_map(|a| at(a, "bufferView")).collect();
        let gone: BTreeSet<usize> =
            elements.accessors[left.accessors..].iter().flat_map(|a| at(a, "bufferView")).collect();
        for (_, other) in root.members().into_iter().filter(|(key, _)| key != "accessors") {
            viewed.extend(at(&other, "bufferView"));
        }
        left.views = end(left.views, |v| gone.contains(&v) && !viewed.contains(&v));
        let (kept, gone) = views.split_at(left.views);
        let mut filled: BTreeSet<usize> = kept.iter().flat_map(|v| at(v, "buffer")).collect();
        for (_, other) in root.members().into_iter().filter(|(key, _)| key != "bufferViews") {
            filled.extend(at(&other, "buffer"));
        }
        let emptied: BTreeSet<usize> = gone.iter().flat_map(|v| at(v, "buffer")).collect();
        left.buffers = end(left.buffers, |b| emptied.contains(&b) && !filled.contains(&b));
        left.bin = document.bin.as_ref().and_then(|_| bytes(kept, gone));
        left
    }

    /// Takes out what goes.
    pub(super) fn leave_out(&self, splice: &mut Splice<'_>, root: &Element<'_>) -> Result<(), Fault> {
        for (key, kept) in [("accessors", self.accessors), ("bufferViews", self.views), ("buffers", self.buffers)] {
            if let Some(array) = root.get(key).filter(|array| kept < array.items().len()) {
                splice.truncate(&array, kept)?;
            }
        }
        Ok(())
    }
}

/// Where what `goes` at the end of an array begins; never is all of it taken.
fn end(length: usize, goes: impl Fn(usize) -> bool) -> usize {
    (0..length).rev().find(|&i| !goes(i)).map_or(length, |last| last + 1)
}

/// Bytes of buffer 0 up to the views that go, if all that stay lie before them.
fn bytes(kept: &[Element<'_>], gone: &[Element<'_>]) -> Option<usize> {
    let offset = |view: &Element<'_>| view.index_at("byteOffset").unwrap_or(0);
    let first = gone.iter().filter(|view| view.index_at("buffer") == Some(0)).map(offset).min()?;
    let mut all = kept.to_vec();
    for extensions in kept.iter().filter_map(|view| view.get("extensions")) {
        all.extend(extensions.members().into_iter().map(|(_, extension)| extension));
    }
    let last = all.iter().filter(|view| view.index_at("buffer") == Some(0));
    let last = last.map(|view| offset(view) + view.index_at("byteLength").unwrap_or(0)).max()?;
    (last <= first).then_some(first)
}

/// All indices within a value.
fn all(element: &Element<'_>) -> BTreeSet<usize> {
    numbers(element, "", true)
}

/// All indices at `key` within a value.
fn at(element: &Element<'_>, key: &str) -> BTreeSet<usize> {
    numbers(element, key, false)
}
