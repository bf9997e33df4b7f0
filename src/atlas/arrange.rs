//! Finds density, page size and places: cuts what is larger than a page, lowers the density if pages run out.
//!
//! Charts are packed as what they claim of a grid of cells (`claim`), so that mip levels and blocks of compressed
//! textures do not mix them. Sides of pages are multiples of a cell and of [`BLOCK`]; `choose` has the rest.

use super::Error;
use super::Settings;
use super::align::Piece;
use super::apart::Touched;
use super::cells::Cells;
use super::choose::choose;
use super::choose::padded_area;
use super::claim::Claim;
use super::claim::claim;
use super::claim::reach;
use super::connect;
use super::guard::Guard;
use super::pack::Place;
use super::pack::Sheet;
use super::shape::BLOCK;
use super::shape::Footprint;
use super::shape::Shape;
use super::shape::extent;
use super::shape::fraction_bits;
use super::shape::shape;
use super::shape::touched;
use super::shape::whole_side;
use super::specks;
use super::specks::Small;
use crate::base::Warning;
use crate::base::parallel;
use crate::scene::Scene;
use crate::trace::Tracer;
use core::iter::repeat_n;
use glam::DVec2;
use std::sync::Arc;

/// Pages of an atlas without `max_pages`: 256 pages of 4096² take half a gigabyte as bits alone.
const MOST_PAGES: u32 = 256;

/// How much larger than a page that of a kept layout may be to be made as large.
const LITTLE_MORE: f64 = 1.05;

/// Smallest factor on a density at which the areas fit, before giving up.
const LEAST_FACTOR: f64 = 1e-3;

/// A packed piece.
#[derive(Debug)]
pub(super) struct Block {
    pub(super) piece: Piece,
    pub(super) shape: Shape,
    /// One for each entry of `Piece::owners`.
    pub(super) places: Vec<Place>,
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
    /// Mip levels in which no two charts meet.
    pub(super) mips: u32,
}

/// Scales, cuts and packs the pieces.
pub(super) fn arrange(
    tracer: &Tracer<'_>,
    pieces: Vec<Piece>,
    settings: &Settings,
    guard: &Guard,
    warnings: &mut Vec<Warning>,
) -> Result<Arranged, Error> {
    let scene = tracer.scene();
    let allowed = settings.max_pages.unwrap_or(MOST_PAGES);
    let fail = Error::DoesNotFit {
        charts: pieces.iter().map(|piece| piece.parts.len() * piece.copies()).sum(),
        padding: settings.padding,
        mips: settings.mips,
        pages: allowed,
        side: settings.page_size,
    };
    let density = f64::from(settings.texels_per_meter);
    let small = if settings.share_texels { specks::small(tracer, &pieces, density) } else { vec![None; pieces.len()] };
    let attempt = |factor: f64| attempt(&pieces, &small, density * factor, settings, allowed, guard);
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
    best.lowered.sort_by_key(|(part, _)| *part);
    warn_of_lowered(scene, &best.lowered, warnings);
    let mut arranged = best.finish((density * factor) as f32, fraction_bits(settings.page_size));
    arranged.mips = clean_levels(scene, &arranged, settings.mips, warnings);
    Ok(arranged)
}

/// Mip levels in which no two charts meet: all that were asked for, but for kept layouts whose charts are too close.
fn clean_levels(scene: &Scene, arranged: &Arranged, asked: u32, warnings: &mut Vec<Warning>) -> u32 {
    let mut clean = asked;
    for block in arranged.blocks.iter().filter(|block| block.piece.page.is_some() && block.piece.parts.len() > 1) {
        let is_clean = |level: &u32| !block.places.iter().any(|place| meets(block, *place, *level, arranged));
        let own = (1..=asked).rev().find(is_clean).unwrap_or(0);
        if own < asked {
            let owners = &block.piece.owners[0];
            let name = &scene.parts[owners[0] as usize].name;
            let others = match owners.len() - 1 {
                0 => String::new(),
                count => format!(" and {count} other primitive(s)"),
            };
            let message = format!(
                "charts of the kept TEXCOORD_1 of {name}{others} are so close to each other that mip level {next} mixes \
                 them; leave more space between them, or use --uv generate",
                next = own + 1,
            );
            warnings.push(Warning::new("mips-mixed", message).at(name.clone()));
        }
        clean = clean.min(own);
    }
    clean
}

/// Look-ups in two charts of the block at `place` read one cell of a mip level.
fn meets(block: &Block, place: Place, level: u32, arranged: &Arranged) -> bool {
    let Place { x: left, y: top, .. } = place;
    // As many whole cells as there are to the left and above may be left out.
    let [left, top] = [left, top].map(|at| at - (at >> (level + 1) << (level + 1)) + (1 << (level + 1)));
    let Footprint { width, height, .. } = block.shape.footprint;
    let mut cells = Cells::new(level, [left + width, top + height].map(|n| n + (2 << level)), 1);
    for (face, grid) in block.piece.faces.iter().zip(&block.shape.grid) {
        touched(*grid, arranged.fraction_bits, |y, from, to| {
            (from..to).for_each(|x| cells.cover(0, [left + x, top + y], face.chart));
        });
    }
    cells.are_shared()
}

fn warn_of_lowered(scene: &Scene, lowered: &[(u32, f64)], warnings: &mut Vec<Warning>) {
    for group in lowered.chunk_by(|a, b| a.0 == b.0) {
        let part = &scene.parts[group[0].0 as usize];
        let (name, material) = (&part.name, &scene.materials[part.material].name);
        let least = group.iter().fold(1.0, |least: f64, (_, factor)| least.min(*factor));
        let message = format!(
            "{} chart(s) of {name}, material {material}, are larger than a page and cannot be cut; their density was lowered, at most by the \
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
    places: Vec<Vec<Place>>,
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
            .map(|((piece, shape), places)| Block { piece: unite_sharing(piece, &shape, fraction_bits), shape, places })
            .collect();
        Arranged { page_size: self.size, pages: self.pages, texels_per_meter, fraction_bits, blocks, mips: 0 }
    }
}

fn attempt(
    pieces: &[Piece],
    small: &[Option<Small>],
    density: f64,
    settings: &Settings,
    allowed: u32,
    guard: &Guard,
) -> Result<Attempt, Error> {
    guard.check()?;
    let (sheet, limit) = sheet(settings, allowed);
    let capacity = f64::from(allowed) * limit * limit;
    let area: f64 = pieces.iter().map(|piece| piece.copies() as f64 * area(piece) * density * density).sum();
    if area > capacity {
        // Not even without padding; said before any memory is spent on it.
        return Ok(Attempt::TooLarge((0.97 * capacity / area).sqrt()));
    }
    let mut fitted = Vec::with_capacity(pieces.len());
    let mut lowered = Vec::new();
    let shared = specks::share(pieces, small, density);
    for (piece, _) in pieces.iter().zip(&shared.is_in).filter(|(_, is_in)| !**is_in) {
        match piece.page {
            Some(page) => fitted.push(lower(piece, page, density, (limit, settings.page_size.into()), &mut lowered)),
            None => cut(piece, density, limit, &mut fitted, &mut lowered),
        }
    }
    fitted.extend(shared.texels);
    let bits = fraction_bits(settings.page_size);
    let level = settings.mips;
    let shapes = parallel::map(fitted.len(), |i| shape(&fitted[i], density, bits));
    let claims = parallel::map(shapes.len(), |i| claim(&shapes[i], level, settings.padding, sheet.size[0]));
    let copies = |i: usize| repeat_n(&claims[i], fitted[i].copies());
    let each: Vec<&Claim> = (0..claims.len()).flat_map(copies).collect();
    let cells: Vec<&Footprint> = each.iter().map(|claim| &claim.cells).collect();
    let multiple = (BLOCK >> level).max(1);
    let Some(choice) = choose(&cells, sheet, multiple, guard)? else {
        let room = f64::from(sheet.pages) * f64::from(sheet.size[0] - 2 * sheet.margin).powi(2);
        let factor = (0.95 * room / padded_area(&cells, sheet)).sqrt();
        return Ok(Attempt::TooDense(factor.clamp(0.5, 0.96)));
    };
    let mut at = choice.places.into_iter().zip(&each).map(|(place, claim)| Place {
        x: (place.x << level) + claim.offset[0],
        y: (place.y << level) + claim.offset[1],
        ..place
    });
    let places = fitted.iter().map(|piece| at.by_ref().take(piece.copies()).collect()).collect();
    let size = choice.size.map(|cells| cells << level);
    Ok(Attempt::Fits(Layout { size, pages: choice.pages, pieces: fitted, shapes, places, lowered }))
}

/// The largest sheet, in cells, and the largest side of a chart on it [texels].
fn sheet(settings: &Settings, pages: u32) -> (Sheet, f64) {
    let (level, padding) = (settings.mips, settings.padding);
    let side = settings.page_size >> level;
    if level == 0 {
        let margin = (padding / 2).max(1);
        return (Sheet { size: [side; 2], pages, padding, margin }, f64::from(side - 2 * margin));
    }
    let limit = f64::from(side << level) - 2.0 * f64::from(reach(level, padding));
    (Sheet { size: [side; 2], pages, padding: 0, margin: 0 }, limit)
}

/// Area of the triangles of a piece [m²].
fn area(piece: &Piece) -> f64 {
    piece.corners.iter().map(|c| 0.5 * super::flatten::twice_area(*c).abs()).sum()
}

/// Cuts a piece until every part fits into `limit` texels; where that is impossible, scales it down.
fn cut(piece: &Piece, density: f64, limit: f64, fitted: &mut Vec<Piece>, lowered: &mut Vec<(u32, f64)>) {
    let mut stack = vec![piece.clone()];
    while let Some(mut piece) = stack.pop() {
        let (low, high) = extent(&piece);
        let size = (high - low) * density;
        if size.max_element() <= limit {
            fitted.push(piece);
        } else if piece.faces.len() == 1 || piece.corners.iter().any(|c| spans(*c, density, limit)) {
            // 0.999: the limit holds for sides that are rounded up to whole texels.
            let factor = 0.999 * limit / size.max_element();
            piece.corners.iter_mut().flatten().for_each(|p| *p *= factor);
            lowered.extend(piece.owners.iter().map(|parts| (parts[0], factor)));
            fitted.push(piece);
        } else {
            stack.extend(halves(&piece, low, high));
        }
    }
}

/// A kept layout, scaled down if it is larger than `limit` [texels]: to a page of whole blocks, one of `side` texels if that
/// takes little more.
fn lower(piece: &Piece, page: DVec2, density: f64, (limit, side): (f64, f64), lowered: &mut Vec<(u32, f64)>) -> Piece {
    let (low, high) = extent(piece);
    let sides = DVec2::from([0, 1].map(|k| whole_side(page[k] * density)));
    let texels = ((high - low) / page * sides).max_element();
    if texels <= limit {
        return piece.clone();
    }
    let most = sides.max_element() * limit / texels;
    let most = if (side..LITTLE_MORE * side).contains(&most) { side } else { most };
    let blocks = (most / f64::from(BLOCK)).floor() * f64::from(BLOCK);
    // 0.999: the limit holds for sides that are rounded up to whole texels.
    let wanted = if blocks > 0.0 { blocks } else { 0.999 * most };
    let factor = wanted / (page * density).max_element();
    lowered.extend(piece.owners.iter().map(|parts| (parts[0], factor)));
    piece.clone().scaled(factor)
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
                owners: Arc::clone(&piece.owners),
                parts: piece.parts.clone(),
                faces: members().map(|i| piece.faces[side[i]]).collect(),
                corners: members().map(|i| corners[i]).collect(),
                page: None,
            });
        }
    }
    halves
}

/// In a kept layout, makes one chart of charts that share a texel at this density.
fn unite_sharing(mut piece: Piece, shape: &Shape, bits: u32) -> Piece {
    if piece.page.is_none() {
        return piece;
    }
    let number = Touched::new(&piece, shape, bits).sets.numbers();
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
