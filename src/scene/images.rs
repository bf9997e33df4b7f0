//! Decodes the images that the materials in use need, in parallel: PNG, JPEG, WebP, KTX2 and DDS to 8-bit RGBA.
//!
//! In: document, materials, and which textures may be coarser (`reduce`). Out: one [`Texture`] per texture of the
//! document, of some the product with another one; those that are not needed are one white texel. The format is told from the bytes, as many documents state
//! it wrongly. Colour profiles and orientation tags are ignored (glTF 2.0, section 3.8.3). 16-bit values are rounded to
//! 8 bits.
//!
//! Bounds, all checked from the image headers before anything is decoded: [`MAX_SIDE`], [`MAX_PIXELS`], [`PNG_RATIO`]
//! and its like.

use super::Document;
use super::Error;
use super::Material;
use super::Scene;
use super::basis;
use super::dds;
use super::reduce;
use super::reduce::Image;
use super::reduce::Loss;
use super::reduce::Role;
use super::reduce::Task;
use super::reduce::Use;
use super::schema::TextureEntry;
use super::schema::TextureSource;
use super::schema::label;
use super::texture::Texture;
use super::texture::Wrap;
use crate::base::Warning;
use crate::base::parallel;
use image::ImageFormat;
use image::ImageReader;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::collections::btree_map::Entry;
use std::io::Cursor;
use std::path::PathBuf;

/// Largest width and height [px]; larger textures exist on no GPU.
const MAX_SIDE: u32 = 16_384;

/// Most pixels of all textures together: 4 GiB decoded.
const MAX_PIXELS: u64 = 1 << 30;

/// Most pixels per byte of a PNG: deflate packs 1032 bytes into one, and a bit is a pixel.
const PNG_RATIO: u64 = 8 * 1032;

/// Most pixels per byte of a JPEG: a progressive one that is even has a bit for a block of 64.
const JPEG_RATIO: u64 = 8 * 64;

/// Most pixels that an image of another format may claim, whatever its size; beyond that it is held to [`PNG_RATIO`].
/// An even WebP has a few bytes, and is decoded within 128 MiB.
const SMALL: u64 = 1 << 24;

/// How an image is encoded.
#[derive(Clone, Copy)]
enum Format {
    /// The crate `image` reads it.
    Common(ImageFormat),
    Ktx2,
    Dds,
}

/// An encoded image that is needed.
struct Source {
    bytes: Vec<u8>,
    format: Format,
    /// Image and material, for messages.
    place: String,
    size: [u32; 2],
    scaling: Scaling,
}

/// How an image is scaled down; `covers` as of [`Use`].
#[derive(Clone, Copy, PartialEq)]
enum Scaling {
    Kept,
    /// How often both sides are halved, and what the pixels are.
    Alone {
        halvings: u32,
        role: Role,
        covers: bool,
    },
    /// With another image, which is replaced by the product: how often both sides of this one and of the product are
    /// halved.
    Colors {
        other: usize,
        halvings: [u32; 2],
        loss: Loss,
        covers: bool,
    },
    /// The other image.
    Takes,
}

impl Source {
    fn pixels(&self) -> u64 {
        let [width, height] = self.size.map(u64::from);
        width * height
    }
}

/// Numbers that memory depends on.
pub(super) struct Pixels {
    /// Of all textures as they are kept.
    pub(super) kept: u64,
    /// Of images that are scaled down after that: so many can be in the hands of all threads at one time.
    pub(super) passing: u64,
}

/// Textures, and those of them that hold a product.
pub(super) struct Textures {
    pub(super) textures: Vec<Texture>,
    /// Of colours of another texture and what theirs left of them.
    pub(super) products: BTreeSet<usize>,
}

/// Decodes what `materials` use, if `admit` has nothing against that many pixels; `coarse` are textures that may be
/// scaled down.
pub(super) fn decode(
    document: &mut Document,
    materials: &[Material],
    coarse: &BTreeMap<usize, Use>,
    warnings: &mut Vec<Warning>,
    admit: impl FnOnce(Pixels) -> Result<(), Error>,
) -> Result<Textures, Error> {
    let mut needs = collect(document, materials)?;
    needs.reduce(coarse);
    admit(needs.pixels())?;
    let Needs { textures, sources } = needs;
    let order: Vec<(&usize, &Source)> = sources.iter().filter(|(_, s)| s.scaling != Scaling::Takes).collect();
    let decoded = parallel::map(order.len(), |i| decode_scaled(order[i].1, &sources));
    let (mut images, mut multiplied) = (BTreeMap::new(), BTreeSet::new());
    for ((index, source), found) in order.iter().zip(decoded) {
        let (image, other) = found?;
        images.insert(**index, image);
        if let (Scaling::Colors { other: index, .. }, Some((image, is_product))) = (source.scaling, other) {
            images.insert(index, image);
            multiplied.extend(is_product.then_some(index));
        }
    }
    let mut left: BTreeMap<usize, usize> = BTreeMap::new();
    textures.values().for_each(|image| *left.entry(*image).or_default() += 1);
    let mut result = Vec::with_capacity(document.root.textures.len());
    let products = textures.iter().filter(|(_, image)| multiplied.contains(image)).map(|(t, _)| *t).collect();
    for (index, entry) in document.root.textures.iter().enumerate() {
        let (width, height, pixels) = match textures.get(&index) {
            // Two textures that show one image get a copy each; that is rare, and counted in `MAX_PIXELS`. The last one
            // gets the image itself, so that it is not in memory twice.
            Some(image) => take(&mut images, &mut left, *image),
            None => (1, 1, vec![[255; 4]]),
        };
        let (wrap, nearest) = sampler(document, index, entry, warnings)?;
        result.push(Texture { width, height, pixels, wrap, nearest });
    }
    Ok(Textures { textures: result, products })
}

/// A decoded image: width, height, pixels.
type Decoded = (u32, u32, Vec<[u8; 4]>);

/// The image, or a copy of it if more than one texture is `left` that shows it.
fn take(images: &mut BTreeMap<usize, Decoded>, left: &mut BTreeMap<usize, usize>, image: usize) -> Decoded {
    let left = left.entry(image).or_default();
    *left = left.saturating_sub(1);
    if *left > 0 { images[&image].clone() } else { images.remove(&image).unwrap_or_default() }
}

/// What has to be decoded.
struct Needs {
    /// Texture → image.
    textures: BTreeMap<usize, usize>,
    /// Image → encoded bytes.
    sources: BTreeMap<usize, Source>,
}

impl Needs {
    /// Plans how far images are scaled down: as far as all textures that show them may be, in the same role. Of what only
    /// two of them together say, each is shown by one texture.
    fn reduce(&mut self, coarse: &BTreeMap<usize, Use>) {
        let Self { textures, sources } = self;
        let mut shown: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        textures.iter().for_each(|(texture, image)| shown.entry(*image).or_default().push(*texture));
        for (image, by) in &shown {
            let uses: Option<Vec<&Use>> = by.iter().map(|texture| coarse.get(texture)).collect();
            let Some(uses) = uses else { continue };
            let covers = uses.iter().any(|of| of.covers);
            let size = sources[image].size;
            match uses[0].task {
                Task::Alone(role) if uses.iter().all(|of| of.task == uses[0].task) => {
                    let halvings = uses.iter().map(|of| of.halvings(size)).min().unwrap_or(0);
                    if halvings > 0 {
                        sources.entry(*image).and_modify(|s| s.scaling = Scaling::Alone { halvings, role, covers });
                    }
                }
                Task::Colors(texture, loss) if uses.len() == 1 => {
                    let other = textures[&texture];
                    let all = reduce::common([size, sources[&other].size]);
                    let halvings = [size, all].map(|size| uses[0].halvings(size));
                    if other != *image && shown[&other].len() == 1 && halvings[1] > 0 {
                        let scaling = Scaling::Colors { other, halvings, loss, covers };
                        sources.entry(*image).and_modify(|s| s.scaling = scaling);
                        sources.entry(other).and_modify(|s| s.scaling = Scaling::Takes);
                    }
                }
                _ => {}
            }
        }
    }

    fn pixels(&self) -> Pixels {
        let many = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
        let mut kept: BTreeMap<usize, u64> = self.sources.iter().map(|(image, s)| (*image, s.pixels())).collect();
        let mut passing = vec![];
        for (image, source) in &self.sources {
            match source.scaling {
                Scaling::Alone { halvings, covers: false, .. } => {
                    passing.push(source.pixels());
                    kept.insert(*image, many(reduce::halved(source.size, halvings)));
                }
                Scaling::Colors { other, halvings, covers: false, .. } => {
                    let size = self.sources[&other].size;
                    passing.push(source.pixels() + many(size));
                    kept.insert(*image, many(reduce::halved(source.size, halvings[0])));
                    kept.insert(other, many(reduce::halved(reduce::common([source.size, size]), halvings[1])));
                }
                _ => {}
            }
        }
        passing.sort_unstable_by(|a, b| b.cmp(a));
        Pixels {
            kept: self.textures.values().filter_map(|image| kept.get(image)).sum(),
            passing: passing.iter().take(rayon::current_num_threads()).sum(),
        }
    }
}

/// All that the materials use; sizes checked.
fn collect(document: &mut Document, materials: &[Material]) -> Result<Needs, Error> {
    let mut textures = BTreeMap::new();
    let mut sources = BTreeMap::<usize, Source>::new();
    let mut pixels = 0;
    for material in materials {
        for texture in material.textures().map(|t| t.texture) {
            if textures.contains_key(&texture) {
                continue;
            }
            let image = image_of(&document.root.textures[texture])
                .map_err(|e| e.within(&format!("texture {texture} of material {}", material.name)))?;
            let source = match sources.entry(image) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => {
                    let (source, file) = open(document, image, &format!("material {}", material.name))?;
                    document.note(file);
                    new.insert(source)
                }
            };
            pixels += source.pixels();
            if pixels > MAX_PIXELS {
                return Err(Error::unsupported(format!(
                    "the textures take more than {} GiB when decoded; scale them down before the bake",
                    (MAX_PIXELS * 4) >> 30
                )));
            }
            textures.insert(texture, image);
        }
    }
    Ok(Needs { textures, sources })
}

impl TextureEntry {
    /// The image that it shows; PNG or JPEG where there is one, since the others are made from it with loss.
    #[must_use]
    pub fn image(&self) -> Option<usize> {
        let source = |extension: &Option<TextureSource>| extension.as_ref().and_then(|e| e.source);
        let extensions = [&self.extensions.webp, &self.extensions.basisu, &self.extensions.dds];
        self.source.or_else(|| extensions.into_iter().find_map(source))
    }
}

fn image_of(texture: &TextureEntry) -> Result<usize, Error> {
    texture.image().ok_or_else(|| Error::invalid("it has no image"))
}

/// An image that is no texture.
pub(super) struct Picture {
    pub(super) width: u32,
    pub(super) height: u32,
    /// sRGB and alpha, top row first.
    pub(super) pixels: Vec<[u8; 4]>,
    /// It is a PNG with alpha, which `EXT_lights_image_based` reads as a divisor.
    pub(super) rgbd: bool,
}

/// Decodes one image for `user`, of at most `most` pixels.
pub(super) fn decode_alone(document: &mut Document, index: usize, user: &str, most: u64) -> Result<Picture, Error> {
    let (source, file) = open(document, index, user)?;
    document.note(file);
    if source.pixels() > most {
        let what = format!("{} has {} pixels; {most} are the limit, scale it down", source.place, source.pixels());
        return Err(Error::unsupported(what));
    }
    let png = matches!(source.format, Format::Common(ImageFormat::Png));
    let (width, height, pixels) = decode_one(&source)?;
    Ok(Picture { width, height, rgbd: png && has_alpha(&source)?, pixels })
}

impl Scene {
    /// An image as it is in the document, whatever was made of it: width and height [px], and encoded values.
    ///
    /// # Errors
    /// Its file is gone or was changed since the scene was read.
    pub fn decoded_image(&self, index: usize) -> Result<Decoded, Error> {
        let decode = || decode_one(&open(&self.document, index, "the document")?.0);
        decode().map_err(|e| e.in_file(&self.document.path))
    }
}

fn has_alpha(source: &Source) -> Result<bool, Error> {
    let decoder = image::codecs::png::PngDecoder::new(Cursor::new(&source.bytes));
    let decoder = decoder.map_err(|e| Error::invalid(format!("{} cannot be decoded: {e}", source.place)))?;
    Ok(image::ImageDecoder::color_type(&decoder).has_alpha())
}

/// The encoded bytes of an image, and the file that they are from.
fn open(document: &Document, index: usize, user: &str) -> Result<(Source, Option<PathBuf>), Error> {
    let Some(image) = document.root.images.get(index) else {
        let have = document.root.images.len();
        let what = format!("image {index}, needed by {user}, does not exist, there are {have}");
        return Err(Error::invalid(what));
    };
    let named = image.name.as_deref().or(image.uri.as_deref().filter(|u| !u.starts_with("data:")));
    let place = format!("image {index} \"{}\" of {user}", label(named, "image", index));
    let (bytes, file) = match (image.buffer_view, &image.uri) {
        (Some(view), _) => (document.buffer_view(view).map_err(|e| e.within(&place))?.to_vec(), None),
        (None, Some(uri)) => document.find(uri, &place, usize::MAX)?,
        (None, None) => return Err(Error::invalid(format!("{place} has neither a URI nor a buffer view"))),
    };
    let format = match image::guess_format(&bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)) => Format::Common(format),
        _ if bytes.starts_with(basis::MAGIC) => Format::Ktx2,
        _ if bytes.starts_with(dds::MAGIC) => Format::Dds,
        _ if bytes.starts_with(b"\xABKTX") => {
            return Err(Error::unsupported(format!("{place} is KTX 1; convert the textures to PNG or JPEG first")));
        }
        _ => return Err(Error::invalid(format!("{place} is neither PNG nor JPEG nor WebP nor KTX2 nor DDS"))),
    };
    let mut source = Source { bytes, format, place, size: [0; 2], scaling: Scaling::Kept };
    source.size = size(&source)?;
    Ok((source, file))
}

fn reader(bytes: &[u8], format: ImageFormat) -> ImageReader<Cursor<&[u8]>> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(4 * MAX_PIXELS);
    reader.limits(limits);
    reader
}

/// Width and height of an image according to its header, after checking that they are plausible.
fn size(source: &Source) -> Result<[u32; 2], Error> {
    let place = &source.place;
    let (width, height) = match source.format {
        Format::Ktx2 => basis::size(&source.bytes).map_err(|e| e.within(place))?,
        Format::Dds => dds::size(&source.bytes).map_err(|e| e.within(place))?,
        Format::Common(format) => {
            let mut reader = reader(&source.bytes, format);
            reader.no_limits();
            reader.into_dimensions().map_err(|e| Error::invalid(format!("{place} cannot be decoded: {e}")))?
        }
    };
    if width > MAX_SIDE || height > MAX_SIDE {
        return Err(Error::unsupported(format!("{place} has {width} × {height} pixels; {MAX_SIDE} are the limit")));
    }
    let pixels = u64::from(width) * u64::from(height);
    let bytes = source.bytes.len() as u64;
    let most = match source.format {
        Format::Common(ImageFormat::Png) => PNG_RATIO * bytes,
        Format::Common(ImageFormat::Jpeg) => JPEG_RATIO * bytes,
        Format::Common(_) | Format::Ktx2 | Format::Dds => SMALL.max(PNG_RATIO * bytes),
    };
    if pixels > most {
        let what = format!("{place} claims {width} × {height} pixels but has only {bytes} bytes");
        return Err(Error::invalid(what));
    }
    Ok([width, height])
}

fn decode_one(source: &Source) -> Result<Decoded, Error> {
    let place = &source.place;
    let (width, height, pixels) = match source.format {
        Format::Ktx2 => basis::decode(&source.bytes).map_err(|e| e.within(place))?,
        Format::Dds => dds::decode(&source.bytes).map_err(|e| e.within(place))?,
        Format::Common(format) => {
            let image = reader(&source.bytes, format).decode();
            let image = image.map_err(|e| Error::invalid(format!("{place} cannot be decoded: {e}")))?.into_rgba8();
            (image.width(), image.height(), image.as_raw().as_chunks().0.to_vec())
        }
    };
    if width == 0 || height == 0 {
        return Err(Error::invalid(format!("{place} has no pixels")));
    }
    Ok((width, height, pixels))
}

/// The image, scaled down as was planned, and the other one that goes with it: whether that is their product.
fn decode_scaled(
    source: &Source,
    sources: &BTreeMap<usize, Source>,
) -> Result<(Decoded, Option<(Decoded, bool)>), Error> {
    let whole = decode_one(source)?;
    let (width, height, pixels) = &whole;
    let image = Image { size: [*width, *height], pixels };
    let is_even = |covers: bool| !covers || pixels.iter().all(|p| p[3] == pixels[0][3]);
    let small = |([width, height], pixels): ([u32; 2], Vec<[u8; 4]>)| (width, height, pixels);
    match source.scaling {
        Scaling::Alone { halvings, role, covers } if image.size == source.size && is_even(covers) => {
            Ok((small(reduce::reduce(image, halvings, role)), None))
        }
        Scaling::Colors { other, halvings, loss, covers } => {
            let second = decode_one(&sources[&other])?;
            if !is_even(covers) {
                return Ok((whole, Some((second, false))));
            }
            let of = Image { size: [second.0, second.1], pixels: &second.2 };
            let product = small(reduce::product(image, of, halvings[1], loss));
            Ok((small(reduce::reduce(image, halvings[0], Role::Color)), Some((product, true))))
        }
        _ => Ok((whole, None)),
    }
}

fn sampler(
    document: &Document,
    index: usize,
    texture: &TextureEntry,
    warnings: &mut Vec<Warning>,
) -> Result<([Wrap; 2], bool), Error> {
    let Some(sampler) = texture.sampler else { return Ok(([Wrap::Repeat; 2], false)) };
    let Some(sampler) = document.root.samplers.get(sampler) else {
        return Err(Error::invalid(format!("texture {index}: sampler {sampler} does not exist")));
    };
    let wrap = [sampler.wrap_s, sampler.wrap_t].map(|mode| match mode {
        None | Some(10_497) => Wrap::Repeat,
        Some(33_648) => Wrap::Mirror,
        Some(33_071) => Wrap::Clamp,
        Some(other) => {
            let what = format!("texture {index}: wrap mode {other} does not exist; REPEAT was used");
            warnings.push(Warning::new("bad-sampler", what));
            Wrap::Repeat
        }
    });
    Ok((wrap, sampler.mag_filter == Some(9728)))
}
