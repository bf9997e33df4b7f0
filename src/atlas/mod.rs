//! [`Scene`] → [`Atlas`]: charts, pages, conservative texel coverage. xatlas lives only here.
//!
//! Lightmap coordinates are kept in texels: x right, y down, texel (0, 0) covers [0, 1)². UV = texels / page size.
//!
//! Steps: weld the triangles of each part by position (`weld`), take planar pieces and smooth components (`region`),
//! flatten them by projection or by xatlas (`flatten`, `chart`), turn each chart to the texel rows (`align`), or keep
//! the part's own `TEXCOORD_1` (`keep`, `sides`), those of a page together (`beside`); put charts smaller than a texel
//! together (`specks`), scale to the density and rasterise (`shape`), find what each chart needs of a page so that mip levels do not mix charts (`claim`, `cells`),
//! pack (`pack`, `choose`, `arrange`), and give every triangle corner its output vertex (`assemble`).
//!
//! Parts that place the same primitive in the same size (`scene::EqualParts`) have one layout, and a place each for every
//! chart; those in the same shape but of other sizes have the same charts, scaled (`alike`).
//!
//! Invariants:
//! * every triangle with an area in a part that receives light has a chart (of parts that are equal, the first decides);
//! * no texel is touched by two charts, and charts that were made here are at least `padding` empty texels apart;
//! * up to mip level `Atlas::mips`, no look-up in a chart reads a cell that a look-up in another chart reads;
//! * vertices lie on a grid of 2⁻ⁿ texels, and charts move by whole texels only, so that coordinates are exact in `f32`
//!   and a chart covers the same texels wherever it is packed;
//! * the result does not depend on the number of threads.

mod align;
mod alike;
mod apart;
mod arrange;
mod assemble;
mod beside;
pub mod cells;
mod chart;
mod choose;
mod claim;
pub(crate) mod connect;
mod flatten;
mod guard;
mod keep;
mod layout;
mod merge;
mod open;
pub(crate) mod overlap;
mod pack;
pub mod raster;
mod region;
mod shape;
mod sides;
pub(crate) mod specks;
mod weld;

use crate::base::Warned;
use crate::base::Warning;
use crate::base::parallel;
use crate::scene::Scene;
use crate::trace::Tracer;
use core::time::Duration;
use guard::Guard;
pub use layout::{ChartedPart, Layout};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// No chart: the triangle has no area, or its part receives no light.
pub const NO_CHART: u32 = u32::MAX;

/// Largest page side [texels]: vertex coordinates need some of the 24 bits of an `f32` for fractions of a texel.
pub const MAX_PAGE_SIZE: u32 = 16384;

/// Most mip levels that can be kept clean: every chart takes at least 2ᵏ × 2ᵏ texels.
pub const MOST_MIPS: u32 = 6;

/// Where every triangle lies on the lightmap pages.
#[derive(Debug, Default)]
pub struct Atlas {
    /// Width and height of every page [texels].
    pub page_size: [u32; 2],
    /// Number of pages.
    pub pages: u32,
    /// Density that was reached, in world space, where a part has no factor of its own [texels/m].
    pub texels_per_meter: f32,
    /// Charts; a chart lies on one page.
    pub charts: Vec<Chart>,
    /// One entry per `Scene::parts`, in the same order.
    pub parts: Vec<ChartedPart>,
    /// Texels of all pages that a chart touches.
    pub covered_texels: u64,
    /// Mip levels, counted from 1, whose bilinear look-ups in a chart read no texel of another chart.
    pub mips: u32,
}

impl Atlas {
    /// Share of all page texels that charts touch, in [0, 1]; 0 without pages.
    #[must_use]
    pub fn utilization(&self) -> f64 {
        let texels = u64::from(self.page_size[0]) * u64::from(self.page_size[1]) * u64::from(self.pages);
        if texels == 0 { 0.0 } else { self.covered_texels as f64 / texels as f64 }
    }
}

/// A connected piece of surface that is flat on a page, or several that share a texel (`specks`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Chart {
    /// Index into `Scene::parts`. Where charts of a kept layout share texels and count as one, their first part.
    pub part: u32,
    /// Page it lies on.
    pub page: u32,
}

/// What happens to a `TEXCOORD_1` of the document.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Uv {
    /// Keep it where it is a usable lightmap layout, otherwise chart anew and warn.
    #[default]
    Auto,
    /// Keep it; where it is missing or unusable, that is an error.
    Keep,
    /// Chart everything anew.
    Generate,
}

/// How to lay out the lightmap.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Wanted density in world space [texels/m], finite and > 0; parts have factors of it.
    pub texels_per_meter: f32,
    /// Largest width and height of a page [texels], 16 to [`MAX_PAGE_SIZE`].
    pub page_size: u32,
    /// Lower the density until this many pages suffice; `None` = as many as needed.
    pub max_pages: Option<u32>,
    /// Empty texels between charts.
    pub padding: u32,
    /// Mip levels that mix no charts, 0 to [`MOST_MIPS`]; 2 and more also keep blocks of 4 × 4 texels apart.
    pub mips: u32,
    /// Use of `TEXCOORD_1`.
    pub uv: Uv,
    /// Put charts smaller than a texel together (`specks`).
    pub share_texels: bool,
    /// Give up after this time.
    pub time_limit: Option<Duration>,
    /// Give up when it becomes true.
    pub cancel: Option<Arc<AtomicBool>>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            texels_per_meter: 16.0,
            page_size: 4096,
            max_pages: None,
            padding: 2,
            mips: 0,
            uv: Uv::Auto,
            share_texels: true,
            time_limit: None,
            cancel: None,
        }
    }
}

/// Why there is no atlas.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// `Settings::cancel` became true.
    #[error("charting was cancelled")]
    Cancelled,
    /// `Settings::time_limit` was exceeded.
    #[error("charting took longer than the time limit of {0:?}; raise the limit or lower the density")]
    TimeLimit(Duration),
    /// Not even at a thousandth of the density at which the bare areas would fit.
    #[error(
        "{charts} charts with {padding} texels of padding and {mips} clean mip levels do not fit on {pages} pages of \
         {side}² texels at any density; allow more or larger pages, less padding, or fewer levels"
    )]
    DoesNotFit {
        /// Number of charts.
        charts: usize,
        /// Padding [texels].
        padding: u32,
        /// Mip levels.
        mips: u32,
        /// Pages that were allowed.
        pages: u32,
        /// Page side [texels].
        side: u32,
    },
    /// `TEXCOORD_1` is to be kept but cannot be.
    #[error("{node}: TEXCOORD_1 cannot be kept as a lightmap layout: {reason}; repair it, or use --uv auto")]
    UnusableUv {
        /// Name of the node.
        node: String,
        /// What is wrong with it.
        reason: String,
    },
    /// `TEXCOORD_1` is to be kept but is not there.
    #[error("{nodes}: there is no TEXCOORD_1 to keep as a lightmap layout; make one, or use --uv auto")]
    MissingUv {
        /// Names of the nodes, with commas.
        nodes: String,
    },
    /// A setting is out of range.
    #[error("{0}")]
    Setting(String),
}

/// What each part's own `TEXCOORD_1` is worth as a lightmap layout at the wanted density: `usable`, or what is wrong with it;
/// `None` where there is none. One entry per `Scene::parts`.
#[must_use]
pub fn existing_layouts(scene: &Scene, settings: &Settings) -> Vec<Option<String>> {
    keep::layouts(scene, settings)
}

/// Charts the parts of a scene that receive light and packs the charts into pages. The tracer is that of the scene; it tells
/// which charts smaller than a texel are about as open as others.
///
/// Warnings: `density-lowered` (all charts, to fit `max_pages`), `chart-density-lowered` (a chart larger than a page),
/// `uv-regenerated` (a `TEXCOORD_1` that is no usable lightmap layout), `mips-mixed` (charts of a kept one are too near to
/// each other for `mips`).
///
/// # Errors
/// [`Error`]: cancelled, out of time, no density fits, a `TEXCOORD_1` that cannot be kept, a setting out of range.
pub fn build(tracer: &Tracer<'_>, settings: &Settings) -> Result<Warned<Atlas>, Error> {
    check(settings)?;
    let scene = tracer.scene();
    let guard = Guard::new(settings.time_limit, settings.cancel.clone());
    let equal = scene.equal_parts();
    let kept = keep::kept_blocks(scene, settings, &equal, &guard)?;
    let mut pieces = fresh_pieces(scene, &equal.sets(|p| scene.parts[p].receives && !kept.part_is_kept[p]), &guard)?;
    pieces.extend(kept.pieces);
    pieces.sort_by_key(|piece| piece.owners[0][0]);
    let mut warnings: Vec<Warning> = kept.warnings.into_iter().map(|(_, warning)| warning).collect();
    let arranged = arrange::arrange(tracer, pieces, settings, &guard, &mut warnings)?;
    let output = assemble::assemble(scene, &arranged, &kept.part_is_kept);
    Ok(Warned { output, warnings })
}

/// Charts of sets of equal parts. Sets that are alike but for their size are charted once.
fn fresh_pieces(scene: &Scene, sets: &[Vec<u32>], guard: &Guard) -> Result<Vec<align::Piece>, Error> {
    let set_of: BTreeMap<usize, usize> = sets.iter().enumerate().map(|(i, set)| (set[0] as usize, i)).collect();
    let like = alike::find(scene, |p| set_of.contains_key(&p));
    let lead = |i: usize| sets[i][0] as usize;
    let owners = |i: usize| -> Arc<[Vec<u32>]> { sets[i].iter().map(|p| vec![*p]).collect() };
    let charted = parallel::map(sets.len(), |i| -> Result<Vec<align::Piece>, Error> {
        if like[lead(i)].is_some() {
            return Ok(Vec::new());
        }
        let surface = weld::Surface::new(scene, &scene.parts[lead(i)]);
        let flats = region::flatten_part(&surface, guard)?;
        let owners = owners(i);
        Ok(flats.iter().map(|flat| align::piece(&surface, flat, &owners)).collect())
    });
    let charted = charted.into_iter().collect::<Result<Vec<_>, Error>>()?;
    let scaled = parallel::map(sets.len(), |i| {
        let density = f64::from(scene.parts[lead(i)].treatment.density);
        let (source, ratio) = like[lead(i)].map_or((i, 1.0), |like| (set_of[&like.part], like.ratio));
        let owners = owners(i);
        let of_set = |piece: &align::Piece| piece.clone().of(&owners).scaled(ratio * density);
        charted[source].iter().map(of_set).collect::<Vec<_>>()
    });
    Ok(scaled.into_iter().flatten().collect())
}

fn check(settings: &Settings) -> Result<(), Error> {
    let density = settings.texels_per_meter;
    if !(density.is_finite() && density > 0.0) {
        return Err(Error::Setting(format!(
            "the density must be a positive number of texels per metre, not {density}"
        )));
    }
    if !(16..=MAX_PAGE_SIZE).contains(&settings.page_size) {
        let side = settings.page_size;
        return Err(Error::Setting(format!("the page size must be 16 to {MAX_PAGE_SIZE} texels, not {side}")));
    }
    if settings.padding > settings.page_size / 4 {
        let padding = settings.padding;
        return Err(Error::Setting(format!("a padding of {padding} texels is more than a quarter of a page")));
    }
    if settings.mips > MOST_MIPS || 8 << settings.mips > settings.page_size {
        let (mips, side) = (settings.mips, settings.page_size);
        return Err(Error::Setting(format!(
            "{mips} clean mip levels are too many; there can be up to {MOST_MIPS}, and pages of {side} texels must be \
             eight times as wide as their smallest texel"
        )));
    }
    if settings.max_pages == Some(0) {
        return Err(Error::Setting("at least one page is needed".to_owned()));
    }
    Ok(())
}
