//! Which triangles of a flat layout hang together over common edges.

use crate::base::Sets;
use glam::DVec2;

/// Component of each triangle, numbered by first appearance; triangles share an edge if both ends have the same bits.
pub(super) fn components(triangles: &[[DVec2; 3]]) -> Vec<u32> {
    let mut edges = Vec::with_capacity(triangles.len() * 3);
    for (t, triangle) in triangles.iter().enumerate() {
        let keys = triangle.map(|p| ((p.x + 0.0).to_bits(), (p.y + 0.0).to_bits()));
        for k in 0..3 {
            let (a, b) = (keys[k], keys[(k + 1) % 3]);
            edges.push((a.min(b), a.max(b), t));
        }
    }
    edges.sort_unstable();
    let mut sets = Sets::new(triangles.len());
    for pair in edges.windows(2) {
        if (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1) {
            sets.join(pair[0].2, pair[1].2);
        }
    }
    sets.numbers()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_hang_together_over_edges_not_corners() {
        let p = |x: f64, y: f64| DVec2::new(x, y);
        let strip = [p(0., 0.), p(1., 0.), p(0., 1.)];
        let joined = [p(1., 0.), p(1., 1.), p(0., 1.)];
        let corner = [p(1., 1.), p(2., 1.), p(2., 2.)];
        assert_eq!(components(&[strip, corner, joined]), [0, 1, 0]);
    }
}
