//! The geometry layer: a prim per node, a mesh per primitive, the document's materials.
//!
//! Points, normals and texture coordinates are those of the document's vertices in their order, unless triangles were
//! cut: then those of the new vertices follow. Faces are the document's triangles in their order, wound so that the
//! front is counter-clockwise in world space. `customData` on node and mesh says what they were in the glTF.

use super::Bake;
use super::images::Images;
use super::material;
use super::paths::MATERIALS;
use super::text::Text;
use super::text::number;
use super::text::string;
use super::text::tuple;
use super::texture_sets;
use super::varname;
use crate::vertices::Origin;
use core::ops::{Add, Mul};
use glam::DVec3;
use glam::Vec3;

/// The layer.
pub(super) fn layer(bake: &Bake<'_>, images: &Images) -> Vec<u8> {
    let mut text = Text::layer(&bake.metadata("geometry and materials of a glTF"));
    text.prim("def Xform \"World\"", &[], |text| {
        let [x, y, z] = bake.scene.offset.to_array();
        if bake.scene.offset != DVec3::ZERO {
            text.line(format!("double3 xformOp:translate = ({x}, {y}, {z})"));
            text.line("uniform token[] xformOpOrder = [\"xformOp:translate\"]");
        }
        text.prim(&format!("def Scope \"{MATERIALS}\""), &[], |text| {
            for m in 0..bake.scene.materials.len() {
                if bake.scene.parts.iter().any(|part| part.material == m) {
                    material::write(bake, images, text, m);
                }
            }
        });
        for (node, parts) in &bake.paths.nodes {
            let name = &bake.scene.parts[parts[0]].name;
            let data =
                format!("customData = {{ dictionary gltf = {{ int node = {node}; string name = {} }} }}", string(name));
            text.prim(&format!("def Xform \"{}\"", bake.paths.node(*node)), &[data], |text| {
                parts.iter().for_each(|&p| mesh(bake, text, p));
            });
        }
    });
    text.into_bytes()
}

fn mesh(bake: &Bake<'_>, text: &mut Text, p: usize) {
    let part = &bake.scene.parts[p];
    let metadata = [
        "prepend apiSchemas = [\"MaterialBindingAPI\"]".to_owned(),
        format!(
            "customData = {{ dictionary gltf = {{ int mesh = {}; int primitive = {} }} }}",
            part.mesh, part.primitive
        ),
    ];
    let shape = Shape::new(bake, p);
    text.prim(&format!("def Mesh \"{}\"", bake.paths.mesh(part)), &metadata, |text| {
        let material = &bake.scene.materials[part.material];
        let points = shape.attribute(|v| bake.scene.vertex_position(v));
        let low = points.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = points.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        text.line(format!("uniform bool doubleSided = {}", u8::from(material.double_sided)));
        text.line(format!("float3[] extent = [{}, {}]", tuple(&low.to_array()), tuple(&high.to_array())));
        text.list("int[] faceVertexCounts", shape.triangles.iter().map(|_| "3".to_owned()), "");
        text.list("int[] faceVertexIndices", shape.triangles.iter().flatten().map(u32::to_string), "");
        text.line(format!("rel material:binding = </World/{MATERIALS}/{}>", bake.paths.material(part.material)));
        if part.has_normals {
            let normals = shape.attribute(|v| bake.scene.vertex_normal(v)).into_iter().map(Vec3::normalize_or_zero);
            text.list("normal3f[] normals", normals.map(|n| tuple(&n.to_array())), "interpolation = \"vertex\"");
        }
        text.list("point3f[] points", points.iter().map(|v| tuple(&v.to_array())), "");
        primvars(bake, text, p, &shape);
        text.line("uniform token subdivisionScheme = \"none\"");
    });
}

/// Vertex colours, and the texture coordinates that there are or that the material reads.
fn primvars(bake: &Bake<'_>, text: &mut Text, p: usize, shape: &Shape<'_>) {
    let vertices = &bake.scene.vertices;
    let part = &bake.scene.parts[p];
    let primitive = &bake.scene.document.root.meshes[part.mesh].primitives[part.primitive];
    const PER_VERTEX: &str = "interpolation = \"vertex\"";
    if primitive.attributes.contains_key("COLOR_0") {
        let colors = shape.attribute(|v| bake.scene.vertex_color(v));
        let color = colors.iter().map(|c| tuple(&c.truncate().to_array()));
        text.list("color3f[] primvars:displayColor", color, PER_VERTEX);
        if colors.iter().any(|c| c.w != 1.0) {
            text.list("float[] primvars:displayOpacity", colors.iter().map(|c| number(c.w)), PER_VERTEX);
        }
    }
    let read = texture_sets(&bake.scene.materials[part.material]);
    for (set, uv) in vertices.uv.iter().enumerate() {
        let own = set == 0 && primitive.attributes.contains_key("TEXCOORD_0");
        if uv.len() == vertices.position.len() && (own || read.contains(&set)) {
            let upwards = shape
                .attribute(|v| bake.scene.vertex_uv(set, v).unwrap_or_default())
                .into_iter()
                .map(|uv| tuple(&[uv.x, 1.0 - uv.y]));
            text.list(&format!("texCoord2f[] primvars:{}", varname(set)), upwards, PER_VERTEX);
        }
    }
}

/// Vertices and triangles of a part.
pub(super) struct Shape<'a> {
    /// Of the part's first vertex in the scene.
    first: u32,
    count: u32,
    /// Where the vertices come from, if there are more than the document has.
    origins: Option<&'a [Origin]>,
    /// Vertices of the part.
    pub(super) triangles: Vec<[u32; 3]>,
}

impl<'a> Shape<'a> {
    pub(super) fn new(bake: &'a Bake<'_>, p: usize) -> Self {
        let part = &bake.scene.parts[p];
        let first = part.vertices.start;
        let count = part.vertices.end - first;
        if let Some(cut) = bake.lit_vertices(p).filter(|lit| lit.refined) {
            return Self { first, count, origins: Some(&cut.origins), triangles: cut.triangles.clone() };
        }
        Self { first, count, origins: None, triangles: bake.scene.part_triangles(part).collect() }
    }

    /// What the vertices of the part have, by what those of the scene have.
    pub(super) fn attribute<T>(&self, value: impl Fn(u32) -> T) -> Vec<T>
    where
        T: Copy + Add<Output = T> + Mul<f32, Output = T>,
    {
        let Some(origins) = self.origins else {
            return (self.first..self.first + self.count).map(value).collect();
        };
        let at = |o: &Origin, k: usize| value(self.first + o.source[k]);
        let blend = |o: &Origin| at(o, 0) * o.weight[0] + at(o, 1) * o.weight[1] + at(o, 2) * o.weight[2];
        origins.iter().map(|o| if o.is_source() { at(o, 0) } else { blend(o) }).collect()
    }
}
