//! The input document as read: source text of the JSON, binary chunk, and where it came from.
//!
//! The text is kept so that `output` can splice its additions into it and leave every other byte alone.

use std::path::PathBuf;

/// A glTF or GLB file and its buffers, before interpretation.
#[derive(Debug, Default, Clone)]
pub struct Document {
    /// The file that was read.
    pub path: PathBuf,
    /// It is a GLB container.
    pub glb: bool,
    /// JSON source text, without the padding of a GLB chunk.
    pub json: String,
    /// The GLB's BIN chunk.
    pub bin: Option<Vec<u8>>,
    /// Further GLB chunks as (type, bytes), in file order.
    pub extra_chunks: Vec<(u32, Vec<u8>)>,
    /// Bytes of every buffer, by buffer index.
    pub buffers: Vec<Vec<u8>>,
    /// Every file that was read, the document itself first: buffers, images.
    pub files_read: Vec<PathBuf>,
}

/// The elements of an accessor, tightly packed in their stored component type, sparse substitution applied.
#[derive(Debug, Clone, PartialEq)]
pub struct AccessorData {
    /// Number of elements.
    pub count: usize,
    /// Components per element (1 to 16).
    pub components: usize,
    /// glTF component type (5120 … 5126).
    pub component_type: u32,
    /// Integers stand for [0, 1] or [−1, 1].
    pub normalized: bool,
    /// `count` × `components` little-endian values without padding.
    pub bytes: Vec<u8>,
}
