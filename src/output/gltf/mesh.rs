//! Meshes with a lightmap: what of a primitive is shared, what is written anew.
//!
//! A primitive whose vertices stay as they are keeps its accessors and indices and gains `TEXCOORD_n`. One whose
//! vertices were split gets all attributes and morph targets again, element by element, byte for byte in their
//! component type, and its triangles as a list; so does one that was compressed by Draco. Vertices that cuts added are
//! interpolated (`interpolate`). One that lies on several pages becomes one primitive per page, with
//! common attributes. Everything else of it (extras, extensions, material variants) is carried over, but
//! for light of a former bake at its vertices (`former`).
//!
//! Triangles without a chart (no area) stay, on the first page. Two instances that split a primitive alike share what
//! was written for the first.

use super::append::Append;
use super::append::component_size;
use super::former::without_light;
use super::interpolate::extended;
use super::material::Assigned;
use super::material::Use;
use super::plan;
use super::plan::Baked;
use super::plan::Elements;
use super::plan::Instance;
use crate::atlas::Atlas;
use crate::atlas::NO_CHART;
use crate::base::Warning;
use crate::output::Error;
use crate::output::splice::Element;
use crate::output::splice::Fault;
use crate::output::splice::Splice;
use crate::scene::Origin;
use crate::scene::Scene;
use std::collections::BTreeMap;

/// Primitive extensions that stay right when vertices are renumbered.
const RENUMBERING_IS_FINE: [&str; 3] = ["KHR_materials_variants", "EXT_mesh_features", "EXT_structural_metadata"];

/// Writes meshes; collects what they need in `append`.
pub(super) struct Meshes<'a> {
    scene: &'a Scene,
    atlas: &'a Atlas,
    elements: &'a Elements<'a>,
    materials: &'a Assigned,
    pub(super) append: Append,
    /// Lightmap coordinates get 16 bits.
    pub(super) quantize_uv: bool,
    splits: Vec<Split<'a>>,
    /// (mesh, primitive) → its ways of being split.
    splits_of: BTreeMap<(usize, usize), Vec<usize>>,
    /// (split, accessor that was read) → accessor.
    attributes: BTreeMap<(usize, usize), usize>,
    /// Vertex count → accessor of so many zeros.
    zeros: BTreeMap<usize, usize>,
}

/// A way in which a primitive was split or cut into pages.
struct Split<'a> {
    source_vertex: &'a [u32],
    /// Where the vertices come from, if triangles were cut.
    origins: Option<&'a [Origin]>,
    /// Index lists written so far, with their accessors.
    indices: Vec<(Vec<u32>, usize)>,
}

impl Split<'_> {
    fn is(&self, source_vertex: &[u32], origins: Option<&[Origin]>) -> bool {
        self.source_vertex == source_vertex && self.origins == origins
    }
}

impl<'a> Meshes<'a> {
    pub(super) fn new(
        scene: &'a Scene,
        atlas: &'a Atlas,
        elements: &'a Elements<'a>,
        materials: &'a Assigned,
        append: Append,
    ) -> Self {
        let (splits, splits_of, attributes, zeros) = (Vec::new(), BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        Self { scene, atlas, elements, materials, append, quantize_uv: false, splits, splits_of, attributes, zeros }
    }

    /// The mesh of an instance.
    pub(super) fn mesh(&mut self, instance: &Instance<Baked>, warnings: &mut Vec<Warning>) -> Result<String, Error> {
        let text = self.elements.meshes[instance.mesh].text();
        let root = Element::root(text).map_err(|e| self.fault(&e))?;
        let mut splice = Splice::new(text);
        for (i, primitive) in root.array("primitives").iter().enumerate() {
            let place = [instance.mesh, i];
            let baked = instance.baked.get(&i);
            let stays = |name: &str| baked.is_none() && name == "_LIGHTMAP";
            let plain = without_light(primitive.text(), &self.scene.document, place, stays);
            let plain = plain.map_err(|e| self.fault(&e))?;
            let Some(baked) = baked else {
                if plain != primitive.text() {
                    splice.replace(primitive, plain);
                }
                continue;
            };
            if !baked.unsplit {
                self.warn_of_extensions(primitive, baked, warnings);
            }
            splice.replace(primitive, self.primitives(&plain, baked)?.join(", "));
        }
        splice.apply().map_err(|e| self.fault(&e))
    }

    fn fault(&self, fault: &Fault) -> Error {
        Error::invalid(&self.scene.document.path, fault.to_string())
    }

    fn warn_of_extensions(&self, primitive: &Element<'_>, baked: &Baked, warnings: &mut Vec<Warning>) {
        for (name, _) in primitive.get("extensions").map(|e| e.members()).unwrap_or_default() {
            if !RENUMBERING_IS_FINE.contains(&name.as_str()) && name != plan::DRACO {
                let part = &self.scene.parts[baked.part];
                let message = format!(
                    "extension {name} of primitive {} was copied, but vertices had to be renumbered for the lightmap; \
                     vertex indices in it would be wrong",
                    part.primitive
                );
                warnings.push(Warning::new("renumbered-vertices", message).at(part.name.as_str()));
            }
        }
    }

    /// One primitive per page.
    fn primitives(&mut self, text: &str, baked: &Baked) -> Result<Vec<String>, Error> {
        let text = &plan::uncompressed(text).map_err(|e| self.fault(&e))?;
        let root = Element::root(text).map_err(|e| self.fault(&e))?;
        let split = self.split_of(baked);
        let edits = self.vertex_edits(&root, baked, split)?;
        let mut out = Vec::with_capacity(baked.pages.len());
        for &page in &baked.pages {
            let primitive = self.on_page(&root, baked, split, page, &edits);
            out.push(primitive.map_err(|e| self.fault(&e))?);
        }
        Ok(out)
    }

    fn on_page(
        &mut self,
        root: &Element<'_>,
        baked: &Baked,
        split: usize,
        page: u32,
        edits: &VertexEdits<'_>,
    ) -> Result<String, Fault> {
        let mut splice = Splice::new(root.text());
        for (element, accessor) in &edits.replaced {
            splice.replace(element, accessor.to_string());
        }
        for (name, accessor) in &edits.added {
            splice.set_path(root, &["attributes", name], accessor.to_string())?;
        }
        let lightmap = Use { page, set: baked.set };
        self.materials.set(&mut splice, root, lightmap)?;
        if !baked.unsplit || baked.pages.len() > 1 {
            let indices = self.indices(baked, page, split);
            splice.set(root, "indices", indices.to_string())?;
            if root.index_at("mode").is_some_and(|mode| mode != 4) {
                splice.set(root, "mode", "4")?;
            }
        }
        splice.apply()
    }

    /// The attributes and morph targets of a primitive, shared by its pages.
    fn vertex_edits<'e>(&mut self, root: &Element<'e>, baked: &Baked, split: usize) -> Result<VertexEdits<'e>, Error> {
        let charted = &self.atlas.parts[baked.part];
        let count = charted.layout.source_vertex.len();
        let mut edits = VertexEdits { replaced: Vec::new(), added: Vec::new() };
        let lightmap = format!("TEXCOORD_{}", baked.set);
        let attributes = root.get("attributes").map(|a| a.members()).unwrap_or_default();
        if !baked.unsplit {
            for (name, element) in root.array("targets").iter().flat_map(Element::members) {
                let new = self.remapped(&element, element.index(), &name, baked, split)?;
                edits.replaced.push((element, new));
            }
            let (root, part) = (&self.scene.document.root, &self.scene.parts[baked.part]);
            for (name, element) in attributes.iter().filter(|(name, _)| *name != lightmap) {
                let read = root.attribute(part.mesh, part.primitive, name);
                edits.replaced.push((*element, self.remapped(element, read, name, baked, split)?));
            }
        }
        if !attributes.iter().any(|(name, _)| name == "TEXCOORD_0") {
            let append = &mut self.append;
            let zeros = *self.zeros.entry(count).or_insert_with(|| append.zero_uv(count));
            edits.added.push(("TEXCOORD_0".to_owned(), zeros));
        }
        if !baked.keep_uv {
            let uv = self.append.lightmap_uv(charted, self.atlas.page_size, self.quantize_uv);
            edits.added.push((lightmap, uv));
        }
        Ok(edits)
    }

    fn missing(&self, baked: &Baked, attribute: &str) -> Error {
        let part = &self.scene.parts[baked.part];
        let message = format!("{}, primitive {}: no usable accessor for {attribute}", part.name, part.primitive);
        Error::invalid(&self.scene.document.path, message)
    }

    /// The number of the way in which a primitive is split; equal ways have equal numbers.
    fn split_of(&mut self, baked: &Baked) -> usize {
        let part = &self.scene.parts[baked.part];
        let source_vertex = self.atlas.parts[baked.part].layout.source_vertex.as_slice();
        let origins = self.scene.cuts.origins_of(baked.part);
        let known = self.splits_of.entry((part.mesh, part.primitive)).or_default();
        if let Some(&same) = known.iter().find(|&&s| self.splits[s].is(source_vertex, origins)) {
            return same;
        }
        known.push(self.splits.len());
        self.splits.push(Split { source_vertex, origins, indices: Vec::new() });
        self.splits.len() - 1
    }

    /// The accessor that has the elements of `read` in the order of the output vertices; `source` names the accessor whose
    /// further members it gets.
    fn remapped(
        &mut self,
        source: &Element<'_>,
        read: Option<usize>,
        name: &str,
        baked: &Baked,
        split: usize,
    ) -> Result<usize, Error> {
        let read = read.ok_or_else(|| self.missing(baked, name))?;
        if let Some(&done) = self.attributes.get(&(split, read)) {
            return Ok(done);
        }
        let picked = self.splits[split].source_vertex;
        let old = source.index().and_then(|source| self.elements.accessors.get(source));
        let old = old.ok_or_else(|| self.missing(baked, name))?;
        let mut data = self.scene.document.accessor(read)?;
        if let Some(origins) = self.splits[split].origins {
            data = extended(&data, name, origins).ok_or_else(|| self.missing(baked, name))?;
        }
        let complete = data.bytes.len() >= data.count * data.components * component_size(data.component_type);
        if !complete || picked.iter().any(|&v| v as usize >= data.count) {
            return Err(self.missing(baked, name));
        }
        let new = self.append.rewritten(old, name, &data, picked);
        self.attributes.insert((split, read), new);
        Ok(new)
    }

    /// Triangles of one page in the document's winding.
    fn indices(&mut self, baked: &Baked, page: u32, split: usize) -> usize {
        let charted = &self.atlas.parts[baked.part];
        let mirrored = self.scene.parts[baked.part].mirrored;
        let home = |chart: u32| match chart {
            NO_CHART => baked.pages.first() == Some(&page),
            chart => self.atlas.charts[chart as usize].page == page,
        };
        let of_page = charted.layout.triangles.iter().zip(charted.charts()).filter(|(_, chart)| home(*chart));
        let list: Vec<u32> = of_page.flat_map(|(&[a, b, c], _)| if mirrored { [a, c, b] } else { [a, b, c] }).collect();
        if let Some((_, done)) = self.splits[split].indices.iter().find(|(written, _)| *written == list) {
            return *done;
        }
        let new = self.append.indices(&list);
        self.splits[split].indices.push((list, new));
        new
    }
}

/// Changes of a primitive's attributes and targets.
struct VertexEdits<'e> {
    /// Value in the source → accessor.
    replaced: Vec<(Element<'e>, usize)>,
    /// Attribute → accessor.
    added: Vec<(String, usize)>,
}
