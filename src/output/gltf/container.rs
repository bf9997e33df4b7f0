//! Where the bytes of the output go: GLB with its BIN chunk, or `.gltf` with files beside it.
//!
//! | input → output | old bytes | new bytes |
//! |---|---|---|
//! | GLB → GLB | stay in the BIN chunk | appended to it (buffer 0 grows) |
//! | glTF → GLB | buffer 0 becomes the BIN chunk, other files stay where they are | appended to the BIN chunk |
//! | glTF → glTF | stay where they are | a new buffer `<stem>.lightmap.bin` |
//! | GLB → glTF | the BIN chunk becomes `<stem>.bin` | a new buffer `<stem>.lightmap.bin` |
//!
//! Files that stay, and pages of former bakes that do, are referred to from the output's folder. A GLB whose buffer 0 exists
//! nowhere (a placeholder for compressed data) keeps it, and new bytes go to `<stem>.lightmap.bin`.
//!
//! Source: glTF 2.0, section 4.4 (GLB layout), section 3.6.1.2 (the GLB-stored buffer is the first).

use super::append::Append;
use super::former::Former;
use crate::base::Warning;
use crate::output::Contents;
use crate::output::Error;
use crate::output::Files;
use crate::output::names::beside;
use crate::output::names::parent;
use crate::output::names::rebased;
use crate::output::names::relative_uri;
use crate::output::names::uri_prefix;
use crate::output::splice::Element;
use crate::output::splice::Fault;
use crate::output::splice::Splice;
use crate::output::splice::quoted;
use crate::scene::Document;
use std::path::Path;

/// What the plan for the bytes needs to know.
pub(super) struct Container<'a> {
    document: &'a Document,
    output: &'a Path,
    glb: bool,
    buffers: Vec<Element<'a>>,
}

/// The BIN chunk's old content and the files beside the document.
#[derive(Default)]
pub(super) struct Bytes {
    bin: Option<Contents>,
    files: Files,
}

impl<'a> Container<'a> {
    pub(super) fn new(document: &'a Document, root: &Element<'a>, output: &'a Path) -> Self {
        let glb = output.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb"));
        Self { document, output, glb, buffers: root.array("buffers") }
    }

    /// The document's buffer 0 has bytes that a BIN chunk can hold.
    fn first_buffer(&self) -> Option<&'a [u8]> {
        let first = self.buffers.first()?;
        if self.document.root.buffers.first()?.extensions.is_fallback() {
            return None; // Its bytes, if there are any, were not read.
        }
        let stored = first.get("uri").is_some() || self.document.bin.is_some();
        let bytes = self.document.buffers.first().map(Vec::as_slice);
        let bytes = if first.get("uri").is_none() { self.document.bin.as_deref().or(bytes) } else { bytes };
        bytes.filter(|_| stored)
    }

    /// Splices buffers, views and accessors into the document, rebases URIs, and says which bytes go where.
    pub(super) fn place(
        &self,
        splice: &mut Splice<'a>,
        root: &Element<'a>,
        append: Append,
        former: &Former,
        warnings: &mut Vec<Warning>,
    ) -> Result<Bytes, Error> {
        let mut bytes = Bytes::default();
        let moved_into_bin = self.glb.then(|| self.first_buffer()).flatten();
        let moved_into_bin = moved_into_bin.map(|old| &old[..former.leftover.bin.unwrap_or(old.len()).min(old.len())]);
        let fault = |e: Fault| Error::invalid(&self.document.path, e.to_string());
        let appended = if self.glb && (self.buffers.is_empty() || moved_into_bin.is_some()) {
            let old = moved_into_bin.map_or(0, <[u8]>::len);
            let appended = append.finish(0, old.next_multiple_of(4));
            let mut bin = Contents::from(moved_into_bin.map(<[u8]>::to_vec).unwrap_or_default());
            bin.pad(old.next_multiple_of(4));
            bin.append(appended.bytes.clone());
            let length = if appended.bytes.is_empty() { old } else { bin.len() };
            let stored = |first: &Element<'_>| first.index_at("byteLength");
            match self.buffers.first() {
                Some(first) if first.get("uri").is_some() => splice.replace(first, stored_buffer(first, None, length)),
                Some(first) if length > old || stored(first).is_some_and(|stored| length < stored) => {
                    splice.set(first, "byteLength", length.to_string()).map_err(fault)?;
                }
                Some(_) => {}
                None if length > 0 => {
                    splice.append_at(root, "buffers", vec![format!("{{\"byteLength\": {length}}}")]).map_err(fault)?;
                }
                None => {}
            }
            bytes.bin = (length > 0).then_some(bin);
            appended
        } else {
            self.unpack_bin(splice, &mut bytes, former)?;
            let appended = append.finish(former.leftover.buffers, 0);
            if !appended.bytes.is_empty() {
                let file = beside(self.output, "lightmap.bin");
                let uri = relative_uri(parent(self.output), &file)?;
                let buffer = format!("{{\"uri\": {}, \"byteLength\": {}}}", quoted(&uri), appended.bytes.len());
                splice.append_at(root, "buffers", vec![buffer]).map_err(fault)?;
                bytes.files.push((file, appended.bytes.clone()));
            }
            appended
        };
        splice.append_at(root, "bufferViews", appended.views).map_err(fault)?;
        splice.append_at(root, "accessors", appended.accessors).map_err(fault)?;
        let skipped = usize::from(moved_into_bin.is_some());
        self.rebase(splice, at(self.buffers.iter().take(former.leftover.buffers).skip(skipped), "uri"))?;
        self.rebase(splice, at(root.array("images").iter().take(former.images), "uri"))?;
        let (textures, scenes) = (root.array("textures"), root.array("scenes"));
        let scenes = scenes.iter().enumerate().filter(|(i, _)| !former.scenes.contains(i)).map(|(_, scene)| scene);
        let pages = textures.iter().take(former.textures).chain(scenes);
        self.rebase(
            splice,
            pages.filter_map(|e| e.find(&["extras", "lightmap"])).flat_map(|m| page_uris(&m)).collect(),
        )?;
        let lights = |name: &str| root.find(&["extensions", name]).map(|e| e.array("lights")).unwrap_or_default();
        self.rebase(splice, at(lights("EXT_lights_ies").iter(), "uri"))?;
        let wishes = lights("KHR_lights_punctual").into_iter().filter_map(|l| l.find(&["extras", "texelwalk"]));
        self.rebase(splice, at(wishes.collect::<Vec<_>>().iter(), "ies"))?;
        if !self.glb && !self.document.extra_chunks.is_empty() {
            let message = "GLB chunks other than JSON and BIN cannot be kept in a .gltf file; they were dropped";
            warnings.push(Warning::new("glb-chunk-dropped", message));
        }
        Ok(bytes)
    }

    /// GLB → glTF: the BIN chunk becomes a file.
    fn unpack_bin(&self, splice: &mut Splice<'a>, bytes: &mut Bytes, former: &Former) -> Result<(), Error> {
        let (Some(first), Some(bin)) = (self.buffers.first(), &self.document.bin) else { return Ok(()) };
        if self.glb || first.get("uri").is_some() {
            return Ok(());
        }
        let length = first.index_at("byteLength").unwrap_or(bin.len()).min(bin.len());
        let length = former.leftover.bin.unwrap_or(length).min(length);
        let file = beside(self.output, "bin");
        let uri = relative_uri(parent(self.output), &file)?;
        splice.replace(first, stored_buffer(first, Some(&uri), length));
        bytes.files.push((file, bin[..length].to_vec().into()));
        Ok(())
    }

    /// Turns what leads from the input's folder to files so that it leads there from the output's.
    fn rebase(&self, splice: &mut Splice<'a>, uris: Vec<Element<'a>>) -> Result<(), Error> {
        let prefix = uri_prefix(parent(self.output), parent(&self.document.path))?;
        for uri in uris {
            let old = uri.string().unwrap_or_default();
            let new = rebased(&old, &prefix);
            if new != old {
                splice.replace(&uri, quoted(&new));
            }
        }
        Ok(())
    }

    /// The finished files from the spliced JSON.
    pub(super) fn assemble(&self, json: String, bytes: Bytes) -> Result<Files, Error> {
        let mut files = bytes.files;
        let document = if self.glb { self.glb(json, bytes.bin)? } else { json.into_bytes().into() };
        files.push((self.output.to_path_buf(), document));
        Ok(files)
    }

    /// Its first piece has all up to the end of the JSON chunk.
    fn glb(&self, json: String, bin: Option<Contents>) -> Result<Contents, Error> {
        let mut chunks = vec![(0x4E4F_534A, Contents::from(json.into_bytes()))];
        chunks.extend(bin.map(|bin| (0x004E_4942, bin)));
        chunks.extend(self.document.extra_chunks.iter().map(|(kind, data)| (*kind, data.clone().into())));
        for (i, (_, data)) in chunks.iter_mut().enumerate() {
            let missing = data.len().next_multiple_of(4) - data.len();
            data.extend(&[if i == 0 { b' ' } else { 0 }; 3][..missing]);
        }
        let total = 12 + chunks.iter().map(|(_, data)| 8 + data.len()).sum::<usize>();
        let mut out = Contents::from([b"glTF\x02\0\0\0".as_slice(), &self.length(total)?].concat());
        for (i, (kind, data)) in chunks.into_iter().enumerate() {
            out.extend(&self.length(data.len())?);
            out.extend(&u32::to_le_bytes(kind));
            if i == 0 { out.extend(&data.to_vec()) } else { out.append(data) }
        }
        Ok(out)
    }

    fn length(&self, bytes: usize) -> Result<[u8; 4], Error> {
        let length = u32::try_from(bytes).map_err(|_| {
            Error::invalid(self.output, "would be larger than the 4 GiB that a GLB can have; write a .gltf instead")
        })?;
        Ok(length.to_le_bytes())
    }
}

/// What elements have at `key`.
fn at<'e, 'a: 'e>(elements: impl Iterator<Item = &'e Element<'a>>, key: &str) -> Vec<Element<'a>> {
    elements.filter_map(|e| e.get(key)).collect()
}

/// All URIs in the `extras.lightmap` of a texture or scene that a former bake wrote.
fn page_uris<'a>(manifest: &Element<'a>) -> Vec<Element<'a>> {
    let mut found = vec![];
    for page in core::iter::once(*manifest).chain(manifest.array("pages")) {
        found.extend(at(core::iter::once(&page).chain(&page.array("files")), "uri"));
        let directional = page.get("directional").map(|d| d.members()).unwrap_or_default();
        found.extend(directional.into_iter().filter(|(key, _)| key != "mode" && key != "decode").map(|(_, uri)| uri));
    }
    found
}

/// A buffer object with another place and length, its other members kept.
fn stored_buffer(buffer: &Element<'_>, uri: Option<&str>, length: usize) -> String {
    let mut members: Vec<String> = uri.map(|uri| format!("\"uri\": {}", quoted(uri))).into_iter().collect();
    members.push(format!("\"byteLength\": {length}"));
    for (key, value) in buffer.members() {
        if key != "uri" && key != "byteLength" {
            members.push(format!("{}: {}", quoted(&key), value.text()));
        }
    }
    format!("{{{}}}", members.join(", "))
}
