//! `MSFT_texture_dds`: pixels are those of the format's definition and of OpenImageIO, and no claim of a header is trusted.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "tests")]

#[path = "support/crosscheck_env.rs"]
mod crosscheck_env;
#[path = "support/gltf_builder.rs"]
mod gltf_builder;

use gltf_builder::Builder;
use std::path::Path;
use texelwalk::base::Stream;
use texelwalk::base::random::Stage;
use texelwalk::scene::{Class, Error, Scene, Settings, load_bytes};

/// A square whose base colour is an image of DDS.
fn square(dds: &[u8]) -> Builder {
    Builder::textured(dds, "image/vnd-ms.dds", "MSFT_texture_dds")
}

fn read(dds: &[u8]) -> Result<Scene, Error> {
    let loaded = load_bytes(square(dds).gltf(), Path::new("a.gltf"), &Settings::default())?;
    assert_eq!(loaded.warnings, []);
    Ok(loaded.output)
}

/// A file of one level; `words` are (offset, value) pairs of the header.
fn file(width: u32, height: u32, words: &[(usize, u32)], data: &[u8]) -> Vec<u8> {
    let longer = words.iter().any(|w| w.0 >= 128);
    let mut bytes = vec![0u8; if longer { 148 } else { 128 }];
    let common =
        [(0, u32::from_le_bytes(*b"DDS ")), (4, 124), (8, 0x1007), (12, height), (16, width), (28, 1), (76, 32)];
    for (at, value) in common.iter().chain([(108, 0x1000)].iter()).chain(words) {
        bytes[*at..at + 4].copy_from_slice(&value.to_le_bytes());
    }
    bytes.extend_from_slice(data);
    bytes
}

fn four_cc(code: &[u8; 4]) -> Vec<(usize, u32)> {
    vec![(80, 4), (84, u32::from_le_bytes(*code))]
}

fn dx10(format: u32) -> Vec<(usize, u32)> {
    [four_cc(b"DX10"), vec![(128, format), (132, 3), (140, 1)]].concat()
}

/// Red above blue in RGB565, then two bits a pixel: pixel k of each row has colour k of 0, 1, 2/3 + 1/3, 1/3 + 2/3.
const BLOCK: [u8; 8] = [0x00, 0xf8, 0x1f, 0x00, 0b1110_0100, 0b1110_0100, 0b1110_0100, 0b1110_0100];

#[test]
fn blocks_and_plain_pixels_are_read_as_defined() {
    // 6 × 5 pixels: blocks stick out to the right and below.
    let scene = read(&file(6, 5, &four_cc(b"DXT1"), &BLOCK.repeat(4))).unwrap();
    let texture = &scene.textures[0];
    assert_eq!((texture.width, texture.height, texture.pixels.len()), (6, 5, 30));
    let colors = [[255, 0, 0, 255], [0, 0, 255, 255], [170, 0, 85, 255], [85, 0, 170, 255]];
    for (k, pixel) in texture.pixels.iter().enumerate() {
        assert_eq!(*pixel, colors[k % 6 % 4], "{k}");
    }
    let same = read(&file(6, 5, &dx10(72), &BLOCK.repeat(4))).unwrap();
    assert_eq!(same.textures[0].pixels, texture.pixels);
    let masks = [(80, 0x41), (88, 32), (92, 0xff_0000), (96, 0xff00), (100, 0xff), (104, 0xff00_0000)];
    let plain = read(&file(2, 1, &masks, &[3, 2, 1, 4, 7, 6, 5, 8])).unwrap();
    assert_eq!(plain.textures[0].pixels, [[1, 2, 3, 4], [5, 6, 7, 8]]);
    let opaque = read(&file(2, 1, &dx10(88), &[3, 2, 1, 4, 7, 6, 5, 8])).unwrap();
    assert_eq!(opaque.textures[0].pixels, [[1, 2, 3, 255], [5, 6, 7, 255]]);
}

#[test]
fn what_cannot_be_read_is_refused() {
    let refused = |bytes: &[u8], class: Class, words: &[&str]| {
        let error = read(bytes).unwrap_err();
        let message = error.to_string();
        assert!(words.iter().chain(&["image 0", "Wood"]).all(|w| message.contains(w)), "{message}");
        assert_eq!(error.class(), class, "{message}");
    };
    let good = file(4, 4, &four_cc(b"DXT1"), &BLOCK);
    for length in [4, 20, 87, 115] {
        refused(&good[..length], Class::Invalid, &["truncated"]);
    }
    refused(&good[..135], Class::Invalid, &["claims 4 × 4 pixels in 8 bytes, but has 7"]);
    for (width, height) in [(u32::MAX, u32::MAX), (1 << 16, 4), (4, 8)] {
        refused(&file(width, height, &four_cc(b"DXT1"), &BLOCK), Class::Invalid, &["claims"]);
    }
    refused(&file(0, 4, &four_cc(b"DXT1"), &BLOCK), Class::Invalid, &["no pixels"]);
    refused(&file(4, 4, &four_cc(b"ATI2"), &BLOCK.repeat(2)), Class::Unsupported, &["four-character code"]);
    refused(&file(4, 4, &dx10(95), &BLOCK.repeat(2)), Class::Unsupported, &["DXGI format 95"]);
    refused(&file(4, 4, &[(80, 0x40), (88, 16)], &BLOCK.repeat(4)), Class::Unsupported, &["16 bits"]);
    let cube = [four_cc(b"DXT1"), vec![(112, 0xfe00)]].concat();
    refused(&file(4, 4, &cube, &BLOCK.repeat(6)), Class::Unsupported, &["several pictures"]);
    let array = [dx10(71), vec![(140, 9)]].concat();
    refused(&file(4, 4, &array, &BLOCK.repeat(9)), Class::Unsupported, &["several pictures"]);
}

#[test]
#[ignore = "slow: makes a Python environment, minutes"]
fn pixels_are_those_of_openimageio() {
    let folder = crosscheck_env::folder("dds");
    let mut arguments = vec![];
    let mut random = Stream::new(5, Stage::Render, 0, 0);
    for (name, words, size) in [
        ("bc1", four_cc(b"DXT1"), 8),
        ("bc2", four_cc(b"DXT3"), 16),
        ("bc3", four_cc(b"DXT5"), 16),
        ("bc7", dx10(98), 16),
    ] {
        let data: Vec<u8> = (0..16 * 16 * size).map(|_| random.next_u32() as u8).collect();
        let bytes = file(64, 64, &words, &data);
        let (path, pixels) = (folder.join(format!("{name}.dds")), folder.join(format!("{name}.rgba")));
        std::fs::write(&path, &bytes).unwrap();
        std::fs::write(&pixels, read(&bytes).unwrap().textures[0].pixels.as_flattened()).unwrap();
        arguments.extend([path, pixels]);
    }
    let arguments: Vec<&str> = arguments.iter().map(|p| crosscheck_env::text(p)).collect();
    crosscheck_env::accepts("checks/dds.py", &arguments);
    let mixed = [arguments[0], arguments[3]];
    crosscheck_env::rejects("checks/dds.py", &mixed, "apart");
}
