//! Bakes in a browser: three.js in headless Chromium must show what `texelwalk render` shows, by our plugin.
//!
//! Needs Chromium (Debian package `chromium`), the environment of the cross-checks, and packages that are installed under
//! `target/` on the first run. The page is that of `pipelines/web`; see `pipelines/checks/browser.py` for what is compared.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/crosscheck_env.rs"]
mod crosscheck_env;

use crosscheck_env::{accepts, bake, brighten, fixture, folder, rejects, texelwalk, text};
use std::fs;
use std::path::{Path, PathBuf};

fn runs(arguments: &[&str]) {
    let output = texelwalk(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// The linear picture of a camera, as `render` takes it.
fn picture(baked: &Path, camera: &str, [width, height]: [&str; 2]) -> PathBuf {
    let path = baked.with_file_name("view.exr");
    let size = ["--width", width, "--height", height, "--samples", "64"];
    let mut arguments = vec!["render", text(baked), "-o", text(&path), "--camera", camera];
    arguments.extend(size);
    runs(&arguments);
    path
}

/// Compares both pictures; PNGs of them and of the page stay in the folder `pictures` beside the document.
fn shows_what_render_shows(baked: &Path, camera: &str) {
    let (reference, pictures) = (picture(baked, camera, ["480", "320"]), baked.with_file_name("pictures"));
    let arguments = [text(baked), text(&reference), "--camera", camera, "--pictures", text(&pictures)];
    accepts("checks/browser.py", &arguments);
}

#[test]
#[ignore = "slow: Chromium with software WebGL, and a Python environment"]
fn a_browser_shows_cornell_as_render_does() {
    let baked = bake(&fixture("cornell"), &folder("browser_cornell"), &["--preset", "preview"]);
    assert_eq!(baked.pages.len(), 1);
    shows_what_render_shows(&baked.gltf, "0");
}

#[test]
#[ignore = "slow: Chromium with software WebGL, and a Python environment"]
fn a_browser_shows_light_at_vertices_as_render_does() {
    let baked = folder("browser_vertices").join("cornell.gltf");
    let input = fixture("cornell").file;
    runs(&["bake", text(&input), "-o", text(&baked), "--target", "vertex", "--preset", "preview", "-q"]);
    shows_what_render_shows(&baked, "0");
}

#[test]
#[ignore = "slow: Chromium with software WebGL, and a Python environment"]
fn a_browser_shows_the_office_on_many_pages_as_render_does() {
    let options = ["--preset", "preview", "--page-size", "64"];
    let baked = bake(&fixture("office"), &folder("browser_office"), &options);
    shows_what_render_shows(&baked.gltf, "1");
    assert!(baked.pages.len() > 3, "64² texels should not be enough for the office");
}

#[test]
#[ignore = "slow: Chromium with software WebGL, and a Python environment"]
fn the_browser_check_rejects_wrong_light() {
    let out = folder("browser_rejects");
    let baked = bake(&fixture("cornell"), &out, &["--preset", "preview"]);
    let reference = picture(&baked.gltf, "0", ["240", "160"]);
    let good = fs::read_to_string(&baked.gltf).unwrap();
    let wrong = |from: &str, to: &str| {
        assert!(good.contains(from));
        let path = out.join("wrong.gltf");
        fs::write(&path, good.replace(from, to)).unwrap();
        path
    };
    let channel = wrong(r#""texCoord": 1, "intensity""#, r#""texCoord": 0, "intensity""#);
    rejects("checks/browser.py", &[text(&channel), text(&reference)], "the ratio of means is off");
    // Without the patch of the plugin, three.js keeps some of the light for highlights.
    rejects("checks/browser.py", &[text(&baked.gltf), text(&reference), "--plain"], "of the pixels are off");
    brighten(&baked.pages[0], 1.05);
    rejects("checks/browser.py", &[text(&baked.gltf), text(&reference)], "the ratio of means is off");
}

#[test]
#[ignore = "slow: Chromium with software WebGL, and a Python environment"]
fn a_browser_shows_vertex_light_and_light_by_normal_and_says_what_is_wrong_with_a_file() {
    accepts("checks/browser_cases.py", &[]);
    let wrong =
        [("radiosity", "is off by"), ("light by normal", "is off by"), ("a texture without EXR", "was not refused")];
    for (name, why) in wrong {
        rejects("checks/browser_cases.py", &["--wrong", name], why);
    }
}
