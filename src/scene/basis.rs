//! Decodes KTX2 images of `KHR_texture_basisu`: ETC1S (`BasisLZ`) and UASTC, plain or by Zstandard, to 8-bit RGBA.
//!
//! In: the bytes of a file. Out: the pixels of its largest level, row 0 on top as the extension demands.
//!
//! Source: Khronos, "KTX File Format Specification 2.0", section 3 (header, level index); the decoder is the crate
//! `basisu`, whose pixels equal those of the reference transcoder (`tests/library/basis.rs`).
//!
//! What the header claims is compared with the bytes that exist before the decoder allocates ([`size`]). Damaged streams
//! must be refused, not end the program: `basisu` indexes by what it reads, so a panic of it is turned into an error.

use super::Error;
use basisu::DecodeFlags;
use basisu::SourceFormat;
use basisu::TargetFormat;
use basisu::Transcoder;
use std::panic::AssertUnwindSafe;
use std::panic::catch_unwind;

/// First bytes of a file.
pub(super) const MAGIC: &[u8] = b"\xABKTX 20\xBB\r\n\x1A\n";

/// A block of UASTC is 4 × 4 pixels in so many bytes.
const UASTC_BLOCK: u64 = 16;

/// The value of `supercompressionScheme` for Zstandard.
const ZSTANDARD: u32 = 2;

/// Width and height [px] according to the header; what the first level takes when it is unpacked must fit to them.
pub(super) fn size(bytes: &[u8]) -> Result<(u32, u32), Error> {
    let word = |at: usize| bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let (Some(width), Some(height), Some(scheme), Some(low), Some(high)) =
        (word(20), word(24), word(44), word(96), word(100))
    else {
        return Err(Error::invalid("its KTX2 header is truncated"));
    };
    let unpacked = u64::from(high) << 32 | u64::from(low);
    let blocks = u64::from(width.div_ceil(4)) * u64::from(height.div_ceil(4));
    if scheme == ZSTANDARD && unpacked != blocks * UASTC_BLOCK {
        return Err(Error::invalid(format!("its first level claims {unpacked} bytes for {width} × {height} pixels")));
    }
    Ok((width, height))
}

/// Width, height and pixels. [`size`] must have accepted the bytes.
pub(super) fn decode(bytes: &[u8]) -> Result<(u32, u32, Vec<[u8; 4]>), Error> {
    let damaged = || Error::invalid("its KTX2 stream is damaged");
    catch_unwind(AssertUnwindSafe(|| pixels(bytes))).unwrap_or_else(|_| Err(damaged()))
}

fn pixels(bytes: &[u8]) -> Result<(u32, u32, Vec<[u8; 4]>), Error> {
    let fail = |e: basisu::Error| Error::invalid(format!("its KTX2 data is no texture of Basis Universal ({e:?})"));
    let image = Transcoder::new(bytes).map_err(fail)?;
    if !matches!(image.source_format(), SourceFormat::Etc1s | SourceFormat::UastcLdr) {
        return Err(Error::unsupported("it is KTX2, but neither ETC1S nor UASTC; convert it to PNG or JPEG first"));
    }
    if image.face_count() > 1 || image.layer_count() > 1 {
        return Err(Error::invalid("it is a KTX2 file of several pictures, which no glTF texture may be"));
    }
    let (width, height) = image.base_dimensions();
    let rgba = image.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE).map_err(fail)?;
    Ok((width, height, rgba.as_chunks().0.to_vec()))
}
