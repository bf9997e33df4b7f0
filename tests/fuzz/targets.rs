//! The readers that are fed: each target makes one changed input and runs the library on it.
//!
//! A target returns what became of its input, or panics where what was accepted breaks a promise of the library.

use crate::mutate::{self, Random};
use crate::samples::{self, Document, Samples};
use glam::Vec2;
use std::fs;
use std::path::Path;
use texelwalk::output::gltf::{Quantity, write_gltf};
use texelwalk::output::names::page_files;
use texelwalk::output::{exr, gltf};
use texelwalk::render::{self, Lightmaps};
use texelwalk::scene::{self, Environment, Scene, ies};
use texelwalk::settings::{Options, Preset};
use texelwalk::trace::Tracer;
use texelwalk::{atlas, check};

/// What became of an input.
pub(crate) struct Outcome {
    /// Its size [bytes].
    pub(crate) bytes: usize,
    pub(crate) accepted: bool,
}

/// One reader.
pub(crate) struct Target {
    pub(crate) name: &'static str,
    pub(crate) run: fn(&Samples, &mut Random) -> Outcome,
    /// Executions of 1000.
    pub(crate) share: u64,
}

/// All of them. Shares follow from how much there is to find and what an execution costs.
pub(crate) const ALL: [Target; 10] = [
    Target { name: "document", run: document, share: 420 },
    Target { name: "image", run: image, share: 170 },
    Target { name: "configuration", run: configuration, share: 100 },
    Target { name: "environment", run: environment, share: 80 },
    Target { name: "picture", run: picture, share: 80 },
    Target { name: "rewrite", run: rewrite, share: 60 },
    Target { name: "baked", run: baked, share: 40 },
    Target { name: "ies", run: lamp, share: 40 },
    Target { name: "check", run: checked, share: 6 },
    Target { name: "bake", run: bake, share: 4 },
];

/// A document with its parts or its text changed, as GLB or as JSON with everything in it.
fn changed(samples: &Samples, random: &mut Random) -> Vec<u8> {
    let mut document = random.pick(&samples.documents).clone();
    if !random.one_in(4) {
        mutate::json(&mut document.json, random);
    }
    if random.one_in(3) {
        let donor = &random.pick(&samples.documents).bin;
        mutate::bytes(&mut document.bin, donor, random);
    }
    let mut file = if random.one_in(2) { document.glb() } else { with_data_uri(&document) };
    match random.below(8) {
        0 => mutate::bytes(&mut file, &[], random),
        1 => mutate::text(&mut file, random),
        _ => {}
    }
    file
}

fn with_data_uri(document: &Document) -> Vec<u8> {
    let mut json = document.json.clone();
    if let Some(buffer) = json.pointer_mut("/buffers/0").and_then(|b| b.as_object_mut()) {
        let uri = crate::gltf_builder::data_uri("application/octet-stream", &document.bin);
        buffer.entry("uri").or_insert(uri.into());
    }
    json.to_string().into_bytes()
}

fn load(bytes: &[u8]) -> Option<Scene> {
    // A variant is asked for where a document says its name, in whatever place.
    let variant = bytes.windows(7).any(|w| w == b"\"night\"").then(|| "night".to_owned());
    let how = scene::Settings { variant, normal_maps: true, ..scene::Settings::default() };
    match scene::load_bytes(bytes.to_vec(), Path::new("/nowhere/a.gltf"), &how) {
        Ok(loaded) => Some(loaded.output),
        Err(error) => {
            let message = error.to_string();
            assert!(!message.contains('\n') && message.len() < 700, "not one short line: {message}");
            None
        }
    }
}

/// The promises of the loader: everything finite, reflectance and opacity in [0, 1], indices in range.
fn assert_sound(scene: &Scene) {
    let vertices = &scene.vertices;
    assert!(vertices.position.iter().chain(&vertices.normal).all(|p| p.is_finite()));
    assert!(vertices.uv.iter().flatten().all(|t| t.is_finite()));
    assert!(scene.triangles.iter().flatten().all(|&v| (v as usize) < vertices.position.len()));
    let count = scene.triangles.len();
    for t in (0..count).step_by(count.div_ceil(64).max(1)).map(|t| t as u32) {
        for at in [Vec2::ZERO, Vec2::new(0.3, 0.4)] {
            let (reflectance, emission) = (scene.reflectance(t, at), scene.emission(t, at));
            assert!(reflectance.is_finite() && reflectance.min_element() >= 0.0, "reflectance {reflectance}");
            assert!(emission.is_finite() && emission.min_element() >= 0.0, "emission {emission}");
            assert!((0.0..=1.0).contains(&scene.opacity(t, at)));
        }
    }
}

fn document(samples: &Samples, random: &mut Random) -> Outcome {
    let file = changed(samples, random);
    let scene = load(&file);
    scene.iter().for_each(assert_sound);
    Outcome { bytes: file.len(), accepted: scene.is_some() }
}

fn image(samples: &Samples, random: &mut Random) -> Outcome {
    let mut image = random.pick(&samples.images).clone();
    let donor = random.pick(&samples.images);
    mutate::bytes(&mut image, donor, random);
    // Without right checksums a changed PNG goes no further than these.
    if !random.one_in(8) {
        repair_checksums(&mut image);
    }
    let file = samples::textured(&image).glb(&[]);
    let scene = load(&file);
    scene.iter().for_each(assert_sound);
    Outcome { bytes: file.len(), accepted: scene.is_some() }
}

/// Writes the checksum of every chunk of a PNG anew.
fn repair_checksums(png: &mut [u8]) {
    let mut at = 8;
    while png.starts_with(b"\x89PNG") && at + 12 <= png.len() {
        let length = u32::from_be_bytes(png[at..at + 4].try_into().unwrap()) as usize;
        let Some(end) = (at + 8).checked_add(length).filter(|end| end + 4 <= png.len()) else { return };
        let crc = crc32(&png[at + 4..end]);
        png[end..end + 4].copy_from_slice(&crc.to_be_bytes());
        at = end + 4;
    }
}

/// CRC-32 as PNG uses it (ISO 3309), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    })
}

fn configuration(samples: &Samples, random: &mut Random) -> Outcome {
    let mut text = random.pick(&samples.configurations).clone().into_bytes();
    mutate::text(&mut text, random);
    let bytes = text.len();
    let options = String::from_utf8(text).ok().and_then(|text| Options::from_toml(&text).ok());
    let settings = options.and_then(|options| options.over(Options::preset(Preset::Preview).unwrap()).settings().ok());
    if let Some(settings) = &settings {
        assert!(settings.texels_per_meter > 0.0 && settings.texels_per_meter.is_finite());
        assert!(serde_json::to_string(settings).is_ok());
    }
    Outcome { bytes, accepted: settings.is_some() }
}

/// A changed picture on the disk, for readers that take paths.
fn changed_picture(samples: &Samples, random: &mut Random) -> (std::path::PathBuf, usize) {
    let mut picture = random.pick(&samples.pictures).clone();
    let donor = random.pick(&samples.pictures);
    mutate::bytes(&mut picture, donor, random);
    let path = samples.path("picture");
    fs::write(&path, &picture).unwrap();
    (path, picture.len())
}

fn environment(samples: &Samples, random: &mut Random) -> Outcome {
    let (path, bytes) = changed_picture(samples, random);
    let map = Environment::load(&path, 2.0, 1.0);
    if let Ok(map) = map.as_ref().map(|map| &map.output) {
        let [width, height] = map.size();
        assert!(width > 0 && height > 0);
        for toward in [glam::Vec3::X, glam::Vec3::NEG_Y, glam::Vec3::new(0.6, 0.0, -0.8)] {
            let radiance = map.radiance(toward);
            assert!(radiance.is_finite() && radiance.min_element() >= 0.0);
        }
    }
    Outcome { bytes, accepted: map.is_ok() }
}

/// An IES file; what is read has no surprises in any direction.
fn lamp(samples: &Samples, random: &mut Random) -> Outcome {
    let mut text = random.pick(&samples.lamps).clone().into_bytes();
    if random.one_in(4) {
        mutate::bytes(&mut text, random.pick(&samples.lamps).as_bytes(), random);
    } else {
        mutate::text(&mut text, random);
    }
    let read = ies::read(&text);
    match &read {
        Ok(ies::Read { profile, .. }) => {
            assert!(profile.flux().is_finite() && profile.flux() >= 0.0 && profile.peak().is_finite());
            let drawn = [0.0, 0.3, 0.999_999].map(|u| profile.sample(Vec2::new(u, 1.0 - u))).into_iter().flatten();
            let ends = [glam::Vec3::X, glam::Vec3::NEG_Z, glam::Vec3::new(0.6, 0.0, -0.8)].map(|d| (d, 0.0));
            for (direction, weight) in drawn.chain(ends) {
                let candela = profile.candela(direction);
                assert!(weight.is_finite() && (0.0..=profile.peak()).contains(&candela));
            }
        }
        Err(error) => assert!(error.to_string().len() < 700, "{error}"),
    }
    Outcome { bytes: text.len(), accepted: read.is_ok() }
}

fn picture(samples: &Samples, random: &mut Random) -> Outcome {
    let (path, bytes) = changed_picture(samples, random);
    let image = exr::read_rgba(&path);
    if let Ok(image) = &image {
        assert_eq!(image.pixels.len(), image.width as usize * image.height as usize);
    }
    Outcome { bytes, accepted: image.is_ok() }
}

/// What loads can be charted and written, and what is written loads.
fn rewrite(samples: &Samples, random: &mut Random) -> Outcome {
    let file = changed(samples, random);
    let bytes = file.len();
    let Some(scene) = load(&file) else { return Outcome { bytes, accepted: false } };
    let how = atlas::Settings {
        texels_per_meter: 4.0,
        page_size: 64,
        max_pages: Some(4),
        padding: 1,
        ..atlas::Settings::default()
    };
    let Ok(atlas) = atlas::build(&Tracer::new(&scene), &how) else { return Outcome { bytes, accepted: false } };
    let output = samples.path("out.glb");
    let settings = gltf::Settings {
        quantity: Quantity::Radiosity,
        output: output.clone(),
        generator: "fuzz".to_owned(),
        quantize_uv: false,
    };
    let Ok(written) = write_gltf(&scene, &atlas.output, &page_files(&output, atlas.output.pages), &settings) else {
        return Outcome { bytes, accepted: false };
    };
    let (_, glb) = written.output.last().unwrap();
    let again = scene::load_bytes(glb.to_vec(), &output, &scene::Settings::default());
    let again = again.unwrap_or_else(|e| panic!("what was written does not load: {e}")).output;
    assert_eq!(again.triangles.len(), scene.triangles.len());
    Outcome { bytes, accepted: true }
}

/// A bake with its document or one of its pages changed; the path of its document.
fn changed_bake(samples: &Samples, random: &mut Random) -> (std::path::PathBuf, usize) {
    let mut document = samples.baked.clone();
    // All of them: what an execution finds must not depend on those before it.
    samples.pages.iter().for_each(|(path, bytes)| fs::write(path, bytes).unwrap());
    if random.one_in(2) {
        // A format that is not the first is read where the others are not listed.
        let files = document.json.pointer_mut("/textures/0/extras/lightmap/files").and_then(|f| f.as_array_mut());
        let files = files.expect("the sample lists its formats");
        let kept = files.swap_remove(random.below(files.len()));
        *files = vec![kept];
    }
    if random.one_in(2) {
        mutate::json(&mut document.json, random);
    } else {
        let (path, bytes) = random.pick(&samples.pages);
        let mut bytes = bytes.clone();
        mutate::bytes(&mut bytes, &random.pick(&samples.pages).1, random);
        repair_checksums(&mut bytes);
        fs::write(path, bytes).unwrap();
    }
    let path = samples.path("baked/box.glb");
    fs::write(&path, document.glb()).unwrap();
    (path, document.size() + samples.pages.iter().map(|(_, b)| b.len()).sum::<usize>())
}

/// Reads lightmaps as `render` does, and sometimes takes a picture.
fn baked(samples: &Samples, random: &mut Random) -> Outcome {
    let (path, bytes) = changed_bake(samples, random);
    let Ok(loaded) = scene::load(&path, &scene::Settings::default()) else { return Outcome { bytes, accepted: false } };
    let Ok(lightmaps) = Lightmaps::load(&loaded.output) else { return Outcome { bytes, accepted: false } };
    if random.one_in(8) {
        let how = render::Settings { width: 8, height: 6, samples: 1, ..render::Settings::default() };
        let _ = render::render(&loaded.output, &lightmaps, &how);
    }
    Outcome { bytes, accepted: true }
}

/// What the check says of the bake that lies there.
pub(crate) fn check(samples: &Samples) -> Result<check::Report, check::Error> {
    let baked = check::Baked::load(&samples.path("baked/box.glb"), None)?;
    check::check(&baked, &check::Settings::default())
}

fn checked(samples: &Samples, random: &mut Random) -> Outcome {
    let (_, bytes) = changed_bake(samples, random);
    let report = check(samples);
    if let Ok(report) = &report {
        assert!(!report.to_text().is_empty() && serde_json::from_str::<serde_json::Value>(&report.to_json()).is_ok());
    }
    Outcome { bytes, accepted: report.is_ok() }
}

/// The whole of it, from file to files.
fn bake(samples: &Samples, random: &mut Random) -> Outcome {
    let file = changed(samples, random);
    let bytes = file.len();
    let more = *random.pick(&[
        "",
        "cut-contacts = true",
        "target = \"vertex\"",
        "directional = \"sh\"",
        "format = [\"ktx2\"]",
        "aov = [\"stderr\", \"ao\"]",
    ]);
    let (input, output) = (samples.path("in.gltf"), samples.path("result/out.gltf"));
    fs::write(&input, file).unwrap();
    let outcome = samples::bake(&samples::bake_request(input, output.clone(), more));
    if let Ok(outcome) = &outcome {
        let values = outcome.lightmap.pages.iter().flat_map(|page| &page.pixels).flatten();
        assert!(values.clone().all(|v| v.is_finite() && *v >= 0.0), "a texel is negative or not finite");
        // Under the same sky: without one, the document's own image-based light would be read, too.
        let sky = scene::Sky::constant(texelwalk::base::Rgb::ONE);
        let again = scene::load(&output, &scene::Settings { sky, ..scene::Settings::default() });
        assert!(again.is_ok(), "what was written does not load: {}", again.unwrap_err());
    }
    Outcome { bytes, accepted: outcome.is_ok() }
}
