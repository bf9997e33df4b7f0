//! Broken and hostile documents: the right class of error, one clear message, no panic, at once.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

#[path = "support/hostile.rs"]
mod hostile;
#[path = "support/odd.rs"]
mod odd;
#[path = "support/rich.rs"]
mod rich;

use hostile::builder as gltf_builder;
use std::time::Duration;
use std::time::Instant;
use texelwalk::scene;
use texelwalk::trace::Tracer;

/// Longest that a refusal may take. The slowest cases parse a few megabytes; a hundred times less is usual. (2.7 s were
/// measured beside four busy programs.)
const PATIENCE: Duration = Duration::from_secs(5);

#[test]
fn every_case_is_refused_with_its_class_and_a_clear_message() {
    let cases = hostile::cases();
    assert!(cases.len() >= 110, "{}", cases.len());
    let mut faults = Vec::new();
    for case in &cases {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in &case.files {
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        let start = Instant::now();
        let result =
            std::panic::catch_unwind(|| scene::load(&folder.path().join(case.main), &scene::Settings::default()));
        let took = start.elapsed();
        let error = match result {
            Err(_) => {
                faults.push(format!("{}: panicked", case.name));
                continue;
            }
            Ok(Ok(_)) => {
                faults.push(format!("{}: was loaded", case.name));
                continue;
            }
            Ok(Err(error)) => error,
        };
        let expected = match case.class {
            hostile::Class::Unsupported => scene::Class::Unsupported,
            hostile::Class::Invalid => scene::Class::Invalid,
            hostile::Class::Io => scene::Class::Io,
        };
        let message = error.to_string();
        if error.class() != expected {
            faults.push(format!("{}: {:?} instead of {expected:?}: {message}", case.name, error.class()));
        }
        for word in &case.message_contains {
            if !message.contains(word) {
                faults.push(format!("{}: `{word}` is missing in: {message}", case.name));
            }
        }
        if message.contains('\n') || message.len() > 500 {
            faults.push(format!("{}: not one short line: {message}", case.name));
        }
        if took > PATIENCE {
            faults.push(format!("{}: took {took:?}", case.name));
        }
    }
    assert!(faults.is_empty(), "{} of {} cases:\n{}", faults.len(), cases.len(), faults.join("\n"));
}

#[test]
fn case_names_are_distinct() {
    let mut names: Vec<_> = hostile::cases().iter().map(|c| c.name).collect();
    names.sort_unstable();
    assert!(names.windows(2).all(|w| w[0] != w[1]));
}

/// Writes files into a folder, which it makes.
fn write(folder: &std::path::Path, name: &str, bytes: &[u8]) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn odd_documents_load_and_can_be_charted() {
    let cases = odd::cases();
    assert!(cases.len() >= 28, "{}", cases.len());
    let mut faults = Vec::new();
    for case in &cases {
        let folder = tempfile::tempdir().unwrap();
        case.files.iter().for_each(|(name, bytes)| write(folder.path(), name, bytes));
        let loaded = match scene::load(&folder.path().join(case.main), &scene::Settings::default()) {
            Ok(loaded) => loaded,
            Err(error) => {
                faults.push(format!("{}: {error}", case.name));
                continue;
            }
        };
        let (scene, count) = (&loaded.output, loaded.output.triangles.len());
        if count != case.triangles || !(case.holds)(scene) {
            faults.push(format!("{}: {count} triangles, or not what they should be", case.name));
        }
        let mut codes: Vec<&str> = loaded.warnings.iter().map(|w| w.code).collect();
        codes.dedup();
        if codes != case.warnings {
            faults.push(format!("{}: warnings {codes:?}", case.name));
        }
        let how =
            texelwalk::atlas::Settings { page_size: 1024, max_pages: Some(1), ..texelwalk::atlas::Settings::default() };
        match texelwalk::atlas::build(&Tracer::new(scene), &how) {
            Ok(atlas) if atlas.output.pages == 1 => {}
            Ok(atlas) => faults.push(format!("{}: {} pages", case.name, atlas.output.pages)),
            Err(error) => faults.push(format!("{}: no atlas: {error}", case.name)),
        }
    }
    assert!(faults.is_empty(), "{} of {} cases:\n{}", faults.len(), cases.len(), faults.join("\n"));
}

/// Links are followed, as everywhere; what is at their end must be a file.
#[cfg(unix)]
#[test]
fn links_are_followed_to_files_alone() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let mut b = hostile::builder::Builder::triangle();
    b.json["buffers"][0]["uri"] = serde_json::json!("a.bin");
    write(folder.path(), "real.gltf", &b.gltf());
    write(folder.path(), "real.bin", &b.bin);
    let at = |name: &str| folder.path().join(name);
    symlink("real.gltf", at("a.gltf")).unwrap();
    let load = || scene::load(&at("a.gltf"), &scene::Settings::default()).map_err(|e| (e.class(), e.to_string()));
    symlink("real.bin", at("a.bin")).unwrap();
    assert_eq!(load().unwrap().output.triangles.len(), 1);
    for (target, class, word) in [
        ("a.bin", scene::Class::Io, "a.bin"),
        ("/dev/zero", scene::Class::Io, "not a regular file"),
        (".", scene::Class::Io, "not a regular file"),
        ("nowhere", scene::Class::Invalid, "a.bin"),
    ] {
        std::fs::remove_file(at("a.bin")).unwrap();
        symlink(target, at("a.bin")).unwrap();
        let (found, message) = load().unwrap_err();
        assert!(found == class && message.contains(word), "link to {target}: {found:?} {message}");
    }
}

/// The document that most cases change is fine by itself, so each refusal is due to the change.
#[test]
fn the_unchanged_document_loads() {
    let path = std::path::Path::new("a.gltf");
    for bytes in [hostile::builder::Builder::triangle().gltf(), hostile::builder::Builder::triangle().glb(&[])] {
        let loaded = scene::load_bytes(bytes, path, &scene::Settings::default()).unwrap();
        assert_eq!(loaded.output.triangles, [[0, 1, 2]]);
        assert_eq!(loaded.warnings, []);
    }
}

/// Every prefix and every single changed byte of a small file: whatever comes out, it is no panic.
#[test]
fn prefixes_and_flipped_bytes_never_panic() {
    let path = std::path::Path::new("a.glb");
    let mut b = hostile::builder::Builder::square(serde_json::json!({
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "BLEND"
    }));
    b.texture(2, &[[9, 8, 7, 6]; 4]);
    let good = b.glb(&[]);
    let mut loaded = 0;
    for end in 0..good.len() {
        assert!(scene::load_bytes(good[..end].to_vec(), path, &scene::Settings::default()).is_err());
    }
    for at in 0..good.len() {
        for flip in [0x01, 0x10, 0xff] {
            let mut bad = good.clone();
            bad[at] ^= flip;
            loaded += usize::from(scene::load_bytes(bad, path, &scene::Settings::default()).is_ok());
        }
    }
    assert!(loaded > 100, "only {loaded} changed files still load: the test no longer reaches the decoder");
}

/// Paths to everything in a document.
fn pointers(value: &serde_json::Value, here: &str, out: &mut Vec<String>) {
    out.push(here.to_owned());
    if let Some(object) = value.as_object() {
        object.iter().for_each(|(key, value)| pointers(value, &format!("{here}/{key}"), out));
    }
    if let Some(array) = value.as_array() {
        array.iter().enumerate().for_each(|(i, value)| pointers(value, &format!("{here}/{i}"), out));
    }
}

/// Each value of a document in turn becomes something else: the reader returns, and what it accepts is finite.
#[test]
fn any_value_may_be_anything() {
    use serde_json::json;
    let good: serde_json::Value = serde_json::from_slice(&rich::document().gltf()).unwrap();
    let load = |json: &serde_json::Value| {
        scene::load_bytes(json.to_string().into_bytes(), std::path::Path::new("a.gltf"), &scene::Settings::default())
    };
    let first = load(&good).unwrap();
    assert!(first.output.parts.len() == 2 && first.output.lights.len() == 1 && first.output.cameras.len() == 1);
    let mut places = Vec::new();
    pointers(&good, "", &mut places);
    assert!(places.len() > 200, "{}", places.len());
    let odd = [
        json!(-1),
        json!(0),
        json!(0.5),
        json!(1),
        json!(7),
        json!(1_000_000_000),
        json!(u64::MAX),
        json!(1e308),
        json!(-1e39),
        json!(1e-320),
        json!("x"),
        json!(""),
        json!(null),
        json!(true),
        json!([]),
        json!([0]),
        json!({}),
    ];
    let (mut accepted, mut refused) = (0, 0);
    for place in &places {
        for value in &odd {
            let mut json = good.clone();
            *json.pointer_mut(place).unwrap() = value.clone();
            match load(&json) {
                Err(_) => refused += 1,
                Ok(loaded) => {
                    accepted += 1;
                    let v = &loaded.output.vertices;
                    assert!(v.position.iter().chain(&v.normal).all(|p| p.is_finite()), "{place} = {value}");
                    assert!(v.uv.iter().flatten().all(|t| t.is_finite()), "{place} = {value}");
                    let b = glam::Vec2::splat(0.3);
                    for t in 0..loaded.output.triangles.len() as u32 {
                        let scene = &loaded.output;
                        let light = scene.reflectance(t, b) + scene.emission(t, b);
                        assert!(light.is_finite() && light.min_element() >= 0.0, "{place} = {value}: {light}");
                        assert!((0.0..=1.0).contains(&scene.opacity(t, b)), "{place} = {value}");
                    }
                }
            }
        }
    }
    assert!(accepted > 500 && refused > 500, "{accepted} accepted, {refused} refused");
}
