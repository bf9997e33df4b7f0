//! Names of the files of a bake, and the relative URIs by which they refer to each other.
//!
//! A URI is a relative path with forward slashes, every byte outside RFC 3986's unreserved set percent-encoded. A URI
//! that the input already had keeps its spelling; when the output lies in another folder it only gets a prefix, less what
//! it would go back from at once: what is baked again and again does not depend on the folders in between.

use super::Error;
use super::directional::Texture;
use super::formats::PageFile;
use std::fmt::Write;
use std::path::Component;
use std::path::Path;
use std::path::PathBuf;

/// Letters of a group's name that go into a file's.
const MOST_LETTERS: usize = 64;

/// Where the files of one lightmap page go.
#[derive(Debug, Clone, PartialEq)]
pub struct PageFiles {
    /// The lightmap itself.
    pub exr: PathBuf,
    /// Its preview, for readers that know no EXR.
    pub png: PathBuf,
    /// Its files in all formats, the one that readers shall take first; empty if the EXR is the only one.
    pub files: Vec<PageFile>,
    /// Its light by normal; usually empty.
    pub directional: Vec<(Texture, PathBuf)>,
}

/// The glTF file that `-o` asks for: `output` itself, or the input's name in it if it is a folder (it exists, or ends
/// in a separator, or has no extension and is not there).
#[must_use]
pub fn document_path(input: &Path, output: &Path) -> PathBuf {
    let text = output.as_os_str().as_encoded_bytes();
    let ends_in_separator = text.last().is_some_and(|&b| b == b'/' || (cfg!(windows) && b == b'\\'));
    let is_new = output.extension().is_none() && output.symlink_metadata().is_err();
    if output.is_dir() || ends_in_separator || is_new {
        output.join(input.file_name().unwrap_or_default())
    } else {
        output.to_path_buf()
    }
}

/// `out/room.glb`, `lightmap0.exr` → `out/room.lightmap0.exr`.
#[must_use]
pub fn beside(document: &Path, suffix: &str) -> PathBuf {
    let mut name = document.file_stem().unwrap_or_default().to_os_string();
    name.push(".");
    name.push(suffix);
    document.with_file_name(name)
}

/// The files of `pages` lightmap pages beside `document`.
#[must_use]
pub fn page_files(document: &Path, pages: u32) -> Vec<PageFiles> {
    (0..pages)
        .map(|k| PageFiles {
            exr: beside(document, &format!("lightmap{k}.exr")),
            png: beside(document, &format!("lightmap{k}.png")),
            files: vec![],
            directional: vec![],
        })
        .collect()
}

/// The file of the further layers of page `k` beside `document`.
#[must_use]
pub fn aov_file(document: &Path, k: u32) -> PathBuf {
    beside(document, &format!("aov{k}.exr"))
}

/// Names as parts of file names: letters, digits and `-` stay, anything else becomes `_`. A page number follows, so
/// what ends in a digit gets a `-`. No two are equal, not even where letter case does not count: later ones get a
/// number.
pub fn words<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    let mut words: Vec<String> = vec![];
    for name in names {
        let stem: String = name.chars().map(plain).take(MOST_LETTERS).collect();
        let end = |word: String| if word.ends_with(|c: char| c.is_ascii_digit()) { word + "-" } else { word };
        let numbered = (2..).map(|n| end(format!("{stem}-{n}")));
        let mut choices = core::iter::once(end(stem.clone())).chain(numbered);
        let free = |word: &String| !words.iter().any(|w| w.eq_ignore_ascii_case(word));
        words.extend(choices.find(free));
    }
    words
}

/// URI by which a file in `folder` refers to the file `target`; both may still be missing.
///
/// # Errors
/// If no relative path leads from one to the other (different drives), or a name cannot be written as UTF-8.
pub fn relative_uri(folder: &Path, target: &Path) -> Result<String, Error> {
    let name = target
        .file_name()
        .ok_or_else(|| Error::invalid(target, "is not the name of a file that a URI can point to"))?;
    let prefix = uri_prefix(folder, parent(target))?;
    Ok(prefix + &encode(text(target, name)?))
}

/// What to put before a URI that is relative to `of`, so that it is right from `from`: empty, or `../a/`.
///
/// # Errors
/// As for [`relative_uri`].
pub fn uri_prefix(from: &Path, of: &Path) -> Result<String, Error> {
    let (from_full, of_full) = (resolved(from)?, resolved(of)?);
    let (a, b): (Vec<_>, Vec<_>) = (from_full.components().collect(), of_full.components().collect());
    let common = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    if common == 0 {
        return Err(Error::invalid(of, format!("no relative path leads here from {}", from.display())));
    }
    let mut uri = "../".repeat(a.len() - common);
    for component in &b[common..] {
        uri += &encode(text(of, component.as_os_str())?);
        uri.push('/');
    }
    Ok(uri)
}

/// Adds `prefix`, as [`uri_prefix`] makes it, to a URI unless it is absolute (`data:`, `https:`, `/…`) or empty. Folders of
/// the prefix that the URI leaves again are left out.
#[must_use]
pub fn rebased(uri: &str, prefix: &str) -> String {
    let scheme = uri.find(':').is_some_and(|colon| {
        uri[..colon].chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c))
            && uri.starts_with(|c: char| c.is_ascii_alphabetic())
    });
    if scheme || uri.starts_with('/') || uri.is_empty() {
        return uri.to_owned();
    }
    let (mut before, mut rest) = (prefix, uri);
    while let Some(above) = rest.strip_prefix("../") {
        let outer = before.strip_suffix('/').map(|folder| &before[..folder.rfind('/').map_or(0, |slash| slash + 1)]);
        let Some(outer) = outer.filter(|outer| &before[outer.len()..] != "../") else { break };
        (before, rest) = (outer, above);
    }
    format!("{before}{rest}")
}

/// Percent-encodes one path component.
#[must_use]
pub fn encode(component: &str) -> String {
    component.bytes().fold(String::new(), |mut out, b| {
        if b.is_ascii_alphanumeric() || b"-._~".contains(&b) {
            out.push(char::from(b));
        } else {
            // Writing to a string cannot fail.
            let _ = write!(out, "%{b:02X}");
        }
        out
    })
}

/// The file that a relative URI of `document` leads to; `None` for absolute URIs and broken escapes.
#[must_use]
pub fn local_path(document: &Path, uri: &str) -> Option<PathBuf> {
    if uri.is_empty() || rebased(uri, "x") == uri {
        return None;
    }
    Some(parent(document).join(decoded(uri)?))
}

/// Percent-decodes.
fn decoded(uri: &str) -> Option<String> {
    let (mut bytes, mut rest) = (Vec::new(), uri.as_bytes());
    while let Some((&b, tail)) = rest.split_first() {
        let escaped = || u8::from_str_radix(core::str::from_utf8(tail.get(..2)?).ok()?, 16).ok();
        bytes.push(if b == b'%' { escaped()? } else { b });
        rest = if b == b'%' { &tail[2..] } else { tail };
    }
    String::from_utf8(bytes).ok()
}

/// Path with forward slashes by which a file in `folder` refers to the file `target`; starts with `./` or `../`.
///
/// # Errors
/// As for [`relative_uri`].
pub fn relative_path(folder: &Path, target: &Path) -> Result<String, Error> {
    let uri = relative_uri(folder, target)?;
    let path = decoded(&uri).ok_or_else(|| Error::invalid(target, "the name is not UTF-8; rename it"))?;
    Ok(if path.starts_with("../") { path } else { format!("./{path}") })
}

/// The folder that a file lies in; `.` for a bare name.
#[must_use]
pub fn parent(file: &Path) -> &Path {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

fn text<'a>(path: &Path, name: &'a std::ffi::OsStr) -> Result<&'a str, Error> {
    name.to_str().ok_or_else(|| Error::invalid(path, "the name is not UTF-8, so no URI can point to it; rename it"))
}

/// Absolute path without links or `..`; the part that does not exist yet is taken literally.
fn resolved(folder: &Path) -> Result<PathBuf, Error> {
    let absolute = std::path::absolute(folder).map_err(|e| Error::io(folder, "find the folder", e))?;
    let mut existing = absolute.as_path();
    let mut rest = Vec::new();
    loop {
        if let Ok(found) = existing.canonicalize() {
            let mut out = found;
            for component in rest.iter().rev() {
                match component {
                    Component::ParentDir => {
                        out.pop();
                    }
                    Component::CurDir => {}
                    other => out.push(other.as_os_str()),
                }
            }
            return Ok(out);
        }
        let (Some(up), Some(last)) = (existing.parent(), existing.components().next_back()) else {
            return Ok(absolute);
        };
        rest.push(last);
        existing = up;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_a_bake() {
        assert_eq!(beside(Path::new("out/my room.v2.glb"), "lightmap1.exr"), Path::new("out/my room.v2.lightmap1.exr"));
        assert_eq!(
            document_path(Path::new("in/a.gltf"), Path::new("no-such-folder/")),
            Path::new("no-such-folder/a.gltf")
        );
        assert_eq!(document_path(Path::new("in/a.gltf"), Path::new("b.glb")), Path::new("b.glb"));
        assert_eq!(document_path(Path::new("in/a.gltf"), Path::new("b.vrm")), Path::new("b.vrm"));
        assert_eq!(document_path(Path::new("in/a.gltf"), Path::new("no/such")), Path::new("no/such/a.gltf"));
        assert_eq!(page_files(Path::new("a.glb"), 2)[1].png, Path::new("a.lightmap1.png"));
    }

    #[test]
    fn words_are_plain_and_different() {
        let names = ["key light", "key/light", "Key_Light", "lamp2", "../ü"];
        assert_eq!(words(names.into_iter()), ["key_light", "key_light-2-", "Key_Light-3-", "lamp2-", "____"]);
    }

    #[test]
    fn uris_lead_from_one_folder_to_the_other() {
        let root = tempfile::tempdir().unwrap();
        let (a, b) = (root.path().join("in put"), root.path().join("out/deep"));
        std::fs::create_dir_all(&a).unwrap();
        assert_eq!(uri_prefix(&b, &a).unwrap(), "../../in%20put/");
        assert_eq!(uri_prefix(&a, &a.join(".")).unwrap(), "");
        assert_eq!(uri_prefix(&b.join("../x"), &b).unwrap(), "../deep/");
        assert_eq!(relative_uri(&b, &b.join("50% #1 ü.exr")).unwrap(), "50%25%20%231%20%C3%BC.exr");
        assert_eq!(relative_path(&b, &b.join("50% #1 ü.exr")).unwrap(), "./50% #1 ü.exr");
        assert_eq!(relative_path(&b, &a.join("c.exr")).unwrap(), "../../in put/c.exr");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_before_going_up() {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(root.path().join("far/away")).unwrap();
        std::fs::create_dir_all(root.path().join("in")).unwrap();
        std::os::unix::fs::symlink(root.path().join("far/away"), root.path().join("out")).unwrap();
        assert_eq!(uri_prefix(&root.path().join("out"), &root.path().join("in")).unwrap(), "../../in/");
    }

    #[test]
    fn uris_lead_back_to_files() {
        let back = |uri: &str| local_path(Path::new("out/a.gltf"), uri);
        assert_eq!(back("../x/50%25%20%C3%BC.exr").unwrap(), Path::new("out/../x/50% ü.exr"));
        for bad in ["", "data:,x", "https://x/y", "/abs", "a%2", "a%zz", "%FF"] {
            assert_eq!(back(bad), None, "{bad}");
        }
    }

    #[test]
    fn only_relative_uris_are_rebased() {
        assert_eq!(rebased("t%20ex.png", "../in/"), "../in/t%20ex.png");
        assert_eq!(rebased("sub/a:b.png", "../in/"), "../in/sub/a:b.png");
        assert_eq!(rebased("../../tx/a%20b.png", "../o1/"), "../../tx/a%20b.png");
        assert_eq!(rebased("../a/../b.png", "../../x%20y/z/"), "../../x%20y/a/../b.png");
        assert_eq!(rebased("../../../b.png", "../x/"), "../../../b.png");
        assert_eq!(rebased("../b.png", ""), "../b.png");
        assert_eq!(rebased("../../b.png", "sub/"), "../b.png");
        for fixed in ["data:image/png;base64,AA==", "https://x/y.png", "/root.png", ""] {
            assert_eq!(rebased(fixed, "../in/"), fixed);
        }
    }
}
