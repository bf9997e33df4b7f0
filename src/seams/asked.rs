//! Where along the borders of a layout the two sides of a seam are compared: six times per texel, or more often.
//!
//! Between the points that agree look-ups bend on both sides, at other places. With a quarter of these points, steps of a
//! torus and of a lumpy body at 8 texels per metre were 0.8 and 2.1 % at the points, 6.1 and 20.5 % at nine per texel.
//!
//! In: a layout and its border sides. Out: [`Asked`] sides. A long side is asked at several points. Of sides that have one
//! point, those of one chart in one square of a twelfth of a texel are asked at one for all of them, so points do not grow
//! with the mesh: 1,400 sides around the 20 texels of a ball of 9,798 triangles gave 1,400 points. Larger squares hold
//! different seams, and leave steps between them.
//!
//! Invariant: lengths add up to that of the border.

use crate::atlas::Layout;
use glam::Vec2;

/// Points per texel of an edge.
pub(super) const POINTS: f32 = 6.0;
/// Squares per point of an edge, in which short edges have one point.
const SQUARES: f32 = 2.0;
/// Most points of an edge.
const MOST_POINTS: f32 = 1e6;

/// A side of a triangle, with points at which it is asked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Asked {
    /// Triangle of the part.
    pub(super) triangle: u32,
    /// Its first corner.
    pub(super) side: u8,
    /// So many points, evenly.
    pub(super) count: u32,
    /// Length of the border that each stands for [texels].
    pub(super) length: f32,
}

/// Where the sides of a layout are asked; `sides` has a bit for each side of each triangle that is one.
pub(super) fn along(layout: &Layout, sides: &[u8], points: f32) -> Vec<Asked> {
    let (mut long, mut short) = (vec![], vec![]);
    for ((triangle, vertices), bits) in (0..).zip(&layout.triangles).zip(sides) {
        for side in (0..3u8).filter(|side| bits >> side & 1 == 1) {
            let [a, b] = [side, (side + 1) % 3].map(|corner| layout.uv[vertices[usize::from(corner)] as usize]);
            let length = a.distance(b);
            let count = (points * length).ceil().clamp(1.0, MOST_POINTS);
            if count > 1.0 {
                long.push(Asked { triangle, side, count: count as u32, length: length / count });
            } else {
                let square = square(a.midpoint(b), points);
                short.push((layout.chart[triangle as usize], square, Asked { triangle, side, count: 1, length }));
            }
        }
    }
    short.sort_by_key(|(chart, square, _)| (*chart, *square));
    let squares = short.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1));
    long.extend(squares.map(|square| middle(square.iter().map(|(_, _, asked)| *asked))));
    long.sort_by_key(|asked| (asked.triangle, asked.side));
    long
}

/// The square that a point lies in.
fn square(at: Vec2, points: f32) -> [i32; 2] {
    (at * SQUARES * points).floor().to_array().map(|x| x as i32)
}

/// The side in the middle of several, by length, for all of them. There must be one.
fn middle(sides: impl Iterator<Item = Asked> + Clone) -> Asked {
    let total = sides.clone().fold(0.0, |sum, side| sum + side.length);
    let (mut way, mut chosen) = (0.0, None);
    for side in sides {
        way += side.length;
        chosen = Some(side);
        if way >= 0.5 * total {
            break;
        }
    }
    chosen.map_or(Asked { triangle: 0, side: 0, count: 0, length: 0.0 }, |side| Asked { length: total, ..side })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of `texels` per side whose lower border has `pieces` sides.
    fn comb(texels: f32, pieces: u32) -> (Layout, Vec<u8>) {
        let mut uv: Vec<Vec2> = (0..=pieces).map(|k| Vec2::new(texels * k as f32 / pieces as f32, 0.0)).collect();
        uv.push(Vec2::new(0.5 * texels, texels));
        let triangles: Vec<[u32; 3]> = (0..pieces).map(|k| [k, k + 1, pieces + 1]).collect();
        let layout = Layout { uv, chart: vec![0; triangles.len()], triangles, ..Layout::default() };
        let sides = vec![1; pieces as usize];
        (layout, sides)
    }

    #[test]
    fn points_do_not_grow_with_the_mesh() {
        for pieces in [1, 2, 7, 30, 500] {
            let (layout, sides) = comb(5.0, pieces);
            let asked = along(&layout, &sides, 2.0);
            let points: u32 = asked.iter().map(|a| a.count).sum();
            assert!((10..=22).contains(&points), "{pieces}: {points}");
            let length: f32 = asked.iter().map(|a| a.length * a.count as f32).sum();
            assert!((length - 5.0).abs() < 1e-3, "{pieces}: {length}");
            assert!(asked.is_sorted_by_key(|a| (a.triangle, a.side)));
        }
    }

    #[test]
    fn charts_do_not_share_points() {
        let (mut layout, sides) = comb(0.2, 4);
        assert_eq!(along(&layout, &sides, 2.0).len(), 1);
        layout.chart = vec![0, 1, 0, 1];
        let asked = along(&layout, &sides, 2.0);
        assert_eq!(asked.len(), 2);
        assert!(asked.iter().all(|a| (a.length - 0.1).abs() < 1e-6));
        assert!(along(&Layout::default(), &[], 2.0).is_empty());
    }
}
