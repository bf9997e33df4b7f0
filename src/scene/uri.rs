//! What a URI of a buffer or image refers to: bytes inside the document, or a file beside it (glTF 2.0, section 2.8).
//!
//! Relative paths may go up (`../textures/a.png` is common in real assets and the specification allows it). Absolute
//! paths and every scheme but `data:` are refused: a document must not decide which file of the machine is opened, nor
//! start a download. Only regular files are opened, so that a document cannot make a bake hang on a pipe or device.

use std::fs::File;
use std::io;
use std::io::Read;
use std::path::Path;
use std::path::PathBuf;

/// Most bytes of a URI that is no `data:` URI; paths end at 4096 bytes on Linux, and every byte may be written as three.
const LONGEST: usize = 3 * 4096;

/// Where the bytes are.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Resource {
    /// Decoded from a `data:` URI.
    Data(Vec<u8>),
    /// Relative paths to try in turn: percent-decoded, then as written (some exporters do not encode).
    Files(Vec<PathBuf>),
}

/// Interprets a URI; the error is a clause that follows "its URI …".
pub(super) fn resolve(uri: &str) -> Result<Resource, String> {
    if uri.is_empty() {
        return Err("is empty".to_owned());
    }
    if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
        return data(&uri[5..]).map(Resource::Data);
    }
    if uri.len() > LONGEST {
        return Err(format!("has {} bytes; no file has such a name", uri.len()));
    }
    let shown: String = uri.chars().take(80).collect();
    if let Some((scheme, _)) = uri.split_once(':')
        && scheme.starts_with(|c: char| c.is_ascii_alphabetic())
        && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
    {
        return Err(format!(
            "`{shown}` is absolute; put the file beside the document and refer to it by relative path"
        ));
    }
    let mut files = Vec::new();
    for name in [String::from_utf8(percent_decode(uri)).unwrap_or_else(|_| uri.to_owned()), uri.to_owned()] {
        let path = Path::new(&name);
        if name.starts_with(['/', '\\']) || path.has_root() || name.contains('\0') {
            return Err(format!("`{shown}` is an absolute path; use a path relative to the document"));
        }
        if !files.iter().any(|f: &PathBuf| f == path) {
            files.push(path.to_path_buf());
        }
    }
    Ok(Resource::Files(files))
}

/// Reads at most `limit` bytes of the first of `files` that exists under `folder`; says which one it was.
pub(super) fn read(folder: &Path, files: &[PathBuf], limit: usize) -> Result<(PathBuf, Vec<u8>), (PathBuf, io::Error)> {
    let mut failure = None;
    for file in files {
        let path = folder.join(file);
        match read_regular(&path, limit) {
            Ok(bytes) => return Ok((path, bytes)),
            Err(e) => failure = failure.or(Some((path, e))),
        }
    }
    Err(failure.unwrap_or_else(|| (folder.to_path_buf(), io::ErrorKind::NotFound.into())))
}

fn read_regular(path: &Path, limit: usize) -> io::Result<Vec<u8>> {
    if !std::fs::metadata(path)?.is_file() {
        return Err(io::Error::other("it is not a regular file"));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(limit as u64).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn data(rest: &str) -> Result<Vec<u8>, String> {
    let (head, body) = rest.split_once(',').ok_or("is a data URI without a comma")?;
    let bytes = percent_decode(body);
    if head.rsplit(';').next().is_some_and(|last| last.trim().eq_ignore_ascii_case("base64")) {
        base64(&bytes).ok_or_else(|| "is a data URI with broken base64".to_owned())
    } else {
        Ok(bytes)
    }
}

/// `%41` → `A`; a percent sign without two hexadecimal digits stands for itself.
fn percent_decode(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let digit = |at: usize| bytes.get(at).and_then(|&b| char::from(b).to_digit(16));
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        match (bytes[at], digit(at + 1), digit(at + 2)) {
            (b'%', Some(high), Some(low)) => {
                out.push((high * 16 + low) as u8);
                at += 3;
            }
            (byte, ..) => {
                out.push(byte);
                at += 1;
            }
        }
    }
    out
}

/// Standard and URL-safe alphabets, padding optional (RFC 4648, sections 4 and 5).
fn base64(text: &[u8]) -> Option<Vec<u8>> {
    let end = text.iter().rposition(|&b| b != b'=').map_or(0, |p| p + 1);
    let text = &text[..end];
    let mut out = Vec::with_capacity(text.len() / 4 * 3 + 2);
    for group in text.chunks(4) {
        let mut bits = 0u32;
        for &byte in group {
            let value = match byte {
                b'A'..=b'Z' => byte - b'A',
                b'a'..=b'z' => byte - b'a' + 26,
                b'0'..=b'9' => byte - b'0' + 52,
                b'+' | b'-' => 62,
                b'/' | b'_' => 63,
                _ => return None,
            };
            bits = bits << 6 | u32::from(value);
        }
        match group.len() {
            4 => out.extend_from_slice(&bits.to_be_bytes()[1..]),
            3 => out.extend_from_slice(&(bits >> 2).to_be_bytes()[2..]),
            2 => out.push((bits >> 4) as u8),
            _ => return None,
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(uri: &str) -> Vec<u8> {
        match resolve(uri).unwrap() {
            Resource::Data(d) => d,
            Resource::Files(f) => panic!("{f:?}"),
        }
    }

    #[test]
    fn base64_vectors_of_rfc_4648() {
        let vectors = [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYg==", "foob")];
        for (code, plain) in vectors.into_iter().chain([("Zm9vYmE=", "fooba"), ("Zm9vYmFy", "foobar")]) {
            assert_eq!(bytes(&format!("data:;base64,{code}")), plain.as_bytes());
            assert_eq!(bytes(&format!("DATA:a/b;Base64,{}", code.trim_end_matches('='))), plain.as_bytes());
        }
        assert_eq!(bytes("data:;base64,Zg%3D%3D"), b"f");
        assert_eq!(bytes("data:text/plain,a%20b"), b"a b");
        assert!(resolve("data:;base64,Z").is_err() && resolve("data:;base64,Zm9?").is_err());
        assert!(resolve("data:base64").is_err());
    }

    #[test]
    fn only_relative_files_are_accepted() {
        for bad in
            ["/etc/passwd", "%2Fetc%2Fpasswd", "\\\\host\\a", "file:///a.bin", "https://a/b.bin", "C:\\a.bin", ""]
        {
            assert!(resolve(bad).is_err(), "{bad}");
        }
        let files = |names: &[&str]| Resource::Files(names.iter().map(PathBuf::from).collect());
        assert_eq!(resolve("../a%20b.png"), Ok(files(&["../a b.png", "../a%20b.png"])));
        assert_eq!(resolve("100%.png"), Ok(files(&["100%.png"])));
        assert_eq!(resolve("a/b:c.png"), Ok(files(&["a/b:c.png"])));
    }
}
