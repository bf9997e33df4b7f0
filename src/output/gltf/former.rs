//! What a former bake left in the document, and this one makes needless.
//!
//! In: the document's text and what this bake edits of it. Out: what goes:
//! * textures of pages (they have `extras.lightmap.uri`) that nothing refers to any more, with the images and samplers that
//!   they alone use, and `MOZ_lightmap` of materials that no primitive has. Without that, ten bakes in a row leave ten
//!   pages, nine of them in folders that may be gone;
//! * light at vertices, `_LIGHTMAP` and `COLOR_0`, of primitives that get other light, and `COLOR_0` of those that get none
//!   where no manifest would tell any more that it is light; and of their numbers, what `leftover` says.
//!
//! Of arrays only the end goes, where bakes append, so no index changes its meaning. Other scenes keep their pages.

use super::leftover::Leftover;
use super::material::Assigned;
use super::plan::Elements;
use super::plan::Instance;
use super::plan::without_extension;
use crate::output::splice::Element;
use crate::output::splice::Fault;
use crate::output::splice::Splice;
use crate::scene::Document;
use std::collections::BTreeSet;

/// The extension that gives a material a lightmap.
pub(super) const LIGHTMAP: &str = "MOZ_lightmap";

/// How much of a document stays.
pub(super) struct Former {
    /// Textures that stay, from the first on; others follow in their place.
    pub(super) textures: usize,
    /// The same for images.
    pub(super) images: usize,
    /// The same for samplers.
    pub(super) samplers: usize,
    /// Scenes whose manifest is replaced.
    pub(super) scenes: BTreeSet<usize>,
    /// Materials without users whose lightmap goes.
    materials: Vec<usize>,
    /// Others follow, so arrays may be empty meanwhile.
    appends: bool,
    /// What stays of accessors, buffer views and buffers.
    pub(super) leftover: Leftover,
}

impl Former {
    /// For a bake that edits `materials`, replaces the manifests of `scenes`, and `appends` textures; `leftover`
    /// is of light at its vertices.
    pub(super) fn new(
        root: &Element<'_>,
        elements: &Elements<'_>,
        materials: &Assigned,
        scenes: BTreeSet<usize>,
        appends: bool,
        leftover: Leftover,
    ) -> Self {
        let textures = root.array("textures");
        let [images, samplers] = ["images", "samplers"].map(|key| root.array(key).len());
        let mut all = Self { textures: textures.len(), images, samplers, scenes, materials: vec![], appends, leftover };
        let is_page = |t: usize| textures.get(t).is_some_and(|t| t.find(&["extras", "lightmap", "uri"]).is_some());
        if !(0..textures.len()).any(is_page) {
            return all;
        }
        let mut used = BTreeSet::new();
        for (m, material) in elements.materials.iter().enumerate() {
            let goes = materials.edits(m) || !materials.is_used(m);
            indices(material, "index", if goes { LIGHTMAP } else { "" }, &mut used);
            let page = material.find(&["extensions", LIGHTMAP]).and_then(|l| l.index_at("index"));
            if !materials.is_used(m) && page.is_some_and(is_page) {
                all.materials.push(m);
            }
        }
        for (_, scene) in root.array("scenes").iter().enumerate().filter(|(s, _)| !all.scenes.contains(s)) {
            let pages = scene.find(&["extras", "lightmap"]).map(|l| l.array("pages")).unwrap_or_default();
            used.extend(pages.iter().filter_map(|page| page.index_at("texture")));
        }
        all.textures = all.end(root, "textures", textures.len(), |t| is_page(t) && !used.contains(&t));
        let (kept, gone) = textures.split_at(all.textures);
        let in_lights = root.get("extensions").map(|e| numbers(&e, "specularImages", false)).unwrap_or_default();
        let alone = |key: &str| {
            let [kept, gone] = [kept, gone].map(|part| {
                let mut found = BTreeSet::new();
                part.iter().for_each(|texture| indices(texture, key, "", &mut found));
                found
            });
            gone.difference(&kept).copied().collect::<BTreeSet<usize>>()
        };
        let (own_images, own_samplers) = (alone("source"), alone("sampler"));
        all.images = all.end(root, "images", images, |i| own_images.contains(&i) && !in_lights.contains(&i));
        all.samplers = all.end(root, "samplers", samplers, |s| own_samplers.contains(&s));
        all
    }

    /// Where what `goes` at the end of an array begins. An array that would be empty goes as a whole, which only the first
    /// member of an object cannot.
    fn end(&self, root: &Element<'_>, key: &str, length: usize, goes: impl Fn(usize) -> bool) -> usize {
        let kept = (0..length).rev().find(|&i| !goes(i)).map_or(0, |last| last + 1);
        let first = root.members().first().is_some_and(|(name, _)| name == key);
        if kept == 0 && first && !self.appends { length } else { kept }
    }

    /// Takes out what goes.
    pub(super) fn leave_out(
        &self,
        splice: &mut Splice<'_>,
        root: &Element<'_>,
        elements: &Elements<'_>,
    ) -> Result<(), Fault> {
        for (key, kept) in [("textures", self.textures), ("images", self.images), ("samplers", self.samplers)] {
            let Some(array) = root.get(key).filter(|array| kept < array.items().len()) else { continue };
            if kept == 0 && !self.appends {
                splice.remove(root, key)?;
            } else {
                splice.truncate(&array, kept)?;
            }
        }
        for material in self.materials.iter().filter_map(|&m| elements.materials.get(m)) {
            splice.replace(material, without_extension(material.text(), LIGHTMAP)?);
        }
        self.leftover.leave_out(splice, root)
    }
}

/// Takes light out of the vertex colours of meshes that stay as they are, where the manifests that told of it are replaced.
pub(super) fn leave_out_colors<B>(
    splice: &mut Splice<'_>,
    document: &Document,
    elements: &Elements<'_>,
    instances: &[Instance<B>],
    shown_elsewhere: &BTreeSet<usize>,
) -> Result<(), Fault> {
    if document.baked_color.is_none() || instances.is_empty() {
        return Ok(());
    }
    let mut done: BTreeSet<usize> = instances.iter().filter(|i| i.in_place).map(|i| i.mesh).collect();
    let moved: BTreeSet<usize> = instances.iter().flat_map(|i| i.also.iter().chain([&i.node])).copied().collect();
    let unmoved = |n: &usize| !moved.contains(n);
    done.extend(shown_elsewhere.iter().filter(|n| unmoved(n)).filter_map(|&n| elements.nodes.get(n)?.index_at("mesh")));
    for (mesh, primitives) in elements.primitives.iter().enumerate().filter(|(mesh, _)| !done.contains(mesh)) {
        for (i, primitive) in primitives.iter().enumerate() {
            let plain = without_light(primitive.text(), document, [mesh, i], |name| name == "_LIGHTMAP")?;
            if plain != primitive.text() {
                splice.replace(primitive, plain);
            }
        }
    }
    Ok(())
}

/// Indices at `key` anywhere within a value, but not within members called `but`.
fn indices(element: &Element<'_>, key: &str, but: &str, found: &mut BTreeSet<usize>) {
    for (name, value) in element.members().iter().filter(|(name, _)| name != but) {
        found.extend(value.index().filter(|_| name == key));
        indices(value, key, but, found);
    }
    element.items().iter().for_each(|item| indices(item, key, but, found));
}

/// All indices in arrays at `key` anywhere within a value.
pub(super) fn numbers(element: &Element<'_>, key: &str, within: bool) -> BTreeSet<usize> {
    let mut found: BTreeSet<usize> = element.index().filter(|_| within).into_iter().collect();
    for (name, value) in element.members() {
        found.extend(numbers(&value, key, within || name == key));
    }
    found.extend(element.items().iter().flat_map(|item| numbers(item, key, within)));
    found
}

/// An attribute of a primitive holds light of a former bake.
pub(super) fn is_light(document: &Document, [mesh, index]: [usize; 2], name: &str) -> bool {
    let is_own = || document.baked_color.is_none() || document.root.attribute(mesh, index, "COLOR_0").is_some();
    name == "_LIGHTMAP" || (name == "COLOR_0" && !is_own())
}

/// A primitive without light of a former bake at its vertices, but for attributes that stay or are written anew.
pub(super) fn without_light(
    primitive: &str,
    document: &Document,
    [mesh, index]: [usize; 2],
    stays: impl Fn(&str) -> bool,
) -> Result<String, Fault> {
    let root = Element::root(primitive)?;
    let goes = |name: &str| !stays(name) && is_light(document, [mesh, index], name);
    let Some(attributes) = root.get("attributes") else { return Ok(primitive.to_owned()) };
    let mut kept = attributes.members();
    let before = kept.len();
    kept.retain(|(name, _)| !goes(name));
    if kept.len() == before {
        return Ok(primitive.to_owned());
    }
    let mut splice = Splice::new(primitive);
    splice.replace(&attributes, super::plan::object(&kept));
    splice.apply()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::gltf::material::Users;

    /// Two materials, of which the second has the lightmap of the last of three textures, and another scene.
    const BAKED: &str = r#"{"asset": {}, "samplers": [{}, {"own": 1}],
        "images": [{"uri": "a"}, {"uri": "old.png"}, {"uri": "new.png"}],
        "textures": [{"source": 0, "sampler": 0}, {"source": 1, "sampler": 1, "extras": {"lightmap": {"uri": "old.exr"}}},
            {"source": 2, "sampler": 1, "extras": {"lightmap": {"uri": "new.exr"}}}],
        "materials": [{"normalTexture": {"index": 0}}, {"extensions": {"MOZ_lightmap": {"index": 2}, "X": 1}}],
        "scenes": [{"extras": {"lightmap": {"pages": [{"texture": 2}]}}}, {"extras": {"lightmap": {"pages": [{"texture": 1}]}}}]}"#;

    /// The document without what goes where material 1 has these users.
    fn left(text: &str, scenes: &[usize], used: bool, appends: bool) -> serde_json::Value {
        let root = Element::root(text).unwrap();
        let mut users = Users::default();
        users.add(Some(0), None);
        if used {
            users.add(Some(1), None);
        }
        let (elements, assigned) = (Elements::new(&root), users.assign(2));
        let leftover = Leftover { accessors: 0, views: 0, buffers: 0, bin: None };
        let former = Former::new(&root, &elements, &assigned, scenes.iter().copied().collect(), appends, leftover);
        let mut splice = Splice::new(text);
        former.leave_out(&mut splice, &root, &elements).unwrap();
        serde_json::from_str(&splice.apply().unwrap()).unwrap()
    }

    #[test]
    fn what_nothing_refers_to_goes_and_all_else_stays() {
        let length = |document: &serde_json::Value| {
            ["textures", "images", "samplers"].map(|key| document[key].as_array().map_or(0, Vec::len))
        };
        assert_eq!(length(&left(BAKED, &[0, 1], true, true)), [3, 3, 2], "the material has it");
        let gone = left(BAKED, &[0, 1], false, true);
        assert_eq!(length(&gone), [1, 1, 1]);
        assert_eq!(gone["materials"][1], serde_json::json!({"extensions": {"X": 1}}));
        assert_eq!(length(&left(BAKED, &[0], false, true)), [2, 2, 2], "the other scene has the first page");
        assert_eq!(length(&left(BAKED, &[], false, true)), [3, 3, 2], "both scenes have theirs");
        let environment = BAKED.replace("\"asset\": {}", "\"extensions\": {\"L\": [{\"specularImages\": [[0, 2]]}]}");
        assert_eq!(length(&left(&environment, &[0, 1], false, true)), [1, 3, 1], "a light has the image");
        let foreign = BAKED.replace("\"lightmap\": {\"uri\": \"new.exr\"}", "\"other\": 1");
        assert_eq!(length(&left(&foreign, &[0, 1], false, true)), [3, 3, 2], "it is not ours");
    }

    #[test]
    fn arrays_without_anything_go_but_for_the_first() {
        let only = BAKED.replace("{\"source\": 0, \"sampler\": 0}, ", "").replace("\"index\": 0", "\"i\": 0");
        let only = only.replace("{\"uri\": \"a\"}, ", "").replace("[{}, ", "[");
        let only = only.replace("\"source\": 1, \"sampler\": 1", "\"source\": 0, \"sampler\": 0");
        let only = only.replace("\"source\": 2, \"sampler\": 1", "\"source\": 1, \"sampler\": 0");
        let gone = left(&only, &[0, 1], false, false);
        assert_eq!(gone.as_object().unwrap().keys().collect::<Vec<_>>(), ["asset", "materials", "scenes"]);
        assert_eq!(left(&only, &[0, 1], false, true)["textures"], serde_json::json!([]), "others follow");
        let first = only.replace("\"asset\": {}, ", "");
        assert_eq!(left(&first, &[0, 1], false, false)["samplers"].as_array().unwrap().len(), 1);
    }
}
