//! Decompresses buffer views of `EXT_meshopt_compression` and `KHR_meshopt_compression`.
//!
//! In: a [`Document`] with its buffers. Out: every compressed view of its typed data shows a buffer with the decompressed
//! bytes; the JSON text still has the compressed ones, so `output` keeps what it does not touch as it was.
//!
//! Source: the extensions' specifications (modes, filters, allowed strides); the codecs are those of the crate `draco-io`,
//! which checks every read.
//!
//! Limit: a view may become at most [`MOST_GROWTH`] times as large as its compressed bytes.

use super::Document;
use super::Error;
use super::schema::optional;
use super::schema::required;
use crate::base::parallel;
use draco_io::MeshoptFilter;
use draco_io::MeshoptMode;
use draco_io::meshopt::decode_buffer_view;
use serde::Deserialize;

/// Decompressed over compressed size. A block of 256 equal vertices of 4 bytes takes one byte of the codec's version 1;
/// nothing takes less.
const MOST_GROWTH: usize = 1024;

/// `EXT_meshopt_compression`, or the same as `KHR_meshopt_compression`.
#[derive(Debug, Clone, Deserialize)]
pub struct Meshopt<T> {
    #[serde(rename = "EXT_meshopt_compression")]
    ext: Option<T>,
    #[serde(rename = "KHR_meshopt_compression")]
    khr: Option<T>,
}

// By hand: a derived one would ask for T: Default.
impl<T> Default for Meshopt<T> {
    fn default() -> Self {
        Self { ext: None, khr: None }
    }
}

impl<T> Meshopt<T> {
    fn get(&self) -> Option<&T> {
        self.khr.as_ref().or(self.ext.as_ref())
    }
}

/// Where the bytes of a compressed view are, and how.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct CompressedView {
    #[serde(deserialize_with = "optional")]
    buffer: Option<usize>,
    #[serde(deserialize_with = "required")]
    byte_offset: usize,
    #[serde(deserialize_with = "required")]
    byte_length: usize,
    #[serde(deserialize_with = "required")]
    byte_stride: usize,
    #[serde(deserialize_with = "required")]
    count: usize,
    mode: String,
    filter: Option<String>,
}

/// What the extension says of a buffer.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct Fallback {
    fallback: bool,
}

impl Meshopt<Fallback> {
    /// The buffer stands for what is decompressed; nothing has to be read.
    #[must_use]
    pub fn is_fallback(&self) -> bool {
        self.get().is_some_and(|f| f.fallback)
    }
}

impl Document {
    /// Marks buffers without bytes of which every view is compressed as placeholders: not all files that have some say so.
    pub(super) fn mark_placeholders(&mut self) {
        // By buffer: whether it has a compressed view, and whether it has a plain one.
        let mut views = vec![[false; 2]; self.root.buffers.len()];
        for view in &self.root.buffer_views {
            if let Some(of) = view.buffer.and_then(|buffer| views.get_mut(buffer)) {
                of[usize::from(view.extensions.get().is_none())] = true;
            }
        }
        let has_chunk = self.bin.is_some();
        for (index, buffer) in self.root.buffers.iter_mut().enumerate() {
            let empty = buffer.uri.is_none() && (index > 0 || !has_chunk);
            if empty && views[index] == [true, false] {
                buffer.extensions.khr = Some(Fallback { fallback: true });
            }
        }
    }
}

impl Document {
    /// Decompresses all views.
    pub(super) fn decompress_views(&mut self) -> Result<(), Error> {
        let compressed: Vec<(usize, CompressedView)> = (self.root.buffer_views.iter().enumerate())
            .filter_map(|(i, view)| Some((i, view.extensions.get()?.clone())))
            .collect();
        let decompressed = parallel::map(compressed.len(), |k| {
            let (view, how) = &compressed[k];
            self.decompressed(*view, how).map_err(|e| e.within(&format!("buffer view {view}")))
        });
        for ((view, _), bytes) in compressed.into_iter().zip(decompressed) {
            let buffer = self.add_buffer(bytes?);
            let view = &mut self.root.buffer_views[view];
            (view.buffer, view.byte_offset) = (Some(buffer), 0);
        }
        Ok(())
    }

    fn decompressed(&self, view: usize, how: &CompressedView) -> Result<Vec<u8>, Error> {
        let length = self.root.buffer_views[view].byte_length;
        if how.count.checked_mul(how.byte_stride) != Some(length) {
            let CompressedView { count, byte_stride, .. } = how;
            return Err(Error::invalid(format!(
                "{count} compressed elements of {byte_stride} bytes do not make its {length} bytes"
            )));
        }
        let buffer = how.buffer.and_then(|b| self.buffers.get(b));
        let buffer =
            buffer.ok_or_else(|| Error::invalid("its compressed bytes are in a buffer that does not exist"))?;
        let end = how.byte_offset.checked_add(how.byte_length);
        let source = end.and_then(|end| buffer.get(how.byte_offset..end));
        let source = source.ok_or_else(|| Error::invalid("its compressed bytes reach beyond their buffer"))?;
        if length / MOST_GROWTH > source.len() {
            let have = source.len();
            return Err(Error::invalid(format!("{have} compressed bytes cannot hold {length} bytes")));
        }
        let fault = |e: draco_io::GltfError| Error::invalid(e.to_string());
        let mode = MeshoptMode::from_name(&how.mode).map_err(fault)?;
        let filter = MeshoptFilter::from_name(how.filter.as_deref().unwrap_or("NONE")).map_err(fault)?;
        let mut bytes = vec![0; length];
        if how.count > 0 {
            decode_buffer_view(&mut bytes, source, mode, filter, how.count, how.byte_stride).map_err(fault)?;
        }
        Ok(bytes)
    }
}
