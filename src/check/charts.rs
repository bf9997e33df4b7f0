//! What the charts of a document are, which does not say it.
//!
//! In: triangles on their pages. Out: a chart for each. Triangles that hang together over edges whose ends agree both in
//! the world and on the page are one, and so are those of a part that are smaller than a texel with what else lies in
//! their texel, if that is near and faces the same way.
//!
//! Triangles without area on their page have no chart, but what hangs together over them is one: of a bevel a thousandth of
//! a texel wide nothing is left there, and frames of pictures with such bevels would fall into hundreds of charts.

use super::subject::{Flat, texel_area};
use crate::atlas::NO_CHART;
use crate::atlas::specks::{Speck, belong_together};
use crate::base::Sets;
use crate::scene::Scene;
use glam::{IVec2, Vec2};
use rayon::slice::ParallelSliceMut;

/// A set of triangles that hang together.
struct Island {
    /// One of its triangles, as an index into the members.
    member: usize,
    low: Vec2,
    high: Vec2,
    /// Area in the world [m²] and on its page [texel²].
    areas: [f64; 2],
    speck: Speck,
}

/// Class of each vertex: place in the world, page and place on it, by their bits.
pub(super) fn corners(scene: &Scene, flat: &[Option<Flat>]) -> Vec<u32> {
    let mut keys = vec![([0u32; 6], u32::MAX); scene.vertex_count()];
    for (t, f) in flat.iter().enumerate() {
        let Some(f) = f else { continue };
        for (v, uv) in scene.triangle(t as u32).iter().zip(f.uv) {
            let p = scene.vertex_position(*v);
            // Adding 0 makes −0 the same as 0.
            let bits = [p.x, p.y, p.z, uv.x, uv.y].map(|x| (x + 0.0).to_bits());
            keys[*v as usize] = ([f.page, bits[0], bits[1], bits[2], bits[3], bits[4]], *v);
        }
    }
    keys.par_sort_unstable();
    let mut class = vec![u32::MAX; keys.len()];
    let mut count = 0;
    for (k, (key, vertex)) in keys.iter().enumerate() {
        count += u32::from(k > 0 && keys[k - 1].0 != *key);
        if *vertex != u32::MAX {
            class[*vertex as usize] = count;
        }
    }
    class
}

/// Charts by triangle, numbered by first appearance; `corner` has the classes of the vertices.
pub(super) fn charts(scene: &Scene, flat: &[Option<Flat>], corner: &[u32]) -> Vec<u32> {
    let inside = (0..flat.len()).filter(|&t| flat[t].is_some_and(|f| f.inside));
    let (mut members, vanishing): (Vec<usize>, Vec<usize>) =
        inside.partition(|&t| flat[t].is_some_and(|f| texel_area(&f.uv) > 0.0));
    let charted = members.len();
    members.extend(vanishing);
    let mut edges: Vec<(u32, u32, u32)> = Vec::with_capacity(3 * members.len());
    for (m, &t) in members.iter().enumerate() {
        let class = scene.triangle(t as u32).map(|v| corner[v as usize]);
        for k in 0..3 {
            let (a, b) = (class[k], class[(k + 1) % 3]);
            edges.push((a.min(b), a.max(b), m as u32));
        }
    }
    edges.par_sort_unstable();
    let mut sets = Sets::new(members.len());
    for pair in edges.windows(2) {
        if (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1) {
            sets.join(pair[0].2 as usize, pair[1].2 as usize);
        }
    }
    join_specks(scene, flat, &members, &mut sets);
    let mut chart = vec![NO_CHART; flat.len()];
    // What vanishes comes last, so that numbers of charts have no gaps.
    for (number, t) in sets.numbers().into_iter().zip(members).take(charted) {
        chart[t] = number;
    }
    chart
}

/// Joins what is smaller than a texel with what it shares it with.
fn join_specks(scene: &Scene, flat: &[Option<Flat>], members: &[usize], sets: &mut Sets) {
    let islands = islands(scene, flat, members, &sets.numbers());
    // By page, part and texel.
    let mut small: Vec<([u32; 2], [i32; 2], usize)> = Vec::new();
    for (i, island) in islands.iter().enumerate() {
        let texel = island.low.floor();
        let triangle = members[island.member];
        let is_small = island.areas[1] > 0.0 && (island.high - texel).max_element() <= 1.0;
        if let Some(f) = flat[triangle].filter(|_| is_small) {
            let texel: IVec2 = texel.as_ivec2();
            small.push(([f.page, scene.part_index(triangle as u32) as u32], texel.to_array(), i));
        }
    }
    small.sort_unstable();
    for group in small.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).filter(|group| group.len() > 1) {
        let group: Vec<&Island> = group.iter().map(|small| &islands[small.2]).collect();
        let specks: Vec<Speck> = group.iter().map(|island| island.speck).collect();
        let [world, page] = [0, 1].map(|k| group.iter().map(|island| island.areas[k]).fold(0.0, |a, b| a + b));
        if belong_together(&specks, (world / page).sqrt()) {
            group.windows(2).for_each(|pair| sets.join(pair[0].member, pair[1].member));
        }
    }
}

fn islands(scene: &Scene, flat: &[Option<Flat>], members: &[usize], number: &[u32]) -> Vec<Island> {
    let mut islands: Vec<Island> = Vec::new();
    for (member, &t) in members.iter().enumerate() {
        let Some(f) = flat[t] else { continue };
        let k = number[member] as usize;
        if k == islands.len() {
            let (low, high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
            islands.push(Island { member, low, high, areas: [0.0; 2], speck: Speck::NONE });
        }
        let island = &mut islands[k];
        let [a, b, c] = f.uv;
        island.low = island.low.min(a).min(b).min(c);
        island.high = island.high.max(a).max(b).max(c);
        island.areas[0] += scene.area(t as u32);
        island.areas[1] += texel_area(&f.uv);
        island.speck.add(scene.corners(t as u32).map(|p| p.as_dvec3()));
    }
    islands
}
