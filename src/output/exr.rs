//! OpenEXR: lightmap pages, AOV files, and the reader that `compare` and `render` use.
//!
//! Written: one part, scan lines in increasing order, ZIP of 16 lines, half (or float for positions and errors),
//! Rec.709 chromaticities, no time stamp. Row 0 = v 0. Values beyond the half range are clamped to it, which the bake
//! warns of (`bake::bright`); not-a-number is an error, because one such texel blackens everything that is filtered with it.
//!
//! Trap: the `exr` crate keeps attributes that it does not know in a `HashMap`, so it would write them in another order
//! on every run. They are therefore spliced into the finished header here, in the order of their names, and the table
//! of chunk offsets behind the header is moved along (OpenEXR file layout, "Components" 1 to 4).

use super::Error;
use crate::base::exr_tiles::has_sound_tiles;
use crate::finish::Page;
use ::exr::meta::attribute::Chromaticities;
use ::exr::prelude as format;
use ::exr::prelude::ReadChannels;
use ::exr::prelude::ReadLayers;
use ::exr::prelude::WritableImage;
use half::f16;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

/// The largest half float, which brighter values become.
pub const LARGEST: f32 = 65504.0;

/// String attributes by name (at most 31 bytes each), for example `texelwalk.quantity`.
pub type Attributes = BTreeMap<String, String>;

/// One layer of an AOV file.
#[derive(Debug, Clone)]
pub struct AovLayer {
    /// Name before the dot, for example `direct`.
    pub name: String,
    /// Names after the dot, for example `R`, `G`, `B` or `X`, `Y`, `Z`, each with one value per texel.
    pub channels: Vec<(String, Vec<f32>)>,
    /// 32-bit floats instead of half.
    pub float: bool,
}

/// A picture in linear values.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ImageF32 {
    /// Width [px].
    pub width: u32,
    /// Height [px].
    pub height: u32,
    /// R, G, B, A; row-major, top row first. A = 1 where the file has none.
    pub pixels: Vec<[f32; 4]>,
    /// The file has an A channel.
    pub has_alpha: bool,
}

/// The bytes of a lightmap page's file. `path` is where it will go, for messages.
///
/// # Errors
/// If a value is not a number, or an attribute's name is too long.
pub fn lightmap(path: &Path, page: &Page, attributes: &Attributes) -> Result<Vec<u8>, Error> {
    let channel = |c: usize| page.pixels.iter().map(|p| p[c]).collect::<Vec<f32>>();
    let named = ["R", "G", "B", "A"].into_iter().enumerate().map(|(c, name)| (name.to_owned(), channel(c), false));
    write(path, [page.width, page.height], named.collect(), attributes)
}

/// The bytes of a picture in linear values: float R, G, B, and coverage as A. `path` is for messages.
///
/// # Errors
/// As for [`aovs`].
pub fn picture(path: &Path, size: [u32; 2], pixels: &[[f32; 3]], coverage: &[f32]) -> Result<Vec<u8>, Error> {
    let color = |c: usize| pixels.iter().map(|p| p[c]).collect::<Vec<f32>>();
    let [red, green, blue] = [0, 1, 2].map(color);
    let named = [("R", red), ("G", green), ("B", blue), ("A", coverage.to_vec())];
    write(path, size, named.map(|(name, values)| (name.to_owned(), values, true)).into(), &Attributes::new())
}

/// The bytes of an AOV file: every layer's channels as `layer.channel` in one part. `path` is for messages.
///
/// # Errors
/// As for [`lightmap`], and if a layer does not have one value per texel.
pub fn aovs(path: &Path, size: [u32; 2], layers: Vec<AovLayer>, attributes: &Attributes) -> Result<Vec<u8>, Error> {
    let mut channels = Vec::new();
    for layer in layers {
        for (suffix, values) in layer.channels {
            channels.push((format!("{}.{suffix}", layer.name), values, layer.float));
        }
    }
    write(path, size, channels, attributes)
}

fn write(
    path: &Path,
    [width, height]: [u32; 2],
    mut channels: Vec<(String, Vec<f32>, bool)>,
    attributes: &Attributes,
) -> Result<Vec<u8>, Error> {
    channels.sort_by(|a, b| a.0.cmp(&b.0));
    let texels = width as usize * height as usize;
    let mut list = Vec::with_capacity(channels.len());
    for (name, values, float) in channels {
        if values.len() != texels || texels == 0 {
            let count = values.len();
            return Err(Error::invalid(
                path,
                format!("channel {name} has {count} values for {width} × {height} texels"),
            ));
        }
        if let Some(i) = values.iter().position(|v| v.is_nan()) {
            let (x, y) = (i % width as usize, i / width as usize);
            return Err(Error::invalid(path, format!("texel ({x}, {y}) of channel {name} is not a number")));
        }
        let samples = if float {
            format::FlatSamples::F32(values.into_iter().map(|v| v.clamp(f32::MIN, f32::MAX)).collect())
        } else {
            format::FlatSamples::F16(values.into_iter().map(to_half).collect())
        };
        list.push(format::AnyChannel::new(header_text(path, &name)?, samples));
    }
    let encoding = format::Encoding {
        compression: format::Compression::ZIP16,
        blocks: format::Blocks::ScanLines,
        line_order: format::LineOrder::Increasing,
    };
    let layer = format::Layer::new(
        (width as usize, height as usize),
        format::LayerAttributes::default(),
        encoding,
        format::AnyChannels { list: list.into() },
    );
    let mut image = format::Image::from_layer(layer);
    image.attributes.chromaticities = Some(Chromaticities {
        red: format::Vec2(0.64, 0.33),
        green: format::Vec2(0.30, 0.60),
        blue: format::Vec2(0.15, 0.06),
        white: format::Vec2(0.3127, 0.3290),
    });
    let mut bytes = Cursor::new(Vec::new());
    // The parallel writer starts a pool of its own, as large as the machine; with one thread allowed it must not.
    let written = if rayon::current_num_threads() == 1 {
        image.write().non_parallel().to_buffered(&mut bytes)
    } else {
        image.write().to_buffered(&mut bytes)
    };
    written.map_err(|e| Error::invalid(path, format!("the picture cannot be encoded: {e}")))?;
    with_attributes(path, bytes.into_inner(), attributes)
}

/// Nearest finite half.
fn to_half(value: f32) -> f16 {
    f16::from_f32(value.clamp(-LARGEST, LARGEST))
}

fn header_text(path: &Path, name: &str) -> Result<format::Text, Error> {
    format::Text::new_or_none(name).filter(|_| name.is_ascii() && !name.is_empty() && name.len() < 32).ok_or_else(
        || Error::invalid(path, format!("the name `{name}` does not fit an EXR header (1 to 31 ASCII letters)")),
    )
}

/// Inserts string attributes at the end of the header of a single-part scan-line file.
fn with_attributes(path: &Path, bytes: Vec<u8>, attributes: &Attributes) -> Result<Vec<u8>, Error> {
    let mut added = Vec::new();
    for (name, value) in attributes {
        header_text(path, name)?;
        let size =
            i32::try_from(value.len()).map_err(|_| Error::invalid(path, format!("attribute {name} is too long")))?;
        added.extend_from_slice(name.as_bytes());
        added.extend_from_slice(b"\0string\0");
        added.extend_from_slice(&size.to_le_bytes());
        added.extend_from_slice(value.as_bytes());
    }
    let spliced = header_end(&bytes).and_then(|end| {
        let table = end + 1;
        let first_chunk = usize::try_from(u64_at(&bytes, table)?).ok()?;
        let mut out = bytes.get(..end)?.to_vec();
        out.extend_from_slice(&added);
        out.push(0);
        for at in (table..first_chunk).step_by(8) {
            out.extend_from_slice(&(u64_at(&bytes, at)? + added.len() as u64).to_le_bytes());
        }
        out.extend_from_slice(bytes.get(first_chunk..)?);
        Some(out)
    });
    spliced.ok_or_else(|| Error::invalid(path, "the encoded EXR header cannot be understood"))
}

/// Position of the zero byte that ends the header.
fn header_end(bytes: &[u8]) -> Option<usize> {
    let zero_from = |at: usize| bytes.get(at..)?.iter().position(|&b| b == 0).map(|n| at + n);
    let mut at = 8; // magic number, version
    while *bytes.get(at)? != 0 {
        let kind = zero_from(at)? + 1;
        let size = zero_from(kind)? + 1;
        let length = u32::from_le_bytes(bytes.get(size..size + 4)?.try_into().ok()?);
        at = size + 4 + length as usize;
    }
    Some(at)
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?))
}

/// Most texels that a byte of a file can stand for: zlib packs at most 1032 : 1, and a texel takes 6 bytes or more.
const TEXELS_PER_BYTE: usize = 256;

/// Reads the first RGB or RGBA layer of an EXR file, of half, float or integer samples.
///
/// # Errors
/// If it cannot be read, is no EXR file, or has no R, G, B channels.
pub fn read_rgba(path: &Path) -> Result<ImageF32, Error> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, "read", e))?;
    let broken = |e: ::exr::error::Error| Error::invalid(path, format!("cannot be read as an EXR picture: {e}"));
    let meta = ::exr::meta::MetaData::read_from_buffered(Cursor::new(&bytes), false).map_err(broken)?;
    let most = bytes.len().saturating_mul(TEXELS_PER_BYTE);
    if meta.headers.iter().any(|h| h.layer_size.width().saturating_mul(h.layer_size.height()) > most) {
        return Err(Error::invalid(path, "its header claims more texels than a file of this length can hold"));
    }
    if !meta.headers.iter().all(has_sound_tiles) {
        return Err(Error::invalid(path, "its tiles are larger than the picture, and beyond a million texels"));
    }
    let image = format::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            |size, channels: &format::RgbaChannels| ImageF32 {
                width: size.width() as u32,
                height: size.height() as u32,
                pixels: vec![[0.0; 4]; size.area()],
                has_alpha: channels.3.is_some(),
            },
            |image, at, (r, g, b, a): (f32, f32, f32, f32)| {
                let i = at.y() * image.width as usize + at.x();
                if let Some(pixel) = image.pixels.get_mut(i) {
                    *pixel = [r, g, b, a];
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(&bytes))
        .map_err(broken)?;
    Ok(image.layer_data.channel_data.pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(width: u32, height: u32) -> Page {
        let value = |i: u32, c: u32| (i.wrapping_mul(2_654_435_761) >> (8 + c)) as f32 / 65536.0;
        let pixels = (0..width * height).map(|i| [value(i, 0), value(i, 1), value(i, 2), (i % 2) as f32]).collect();
        Page { width, height, pixels }
    }

    fn attributes() -> Attributes {
        (0..20).map(|i| (format!("texelwalk.key{i}"), format!("value {i} ü"))).collect()
    }

    fn round_trip(bytes: &[u8]) -> ImageF32 {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        read_rgba(file.path()).unwrap()
    }

    #[test]
    fn values_round_trip_to_half_precision() {
        let page = page(37, 53);
        let image = round_trip(&lightmap(Path::new("x.exr"), &page, &attributes()).unwrap());
        assert_eq!((image.width, image.height, image.has_alpha), (37, 53, true));
        for (read, written) in image.pixels.iter().zip(&page.pixels) {
            assert_eq!(*read, written.map(|v| f16::from_f32(v).to_f32()));
        }
    }

    #[test]
    fn bytes_are_the_same_on_every_run_and_thread_count() {
        let page = page(200, 333);
        let bytes: Vec<Vec<u8>> = [1, 2, 3, 8, 8]
            .into_iter()
            .map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| lightmap(Path::new("x.exr"), &page, &attributes()).unwrap())
            })
            .collect();
        assert!(bytes.windows(2).all(|w| w[0] == w[1]));
    }

    #[test]
    fn attributes_are_readable_and_in_order() {
        let bytes = lightmap(Path::new("x.exr"), &page(8, 40), &attributes()).unwrap();
        let meta = ::exr::meta::MetaData::read_from_buffered(Cursor::new(&bytes), true).unwrap();
        let header = &meta.headers[0];
        assert_eq!(header.compression, format::Compression::ZIP16);
        assert_eq!(header.shared_attributes.chromaticities.unwrap().red, format::Vec2(0.64, 0.33));
        assert!(header.own_attributes.capture_date.is_none());
        let found = header.own_attributes.other.len() + header.shared_attributes.other.len();
        assert_eq!(found, 20);
        let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
        assert_eq!(names, ["A", "B", "G", "R"]);
        let place = |i: usize| bytes.windows(15).position(|w| w == format!("texelwalk.key{i:02}").as_bytes());
        assert!(place(10).unwrap() < place(11).unwrap());
    }

    #[test]
    fn tiles_beyond_all_size_are_refused() {
        use ::exr::image::write::WritableImage;
        let image = format::Image::from_encoded_channels(
            (24, 8),
            format::Encoding { blocks: format::Blocks::Tiles(format::Vec2(64, 64)), ..format::Encoding::UNCOMPRESSED },
            format::SpecificChannels::rgb(|_| (1.0f32, 2.0f32, 3.0f32)),
        );
        let mut bytes = vec![];
        image.write().to_buffered(Cursor::new(&mut bytes)).unwrap();
        // Larger than the picture, as tiles of small pictures are.
        assert_eq!(round_trip(&bytes).pixels[100][..3], [1.0, 2.0, 3.0]);
        let head = b"tiledesc\0\x09\0\0\0";
        let at = bytes.windows(head.len()).position(|w| w == head).unwrap() + head.len();
        bytes[at + 3] = 4;
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &bytes).unwrap();
        let refused = read_rgba(file.path()).unwrap_err().to_string();
        assert!(refused.contains("tiles"), "{refused}");
    }

    #[test]
    fn not_a_number_is_refused_and_infinity_is_clamped() {
        let mut bad = page(4, 4);
        bad.pixels[6][1] = f32::NAN;
        let message = lightmap(Path::new("x.exr"), &bad, &Attributes::new()).unwrap_err().to_string();
        assert!(message.contains("texel (2, 1) of channel G"), "{message}");
        bad.pixels[6][1] = f32::INFINITY;
        bad.pixels[7][1] = -1e9;
        let image = round_trip(&lightmap(Path::new("x.exr"), &bad, &Attributes::new()).unwrap());
        assert_eq!((image.pixels[6][1], image.pixels[7][1]), (65504.0, -65504.0));
    }

    #[test]
    fn names_that_do_not_fit_are_refused() {
        for name in ["", "texelwalk.a-name-of-more-than-31-bytes", "ü"] {
            let attributes = Attributes::from([(name.to_owned(), "x".to_owned())]);
            assert!(lightmap(Path::new("x.exr"), &page(2, 2), &attributes).is_err(), "{name}");
        }
    }

    #[test]
    fn layers_are_dotted_channels_of_one_part() {
        let values = |k: f32| (0..6).map(|i| i as f32 * k).collect::<Vec<f32>>();
        let layers = vec![
            AovLayer { name: "stderr".into(), channels: vec![("Y".into(), values(1e-9))], float: true },
            AovLayer {
                name: "direct".into(),
                channels: vec![("R".into(), values(1.0)), ("B".into(), values(2.0))],
                float: false,
            },
        ];
        let bytes = aovs(Path::new("x.exr"), [3, 2], layers, &attributes()).unwrap();
        let image = format::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
        let image = image.all_attributes().from_buffered(Cursor::new(&bytes)).unwrap();
        let channels = &image.layer_data.channel_data.list;
        assert_eq!(
            channels.iter().map(|c| c.name.to_string()).collect::<Vec<_>>(),
            ["direct.B", "direct.R", "stderr.Y"]
        );
        assert_eq!(channels[2].sample_data.values_as_f32().collect::<Vec<_>>(), values(1e-9));
        assert_eq!(channels[0].sample_data.values_as_f32().collect::<Vec<_>>(), values(2.0));
        let short = vec![AovLayer { name: "a".into(), channels: vec![("Y".into(), vec![0.0])], float: false }];
        assert!(aovs(Path::new("x.exr"), [3, 2], short, &Attributes::new()).is_err());
    }

    #[test]
    fn broken_files_are_errors() {
        let good = lightmap(Path::new("x.exr"), &page(64, 64), &attributes()).unwrap();
        let file = tempfile::NamedTempFile::new().unwrap();
        for length in [0, 4, 40, good.len() / 3, good.len() - 1] {
            std::fs::write(file.path(), &good[..length]).unwrap();
            assert!(matches!(read_rgba(file.path()), Err(Error::Invalid { .. })), "{length}");
        }
        // A data window of a billion texels in a file of a few kilobytes.
        let mut huge = good;
        let at = huge.windows(16).position(|w| w == b"dataWindow\0box2i").unwrap() + 21;
        huge[at + 8..at + 12].copy_from_slice(&30_000i32.to_le_bytes());
        huge[at + 12..at + 16].copy_from_slice(&30_000i32.to_le_bytes());
        std::fs::write(file.path(), &huge).unwrap();
        assert!(matches!(read_rgba(file.path()), Err(Error::Invalid { .. })));
        assert!(matches!(read_rgba(Path::new("/no/such.exr")), Err(Error::Io { .. })));
    }
}
