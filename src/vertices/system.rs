//! The normal equations of the fit, and errors of any solution.
//!
//! In: mesh and field. Out: a sparse symmetric matrix by rows, its right-hand side, and the integrals of each triangle
//! that tell the error of a solution without looking at a texel again.
//!
//! Symbols: M = ∫ φᵢ φⱼ over what is exposed, b = ∫ f φᵢ, x values at the unknowns. The matrix is M, the hinges of
//! [`bend`](super::bend), and for triangles of which a part h of the area A is hidden a pull [`FILL`] h²/A between their
//! corners: without it, nothing would say what a vertex inside a solid holds.
//!
//! Invariant: rows of hinges and pulls add up to zero, so constants are solved exactly.

use super::bend::Hinge;
use super::bend::hinges;
use super::mesh::Element;
use super::mesh::Mesh;
use super::quadrature::Field;
use super::weld;
use crate::base::Around;
use crate::base::Progress;
use crate::base::Sparse;
use crate::base::nonnegative;
use crate::base::parallel;
use crate::base::sparse::Row;
use glam::DVec3;

/// Larger: light under furniture is pulled into the open; smaller: more steps of the solver.
const FILL: f64 = 0.01;
/// Residual of the solution: a thousandth of what half floats keep.
const CLOSE: f64 = 1e-7;

/// Integrals over one triangle.
#[derive(Debug, Clone, Copy, Default)]
struct Local {
    /// ∫ φⱼ φₖ for (0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2) [m²].
    mass: [f64; 6],
    /// ∫ f φₖ.
    load: [DVec3; 3],
    /// ∫ f².
    square: DVec3,
}

/// Index into [`Local::mass`].
const fn pair(j: usize, k: usize) -> usize {
    [[0, 1, 2], [1, 3, 4], [2, 4, 5]][j][k]
}

/// The equations.
pub(super) struct System {
    /// Unknown of each vertex of the mesh.
    pub(super) unknown: Vec<u32>,
    /// Unknowns of each triangle's corners.
    corners: Vec<[u32; 3]>,
    locals: Vec<Local>,
    matrix: Sparse,
    load: Vec<DVec3>,
    /// ∫ φᵢ [m²].
    mass: Vec<f64>,
}

impl System {
    /// The equations of a mesh. `before` are those of the mesh that it was refined from: triangles that were not cut keep
    /// their integrals.
    pub(super) fn new(mesh: &Mesh, field: &Field<'_>, before: Option<&Self>) -> Self {
        let places = weld::places(&mesh.vertices);
        let (unknown, count) = weld::unknowns(&mesh.vertices, &places);
        let corners: Vec<[u32; 3]> = mesh.elements.iter().map(|e| e.corners.map(|v| unknown[v as usize])).collect();
        let locals = parallel::map(corners.len(), |e| {
            let known = before.zip(mesh.elements[e].uncut).map(|(system, old)| system.locals[old as usize]);
            known.unwrap_or_else(|| integrals(&mesh.elements[e], field))
        });
        let hinges = hinges(mesh, &unknown);
        let around = Around::new(count, corners.iter().map(|c| c.iter().copied().zip(0..)));
        let hinged = Around::new(count, hinges.iter().map(|h| h.unknowns.iter().copied().zip(0..)));
        let mut system = Self {
            load: parallel::map_light(count, |i| {
                around.of(i).fold(DVec3::ZERO, |sum, (e, k)| sum + locals[e].load[usize::from(k)])
            }),
            mass: parallel::map_light(count, |i| {
                around
                    .of(i)
                    .fold(0.0, |sum, (e, k)| sum + (0..3).fold(0.0, |s, j| s + locals[e].mass[pair(k.into(), j)]))
            }),
            unknown,
            corners,
            locals,
            matrix: Sparse::default(),
        };
        system.matrix = Sparse::new(count, |i, row| system.fill(row, i, mesh, &around, &hinged, &hinges));
        system
    }

    /// One row of the matrix.
    fn fill(&self, row: &mut Row, i: usize, mesh: &Mesh, around: &Around<u8>, hinged: &Around<u8>, hinges: &[Hinge]) {
        for (e, k) in around.of(i).map(|(e, k)| (e, usize::from(k))) {
            let local = &self.locals[e];
            let pull = pull(&mesh.elements[e], local);
            for j in 0..3 {
                let fill = if j == k { 2.0 * pull } else { -pull };
                row.add(self.corners[e][j], local.mass[pair(k, j)] + fill);
            }
        }
        for (h, k) in hinged.of(i) {
            let Hinge { unknowns, weights } = &hinges[h];
            unknowns.iter().zip(weights).for_each(|(&u, w)| row.add(u, weights[usize::from(k)] * w));
        }
    }

    /// The values that fit best.
    pub(super) fn solve(&self, progress: &Progress) -> Vec<DVec3> {
        nonnegative::solve(&self.matrix, &self.load, self.weighted(), CLOSE, progress)
    }

    /// b/∫φ: mean light around each unknown, weighted by its hat function; zero where nothing is exposed.
    fn weighted(&self) -> Vec<DVec3> {
        self.load.iter().zip(&self.mass).map(|(b, m)| mean(*b, *m)).collect()
    }

    /// Mean light over the triangles around each unknown; zero where nothing is exposed.
    pub(super) fn averaged(&self) -> Vec<DVec3> {
        let mut sums = vec![(DVec3::ZERO, 0.0); self.load.len()];
        for (local, corners) in self.locals.iter().zip(&self.corners) {
            for &corner in corners {
                let (light, area) = &mut sums[corner as usize];
                *light += local.load[0] + local.load[1] + local.load[2];
                *area += local.area();
            }
        }
        sums.into_iter().map(|(light, area)| mean(light, area)).collect()
    }

    /// The lightmap's value at each unknown, mean over the triangles around it.
    pub(super) fn sampled(&self, mesh: &Mesh, field: &Field<'_>) -> Vec<DVec3> {
        let mut sums = vec![(DVec3::ZERO, 0.0); self.load.len()];
        for (element, corners) in mesh.elements.iter().zip(&self.corners).filter(|(e, _)| e.is_charted()) {
            for (uv, &corner) in element.uv.iter().zip(corners) {
                let (sum, count) = &mut sums[corner as usize];
                *sum += field.light(element.page, *uv);
                *count += 1.0;
            }
        }
        sums.into_iter().map(|(sum, count)| mean(sum, count)).collect()
    }

    /// ∫ (f − x)² of each triangle, channels added.
    pub(super) fn errors(&self, x: &[DVec3]) -> Vec<f64> {
        parallel::map_light(self.locals.len(), |e| self.locals[e].error(self.corners[e].map(|u| x[u as usize])))
    }

    /// Root mean square error over the mean.
    pub(super) fn relative_error(&self, x: &[DVec3]) -> f64 {
        let error: f64 = self.errors(x).iter().fold(0.0, |a, b| a + b);
        let light = self.load.iter().fold(DVec3::ZERO, |a, b| a + *b).element_sum() / 3.0;
        let area = self.mass.iter().fold(0.0, |a, b| a + b);
        if light > 0.0 { (error / 3.0 * area).max(0.0).sqrt() / light } else { 0.0 }
    }
}

fn mean(sum: DVec3, weight: f64) -> DVec3 {
    if weight > 0.0 { sum / weight } else { DVec3::ZERO }
}

impl Local {
    fn error(&self, x: [DVec3; 3]) -> f64 {
        let mut sum = self.square;
        for k in 0..3 {
            sum -= 2.0 * x[k] * self.load[k];
            for j in 0..3 {
                sum += x[k] * x[j] * self.mass[pair(k, j)];
            }
        }
        sum.element_sum().max(0.0)
    }

    /// Area that was seen [m²].
    fn area(&self) -> f64 {
        let [a, b, c, d, e, f] = self.mass;
        a + d + f + 2.0 * (b + c + e)
    }
}

fn integrals(element: &Element, field: &Field<'_>) -> Local {
    let mut local = Local::default();
    field.visit(element, |point| {
        for k in 0..3 {
            local.load[k] += point.light * (point.area * point.hats[k]);
            for j in k..3 {
                local.mass[pair(k, j)] += point.area * point.hats[k] * point.hats[j];
            }
        }
        local.square += point.light * point.light * point.area;
    });
    local
}

/// Weight of (xⱼ − xₖ)² for the corners of a triangle that is partly hidden.
fn pull(element: &Element, local: &Local) -> f64 {
    let hidden = (element.area - local.area()).max(0.0);
    if element.area > 0.0 { FILL * hidden * hidden / element.area } else { 0.0 }
}
