//! Cuts a welded part into pieces that can be flattened: planar regions, smooth components, chunks for xatlas.
//!
//! Planar regions whose border is hard everywhere (walls, floors, the sides of a box) become charts at once, by
//! projection, without distortion. What is left falls into components of faces joined by soft edges. A component that
//! one projection flattens well (terrain, gentle curves) is one chart. Any other is cut into chunks of at most
//! [`CHUNK_FACES`] faces for xatlas, whose time grows with the square of the piece (51,200 faces of smooth terrain in
//! one piece: 219 s), and neighbouring charts are merged again afterwards.

use super::Error;
use super::chart;
use super::flatten;
use super::flatten::Flat;
use super::guard::Guard;
use super::merge;
use super::weld::NONE;
use super::weld::Surface;
use crate::base::parallel;
use glam::DVec3;

/// Faces per xatlas call. Larger: time per face grows in proportion; smaller: more cuts to merge away.
const CHUNK_FACES: usize = 500;

/// A planar region of this many faces is a chart by itself, even where its border is smooth.
const LARGE_REGION_FACES: usize = 250;

/// A vertex may be this far off the plane of a region's first face, as a fraction of that face's longest edge.
const PLANE_TOLERANCE: f64 = 1e-5;

/// … or this many times the largest coordinate: about four steps of the `f32` grid the positions lie on.
const GRID_TOLERANCE: f64 = 2.5e-7;

/// Charts of a whole part, in an order that depends on the part alone; every face with an area is in one.
pub(super) fn flatten_part(surface: &Surface, guard: &Guard) -> Result<Vec<Flat>, Error> {
    guard.check()?;
    let (region_of, regions) = planar_regions(surface);
    let mut done = vec![false; surface.faces.len()];
    let mut flats = Vec::new();
    for region in &regions {
        if region.len() >= LARGE_REGION_FACES || has_hard_border(surface, region, &region_of) {
            for face in region {
                done[*face as usize] = true;
            }
            match flatten::project(surface, region) {
                Some(flat) => flats.push(flat),
                None => flats.extend(flatten::split(surface, region)),
            }
        }
    }
    let components = components(surface, &done);
    for charts in parallel::map(components.len(), |c| flatten_component(surface, &components[c], &region_of, guard)) {
        flats.extend(charts?);
    }
    Ok(flats)
}

fn flatten_component(surface: &Surface, faces: &[u32], region_of: &[u32], guard: &Guard) -> Result<Vec<Flat>, Error> {
    guard.check()?;
    if let Some(flat) = flatten::project(surface, faces) {
        return Ok(vec![flat]);
    }
    let chunks = chunks(surface, faces, region_of);
    let mut flats = Vec::new();
    for charts in parallel::map(chunks.len(), |c| chart::unwrap(surface, &chunks[c], guard)) {
        flats.extend(charts?);
    }
    guard.check()?;
    Ok(merge::merge(surface, flats))
}

/// Region of each face (`NONE` without area), and the faces of each region.
fn planar_regions(surface: &Surface) -> (Vec<u32>, Vec<Vec<u32>>) {
    let largest = surface.positions.iter().fold(0.0f64, |a, p| a.max(p.abs().max_element()));
    let mut order: Vec<u32> = (0..surface.faces.len() as u32).filter(|f| surface.area[*f as usize] > 0.0).collect();
    order.sort_by(|a, b| surface.area[*b as usize].total_cmp(&surface.area[*a as usize]).then(a.cmp(b)));
    let mut region_of = vec![NONE; surface.faces.len()];
    let mut regions: Vec<Vec<u32>> = Vec::new();
    for seed in order {
        if region_of[seed as usize] != NONE {
            continue;
        }
        let id = regions.len() as u32;
        region_of[seed as usize] = id;
        let mut faces = vec![seed];
        if !surface.sliver[seed as usize] {
            let normal = surface.normal[seed as usize];
            let origin = surface.corners(seed)[0];
            let edge = (0..3).map(|k| surface.edge_length(seed, k)).fold(0.0, f64::max);
            let tolerance = (PLANE_TOLERANCE * edge).max(GRID_TOLERANCE * largest).min(0.01 * edge);
            let mut next = 0;
            while next < faces.len() {
                let face = faces[next] as usize;
                next += 1;
                for g in surface.neighbor[face] {
                    if g == NONE || region_of[g as usize] != NONE {
                        continue;
                    }
                    let alike = surface.sliver[g as usize] || surface.normal[g as usize].dot(normal) > 0.99;
                    let near = surface.corners(g).iter().all(|p| (*p - origin).dot(normal).abs() <= tolerance);
                    if alike && near {
                        region_of[g as usize] = id;
                        faces.push(g);
                    }
                }
            }
        }
        faces.sort_unstable();
        regions.push(faces);
    }
    (region_of, regions)
}

/// No soft edge leads out of the region.
fn has_hard_border(surface: &Surface, region: &[u32], region_of: &[u32]) -> bool {
    region.iter().all(|f| {
        let f = *f as usize;
        (0..3).all(|k| {
            let g = surface.neighbor[f][k];
            g == NONE || !surface.soft[f][k] || region_of[g as usize] == region_of[f]
        })
    })
}

/// Faces with an area that are not done, by connection over soft edges.
fn components(surface: &Surface, done: &[bool]) -> Vec<Vec<u32>> {
    let mut seen = done.to_vec();
    let mut components = Vec::new();
    for seed in 0..surface.faces.len() {
        if seen[seed] || surface.area[seed] <= 0.0 {
            continue;
        }
        seen[seed] = true;
        let mut faces = vec![seed as u32];
        let mut next = 0;
        while next < faces.len() {
            let f = faces[next] as usize;
            next += 1;
            for k in 0..3 {
                let g = surface.neighbor[f][k];
                if g != NONE && surface.soft[f][k] && !seen[g as usize] {
                    seen[g as usize] = true;
                    faces.push(g);
                }
            }
        }
        faces.sort_unstable();
        components.push(faces);
    }
    components
}

/// Halves the component along its longest axis until every piece is small; planar regions stay whole.
fn chunks(surface: &Surface, faces: &[u32], region_of: &[u32]) -> Vec<Vec<u32>> {
    let mut by_region: Vec<(u32, u32)> = faces.iter().map(|f| (region_of[*f as usize], *f)).collect();
    by_region.sort_unstable();
    let cells: Vec<Cell> = by_region
        .chunk_by(|a, b| a.0 == b.0)
        .map(|group| {
            let faces: Vec<u32> = group.iter().map(|(_, f)| *f).collect();
            let sum = faces.iter().fold(DVec3::ZERO, |sum, f| sum + surface.corners(*f).iter().sum::<DVec3>());
            Cell { center: sum / (3.0 * faces.len() as f64), faces }
        })
        .collect();
    let mut chunks = Vec::new();
    let mut stack = vec![cells];
    while let Some(mut cells) = stack.pop() {
        let count: usize = cells.iter().map(|cell| cell.faces.len()).sum();
        if count <= CHUNK_FACES || cells.len() == 1 {
            let mut faces: Vec<u32> = cells.into_iter().flat_map(|cell| cell.faces).collect();
            faces.sort_unstable();
            chunks.push(faces);
            continue;
        }
        let low = cells.iter().fold(DVec3::INFINITY, |a, c| a.min(c.center));
        let high = cells.iter().fold(DVec3::NEG_INFINITY, |a, c| a.max(c.center));
        let extent = (high - low).to_array();
        let axis = (0..3).fold(0, |best, k| if extent[k] > extent[best] { k } else { best });
        cells.sort_by(|a, b| a.center[axis].total_cmp(&b.center[axis]).then(a.faces[0].cmp(&b.faces[0])));
        let mut half = 0;
        let mut split = 0;
        while split + 1 < cells.len() && (split == 0 || half + cells[split].faces.len() <= count / 2) {
            half += cells[split].faces.len();
            split += 1;
        }
        let upper = cells.split_off(split);
        stack.push(upper);
        stack.push(cells);
    }
    chunks
}

/// The unit of chunking: a planar region.
struct Cell {
    center: DVec3,
    faces: Vec<u32>,
}
