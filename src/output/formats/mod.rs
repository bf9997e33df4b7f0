//! Lightmap pages in the formats that engines load: `--format`.
//!
//! In: the pages of a bake. Out: a file per page and format, and what a reader must know to decode it. Every format
//! holds the same picture, the half floats of the EXR (not below 0, at most 65,504), row 0 = v 0, linear Rec.709. In the table `rgb`
//! and `a` are what a sampler returns, in [0, 1] for PNG; nothing is sRGB, so load without colour conversion.
//!
//! | format | file | value of a texel | whose convention |
//! |---|---|---|---|
//! | `exr` | `.exr` | `rgb`, half | the lightmap itself; `a` is the coverage |
//! | `hdr` | `.hdr` | `rgb`; (R, G, B)/256 · 2^(E − 128) | Radiance RGBE, run lengths; no offset of ½, as most readers decode |
//! | `png` | `.linear16.png` | `rgb · scale` | 16 bits per channel |
//! | `rgbm` | `.rgbm.png` | `(8 · a · rgb)² · scale` | `PlayCanvas` (type RGBM) |
//! | `rgbd` | `.rgbd.png` | `rgb^2.2 / a · scale` | Babylon.js (`isRGBD`) |
//! | `rgbe` | `.rgbe.png` | `rgb · 2^(255 a − 128)`; 0 where a = 0 | `PlayCanvas` (type RGBE), three.js of old; not that of `.hdr`, which divides by 256 |
//! | `ktx2` | `.ktx2` | `rgb` | BC6H unsigned with mip levels, see [`ktx2`], [`mips`] |
//!
//! `scale` is a power of two, one per format and bake so that pages and light groups look alike: the smallest with
//! which the largest value of the lightmap fits (1, 64 and 255 times `scale` for `png`, `rgbm` and `rgbd`). Engines whose
//! decoder is built in multiply its result by `scale`.
//!
//! Limits: only EXR has coverage; in the others `a` is a part of the code or 1. Where `a` is a part of the code, it must
//! not be premultiplied into the colour on loading, and `rgbe` must be decoded before it is filtered. Samplers filter
//! codes: half way between a texel and one four times as bright `rgbm` is 10 % too dark, `rgbd` 36 %. Browsers keep 8 of
//! the 16 bits of `png`. three.js once had a linear RGBM (`rgb · a · 7` or 16) and RGBD, Unity has RGBM of its own; those
//! are not written.
//!
//! Errors, as a part of the largest channel: `hdr` at most 1/255, `rgbe` 1/255, `rgbm` 1/127 above `scale`/1000; `png`
//! `scale`/131,070 absolutely; `rgbd` 1/150 from `scale` up, and growing below, where it is 8-bit gamma.

mod blocks;
mod images;
pub mod ktx2;
pub mod mips;
mod pack;

use super::Error;
use super::Files;
use super::exr;
use super::exr::Attributes;
use super::exr::ImageF32;
use super::names::PageFiles;
use super::names::local_path;
use super::names::relative_uri;
use super::splice::Element;
use super::splice::quoted;
use crate::finish::Lightmap;
use crate::finish::Page;
use half::f16;
use std::path::Path;
use std::path::PathBuf;

/// How a page is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// `OpenEXR`, half floats.
    Exr,
    /// Radiance HDR, 8 bits per channel and a common exponent.
    Hdr,
    /// PNG, 16 bits per channel, linear, times a scale.
    Png,
    /// PNG, 8 bits: (8·a·rgb)²·scale, as `PlayCanvas` reads it.
    Rgbm,
    /// PNG, 8 bits: rgb^2.2/a·scale, as Babylon.js reads it.
    Rgbd,
    /// PNG, 8 bits: rgb·2^(255a−128).
    Rgbe,
    /// KTX 2 with BC6H blocks and mip levels.
    Ktx2,
}

impl Format {
    /// All of them, the most exact first (root mean square error of the fixtures), those that cannot be read here last.
    pub const ALL: [Self; 7] = [Self::Exr, Self::Png, Self::Hdr, Self::Rgbe, Self::Rgbm, Self::Rgbd, Self::Ktx2];

    /// Its name in options and manifests.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Hdr => "hdr",
            Self::Png => "png",
            Self::Rgbm => "rgbm",
            Self::Rgbd => "rgbd",
            Self::Rgbe => "rgbe",
            Self::Ktx2 => "ktx2",
        }
    }

    /// End of its files' names. `.png` alone is the preview's.
    const fn extension(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Hdr => "hdr",
            Self::Png => "linear16.png",
            Self::Rgbm => "rgbm.png",
            Self::Rgbd => "rgbd.png",
            Self::Rgbe => "rgbe.png",
            Self::Ktx2 => "ktx2",
        }
    }

    /// The formula of the table above, as manifests spell it.
    const fn decode(self) -> &'static str {
        match self {
            Self::Exr | Self::Hdr | Self::Ktx2 => "rgb",
            Self::Png => "rgb*scale",
            Self::Rgbm => "(8*a*rgb)^2*scale",
            Self::Rgbd => "rgb^2.2/a*scale",
            Self::Rgbe => "rgb*2^(255*a-128)",
        }
    }

    /// Largest value of its code, in units of the scale; `None` if it has no scale.
    const fn most(self) -> Option<f64> {
        match self {
            Self::Png => Some(1.0),
            Self::Rgbm => Some(64.0),
            Self::Rgbd => Some(255.0),
            Self::Exr | Self::Hdr | Self::Rgbe | Self::Ktx2 => None,
        }
    }

    /// Where the file goes that belongs to a page's EXR.
    #[must_use]
    pub fn path(self, page_exr: &Path) -> PathBuf {
        page_exr.with_extension(self.extension())
    }
}

/// A format and the scale that a bake chose for it; 1 where the format has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coding {
    /// How.
    pub format: Format,
    /// Factor of the decoded value, a power of two.
    pub scale: f64,
}

/// The file of a page in one format.
#[derive(Debug, Clone, PartialEq)]
pub struct PageFile {
    /// Where.
    pub path: PathBuf,
    /// How to decode it.
    pub coding: Coding,
    /// It is to be among the glTF's images as well, behind `EXT_texture_exr`.
    pub image: bool,
}

impl PageFile {
    /// Its entry in a manifest whose document lies in `folder`.
    pub(super) fn json(&self, folder: &Path) -> Result<String, Error> {
        let Coding { format, scale } = self.coding;
        let uri = quoted(&relative_uri(folder, &self.path)?);
        let scale = match format.most() {
            Some(_) => format!(", \"scale\": {}", serde_json::Value::from(scale)),
            None => String::new(),
        };
        Ok(format!("{{\"format\": \"{}\", \"uri\": {uri}, \"decode\": \"{}\"{scale}}}", format.name(), format.decode()))
    }
}

/// What a bake writes for every page.
#[derive(Debug, Clone)]
pub struct Plan {
    codings: Vec<Coding>,
    /// Mip levels in which pages do not mix charts.
    mips: u32,
}

impl Plan {
    /// The scales for a lightmap, which is the sum of everything that is written with them.
    #[must_use]
    pub fn new(formats: &[Format], mips: u32, lightmap: &Lightmap) -> Self {
        let values = lightmap.pages.iter().flat_map(|p| &p.pixels).flat_map(|p| &p[..3]);
        let largest = f64::from(values.fold(0.0f32, |most, &v| most.max(half(v).to_f32())));
        let coding = |&format: &Format| Coding { format, scale: format.most().map_or(1.0, |m| scale(largest / m)) };
        Self { codings: formats.iter().map(coding).collect(), mips }
    }

    /// Tells the document about its files, unless a plain EXR is all there is. `image` puts the EXR among its images.
    pub fn name(&self, pages: &mut [PageFiles], image: bool) {
        if !image && self.codings.iter().all(|c| c.format == Format::Exr) {
            return;
        }
        for page in pages {
            let file = |&coding: &Coding| PageFile {
                path: coding.format.path(&page.exr),
                coding,
                image: image && coding.format == Format::Exr,
            };
            page.files = self.codings.iter().map(file).collect();
        }
    }

    /// The files of one page, whose EXR would be `page_exr`.
    ///
    /// # Errors
    /// If a value is not a number, or a file cannot be encoded.
    pub fn encode(&self, page_exr: &Path, page: &Page, attributes: &Attributes) -> Result<Files, Error> {
        let one = |&coding: &Coding| {
            let path = coding.format.path(page_exr);
            encode(&path, page, coding, self.mips, attributes).map(|bytes| (path, bytes.into()))
        };
        self.codings.iter().map(one).collect()
    }
}

/// The bytes of a page's file. `path` is where it will go, for messages.
///
/// # Errors
/// If a value is not a number, or the picture cannot be encoded.
pub fn encode(path: &Path, page: &Page, coding: Coding, mips: u32, attributes: &Attributes) -> Result<Vec<u8>, Error> {
    check(path, page)?;
    match coding.format {
        Format::Exr => exr::lightmap(path, page, attributes),
        Format::Ktx2 => ktx2::texture(path, &mips::levels(page, mips), attributes),
        Format::Hdr | Format::Png | Format::Rgbm | Format::Rgbd | Format::Rgbe => images::encode(path, page, coding),
    }
}

/// The most exact file of a page that can be read, by the `extras.lightmap` of its texture in `document`.
#[must_use]
pub fn most_exact(document: &Path, named: &Element<'_>) -> Option<(PathBuf, Coding)> {
    let listed = named.array("files");
    let of = |format: Format| {
        listed.iter().find(|f| f.get("format").and_then(|n| n.string()).as_deref() == Some(format.name()))
    };
    let best = Format::ALL.into_iter().find_map(|format| of(format).map(|file| (format, file)));
    let (format, entry) = best.unwrap_or((Format::Exr, named));
    let scale = entry.get("scale").and_then(|s| s.text().parse().ok()).unwrap_or(1.0);
    let path = local_path(document, &entry.get("uri")?.string()?)?;
    Some((path, Coding { format, scale }))
}

/// Reads a page back; A = 1 everywhere unless the format is EXR.
///
/// # Errors
/// If the file is missing or damaged, or it is KTX2, which can only be written here.
pub fn read(path: &Path, coding: Coding) -> Result<ImageF32, Error> {
    match coding.format {
        Format::Exr => exr::read_rgba(path),
        Format::Ktx2 => Err(Error::invalid(
            path,
            "KTX2 pages can be written but not read here; bake with --format ktx2,exr to keep a file that can",
        )),
        Format::Hdr | Format::Png | Format::Rgbm | Format::Rgbd | Format::Rgbe => images::read(path, coding),
    }
}

fn check(path: &Path, page: &Page) -> Result<(), Error> {
    let [width, height] = [page.width, page.height].map(|n| n as usize);
    if page.pixels.len() != width * height || page.pixels.is_empty() {
        let count = page.pixels.len();
        return Err(Error::invalid(path, format!("{count} texels do not fill {width} × {height}")));
    }
    let bad = page.pixels.iter().position(|p| p.iter().any(|v| v.is_nan()));
    bad.map_or(Ok(()), |i| Err(Error::invalid(path, format!("texel ({}, {}) is not a number", i % width, i / width))))
}

/// The value that every format stores: the EXR's half float, never below 0.
fn half(value: f32) -> f16 {
    f16::from_f32(value.clamp(0.0, exr::LARGEST))
}

/// The smallest power of two that is not below `least`; 1 for black.
fn scale(least: f64) -> f64 {
    if least <= 0.0 {
        return 1.0;
    }
    let (fraction, exponent) = libm::frexp(least);
    libm::ldexp(1.0, if fraction == 0.5 { exponent - 1 } else { exponent })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn page(values: &[f32]) -> Page {
        let pixels = values.iter().map(|&v| [v, 0.5 * v, 0.0, 1.0]).collect();
        Page { width: values.len() as u32, height: 1, pixels }
    }

    fn lightmap(values: &[f32]) -> Lightmap {
        Lightmap { pages: vec![page(values)] }
    }

    #[test]
    fn scales_are_the_smallest_power_of_two_that_fits() {
        for (least, expected) in [(0.0, 1.0), (1.0, 1.0), (1.001, 2.0), (0.75, 1.0), (0.5, 0.5), (1e-3, 1.0 / 512.0)] {
            assert_eq!(scale(least), expected, "{least}");
        }
        let plan = Plan::new(&[Format::Png, Format::Rgbm, Format::Rgbd, Format::Hdr], 2, &lightmap(&[0.1, 100.0]));
        assert_eq!(plan.codings.iter().map(|c| c.scale).collect::<Vec<_>>(), [128.0, 2.0, 0.5, 1.0]);
    }

    #[test]
    fn every_format_that_can_be_read_comes_back() {
        let values = [0.0, 6e-8, 0.001, 0.02, 0.5, 1.0, 1.5, 3.0, 7.0, 12.0, 99.0, 500.0];
        let plan = Plan::new(&Format::ALL, 1, &lightmap(&values));
        let folder = tempfile::tempdir().unwrap();
        let files = plan.encode(&folder.path().join("a.lightmap0.exr"), &page(&values), &BTreeMap::new()).unwrap();
        assert_eq!(files.len(), Format::ALL.len());
        for ((path, bytes), &coding) in files.iter().zip(&plan.codings) {
            std::fs::write(path, bytes.to_vec()).unwrap();
            if coding.format == Format::Ktx2 {
                assert!(read(path, coding).unwrap_err().to_string().contains("ktx2,exr"));
                continue;
            }
            let image = read(path, coding).unwrap();
            assert_eq!((image.width, image.height), (values.len() as u32, 1));
            for (pixel, value) in image.pixels.iter().zip(values).skip(4) {
                let error = (pixel[0] - value).abs().max((pixel[1] - 0.5 * value).abs());
                assert!(error <= value / 100.0 && pixel[2] == 0.0, "{coding:?}: {value} became {pixel:?}");
            }
            assert!(image.pixels[0][..3] == [0.0; 3], "{coding:?}");
        }
    }

    #[test]
    fn what_is_not_a_number_is_refused_by_all_and_the_rest_is_clamped() {
        for format in Format::ALL {
            let coding = Coding { format, scale: 1024.0 };
            let bytes = |value: f32| encode(Path::new("x"), &page(&[1.0, value]), coding, 1, &BTreeMap::new());
            assert!(bytes(f32::NAN).unwrap_err().to_string().contains("(1, 0)"), "{format:?}");
            assert_eq!(bytes(f32::INFINITY).unwrap(), bytes(1e9).unwrap(), "{format:?}");
            if format != Format::Exr {
                assert_eq!(bytes(-1.0).unwrap(), bytes(0.0).unwrap(), "{format:?}");
            }
            assert!(encode(Path::new("x"), &Page::default(), coding, 1, &BTreeMap::new()).is_err());
        }
    }

    #[test]
    fn names_are_beside_the_exr_and_differ() {
        let mut pages = crate::output::names::page_files(Path::new("out/my.room.glb"), 2);
        Plan::new(&[Format::Exr], 2, &lightmap(&[1.0])).name(&mut pages, false);
        assert!(pages[0].files.is_empty());
        Plan::new(&Format::ALL, 2, &lightmap(&[3.0])).name(&mut pages, true);
        let names: Vec<String> =
            pages[1].files.iter().map(|f| f.path.file_name().unwrap().to_string_lossy().into_owned()).collect();
        assert_eq!(names[1], "my.room.lightmap1.linear16.png");
        let unique: std::collections::BTreeSet<&String> = names.iter().collect();
        assert!(unique.len() == 7 && !names.contains(&"my.room.lightmap1.png".to_owned()));
        assert_eq!(pages[0].files.iter().filter(|f| f.image).count(), 1);
        let json = pages[0].files[4].json(Path::new("out")).unwrap();
        assert!(
            json.contains(r#""uri": "my.room.lightmap0.rgbm.png", "decode": "(8*a*rgb)^2*scale", "scale": 0.0625"#)
        );
    }
}
