//! How much memory a scene will take, from numbers that are known before it is taken.
//!
//! In: a document whose buffers are read, or a scene. Out: [`Footprint`], and its bytes at the peak of a bake.
//!
//! The factors are measured peaks of whole bakes (resident set, two threads) with few texels, so they cover what all
//! stages make of triangles and vertices: ray hierarchy, charts, output buffers. They are upper bounds, because what is
//! held at one time depends on the order of the stages and on the allocator.

use super::Document;
use super::EqualParts;
use super::Error;
use super::Part;
use super::Scene;
use crate::base::MemoryLimit;
use crate::base::memory_limit::in_words;

/// Numbers that memory depends on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
pub struct Footprint {
    /// JSON and buffers [bytes].
    pub document_bytes: u64,
    /// Vertices, those that parts share once.
    pub vertices: u64,
    /// Triangles, those that parts share once.
    pub triangles: u64,
    /// Triangles of copies that get light of their own.
    pub lit_copies: u64,
    /// Those of them that have charts of their own: of copies that are equal, the first.
    pub charted_copies: u64,
    /// Triangles that glow; 0 before materials are known.
    pub glowing: u64,
    /// Parts: primitives as placed by nodes.
    pub parts: u64,
    /// Pixels of decoded textures, as they are kept.
    pub texture_pixels: u64,
    /// Pixels of images that are scaled down, as many as threads decode at one time; 0 after loading.
    pub passing_pixels: u64,
}

/// Bytes of memory for each of the numbers above. The document is read into buffers and written.
const PER_DOCUMENT_BYTE: u64 = 2;
const PER_VERTEX: u64 = 120;
const PER_TRIANGLE: u64 = 300;
/// What shadow rays aim at, and the hierarchy over it: a bake with 980,000 of them took 918 MB.
const PER_GLOWING: u64 = 200;
const PER_PART: u64 = 4096;
/// Places and borders of charts, which grow with the texels along borders rather; but those are not known yet. A bake of
/// 5,000 balls of 9,798 triangles in one size, 97,396 texels, took 404 MB.
const PER_LIT_COPY: u64 = 7;
/// Charts of those that are like no other.
const PER_CHARTED_COPY: u64 = 250;
/// More for the first [`FEW`] triangles: freed buffers of that size stay with the allocator. A bake of 1.0 million took
/// 602 MB, of 10.0 million 3.45 GB.
const PER_FIRST_TRIANGLE: u64 = 250;
const FEW: u64 = 1 << 20;
/// Four channels, and what is in the hands of the decoder.
const PER_PIXEL: u64 = 5;
/// Three channels from the decoder, and four twice.
const PER_PASSING_PIXEL: u64 = 11;

impl Footprint {
    /// Of the document alone; `geometry` counts its parts before it places them, `images` textures by their headers.
    pub(super) fn of_document(document: &Document) -> Self {
        Self { document_bytes: document_bytes(document), ..Self::default() }
    }

    /// With the copies that get light.
    pub(super) fn with_lit(self, parts: &[Part], is_copied: impl Fn(usize) -> bool) -> Self {
        let equal = EqualParts::new(parts, |_| false);
        let triangles = |is_counted: &dyn Fn(usize) -> bool| {
            let lit = (0..parts.len()).filter(|&p| parts[p].receives && is_copied(p) && is_counted(p));
            lit.map(|p| parts[p].triangles.len() as u64).sum()
        };
        let charted_copies = triangles(&|p| equal.first[p] as usize == p);
        Self { lit_copies: triangles(&|_| true), charted_copies, ..self }
    }

    /// Of a scene as it is.
    #[must_use]
    pub fn of_scene(scene: &Scene) -> Self {
        let footprint = Self {
            document_bytes: document_bytes(&scene.document),
            vertices: scene.vertices.position.len() as u64,
            triangles: scene.triangles.len() as u64,
            glowing: scene.parts.iter().filter(|p| scene.glows(p)).map(|p| p.triangles.len() as u64).sum(),
            parts: scene.parts.len() as u64,
            texture_pixels: scene.textures.iter().map(|t| t.pixels.len() as u64).sum(),
            ..Self::default()
        };
        footprint.with_lit(&scene.parts, |p| scene.is_copied(p))
    }

    /// Bytes for document and geometry at the peak of a bake.
    #[must_use]
    pub fn geometry_bytes(&self) -> u64 {
        self.document_bytes * PER_DOCUMENT_BYTE
            + self.vertices * PER_VERTEX
            + self.triangles * PER_TRIANGLE
            + self.triangles.min(FEW) * PER_FIRST_TRIANGLE
            + self.glowing * PER_GLOWING
            + self.parts * PER_PART
            + self.lit_copies * PER_LIT_COPY
            + self.charted_copies * PER_CHARTED_COPY
    }

    /// Bytes for decoded textures.
    #[must_use]
    pub fn texture_bytes(&self) -> u64 {
        self.texture_pixels * PER_PIXEL + self.passing_pixels * PER_PASSING_PIXEL
    }

    /// Refuses what needs more than `limit` bytes.
    pub(super) fn admit(&self, limit: Option<MemoryLimit>) -> Result<(), Error> {
        let needed = self.geometry_bytes() + self.texture_bytes();
        match limit {
            Some(limit) if limit.refuses(needed) => Err(Error::memory(format!(
                "loading it needs about {} of memory, more than {limit}: {} for {} vertices and {} triangles, {} for \
                 textures with {} pixels; raise --memory-limit, bake it in several pieces, or scale its textures down",
                in_words(needed),
                in_words(self.geometry_bytes()),
                self.vertices,
                self.triangles,
                in_words(self.texture_bytes()),
                self.texture_pixels
            ))),
            _ => Ok(()),
        }
    }
}

fn document_bytes(document: &Document) -> u64 {
    let buffers: usize = document.buffers.iter().map(Vec::len).sum();
    (document.json.len() + buffers) as u64
}
