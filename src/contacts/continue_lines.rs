//! Continues the lines of thin walls to the border of the surface that they stand on.
//!
//! Around the end of a wall, and around a leg, the floor hangs together, and its chart has texels on both sides. Where the
//! wall is narrower than a look-up reaches, a look-up on one side reads texels of the other. A line through the wall, from
//! border to border of the floor, puts the sides into different charts; the seams between them are stitched like others.
//!
//! Only where it is needed, since every line makes charts: where the same piece of a plane surface lies on both sides of a
//! line within [`REACH`] texels, on [`LEAST_LENGTH`] texels of it. So walls have it and shelves, legs of tables do not: light
//! gets round them.
//!
//! Limit: a wall that is curved on the floor counts as straight ones of up to [`STRAIGHT`]; short ones get no line.

use super::Segment;
use super::arrange::Shape;
use super::find::{MARGIN, part_on};
use super::mesh::{GRID, Mesh};
use super::plane::{Plane, along, clip, weights};
use crate::base::{Sets, parallel};
use glam::{DVec2, DVec3};
use rayon::slice::ParallelSliceMut;
use std::collections::HashMap;

/// Thickness below which a wall is thin [texels]: a look-up reaches over two texels, turned by 45° over √8.
const REACH: f64 = 2.83;
/// Length from which a thin wall gets its line [texels].
const LEAST_LENGTH: f64 = 4.0;
/// Distance of the points at which lines are looked at [texels].
const STEP: f64 = 0.5;
/// Most of these points on one piece of a line.
const MOST_STEPS: f64 = 4096.0;
/// Sine of the angle up to which pieces of a line are one wall (20°).
const STRAIGHT: f64 = 0.34;
/// Cosine from which on triangles lie in one plane, if their corners do.
const PLANE: f64 = 0.999;

/// Lines to add.
#[derive(Debug, Default)]
pub(super) struct Continued {
    /// Triangle and line.
    pub(super) lines: Vec<(u32, Segment)>,
    /// Walls.
    pub(super) count: u64,
}

/// A point by what it lies on: a place, an edge, or the inside of a triangle.
type Key = (u32, u32, u32);

/// A piece of a cut triangle, in the plane of its region.
struct Piece {
    corners: [DVec2; 3],
    keys: [Key; 3],
}

/// Lines through thin walls, for all plane regions that have contacts. `texel` is that of parts without a density of their
/// own [m].
pub(super) fn continued(mesh: &Mesh<'_>, shapes: &[Option<Shape>], texel: f64, tolerance: f64) -> Continued {
    let mut seen = vec![false; shapes.len()];
    let mut regions = vec![];
    for (t, shape) in (0u32..).zip(shapes) {
        if !seen[t as usize]
            && shape.as_ref().is_some_and(|s| !s.borders.is_empty())
            && let Some((plane, _)) = mesh.flat(t)
        {
            regions.push((plane, region(mesh, t, plane, tolerance, &mut seen)));
        }
    }
    let found = parallel::map(regions.len(), |r| {
        let (plane, triangles) = &regions[r];
        let texel = texel / f64::from(mesh.scene.part(triangles[0]).treatment.density);
        Region::new(mesh, shapes, *plane, triangles, texel, tolerance).lines(mesh)
    });
    let mut all = Continued::default();
    for region in found {
        all.count += region.count;
        all.lines.extend(region.lines);
    }
    all
}

/// Triangles that hang together with one in its plane.
fn region(mesh: &Mesh<'_>, seed: u32, plane: Plane, tolerance: f64, seen: &mut [bool]) -> Vec<u32> {
    let mut all = vec![seed];
    seen[seed as usize] = true;
    let mut next = 0;
    while next < all.len() {
        let t = all[next];
        next += 1;
        for side in 0..3 {
            let beyond: Vec<u32> = mesh.goes_on(t, side, plane.normal).collect();
            for other in beyond {
                let corners = mesh.corners(other);
                let flat = corners.iter().all(|p| plane.height(*p).abs() <= tolerance);
                let alike = Plane::new(corners).is_some_and(|p| p.normal.dot(plane.normal) > PLANE);
                if flat && alike && mesh.is_cut(other) && !seen[other as usize] {
                    seen[other as usize] = true;
                    all.push(other);
                }
            }
        }
    }
    all
}

/// Plane triangles that hang together, cut into pieces.
struct Region<'a> {
    plane: Plane,
    triangles: &'a [u32],
    texel: f64,
    tolerance: f64,
    pieces: Vec<Piece>,
    /// Connected part of the region that each piece is in.
    part: Vec<usize>,
    /// Lines between parts.
    borders: Vec<Segment>,
    /// Pieces by cell of a grid.
    cells: HashMap<[i32; 2], Vec<u32>>,
    cell: f64,
}

impl<'a> Region<'a> {
    fn new(
        mesh: &Mesh<'_>,
        shapes: &[Option<Shape>],
        plane: Plane,
        triangles: &'a [u32],
        texel: f64,
        tolerance: f64,
    ) -> Self {
        let (mut pieces, mut borders) = (vec![], vec![]);
        for &t in triangles {
            let corners = mesh.corners(t).map(|p| plane.at(p));
            match &shapes[t as usize] {
                None => pieces.push(Piece { corners, keys: [0, 1, 2].map(|k| corner_key(mesh, t, k)) }),
                Some(shape) => {
                    let at = |k: u32| place(corners, shape.points[k as usize]);
                    let key = |k: u32| key(mesh, t, shape.points[k as usize]);
                    pieces.extend(shape.triangles.iter().map(|p| Piece { corners: p.map(at), keys: p.map(key) }));
                    borders.extend(shape.borders.iter().map(|&[a, b]| (sorted(key(a), key(b)), [at(a), at(b)])));
                }
            }
        }
        borders.sort_by_key(|b: &((Key, Key), Segment)| b.0);
        borders.dedup_by_key(|b| b.0);
        let part = parts(&pieces, &borders);
        let (low, high) = pieces
            .iter()
            .flat_map(|p| p.corners)
            .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        // About as many cells as pieces, and none smaller than a texel.
        let cell = ((high - low).element_product() / pieces.len() as f64).sqrt().max(texel);
        let borders = borders.into_iter().map(|(_, line)| line).collect();
        let mut region =
            Self { plane, triangles, texel, tolerance, pieces, part, borders, cells: HashMap::new(), cell };
        region.fill_cells();
        region
    }

    fn cell_of(&self, p: DVec2) -> [i32; 2] {
        (p / self.cell).floor().to_array().map(|x| x as i32)
    }

    fn fill_cells(&mut self) {
        for k in 0..self.pieces.len() {
            let [a, b, c] = self.pieces[k].corners;
            let (low, high) = (self.cell_of(a.min(b).min(c)), self.cell_of(a.max(b).max(c)));
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    self.cells.entry([x, y]).or_default().push(k as u32);
                }
            }
        }
    }

    /// The part that a point lies in.
    fn part_at(&self, p: DVec2) -> Option<usize> {
        let near = self.cells.get(&self.cell_of(p))?;
        let inside = |k: &&u32| weights(self.pieces[**k as usize].corners, p).iter().all(|w| *w >= 0.0);
        near.iter().find(inside).map(|k| self.part[*k as usize])
    }

    /// Length of a line with one part on both sides within reach [m].
    fn thin_length(&self, [a, b]: Segment) -> f64 {
        let length = a.distance(b);
        let Some(across) = (b - a).perp().try_normalize() else { return 0.0 };
        let count = (length / (STEP * self.texel)).ceil().clamp(1.0, MOST_STEPS);
        let beside = 3.0 * self.tolerance;
        let thin = |k: &u32| {
            let middle = a.lerp(b, (f64::from(*k) + 0.5) / count);
            [across, -across].into_iter().any(|side| {
                let own = self.part_at(middle + side * beside);
                let beyond = (0..=24).map(|k| beside + (REACH * self.texel - beside) * f64::from(k) / 24.0);
                own.is_some() && beyond.into_iter().any(|r| self.part_at(middle - side * r) == own)
            })
        };
        (0..count as u32).filter(thin).count() as f64 * length / count
    }

    /// The lines of its thin walls, by triangle.
    fn lines(&self, mesh: &Mesh<'_>) -> Continued {
        let thin: Vec<f64> = self.borders.iter().map(|line| self.thin_length(*line)).collect();
        let mut order: Vec<usize> = (0..thin.len()).filter(|&k| thin[k] > 0.0).collect();
        order.sort_by(|&a, &b| thin[b].total_cmp(&thin[a]).then(a.cmp(&b)));
        let mut walls: Vec<Wall> = vec![];
        for k in order {
            let line = self.borders[k];
            match walls.iter_mut().find(|wall| wall.has(&line, REACH * self.texel)) {
                Some(wall) => wall.add(&line, thin[k], self.tolerance),
                None => walls.push(Wall { line, thin: thin[k] }),
            }
        }
        let mut out = Continued::default();
        for wall in walls.into_iter().filter(|wall| wall.thin >= LEAST_LENGTH * self.texel) {
            out.count += 1;
            out.lines.extend(self.through(mesh, &wall.line));
        }
        out
    }

    /// A line, continued as far as the region goes on without a gap.
    fn through(&self, mesh: &Mesh<'_>, line: &Segment) -> Vec<(u32, Segment)> {
        let direction = (line[1] - line[0]).normalize_or_zero();
        let far = self.pieces.iter().flat_map(|p| p.corners).fold(0.0f64, |m, p| m.max(p.distance(line[0])));
        let endless = [line[0] - direction * (far + 1.0), line[0] + direction * (far + 1.0)];
        let span = |p: DVec2| (p - line[0]).dot(direction);
        let mut met: Vec<(f64, f64, u32)> = vec![];
        for &t in self.triangles {
            let flat = mesh.corners(t).map(|p| self.plane.at(p));
            if let Some([a, b]) = clip(flat, endless, MARGIN * self.tolerance) {
                met.push((span(a), span(b), t));
            }
        }
        let (mut low, mut high) = (0.0f64, span(line[1]));
        met.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        met.iter().for_each(|m| high = if m.0 <= high { high.max(m.1) } else { high });
        met.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.2.cmp(&b.2)));
        met.iter().for_each(|m| low = if m.1 >= low { low.min(m.0) } else { low });
        let within = met.into_iter().map(|(from, to, t)| (from.max(low), to.min(high), t));
        let kept = within.filter(|(from, to, _)| to - from > self.tolerance);
        kept.filter_map(|(from, to, t)| {
            let (own, flat) = mesh.flat(t)?;
            let world = |x: f64| -> DVec3 { self.plane.point(line[0] + direction * x) };
            let part = part_on(flat, [from, to].map(|x| own.at(world(x))), self.tolerance)?;
            Some((t, part))
        })
        .collect()
    }
}

/// Pieces of lines that belong to one wall.
struct Wall {
    line: Segment,
    /// Length on which it is thin [m].
    thin: f64,
}

impl Wall {
    /// The line belongs to this wall: one of its sides, or its continuation behind a door.
    fn has(&self, line: &Segment, reach: f64) -> bool {
        let [u, v] = [self.line, *line].map(|[a, b]| (b - a).normalize_or_zero());
        let near = line.iter().all(|p| along(self.line, *p).1 < reach);
        u.perp_dot(v).abs() < STRAIGHT && near
    }

    fn add(&mut self, line: &Segment, thin: f64, tolerance: f64) {
        if line.iter().all(|p| along(self.line, *p).1 <= 2.0 * tolerance) {
            self.thin += thin;
            let mut ends = [self.line[0], self.line[1], line[0], line[1]];
            ends.sort_by(|p, q| along(self.line, *p).0.total_cmp(&along(self.line, *q).0));
            self.line = [ends[0], ends[3]];
        }
    }
}

/// Connected parts of pieces, over sides that are no borders.
fn parts(pieces: &[Piece], borders: &[((Key, Key), Segment)]) -> Vec<usize> {
    let mut sides: Vec<((Key, Key), usize)> = vec![];
    for (p, piece) in pieces.iter().enumerate() {
        for k in 0..3 {
            sides.push((sorted(piece.keys[k], piece.keys[(k + 1) % 3]), p));
        }
    }
    sides.par_sort_unstable();
    let mut sets = Sets::new(pieces.len());
    for pair in sides.windows(2) {
        if pair[0].0 == pair[1].0 && borders.binary_search_by_key(&pair[0].0, |b| b.0).is_err() {
            sets.join(pair[0].1, pair[1].1);
        }
    }
    (0..pieces.len()).map(|p| sets.find(p)).collect()
}

fn sorted(a: Key, b: Key) -> (Key, Key) {
    (a.min(b), a.max(b))
}

fn corner_key(mesh: &Mesh<'_>, triangle: u32, corner: usize) -> Key {
    let [place, _] = mesh.ends(triangle, corner);
    (place, place, 0)
}

/// Points on edges are the same for all triangles there; those inside are a triangle's own.
fn key(mesh: &Mesh<'_>, triangle: u32, steps: [u32; 3]) -> Key {
    if let Some(corner) = steps.iter().position(|s| *s == GRID) {
        return corner_key(mesh, triangle, corner);
    }
    let Some(side) = (0..3).find(|&k| steps[(k + 2) % 3] == 0) else {
        return (u32::MAX - triangle, steps[1], steps[2] | 1 << 31);
    };
    let ([a, b], from) = (mesh.ends(triangle, side), steps[(side + 1) % 3]);
    if a < b { (a, b, from) } else { (b, a, GRID - from) }
}

fn place(corners: [DVec2; 3], steps: [u32; 3]) -> DVec2 {
    let [a, b, c] = steps.map(|s| f64::from(s) / f64::from(GRID));
    corners[0] * a + corners[1] * b + corners[2] * c
}
