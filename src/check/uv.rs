//! Lightmap coordinates: missing, outside of the page, without area, claimed twice.
//!
//! Overlap is decided by 16 samples per texel with the half-open rules of [`crate::atlas::overlap`], so triangles that
//! share an edge never overlap, and sub-texel overlaps between charts are found too.
//!
//! Limits: coordinates that are no numbers are replaced by the loader, so they are known by its warnings; overlaps thinner
//! than a quarter of a texel can be missed.

use super::measure::{Kind, Measure, Tally};
use super::subject::{Subject, texel_area};
use crate::atlas::NO_CHART;
use crate::atlas::overlap::{STEPS, visit_samples};
use crate::base::{Warning, parallel};
use crate::patches::SurfacePoint;
use glam::Vec2;

/// Samples per texel side.
const SAMPLES: i64 = 4;

/// Area on the page over what the density of the scene would give, below which a triangle has none.
const NONE: f64 = 1e-3;

/// A point of a triangle that stands for all of it.
const MIDDLE: Vec2 = Vec2::splat(1.0 / 3.0);

/// The four measures of coordinates; `warnings` are those of the loader.
pub(super) fn measure(subject: &Subject<'_>, warnings: &[Warning]) -> Vec<Measure> {
    vec![missing(subject, warnings), range(subject), overlap(subject), degenerate(subject)]
}

fn middle(triangle: usize) -> SurfacePoint {
    SurfacePoint { triangle: triangle as u32, b: MIDDLE }
}

fn missing(subject: &Subject<'_>, warnings: &[Warning]) -> Measure {
    let limit = subject.settings.limit(Kind::UvMissing);
    let (mut tally, mut notes) = (Tally::default(), vec![]);
    for part in subject.scene.parts.iter().filter(|p| p.receives) {
        let range = part.triangles.start as usize..part.triangles.end as usize;
        let area = range.clone().map(|t| subject.area[t]).fold(0.0, |a, b| a + b);
        let largest = range.clone().max_by(|a, b| subject.area[*a].total_cmp(&subject.area[*b])).unwrap_or(0);
        let none = area > 0.0 && range.clone().all(|t| subject.flat[t].is_none());
        tally.look(if none { 1.0 } else { 0.0 }, limit, || middle(largest));
        if none && notes.len() < 20 {
            notes.push(format!("{}, mesh {} primitive {}, has no lightmap", part.name, part.mesh, part.primitive));
        }
    }
    let sets = subject.scene.materials.iter().filter_map(|m| m.lightmap_uv_set);
    let mut sets: Vec<String> = sets.map(|set| format!("TEXCOORD_{set} are not finite")).collect();
    sets.sort_unstable();
    sets.dedup();
    let bad = |w: &&Warning| w.code == "bad-texcoord" && sets.iter().any(|s| w.message.contains(s.as_str()));
    let broken: Vec<&Warning> = warnings.iter().filter(bad).collect();
    tally.count += broken.len() as u64;
    notes.extend(broken.iter().map(|w| w.message.clone()));
    let value = tally.count as f64;
    let mut measure = tally.measure(subject, Kind::UvMissing, value);
    measure.notes = notes;
    measure
}

/// Sum of the areas of triangles that receive light and have a place on a page [m²].
fn placed_area(subject: &Subject<'_>) -> f64 {
    let placed = |t: &usize| subject.flat[*t].is_some();
    (0..subject.flat.len()).filter(placed).map(|t| subject.area[t]).fold(0.0, |a, b| a + b).max(f64::MIN_POSITIVE)
}

fn range(subject: &Subject<'_>) -> Measure {
    let (mut tally, mut outside) = (Tally::default(), 0.0);
    for (t, flat) in subject.flat.iter().enumerate() {
        let Some(flat) = flat else { continue };
        let page = subject.page(flat.page);
        let size = Vec2::new(page.width as f32, page.height as f32);
        let beyond = |p: Vec2| f64::from((-p).max(p - size).max_element().max(0.0));
        let worst = flat.uv.map(beyond).into_iter().fold(0.0, f64::max);
        tally.look(if flat.inside { 0.0 } else { worst }, 0.0, || middle(t));
        outside += if flat.inside { 0.0 } else { subject.area[t] };
    }
    let mut measure = tally.measure(subject, Kind::UvRange, outside / placed_area(subject));
    if measure.count > 0 {
        measure.notes.push(format!("{} triangles; the worst is {:.1} texels outside", measure.count, measure.worst));
    }
    measure
}

fn degenerate(subject: &Subject<'_>) -> Measure {
    let inside = |t: &usize| subject.flat[*t].is_some_and(|f| f.inside);
    let all: Vec<usize> = (0..subject.flat.len()).filter(inside).collect();
    let flat_area = |t: usize| subject.flat[t].map_or(0.0, |f| texel_area(&f.uv));
    let (mut world, mut texels) = (0.0, 0.0);
    for &t in &all {
        world += subject.area[t];
        texels += flat_area(t);
    }
    let density = texels / world.max(f64::MIN_POSITIVE);
    let (mut tally, mut collapsed) = (Tally::default(), 0.0);
    for t in all {
        let none = subject.area[t] > 0.0 && flat_area(t) <= NONE * density * subject.area[t];
        let area = if none { subject.area[t] } else { 0.0 };
        tally.look(area, 0.0, || middle(t));
        collapsed += area;
    }
    let mut measure = tally.measure(subject, Kind::UvDegenerate, collapsed / world.max(f64::MIN_POSITIVE));
    if measure.count > 0 {
        measure.notes.push(format!("{} triangles, the largest of {:.3} m²", measure.count, measure.worst));
    }
    measure
}

/// What overlaps on one page.
#[derive(Default)]
struct Doubles {
    samples: u64,
    /// Triangle and place [samples] of what came second.
    double: Vec<(u32, [i64; 2])>,
}

fn overlap(subject: &Subject<'_>) -> Measure {
    let pages = parallel::map(subject.lightmaps.pages().len(), |page| doubles(subject, page as u32));
    let (mut tally, mut samples, mut doubled) = (Tally::default(), 0, 0);
    let limit = subject.settings.limit(Kind::UvOverlap);
    for mut page in pages {
        samples += page.samples;
        doubled += page.double.len() as u64;
        page.double.sort_unstable_by_key(|(t, p)| (p.map(|x| x.div_euclid(SAMPLES)), *t));
        for texel in
            page.double.chunk_by(|a, b| a.1.map(|x| x.div_euclid(SAMPLES)) == b.1.map(|x| x.div_euclid(SAMPLES)))
        {
            let (triangle, at) = texel[texel.len() / 2];
            let share = texel.len() as f64 / (SAMPLES * SAMPLES) as f64;
            tally.look(share, limit, || sample_point(subject, triangle, at));
        }
    }
    tally.of = samples / (SAMPLES * SAMPLES) as u64;
    let value = doubled as f64 / samples.max(1) as f64;
    let texels = doubled as f64 / (SAMPLES * SAMPLES) as f64;
    let mut measure = tally.measure(subject, Kind::UvOverlap, value);
    if doubled > 0 {
        measure.notes.push(format!("{texels:.1} texels are claimed again"));
    }
    measure
}

fn sample_point(subject: &Subject<'_>, triangle: u32, at: [i64; 2]) -> SurfacePoint {
    let place = Vec2::from(at.map(|x| (x as f32 + 0.5) / SAMPLES as f32));
    let [a, b, c] = subject.flat[triangle as usize].map_or([Vec2::ZERO; 3], |f| f.uv);
    let (e1, e2, p) = (b - a, c - a, place - a);
    let area = e1.perp_dot(e2);
    let b1 = (p.perp_dot(e2) / area).clamp(0.0, 1.0);
    let b2 = (e1.perp_dot(p) / area).clamp(0.0, 1.0 - b1);
    let b = Vec2::new(b1, b2);
    SurfacePoint { triangle, b: if b.is_finite() { b } else { MIDDLE } }
}

fn doubles(subject: &Subject<'_>, page: u32) -> Doubles {
    let image = subject.page(page);
    let (width, height) = (i64::from(image.width) * SAMPLES, i64::from(image.height) * SAMPLES);
    let mut bits = vec![0u64; (width as usize * height as usize).div_ceil(64)];
    let mut found = Doubles::default();
    for (t, flat) in subject.flat.iter().enumerate() {
        let Some(flat) = flat.filter(|f| f.page == page && subject.chart[t] != NO_CHART) else { continue };
        let grid = flat.uv.map(|p| {
            let q = (p.as_dvec2() * (SAMPLES * STEPS) as f64).round();
            [q.x as i64, q.y as i64]
        });
        visit_samples(grid, |x, y| {
            if (0..width).contains(&x) && (0..height).contains(&y) {
                let bit = (y * width + x) as usize;
                let mask = 1u64 << (bit % 64);
                if bits[bit / 64] & mask == 0 {
                    found.samples += 1;
                } else {
                    found.double.push((t as u32, [x, y]));
                }
                bits[bit / 64] |= mask;
            }
        });
    }
    found
}
