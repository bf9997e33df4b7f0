//! The files that a bake will write, by name, before there is anything to write: what cannot go where it is asked for is
//! refused at the start and not after hours.
//!
//! In: the request; then, once they are known, files that were read, pages and groups of lights. Out: nothing, or why
//! not (`output::targets`).
//!
//! Limits: images that USD needs beside its layers are not foreseen. `NAME.lightmap.bin` counts as written where a
//! `.gltf` is, which it need not be.

use super::{Error, Request};
use crate::output::directional::Texture;
use crate::output::{names, targets, usd};
use crate::settings::{Directional, Settings, Target};
use std::path::{Path, PathBuf};

/// Checks what is known before the document was read.
pub(super) fn check_early(request: &Request) -> Result<(), Error> {
    let inputs = [Some(&request.input), request.settings.environment.as_ref()];
    let inputs: Vec<PathBuf> = inputs.into_iter().flatten().chain(&request.also_read).cloned().collect();
    check(request, &inputs, 1, &[])
}

/// Checks everything; `groups` are the names of the groups of lights that get files of their own.
pub(super) fn check(request: &Request, inputs: &[PathBuf], pages: u32, groups: &[&str]) -> Result<(), Error> {
    let files = all(request, pages, groups);
    let paths: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    targets::check(&paths, inputs)?;
    Ok(targets::check_folders(&paths)?)
}

/// The names of all files; those that the request has come first.
fn all(request: &Request, pages: u32, groups: &[&str]) -> Vec<PathBuf> {
    let document = names::document_path(&request.input, &request.output);
    let mut files = vec![document.clone()];
    files.extend([&request.report, &request.html, &request.depfile].into_iter().flatten().cloned());
    files.extend(request.usd.iter().flat_map(|usd| usd::layers(usd)));
    let ends_in = |path: &Path, extension: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
    let glb = ends_in(&document, "glb");
    if !glb {
        files.push(names::beside(&document, "lightmap.bin"));
        files.extend(ends_in(&request.input, "glb").then(|| names::beside(&document, "bin")));
    }
    let settings = &request.settings;
    if settings.target == Target::Lightmap {
        files.extend(on_pages(settings, &document, pages, groups));
        let preview = if glb { "preview.glb" } else { "preview.gltf" };
        files.extend(settings.preview_gltf.then(|| names::beside(&document, preview)));
    }
    files
}

/// Pages with all that is beside them.
fn on_pages(settings: &Settings, document: &Path, pages: u32, groups: &[&str]) -> Vec<PathBuf> {
    let in_all_formats = |exr: &PathBuf| settings.format.iter().map(|format| format.path(exr)).collect::<Vec<_>>();
    let mut files = vec![];
    for (k, page) in (0..).zip(names::page_files(document, pages)) {
        files.extend(in_all_formats(&page.exr));
        files.extend(textures(settings.directional).iter().map(|texture| texture.path(&page.exr)));
        files.extend((!settings.aov.is_empty()).then(|| names::aov_file(document, k)));
        files.push(page.png);
    }
    files.extend(group_paths(document, groups, pages).iter().flatten().flat_map(in_all_formats));
    files
}

fn textures(mode: Directional) -> &'static [Texture] {
    match mode {
        Directional::None => &[],
        Directional::Sh => &[Texture::L0, Texture::L1x, Texture::L1y, Texture::L1z],
        Directional::Dominant => &[Texture::Direction],
    }
}

/// EXR files of each group of lights, by page; files of other formats lie beside them.
pub(super) fn group_paths(document: &Path, groups: &[&str], pages: u32) -> Vec<Vec<PathBuf>> {
    let file = |word: &str, k: u32| names::beside(document, &format!("lightmap-{word}{k}.exr"));
    let words = names::words(groups.iter().copied());
    words.iter().map(|word| (0..pages).map(|k| file(word, k)).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::{Observer, bake};
    use crate::base::Progress;
    use crate::settings::{Options, Preset};
    use std::collections::BTreeSet;
    use std::sync::Arc;

    struct Silent;

    impl Observer for Silent {
        fn stage(&self, _: &'static str, _: &Arc<Progress>) {}
        fn done(&self, _: &'static str, _: f64) {}
    }

    /// Names of the files of a bake of cornell, as foreseen and as written.
    fn both(options: &str, output: &str, groups: &[&str]) -> [BTreeSet<PathBuf>; 2] {
        let home = tempfile::tempdir().unwrap();
        let input = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cornell/cornell.gltf");
        let few = "texels-per-meter = 4\ngather = 1\nlines-per-texel = 1\ndirect-samples = 1\n";
        let settings = Options::from_toml(&(few.to_owned() + options)).unwrap().settings().unwrap();
        let mut request = Request::new(input, home.path().join(output), settings, Preset::Preview);
        let named = |name: &str| Some(home.path().join(name));
        (request.report, request.html, request.depfile) = (named("r.json"), named("r.html"), named("d"));
        request.usd = named("u.usda");
        let written = bake(&request, &Silent, Arc::default()).unwrap();
        let foreseen = all(&request, written.report.atlas.pages, groups);
        [foreseen, written.files.into_iter().map(|(path, _)| path).collect()].map(|files| files.into_iter().collect())
    }

    #[test]
    fn all_files_are_foreseen() {
        let most = "format = [\"exr\", \"hdr\", \"ktx2\"]\npreview-gltf = true\naov = [\"chart\"]\ndirectional = \"sh\"\n\
                    light-groups = true\npage-size = 32";
        let [foreseen, written] = both(most, "a.glb", &["default"]);
        assert_eq!(foreseen, written);
        assert!(written.len() > 20);
        let [foreseen, written] = both("directional = \"dominant\"", "new/a.gltf", &[]);
        assert_eq!(foreseen, written);
        let [foreseen, written] = both("target = \"vertex\"", "a.gltf", &[]);
        assert_eq!(foreseen, written);
    }
}
