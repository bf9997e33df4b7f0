//! Which vertices are one: at one place, or at one place with one normal.
//!
//! Exporters split a vertex wherever texture coordinates, materials or objects meet, and light does not care. Positions
//! are compared within the rounding of world transforms; normals within [`LEAST_COSINE`], the bend up to which texels
//! share light as well.
//!
//! Invariants: classes are numbered in the order of their first vertices; the result depends on the vertices alone.

use super::mesh::Vertex;
use glam::DVec3;
use rayon::slice::ParallelSliceMut;
use std::collections::HashMap;

/// Distance of places that are one, in parts of the largest coordinate: a few rounding steps of an `f32`. More would join
/// details of a level that lies far from the origin.
const NEAR: f64 = 3e-7;
/// Edge of a cell of space in that distance.
const CELL: f64 = 64.0;
/// Cosine of the angle between normals that are one: 10°.
const LEAST_COSINE: f64 = 0.984_807_753;
/// Places in a cell that are looked at: more of them are no detail but broken.
const CROWD: usize = 64;

/// Class of each vertex by place, and the number of classes.
pub(super) fn places(vertices: &[Vertex]) -> (Vec<u32>, usize) {
    let most = vertices.iter().fold(0.0f64, |m, v| m.max(v.position.abs().max_element()));
    let near = (NEAR * most).max(f64::MIN_POSITIVE);
    let cell_of = |p: DVec3| (p / (CELL * near)).floor().to_array().map(|x| x as i64);
    let mut cells: HashMap<[i64; 3], Vec<(DVec3, u32)>> = HashMap::new();
    let (mut class, mut count) = (vec![0; vertices.len()], 0);
    for same in coincident(vertices) {
        let p = vertices[same[0] as usize].position;
        let (low, high) = (cell_of(p - near), cell_of(p + near));
        let known = corners(low, high).find_map(|cell| {
            let known = cells.get(&cell)?.iter().take(CROWD);
            known.clone().find(|(q, _)| (*q - p).abs().max_element() <= near).map(|(_, class)| *class)
        });
        let own = known.unwrap_or_else(|| {
            cells.entry(cell_of(p)).or_default().push((p, count));
            count += 1;
            count - 1
        });
        same.iter().for_each(|&v| class[v as usize] = own);
    }
    (class, count as usize)
}

/// Vertices at exactly one place, in the order of their first ones: most of those that are one.
fn coincident(vertices: &[Vertex]) -> Vec<Vec<u32>> {
    let key = |v: u32| vertices[v as usize].position.to_array().map(f64::to_bits);
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    order.par_sort_unstable_by_key(|&v| (key(v), v));
    let mut groups: Vec<Vec<u32>> = order.chunk_by(|&a, &b| key(a) == key(b)).map(<[u32]>::to_vec).collect();
    groups.par_sort_unstable_by_key(|group| group[0]);
    groups
}

/// Cells between two that differ by at most one in each coordinate.
fn corners(low: [i64; 3], high: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    let pick = move |k: usize, c: usize| if k >> c & 1 == 1 { high[c] } else { low[c] };
    let once = move |k: &usize| (0..3).all(|c| k >> c & 1 == 0 || high[c] != low[c]);
    (0..8).filter(once).map(move |k| [0, 1, 2].map(|c| pick(k, c)))
}

/// Class of each vertex by place and normal, and the number of classes.
pub(super) fn unknowns(vertices: &[Vertex], (place, places): &(Vec<u32>, usize)) -> (Vec<u32>, usize) {
    let mut at_place: Vec<Vec<(DVec3, u32)>> = vec![vec![]; *places];
    let mut count = 0;
    let class = vertices.iter().zip(place).map(|(vertex, &place)| {
        let known = &mut at_place[place as usize];
        if let Some((_, class)) = known.iter().find(|(normal, _)| normal.dot(vertex.normal) >= LEAST_COSINE) {
            return *class;
        }
        known.push((vertex.normal, count));
        count += 1;
        count - 1
    });
    (class.collect(), count as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Origin;

    fn vertex(position: [f64; 3], normal: [f64; 3]) -> Vertex {
        let (position, normal) = (DVec3::from(position), DVec3::from(normal).normalize());
        Vertex { part: 0, origin: Origin::source(0), position, normal }
    }

    #[test]
    fn rounding_is_forgiven_and_detail_is_not() {
        let up = [0.0, 1.0, 0.0];
        let all = [
            vertex([100.0, 0.0, 0.0], up),
            vertex([100.000_02, 0.0, 0.0], up),
            vertex([100.001, 0.0, 0.0], up),
            vertex([100.0, 0.0, 0.0], [0.1, 1.0, 0.0]),
            vertex([100.0, 0.0, 0.0], [0.0, -1.0, 0.0]),
        ];
        let places = places(&all);
        assert_eq!(places, (vec![0, 0, 1, 0, 0], 2));
        assert_eq!(unknowns(&all, &places), (vec![0, 0, 1, 0, 2], 3));
    }

    #[test]
    fn places_on_the_two_sides_of_a_cell_are_found() {
        let step = CELL * NEAR;
        let all: Vec<Vertex> = (-200..200)
            .flat_map(|k| [k as f64 * step - 0.4 * NEAR, k as f64 * step + 0.4 * NEAR])
            .map(|x| vertex([x, 1.0, x], [0.0, 0.0, 1.0]))
            .collect();
        let (class, count) = places(&all);
        assert_eq!(count, 400);
        assert!(class.chunks(2).all(|pair| pair[0] == pair[1]));
    }
}
