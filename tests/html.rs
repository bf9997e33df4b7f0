//! The HTML report: one page that needs nothing else, shows what was baked, and says what texts say.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "support/html_page.rs"]
mod html_page;

use html_page::{Html, read, unmeasured};
use image::RgbImage;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const EVIL: &str = "<script>alert(1)</script>&\"'<b>";

fn texelwalk(arguments: &[&str], home: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    command.args(arguments).current_dir(home).stdin(Stdio::null()).output().unwrap()
}

/// A copy of the box, after `edit`.
fn cornell(edit: impl Fn(&mut Value)) -> tempfile::TempDir {
    let home = tempfile::tempdir().unwrap();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/cornell");
    fs::copy(source.join("cornell.bin"), home.path().join("cornell.bin")).unwrap();
    let mut document: Value = serde_json::from_slice(&fs::read(source.join("cornell.gltf")).unwrap()).unwrap();
    edit(&mut document);
    fs::write(home.path().join("cornell.gltf"), document.to_string()).unwrap();
    home
}

/// Bakes at a low density; the page is `report.html`.
fn bake(home: &Path, options: &[&str]) -> Output {
    let fixed = ["bake", "cornell.gltf", "-o", "out.gltf", "-q", "--preset", "preview", "--html", "report.html"];
    texelwalk(&[&fixed, options].concat(), home)
}

fn page(home: &Path, options: &[&str]) -> String {
    let out = bake(home, options);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    fs::read_to_string(home.join("report.html")).unwrap()
}

/// What `render` makes of the baked document, in the size of the page's pictures.
fn rendered(home: &Path, camera: &str) -> RgbImage {
    let sizes = ["--width", "768", "--height", "512", "--samples", "4"];
    let out = texelwalk(&[&["render", "out.gltf", "-o", "view.png", "--camera", camera], &sizes[..]].concat(), home);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    image::open(home.join("view.png")).unwrap().into_rgb8()
}

/// Mean difference of the channels, of 255.
fn difference(a: &RgbImage, b: &RgbImage) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let sum: u64 = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.as_raw().len() as f64
}

/// Ids of the sections, in order.
fn sections(html: &Html) -> Vec<&str> {
    html.all("section").map(|s| s.attributes["id"].as_str()).collect()
}

/// A camera that is missing, with an evil name, and two groups of lights, one of them with an evil name.
fn troubled(document: &mut Value) {
    let light = document["materials"].as_array().unwrap().iter().position(|m| m["emissiveFactor"].is_array()).unwrap();
    document["materials"][light]["extras"] = json!({"texelwalk": {"light_group": EVIL}});
    document["materials"][1]["emissiveFactor"] = json!([0.5, 0.2, 0.1]);
    document["nodes"][0]["camera"] = json!(7);
    document["nodes"][0]["name"] = json!(EVIL);
}

#[test]
fn a_page_holds_pictures_maps_groups_and_warnings_and_is_the_same_at_any_thread_count() {
    let options =
        |threads| ["--threads", threads, "--page-size", "48", "--light-groups", "--depfile", "d", "--report", "r.json"];
    let home = cornell(troubled);
    let text = page(home.path(), &options("2"));
    let html = read(&text).unwrap();
    let report: Value = serde_json::from_slice(&fs::read(home.path().join("r.json")).unwrap()).unwrap();
    let expected = ["views", "warnings", "pages", "groups", "stages", "passes", "ledger", "settings", "files"];
    assert_eq!(sections(&html), expected);

    // The pictures are those that `render` makes of the files; the charts of a page are not its light.
    let baked = html.picture("The scene in the light");
    // Camera 0, of the node that is troubled, cannot be used.
    let same = difference(&baked, &rendered(home.path(), "1"));
    let other = difference(&baked, &html.picture("The scene without a bake"));
    assert!(same < 2.0 && other > 10.0, "{same} {other}");
    let pages = report["atlas"]["pages"].as_u64().unwrap();
    assert!(
        pages > 1
            && html.all("img").filter(|e| e.attributes["alt"].starts_with("Lightmap page")).count() as u64
                == pages.min(6)
    );
    assert!(difference(&html.picture("Lightmap page 0"), &html.picture("Its charts")) > 10.0);
    assert_eq!(html.all("img").filter(|e| e.attributes["alt"].starts_with("The scene lit by the group")).count(), 2);
    // All light is in the two groups: shares as printed add up.
    let shares = html.all("figcaption").filter_map(|e| e.text.strip_suffix(" % of the light"));
    let sum: f64 = shares.map(|s| s.trim().parse::<f64>().unwrap()).sum();
    assert!((sum - 100.0).abs() < 0.3, "{sum}");

    // Evil names are text, in the table and beside the picture of their group.
    let evil: Vec<&str> = html.elements.iter().filter(|e| e.text == EVIL).map(|e| e.tag.as_str()).collect();
    assert_eq!((html.all("script").count(), evil.as_slice()), (1, &["td", "b"][..]));
    assert!(html.text().contains("bad-camera") && text.contains("href=\"#warnings\""));
    assert!(html.elements.iter().any(|e| e.tag == "code" && e.text == "--light-groups"));

    let rule = fs::read_to_string(home.path().join("d")).unwrap();
    assert!(report["outputs"].as_array().unwrap().contains(&json!("report.html")) && rule.contains(" report.html:"));

    let again = page(home.path(), &options("1"));
    assert!(again != text && unmeasured(&again) == unmeasured(&text), "thread counts differ");
    assert!(text.contains("<!-- measured -->") && unmeasured(&text).len() < text.len());
}

#[test]
fn vertex_light_has_its_own_figures_and_the_first_three_cameras() {
    let home = cornell(|document| {
        for name in ["b", "c", "d"] {
            let mut node = document["nodes"][8].clone();
            node["name"] = json!(name);
            node["translation"][0] = json!(2.0);
            let number = document["nodes"].as_array().unwrap().len();
            document["scenes"][0]["nodes"].as_array_mut().unwrap().push(json!(number));
            document["nodes"].as_array_mut().unwrap().push(node);
        }
    });
    let text = page(home.path(), &["--target", "vertex", "--subdivide", "0.1"]);
    let html = read(&text).unwrap();
    assert_eq!(sections(&html), ["views", "vertices", "stages", "passes", "ledger", "settings", "files"]);
    assert_eq!(html.all("img").count(), 6);
    assert!(html.text().contains("1 more camera"));
    // Triangles were cut; the picture shows them as the file has them.
    let baked = html.picture("The scene in the light");
    let same = difference(&baked, &rendered(home.path(), "0"));
    assert!(same < 2.0 && difference(&baked, &rendered(home.path(), "1")) > 4.0, "{same}");
}

#[test]
fn a_page_that_cannot_be_written_leaves_nothing() {
    let home = cornell(|_| {});
    fs::write(home.path().join("file"), "x").unwrap();
    let before: Vec<PathBuf> = fs::read_dir(home.path()).unwrap().map(|e| e.unwrap().path()).collect();
    let input = fs::read(home.path().join("cornell.gltf")).unwrap();
    let failing = [
        (["--html", "cornell.gltf", "--report", "r"], 3, "would overwrite the input"),
        (["--html", "r", "--report", "r"], 3, "two outputs have this name"),
        (["--html", "file/page.html", "--report", "r"], 4, "file"),
    ];
    for (options, code, message) in failing {
        let common = ["bake", "cornell.gltf", "-o", "out.gltf", "--preset", "preview", "--gather", "2", "-q"];
        let out = texelwalk(&[&common[..], &options].concat(), home.path());
        let error = String::from_utf8_lossy(&out.stderr);
        assert!(out.status.code() == Some(code) && error.contains(message), "{options:?}: {error}");
        let after: Vec<PathBuf> = fs::read_dir(home.path()).unwrap().map(|e| e.unwrap().path()).collect();
        assert_eq!(after.len(), before.len(), "{options:?}: {after:?}");
    }
    assert_eq!(fs::read(home.path().join("cornell.gltf")).unwrap(), input);
}

#[test]
fn the_reader_refuses_pages_with_faults() {
    let page = |inside: &str| format!("<!DOCTYPE html>\n<body>{inside}</body>\n");
    let pixel = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg==";
    let image = |size: &str, data: &str| format!("<img alt=\"a\" {size} src=\"data:image/png;base64,{data}\">");
    let right = "width=\"1\" height=\"1\"";
    assert!(read(&page(&format!("<p id=\"a\">&lt;</p><a href=\"#a\">x</a>{}", image(right, pixel)))).is_ok());
    for (fault, inside) in [
        ("closes", "<p><b></p></b>".to_owned()),
        ("closes <p>", "<p>".to_owned()),
        ("without quotes", "<p id=a></p>".to_owned()),
        ("bare &", "<p>a & b</p>".to_owned()),
        ("bare >", "<p>a > b</p>".to_owned()),
        ("no tag", "<p>a < b</p>".to_owned()),
        ("twice", "<p id=\"a\"></p><p id=\"a\"></p>".to_owned()),
        ("not there", "<a href=\"#b\">x</a>".to_owned()),
        ("outside", "<a href=\"https://example.org\">x</a>".to_owned()),
        ("handler", "<p onclick=\"x\"></p>".to_owned()),
        ("no data URI", "<img alt=\"a\" src=\"a.png\">".to_owned()),
        ("without alt", image(right, pixel).replace("\"a\"", "\"\"")),
        ("states", image("width=\"2\" height=\"1\"", pixel)),
        ("img", image(right, &pixel[..40])),
    ] {
        let error = read(&page(&inside)).unwrap_err();
        assert!(error.contains(fault), "{inside}: {error}");
    }
    assert!(read("<!DOCTYPE html>\n<p>").unwrap_err().contains("not closed"));
    assert_eq!(unmeasured("a<!-- measured -->1 s<!-- /measured -->b"), "ab");
}
