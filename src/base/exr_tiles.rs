//! Tiles of EXR files that are larger than any picture needs.
//!
//! The decoder takes memory for a whole tile, however little of it the picture covers: a file of a kilobyte that claims tiles
//! of 67 million by 64 texels took 1.9 GiB.

use exr::meta::BlockDescription;
use exr::meta::header::Header;

/// Texels that any tile may have; larger ones must not have more than the picture.
const MOST: usize = 1 << 20;

/// Tiles have no more texels than they may.
#[must_use]
pub fn has_sound_tiles(header: &Header) -> bool {
    let BlockDescription::Tiles(tiles) = header.blocks else { return true };
    let area = |width: usize, height: usize| width.saturating_mul(height);
    let most = area(header.layer_size.width(), header.layer_size.height()).max(MOST);
    area(tiles.tile_size.width(), tiles.tile_size.height()) <= most
}
