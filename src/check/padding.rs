//! What bilinear look-ups at chart borders read besides their own chart: other charts, texels nobody filled, and such that
//! somebody filled with light of something else (`foreign`).
//!
//! A look-up at a point reads the four texels whose centres are around it. The pieces of triangles in a texel say which
//! of its neighbours are read. Another chart in one of them is a fault unless it is the same surface going on: the
//! triangle, continued as a plane, would be where the other one is.

use super::foreign::Foreign;
use super::measure::{Kind, Measure, Tally};
use super::subject::{FLOOR, Subject, rgb, world_of};
use super::texels;
use crate::atlas::raster::Polygon;
use crate::base::parallel;
use glam::{DVec2, IVec2};

/// Texels per chunk of work.
const CHUNK: usize = 1024;

/// Weight in a look-up below which a texel does not matter.
const LEAST_WEIGHT: f64 = 0.01;

/// Distance between a surface and the plane of another chart's triangle, in texel edges, up to which one continues the
/// other.
const CONTINUES: f32 = 0.25;

/// Largest weight that the texel at `offset` has in look-ups at points of a polygon within texel (0, 0).
fn weight(polygon: &Polygon, offset: IVec2) -> f64 {
    let tent = |d: f64| (1.0 - d.abs()).max(0.0);
    let center = offset.as_dvec2() + 0.5;
    polygon.corners().iter().map(|c| tent(c.x - center.x) * tent(c.y - center.y)).fold(0.0, f64::max)
}

/// The texels around one, itself included.
fn around(radius: i32) -> impl Iterator<Item = IVec2> {
    (-radius..=radius).flat_map(move |y| (-radius..=radius).map(move |x| IVec2::new(x, y)))
}

/// Pairs of charts that are nearer than look-ups, or `Settings::padding` empty texels between them, allow.
pub(super) fn padding(subject: &Subject<'_>) -> Measure {
    let patches = &subject.patches;
    let pure = parallel::map_light(patches.front, |i| subject.is_pure(i));
    let chunks = parallel::map_chunks(patches.front, CHUNK, |range| {
        let (mut tally, mut pairs) = (Tally::default(), vec![]);
        for i in range {
            let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
            let mut worst = 0.0f64;
            for offset in around(subject.settings.padding.map_or(1, |p| p.max(1) as i32)) {
                let Some(j) = patches.front_at(page, x as i32 + offset.x, y as i32 + offset.y) else { continue };
                if pure[i] && pure[j] && patches.chart(i) == patches.chart(j) {
                    continue;
                }
                worst = worst.max(mixed(subject, i, j, offset, &mut pairs));
            }
            tally.look(worst, 0.0, || subject.middle(i));
        }
        (tally, pairs)
    });
    let (tallies, pairs): (Vec<Tally>, Vec<Vec<[u32; 2]>>) = chunks.into_iter().unzip();
    let mut pairs: Vec<[u32; 2]> = pairs.into_iter().flatten().collect();
    pairs.sort_unstable();
    pairs.dedup();
    let mut measure = Tally::join(tallies).measure(subject, Kind::Padding, pairs.len() as f64);
    if measure.count > 0 {
        measure.notes.push(format!("at {} texels of {} charts", measure.count, subject.atlas.charts.len()));
    }
    measure
}

/// How much look-ups in texel i mix the charts of texel j in; notes the pairs of charts.
fn mixed(subject: &Subject<'_>, i: usize, j: usize, offset: IVec2, pairs: &mut Vec<[u32; 2]>) -> f64 {
    let (patches, chart) = (&subject.patches, |t: u32| subject.chart[t as usize]);
    let mut worst = 0.0f64;
    for (own, polygon) in patches.pieces(i) {
        // Nearer than the padding that was asked for counts by the distance, look-ups by their weight.
        let asked = subject.settings.padding.is_some_and(|p| offset.abs().max_element() <= p as i32);
        let weight = weight(&polygon, offset);
        if weight < LEAST_WEIGHT && !asked {
            continue;
        }
        for (other, there) in patches.pieces(j) {
            let pair = [chart(own).min(chart(other)), chart(own).max(chart(other))];
            if pair[0] != pair[1]
                && !continues(subject, i, own, other, offset.as_dvec2() + there.centroid(), there.centroid(), j)
            {
                if !pairs.contains(&pair) {
                    pairs.push(pair);
                }
                let near = 1.0 / f64::from(1 + offset.abs().max_element());
                worst = worst.max(if asked { near.max(weight) } else { weight });
            }
        }
    }
    worst
}

/// The triangle `other` lies where `own` would be if it went on; `at` is the place from texel i, `within` from texel j.
fn continues(subject: &Subject<'_>, i: usize, own: u32, other: u32, at: DVec2, within: DVec2, j: usize) -> bool {
    let (patches, scene) = (&subject.patches, subject.scene);
    let Some(flat) = subject.flat[own as usize] else { return false };
    let (x, y) = patches.texel_xy(i);
    let Some(expected) = world_of(scene, &flat, own, at + DVec2::new(f64::from(x), f64::from(y))) else { return false };
    let point = patches.point_on(j, other, within);
    expected.distance(scene.position(point.triangle, point.b)) < CONTINUES * patches.texel_edge(i)
}

/// Texels of charts whose look-ups read zeros around them, or what is none of their light.
pub(super) fn uncovered(subject: &Subject<'_>, foreign: &Foreign) -> Measure {
    let value = |i| black_weight(subject, i).max(foreign_weight(subject, foreign, i));
    texels::count(subject, Kind::Uncovered, LEAST_WEIGHT, value)
}

/// Largest weight of a texel without surface in look-ups of a texel whose light it has nothing to do with.
fn foreign_weight(subject: &Subject<'_>, foreign: &Foreign, i: usize) -> f64 {
    let patches = &subject.patches;
    let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
    let image = subject.page(page);
    if subject.mean <= 0.0 || patches.exposed[i] <= 0.0 {
        return 0.0;
    }
    let is_foreign = |o: &IVec2| {
        let at = [x as i32 + o.x, y as i32 + o.y];
        let within = at[0] >= 0 && at[1] >= 0 && at[0] < image.width as i32 && at[1] < image.height as i32;
        within
            && patches.front_at(page, at[0], at[1]).is_none()
            && foreign.is_beside(subject, patches.chart(i), page, at)
    };
    let most = |o: IVec2| patches.pieces(i).map(|(_, polygon)| weight(&polygon, o)).fold(0.0, f64::max);
    let read = around(1).map(|o| (o, most(o))).filter(|(o, most)| *most > LEAST_WEIGHT && is_foreign(o));
    read.map(|(_, most)| most).fold(0.0, f64::max)
}

/// Largest weight of an unfilled texel in look-ups of a lit one.
fn black_weight(subject: &Subject<'_>, i: usize) -> f64 {
    let patches = &subject.patches;
    let (page, (x, y)) = (patches.page(i), patches.texel_xy(i));
    let image = subject.page(page);
    let lit = |x: i32, y: i32| rgb(subject.texel(page, x, y)).max_element() > FLOOR * subject.mean;
    // Nobody sees what lies inside of solids.
    if subject.mean <= 0.0 || patches.exposed[i] <= 0.0 || !lit(x as i32, y as i32) {
        return 0.0;
    }
    let mut worst = 0.0f64;
    for offset in around(1).filter(|o| *o != IVec2::ZERO) {
        let (tx, ty) = (x as i32 + offset.x, y as i32 + offset.y);
        let beyond = tx < 0 || ty < 0 || tx >= image.width as i32 || ty >= image.height as i32;
        if beyond || patches.front_at(page, tx, ty).is_some() || rgb(subject.texel(page, tx, ty)).max_element() != 0.0 {
            continue;
        }
        // What lies in the dark has dark neighbours; filled texels around it are black and right.
        let mut neighbors =
            around(1).map(|o| (tx + o.x, ty + o.y)).filter(|(x, y)| patches.front_at(page, *x, *y).is_some());
        if neighbors.all(|(x, y)| lit(x, y)) {
            let most = patches.pieces(i).map(|(_, polygon)| weight(&polygon, offset)).fold(0.0, f64::max);
            worst = worst.max(most);
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_bilinear_look_ups() {
        let corners = [DVec2::new(0.5, 0.5), DVec2::new(1.0, 0.5), DVec2::new(0.5, 0.75)];
        let polygon = Polygon::triangle(corners);
        let at = |x, y| weight(&polygon, IVec2::new(x, y));
        assert_eq!([at(0, 0), at(1, 0), at(0, 1), at(-1, 0), at(0, -1)], [1.0, 0.5, 0.25, 0.0, 0.0]);
        assert_eq!(around(2).count(), 25);
    }
}
