//! Finds density, page size and places: cuts what is larger than a page, lowers the density if pages run out.
//!
//! One page is made as small as it can be, its sides multiples of 4 (blocks of compressed textures); several pages have
//! the largest width, and a height that fills the last one too.

use super::Error;
use super::Settings;
use super::align::Piece;
use super::connect;
use super::guard::Guard;
use super::pack::Place;
use super::pack::Sheet;
use super::pack::pack;
use super::shape::Footprint;
use super::shape::Shape;
use super::shape::extent;
use super::shape::fraction_bits;
use super::shape::shape;
use super::shape::touched;
use crate::base::Warning;
use crate::base::parallel;
use crate::scene::Scene;
use glam::DVec2;

/// Pages of an atlas without `max_pages`: 256 pages of 4096² take half a gigabyte as bits alone.
const MOST_PAGES: u32 = 256;

/// Share of the page area that the first guess of a page size expects to be filled, padding included.
const EXPECTED_FILL: f64 = 0.94;

/// Page widths that are tried for one page, relative to the first guess; fewer where there are many charts.
const WIDTHS: [f64; 5] = [1.0, 1.06, 0.94, 1.15, 1.3];

/// Charts from which on only two widths are tried.
const MANY_CHARTS: usize = 3000;

/// Smallest factor on a density at which the areas fit, before giving up.
const LEAST_FACTOR: f64 = 1e-3;

/// A packed piece.
#[derive(Debug)]
pub(super) struct Block {
    pub(super) piece: Piece,
    pub(super) shape: Shape,
    pub(super) place: Place,
}

/// The packed pages.
#[derive(Debug)]
pub(super) struct Arranged {
    pub(super) page_size: [u32; 2],
    pub(super) pages: u32,
    pub(super) texels_per_meter: f32,
    /// Bits of the fixed-point fraction in `Shape::grid`.
    pub(super) fraction_bits: u32,
    pub(super) blocks: Vec<Block>,
}

/// Scales, cuts and packs the pieces.
pub(super) fn arrange(
    scene: &Scene,
    pieces: Vec<Piece>,
    settings: &Settings,
    guard: &Guard,
    warnings: &mut Vec<Warning>,
) -> Result<Arranged, Error> {
    let allowed = settings.max_pages.unwrap_or(MOST_PAGES);
    let fail = Error::DoesNotFit {
        charts: pieces.iter().map(|piece| piece.parts.len()).sum(),
        padding: settings.padding,
        pages: allowed,
        side: settings.page_size,
    };
    let density = f64::from(settings.texels_per_meter);
    let attempt = |factor: f64| attempt(&pieces, density * factor, settings, allowed, guard);
    let mut factor = 1.0;
    let mut too_dense = None;
    let mut least = LEAST_FACTOR;
    let mut best = loop {
        match attempt(factor)? {
            Attempt::Fits(layout) => break layout,
            Attempt::TooLarge(step) => {
                too_dense = Some(factor);
                factor *= step;
                least = factor * LEAST_FACTOR;
            }
            Attempt::TooDense(step) => {
                too_dense = Some(factor);
                factor *= step;
            }
        }
        if factor < least {
            return Err(fail);
        }
    };
    if let Some(mut high) = too_dense {
        for _ in 0..3 {
            let middle = 0.5 * (factor + high);
            match attempt(middle)? {
                Attempt::Fits(layout) => (best, factor) = (layout, middle),
                Attempt::TooLarge(_) | Attempt::TooDense(_) => high = middle,
            }
        }
        let message = format!(
            "the charts do not fit on {allowed} pages of {side} x {side} texels at {density} texels/m; the density was \
             lowered by the factor {factor:.4} to {reached:.3} texels/m",
            side = settings.page_size,
            reached = density * factor,
        );
        warnings.push(Warning::new("density-lowered", message));
    }
    warn_of_lowered(scene, &best.lowered, warnings);
    Ok(best.finish((density * factor) as f32, fraction_bits(settings.page_size)))
}

fn warn_of_lowered(scene: &Scene, lowered: &[(u32, f64)], warnings: &mut Vec<Warning>) {
    for group in lowered.chunk_by(|a, b| a.0 == b.0) {
        let name = &scene.parts[group[0].0 as usize].name;
        let least = group.iter().fold(1.0, |least: f64, (_, factor)| least.min(*factor));
        let message = format!(
            "{} chart(s) of {name} are larger than a page and cannot be cut; their density was lowered, at most by the \
             factor {least:.4}",
            group.len(),
        );
        warnings.push(Warning::new("chart-density-lowered", message).at(name.clone()));
    }
}

enum Attempt {
    Fits(Layout),
    /// The area alone is more than the pages hold; try again at this factor of the density.
    TooLarge(f64),
    /// No place was found; try again at this factor of the density.
    TooDense(f64),
}

struct Layout {
    size: [u32; 2],
    pages: u32,
    pieces: Vec<Piece>,
    shapes: Vec<Shape>,
    places: Vec<Place>,
    /// Part and factor of charts that are larger than a page.
    lowered: Vec<(u32, f64)>,
}

impl Layout {
    fn finish(self, texels_per_meter: f32, fraction_bits: u32) -> Arranged {
        let blocks = self
            .pieces
            .into_iter()
            .zip(self.shapes)
            .zip(self.places)
            .map(|((piece, shape), place)| Block { piece: unite_sharing(piece, &shape, fraction_bits), shape, place })
            .collect();
        Arranged { page_size: self.size, pages: self.pages, texels_per_meter, fraction_bits, blocks }
    }
}

fn attempt(pieces: &[Piece], density: f64, settings: &Settings, allowed: u32, guard: &Guard) -> Result<Attempt, Error> {
    guard.check()?;
    let sheet = Sheet { size: [settings.page_size; 2], pages: allowed, padding: settings.padding };
    let limit = f64::from(settings.page_size - 2 * sheet.margin());
    let capacity = f64::from(allowed) * limit * limit;
    let area: f64 = pieces.iter().map(|piece| area(piece) * density * density).sum();
    if area > capacity {
        // Not even without padding; said before any memory is spent on it.
        return Ok(Attempt::TooLarge((0.97 * capacity / area).sqrt()));
    }
    let mut fitted = Vec::with_capacity(pieces.len());
    let mut lowered = Vec::new();
    for piece in pieces {
        cut(piece, density, limit, &mut fitted, &mut lowered);
    }
    let bits = fraction_bits(settings.page_size);
    let shapes = parallel::map(fitted.len(), |i| shape(&fitted[i], density, bits));
    let footprints: Vec<&Footprint> = shapes.iter().map(|shape| &shape.footprint).collect();
    match choose(&footprints, sheet, guard)? {
        Some((size, pages, places)) => {
            Ok(Attempt::Fits(Layout { size, pages, pieces: fitted, shapes, places, lowered }))
        }
        None => {
            let padded = padded_area(&footprints, sheet);
            Ok(Attempt::TooDense((0.95 * capacity / padded).sqrt().clamp(0.5, 0.96)))
        }
    }
}

/// Area of the triangles of a piece [m²].
fn area(piece: &Piece) -> f64 {
    piece.corners.iter().map(|c| 0.5 * super::flatten::twice_area(*c).abs()).sum()
}

/// Texels that footprints need together with their padding, estimated.
fn padded_area(footprints: &[&Footprint], sheet: Sheet) -> f64 {
    let pad = u64::from(sheet.padding);
    footprints.iter().map(|f| (f.texels + pad * (u64::from(f.width + f.height) + pad)) as f64).sum()
}

/// A page size, the number of pages, and places.
type Choice = ([u32; 2], u32, Vec<Place>);

/// Chooses the page size.
fn choose(footprints: &[&Footprint], sheet: Sheet, guard: &Guard) -> Result<Option<Choice>, Error> {
    if footprints.is_empty() {
        return Ok(Some(([0, 0], 0, Vec::new())));
    }
    let side = sheet.size[0];
    let margin = 2 * sheet.margin();
    let guess = (padded_area(footprints, sheet) / EXPECTED_FILL).sqrt();
    let widest = footprints.iter().map(|f| f.width + margin).max().unwrap_or(0);
    let tries = if footprints.len() > MANY_CHARTS { 2 } else { WIDTHS.len() };
    let mut best: Option<Choice> = None;
    let mut tried = Vec::new();
    if guess <= f64::from(side) {
        for factor in &WIDTHS[..tries] {
            let width = round_up(((guess * factor) as u32).max(widest), side);
            if tried.contains(&width) {
                continue;
            }
            tried.push(width);
            let one = Sheet { size: [width, side], pages: 1, ..sheet };
            if let Some(places) = pack(footprints, one, guard)? {
                let size = used(footprints, &places, sheet);
                if best.as_ref().is_none_or(|best| texels(size) < texels(best.0)) {
                    best = Some((size, 1, places));
                }
            }
        }
    }
    if best.is_some() {
        return Ok(best);
    }
    several(footprints, sheet, guard)
}

/// Several pages of full width, all of the same height.
fn several(footprints: &[&Footprint], sheet: Sheet, guard: &Guard) -> Result<Option<Choice>, Error> {
    let Some(places) = pack(footprints, sheet, guard)? else {
        return Ok(None);
    };
    let pages = places.iter().map(|place| place.page + 1).max().unwrap_or(0);
    let side = sheet.size[0];
    if pages == 1 {
        return Ok(Some((used(footprints, &places, sheet), 1, places)));
    }
    let last = footprints.iter().zip(&places).filter(|(_, place)| place.page + 1 == pages);
    let last_height = last.map(|(f, place)| place.y + f.height + sheet.margin()).max().unwrap_or(side);
    let tallest = footprints.iter().map(|f| f.height + 2 * sheet.margin()).max().unwrap_or(0);
    let level = f64::from(side * (pages - 1) + last_height) / f64::from(pages);
    for slack in [1.01, 1.04] {
        let height = round_up(((level * slack) as u32).max(tallest), side);
        if height < side {
            let lower = Sheet { size: [side, height], pages, ..sheet };
            if let Some(places) = pack(footprints, lower, guard)? {
                return Ok(Some((lower.size, pages, places)));
            }
        }
    }
    Ok(Some((sheet.size, pages, places)))
}

fn texels(size: [u32; 2]) -> u64 {
    u64::from(size[0]) * u64::from(size[1])
}

/// Size of the page that is in use.
fn used(footprints: &[&Footprint], places: &[Place], sheet: Sheet) -> [u32; 2] {
    let ends = footprints.iter().zip(places).map(|(f, place)| [place.x + f.width, place.y + f.height]);
    let [width, height] = ends.fold([0, 0], |a: [u32; 2], b| [a[0].max(b[0]), a[1].max(b[1])]);
    let side = sheet.size[0];
    [round_up(width + sheet.margin(), side), round_up(height + sheet.margin(), side)]
}

/// The next multiple of 4, but not more than the largest page side.
fn round_up(texels: u32, side: u32) -> u32 {
    texels.next_multiple_of(4).min(side)
}

/// Cuts a piece until every part fits into `limit` texels; where that is impossible, scales it down.
fn cut(piece: &Piece, density: f64, limit: f64, fitted: &mut Vec<Piece>, lowered: &mut Vec<(u32, f64)>) {
    let mut stack = vec![piece.clone()];
    while let Some(mut piece) = stack.pop() {
        let (low, high) = extent(&piece);
        let size = (high - low) * density;
        if size.max_element() <= limit {
            fitted.push(piece);
        } else if piece.kept || piece.faces.len() == 1 || piece.corners.iter().any(|c| spans(*c, density, limit)) {
            // 0.999: the limit holds for sides that are rounded up to whole texels.
            let factor = 0.999 * limit / size.max_element();
            piece.corners.iter_mut().flatten().for_each(|p| *p *= factor);
            lowered.push((piece.parts[0], factor));
            fitted.push(piece);
        } else {
            stack.extend(halves(&piece, low, high));
        }
    }
}

/// The triangle alone is larger than a page.
fn spans(corners: [DVec2; 3], density: f64, limit: f64) -> bool {
    let low = corners[0].min(corners[1]).min(corners[2]);
    let high = corners[0].max(corners[1]).max(corners[2]);
    (high - low).max_element() * density > limit
}

/// Both sides of the middle across the longer side, each in connected pieces.
fn halves(piece: &Piece, low: DVec2, high: DVec2) -> Vec<Piece> {
    let axis = if high.x - low.x >= high.y - low.y { 0 } else { 1 };
    let mut order: Vec<usize> = (0..piece.faces.len()).collect();
    let center = |i: usize| piece.corners[i].iter().map(|p| p[axis]).sum::<f64>() / 3.0;
    order.sort_by(|a, b| center(*a).total_cmp(&center(*b)).then(a.cmp(b)));
    let middle = 0.5 * (low[axis] + high[axis]);
    let split = order.partition_point(|i| center(*i) < middle).clamp(1, order.len() - 1);
    let mut halves = Vec::new();
    for side in [&order[..split], &order[split..]] {
        let corners: Vec<[DVec2; 3]> = side.iter().map(|i| piece.corners[*i]).collect();
        let component = connect::components(&corners);
        for id in 0..component.iter().map(|c| c + 1).max().unwrap_or(0) {
            let members = || (0..side.len()).filter(|i| component[*i] == id);
            halves.push(Piece {
                parts: piece.parts.clone(),
                faces: members().map(|i| piece.faces[side[i]]).collect(),
                corners: members().map(|i| corners[i]).collect(),
                kept: piece.kept,
            });
        }
    }
    halves
}

/// In a kept layout, makes one chart of charts that share a texel at this density.
fn unite_sharing(mut piece: Piece, shape: &Shape, bits: u32) -> Piece {
    if !piece.kept {
        return piece;
    }
    let sets = &mut sharing(&piece, shape, bits);
    let number = sets.numbers();
    let count = number.iter().map(|n| n + 1).max().unwrap_or(0) as usize;
    let mut parts = vec![u32::MAX; count];
    for (chart, n) in number.iter().enumerate() {
        parts[*n as usize] = parts[*n as usize].min(piece.parts[chart]);
    }
    for face in &mut piece.faces {
        face.chart = number[face.chart as usize];
    }
    piece.parts = parts;
    piece
}

/// Sets of the piece's charts that share texels.
pub(super) fn sharing(piece: &Piece, shape: &Shape, bits: u32) -> connect::Sets {
    let mut sets = connect::Sets::new(piece.parts.len());
    let width = shape.footprint.width as usize;
    let mut owner = vec![u32::MAX; width * shape.footprint.height as usize];
    for (face, grid) in piece.faces.iter().zip(&shape.grid) {
        touched(*grid, bits, |y, from, to| {
            for x in from..to {
                let texel = &mut owner[y as usize * width + x as usize];
                if *texel != u32::MAX && *texel != face.chart {
                    sets.join(*texel as usize, face.chart as usize);
                }
                *texel = face.chart;
            }
        });
    }
    sets
}
