//! Which node gets which lightmapped mesh.
//!
//! In: scene, atlas and the document's elements. Out: one [`Instance`] per node that has light on it.
//!
//! A primitive is baked if a chart lies on one of its triangles. Its lightmap is on `TEXCOORD_1`, unless textures of
//! its material read a `TEXCOORD_1` that would have to change; then it is on the next free set. The first instance of a
//! mesh takes the mesh's place if every node that uses the mesh is baked; all other instances go behind the existing
//! meshes. Nodes that show the lightmap of another node get the mesh of that one.

use super::material::Use;
use super::material::Users;
use super::material::reads_uv_set;
use crate::atlas::Atlas;
use crate::atlas::ChartedPart;
use crate::atlas::NO_CHART;
use crate::base::Warning;
use crate::output::Error;
use crate::output::splice::Element;
use crate::output::splice::Fault;
use crate::output::splice::Splice;
use crate::output::splice::quoted;
use crate::scene::Scene;
use glam::Vec2;
use std::collections::BTreeMap;
use std::collections::BTreeSet;

/// How far [texels] an existing `TEXCOORD_1` may be from the wanted place to be used as it is: well below what a
/// bilinear look-up shows at half precision.
const SAME_PLACE: f32 = 1.0 / 256.0;

pub(super) const DRACO: &str = "KHR_draco_mesh_compression";

/// A node with light on it; `B` says what a primitive carries.
pub(super) struct Instance<B> {
    pub(super) node: usize,
    pub(super) mesh: usize,
    /// Primitive of the mesh → what is baked on it.
    pub(super) baked: BTreeMap<usize, B>,
    /// It replaces the source mesh.
    pub(super) in_place: bool,
    /// Further nodes that show the same.
    pub(super) also: Vec<usize>,
}

/// A primitive with light on it.
pub(super) struct Baked {
    /// Index into the scene's and the atlas's parts.
    pub(super) part: usize,
    /// Pages that its triangles lie on, in order.
    pub(super) pages: Vec<u32>,
    /// n of its lightmap's `TEXCOORD_n`.
    pub(super) set: usize,
    /// The `TEXCOORD_n` that is there already is right.
    pub(super) keep_uv: bool,
    /// Output vertices equal source vertices, and accessors hold them.
    pub(super) unsplit: bool,
}

impl Baked {
    /// What its materials are used with.
    pub(super) fn uses(&self) -> Vec<Option<Use>> {
        self.pages.iter().map(|&page| Some(Use { page, set: self.set })).collect()
    }
}

/// The elements of a document that a plan looks at.
pub(super) struct Elements<'a> {
    pub(super) nodes: Vec<Element<'a>>,
    pub(super) materials: Vec<Element<'a>>,
    pub(super) accessors: Vec<Element<'a>>,
    pub(super) meshes: Vec<Element<'a>>,
    /// By mesh.
    pub(super) primitives: Vec<Vec<Element<'a>>>,
}

impl<'a> Elements<'a> {
    pub(super) fn new(root: &Element<'a>) -> Self {
        let meshes = root.array("meshes");
        Self {
            nodes: root.array("nodes"),
            materials: root.array("materials"),
            accessors: root.array("accessors"),
            primitives: meshes.iter().map(|m| m.array("primitives")).collect(),
            meshes,
        }
    }
}

/// All instances with a lightmap, in the order in which the scene has their nodes.
pub(super) fn lightmapped(
    scene: &Scene,
    atlas: &Atlas,
    elements: &Elements<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Instance<Baked>>, Error> {
    let fail = |message: String| Error::invalid(&scene.document.path, message);
    if atlas.parts.len() != scene.parts.len() {
        return Err(fail(format!("{} parts, but {} are charted", scene.parts.len(), atlas.parts.len())));
    }
    let mut all = Vec::new();
    for (p, (part, charted)) in scene.parts.iter().zip(&atlas.parts).enumerate() {
        check(charted, atlas).map_err(|why| fail(format!("{}, primitive {}: {why}", part.name, part.primitive)))?;
        let pages: BTreeSet<u32> =
            charted.charts().filter(|&c| c != NO_CHART).map(|c| atlas.charts[c as usize].page).collect();
        if pages.is_empty() || !part.receives {
            continue;
        }
        let primitive = primitive(scene, elements, p)?;
        let baked = baked(scene, atlas, elements, p, primitive, pages.into_iter().collect());
        if baked.set != 1 {
            let message = format!(
                "primitive {} has textures on TEXCOORD_1, so its lightmap is on TEXCOORD_{}, which few viewers read",
                part.primitive, baked.set
            );
            warnings.push(Warning::new("lightmap-uv-set", message).at(part.name.as_str()));
        }
        all.push((p, baked));
    }
    instances(scene, elements, all)
}

/// The primitive of a part.
fn primitive<'e, 'a>(scene: &Scene, elements: &'e Elements<'a>, part: usize) -> Result<&'e Element<'a>, Error> {
    let part = &scene.parts[part];
    let primitive = elements.primitives.get(part.mesh).and_then(|all| all.get(part.primitive));
    primitive.filter(|_| part.node < elements.nodes.len()).ok_or_else(|| {
        let message = format!("{} refers to a mesh or node that the document lacks", part.name);
        Error::invalid(&scene.document.path, message)
    })
}

/// Parts with what is baked on them, sorted into instances in the order of their nodes in `parts`.
pub(super) fn instances<B>(
    scene: &Scene,
    elements: &Elements<'_>,
    parts: Vec<(usize, B)>,
) -> Result<Vec<Instance<B>>, Error> {
    let mut all: Vec<Instance<B>> = Vec::new();
    let mut by_node: BTreeMap<usize, usize> = BTreeMap::new();
    let mut shown: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    scene.shown.iter().for_each(|&(node, other)| shown.entry(other).or_default().push(node));
    for (p, baked) in parts {
        primitive(scene, elements, p)?;
        let part = &scene.parts[p];
        let at = *by_node.entry(part.node).or_insert(all.len());
        if at == all.len() {
            let also = shown.remove(&part.node).unwrap_or_default();
            all.push(Instance { node: part.node, mesh: part.mesh, baked: BTreeMap::new(), in_place: false, also });
        }
        if all[at].mesh != part.mesh || all[at].baked.insert(part.primitive, baked).is_some() {
            let message = format!("{}: one node places a primitive twice, which glTF cannot express", part.name);
            return Err(Error::invalid(&scene.document.path, message));
        }
    }
    let mut unbaked_meshes: BTreeSet<usize> = BTreeSet::new();
    let shows: BTreeSet<usize> = all.iter().flat_map(|i| i.also.iter().copied()).collect();
    for (n, node) in elements.nodes.iter().enumerate() {
        if !by_node.contains_key(&n) && !shows.contains(&n) {
            unbaked_meshes.extend(node.index_at("mesh"));
        }
    }
    let mut replaced = BTreeSet::new();
    for instance in &mut all {
        instance.in_place = !unbaked_meshes.contains(&instance.mesh) && replaced.insert(instance.mesh);
    }
    Ok(all)
}

fn check(charted: &ChartedPart, atlas: &Atlas) -> Result<(), &'static str> {
    let layout = &charted.layout;
    let vertices = layout.source_vertex.len();
    if layout.uv.len() != vertices || layout.chart.len() != layout.triangles.len() {
        return Err("its charts are incomplete");
    }
    if layout.triangles.iter().flatten().any(|&v| v as usize >= vertices) {
        return Err("a charted triangle uses a vertex that does not exist");
    }
    let page_exists = |c: u32| c == NO_CHART || atlas.charts.get(c as usize).is_some_and(|c| c.page < atlas.pages);
    if !charted.charts().all(page_exists) {
        return Err("a triangle lies on a chart or page that does not exist");
    }
    if !charted.uvs().all(|uv| uv.is_finite()) {
        return Err("a lightmap coordinate is not finite");
    }
    Ok(())
}

fn baked(
    scene: &Scene,
    atlas: &Atlas,
    elements: &Elements<'_>,
    part: usize,
    primitive: &Element<'_>,
    pages: Vec<u32>,
) -> Baked {
    let charted = &atlas.parts[part];
    let attributes = primitive.get("attributes");
    let accessor = |name: &str| attributes.and_then(|a| a.index_at(name));
    let count = accessor("POSITION").and_then(|a| elements.accessors.get(a)).and_then(|a| a.index_at("count"));
    let identity = charted.layout.source_vertex.iter().enumerate().all(|(i, &v)| i == v as usize);
    let unsplit = identity && count == Some(charted.layout.source_vertex.len()) && !is_compressed(primitive);
    let keep_uv = unsplit && charted.kept && accessor("TEXCOORD_1").is_some() && in_place(scene, atlas, part);
    let read_by_textures = || {
        let materials =
            materials_of(primitive).into_iter().flatten().filter_map(|m| elements.materials.get(m).copied());
        materials.chain(primitive.get("extensions")).any(|e| reads_uv_set(&e, 1))
    };
    let mut set = 1;
    if !keep_uv && accessor("TEXCOORD_1").is_some() && read_by_textures() {
        while accessor(&format!("TEXCOORD_{set}")).is_some() {
            set += 1;
        }
    }
    Baked { part, pages, set, keep_uv, unsplit }
}

/// The values of a primitive are in the bytes of Draco.
pub(super) fn is_compressed(primitive: &Element<'_>) -> bool {
    primitive.find(&["extensions", DRACO]).is_some()
}

/// A primitive without its compressed bytes: the vertices that are written for it are not theirs.
pub(super) fn uncompressed(primitive: &str) -> Result<String, Fault> {
    without_extension(primitive, DRACO)
}

/// Members as the text of an object.
pub(super) fn object(members: &[(String, Element<'_>)]) -> String {
    let member = |(name, value): &(String, Element<'_>)| format!("{}: {}", quoted(name), value.text());
    format!("{{{}}}", members.iter().map(member).collect::<Vec<_>>().join(", "))
}

/// An object without one of its `extensions`.
pub(super) fn without_extension(owner: &str, extension: &str) -> Result<String, Fault> {
    let root = Element::root(owner)?;
    if root.find(&["extensions", extension]).is_none() {
        return Ok(owner.to_owned());
    }
    let mut others = root.get("extensions").map(|e| e.members()).unwrap_or_default();
    others.retain(|(name, _)| name != extension);
    let mut members = root.members();
    if others.is_empty() {
        members.retain(|(name, _)| name != "extensions");
        return Ok(object(&members));
    }
    let mut splice = Splice::new(owner);
    splice.set(&root, "extensions", object(&others))?;
    splice.apply()
}

/// The part's own `TEXCOORD_1` is where the atlas wants it.
fn in_place(scene: &Scene, atlas: &Atlas, part: usize) -> bool {
    let charted = &atlas.parts[part];
    let range = &scene.parts[part].vertices;
    let size = Vec2::new(atlas.page_size[0] as f32, atlas.page_size[1] as f32);
    let own: Option<Vec<Vec2>> = range.clone().map(|v| scene.vertex_uv(1, v)).collect();
    let Some(own) = own.filter(|own| own.len() == charted.layout.uv.len()) else { return false };
    let charts = charted.layout.triangles.iter().zip(charted.charts());
    let corners = charts.filter(|(_, c)| *c != NO_CHART).flat_map(|(t, _)| t);
    corners.copied().all(|v| (own[v as usize] * size - charted.uv(v)).abs().max_element() <= SAME_PLACE)
}

/// The primitive's material, then those of its variants.
pub(super) fn materials_of(primitive: &Element<'_>) -> Vec<Option<usize>> {
    let mappings = primitive.find(&["extensions", "KHR_materials_variants"]).map(|v| v.array("mappings"));
    let variants = mappings.unwrap_or_default().into_iter().filter_map(|m| m.index_at("material")).map(Some);
    core::iter::once(primitive.index_at("material")).chain(variants).collect()
}

/// Every use of a material in the output; `uses` are those of a baked primitive.
pub(super) fn material_users<B>(
    instances: &[Instance<B>],
    elements: &Elements<'_>,
    uses: impl Fn(&B) -> Vec<Option<Use>>,
) -> Users {
    let mut users = Users::default();
    let replaced: BTreeSet<usize> = instances.iter().filter(|i| i.in_place).map(|i| i.mesh).collect();
    for (mesh, primitives) in elements.primitives.iter().enumerate() {
        if !replaced.contains(&mesh) {
            primitives.iter().flat_map(materials_of).for_each(|m| users.add(m, None));
        }
    }
    for instance in instances {
        for (i, primitive) in elements.primitives[instance.mesh].iter().enumerate() {
            let own = instance.baked.get(&i).map_or_else(|| vec![None], &uses);
            for material in materials_of(primitive) {
                own.iter().for_each(|&lightmap| users.add(material, lightmap));
            }
        }
    }
    users
}
