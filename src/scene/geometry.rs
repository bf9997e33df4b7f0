//! Places every primitive of the scene in the world: [`Part`]s, vertices and triangles.
//!
//! In: document, resolved node tree, materials. Out: [`Geometry`], in document order of the node tree.
//!
//! * Triangles wind counter-clockwise seen from the front; under a mirroring transform corners 1 and 2 are swapped.
//! * Normals are transformed by the cofactor matrix, which is det · (inverse transpose) and stays right where a scale
//!   is zero; its sign is corrected under mirroring. Normals that are missing, zero or not finite become the average of
//!   the triangles around, weighted by area.
//! * A scene that is far from the world's origin is moved there, lights, cameras and joints with it (the [`Walk`]).
//! * Sizes are added up before anything is allocated, see [`MAX_ELEMENTS`].

use super::Document;
use super::Error;
use super::Material;
use super::Part;
use super::Settings;
use super::Treatment;
use super::Vertices;
use super::copies;
use super::copies::Copies;
use super::copies::Placement;
use super::far;
use super::footprint::Footprint;
use super::load::SHARE_FROM;
use super::nodes::Placed;
use super::nodes::Walk;
use super::pose;
use super::pose::Pose;
use super::primitive;
use super::primitive::LocalPrimitive;
use super::primitive::Size;
use crate::base::Warning;
use crate::base::parallel;
use glam::DMat4;
use glam::DVec3;
use glam::Vec2;
use glam::Vec3;
use glam::Vec4;
use std::collections::BTreeMap;

/// Most vertices, and most triangles, that are stored or get light, with all instances; 2²⁷ vertices already take about
/// 7 GB. A small document can name one mesh from many nodes, so this must be known before memory is taken.
const MAX_ELEMENTS: usize = 1 << 27;
/// The same with copies, of which only transforms are stored: ids have 32 bits, some of them for flags.
const MAX_IDS: usize = 1 << 28;

/// Largest coordinate [m]. Beyond it neighbouring floats are a metre apart, and every ray test fails.
const MAX_COORDINATE: f32 = 1e7;

/// Triangles from which on a primitive is worth a hierarchy of its own.
const LEAST_SHARED: usize = 32;

/// All surfaces of a scene.
#[derive(Debug, Default)]
pub(super) struct Geometry {
    pub(super) vertices: Vertices,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) triangle_part: Vec<u32>,
    pub(super) parts: Vec<Part>,
    /// What was taken off all positions [m].
    pub(super) offset: DVec3,
    /// Which parts share what is stored.
    pub(super) copies: Copies,
}

/// Indices of a mesh and of a primitive in it.
type MeshPrimitive = (usize, usize);

/// A part before its vertices are placed.
struct Plan {
    placed: Placed,
    mesh: usize,
    primitive: usize,
    size: Size,
    /// Index into the decoded primitives.
    source: usize,
}

/// What is known of the primitives that are placed more than once.
struct Sharing<'a> {
    /// The primitives.
    locals: &'a [LocalPrimitive],
    /// By decoded primitive: its copies share what is stored for the first of them.
    shared: Vec<bool>,
    /// Its first triangle and vertex as stored, once they are.
    stored: Vec<Option<[u32; 2]>>,
}

/// Distance of unit normals that differ by rounding alone.
const SAME_NORMAL: f64 = 1e-5;

/// A part on its way into the scene.
enum Placing {
    Stored(PlacedPart),
    Copied { placement: Placement, scale: f32, flat: bool },
}

/// A part with its vertices in the world, indices from 0.
struct PlacedPart {
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    mirrored: bool,
    scale: f32,
    /// See [`Part::axes`].
    axes: [f64; 6],
    flat: bool,
    warnings: Vec<Warning>,
}

/// `materials` ends with the default material.
pub(super) fn read(
    document: &Document,
    walk: &mut Walk,
    materials: &[Material],
    settings: &Settings,
    footprint: &mut Footprint,
    warnings: &mut Vec<Warning>,
) -> Result<Geometry, Error> {
    let (plans, sources) = plan(document, walk, materials.len() - 1, warnings)?;
    let uv_sets = uv_sets(document, &plans, materials);
    let decoded = parallel::map(sources.len(), |i| primitive::read(document, sources[i].0, sources[i].1, &uv_sets));
    let mut locals = Vec::with_capacity(decoded.len());
    for local in decoded {
        let mut local = local?;
        warnings.append(&mut local.warnings);
        locals.push(local);
    }
    let placed = plans.iter().map(|plan| (plan.source, walk.worlds[plan.placed.node]));
    let offset = far::offset(placed, &locals, MAX_COORDINATE);
    walk.move_by(-offset);
    let joints = document.root.skins.iter().enumerate().map(|(skin, _)| {
        let used = plans.iter().any(|p| document.root.nodes[p.placed.node].skin == Some(skin));
        if used { pose::joints(document, &walk.worlds, skin) } else { Ok(Vec::new()) }
    });
    let joints = joints.collect::<Result<Vec<_>, _>>()?;
    let mut sharing = Sharing::new(document, &plans, &locals, settings.share_from.unwrap_or(SHARE_FROM));
    let is_copied = |plan: &Plan| sharing.shared[plan.source] && copies::is_shareable(walk.worlds[plan.placed.node]);
    let counted = plans.iter().filter(|plan| !is_copied(plan)).map(|plan| (plan.placed.node, plan.size));
    check_counts(counted, |node| document.root.node_name(node), "stores")?;
    let stored = plans.iter().filter(|plan| !is_copied(plan)).map(|plan| plan.size);
    let shared = (0..locals.len()).filter(|&i| sharing.shared[i]).map(|i| locals[i].size());
    for size in stored.chain(shared) {
        footprint.vertices += size.vertices as u64;
        footprint.triangles += size.triangles as u64;
    }
    footprint.parts = plans.len() as u64;
    footprint.admit(settings.memory_limit)?;
    let placed = parallel::map(plans.len(), |i| {
        let (source, world) = (plans[i].source, walk.worlds[plans[i].placed.node]);
        if is_copied(&plans[i]) {
            return copied(document, &plans[i], offset, &locals[source], world);
        }
        place(document, &plans[i], offset, &locals[source], world, &joints).map(Placing::Stored)
    });
    let mut geometry = Geometry { offset, ..Geometry::default() };
    geometry.vertices.uv = vec![Vec::new(); uv_sets.len()];
    for (plan, part) in plans.iter().zip(placed) {
        geometry.push(document, plan, part?, &mut sharing, materials, warnings);
    }
    Ok(geometry)
}

impl<'a> Sharing<'a> {
    /// Shares where that leaves out `share_from` triangles or more in all.
    fn new(document: &Document, plans: &[Plan], locals: &'a [LocalPrimitive], share_from: usize) -> Self {
        let root = &document.root;
        let mut copies = vec![0usize; locals.len()];
        for plan in plans {
            let rigid = root.nodes[plan.placed.node].skin.is_none()
                && root.meshes[plan.mesh].primitives[plan.primitive].targets.is_empty();
            copies[plan.source] += usize::from(rigid);
        }
        let is_whole = |n: &Vec3| n.is_finite() && *n != Vec3::ZERO;
        let fits = |local: &LocalPrimitive| {
            local.triangles.len() >= LEAST_SHARED && local.normal.as_ref().is_none_or(|all| all.iter().all(is_whole))
        };
        let mut shared: Vec<bool> = copies.iter().zip(locals).map(|(&n, local)| n > 1 && fits(local)).collect();
        let saved = (0..locals.len()).filter(|&i| shared[i]).map(|i| (copies[i] - 1) * locals[i].triangles.len());
        if saved.sum::<usize>() < share_from {
            shared.fill(false);
        }
        Self { locals, shared, stored: vec![None; locals.len()] }
    }
}

/// A part of which only the transform is kept.
fn copied(
    document: &Document,
    plan: &Plan,
    offset: DVec3,
    local: &LocalPrimitive,
    world: DMat4,
) -> Result<Placing, Error> {
    let placement = Placement::new(world);
    check_range(document, plan, offset, local.position.iter().map(|p| world.transform_point3(p.as_dvec3())))?;
    Ok(Placing::Copied { placement, scale: Pose::Rigid(world).scale(), flat: local.normal.is_none() })
}

/// Refuses what would take too much memory: vertices and triangles by node.
fn check_counts(
    counted: impl Iterator<Item = (usize, Size)>,
    name: impl Fn(usize) -> String,
    does: &str,
) -> Result<(), Error> {
    let (mut vertices, mut triangles) = (0usize, 0usize);
    for (node, size) in counted {
        (vertices, triangles) = (vertices + size.vertices, triangles + size.triangles);
        if vertices > MAX_ELEMENTS || triangles > MAX_ELEMENTS {
            return Err(too_many(MAX_ELEMENTS, does, &name(node)));
        }
    }
    Ok(())
}

/// Refuses a scene of which too much is to get a lightmap: that is not shared among copies.
pub(super) fn check_lit(parts: &[Part]) -> Result<(), Error> {
    let size = |p: &Part| Size { vertices: p.vertices.len(), triangles: p.triangles.len() };
    let lit = parts.iter().enumerate().filter(|(_, p)| p.receives).map(|(i, p)| (i, size(p)));
    check_counts(lit, |i| parts[i].name.clone(), "lights")
}

fn too_many(most: usize, does: &str, node: &str) -> Error {
    Error::unsupported(format!(
        "with all instances the scene {does} more than {most} vertices or triangles (at node {node}); bake it in several \
         pieces"
    ))
}

/// All vertices of a part lie where rays can be traced. Judged where the document has them, since how far a scene is
/// moved depends on how it is divided into primitives, and a bake may divide it anew.
fn check_range(
    document: &Document,
    plan: &Plan,
    offset: DVec3,
    positions: impl Iterator<Item = DVec3>,
) -> Result<(), Error> {
    let is_inside = |p: &DVec3| p.is_finite() && p.abs().max_element() <= f64::from(MAX_COORDINATE);
    let mut outside = positions.map(|p| p + offset).enumerate().filter(|(_, p)| !is_inside(p));
    let Some((v, position)) = outside.next() else { return Ok(()) };
    let (position, name) = (position.as_vec3(), document.root.primitive_name(plan.mesh, plan.primitive));
    let node = document.root.node_name(plan.placed.node);
    Err(Error::invalid(format!(
        "{name}, placed by node {node}: vertex {v} is at {position}, beyond the limit of {MAX_COORDINATE:e} m"
    )))
}

/// The parts and the distinct primitives behind them, with all sizes checked.
fn plan(
    document: &Document,
    walk: &Walk,
    materials: usize,
    warnings: &mut Vec<Warning>,
) -> Result<(Vec<Plan>, Vec<MeshPrimitive>), Error> {
    let root = &document.root;
    let mut plans = Vec::new();
    let mut sources = Vec::new();
    let mut surveyed: BTreeMap<MeshPrimitive, Option<(Size, usize)>> = BTreeMap::new();
    let (mut vertices, mut triangles) = (0usize, 0usize);
    for placed in walk.placed.iter().filter(|p| p.visible) {
        let Some(mesh) = root.nodes[placed.node].mesh else { continue };
        let name = root.node_name(placed.node);
        let Some(entry) = root.meshes.get(mesh) else {
            return Err(Error::invalid(format!("node {name}: mesh {mesh} does not exist")));
        };
        for primitive in 0..entry.primitives.len() {
            let known = match surveyed.get(&(mesh, primitive)) {
                Some(known) => *known,
                None => {
                    let size = primitive::survey(document, mesh, primitive, warnings)?;
                    let known = size.map(|size| (size, sources.len()));
                    if known.is_some() {
                        sources.push((mesh, primitive));
                    }
                    surveyed.insert((mesh, primitive), known);
                    known
                }
            };
            let Some((size, source)) = known else { continue };
            if let Some(material) = entry.primitives[primitive].material.filter(|&m| m >= materials) {
                let place = root.primitive_name(mesh, primitive);
                return Err(Error::invalid(format!("{place}: material {material} does not exist")));
            }
            vertices = vertices.saturating_add(size.vertices);
            triangles = triangles.saturating_add(size.triangles);
            if vertices > MAX_IDS || triangles > MAX_IDS {
                return Err(too_many(MAX_IDS, "has", &name));
            }
            plans.push(Plan { placed: *placed, mesh, primitive, size, source });
        }
    }
    Ok((plans, sources))
}

/// Which texture coordinate sets to read: 0 and 1 always, others where a material in use asks for them.
fn uv_sets(document: &Document, plans: &[Plan], materials: &[Material]) -> Vec<bool> {
    let mut sets = vec![true; 2];
    for plan in plans {
        let entry = &document.root.meshes[plan.mesh].primitives[plan.primitive];
        let material = &materials[entry.material.unwrap_or(materials.len() - 1)];
        for set in material.uv_sets() {
            if sets.len() <= set {
                sets.resize(set + 1, false);
            }
            sets[set] = true;
        }
    }
    sets
}

fn place(
    document: &Document,
    plan: &Plan,
    offset: DVec3,
    source: &LocalPrimitive,
    world: DMat4,
    joints: &[Vec<DMat4>],
) -> Result<PlacedPart, Error> {
    let root = &document.root;
    let name = root.primitive_name(plan.mesh, plan.primitive);
    let entry = &root.meshes[plan.mesh].primitives[plan.primitive];
    let reader = primitive::Reader { document, entry, name: &name };
    let mut local = LocalPrimitive {
        position: source.position.clone(),
        normal: source.normal.clone(),
        ..LocalPrimitive::default()
    };
    if !entry.targets.is_empty() {
        pose::morph(&reader, &pose::weights(document, plan.placed.node, plan.mesh), &mut local)?;
    }
    let skin = match root.nodes[plan.placed.node].skin {
        None => None,
        Some(skin) => {
            let joints = joints.get(skin).ok_or_else(|| Error::invalid(format!("skin {skin} does not exist")))?;
            pose::skinned(&reader, joints, local.position.len())?
        }
    };
    let pose = skin.map_or(Pose::Rigid(world), Pose::Skinned);
    let at = |(v, p): (usize, &Vec3)| pose.matrix(v).transform_point3(p.as_dvec3());
    check_range(document, plan, offset, local.position.iter().enumerate().map(at))?;
    let position: Vec<Vec3> = local.position.iter().enumerate().map(at).map(|p| p.as_vec3()).collect();
    let mirrored = pose.mirrors();
    let mut triangles = source.triangles.clone();
    if mirrored {
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    let mut warnings = Vec::new();
    let normal = normals(&local, &pose, mirrored, &position, &triangles, |bad| {
        if root.nodes[plan.placed.node].instance > 0 {
            return; // One warning for all instances.
        }
        let what = format!("{name}: {bad} normals are zero or not finite; those of the triangles around were used");
        warnings.push(Warning::new("bad-normals", what).at(root.node_name(plan.placed.node)));
    });
    let (scale, axes) = (pose.scale(), copies::axes(world));
    let flat = local.normal.is_none() || are_faceted(&position, &normal, &triangles);
    Ok(PlacedPart { position, normal, triangles, mirrored, scale, axes, flat, warnings })
}

/// Unit normals in the world; `report` hears how many had to be replaced.
fn normals(
    local: &LocalPrimitive,
    pose: &Pose,
    mirrored: bool,
    position: &[Vec3],
    triangles: &[[u32; 3]],
    report: impl FnOnce(usize),
) -> Vec<Vec3> {
    let sign = if mirrored { -1.0 } else { 1.0 };
    let mut bad = 0;
    let mut normal = match &local.normal {
        None => vec![Vec3::ZERO; position.len()],
        Some(stored) => (stored.iter().enumerate())
            .map(|(v, n)| copies::unit(copies::cofactor(pose.matrix(v)) * sign * n.as_dvec3()))
            .collect(),
    };
    if normal.contains(&Vec3::ZERO) {
        let around = averages(position, triangles);
        for (n, instead) in normal.iter_mut().zip(around).filter(|(n, _)| **n == Vec3::ZERO) {
            *n = instead;
            bad += 1;
        }
    }
    if bad > 0 && local.normal.is_some() {
        report(bad);
    }
    normal
}

/// All normals are those of the triangles at which they are, but for rounding.
fn are_faceted(position: &[Vec3], normal: &[Vec3], triangles: &[[u32; 3]]) -> bool {
    triangles.iter().all(|t| {
        let [a, b, c] = t.map(|v| position[v as usize].as_dvec3());
        let own = (b - a).cross(c - a).try_normalize();
        own.is_none_or(|own| t.iter().all(|&v| normal[v as usize].as_dvec3().distance(own) < SAME_NORMAL))
    })
}

/// Area-weighted average normal of the triangles around each vertex; +y where there is none.
fn averages(position: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut sums = vec![DVec3::ZERO; position.len()];
    for t in triangles {
        let [a, b, c] = t.map(|v| position[v as usize].as_dvec3());
        let n = (b - a).cross(c - a);
        t.iter().for_each(|&v| sums[v as usize] += n);
    }
    sums.into_iter().map(|n| n.try_normalize().unwrap_or(DVec3::Y).as_vec3()).collect()
}

impl Geometry {
    fn push(
        &mut self,
        document: &Document,
        plan: &Plan,
        placing: Placing,
        sharing: &mut Sharing<'_>,
        materials: &[Material],
        warnings: &mut Vec<Warning>,
    ) {
        let (root, local) = (&document.root, &sharing.locals[plan.source]);
        let node = &root.nodes[plan.placed.node];
        let name = root.node_name(plan.placed.node);
        let entry = &root.meshes[plan.mesh].primitives[plan.primitive];
        let material = entry.material.unwrap_or(materials.len() - 1);
        let [first_triangle, first_vertex] = self.parts.last().map_or([0, 0], |p| [p.triangles.end, p.vertices.end]);
        let (triangles, vertices) = (plan.size.triangles, local.position.len());
        let (mirrored, scale, axes, flat) = match &placing {
            Placing::Stored(part) => (part.mirrored, part.scale, part.axes, part.flat),
            Placing::Copied { placement, scale, flat } => {
                (placement.mirrored, *scale, copies::axes(placement.world), *flat)
            }
        };
        let morphed = !entry.targets.is_empty();
        let skinned = node.skin.is_some();
        let first_instance = node.instance == 0;
        for texture in materials[material].textures().filter(|_| first_instance) {
            if local.uv.get(texture.uv_set).is_none_or(Option::is_none) {
                let what = format!(
                    "{}: its material {} uses TEXCOORD_{}, which it lacks; 0 was used",
                    root.primitive_name(plan.mesh, plan.primitive),
                    materials[material].name,
                    texture.uv_set
                );
                warnings.push(Warning::new("missing-texcoord", what).at(&name));
            }
        }
        self.parts.push(Part {
            node: plan.placed.node,
            mesh: plan.mesh,
            primitive: plan.primitive,
            name,
            vertices: copies::ids(first_vertex, vertices),
            triangles: copies::ids(first_triangle, triangles),
            material,
            mirrored,
            scale,
            axes,
            flat,
            has_normals: local.normal.is_some(),
            has_uv1: local.uv.get(1).is_some_and(Option::is_some),
            receives: !(materials[material].unlit || morphed || skinned),
            treatment: Treatment::default(),
        });
        let (stored, placement) = match placing {
            Placing::Stored(mut part) => {
                warnings.append(&mut part.warnings);
                (self.store(local, part.position, part.normal, &part.triangles), None)
            }
            Placing::Copied { placement, .. } => {
                let known = sharing.stored[plan.source];
                let stored = known.unwrap_or_else(|| {
                    let average = || averages(&local.position, &local.triangles);
                    let normal = local.normal.clone().unwrap_or_else(average);
                    self.store(local, local.position.clone(), normal, &local.triangles)
                });
                sharing.stored[plan.source] = Some(stored);
                (stored, Some(placement))
            }
        };
        if sharing.shared.contains(&true) {
            self.copies.push([triangles as u32, vertices as u32], stored, placement);
        }
    }

    /// Appends triangles and vertices; where they begin.
    fn store(
        &mut self,
        local: &LocalPrimitive,
        position: Vec<Vec3>,
        normal: Vec<Vec3>,
        triangles: &[[u32; 3]],
    ) -> [u32; 2] {
        let [first_triangle, first_vertex] = [self.triangles.len() as u32, self.vertices.position.len() as u32];
        let part_index = self.parts.len() as u32 - 1;
        self.triangles.extend(triangles.iter().map(|t| t.map(|v| v + first_vertex)));
        self.triangle_part.resize(self.triangles.len(), part_index);
        self.vertices.position.extend(position);
        self.vertices.normal.extend(normal);
        let end = self.vertices.position.len();
        match &local.color {
            Some(color) => self.vertices.color.extend(color),
            None => self.vertices.color.resize(end, Vec4::ONE),
        }
        for (set, uv) in self.vertices.uv.iter_mut().enumerate() {
            match local.uv.get(set) {
                Some(Some(values)) => uv.extend(values),
                _ => uv.resize(end, Vec2::ZERO),
            }
        }
        [first_triangle, first_vertex]
    }
}
