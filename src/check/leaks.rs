//! Light and darkness that come through walls, because a look-up mixes texels of both sides.
//!
//! At points spread over the surface the bilinear value is compared with that of those of its four texels whose surface
//! can be seen from the point, along two short segments above the surface, as linked texels see each other; over a convex
//! body the segments are higher, or it would hide its own other side. What lies buried in solids is never seen, nor is a
//! texel that a thin wall splits: it has the light of both sides. Panes that let a tenth of the light through are no walls:
//! what is behind them is lit through them, and darker by what they take. Texels outside of the chart have no part on either side;
//! they are the padding's.
//!
//! *Leak*: (look-up − seen) over the largest texel, where what is seen is darker than [`DARK`] of it. *Dark strip*:
//! (seen − look-up) over what is seen, where that is lit.
//!
//! A value counts if texels side by side reach it over a length of [`runs::RUN`], and in sight (`sight`).
//!
//! Limits: at a point that sees none of its texels nothing can be said; of double-sided surfaces the front is looked at.

use super::measure::{Kind, Measure, Tally};
use super::runs;
use super::subject::{FLOOR, Subject};
use crate::base::low_discrepancy::Sequence;
use crate::base::{Rgb, parallel};
use crate::patches::{HEIGHTS, PatchSurface, Spot, SurfacePoint};
use crate::trace::Ray;
use glam::{Vec2, Vec3};

/// Points per texel, and in all.
const PER_TEXEL: usize = 4;
const MOST_POINTS: usize = 2_000_000;

/// Texels per chunk of work.
const CHUNK: usize = 256;

/// Share of the brightest texel below which a point is dark. With 0.01, a room behind walls of a centimetre was not: the
/// texels that its walls split light it. With 0.1, places between books and boards count.
const DARK: f32 = 0.03;

/// Share of the mean light above which a point is lit.
const LIT: f32 = 0.1;

/// Texels that differ by less can neither leak nor darken by a twentieth.
const ALIKE: f32 = 0.99;

/// Least weight of what is seen: below it, it is rounding.
const LEAST_WEIGHT: f32 = 1e-3;

/// Share of the light that passes what is no wall, in its clearest channel.
const CLEAR: f32 = 0.1;

/// Distance from a plane up to which corners lie in it, in texel edges.
const IN_PLANE: f32 = 1e-2;

/// The worst point of a texel by each measure.
type Worst = [(f64, SurfacePoint); 2];

/// Both measures.
pub(super) fn measure(subject: &Subject<'_>) -> Vec<Measure> {
    let patches = &subject.patches;
    let points = (MOST_POINTS / patches.front.max(1)).clamp(1, PER_TEXEL) as u32;
    let kinds = [Kind::Leaks, Kind::DarkStrip];
    let limits = kinds.map(|k| subject.settings.limit(k));
    let chunks = parallel::map_chunks(patches.front, CHUNK, |range| {
        let looked_at = range.filter(|&i| patches.exposed[i] > 0.0 && !is_open(subject, i));
        let found = |i| Some((i, texel(subject, i, points, limits)?));
        looked_at.filter_map(found).collect::<Vec<(usize, Worst)>>()
    });
    let found = chunks.concat();
    let of = patches.exposed[..patches.front].iter().filter(|exposed| **exposed > 0.0).count() as u64;
    let one = |m: usize| judge(subject, kinds[m], of, &found.iter().map(|(i, w)| (*i, w[m])).collect::<Vec<_>>());
    vec![one(0), one(1)]
}

/// One measure, of the worst points of the texels where something was found.
fn judge(subject: &Subject<'_>, kind: Kind, of: u64, found: &[(usize, (f64, SurfacePoint))]) -> Measure {
    let (patches, limit) = (&subject.patches, subject.settings.limit(kind));
    let values: Vec<(usize, f64)> = found.iter().map(|(i, (value, _))| (*i, *value)).collect();
    let value = runs::sustained(patches, &values);
    let mut shown = runs::beyond(patches, &values, limit);
    let count = shown.len();
    if shown.is_empty() {
        // Without a fault, the worst texel is of interest, however small.
        shown = (0..found.len()).collect();
    }
    let mut tally = Tally::default();
    shown.iter().for_each(|&k| tally.look(found[k].1.0, limit, || found[k].1.1));
    (tally.count, tally.of) = (count as u64, of);
    let mut measure = tally.measure(subject, kind, value);
    let single = values.iter().filter(|v| v.1 > limit).count() - count;
    let share = 100.0 * measure.count as f64 / of.max(1) as f64;
    measure.notes.push(format!(
        "above the limit at {share:.3} % of the texels; {single} more in groups that are shorter than {}",
        runs::RUN
    ));
    measure
}

/// Looks at the points of one texel; the worst of them, if any is bad.
fn texel(subject: &Subject<'_>, i: usize, points: u32, limits: [f64; 2]) -> Option<Worst> {
    let surface = PatchSurface::new(subject.tracer, &subject.patches, i);
    let sequence = Sequence::new(i as u64);
    let mut worst = [(0.0, subject.middle(i)); 2];
    for k in 0..points {
        let [x, y, ..] = sequence.point(k);
        let spot = surface.sample(Vec2::new(x, y));
        let Some(found) = look(subject, i, &surface, &spot) else { continue };
        if found.iter().zip(limits).any(|(value, limit)| *value > limit) && subject.is_hidden(spot.point) {
            continue;
        }
        for (worst, value) in worst.iter_mut().zip(found) {
            if value > worst.0 {
                *worst = (value, spot.point);
            }
        }
    }
    worst.iter().any(|w| w.0 > 0.0).then_some(worst)
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

/// The surface of texel `j` can be seen from a point of texel `i`, and all of it is on one side of what stands there.
fn sees(subject: &Subject<'_>, point: SurfacePoint, normal: Vec3, i: usize, j: usize) -> bool {
    let patches = &subject.patches;
    let edge = patches.texel_edge(i).min(patches.texel_edge(j));
    if patches.exposed[j] <= 0.0 || patches.is_split(j) && !is_among_panes(subject, j, edge) {
        return false;
    }
    // The mean position of a texel that spans facets lies below them.
    let middle = subject.middle(j);
    let [from, to] = [point, middle].map(|p| subject.scene.position(p.triangle, p.b));
    let there = subject.scene.geometric_normal(middle.triangle);
    let over = crest(to - from, normal, there);
    HEIGHTS.iter().all(|height| {
        let lift = height * edge + over;
        let (from, to) = (from + normal * lift, to + there * lift);
        subject.tracer.segment_clear(from, to) || {
            let ray = Ray { origin: from, direction: to - from, t_max: 1.0 };
            subject.tracer.unblocked(&ray, None).max_element() > CLEAR
        }
    })
}

/// Nothing but panes can be what splits a texel: the rest around it lies in its plane.
fn is_among_panes(subject: &Subject<'_>, j: usize, edge: f32) -> bool {
    let (scene, middle) = (subject.scene, subject.middle(j));
    let at = scene.position(middle.triangle, middle.b);
    let normal = scene.geometric_normal(middle.triangle);
    let is_in_plane = |t: u32| scene.corners(t).iter().all(|corner| (*corner - at).dot(normal).abs() < IN_PLANE * edge);
    let is_pane =
        |t: u32| !scene.material(t).is_opaque() && scene.transmittance(t, Vec2::splat(1.0 / 3.0)).max_element() > CLEAR;
    !subject.tracer.any_within(at - edge, at + edge, |t| !is_in_plane(t) && !is_pane(t))
}

/// How far a surface that bends away from both ends of a line `along` it, with these normals there, rises above it.
fn crest(along: Vec3, here: Vec3, there: Vec3) -> f32 {
    let is_convex = along.dot(here) < 0.0 && along.dot(there) > 0.0;
    let cosine = here.dot(there).clamp(0.0, 1.0);
    if is_convex { 0.5 * along.length() * ((1.0 - cosine) / (1.0 + cosine)).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_sight_rise_above_what_bends_away_and_above_nothing_else() {
        let turned = |degrees: f32| {
            let (sin, cos) = libm::sincosf(degrees.to_radians());
            Vec3::new(sin, cos, 0.0)
        };
        // Two sides of a ridge a metre apart, each falling by 30°, rise to ½·tan 30°.
        let ridge = crest(Vec3::X, turned(-30.0), turned(30.0));
        assert!((ridge - 0.5 * libm::tanf(30.0f32.to_radians())).abs() < 1e-5, "{ridge}");
        assert_eq!(crest(Vec3::X, turned(30.0), turned(-30.0)), 0.0);
        assert_eq!(crest(Vec3::X, Vec3::Y, Vec3::Y), 0.0);
    }
}
