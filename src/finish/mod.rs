//! Irradiance per patch → [`Lightmap`]: the pages as they are stored.

mod assemble;
mod cells;
mod dilate;
mod fill;
mod hidden;
mod judge;
mod network;
mod share;
mod trend;
mod ways;
mod windows;

pub use assemble::assemble;
pub use dilate::dilate;
pub use fill::{fill, refill};
pub use hidden::fill_hidden;
pub use network::Network;
pub use share::{Along, Errors, share};
pub use ways::Ways;

/// One page of a lightmap, row-major, row 0 = v 0.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Page {
    /// Width [texels].
    pub width: u32,
    /// Height [texels].
    pub height: u32,
    /// `width` × `height` linear Rec.709 values in the unit of the stored quantity, and coverage in the fourth place:
    /// 1 where a chart lies on the texel, 0 elsewhere.
    pub pixels: Vec<[f32; 4]>,
}

impl Page {
    /// The up to eight pixels around one.
    pub(crate) fn around(&self, pixel: usize) -> impl Iterator<Item = usize> + use<> {
        let (width, height) = (self.width as usize, self.height as usize);
        let (x, y) = (pixel % width, pixel / width);
        let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
        let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
        rows.flat_map(move |y| columns.clone().map(move |x| y * width + x)).filter(move |near| *near != pixel)
    }
}

/// The stored light of a scene, by page of its atlas.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lightmap {
    /// In the order of `Chart::page`.
    pub pages: Vec<Page>,
}
