//! `KHR_texture_basisu`: pixels are those of the reference transcoder, and no damaged file is trusted.
//!
//! `support/basis/make.py` made the files, and the PNG beside each with the reference transcoder.

use crate::gltf_builder::Builder;
use serde_json::json;
use std::path::Path;
use std::path::PathBuf;
use std::process::Command;
use texelwalk::scene::Class;
use texelwalk::scene::Error;
use texelwalk::scene::Scene;
use texelwalk::scene::Settings;
use texelwalk::scene::load_bytes;

const NAMES: [&str; 4] = ["etc1s", "etc1s-alpha", "uastc", "uastc-zstd"];

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/basis").join(name)
}

/// A square whose base colour is an image of KTX2.
fn square(ktx2: &[u8]) -> Builder {
    Builder::textured(ktx2, "image/ktx2", "KHR_texture_basisu")
}

fn read(ktx2: &[u8]) -> Result<Scene, Error> {
    let loaded = load_bytes(square(ktx2).gltf(), Path::new("a.gltf"), &Settings::default())?;
    assert_eq!(loaded.warnings, []);
    Ok(loaded.output)
}

#[test]
fn pixels_are_those_of_the_reference_transcoder() {
    for name in NAMES {
        let scene = read(&std::fs::read(file(&format!("{name}.ktx2"))).unwrap()).unwrap();
        let expected = image::open(file(&format!("{name}.png"))).unwrap().into_rgba8();
        let texture = &scene.textures[0];
        assert_eq!((texture.width, texture.height), expected.dimensions(), "{name}");
        assert_eq!(texture.pixels.as_flattened(), expected.as_raw(), "{name}");
        // Loss is what is expected of the codecs, so a picture that is upside down or mixed up cannot pass.
        let at = |x: usize, y: usize| texture.pixels[y * 30 + x].map(i32::from);
        let near = |a: [i32; 4], b: [i32; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 60);
        assert!(near(at(1, 19), [8, 242, 40, 255]) && near(at(28, 1), [246, 12, 220, 255]), "{name}");
        assert_eq!(texture.pixels.iter().any(|p| p[3] < 60), ["etc1s-alpha", "uastc"].contains(&name), "{name}");
    }
}

#[test]
fn a_plain_image_beside_it_is_preferred() {
    let mut b = square(&std::fs::read(file("etc1s.ktx2")).unwrap());
    b.texture(1, &[[10, 20, 30, 255]]);
    b.json["textures"][0]["source"] = json!(1);
    b.json.as_object_mut().unwrap().remove("extensionsRequired");
    let scene = load_bytes(b.gltf(), Path::new("a.gltf"), &Settings::default()).unwrap().output;
    assert_eq!(scene.textures[0].pixels, [[10, 20, 30, 255]]);
}

#[test]
fn what_a_header_claims_is_not_believed() {
    let good = |name| std::fs::read(file(name)).unwrap();
    let refusal = |name, at: usize, bytes: &[u8]| {
        let mut changed = good(name);
        changed[at..at + bytes.len()].copy_from_slice(bytes);
        let error = read(&changed).unwrap_err();
        let message = error.to_string();
        assert!(message.contains("image 0") && message.contains("Wood"), "{message}");
        (error.class(), message)
    };
    let size = |width: u32, height: u32| [width.to_le_bytes(), height.to_le_bytes()].concat();
    assert_eq!(refusal("etc1s.ktx2", 20, &size(40_000, 4)).0, Class::Unsupported);
    assert!(refusal("etc1s.ktx2", 20, &size(16_384, 16_384)).1.contains("claims"));
    assert!(refusal("uastc-zstd.ktx2", 96, &(1u64 << 40).to_le_bytes()).1.contains("claims 1099511627776 bytes"));
    assert_eq!(refusal("etc1s.ktx2", 20, &size(0, 0)).0, Class::Invalid);
    assert_eq!(refusal("etc1s.ktx2", 36, &6u32.to_le_bytes()).0, Class::Invalid, "a cube");
    assert!(refusal("etc1s.ktx2", 5, b"11").1.contains("KTX 1"));
    assert!(read(&good("etc1s.ktx2")[..60]).unwrap_err().to_string().contains("truncated"));
}

/// Every byte changed in turn, and every length: refused or read, never a crash. The decoder's own panics are caught; a
/// message of theirs on stderr is all that is left.
#[test]
fn no_damaged_file_is_trusted() {
    for name in NAMES {
        let good = std::fs::read(file(&format!("{name}.ktx2"))).unwrap();
        for at in 0..good.len() {
            for flip in [0xff, 0x01, 0x80, 0x10] {
                let mut changed = good.clone();
                changed[at] ^= flip;
                let _ = read(&changed);
            }
            let _ = read(&good[..at]);
        }
    }
}

#[test]
fn the_output_keeps_the_texture_as_it_was() {
    let home = tempfile::tempdir().unwrap();
    let ktx2 = std::fs::read(file("etc1s.ktx2")).unwrap();
    let input = home.path().join("a.glb");
    std::fs::write(&input, square(&ktx2).glb(&[])).unwrap();
    let output = home.path().join("out/a.glb");
    let mut bake = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    bake.arg("bake").arg(&input).arg("-o").arg(&output).args(["--preset", "preview", "--sky", "1,1,1", "-q"]);
    let done = bake.arg("--usd").arg(home.path().join("out/a.usda")).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let baked = texelwalk::scene::load(&output, &Settings::default()).unwrap().output;
    assert_eq!(baked.document.buffer_view(3).unwrap(), ktx2);
    assert!(baked.document.json.contains("\"KHR_texture_basisu\":{\"source\":0}"));
    let names = std::fs::read_dir(home.path().join("out")).unwrap().map(|e| e.unwrap().file_name());
    let names: Vec<String> = names.map(|n| n.into_string().unwrap()).collect();
    assert!(names.iter().any(|n| n.ends_with("image0.png")), "USD readers know no KTX2: {names:?}");
}
