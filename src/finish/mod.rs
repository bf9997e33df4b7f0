//! Irradiance per patch → [`Lightmap`]: the pages as they are stored.

mod assemble;
mod cells;
mod dilate;
mod fill;
mod hidden;
mod judge;
mod network;
mod share;

pub use assemble::assemble;
pub use dilate::dilate;
pub use fill::{fill, refill};
pub use hidden::fill_hidden;
pub use share::{Along, Errors, share};

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

/// The stored light of a scene, by page of its atlas.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lightmap {
    /// In the order of `Chart::page`.
    pub pages: Vec<Page>,
}
