//! glTF or GLB → [`Scene`]: world-space triangles, materials, textures, lights, sky, cameras.
//!
//! After this stage nothing is optional: transforms are applied, triangles wind counter-clockwise seen from their front
//! (also under mirrored transforms), normals and vertex colours exist, units are glTF's photometric ones.
//!
//! Vertex k of a [`Part`] is element k of the accessors of its primitive, so that `output` can copy attributes by
//! index. Vertices behind those come from cuts ([`Cuts`]).
//!
//! [`load()`] is the only entry; the order of its steps is `load.rs`. The reader is our own, see [`schema`] for why.
//! Every number of a document is checked where it is used: a document can be refused, but it cannot cause a panic, an
//! endless loop, or memory use beyond a small multiple of what the files really contain (the exceptions are named and
//! capped: `accessor.rs`, `geometry.rs`, `images.rs`).
//!
//! Codes of warnings: `animated-node`, `bad-alpha-mode`, `bad-camera`, `bad-color`, `bad-extras`, `bad-light`,
//! `bad-light-group`, `bad-normals`, `bad-sampler`, `bad-texcoord`, `byte-order-mark`, `coarse-coordinates`, `dark-emitter`, `deforming-mesh`,
//! `factor-out-of-range`, `ies-tilt`, `incomplete-triangle`, `lod-levels`, `missing-texcoord`, `no-positions`,
//! `no-triangles`, `not-a-root`, `not-triangles`, `trailing-bytes`, `unsupported-extension`, `unused-rule`.

mod accessor;
mod animation;
mod baked_color;
mod basis;
mod cameras;
mod container;
mod copies;
mod dds;
mod document;
mod draco;
mod environment;
mod equal;
mod error;
mod extensions;
mod extras;
mod far;
mod footprint;
mod geometry;
mod group;
pub mod ies;
mod image_light;
mod images;
mod instances;
mod instancing;
mod lamps;
mod levels;
mod light;
mod load;
mod material;
mod means;
mod meshopt;
mod nodes;
mod optics;
mod origin;
mod peaks;
mod picture;
mod pose;
mod primitive;
mod profile;
mod punctual;
mod reduce;
mod relief;
mod rules;
pub mod schema;
mod surface;
mod texture;
mod treat;
mod uri;
mod variants;
mod volume;

pub use accessor::AccessorData;
pub use baked_color::BakedColor;
pub use copies::{Copied, Copies, Placement};
pub use document::Document;
pub use environment::Environment;
pub use equal::EqualParts;
pub use error::{Class, Error};
pub use footprint::Footprint;
pub use group::Groups;
pub use instances::Instances;
pub use light::{Light, Sky};
pub use load::{SHARE_FROM, Settings, load, load_bytes};
pub use material::{Alpha, Material, NormalMap, TextureRef, Translucency};
pub use origin::{Cuts, Origin};
pub use picture::Picture;
pub use profile::Profile;
pub use rules::{Glob, Rule, Treatment};
pub use texture::{Texture, Wrap};
pub use volume::Volume;

use core::ops::Range;
use glam::{DVec3, Mat4, Vec2, Vec3, Vec4};

/// Everything that is baked or stands in the light, in world space.
#[derive(Debug, Default)]
pub struct Scene {
    /// The input as read.
    pub document: Document,
    /// Vertex attributes as stored, indexed by the triangles; ask for them by id where parts may share them.
    pub vertices: Vertices,
    /// Vertex indices of each triangle as stored, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// Index into `parts` for each stored triangle, of the first part that has it.
    pub triangle_part: Vec<u32>,
    /// One entry per (node, primitive), in document order of the node tree walk.
    pub parts: Vec<Part>,
    /// Materials of the document, then one default material that primitives without a material use.
    pub materials: Vec<Material>,
    /// Decoded textures of the document, by texture index.
    pub textures: Vec<Texture>,
    /// Punctual lights in world space.
    pub lights: Vec<Light>,
    /// Index of the node that each of them hangs on.
    pub light_nodes: Vec<usize>,
    /// Which group each light and each part that glows belongs to.
    pub groups: Groups,
    /// Light from infinity in every direction.
    pub sky: Sky,
    /// Further light from infinity, by picture: that of `EXT_lights_image_based`, unless the settings have a sky.
    pub environment: Option<Environment>,
    /// Cameras in world space.
    pub cameras: Vec<Camera>,
    /// Where the origin of all these coordinates lies in the document's world [m]: zero but for scenes that are far from
    /// there, so that f32 keeps what matters.
    pub offset: DVec3,
    /// Which parts share what `vertices` and `triangles` hold; see [`Scene::corners`] and what is beside it.
    pub copies: Copies,
    /// Nodes that show the lightmap of another node, which places the same mesh: (node, the other), ascending.
    pub shown: Vec<(usize, usize)>,
    /// How it differs from the document: triangles that were cut after reading it.
    pub cuts: Cuts,
}

/// Vertex attributes in world space, structure of arrays, all of the same length.
#[derive(Debug, Default)]
pub struct Vertices {
    /// Position [m].
    pub position: Vec<Vec3>,
    /// Unit normal.
    pub normal: Vec<Vec3>,
    /// Linear vertex colour (white where the primitive has none).
    pub color: Vec<Vec4>,
    /// Texture coordinates by set; a set has one entry per vertex (zero where a primitive lacks the set).
    pub uv: Vec<Vec<Vec2>>,
}

/// One primitive as placed by one node.
#[derive(Debug, Clone)]
pub struct Part {
    /// Index of the node in the document.
    pub node: usize,
    /// Index of the mesh in the document.
    pub mesh: usize,
    /// Index of the primitive in the mesh.
    pub primitive: usize,
    /// Name of the node, or `node 7`; for messages.
    pub name: String,
    /// Ids of its vertices.
    pub vertices: Range<u32>,
    /// Ids of its triangles.
    pub triangles: Range<u32>,
    /// Index into `Scene::materials`.
    pub material: usize,
    /// The node's transform mirrors, so the winding of `triangles` is the reverse of the document's.
    pub mirrored: bool,
    /// Cube root of what the node's transform multiplies volumes by.
    pub scale: f32,
    /// Dot products of the axes of the node's transform [m²]: xx, yy, zz, yz, zx, xy. Placements of a mesh that have the
    /// same ones differ by a rigid motion, or a mirror.
    pub axes: [f64; 6],
    /// Shading normals are the triangles' own: the document has none, or none that differ.
    pub flat: bool,
    /// The primitive has a `NORMAL`.
    pub has_normals: bool,
    /// The primitive has a `TEXCOORD_1` (then `Vertices::uv[1]` holds it).
    pub has_uv1: bool,
    /// It gets lightmap texels. False for unlit, skinned and morphed primitives, which still block light, and where a
    /// rule says so.
    pub receives: bool,
    /// What rules and `extras` say.
    pub treatment: Treatment,
}

/// A camera of the document.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Its place among the nodes with a camera, those that cannot be used included.
    pub number: usize,
    /// Name of its node, for messages.
    pub name: String,
    /// Looks along −z, y up.
    pub world_from_camera: Mat4,
    /// Lens.
    pub projection: Projection,
}

/// The lens of a camera.
#[derive(Debug, Clone, Copy)]
pub enum Projection {
    /// Vertical field of view [rad]; aspect = width/height where the document fixes it.
    Perspective {
        /// Vertical field of view [rad].
        yfov: f32,
        /// Width over height; `None` = of the picture.
        aspect: Option<f32>,
    },
    /// Half sizes of the view [m].
    Orthographic {
        /// Half width [m].
        xmag: f32,
        /// Half height [m].
        ymag: f32,
    },
}
