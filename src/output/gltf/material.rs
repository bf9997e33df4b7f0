//! Materials with `MOZ_lightmap`.
//!
//! A material that is used only by baked primitives of one page gets the extension itself; every further page, and a
//! material that something unbaked uses too, gets a copy behind the existing ones. So no index changes its meaning.

use super::Quantity;
use crate::output::splice::Element;
use crate::output::splice::Fault;
use crate::output::splice::Splice;
use std::collections::BTreeMap;
use std::collections::BTreeSet;

/// A lightmap as a material refers to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Use {
    /// Page of the lightmap.
    pub(super) page: u32,
    /// n of the `TEXCOORD_n` that it is on.
    pub(super) set: usize,
}

/// Which materials are used with which lightmap.
#[derive(Default)]
pub(super) struct Users {
    /// Source material (`None` = glTF's default material) → its uses; `None` = without a lightmap.
    uses: BTreeMap<Option<usize>, BTreeSet<Option<Use>>>,
}

impl Users {
    pub(super) fn add(&mut self, material: Option<usize>, lightmap: Option<Use>) {
        self.uses.entry(material).or_default().insert(lightmap);
    }

    /// Index of the material for every (source material, use), with the source of each copy in order.
    pub(super) fn assign(&self, existing: usize) -> Assigned {
        let used = self.uses.keys().flatten().copied().collect();
        let mut assigned = Assigned { used, index: BTreeMap::new(), in_place: Vec::new(), copies: Vec::new() };
        for (&source, uses) in &self.uses {
            let mut free = source.filter(|_| !uses.contains(&None));
            for &lightmap in uses.iter().flatten() {
                let index = if let Some(source) = free.take() {
                    assigned.in_place.push((source, lightmap));
                    source
                } else {
                    assigned.copies.push((source, lightmap));
                    existing + assigned.copies.len() - 1
                };
                assigned.index.insert((source, lightmap), index);
            }
        }
        assigned
    }
}

/// The materials of the output.
pub(super) struct Assigned {
    used: BTreeSet<usize>,
    index: BTreeMap<(Option<usize>, Use), usize>,
    in_place: Vec<(usize, Use)>,
    copies: Vec<(Option<usize>, Use)>,
}

impl Assigned {
    /// Gives a primitive and its variants the materials for a use.
    pub(super) fn set<'a>(&self, splice: &mut Splice<'a>, primitive: &Element<'a>, lightmap: Use) -> Result<(), Fault> {
        let variants = primitive.find(&["extensions", "KHR_materials_variants"]);
        let mappings = variants.map(|v| v.array("mappings")).unwrap_or_default();
        for user in core::iter::once(*primitive).chain(mappings) {
            if let Some(material) = self.get(user.index_at("material"), lightmap) {
                splice.set(&user, "material", material.to_string())?;
            }
        }
        Ok(())
    }

    /// A primitive has this material of the document.
    pub(super) fn is_used(&self, material: usize) -> bool {
        self.used.contains(&material)
    }

    /// This material of the document is edited.
    pub(super) fn edits(&self, material: usize) -> bool {
        self.in_place.iter().any(|&(source, _)| source == material)
    }

    /// The material to use instead of `source` with a lightmap.
    fn get(&self, source: Option<usize>, lightmap: Use) -> Option<usize> {
        self.index.get(&(source, lightmap)).copied()
    }

    /// Splices the materials into the document; `edit` makes the text of a material for its use.
    pub(super) fn write(
        &self,
        splice: &mut Splice<'_>,
        root: &Element<'_>,
        edit: impl Fn(&str, Use) -> Result<String, Fault>,
    ) -> Result<(), Fault> {
        let materials = root.array("materials");
        let text = |source: Option<usize>, lightmap: Use| {
            let text = source.and_then(|i| materials.get(i)).map_or("{}", Element::text);
            edit(text, lightmap)
        };
        for &(source, lightmap) in &self.in_place {
            if let Some(material) = materials.get(source) {
                splice.replace(material, text(Some(source), lightmap)?);
            }
        }
        let copies: Result<Vec<String>, Fault> = self.copies.iter().map(|&(source, l)| text(source, l)).collect();
        splice.append_at(root, "materials", copies?)
    }
}

/// A material's text with `MOZ_lightmap`.
pub(super) fn with_lightmap(material: &str, texture: usize, set: usize, quantity: Quantity) -> Result<String, Fault> {
    let root = Element::root(material)?;
    let mut splice = Splice::new(material);
    let intensity = quantity.intensity();
    let lightmap = format!("{{\"index\": {texture}, \"texCoord\": {set}, \"intensity\": {intensity}}}");
    splice.set_path(&root, &["extensions", "MOZ_lightmap"], lightmap)?;
    splice.apply()
}

/// Anything below `element` but an old lightmap reads texture coordinate set `set`: a member `texCoord` has that value.
pub(super) fn reads_uv_set(element: &Element<'_>, set: usize) -> bool {
    let member = |(key, value): &(String, Element<'_>)| {
        key != "MOZ_lightmap" && (key == "texCoord" && value.index() == Some(set) || reads_uv_set(value, set))
    };
    element.members().iter().any(member) || element.items().iter().any(|item| reads_uv_set(item, set))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_page_in_place_unless_something_unbaked_uses_it() {
        let (page0, page1) = (Use { page: 0, set: 1 }, Use { page: 1, set: 1 });
        let mut users = Users::default();
        users.add(Some(0), Some(page1));
        users.add(Some(0), Some(page0));
        users.add(Some(1), Some(page0));
        users.add(Some(1), None);
        users.add(None, Some(page0));
        users.add(Some(2), None);
        let assigned = users.assign(3);
        assert_eq!(assigned.get(None, page0), Some(3));
        assert_eq!(assigned.get(Some(0), page0), Some(0));
        assert_eq!(assigned.get(Some(0), page1), Some(4));
        assert_eq!(assigned.get(Some(1), page0), Some(5));
        assert_eq!(assigned.get(Some(2), page0), None);
    }

    #[test]
    fn an_old_lightmap_is_replaced_and_other_extensions_stay() {
        let old =
            "{\"name\":\"m\",\"extensions\":{\"X\":{\"a\":1.50},\"MOZ_lightmap\":{\"index\":9}},\"alphaCutoff\":0.50}";
        let new = with_lightmap(old, 3, 1, Quantity::Irradiance).unwrap();
        let expected = "{\"index\": 3, \"texCoord\": 1, \"intensity\": 1}";
        assert_eq!(new, old.replace("{\"index\":9}", expected));
        let bare = with_lightmap("{}", 0, 2, Quantity::Radiosity).unwrap();
        let expected = "{\"index\": 0, \"texCoord\": 2, \"intensity\": 3.141592653589793}";
        assert_eq!(bare, format!("{{\"extensions\": {{\"MOZ_lightmap\": {expected}}}}}"));
    }

    #[test]
    fn uses_of_a_uv_set_are_found_everywhere_but_in_the_lightmap() {
        let uses = |text: &str| reads_uv_set(&Element::root(text).unwrap(), 1);
        assert!(uses("{\"occlusionTexture\":{\"index\":0,\"texCoord\":1}}"));
        assert!(uses("{\"a\":[{\"extensions\":{\"KHR_texture_transform\":{\"texCoord\":1}}}]}"));
        assert!(!uses(
            "{\"occlusionTexture\":{\"index\":1,\"texCoord\":0},\"extensions\":{\"MOZ_lightmap\":{\"texCoord\":1}}}"
        ));
    }
}
