//! KTX 2.0 container for BC6H textures.
//!
//! In: mip levels, the largest first, and string attributes. Out: the file. Source: Khronos "KTX File Format
//! Specification" 2.0, sections 3 (layout) and 5 (metadata), and "Khronos Data Format Specification" 1.3, section 5 (the
//! descriptor). `VK_FORMAT_BC6H_UFLOAT_BLOCK`, linear BT.709, no supercompression, so a loader can upload it as it is.
//!
//! * Levels lie in the file from the smallest to the largest, each at a multiple of 16 bytes; the index lists them from
//!   the largest.
//! * Keys are sorted: `KTXorientation` (`rd`: rows from the top), `KTXwriter`, then the attributes of the EXR.

use super::blocks;
use crate::finish::Page;
use crate::output::Error;
use crate::output::exr::Attributes;
use std::collections::BTreeMap;
use std::path::Path;

const IDENTIFIER: [u8; 12] = *b"\xABKTX 20\xBB\r\n\x1A\n";
const VK_FORMAT_BC6H_UFLOAT_BLOCK: u32 = 143;
const HEADER_BYTES: usize = 80;
const LEVEL_BYTES: usize = 24;
const WRITER: &str = concat!("texelwalk ", env!("CARGO_PKG_VERSION"));

/// The file of a texture with these levels. `path` is where it will go, for messages.
///
/// # Errors
/// If there are no levels, or the attributes are longer than the format can say.
pub fn texture(path: &Path, levels: &[Page], attributes: &Attributes) -> Result<Vec<u8>, Error> {
    let first = levels.first().ok_or_else(|| Error::invalid(path, "a texture needs at least one level"))?;
    let descriptor = words(&descriptor());
    let metadata = metadata(attributes);
    let descriptor_at = HEADER_BYTES + LEVEL_BYTES * levels.len();
    let metadata_at = descriptor_at + descriptor.len();
    let size = |bytes: usize| {
        u32::try_from(bytes).map_err(|_| Error::invalid(path, "the attributes are longer than a KTX2 header can say"))
    };
    let mut out = IDENTIFIER.to_vec();
    let (type_size, depth, layers, faces, no_supercompression) = (1, 0, 0, 1, 0);
    out.extend(words(&[VK_FORMAT_BC6H_UFLOAT_BLOCK, type_size, first.width, first.height, depth, layers, faces]));
    out.extend(words(&[size(levels.len())?, no_supercompression]));
    out.extend(words(&[size(descriptor_at)?, size(descriptor.len())?, size(metadata_at)?, size(metadata.len())?]));
    out.extend([0; 16]); // offset and length of supercompression data

    let blocks: Vec<Vec<u8>> = levels.iter().map(blocks::bc6h).collect();
    let start = (metadata_at + metadata.len()).next_multiple_of(blocks::BYTES);
    let mut at = start + blocks.iter().map(Vec::len).sum::<usize>();
    for level in &blocks {
        at -= level.len();
        let length = level.len() as u64;
        out.extend([at as u64, length, length].iter().flat_map(|n| n.to_le_bytes()));
    }
    out.extend(descriptor);
    out.extend(metadata);
    out.resize(start, 0);
    out.extend(blocks.into_iter().rev().flatten());
    Ok(out)
}

/// The data format descriptor: one basic block with one sample, the colour.
fn descriptor() -> [u32; 11] {
    const VERSION_1_3: u32 = 2;
    const BLOCK_SIZE: u32 = 40;
    const MODEL_BC6H: u32 = 133;
    const PRIMARIES_BT709: u32 = 1;
    const TRANSFER_LINEAR: u32 = 1;
    const FOUR_BY_FOUR: u32 = 0x0303;
    const SAMPLE_FLOAT: u32 = 0x80;
    const LAST_BIT: u32 = 127;
    const ONE: u32 = 0x3F80_0000;
    [
        4 + BLOCK_SIZE,
        0, // vendor: Khronos; type: basic
        VERSION_1_3 | BLOCK_SIZE << 16,
        MODEL_BC6H | PRIMARIES_BT709 << 8 | TRANSFER_LINEAR << 16,
        FOUR_BY_FOUR,
        blocks::BYTES as u32,
        0,
        LAST_BIT << 16 | SAMPLE_FLOAT << 24,
        0, // position
        0, // lower: 0.0
        ONE,
    ]
}

fn metadata(attributes: &Attributes) -> Vec<u8> {
    let mut pairs: BTreeMap<&str, &str> = attributes.iter().map(|(k, v)| (k.as_str(), v.as_str())).collect();
    pairs.extend([("KTXorientation", "rd"), ("KTXwriter", WRITER)]);
    let mut out = Vec::new();
    for (key, value) in pairs {
        out.extend(((key.len() + value.len() + 2) as u32).to_le_bytes());
        out.extend([key.as_bytes(), b"\0", value.as_bytes(), b"\0"].concat());
        out.resize(out.len().next_multiple_of(4), 0);
    }
    out
}

fn words(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(width: u32, height: u32) -> Page {
        Page { width, height, pixels: vec![[1.0, 2.0, 3.0, 1.0]; (width * height) as usize] }
    }

    fn word(bytes: &[u8], at: usize) -> usize {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
    }

    #[test]
    fn offsets_lead_to_what_they_name() {
        let attributes = Attributes::from([("texelwalk.quantity".to_owned(), "radiosity".to_owned())]);
        let bytes = texture(Path::new("x"), &[page(9, 5), page(4, 2), page(2, 1), page(1, 1)], &attributes).unwrap();
        assert_eq!([12, 20, 24, 36, 40].map(|at| word(&bytes, at)), [143, 9, 5, 1, 4]);
        let (descriptor, metadata) = (word(&bytes, 48), word(&bytes, 56));
        assert_eq!((descriptor, word(&bytes, descriptor)), (80 + 4 * 24, word(&bytes, 52)));
        assert_eq!(&bytes[metadata + 4..metadata + 22], b"KTXorientation\0rd\0");
        let mut end = bytes.len();
        for (k, blocks) in [6, 1, 1, 1].into_iter().enumerate() {
            let at = 80 + 24 * k;
            assert_eq!(
                (word(&bytes, at) % 16, word(&bytes, at + 8), word(&bytes, at + 16)),
                (0, 16 * blocks, 16 * blocks)
            );
            assert_eq!(word(&bytes, at) + word(&bytes, at + 8), end);
            end = word(&bytes, at);
        }
        assert!(end >= metadata + word(&bytes, 60) && end < metadata + word(&bytes, 60) + 16);
        assert!(texture(Path::new("x"), &[], &attributes).is_err());
    }
}
