//! The regulariser: how much a function that is linear over triangles bends at their edges.
//!
//! In: triangles by unknowns. Out: a [`Hinge`] per edge between two triangles, with the energy λ (A₀ + A₁) (K·x)², where
//! K·x is the jump of the derivative across the edge times the edge's length. So it has the unit of the squared error
//! [unit² m²], and scales with the mesh.
//!
//! Source: M. Bergou, M. Wardetzky, D. Harmon, D. Zorin, E. Grinspun, "A Quadratic Bending Model for Inextensible
//! Surfaces", SGP 2006, section 3: K from the cotangents at the edge. There the energy divides by the areas; here it
//! multiplies, because what bends is light, not a sheet. Kavan et al. (see `vertices`) use jumps of the gradient as well.
//!
//! Invariants: constants have no energy on any surface, linear functions none on a plane.
//!
//! Symbols: 0, 1 ends of the edge; 2, 3 the corners opposite; c₀, c₁ cotangents at the ends in one triangle.

use super::mesh::Mesh;
use crate::base::parallel;
use glam::DVec3;

/// λ. Larger: light becomes smoother than it is, most of all over needles, whose cotangents are large (ten times as much
/// made a furnished hotel's fit worse than plain averages); smaller: what few texels say little about swings.
const STIFFNESS: f64 = 1e-4;
/// Cotangents beyond it are cut: needles would tie their neighbours to rounding errors.
const MOST_COTANGENT: f64 = 10.0;

/// An edge between two triangles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hinge {
    /// Unknowns: the ends, then the corners opposite.
    pub(super) unknowns: [u32; 4],
    /// √(energy) = weights · x.
    pub(super) weights: [f64; 4],
}

/// All hinges, in the order of their edges.
pub(super) fn hinges(mesh: &Mesh, unknown: &[u32]) -> Vec<Hinge> {
    let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * mesh.elements.len());
    for (e, element) in (0..).zip(&mesh.elements) {
        let own = element.corners.map(|v| unknown[v as usize]);
        for k in 0..3u32 {
            let (a, b) = (own[k as usize], own[(k as usize + 1) % 3]);
            if a != b && element.area > 0.0 {
                sides.push(([a.min(b), a.max(b)], 3 * e + k));
            }
        }
    }
    rayon::slice::ParallelSliceMut::par_sort_unstable(sides.as_mut_slice());
    let edges: Vec<&[([u32; 2], u32)]> = sides.chunk_by(|a, b| a.0 == b.0).filter(|edge| edge.len() == 2).collect();
    let all = parallel::map_light(edges.len(), |i| hinge(mesh, unknown, [edges[i][0].1, edges[i][1].1]));
    all.into_iter().flatten().collect()
}

/// The hinge between two triangles, each given as 3 · triangle + number of its edge.
fn hinge(mesh: &Mesh, unknown: &[u32], sides: [u32; 2]) -> Option<Hinge> {
    let corner = |side: u32, k: u32| mesh.elements[(side / 3) as usize].corners[((side % 3 + k) % 3) as usize];
    let of = |v: u32| unknown[v as usize];
    let at = |v: u32| mesh.vertices[v as usize].position;
    let [left, right] = sides;
    let ends = [of(corner(left, 0)), of(corner(left, 1))];
    let swapped = u32::from(of(corner(right, 0)) != ends[0]);
    let apexes = [corner(left, 2), corner(right, 2)];
    if apexes.iter().any(|&v| ends.contains(&of(v))) || of(apexes[0]) == of(apexes[1]) {
        return None;
    }
    let [p, q] = [[corner(left, 0), corner(left, 1)], [corner(right, swapped), corner(right, 1 - swapped)]];
    let [[c0, c1], [d0, d1]] = [(p, apexes[0]), (q, apexes[1])]
        .map(|([v0, v1], apex)| [cotangent(at(v0), at(v1), at(apex)), cotangent(at(v1), at(v0), at(apex))]);
    let area = [left, right].map(|side| mesh.elements[(side / 3) as usize].area);
    let normal = |side: u32| {
        let [a, b, c] = mesh.positions(&mesh.elements[(side / 3) as usize]);
        (b - a).cross(c - a).normalize_or_zero()
    };
    // Light need not be smooth over a sharp edge whose corners are shared for want of normals.
    let bend = normal(left).dot(normal(right)).max(0.0);
    let root = (STIFFNESS * (area[0] + area[1])).sqrt() * bend * bend;
    let weights = [c1 + d1, c0 + d0, -(c0 + c1), -(d0 + d1)].map(|w| w * root);
    (root > 0.0).then(|| Hinge { unknowns: [ends[0], ends[1], of(apexes[0]), of(apexes[1])], weights })
}

/// Cotangent of the angle at `at` between the directions to `a` and `b`.
fn cotangent(at: DVec3, a: DVec3, b: DVec3) -> f64 {
    let (u, v) = (a - at, b - at);
    let sine = u.cross(v).length();
    if sine > 0.0 { (u.dot(v) / sine).clamp(-MOST_COTANGENT, MOST_COTANGENT) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::super::mesh::{Element, Vertex};
    use super::*;
    use crate::scene::Origin;
    use glam::DVec2;

    /// Two triangles over the edge 0–1; `lift` raises the fourth corner out of the plane.
    fn pair(lift: f64) -> Mesh {
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.2, 0.0], [0.3, 0.9, 0.0], [0.6, -0.7, lift]];
        let vertex =
            |p: [f64; 3]| Vertex { part: 0, origin: Origin::source(0), position: DVec3::from(p), normal: DVec3::Z };
        let vertices: Vec<Vertex> = positions.into_iter().map(vertex).collect();
        let element = |corners: [u32; 3]| Element { corners, uv: [DVec2::ZERO; 3], page: 0, area: 0.4, uncut: None };
        Mesh { vertices, elements: vec![element([0, 1, 2]), element([1, 0, 3])], original: 4 }
    }

    fn energy(hinge: &Hinge, x: impl Fn(usize) -> f64) -> f64 {
        let dot: f64 = hinge.weights.iter().zip(hinge.unknowns).map(|(w, u)| w * x(u as usize)).sum();
        dot * dot
    }

    #[test]
    fn constants_cost_nothing_and_linear_functions_nothing_on_a_plane() {
        let flat = pair(0.0);
        let found = hinges(&flat, &[0, 1, 2, 3]);
        assert_eq!(found.len(), 1);
        let position = |i: usize| flat.vertices[i].position;
        assert!(energy(&found[0], |_| 5.0) < 1e-24);
        assert!(energy(&found[0], |i| 2.0 * position(i).x - 3.0 * position(i).y) < 1e-24);
        assert!(energy(&found[0], |i| position(i).y.abs()) > 1e-4);
        let bent = hinges(&pair(0.3), &[0, 1, 2, 3]);
        assert!(energy(&bent[0], |_| 5.0) < 1e-24);
    }

    #[test]
    fn sharp_and_open_edges_have_no_hinge() {
        let mut folded = pair(0.0);
        folded.vertices[3].position = DVec3::new(0.3, 0.9, 0.1);
        assert!(hinges(&folded, &[0, 1, 2, 3]).is_empty());
        assert!(hinges(&pair(0.0), &[0, 1, 2, 2]).is_empty());
    }
}
