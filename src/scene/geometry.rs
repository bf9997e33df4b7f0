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
use super::Treatment;
use super::Vertices;
use super::nodes::Placed;
use super::nodes::Walk;
use super::pose;
use super::pose::Pose;
use super::primitive;
use super::primitive::LocalPrimitive;
use super::primitive::Size;
use crate::base::Warning;
use crate::base::parallel;
use glam::DMat3;
use glam::DMat4;
use glam::DVec3;
use glam::Vec2;
use glam::Vec3;
use glam::Vec4;
use std::collections::BTreeMap;

/// Most vertices, and most triangles, of a scene with all instances. Ids have 32 bits; 2²⁷ vertices already take about
/// 7 GB. A small document can name one mesh from many nodes, so this must be known before memory is taken.
const MAX_ELEMENTS: usize = 1 << 27;

/// Largest coordinate [m]. Beyond it neighbouring floats are a metre apart, and every ray test fails.
const MAX_COORDINATE: f32 = 1e7;

/// Distance from the world's origin [m] from which on a scene is moved there. Nearer, f32 resolves a quarter of a
/// millimetre; and what lies beyond [`MAX_COORDINATE`] stays, to be refused.
const FAR: f64 = 4096.0;

/// All surfaces of a scene.
#[derive(Debug, Default)]
pub(super) struct Geometry {
    pub(super) vertices: Vertices,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) triangle_part: Vec<u32>,
    pub(super) parts: Vec<Part>,
    /// What was taken off all positions [m].
    pub(super) offset: DVec3,
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

/// A part with its vertices in the world, indices from 0.
struct PlacedPart {
    position: Vec<Vec3>,
    normal: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    mirrored: bool,
    scale: f32,
    flat: bool,
    warnings: Vec<Warning>,
}

/// `materials` ends with the default material.
pub(super) fn read(
    document: &Document,
    walk: &mut Walk,
    materials: &[Material],
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
    let offset = offset(&plans, &locals, walk);
    walk.move_by(-offset);
    let joints = document.root.skins.iter().enumerate().map(|(skin, _)| {
        let used = plans.iter().any(|p| document.root.nodes[p.placed.node].skin == Some(skin));
        if used { pose::joints(document, &walk.worlds, skin) } else { Ok(Vec::new()) }
    });
    let joints = joints.collect::<Result<Vec<_>, _>>()?;
    let placed = parallel::map(plans.len(), |i| {
        place(document, &plans[i], &locals[plans[i].source], walk.worlds[plans[i].placed.node], &joints)
    });
    let mut geometry = Geometry { offset, ..Geometry::default() };
    geometry.vertices.uv = vec![Vec::new(); uv_sets.len()];
    for (plan, part) in plans.iter().zip(placed) {
        let mut part = part?;
        warnings.append(&mut part.warnings);
        geometry.push(document, plan, &locals[plan.source], part, materials, warnings);
    }
    Ok(geometry)
}

/// About the middle of what lies far away, in whole metres: the mean of the first vertices of all parts.
fn offset(plans: &[Plan], locals: &[LocalPrimitive], walk: &Walk) -> DVec3 {
    let first = |plan: &Plan| {
        let vertex = locals[plan.source].position.first()?;
        Some(walk.worlds[plan.placed.node].transform_point3(vertex.as_dvec3()))
    };
    let (sum, count) = plans.iter().filter_map(first).fold((DVec3::ZERO, 0.0), |(s, n), p| (s + p, n + 1.0));
    let middle = (sum / f64::max(count, 1.0)).round();
    let size = middle.abs().max_element();
    if size > FAR && size <= f64::from(MAX_COORDINATE) { middle } else { DVec3::ZERO }
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
            if vertices > MAX_ELEMENTS || triangles > MAX_ELEMENTS {
                return Err(Error::unsupported(format!(
                    "with all instances the scene has more than {MAX_ELEMENTS} vertices or triangles (at node {name}); \
                     bake it in several pieces"
                )));
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
    let position: Vec<Vec3> = (local.position.iter().enumerate())
        .map(|(v, p)| pose.matrix(v).transform_point3(p.as_dvec3()).as_vec3())
        .collect();
    if let Some(v) = position.iter().position(|p| !p.is_finite() || p.abs().max_element() > MAX_COORDINATE) {
        let node = root.node_name(plan.placed.node);
        return Err(Error::invalid(format!(
            "{name}, placed by node {node}: vertex {v} is at {}, beyond the limit of {MAX_COORDINATE:e} m",
            position[v]
        )));
    }
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
    let scale = pose.scale();
    Ok(PlacedPart { position, normal, triangles, mirrored, scale, flat: local.normal.is_none(), warnings })
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
            .map(|(v, n)| {
                let n = cofactor(pose.matrix(v)) * n.as_dvec3() * sign;
                // Scaled first: the length of a huge or tiny vector overflows or vanishes when it is squared.
                let n = (n / n.abs().max_element()).normalize_or_zero().as_vec3();
                if n.is_finite() { n } else { Vec3::ZERO }
            })
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

/// det(M) · M⁻ᵀ of the linear part; its columns are cross products of M's.
fn cofactor(m: DMat4) -> DMat3 {
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis].map(|c| c.truncate());
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y))
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
        local: &LocalPrimitive,
        part: PlacedPart,
        materials: &[Material],
        warnings: &mut Vec<Warning>,
    ) {
        let root = &document.root;
        let node = &root.nodes[plan.placed.node];
        let name = root.node_name(plan.placed.node);
        let entry = &root.meshes[plan.mesh].primitives[plan.primitive];
        let material = entry.material.unwrap_or(materials.len() - 1);
        let first_vertex = self.vertices.position.len() as u32;
        let first_triangle = self.triangles.len() as u32;
        let count = part.position.len();
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
            vertices: first_vertex..first_vertex + count as u32,
            triangles: first_triangle..first_triangle + plan.size.triangles as u32,
            material,
            mirrored: part.mirrored,
            scale: part.scale,
            flat: part.flat,
            has_uv1: local.uv.get(1).is_some_and(Option::is_some),
            receives: !(materials[material].unlit || morphed || skinned),
            treatment: Treatment::default(),
        });
        let part_index = self.parts.len() as u32 - 1;
        self.triangles.extend(part.triangles.iter().map(|t| t.map(|v| v + first_vertex)));
        self.triangle_part.resize(self.triangles.len(), part_index);
        self.vertices.position.extend(part.position);
        self.vertices.normal.extend(part.normal);
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
    }
}
