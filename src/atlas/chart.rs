//! xatlas, the only file that calls it: cuts a few hundred faces into charts and flattens them.
//!
//! The wrapper trusts its caller with lengths, finiteness and call order; everything it trusts is made true here:
//! * one mesh per atlas object, indexed, every index and length derived from one list of faces;
//! * positions relative to the middle of the piece and divided by its median edge: xatlas has absolute tolerances (a
//!   mesh scaled by 10⁻⁶ comes out without charts, coordinates of 10³⁰ never come back). Pieces that reach beyond
//!   [`MAX_COORDINATE`] median edges do not enter it;
//! * `add_mesh_join` right after `add_mesh`, also after an error, else dropping the object aborts with asserts on;
//! * results are read only after a complete run with at least one chart (otherwise the wrapper makes slices of null);
//! * `face_ignore_data` is never set (the wrapper passes one flag where xatlas reads one per face).
//!
//! Texture coordinates come out of its packer alone. It runs at so coarse a scale that every chart is about one texel
//! and packing costs nothing; the separate scaling of x and y to whole texels is undone in `flatten`.
//!
//! Limits: built without threads, see `.cargo/config.toml`; a time limit is noticed between charts, not within one.

use super::Error;
use super::flatten;
use super::flatten::Flat;
use super::guard::Guard;
use super::weld::Surface;
use glam::DVec2;
use glam::DVec3;
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;
use xatlas_rs_v2::ChartOptions;
use xatlas_rs_v2::IndexData;
use xatlas_rs_v2::MeshData;
use xatlas_rs_v2::MeshDecl;
use xatlas_rs_v2::PackOptions;
use xatlas_rs_v2::Xatlas;

/// Largest coordinate that xatlas gets to see [median edges].
const MAX_COORDINATE: f64 = 1e6;

/// Charts for the given faces; every one of them is in exactly one chart.
pub(super) fn unwrap(surface: &Surface, faces: &[u32], guard: &Guard) -> Result<Vec<Flat>, Error> {
    guard.check()?;
    if let Some(flat) = flatten::project(surface, faces) {
        return Ok(vec![flat]);
    }
    let Some(input) = Input::new(surface, faces) else {
        return Ok(flatten::split(surface, faces));
    };
    let mut flats = Vec::new();
    let mut charted = vec![false; faces.len()];
    for chart in run(&input, guard)? {
        let mut fresh: Vec<(u32, [DVec2; 3])> = Vec::with_capacity(chart.len());
        for (face, corners) in chart {
            if !core::mem::replace(&mut charted[face as usize], true) {
                fresh.push((faces[face as usize], corners));
            }
        }
        fresh.sort_unstable_by_key(|(face, _)| *face);
        let (members, corners): (Vec<u32>, Vec<[DVec2; 3]>) = fresh.into_iter().unzip();
        if !members.is_empty() {
            flats.extend(flatten::adopt(surface, &members, corners));
        }
    }
    let missed: Vec<u32> = faces.iter().zip(&charted).filter(|(_, charted)| !**charted).map(|(f, _)| *f).collect();
    flats.extend(flatten::split(surface, &missed));
    Ok(flats)
}

/// A piece of surface as xatlas gets it.
struct Input {
    positions: Vec<f32>,
    indices: Vec<u32>,
}

impl Input {
    /// Compacts and normalises the faces; `None` where the piece has no usable scale.
    fn new(surface: &Surface, faces: &[u32]) -> Option<Self> {
        let mut edges: Vec<f64> = faces.iter().flat_map(|f| (0..3).map(|k| surface.edge_length(*f, k))).collect();
        edges.sort_by(f64::total_cmp);
        let median = *edges.get(edges.len() / 2)?;
        let mut index: HashMap<u32, u32> = HashMap::new();
        let mut points: Vec<DVec3> = Vec::new();
        let mut indices = Vec::with_capacity(faces.len() * 3);
        for f in faces {
            for v in surface.faces[*f as usize] {
                indices.push(*index.entry(v).or_insert_with(|| {
                    points.push(surface.positions[v as usize]);
                    (points.len() - 1) as u32
                }));
            }
        }
        let low = points.iter().fold(DVec3::INFINITY, |a, p| a.min(*p));
        let high = points.iter().fold(DVec3::NEG_INFINITY, |a, p| a.max(*p));
        let center = low + (high - low) * 0.5;
        let reach = (high - low).max_element() / median;
        if !(reach.is_finite() && reach < MAX_COORDINATE) {
            return None;
        }
        let positions = points.iter().flat_map(|p| ((*p - center) / median).as_vec3().to_array()).collect();
        Some(Self { positions, indices })
    }
}

/// A chart: faces of the input with the flat positions of their corners.
type RawChart = Vec<(u32, [DVec2; 3])>;

fn run(input: &Input, guard: &Guard) -> Result<Vec<RawChart>, Error> {
    let stopped = Arc::new(AtomicBool::new(false));
    let mesh = MeshDecl {
        vertex_position_data: MeshData::Contiguous(&input.positions),
        index_data: Some(IndexData::U32(&input.indices)),
        ..MeshDecl::default()
    };
    let mut atlas = Xatlas::new();
    let (ask, stop) = (guard.clone(), stopped.clone());
    atlas.set_progress_callback(move |_, _| {
        if ask.check().is_err() {
            stop.store(true, Ordering::Relaxed);
        }
        !stop.load(Ordering::Relaxed)
    });
    let added = atlas.add_mesh(&mesh);
    atlas.add_mesh_join();
    if added.is_err() {
        return Ok(Vec::new());
    }
    atlas.compute_charts(&ChartOptions::default());
    if stopped.load(Ordering::Relaxed) {
        guard.check()?;
        return Err(Error::Cancelled);
    }
    // Area of the whole piece over about one texel per chart; the median edge is 1, so pieces span tens of units.
    atlas.pack_charts(&PackOptions {
        texels_per_unit: 1.0 / 64.0,
        bilinear: false,
        rotate_charts_to_axis: false,
        rotate_charts: false,
        ..PackOptions::default()
    });
    if stopped.load(Ordering::Relaxed) {
        guard.check()?;
        return Err(Error::Cancelled);
    }
    if atlas.chart_count() == 0 || atlas.mesh_count() != 1 {
        return Ok(Vec::new());
    }
    Ok(atlas.meshes().first().map_or_else(Vec::new, |mesh| read(input, mesh)))
}

fn read(input: &Input, mesh: &xatlas_rs_v2::Mesh) -> Vec<RawChart> {
    if mesh.index_array.len() != input.indices.len() {
        return Vec::new();
    }
    let corner = |c: usize| {
        let vertex = mesh.vertex_array.get(mesh.index_array[c] as usize)?;
        let charted =
            vertex.atlas_index >= 0 && vertex.xref == input.indices[c] && vertex.uv.iter().all(|x| x.is_finite());
        charted.then(|| DVec2::new(f64::from(vertex.uv[0]), f64::from(vertex.uv[1])))
    };
    let face = |f: u32| {
        let first = f as usize * 3;
        let inside = first + 2 < mesh.index_array.len();
        inside.then(|| Some((f, [corner(first)?, corner(first + 1)?, corner(first + 2)?]))).flatten()
    };
    mesh.chart_array.iter().map(|chart| chart.face_array.iter().filter_map(|f| face(*f)).collect()).collect()
}
