//! Small valid inputs of every kind, to be changed: documents, pictures, environment maps, lightmaps, configuration.

use crate::compressed;
use crate::gltf_builder::{Builder, data_uri, glb, png, words};
use crate::rich;
use image::{DynamicImage, ImageFormat};
use serde_json::{Value, json};
use std::f64::consts::FRAC_1_SQRT_2;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use texelwalk::bake::{self, Observer, Request};
use texelwalk::base::Progress;
use texelwalk::output::exr;
use texelwalk::settings::{Options, Preset};

/// A document in parts that can be changed by themselves.
#[derive(Clone)]
pub(crate) struct Document {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
}

impl Document {
    fn new(mut builder: Builder) -> Self {
        builder.json["buffers"][0]["byteLength"] = json!(builder.bin.len());
        Self { json: builder.json, bin: builder.bin }
    }

    pub(crate) fn glb(&self) -> Vec<u8> {
        glb(self.json.to_string().as_bytes(), Some(&self.bin), &[])
    }

    pub(crate) fn size(&self) -> usize {
        self.bin.len() + self.json.to_string().len()
    }
}

/// Everything that is changed, and a folder for what must lie on the disk.
pub(crate) struct Samples {
    pub(crate) documents: Vec<Document>,
    /// PNG of several kinds, JPEG, both kinds of WebP.
    pub(crate) images: Vec<Vec<u8>>,
    /// Radiance HDR and EXR with every compression that can be written.
    pub(crate) pictures: Vec<Vec<u8>>,
    pub(crate) configurations: Vec<String>,
    /// IES files of every photometric type.
    pub(crate) lamps: Vec<String>,
    /// A bake with its pages in every format.
    pub(crate) baked: Document,
    pub(crate) pages: Vec<(PathBuf, Vec<u8>)>,
    pub(crate) folder: tempfile::TempDir,
}

impl Samples {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let preview = png(1, &[[255; 4]]);
        (0..4).for_each(|k| fs::write(folder.path().join(format!("out.lightmap{k}.png")), &preview).unwrap());
        let (baked, pages) = baked(folder.path());
        let presets = [Preset::Preview, Preset::Production, Preset::Final, Preset::Paper];
        let preset = |p: &Preset| toml::to_string(&Options::preset(*p).unwrap()).unwrap();
        let mut configurations: Vec<String> = presets.iter().map(preset).collect();
        configurations.push(CONFIGURATION.to_owned());
        let (documents, images, pictures) = (documents(), images(), pictures());
        Self { documents, images, pictures, configurations, lamps: lamps(), baked, pages, folder }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

const CONFIGURATION: &str = "texel-size = 0.5\npage-size = 256\nmax-pages = 2\npadding = 3\nmips = 1\nuv = \"generate\"\n\
    format = [\"exr\", \"ktx2\"]\naov = [\"ao\", \"stderr\"]\nao-distance = 2.0\ndirectional = \"sh\"\nsky = [0.1, 0.2, 0.3]\n\
    sky-horizon = [1, 1, 1]\nsun-angle = 0.5\nenvironment = \"sky.hdr\"\nenvironment-rotation = -90.0\nseed = 7\n\
    target-error = 0.02\ntime-limit = 3.5\nbounces = 4\nthreads = 2\nlight-radius = 0.1\n";

fn lamps() -> Vec<String> {
    let file = |first: &str, tilt: &str, kind: u32, horizontal: &str, vertical: &str| {
        let [h, v] = [horizontal, vertical].map(|angles| angles.split(' ').count());
        let candela = (0..h * v).map(|k| format!("{}", 10 + 7 * k % 5)).collect::<Vec<_>>().join(" ");
        format!("{first}\nTILT={tilt}\n1 -1 1.5 {v} {h} {kind} 2 0 0.1 0\n1 1 9\n{vertical}\n{horizontal}\n{candela}\n")
    };
    vec![
        file("IESNA:LM-63-2002", "NONE", 1, "0", "0 45 90"),
        file("IESNA:LM-63-1995", "NONE", 1, "90 180 270", "0 30 60 90"),
        file("IES:LM-63-2019\n[TEST] 1", "NONE", 1, "0 90 180 270 360", "0 90 180"),
        file("IESNA91", "INCLUDE\n1\n2\n0 90\n1 0.9", 2, "0 45 90", "-90 0 90"),
        file("[TEST] 1986", "NONE", 3, "-90 0 90", "0 90"),
    ]
}

/// A triangle under lamps, one in a view and one in a URI.
fn lamp_over_triangle() -> Builder {
    let mut b = Builder::triangle();
    let lamps = lamps();
    let view = b.view(lamps[1].as_bytes(), json!({}));
    let uri = data_uri("application/x-ies-lm-63", lamps[3].as_bytes());
    let list = json!([{"bufferView": view, "mimeType": "application/x-ies-lm-63"}, {"uri": uri}]);
    let light = json!({"type": "spot", "extras": {"texelwalk": {"ies": uri}}});
    b.json["extensionsUsed"] = json!(["EXT_lights_ies", "KHR_lights_punctual"]);
    b.json["extensions"] = json!({"EXT_lights_ies": {"lights": list}, "KHR_lights_punctual": {"lights": [light]}});
    let own = |k: usize| {
        json!({"EXT_lights_ies": {"light": k, "multiplier": 2, "color": [1, 0.5, 1]},
        "KHR_lights_punctual": {"light": 0}})
    };
    b.push("nodes", json!({"translation": [0.3, 0.3, 2], "extensions": own(0)}));
    b.push("nodes", json!({"translation": [0.3, 0.1, 1], "rotation": [0.6, 0, 0, 0.8], "extensions": own(1)}));
    b
}

/// A sheet and a solid of coloured glass in variants and levels, under faces of a cube.
fn glass_under_cube() -> Builder {
    let volume = json!({"thicknessFactor": 0.1, "attenuationDistance": 0.2, "attenuationColor": [0.9, 0.5, 0.1]});
    let glass = json!({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.9}, "KHR_materials_volume": volume}});
    let mut b = Builder::square(json!({}));
    b.push("materials", glass);
    let mappings = json!([{"material": 1, "variants": [0]}]);
    b.set("/meshes/0/primitives/0/extensions", json!({"KHR_materials_variants": {"mappings": mappings}}));
    let position = b.floats("VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1.]);
    let indices = b.accessor(5121, "SCALAR", 12, &[0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3], json!({}));
    let solid = json!({"attributes": {"POSITION": position}, "indices": indices, "material": 1});
    b.push("meshes", json!({"primitives": [solid]}));
    b.push("nodes", json!({"mesh": 1, "extensions": {"MSFT_lod": {"ids": [2]}}}));
    b.push("nodes", json!({"mesh": 0}));
    let mut face = || {
        let view = b.view(&png(1, &[[200, 100, 50, 128]]), json!({}));
        b.push("images", json!({"bufferView": view, "mimeType": "image/png"}))
    };
    let level: Vec<usize> = (0..6).map(|_| face()).collect();
    let light = json!({"specularImages": [level], "irradianceCoefficients": [[1, 1, 1]], "rotation": [0.6, 0, 0, 0.8]});
    let list = |key: &str, value: Value| json!({key: [value]});
    b.json["extensions"] = json!({"EXT_lights_image_based": list("lights", light),
        "KHR_materials_variants": list("variants", json!({"name": "night"}))});
    b.push("scenes", json!({"nodes": [0, 1, 2], "extensions": {"EXT_lights_image_based": {"light": 0}}}));
    b
}

fn documents() -> Vec<Document> {
    let mut all = vec![
        rich::document(),
        Builder::triangle(),
        box_of_squares(),
        strips_and_quantised(),
        lamp_over_triangle(),
        glass_under_cube(),
        compressed::meshopt_square("EXT_meshopt_compression"),
        compressed::meshopt_square("KHR_meshopt_compression"),
        compressed::draco_square(),
    ];
    all.extend(images().iter().map(|image| textured(image)));
    all.into_iter().map(Document::new).collect()
}

/// A square with a picture on it.
pub(crate) fn textured(image: &[u8]) -> Builder {
    let mut b = Builder::square(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
        "emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}, "normalTexture": {"index": 0, "scale": 0.7}, "alphaMode": "BLEND",
        "doubleSided": true}));
    let view = b.view(image, json!({}));
    let image = b.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    b.push("textures", json!({"source": image}));
    b
}

/// A room of three squares with a light, a camera and a kept `TEXCOORD_1`.
fn box_of_squares() -> Builder {
    let mut b = Builder::square(json!({"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.7, 0.6, 1]}}));
    let uv = b.floats("VEC2", &[0., 0., 1., 0., 1., 1., 0., 1.]);
    b.set("/meshes/0/primitives/0/attributes/TEXCOORD_1", json!(uv));
    let normal = b.floats("VEC3", &[0., 0., 1.].repeat(4));
    b.set("/meshes/0/primitives/0/attributes/NORMAL", json!(normal));
    b.push("nodes", json!({"mesh": 0, "rotation": [0, FRAC_1_SQRT_2, 0, FRAC_1_SQRT_2], "scale": [1, 1, -1]}));
    b.push("nodes", json!({"mesh": 0, "rotation": [-FRAC_1_SQRT_2, 0, 0, FRAC_1_SQRT_2], "children": [3, 4]}));
    b.push("nodes", json!({"camera": 0, "translation": [0.5, 0.5, 3]}));
    b.push("nodes", json!({"translation": [0.5, 0.5, 0.7], "extensions": {"KHR_lights_punctual": {"light": 0}}}));
    b.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}));
    b.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 3}]}});
    b
}

/// A strip with normalised integers, a fan without indices, lines and points.
fn strips_and_quantised() -> Builder {
    let mut b = Builder::new();
    let position = b.accessor(
        5123,
        "VEC3",
        4,
        &words(&[0, 0, 0, 0, 9, 0, 0, 0, 0, 9, 0, 0, 9, 9, 0, 0]),
        json!({"normalized": true}),
    );
    let view = b.json["accessors"][position]["bufferView"].as_u64().unwrap();
    b.json["bufferViews"][view as usize]["byteStride"] = json!(8);
    let color = b.accessor(5121, "VEC4", 4, &[200; 16], json!({"normalized": true}));
    let indices = b.accessor(5121, "SCALAR", 4, &[0, 1, 2, 3], json!({}));
    let fan = b.floats("VEC3", &[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0., -1., 0., 0.]);
    let primitive = |mode: u32, position: usize| json!({"attributes": {"POSITION": position}, "mode": mode});
    let mut strip = primitive(5, position);
    strip["attributes"]["COLOR_0"] = json!(color);
    strip["indices"] = json!(indices);
    b.push("meshes", json!({"primitives": [strip, primitive(6, fan), primitive(1, fan), primitive(0, fan)]}));
    b.push("nodes", json!({"mesh": 0, "scale": [1000, 1000, 1000]}));
    b.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    b.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    b
}

/// A lossy WebP of one pixel; the library that writes the others knows only lossless ones.
const LOSSY_WEBP: [u8; 44] = [
    0x52, 0x49, 0x46, 0x46, 0x24, 0x00, 0x00, 0x00, 0x57, 0x45, 0x42, 0x50, 0x56, 0x50, 0x38, 0x20, 0x18, 0x00, 0x00,
    0x00, 0x30, 0x01, 0x00, 0x9d, 0x01, 0x2a, 0x01, 0x00, 0x01, 0x00, 0x02, 0x00, 0x34, 0x25, 0xa4, 0x00, 0x03, 0x70,
    0x00, 0xfe, 0xfb, 0xfd, 0x50, 0x00,
];

fn images() -> Vec<Vec<u8>> {
    let pixels: Vec<u8> = (0..8 * 6 * 4).map(|i: u32| (i * 37 % 251) as u8).collect();
    let rgba = DynamicImage::ImageRgba8(image::RgbaImage::from_raw(8, 6, pixels).unwrap());
    let write = |image: &DynamicImage, format| {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    vec![
        write(&rgba, ImageFormat::Png),
        write(&DynamicImage::ImageLumaA16(rgba.to_luma_alpha16()), ImageFormat::Png),
        write(&DynamicImage::ImageRgb8(rgba.to_rgb8()), ImageFormat::Jpeg),
        write(&DynamicImage::ImageLuma8(rgba.to_luma8()), ImageFormat::Jpeg),
        write(&rgba, ImageFormat::WebP),
        LOSSY_WEBP.to_vec(),
    ]
}

fn pictures() -> Vec<Vec<u8>> {
    let pixels: Vec<[f32; 3]> = (0..24 * 8).map(|i| [i as f32 * 0.1, 1.0, (i % 7) as f32]).collect();
    let hdr = DynamicImage::ImageRgb32F(image::Rgb32FImage::from_raw(24, 8, pixels.concat()).unwrap());
    let mut bytes = Cursor::new(Vec::new());
    hdr.write_to(&mut bytes, ImageFormat::Hdr).unwrap();
    let mut all = vec![bytes.into_inner()];
    all.push(exr::picture(Path::new("a.exr"), [24, 8], &pixels, &[1.0; 24 * 8]).unwrap());
    use ::exr::prelude::{Compression, Encoding, Image, Layer, LayerAttributes, SpecificChannels, WritableImage};
    for compression in [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
    ] {
        let channels = SpecificChannels::rgb(|at: ::exr::prelude::Vec2<usize>| {
            let [r, g, b] = pixels[at.y() * 24 + at.x()];
            (r, g, b)
        });
        let encoding = Encoding { compression, ..Encoding::FAST_LOSSLESS };
        let layer = Layer::new((24, 8), LayerAttributes::named("a"), encoding, channels);
        let mut bytes = Cursor::new(Vec::new());
        Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
        all.push(bytes.into_inner());
    }
    all
}

struct Nobody;

impl Observer for Nobody {
    fn stage(&self, _: &'static str, _: &std::sync::Arc<Progress>) {}
    fn done(&self, _: &'static str, _: f64) {}
}

/// The cheapest bake there is.
pub(crate) fn bake_request(input: PathBuf, output: PathBuf, more: &str) -> Request {
    let least = "texels-per-meter = 3.0\npage-size = 64\nmax-pages = 2\npadding = 1\ngather = 1\nlines-per-texel = 1.0\n\
                 direct-samples = 1\nsky = [0.1, 0.1, 0.1]\n";
    let options = Options::from_toml(&format!("{least}{more}")).unwrap();
    let settings = options.over(Options::preset(Preset::Preview).unwrap()).settings().unwrap();
    Request::new(input, output, settings, Preset::Preview)
}

pub(crate) fn bake(request: &Request) -> Result<bake::Outcome, bake::Error> {
    bake::bake(request, &Nobody, std::sync::Arc::default())
}

/// A bake of the box in every format that can be read, under `folder`/baked.
fn baked(folder: &Path) -> (Document, Vec<(PathBuf, Vec<u8>)>) {
    let input = folder.join("box.glb");
    fs::write(&input, Document::new(box_of_squares()).glb()).unwrap();
    let request = bake_request(
        input,
        folder.join("baked/box.glb"),
        "format = [\"exr\", \"hdr\", \"png\", \"rgbm\", \"rgbd\", \"rgbe\"]\n",
    );
    let files = bake(&request).unwrap().files;
    let pages = files.iter().map(|(path, _)| path.clone()).filter(|p| p.extension().is_some_and(|e| e != "glb"));
    let pages: Vec<(PathBuf, Vec<u8>)> = pages.map(|path| (path.clone(), fs::read(path).unwrap())).collect();
    let glb = fs::read(folder.join("baked/box.glb")).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    (Document { json: serde_json::from_slice(&glb[20..20 + length]).unwrap(), bin: glb[28 + length..].to_vec() }, pages)
}
