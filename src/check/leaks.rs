//! Light and darkness that come through walls, because a look-up mixes texels of both sides.
//!
//! At points spread over the surface the bilinear value is compared with that of those of its four texels whose surface
//! can be seen from the point, along two short segments above the surface, as linked texels see each other. What lies
//! buried in solids is never seen. Texels outside of the chart have no part on either side; they are the padding's.
//!
//! *Leak*: (look-up − seen) over the largest texel, where what is seen is darker than [`DARK`] of it. *Dark strip*:
//! (seen − look-up) over what is seen, where that is lit.
//!
//! Limits: at a point that sees none of its texels nothing can be said; of double-sided surfaces the front is looked at.

use super::measure::{Kind, Measure, Tally};
use super::subject::{FLOOR, Subject};
use crate::base::low_discrepancy::Sequence;
use crate::base::{Rgb, parallel};
use crate::patches::{HEIGHTS, PatchSurface, Spot, SurfacePoint};
use glam::Vec2;

/// Points per texel, and in all.
const PER_TEXEL: usize = 4;
const MOST_POINTS: usize = 2_000_000;

/// Texels per chunk of work.
const CHUNK: usize = 256;

/// Share of the brightest texel below which a point is dark.
const DARK: f32 = 0.01;

/// Share of the mean light above which a point is lit.
const LIT: f32 = 0.1;

/// Texels that differ by less can neither leak nor darken by a twentieth.
const ALIKE: f32 = 0.99;

/// Least weight of what is seen: below it, it is rounding.
const LEAST_WEIGHT: f32 = 1e-3;

/// Both measures.
pub(super) fn measure(subject: &Subject<'_>) -> Vec<Measure> {
    let patches = &subject.patches;
    let points = (MOST_POINTS / patches.front.max(1)).clamp(1, PER_TEXEL) as u32;
    let limits = [Kind::Leaks, Kind::DarkStrip].map(|k| subject.settings.limit(k));
    let chunks = parallel::map_chunks(patches.front, CHUNK, |range| {
        let mut tallies = [Tally::default(), Tally::default()];
        for i in range {
            if patches.exposed[i] > 0.0 {
                texel(subject, i, points, limits, &mut tallies);
            }
        }
        tallies
    });
    let (leaks, strips): (Vec<Tally>, Vec<Tally>) = chunks.into_iter().map(|[leak, strip]| (leak, strip)).unzip();
    let of = |tallies: Vec<Tally>, kind: Kind| {
        let tally = Tally::join(tallies);
        let value = tally.worst();
        let mut measure = tally.measure(subject, kind, value);
        let share = 100.0 * measure.count as f64 / measure.of.max(1) as f64;
        measure.notes.push(format!("above the limit at {share:.3} % of the points"));
        measure
    };
    vec![of(leaks, Kind::Leaks), of(strips, Kind::DarkStrip)]
}

/// Looks at the points of one texel.
fn texel(subject: &Subject<'_>, i: usize, points: u32, limits: [f64; 2], tallies: &mut [Tally; 2]) {
    if is_open(subject, i) {
        tallies.iter_mut().for_each(|t| t.of += u64::from(points));
        return;
    }
    let surface = PatchSurface::new(subject.tracer, &subject.patches, i);
    let sequence = Sequence::new(i as u64);
    for k in 0..points {
        let [x, y, ..] = sequence.point(k);
        let spot = surface.sample(Vec2::new(x, y));
        let [leak, strip] = look(subject, i, &surface, &spot).unwrap_or([0.0; 2]);
        tallies[0].look(leak, limits[0], || spot.point);
        tallies[1].look(strip, limits[1], || spot.point);
    }
}

/// No look-up in the texel can read anything that is hidden and different.
fn is_open(subject: &Subject<'_>, i: usize) -> bool {
    let patches = &subject.patches;
    if patches.exposed[i] >= 1.0 && subject.graph.neighbors(i).len() == 8 {
        return true;
    }
    let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
    let (mut least, mut most) = (f32::INFINITY, 0.0f32);
    for k in 0..9 {
        if let Some(j) = patches.front_at(page, x as i32 + k % 3 - 1, y as i32 + k / 3 - 1) {
            let light = subject.light(j).max_element();
            (least, most) = (least.min(light), most.max(light));
        }
    }
    most <= FLOOR * subject.mean || least >= ALIKE * most
}

/// Leak and dark strip at a point of texel `i`.
fn look(subject: &Subject<'_>, i: usize, surface: &PatchSurface<'_>, spot: &Spot) -> Option<[f64; 2]> {
    let patches = &subject.patches;
    let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
    let corner = Vec2::new(x as f32, y as f32) + spot.within - 0.5;
    let (floor, fraction) = (corner.floor(), corner - corner.floor());
    let (mut all, mut all_weight, mut seen, mut seen_weight, mut brightest) = (Rgb::ZERO, 0.0, Rgb::ZERO, 0.0, 0.0f32);
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let share = |d: i32, f: f32| if d == 0 { 1.0 - f } else { f };
        let weight = share(dx, fraction.x) * share(dy, fraction.y);
        let Some(j) = patches.front_at(page, floor.x as i32 + dx, floor.y as i32 + dy) else { continue };
        if weight <= 0.0 || patches.chart(j) != patches.chart(i) {
            continue;
        }
        let light = subject.light(j);
        all += light * weight;
        all_weight += weight;
        brightest = brightest.max(light.max_element());
        if sees(subject, spot.point, surface.normal(spot), i, j) {
            seen += light * weight;
            seen_weight += weight;
        }
    }
    if seen_weight < LEAST_WEIGHT || brightest <= FLOOR * subject.mean || seen_weight == all_weight {
        return None;
    }
    let (all, seen) = (all / all_weight, seen / seen_weight);
    let dark = seen.max_element() < DARK * brightest;
    let leak = if dark { (all - seen).max_element() / brightest } else { 0.0 };
    let lit = seen.max_element() > LIT * subject.mean;
    let strip = if lit { (seen.max_element() - all.max_element()) / seen.max_element() } else { 0.0 };
    Some([f64::from(leak.max(0.0)), f64::from(strip.max(0.0))])
}

/// The surface of texel `j` can be seen from a point of texel `i`.
fn sees(subject: &Subject<'_>, point: SurfacePoint, normal: glam::Vec3, i: usize, j: usize) -> bool {
    let patches = &subject.patches;
    if patches.exposed[j] <= 0.0 {
        return false;
    }
    let edge = patches.texel_edge(i).min(patches.texel_edge(j));
    let position = subject.scene.position(point.triangle, point.b);
    HEIGHTS.iter().all(|height| {
        let from = position + normal * (height * edge);
        subject.tracer.segment_clear(from, patches.position[j] + patches.normal[j] * (height * edge))
    })
}
