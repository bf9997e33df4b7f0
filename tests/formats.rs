//! `--format`, `--exr-image` and `--preview-gltf`: what the program writes, and what decoders by others make of it.
//!
//! The ignored tests run `formats.py`, `validate.py` and `preview.py` of `pipelines/checks` (OpenImageIO, ktx-parse, the
//! Khronos validator, Blender). Each check is also shown files that were altered, which it has to reject.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/crosscheck_env.rs"]
mod crosscheck_env;

use crosscheck_env::{accepts, bake, brighten, fixture, folder, rejects, texelwalk, text};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use texelwalk::finish::{Lightmap, Page, dilate};
use texelwalk::output::exr::read_rgba;
use texelwalk::output::formats::{Format, Plan};
use texelwalk::output::names;

const ALL: &str = "exr,hdr,png,rgbm,rgbd,rgbe,ktx2";
/// Seconds for a bake, not for light.
const QUICK: [&str; 8] = ["--preset", "preview", "--gather", "2", "--lines-per-texel", "4", "--direct-samples", "2"];

/// Bakes cornell to `out.gltf` in a fresh folder; name and bytes of what was written.
fn cornell(options: &[&str]) -> (tempfile::TempDir, BTreeMap<String, Vec<u8>>) {
    let home = tempfile::tempdir().unwrap();
    let output = home.path().join("out.gltf");
    let input = fixture("cornell").file;
    let arguments = [&["bake", text(&input), "-o", text(&output), "-q"], &QUICK[..], options].concat();
    let done = texelwalk(&arguments);
    assert!(done.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&done.stderr));
    let read = |entry: fs::DirEntry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap());
    let files = fs::read_dir(home.path()).unwrap().map(|e| read(e.unwrap())).collect();
    (home, files)
}

fn json_of(bytes: &[u8]) -> Value {
    serde_json::from_slice(bytes).unwrap()
}

#[test]
fn the_default_is_the_exr_alone_and_says_no_more_than_before() {
    let (_, plain) = cornell(&[]);
    let (_, named) = cornell(&["--format", "exr"]);
    assert_eq!(plain, named);
    assert_eq!(plain.len(), 4, "{:?}", plain.keys());
    let document = String::from_utf8(plain["out.gltf"].clone()).unwrap();
    assert!(!document.contains("\"files\"") && !document.contains("EXT_texture_exr"));
    assert!(!plain["out.lightmap0.exr"].windows(6).any(|w| w == b"format"));
}

#[test]
fn every_file_is_listed_where_readers_and_build_systems_look() {
    let lists = tempfile::tempdir().unwrap();
    let (report, rule) = (lists.path().join("r.json"), lists.path().join("r.d"));
    let options = ["--format", "rgbm,exr,hdr", "--light-groups", "--preview-gltf", "--depfile", text(&rule)];
    let (_, files) = cornell(&[&options[..], &["--report", text(&report)]].concat());
    let (report, rule) = (json_of(&fs::read(report).unwrap()), fs::read_to_string(rule).unwrap());
    let listed: Vec<&str> = report["outputs"].as_array().unwrap().iter().map(|o| o.as_str().unwrap()).collect();
    for name in files.keys() {
        assert!(listed.iter().any(|o| o.ends_with(name.as_str())) && rule.contains(name.as_str()), "{name}");
    }
    assert_eq!(listed.len(), files.len());
    let group = report["light_groups"][0]["files"].as_array().unwrap();
    let ends = ["default0.rgbm.png", "default0.exr", "default0.hdr"];
    assert!(group.iter().zip(ends).all(|(file, end)| file.as_str().unwrap().ends_with(end)), "{group:?}");
    let document = json_of(&files["out.gltf"]);
    let page = &document["scenes"][0]["extras"]["lightmap"]["pages"][0];
    let texture = &document["textures"][page["texture"].as_u64().unwrap() as usize]["extras"]["lightmap"];
    assert_eq!((&page["uri"], &page["files"]), (&texture["uri"], &texture["files"]));
    assert_eq!(page["uri"], "out.lightmap0.rgbm.png");
    let formats: Vec<&Value> = page["files"].as_array().unwrap().iter().map(|f| &f["format"]).collect();
    assert_eq!(formats, ["rgbm", "exr", "hdr"]);
    let scale = page["files"][0]["scale"].as_f64().unwrap();
    assert!(scale.log2().fract() == 0.0 && page["files"][1].get("scale").is_none());
    assert_eq!(json_of(&files["out.preview.gltf"])["images"][0]["uri"], "out.lightmap0.exr");
}

#[test]
fn formats_are_the_same_bytes_at_any_thread_count_and_leave_the_light_as_it_is() {
    let options = ["--format", ALL, "--exr-image", "--preview-gltf"];
    let (home, one) = cornell(&[&options[..], &["--threads", "1"]].concat());
    let (_, two) = cornell(&[&options[..], &["--threads", "2"]].concat());
    assert!(one == two && one.len() == 11, "{:?}", one.keys());
    // BC6H asks for two clean mip levels.
    let (plain_home, _) = cornell(&["--mips", "2"]);
    let page = |home: &tempfile::TempDir| read_rgba(&home.path().join("out.lightmap0.exr")).unwrap();
    assert_eq!(page(&home), page(&plain_home));
}

#[test]
fn options_that_cannot_be_met_are_usage_errors() {
    let home = tempfile::tempdir().unwrap();
    let config = home.path().join("c.toml");
    fs::write(&config, "format = [\"ktx2\"]\nexr-image = true\n").unwrap();
    let (input, output) = (fixture("cornell").file, home.path().join("out.glb"));
    for (options, why) in [
        (&["--format", "jpeg"][..], "jpeg"),
        (&["--format", "exr,"], "--format"),
        (&["--format", "hdr,png", "--exr-image"], "--exr-image"),
        (&["--format", "ktx2", "--preview-gltf"], "--preview-gltf"),
        (&["--config", text(&config)], "--exr-image"),
    ] {
        let done = texelwalk(&[&["bake", text(&input), "-o", text(&output)], options].concat());
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.code() == Some(2) && said.contains(why), "{options:?}: {said}");
    }
    assert!(!output.exists());
}

/// The picture that `render` makes of a baked document.
fn rendered(home: &Path) -> image::RgbImage {
    let (document, view) = (home.join("out.gltf"), home.join("view.png"));
    let size = ["--width", "96", "--height", "64", "--samples", "4", "--exposure", "0"];
    let done = texelwalk(&[&["render", text(&document), "-o", text(&view)], &size[..]].concat());
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    image::open(view).unwrap().into_rgb8()
}

#[test]
fn render_reads_what_can_be_read_and_says_what_cannot() {
    let expected = rendered(cornell(&["--mips", "2"]).0.path());
    assert!(expected.pixels().any(|p| p.0[0] > 64), "the picture shows something");
    for format in ["hdr", "png", "rgbm", "rgbd", "rgbe", "ktx2,rgbm", "rgbm,exr"] {
        let (home, files) = cornell(&["--format", format, "--mips", "2"]);
        assert_eq!(files.contains_key("out.lightmap0.exr"), format.contains("exr"));
        let worst = rendered(home.path()).iter().zip(expected.iter()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(worst <= if format.contains("exr") { 0 } else { 2 }, "{format}: {worst}");
    }
    let (home, _) = cornell(&["--format", "ktx2"]);
    let done = texelwalk(&["render", text(&home.path().join("out.gltf")), "-o", text(&home.path().join("v.png"))]);
    assert_eq!(done.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&done.stderr).contains("--format ktx2,exr"));
}

/// Where light is worth a copy of its manifest: a JSON file that `formats.py` reads, edited.
fn manifest(gltf: &Path, name: &str, edit: impl Fn(String) -> String) -> PathBuf {
    let document = json_of(&fs::read(gltf).unwrap());
    let path = gltf.with_file_name(format!("{name}.json"));
    fs::write(&path, edit(json!({"scenes": document["scenes"]}).to_string())).unwrap();
    path
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn others_decode_every_format_to_the_exr() {
    let out = folder("formats");
    let options = ["--preset", "preview", "--format", ALL, "--light-groups", "--page-size", "128"];
    let office = bake(&fixture("office"), &out, &options);
    let courtyard = bake(&fixture("courtyard"), &out, &options);
    assert!(office.pages.len() > 3, "several pages and groups");
    let group = manifest(&courtyard.gltf, "group", |text| {
        text.replace("lightmap", "lightmap-sky").replace("lightmap-sky\"", "lightmap\"")
    });
    accepts("checks/formats.py", &[text(&office.gltf), text(&courtyard.gltf), text(&group)]);
}

/// Pages that no scene has: half floats from the smallest to the largest, and black.
#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn others_decode_the_extremes() {
    let out = folder("formats_extremes");
    let smooth = |i: u32| libm::exp2f(i as f32 / 64.0 * 40.0 / 64.0 - 24.0).min(65504.0);
    let texel = |x: u32, y: u32| {
        let value = smooth(64 * (y / 4 * 4) + x);
        [value, value * 0.75, value * 0.25, f32::from(u8::from(y % 16 < 13 && x < 60))]
    };
    let page = |value: &dyn Fn(u32, u32) -> [f32; 4]| Page {
        width: 63,
        height: 66,
        pixels: (0..63 * 66).map(|i| value(i % 63, i / 63)).collect(),
    };
    for (name, page) in [("range", page(&texel)), ("black", page(&|_, _| [0.0, 0.0, 0.0, 1.0]))] {
        let document = out.join(format!("{name}.gltf"));
        let mut pages = names::page_files(&document, 1);
        let mut lightmap = Lightmap { pages: vec![page] };
        dilate(&mut lightmap.pages[0], 2);
        let plan = Plan::new(&Format::ALL, 0, &lightmap);
        plan.name(&mut pages, false);
        let attributes = BTreeMap::from([("texelwalk.quantity".to_owned(), "radiosity".to_owned())]);
        let files = plan.encode(&pages[0].exr, &lightmap.pages[0], &attributes).unwrap();
        files.iter().for_each(|(path, bytes)| fs::write(path, bytes.to_vec()).unwrap());
        let entries: Vec<Value> = pages[0].files.iter().map(entry).collect();
        let listed =
            json!({"scenes": [{"extras": {"lightmap": {"pages": [{"uri": entries[0]["uri"], "files": entries}]}}}]});
        let path = out.join(format!("{name}.json"));
        fs::write(&path, listed.to_string()).unwrap();
        accepts("checks/formats.py", &[text(&path)]);
    }
}

/// What a manifest says of a file; the formulas are spelled again here.
fn entry(file: &texelwalk::output::formats::PageFile) -> Value {
    let decode = match file.coding.format {
        Format::Png => "rgb*scale",
        Format::Rgbm => "(8*a*rgb)^2*scale",
        Format::Rgbd => "rgb^2.2/a*scale",
        Format::Rgbe => "rgb*2^(255*a-128)",
        Format::Exr | Format::Hdr | Format::Ktx2 => "rgb",
    };
    let uri = file.path.file_name().unwrap().to_str().unwrap();
    json!({"format": file.coding.format.name(), "uri": uri, "decode": decode, "scale": file.coding.scale})
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn format_check_rejects_other_light_other_scales_and_damaged_files() {
    let out = folder("formats_rejects");
    let baked = bake(&fixture("cornell"), &out, &["--preset", "preview", "--format", ALL]);
    let file = |ending: &str| out.join(format!("cornell.lightmap0.{ending}"));
    let plain = manifest(&baked.gltf, "plain", |t| t);
    accepts("checks/formats.py", &[text(&plain)]);
    for (name, from, to) in [
        ("png", "\"png\",\"scale\":", "\"png\",\"scale\":2"),
        ("rgbm", "lightmap0.rgbm.png", "lightmap0.rgbe.png"),
        ("rgbd", "lightmap0.rgbd.png", "lightmap0.rgbm.png"),
        ("rgbe", "rgb*2^(255*a-128)", "rgb"),
        ("hdr", "lightmap0.hdr", "lightmap0.none"),
    ] {
        let sorted = |t: String| t.replace(from, to);
        let wrong = manifest(&baked.gltf, "wrong", sorted);
        assert_ne!(fs::read(&wrong).unwrap(), fs::read(&plain).unwrap(), "{name}");
        rejects("checks/formats.py", &[text(&wrong)], &format!("{name}: "));
    }
    let ktx2 = fs::read(file("ktx2")).unwrap();
    let first_level = u64::from_le_bytes(ktx2[80..88].try_into().unwrap()) as usize;
    for (at, why) in [(12, "vkFormat"), (first_level + 1, "PSNR"), (104, "levels do not lie"), (0, "ktx-parse refuses")]
    {
        let mut bytes = ktx2.clone();
        // A whole row of blocks, else one byte.
        let end = if at == first_level + 1 { at + 512 } else { at + 1 };
        bytes[at..end].iter_mut().for_each(|b| *b ^= 0x15);
        fs::write(file("ktx2"), bytes).unwrap();
        rejects("checks/formats.py", &[text(&plain)], why);
    }
    fs::write(file("ktx2"), ktx2).unwrap();
    let exr = fs::read(file("exr")).unwrap();
    brighten(&file("exr"), 1.02);
    let (_, said) = crosscheck_env::python("checks/formats.py", &[text(&plain)]);
    for name in ["hdr", "png", "rgbm", "rgbd", "rgbe"] {
        assert!(said.contains(&format!("FAULT  {name:<5}")), "2 % more light is not noticed in {name}:\n{said}");
    }
    fs::write(file("exr"), exr).unwrap();
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn exr_images_and_previews_are_valid_and_blender_shows_them() {
    let (image, type_too) = ("IMAGE_UNRECOGNIZED_FORMAT", "IMAGE_UNRECOGNIZED_FORMAT,VALUE_NOT_IN_LIST");
    for (name, ending) in [("office", "glb"), ("courtyard", "gltf")] {
        let out = folder(&format!("preview_{name}"));
        let options = ["--preset", "preview", "--preview-gltf", "--page-size", "128", "--format", "rgbm,exr"];
        let plain = bake(&fixture(name), &out, &options);
        let preview = out.join(format!("{name}.preview.{ending}"));
        let input = text(&plain.fixture.file);
        accepts("checks/validate.py", &["--input", input, text(&plain.gltf)]);
        accepts("checks/validate.py", &["--input", input, "--expect", image, text(&preview)]);
        let pages: Vec<&str> = plain.pages.iter().map(|p| text(p)).collect();
        assert!(pages.len() > 1);
        accepts("checks/preview.py", &[&[text(&preview)], &pages[..]].concat());
        // The document itself shows the PNG.
        rejects("checks/preview.py", &[&[text(&plain.gltf)], &pages[..1]].concat(), "0 images show it");

        let exr_image = bake(&fixture(name), &out, &[&options[..], &["--exr-image"]].concat());
        accepts("checks/validate.py", &["--input", input, "--expect", type_too, text(&exr_image.gltf)]);
        accepts("checks/validate.py", &["--input", input, "--expect", image, text(&preview)]);
        rejects("checks/validate.py", &["--input", input, text(&exr_image.gltf)], "VALUE_NOT_IN_LIST");
        rejects("checks/validate.py", &["--expect", "NO_SUCH_CODE", text(&plain.gltf)], "NO_SUCH_CODE is missing");
        accepts("checks/preserved.py", &[input, text(&exr_image.gltf)]);
        brighten(&plain.pages[0], 0.5);
        accepts("checks/preview.py", &[text(&preview), pages[0]]);
    }
}
