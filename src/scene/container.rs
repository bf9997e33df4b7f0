//! Splits the bytes of a file into JSON text and binary chunks (glTF 2.0, section 4: GLB), and bounds the text.
//!
//! In: bytes. Out: [`Container`]. Stricter than the specification nowhere; more tolerant in three places, each with a
//! warning or without effect: a byte order mark, bytes after the declared end, zero bytes as padding of the JSON chunk.

use super::Error;
use crate::base::Warning;

const MAGIC: &[u8; 4] = b"glTF";
const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

/// Nesting of the JSON text above which it is refused. Real documents stay below 20; parsers that build a tree of
/// values recurse once per level, and `serde_json` stops them at 127.
const MAX_DEPTH: usize = 100;

/// A file taken apart.
#[derive(Debug)]
pub(super) struct Container {
    pub(super) glb: bool,
    pub(super) json: String,
    pub(super) bin: Option<Vec<u8>>,
    pub(super) extra_chunks: Vec<(u32, Vec<u8>)>,
}

pub(super) fn split(bytes: Vec<u8>, warnings: &mut Vec<Warning>) -> Result<Container, Error> {
    let container = if bytes.starts_with(MAGIC) {
        split_glb(&bytes, warnings)?
    } else {
        Container { glb: false, json: text(bytes, warnings)?, bin: None, extra_chunks: Vec::new() }
    };
    check_depth(&container.json)?;
    Ok(container)
}

fn split_glb(bytes: &[u8], warnings: &mut Vec<Warning>) -> Result<Container, Error> {
    let word =
        |at: usize| -> Option<u32> { bytes.get(at..at.checked_add(4)?)?.try_into().ok().map(u32::from_le_bytes) };
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(Error::invalid("truncated: a GLB header has 12 bytes"));
    };
    if version != 2 {
        return Err(Error::unsupported(format!("GLB version {version}; only version 2 can be read, convert it first")));
    }
    let length = length as usize;
    if length > bytes.len() {
        let have = bytes.len();
        return Err(Error::invalid(format!("truncated: the GLB header says {length} bytes, the file has {have}")));
    }
    if length < bytes.len() {
        let extra = bytes.len() - length;
        warnings.push(Warning::new("trailing-bytes", format!("{extra} bytes after the end of the GLB were ignored")));
    }
    let (mut json, mut bin, mut extra_chunks) = (None, None, Vec::new());
    let mut at = 12;
    let mut index = 0;
    while at < length {
        let (Some(size), Some(kind)) = (word(at), word(at + 4)) else {
            return Err(Error::invalid(format!("truncated: GLB chunk {index} has no complete header")));
        };
        let start = at + 8;
        let end = start.saturating_add(size as usize);
        if end > length {
            return Err(Error::invalid(format!(
                "GLB chunk {index} says {size} bytes, but only {} are left; the file is truncated or damaged",
                length.saturating_sub(start)
            )));
        }
        let data = bytes[start..end].to_vec();
        match (index, kind) {
            (0, JSON) => json = Some(data),
            (0, _) => return Err(Error::invalid("the first GLB chunk is not JSON")),
            (1, BIN) => bin = Some(data),
            _ => extra_chunks.push((kind, data)),
        }
        at = end;
        index += 1;
    }
    let json = json.ok_or_else(|| Error::invalid("the GLB has no JSON chunk"))?;
    Ok(Container { glb: true, json: text(json, warnings)?, bin, extra_chunks })
}

fn text(bytes: Vec<u8>, warnings: &mut Vec<Warning>) -> Result<String, Error> {
    let mut text = String::from_utf8(bytes).map_err(|e| {
        let at = e.utf8_error().valid_up_to();
        Error::invalid(format!("not glTF: neither a GLB header nor UTF-8 text (bad byte at offset {at})"))
    })?;
    if let Some(rest) = text.strip_prefix('\u{feff}') {
        text = rest.to_owned();
        warnings.push(Warning::new("byte-order-mark", "the byte order mark before the JSON was dropped"));
    }
    let end = text.trim_end_matches(['\0', ' ']).len();
    text.truncate(end);
    if text.trim().is_empty() {
        return Err(Error::invalid("the document is empty"));
    }
    Ok(text)
}

/// Refuses text whose brackets nest too deeply, before any parser that recurses sees it.
fn check_depth(json: &str) -> Result<(), Error> {
    let (mut depth, mut in_string, mut escaped) = (0usize, false, false);
    for byte in json.bytes() {
        if in_string {
            (in_string, escaped) = (escaped || byte != b'"', !escaped && byte == b'\\');
            continue;
        }
        match byte {
            b'"' => in_string = true,
            b'{' | b'[' => depth += 1,
            b'}' | b']' => depth = depth.saturating_sub(1),
            _ => {}
        }
        if depth > MAX_DEPTH {
            return Err(Error::invalid(format!("the JSON is nested deeper than {MAX_DEPTH} levels")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn json(bytes: &[u8]) -> Result<Container, Error> {
        split(bytes.to_vec(), &mut Vec::new())
    }

    #[test]
    fn brackets_in_strings_do_not_count() {
        let quoted = format!("{{\"a\": \"{}\\\"{}\"}}", "[".repeat(200), "{".repeat(200));
        assert_eq!(json(quoted.as_bytes()).unwrap().json, quoted);
        assert!(json("[".repeat(101).as_bytes()).is_err());
        assert!(json("[".repeat(100).as_bytes()).is_ok());
    }

    #[test]
    fn a_byte_order_mark_is_dropped_with_a_warning() {
        let mut warnings = Vec::new();
        let container = split("\u{feff}{}".as_bytes().to_vec(), &mut warnings).unwrap();
        assert_eq!((container.json.as_str(), warnings[0].code), ("{}", "byte-order-mark"));
    }
}
