//! Plumbing of the cross-checks: fixtures found on disk, bakes of them, and the Python checks of `pipelines/checks`.
//!
//! Every output goes to `target/crosscheck/<test>/`, so that a failure leaves something to look at. A missing tool fails
//! the test with the message of the check; nothing is skipped.
#![allow(dead_code, reason = "each test crate uses its part")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A scene of `fixtures/`.
#[derive(Clone, Debug)]
pub(crate) struct Fixture {
    /// Name of its folder.
    pub(crate) name: String,
    /// The glTF or GLB file.
    pub(crate) file: PathBuf,
    /// Options that its README asks for: the sky.
    pub(crate) options: Vec<String>,
}

/// A baked fixture.
#[derive(Clone, Debug)]
pub(crate) struct Bake {
    /// What was baked.
    pub(crate) fixture: Fixture,
    /// The glTF or GLB that was written.
    pub(crate) gltf: PathBuf,
    /// Its lightmap pages.
    pub(crate) pages: Vec<PathBuf>,
    /// The `--report`.
    pub(crate) report: serde_json::Value,
}

/// The repository.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// An empty folder for the outputs of one test.
pub(crate) fn folder(test: &str) -> PathBuf {
    let path = root().join("target/crosscheck").join(test);
    if path.exists() {
        fs::remove_dir_all(&path).unwrap();
    }
    fs::create_dir_all(&path).unwrap();
    path
}

/// Every glTF and GLB that lies directly in a folder of `fixtures/`, sorted. A new fixture needs no code.
pub(crate) fn fixtures() -> Vec<Fixture> {
    let mut found = Vec::new();
    for folder in entries(&root().join("fixtures")) {
        for file in entries(&folder) {
            if file.extension().is_some_and(|e| e == "gltf" || e == "glb") {
                let name = folder.file_name().unwrap().to_string_lossy().into_owned();
                let options = readme_options(&folder.join("README.md"));
                found.push(Fixture { name, file, options });
            }
        }
    }
    assert!(!found.is_empty(), "no glTF in {}", root().join("fixtures").display());
    found
}

/// The fixture in the folder `name`.
pub(crate) fn fixture(name: &str) -> Fixture {
    let all = fixtures();
    all.into_iter().find(|f| f.name == name).unwrap_or_else(|| panic!("fixtures/{name} has no glTF"))
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let Ok(listing) = fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = listing.map(|e| e.unwrap().path()).collect();
    paths.sort();
    paths
}

/// `--sky`, `--sky-horizon` and `--sky-ground` with their colours, as the README of a fixture gives them.
fn readme_options(readme: &Path) -> Vec<String> {
    let text = fs::read_to_string(readme).unwrap_or_default();
    let words: Vec<&str> = text.split(|c: char| c.is_whitespace() || c == '`' || c == '=').collect();
    let mut options: Vec<String> = Vec::new();
    for pair in words.windows(2) {
        let known = ["--sky", "--sky-horizon", "--sky-ground"].contains(&pair[0]);
        let is_color = pair[1].split(',').all(|x| x.parse::<f32>().is_ok());
        if known && is_color && !options.iter().any(|o| o == pair[0]) {
            options.extend([pair[0].to_owned(), pair[1].to_owned()]);
        }
    }
    options
}

/// Runs the binary under test.
pub(crate) fn texelwalk(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_texelwalk")).args(arguments).output().unwrap()
}

/// Bakes a fixture into `folder`, with the options its README asks for.
pub(crate) fn bake(fixture: &Fixture, folder: &Path, options: &[&str]) -> Bake {
    let gltf = folder.join(fixture.file.file_name().unwrap());
    let report = folder.join(format!("{}.report.json", fixture.file.file_stem().unwrap().to_string_lossy()));
    let mut arguments = vec!["bake", text(&fixture.file), "-o", text(&gltf), "--report", text(&report), "-q"];
    arguments.extend(fixture.options.iter().map(String::as_str));
    arguments.extend(options);
    let output = texelwalk(&arguments);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "texelwalk {}: {}\n{errors}", arguments.join(" "), output.status);
    let stem = format!("{}.lightmap", gltf.file_stem().unwrap().to_string_lossy());
    let is_page = |p: &PathBuf| {
        let name = p.file_name().unwrap().to_string_lossy().into_owned();
        name.starts_with(&stem) && name.ends_with(".exr")
    };
    let pages: Vec<PathBuf> = entries(folder).into_iter().filter(is_page).collect();
    assert!(!pages.is_empty(), "{}: no lightmap page beside it", gltf.display());
    let report = serde_json::from_slice(&fs::read(&report).unwrap()).unwrap();
    Bake { fixture: fixture.clone(), gltf, pages, report }
}

/// Texels per metre at which a fixture has about `texels` texels (within 10 %); their number grows with the square.
pub(crate) fn density(fixture: &Fixture, texels: f64) -> String {
    let mut density = 8.0;
    for _ in 0..8 {
        let spelled = format!("{density:.4}");
        let told = texelwalk(&["inspect", text(&fixture.file), "--json", "--texels-per-meter", &spelled]);
        assert!(told.status.success(), "{}: {}", fixture.name, String::from_utf8_lossy(&told.stderr));
        let facts: serde_json::Value = serde_json::from_slice(&told.stdout).unwrap();
        let found = facts["texels"].as_f64().unwrap();
        if (found / texels - 1.0).abs() < 0.1 {
            return spelled;
        }
        density *= (texels / found.max(1.0)).sqrt();
    }
    panic!("{}: no density gives about {texels} texels", fixture.name)
}

/// Runs `pipelines/<script>` with Python.
fn run_python(script: &str, arguments: &[&str]) -> Output {
    let path = root().join("pipelines").join(script);
    let output = Command::new("python3").arg(&path).args(arguments).output();
    output.unwrap_or_else(|e| panic!("python3 is needed for {script}: {e}"))
}

/// Runs `pipelines/<script>` with Python; stdout and stderr together, and whether it succeeded.
pub(crate) fn python(script: &str, arguments: &[&str]) -> (bool, String) {
    let output = run_python(script, arguments);
    let said = [output.stdout, output.stderr].concat();
    (output.status.success(), String::from_utf8_lossy(&said).into_owned())
}

/// The Python of the environment of the cross-checks, made if needed.
pub(crate) fn environment_python() -> String {
    let output = run_python("checks/environment.py", &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // Standard error tells of the making; the last line of standard output is the path.
    String::from_utf8_lossy(&output.stdout).lines().last().unwrap().to_owned()
}

/// Asserts that a check accepts; what it printed is in the message and, with --nocapture, on the terminal.
pub(crate) fn accepts(script: &str, arguments: &[&str]) {
    let (good, said) = python(script, arguments);
    eprintln!("{said}");
    assert!(good, "{script} {} found fault:\n{said}", arguments.join(" "));
}

/// Asserts that a check rejects, and says `why`.
pub(crate) fn rejects(script: &str, arguments: &[&str], why: &str) {
    let (good, said) = python(script, arguments);
    assert!(!good && said.contains(why), "{script} {} should complain about '{why}':\n{said}", arguments.join(" "));
}

/// A path as text.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Multiplies the colours of a page in place. The settings of the bake are lost.
pub(crate) fn brighten(page: &Path, by: f32) {
    brighten_where(page, by, |_, _| true);
}

/// The same, where `which(column, row)` holds.
pub(crate) fn brighten_where(page: &Path, by: f32, which: impl Fn(usize, usize) -> bool + Sync) {
    use exr::prelude::f16;
    let image = texelwalk::output::exr::read_rgba(page).unwrap();
    let (width, height) = (image.width as usize, image.height as usize);
    let pixel = |x: usize, y: usize| {
        let by = if which(x, y) { by } else { 1.0 };
        let [r, g, b, a] = image.pixels[y * width + x];
        (f16::from_f32(r * by), f16::from_f32(g * by), f16::from_f32(b * by), f16::from_f32(a))
    };
    exr::prelude::write_rgba_file(page, width, height, pixel).unwrap();
}
