//! `COLOR_0` that holds light which a former bake put there (`--vertex-attribute color0` or `both`).
//!
//! In: a document whose scenes say so in `extras.lightmap.color`, as `output` writes it. Out: nothing that reads vertex
//! colours sees the light. Where the manifest says `white`, no vertex had a colour before: the attributes leave
//! `Document::root`, and [`BakedColor`] keeps where they are. Else the colours that were there are lost, and the values
//! are light times colour: they count as white with their alpha, which is right for who shows the light, and
//! [`Scene::own_colors`] tells who needs the colours.
//!
//! Limits: a document of several scenes counts as one that had colours if one scene's manifest lacks `white`. Then a colour
//! that a primitive without light has of its own is taken for light.

use super::Document;
use super::Error;
use super::Scene;
use crate::base::splice::Element;
use std::collections::BTreeMap;

const COLOR: &str = "COLOR_0";

/// Where the light is, and what it is worth.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BakedColor {
    /// Light that 1 stands for [cd/m²].
    pub scale: f32,
    /// No vertex had a colour before.
    pub white: bool,
    /// Accessor by mesh and primitive.
    pub accessors: BTreeMap<(usize, usize), usize>,
}

impl Document {
    /// Takes light out of the vertex colours; `scene` is the one whose scale counts, if there are several.
    pub(super) fn set_baked_colors_aside(&mut self, scene: Option<usize>) -> Result<(), Error> {
        if !self.json.contains("\"lightmap\"") {
            return Ok(());
        }
        let root = Element::root(&self.json).map_err(|e| Error::invalid(e.to_string()))?;
        let named = |scene: &Element<'_>| {
            let color = scene.find(&["extras", "lightmap", "color"])?;
            color.get("attribute").and_then(|a| a.string()).filter(|a| a == COLOR)?;
            let scale: f32 = color.get("scale").and_then(|s| s.text().parse().ok())?;
            Some((scale, color.get("white").is_some_and(|w| w.text() == "true")))
        };
        let manifests: Vec<_> = root.array("scenes").iter().map(named).collect();
        let shown = scene.or(self.root.scene).unwrap_or(0);
        let own = manifests.get(shown).copied().flatten().or_else(|| manifests.iter().flatten().next().copied());
        let Some((scale, _)) = own else { return Ok(()) };
        let white = manifests.iter().flatten().all(|(_, white)| *white);
        let mut accessors = BTreeMap::new();
        for (m, mesh) in self.root.meshes.iter_mut().enumerate() {
            for (p, primitive) in mesh.primitives.iter_mut().enumerate() {
                let read = &mut primitive.attributes;
                let accessor = if white { read.remove(COLOR) } else { read.get(COLOR).copied() };
                accessors.extend(accessor.map(|accessor| ((m, p), accessor)));
            }
        }
        self.baked_color = Some(BakedColor { scale, white, accessors });
        Ok(())
    }

    /// The colours of a primitive are light times what is not known any more.
    pub(super) fn has_lost_colors(&self, mesh: usize, primitive: usize) -> bool {
        self.baked_color.as_ref().is_some_and(|c| !c.white && c.accessors.contains_key(&(mesh, primitive)))
    }
}

impl Scene {
    /// Checks that all vertex colours are known, as whoever lights the scene anew must.
    ///
    /// # Errors
    /// If a former bake put light into some, and there were colours before.
    pub fn own_colors(&self) -> Result<(), Error> {
        let lost = self.parts.iter().find(|part| self.document.has_lost_colors(part.mesh, part.primitive));
        let Some(part) = lost else { return Ok(()) };
        let what = format!(
            "{}, primitive {}: COLOR_0 holds light that was baked into it, and what colours were there before is not \
             known; bake from the source instead of what a bake wrote",
            part.name, part.primitive
        );
        Err(Error::unsupported(what).in_file(&self.document.path))
    }
}
