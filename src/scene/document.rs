//! The input document as read: source text of the JSON, binary chunk, buffers, and where it came from.
//!
//! The text is kept so that `output` can splice its additions into it and leave every other byte alone.
//!
//! Invariant: `buffers` has one entry per buffer of the document, of exactly its `byteLength`, all of it really read:
//! no allocation trusts a number of the document. Buffers that only stand for what is compressed are empty. Behind them
//! are buffers with what was decompressed (`meshopt`, `draco`), to which views of `root` were turned. Likewise `root` may
//! have accessors behind those of the text: ask it, not the text, which of them hold a primitive's values.

use super::BakedColor;
use super::Error;
use super::container;
use super::schema::Root;
use super::uri;
use super::uri::Resource;
use crate::base::Warning;
use std::io;
use std::path::Path;
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
    /// The parts of `json` that a bake reads, as typed data.
    pub root: Root,
    /// The GLB's BIN chunk.
    pub bin: Option<Vec<u8>>,
    /// Further GLB chunks as (type, bytes), in file order.
    pub extra_chunks: Vec<(u32, Vec<u8>)>,
    /// Bytes of every buffer, by buffer index, then what was decompressed.
    pub buffers: Vec<Vec<u8>>,
    /// Every file that was read, the document itself first: buffers, images.
    pub files_read: Vec<PathBuf>,
    /// Light that a former bake put into vertex colours, which `root` then may not name.
    pub baked_color: Option<BakedColor>,
}

impl Document {
    /// Reads container and JSON; the buffers are still missing.
    pub(super) fn parse(bytes: Vec<u8>, path: &Path, warnings: &mut Vec<Warning>) -> Result<Self, Error> {
        let container = container::split(bytes, warnings)?;
        let root: Root = serde_json::from_str(&container.json)
            .map_err(|e| Error::invalid(format!("the JSON is not valid glTF: {e}")))?;
        check_version(&root)?;
        Ok(Self {
            path: path.to_path_buf(),
            glb: container.glb,
            json: container.json,
            root,
            bin: container.bin,
            extra_chunks: container.extra_chunks,
            buffers: Vec::new(),
            files_read: vec![path.to_path_buf()],
            baked_color: None,
        })
    }

    /// Reads every buffer.
    pub(super) fn load_buffers(&mut self) -> Result<(), Error> {
        self.mark_placeholders();
        for index in 0..self.root.buffers.len() {
            let length = self.root.buffers[index].byte_length;
            let context = format!("buffer {index}");
            if self.root.buffers[index].extensions.is_fallback() {
                self.buffers.push(Vec::new());
                continue;
            }
            let mut bytes = match &self.root.buffers[index].uri {
                Some(uri) => {
                    let uri = uri.clone();
                    self.resource(&uri, &context, length)?
                }
                None => match (&self.bin, index) {
                    (Some(bin), 0) => bin[..bin.len().min(length)].to_vec(),
                    _ => return Err(Error::invalid(format!("{context} has neither a URI nor a GLB BIN chunk"))),
                },
            };
            if bytes.len() < length {
                let have = bytes.len();
                return Err(Error::invalid(format!("{context} should have {length} bytes but has {have}; truncated?")));
            }
            bytes.truncate(length);
            self.buffers.push(bytes);
        }
        Ok(())
    }

    /// The bytes behind a URI, at most `limit` of them; notes the file in `files_read`.
    pub(super) fn resource(&mut self, text: &str, context: &str, limit: usize) -> Result<Vec<u8>, Error> {
        let (bytes, file) = self.find(text, context, limit)?;
        self.note(file);
        Ok(bytes)
    }

    /// Notes a file in `files_read`.
    pub(super) fn note(&mut self, file: Option<PathBuf>) {
        if let Some(path) = file.filter(|path| !self.files_read.contains(path)) {
            self.files_read.push(path);
        }
    }

    /// The bytes behind a URI, at most `limit` of them, and the file that they are from.
    pub(super) fn find(&self, text: &str, context: &str, limit: usize) -> Result<(Vec<u8>, Option<PathBuf>), Error> {
        let resource = uri::resolve(text).map_err(|why| Error::invalid(format!("{context}: its URI {why}")))?;
        let files = match resource {
            Resource::Data(bytes) => return Ok((bytes, None)),
            Resource::Files(files) => files,
        };
        match uri::read(self.path.parent().unwrap_or(Path::new("")), &files, limit) {
            Ok((path, bytes)) => Ok((bytes, Some(path))),
            Err((path, e)) if e.kind() == io::ErrorKind::NotFound => {
                Err(Error::invalid(format!("{context}: its file {} does not exist", path.display())))
            }
            Err((path, e)) => Err(Error::io(path, io::Error::new(e.kind(), format!("{e} ({context})")))),
        }
    }

    /// The bytes of a buffer view.
    ///
    /// # Errors
    /// The view does not exist or reaches beyond its buffer.
    pub fn buffer_view(&self, index: usize) -> Result<&[u8], Error> {
        self.view_bytes(index).map_err(|e| e.in_file(&self.path))
    }

    fn view_bytes(&self, index: usize) -> Result<&[u8], Error> {
        let Some(view) = self.root.buffer_views.get(index) else {
            let have = self.root.buffer_views.len();
            return Err(Error::invalid(format!("buffer view {index} does not exist, there are {have}")));
        };
        let buffer = view.buffer.unwrap_or(usize::MAX);
        let Some(bytes) = self.buffers.get(buffer) else {
            return Err(Error::invalid(format!("buffer view {index} refers to a buffer that does not exist")));
        };
        let (start, length) = (view.byte_offset, view.byte_length);
        start.checked_add(length).and_then(|end| bytes.get(start..end)).ok_or_else(|| {
            let have = bytes.len();
            Error::invalid(format!(
                "buffer view {index} ({length} bytes at offset {start}) reaches beyond buffer {buffer} of {have} bytes"
            ))
        })
    }

    /// Adds bytes that were decompressed; the index of their buffer.
    pub(super) fn add_buffer(&mut self, bytes: Vec<u8>) -> usize {
        self.buffers.push(bytes);
        self.buffers.len() - 1
    }
}

fn check_version(root: &Root) -> Result<(), Error> {
    let Some(asset) = &root.asset else {
        return Err(Error::invalid("the JSON has no `asset`, so it is not glTF 2.0"));
    };
    let newest_needed = asset.min_version.as_deref().unwrap_or(&asset.version);
    match (asset.version.split('.').next(), newest_needed) {
        (Some("2"), "2.0") => Ok(()),
        // Minor versions are backwards compatible unless minVersion says otherwise (glTF 2.0, section 3.2).
        (Some("2"), _) if asset.min_version.is_none() => Ok(()),
        _ => Err(Error::unsupported(format!(
            "glTF version {newest_needed:?}; only 2.0 can be read, convert the file first"
        ))),
    }
}
