//! Single texels: not finite or negative, black among lit ones, far too bright.

use super::measure::{Kind, Measure, Tally};
use super::seams::{Beyond, Seam};
use super::subject::{Subject, rgb};
use crate::base::parallel;
use crate::patches::SurfacePoint;
use crate::render::Lightmaps;
use glam::Vec2;

/// Texels per chunk of work.
const CHUNK: usize = 1024;

/// Share of the mean light above which a texel is lit beyond doubt.
const LIT: f32 = 0.1;

/// A texel this many times as bright as all around it is a firefly.
const FIREFLY: f32 = 8.0;

/// A texel that is no light: page, index.
pub(super) type Bad = (usize, usize);

/// Replaces what is not finite or negative by 0, so that the other measures can go on, and says where it was.
pub(super) fn clean(lightmaps: &mut Lightmaps) -> Vec<Bad> {
    let mut bad = vec![];
    for (page, image) in lightmaps.pages_mut().iter_mut().enumerate() {
        for (i, pixel) in image.pixels.iter_mut().enumerate() {
            if !pixel[..3].iter().all(|v| v.is_finite() && *v >= 0.0) {
                *pixel = [0.0, 0.0, 0.0, pixel[3]];
                bad.push((page, i));
            }
        }
    }
    bad
}

/// The texels that [`clean`] found.
pub(super) fn values(subject: &Subject<'_>, bad: &[Bad]) -> Measure {
    let mut tally = Tally::default();
    for &(page, i) in bad {
        let width = subject.page(page as u32).width as usize;
        let front = subject.patches.front_at(page as u32, (i % width) as i32, (i / width) as i32);
        // Texels beside charts are not on the surface; some point of the page's first chart stands for them.
        let first = || SurfacePoint { triangle: 0, b: Vec2::splat(1.0 / 3.0) };
        tally.look(if front.is_some() { 2.0 } else { 1.0 }, 0.0, || front.map_or_else(first, |i| subject.middle(i)));
    }
    tally.of = subject.lightmaps.pages().iter().map(|p| p.pixels.len() as u64).sum();
    let mut measure = tally.measure(subject, Kind::Values, bad.len() as f64);
    measure.worst = bad.len() as f64;
    let covered = measure.places.iter().all(|p| p.value > 1.0);
    measure.places.retain(|p| p.value > 1.0);
    if let Some(&(page, i)) = bad.first() {
        let width = subject.page(page as u32).width as usize;
        let where_ = if covered { "" } else { ", some of them beside charts" };
        measure.notes.push(format!("the first is page {page}, texel ({}, {}){where_}", i % width, i / width));
    }
    measure
}

/// Black texels whose linked neighbours are all lit.
pub(super) fn invalid(subject: &Subject<'_>) -> Measure {
    let lit = |j: &u32| subject.light(*j as usize).max_element() > LIT * subject.mean;
    let value = |i: usize| {
        let black = subject.mean > 0.0 && subject.light(i).max_element() == 0.0;
        let neighbors = subject.graph.neighbors(i);
        if !black || neighbors.len() < 2 || !neighbors.iter().all(lit) {
            return 0.0;
        }
        let sum = neighbors.iter().map(|&j| subject.light(j as usize).max_element()).fold(0.0, |a, b| a + b);
        f64::from(sum / neighbors.len() as f32 / subject.mean)
    };
    count(subject, Kind::Invalid, 0.0, value)
}

/// Texels that outshine their neighbours, those across seams included: where a shadow ends beside a seam, the last texel
/// of a chart may be the only one in the sun.
pub(super) fn firefly(subject: &Subject<'_>, seams: &[Seam]) -> Measure {
    let patches = &subject.patches;
    let beyond = Beyond::new(seams);
    let value = |i: usize| {
        let own = subject.light(i).max_element();
        if own <= subject.mean {
            return 0.0;
        }
        let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
        let (mut largest, mut count) = (0.0f32, 0);
        for k in (0..9).filter(|k| *k != 4) {
            let Some(j) = patches.front_at(page, x as i32 + k % 3 - 1, y as i32 + k / 3 - 1) else { continue };
            if patches.chart(j) == patches.chart(i) {
                largest =
                    largest.max(rgb(subject.texel(page, x as i32 + k % 3 - 1, y as i32 + k / 3 - 1)).max_element());
                count += 1;
            }
        }
        let over = |largest: f32| f64::from(own / largest.max(1e-3 * subject.mean));
        if count < 2 {
            return 0.0;
        }
        let alone = over(largest);
        if alone > f64::from(FIREFLY) { over(largest.max(beyond.brightest(subject, i))) } else { alone }
    };
    count(subject, Kind::Firefly, f64::from(FIREFLY), value)
}

/// Counts texels in sight whose value is above `limit`.
pub(super) fn count(subject: &Subject<'_>, kind: Kind, limit: f64, value: impl Fn(usize) -> f64 + Sync) -> Measure {
    let tallies = parallel::map_chunks(subject.patches.front, CHUNK, |range| {
        let mut tally = Tally::default();
        for i in range {
            let value = value(i);
            let counts = value <= limit || !subject.is_hidden(subject.middle(i));
            tally.look(if counts { value } else { 0.0 }, limit, || subject.middle(i));
        }
        tally
    });
    let tally = Tally::join(tallies);
    let found = tally.count as f64;
    tally.measure(subject, kind, found)
}
