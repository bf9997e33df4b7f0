//! Decodes DDS images of `MSFT_texture_dds` to 8-bit RGBA: BC1, BC2, BC3, BC7, and plain 32-bit pixels.
//!
//! In: the bytes of a file. Out: the pixels of its largest level, row 0 on top.
//!
//! Source: Microsoft, "Programming Guide for DDS", `DDS_HEADER`, `DDS_PIXELFORMAT` and `DDS_HEADER_DXT10`; the decoder of
//! blocks is the crate `bcdec_rs`, compared with OpenImageIO in `tests/dds.rs`.
//!
//! What the header claims is compared with the bytes that exist before anything is allocated. Values are kept as they are
//! encoded, whether the format's name says sRGB or not: glTF says what a texture means.
//!
//! Limits: one picture; no cube maps, volumes and arrays, and no formats that hold fewer than three channels or more than
//! eight bits of each.

use super::Error;

/// First bytes of a file.
pub(super) const MAGIC: &[u8] = b"DDS ";

/// Bytes of the magic number and the header, and of the further header of newer files.
const HEADER: usize = 128;
const FURTHER: usize = 20;

/// Flags of `DDS_PIXELFORMAT`: a four-character code, plain colours, alpha beside them.
const FOUR_CC: u32 = 0x4;
const RGB: u32 = 0x40;
const ALPHA: u32 = 0x1;
/// Of `dwCaps2`: a cube map, a volume.
const CUBE_OR_VOLUME: u32 = 0x200 | 0x20_0000;

/// How the pixels are encoded.
#[derive(Clone, Copy)]
enum Encoding {
    /// Blocks of 4 × 4 pixels in so many bytes.
    Blocks(usize, fn(&[u8], &mut [u8], usize)),
    /// Four bytes; where each channel is, counted from the lowest bits. No fourth one: opaque.
    Bytes([usize; 3], Option<usize>),
}

/// A file by its header.
struct Header {
    width: u32,
    height: u32,
    encoding: Encoding,
    /// Where the pixels begin.
    start: usize,
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes)
}

impl Header {
    fn read(bytes: &[u8]) -> Result<Self, Error> {
        let truncated = || Error::invalid("its DDS header is truncated");
        let at = |at: usize| word(bytes, at).ok_or_else(truncated);
        let (height, width, caps) = (at(12)?, at(16)?, at(112)?);
        if caps & CUBE_OR_VOLUME != 0 {
            return Err(several());
        }
        let (flags, code) = (at(80)?, at(84)?);
        let (encoding, start) = match (flags & FOUR_CC != 0, &code.to_le_bytes()) {
            (true, b"DXT1") => (blocks(71)?, HEADER),
            (true, b"DXT2" | b"DXT3") => (blocks(74)?, HEADER),
            (true, b"DXT4" | b"DXT5") => (blocks(77)?, HEADER),
            (true, b"DX10") => {
                let (format, dimension, flags, count) = (at(128)?, at(132)?, at(136)?, at(140)?);
                if dimension != 3 || flags & 4 != 0 || count > 1 {
                    return Err(several());
                }
                (blocks(format)?, HEADER + FURTHER)
            }
            (true, _) => return Err(unread(&format!("four-character code {code:#010x}"))),
            (false, _) => {
                let alpha = if flags & ALPHA != 0 { at(104)? } else { 0 };
                (plain(flags, at(88)?, [at(92)?, at(96)?, at(100)?], alpha)?, HEADER)
            }
        };
        let header = Self { width, height, encoding, start };
        let (have, need) = (bytes.len().saturating_sub(start) as u64, header.bytes());
        if have < need {
            let what = format!("its DDS header claims {width} × {height} pixels in {need} bytes, but has {have}");
            return Err(Error::invalid(what));
        }
        Ok(header)
    }

    /// Bytes of the largest level.
    fn bytes(&self) -> u64 {
        let (width, height) = (u64::from(self.width), u64::from(self.height));
        match self.encoding {
            Encoding::Blocks(size, _) => {
                width.div_ceil(4).saturating_mul(height.div_ceil(4)).saturating_mul(size as u64)
            }
            Encoding::Bytes(..) => width.saturating_mul(height).saturating_mul(4),
        }
    }
}

fn several() -> Error {
    Error::unsupported("it is a DDS file of several pictures, which no glTF texture may be")
}

fn unread(what: &str) -> Error {
    Error::unsupported(format!(
        "its DDS pixels ({what}) are none of BC1, BC2, BC3, BC7 and 32-bit colours; convert it to PNG first"
    ))
}

/// By `DXGI_FORMAT`.
fn blocks(format: u32) -> Result<Encoding, Error> {
    Ok(match format {
        70..=72 => Encoding::Blocks(8, bcdec_rs::bc1),
        73..=75 => Encoding::Blocks(16, bcdec_rs::bc2),
        76..=78 => Encoding::Blocks(16, bcdec_rs::bc3),
        97..=99 => Encoding::Blocks(16, bcdec_rs::bc7),
        27..=29 => Encoding::Bytes([0, 1, 2], Some(3)),
        87 | 90 | 91 => Encoding::Bytes([2, 1, 0], Some(3)),
        88 | 92 | 93 => Encoding::Bytes([2, 1, 0], None),
        other => return Err(unread(&format!("DXGI format {other}"))),
    })
}

/// By the masks of the channels.
fn plain(flags: u32, bits: u32, masks: [u32; 3], alpha: u32) -> Result<Encoding, Error> {
    let place = |mask: u32| (0..4).find(|k| mask == 0xff << (8 * k));
    let places = masks.map(place);
    let ([Some(r), Some(g), Some(b)], true) = (places, flags & RGB != 0 && bits == 32) else {
        return Err(unread(&format!("{bits} bits, masks {masks:x?}")));
    };
    Ok(Encoding::Bytes([r, g, b], place(alpha)))
}

/// Width and height [px] according to the header, for which there are enough bytes.
pub(super) fn size(bytes: &[u8]) -> Result<(u32, u32), Error> {
    Header::read(bytes).map(|header| (header.width, header.height))
}

/// Width, height and pixels.
pub(super) fn decode(bytes: &[u8]) -> Result<(u32, u32, Vec<[u8; 4]>), Error> {
    let header = Header::read(bytes)?;
    let (width, height) = (header.width as usize, header.height as usize);
    let data = &bytes[header.start..];
    let mut pixels = vec![[0; 4]; width * height];
    match header.encoding {
        Encoding::Bytes([r, g, b], a) => {
            for (to, from) in pixels.iter_mut().zip(data.as_chunks::<4>().0) {
                *to = [from[r], from[g], from[b], a.map_or(255, |a| from[a])];
            }
        }
        Encoding::Blocks(size, unpack) => {
            let across = width.div_ceil(4);
            for (k, block) in data.chunks_exact(size).take(across * height.div_ceil(4)).enumerate() {
                let mut square = [0u8; 64];
                unpack(block, &mut square, 16);
                let (x, y) = (k % across * 4, k / across * 4);
                for (row, line) in square.chunks_exact(16).enumerate().filter(|(row, _)| y + row < height) {
                    let first = (y + row) * width + x;
                    let to = &mut pixels[first..first + (width - x).min(4)];
                    to.copy_from_slice(&line.as_chunks().0[..to.len()]);
                }
            }
        }
    }
    Ok((header.width, header.height, pixels))
}
