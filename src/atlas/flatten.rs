//! Flattens connected faces: by projection along their mean normal, or by the map that xatlas found, if it is sound.
//!
//! Sound: no triangle turned over, no place covered twice, density within [`MAX_DENSITY_RATIO`] of the mean. What is
//! not is cut into cones of similar normals, in the worst case into single triangles, so every face with an area gets a
//! chart. Flat coordinates are metres with the area of the surface kept, counter-clockwise for faces seen from the
//! front.

use super::overlap;
use super::weld::NONE;
use super::weld::Surface;
use glam::DVec2;
use glam::DVec3;

/// Least cosine between a face and the direction of projection: the stretch is at most 1/0.75.
const FACE_COS: f64 = 0.75;

/// Least mean cosine, weighted by area.
pub(super) const MEAN_COS: f64 = 0.88;

/// Largest and smallest density of a face, as a factor of the mean of its chart (per length).
const MAX_DENSITY_RATIO: f64 = 2.0;

/// Cone in which the last resort gathers faces (cos 37°).
const CONE_COS: f64 = 0.8;

/// Overlap samples per triangle.
const SAMPLES: usize = 12;

/// Faces with flat coordinates.
#[derive(Debug, Clone)]
pub(super) struct Flat {
    /// Faces of the surface, ascending.
    pub(super) faces: Vec<u32>,
    /// Flat position of each corner [m].
    pub(super) corners: Vec<[DVec2; 3]>,
}

/// Projects faces along their mean normal; `None` where that turns, squeezes or overlaps faces too much.
pub(super) fn project(surface: &Surface, faces: &[u32]) -> Option<Flat> {
    let sum = faces.iter().fold(DVec3::ZERO, |n, f| n + surface.normal[*f as usize] * surface.area[*f as usize]);
    let axis = sum.normalize_or_zero();
    let area: f64 = faces.iter().map(|f| surface.area[*f as usize]).sum();
    let squeezed =
        |f: &u32| !surface.sliver[*f as usize] && faces.len() > 1 && surface.normal[*f as usize].dot(axis) < FACE_COS;
    if axis == DVec3::ZERO || sum.length() < MEAN_COS * area || faces.iter().any(squeezed) {
        return None;
    }
    let (s, t) = axis.any_orthonormal_pair();
    let origin = surface.corners(faces[0])[0];
    let mut corners: Vec<[DVec2; 3]> = faces
        .iter()
        .map(|f| surface.corners(*f).map(|p| DVec2::new((p - origin).dot(s), (p - origin).dot(t))))
        .collect();
    if faces.len() > 1 && overlap::coverage(&corners, SAMPLES).overlaps() {
        return None;
    }
    let scale = (area / sum.length()).sqrt();
    corners.iter_mut().flatten().for_each(|p| *p *= scale);
    Some(Flat { faces: faces.to_vec(), corners })
}

/// Charts for faces that xatlas put into one chart at `corners`: one if possible.
pub(super) fn adopt(surface: &Surface, faces: &[u32], corners: Vec<[DVec2; 3]>) -> Vec<Flat> {
    if let Some(flat) = project(surface, faces) {
        return vec![flat];
    }
    match restore(surface, faces, corners) {
        Some(flat) => vec![flat],
        None => split(surface, faces),
    }
}

/// Undoes the stretch of the axes that xatlas's packer added, turns and scales the chart, and checks it.
///
/// The packer scales x and y separately to whole texels. A conformal map has equal Dirichlet energies
/// ∫|∇x|² = ∫|∇y|² (= its area), which gives the ratio of the two factors back.
fn restore(surface: &Surface, faces: &[u32], mut corners: Vec<[DVec2; 3]>) -> Option<Flat> {
    let energy = faces.iter().zip(&corners).fold(DVec2::ZERO, |sum, (f, uv)| {
        if surface.sliver[*f as usize] { sum } else { sum + dirichlet(surface.corners(*f), *uv) }
    });
    let signed: f64 = corners.iter().map(|uv| twice_area(*uv)).sum();
    let ratio = (energy.y / energy.x).sqrt().sqrt();
    let squash = DVec2::new(ratio.copysign(ratio * signed), 1.0 / ratio);
    let area: f64 = faces.iter().map(|f| surface.area[*f as usize]).sum();
    let scale = squash * (2.0 * area / signed.abs()).sqrt();
    if !scale.is_finite() || scale.x == 0.0 || scale.y == 0.0 {
        return None;
    }
    corners.iter_mut().flatten().for_each(|p| *p *= scale);
    let sound = |(f, uv): (&u32, &[DVec2; 3])| {
        let density = 0.5 * twice_area(*uv) / surface.area[*f as usize];
        let limit = MAX_DENSITY_RATIO * MAX_DENSITY_RATIO;
        surface.sliver[*f as usize] || (density > 1.0 / limit && density < limit)
    };
    if !faces.iter().zip(&corners).all(sound) || overlap::coverage(&corners, SAMPLES).overlaps() {
        return None;
    }
    Some(Flat { faces: faces.to_vec(), corners })
}

/// Dirichlet energies of x and y over one triangle (cotangent formula).
fn dirichlet(p: [DVec3; 3], uv: [DVec2; 3]) -> DVec2 {
    (0..3).fold(DVec2::ZERO, |sum, k| {
        let (a, b) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
        let cotangent = a.dot(b) / a.cross(b).length();
        let d = uv[(k + 1) % 3] - uv[(k + 2) % 3];
        sum + d * d * (0.5 * cotangent)
    })
}

/// Twice the signed area of a flat triangle.
pub(super) fn twice_area(uv: [DVec2; 3]) -> f64 {
    (uv[1] - uv[0]).perp_dot(uv[2] - uv[0])
}

/// Cuts faces into connected cones of similar normals that project well; single triangles in the worst case.
pub(super) fn split(surface: &Surface, faces: &[u32]) -> Vec<Flat> {
    let mut faces = faces.to_vec();
    faces.sort_unstable();
    let mut taken = vec![false; faces.len()];
    let mut seeds: Vec<usize> = (0..faces.len()).collect();
    seeds.sort_by(|a, b| surface.area[faces[*b] as usize].total_cmp(&surface.area[faces[*a] as usize]).then(a.cmp(b)));
    let mut flats = Vec::new();
    for seed in seeds {
        if taken[seed] {
            continue;
        }
        let mut cone = grow_cone(surface, &faces, &taken, seed);
        let flat = loop {
            let mut members: Vec<u32> = cone.iter().map(|i| faces[*i]).collect();
            members.sort_unstable();
            if let Some(flat) = project(surface, &members) {
                break flat;
            }
            // Breadth first order: the first half is connected and holds the seed.
            cone.truncate(cone.len().div_ceil(2));
            if cone.len() == 1 {
                break single(surface, faces[seed]);
            }
        };
        for i in cone {
            taken[i] = true;
        }
        flats.push(flat);
    }
    flats
}

/// Indices into `faces` of free faces around a seed, breadth first, within a cone around its normal.
fn grow_cone(surface: &Surface, faces: &[u32], taken: &[bool], seed: usize) -> Vec<usize> {
    let normal = surface.normal[faces[seed] as usize];
    let mut seen = std::collections::HashSet::from([seed]);
    let mut cone = vec![seed];
    let mut next = 0;
    while next < cone.len() {
        let face = faces[cone[next]] as usize;
        next += 1;
        for k in 0..3 {
            let g = surface.neighbor[face][k];
            if g == NONE || !surface.soft[face][k] {
                continue;
            }
            let alike = surface.sliver[g as usize] || surface.normal[g as usize].dot(normal) >= CONE_COS;
            if let Ok(i) = faces.binary_search(&g)
                && alike
                && !taken[i]
                && seen.insert(i)
            {
                cone.push(i);
            }
        }
    }
    cone
}

/// One triangle in its own plane: the first edge along x.
fn single(surface: &Surface, face: u32) -> Flat {
    let [p0, p1, p2] = surface.corners(face);
    let length = p0.distance(p1);
    let along = (p1 - p0).normalize_or_zero();
    let height = 2.0 * surface.area[face as usize] / length.max(f64::MIN_POSITIVE);
    let corner = DVec2::new((p2 - p0).dot(along), height);
    Flat { faces: vec![face], corners: vec![[DVec2::ZERO, DVec2::new(length, 0.0), corner]] }
}
