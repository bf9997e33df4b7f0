//! Charts smaller than a texel share texels: those of a part that lie within a texel of each other and face one way.
//!
//! Each would take a texel and the padding around it, so meshes far finer than their texels cost by their charts: a pot
//! plant of 28,820 leaves had 23,042 texels where its surface fills 178. Within a texel they lie side by side, so no place
//! of a page belongs to two places of the surface.
//!
//! What shares a texel
//! * is near: groups are cells of a grid over what there is of such charts in the part, not larger than a texel, so a
//!   group is at most two texels wide;
//! * faces one way: one of 54, within which normals are at most 42° from each other;
//! * is about as open (`open`): without that, keys of a keyboard were as dark as the gaps between them.
//!
//! The plant has 4,512 texels; `final` takes 6.2 s instead of 20. Against a bake with texels of an eighth of the width its
//! root mean square error is 0.38 instead of 0.42 of a mean of 0.92; a keyboard's, against a sixth, 0.052 instead of 0.076 of
//! 0.41. With six directions and half the steps of openness errors were about as low, but pictures showed blocks on the rim
//! of a pot, where its outside shared texels with its inside.
//!
//! Limit: of light that changes within a texel, such as from the inside of a body finer than that to its outside, the
//! mean is shown; that is what a texel is.

use super::align::Face;
use super::align::Piece;
use super::open::openness;
use super::shape::extent;
use crate::base::parallel;
use crate::scene::Scene;
use crate::trace::Tracer;
use glam::DVec2;
use glam::DVec3;

/// Room between charts in one texel [texels]: samples that tell overlaps are a 16th apart, coordinates are rounded to less.
const GAP: f64 = 1.0 / 256.0;

/// Side of a texel that is used: all of it but for rounding.
const FULL: f64 = 1.0 - 1e-9;

/// Largest side of what shares a texel, in texels: twice √3, the most that two texels have in any direction.
const MOST_WIDTH: f64 = 3.5;

/// Tangent of half a third of a right angle, which a side of a cube fills.
const TAN_THIRD: f64 = 0.268;

/// Cosine between a normal and the mean of a set below which it faces away.
const AWAY: f64 = 0.5;

/// Share of the area that may: charts bend, and rounding takes parts of them away that have no area on a page.
const MOST_AWAY: f64 = 0.1;

/// How far a chart looks around, in texels: what is farther closes in all that shares its texel about as much.
const SURROUNDINGS: f64 = 2.0;

/// What a chart is in the world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Speck {
    low: DVec3,
    high: DVec3,
    /// Sum of the normals by area; means nothing where it is 0.
    normal: DVec3,
}

impl Speck {
    /// No triangles.
    pub(crate) const NONE: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY, normal: DVec3::ZERO };

    /// With a triangle more.
    pub(crate) fn add(&mut self, corners: [DVec3; 3]) {
        let [a, b, c] = corners;
        self.low = self.low.min(a).min(b).min(c);
        self.high = self.high.max(a).max(b).max(c);
        self.normal += (b - a).cross(c - a);
    }

    fn of(scene: &Scene, piece: &Piece) -> Self {
        let first = scene.parts[piece.owners[0][0] as usize].triangles.start;
        let mut speck = Self::NONE;
        let corners = |face: &Face| scene.corners(first + face.triangle).map(|p| p.as_dvec3());
        piece.faces.iter().for_each(|face| speck.add(corners(face)));
        speck
    }

    /// Which of the directions it faces: those of the squares on a cube whose sides are cut in three by equal angles.
    fn direction(&self) -> u8 {
        let n = self.normal.abs();
        let axis = if n.x >= n.y && n.x >= n.z { 0 } else { 1 + usize::from(n.z > n.y) };
        let side = 2 * axis + usize::from(self.normal[axis] < 0.0);
        let third = |k: usize| {
            let tangent = self.normal[(axis + k) % 3] / n[axis];
            1 + usize::from(tangent > TAN_THIRD) - usize::from(tangent < -TAN_THIRD)
        };
        (9 * side + 3 * third(1) + third(2)) as u8
    }
}

/// Charts that share texels of this width [m] are as near to each other, and as alike in direction, as those made here.
pub(crate) fn belong_together(specks: &[Speck], edge: f64) -> bool {
    let low = specks.iter().fold(DVec3::INFINITY, |a, s| a.min(s.low));
    let high = specks.iter().fold(DVec3::NEG_INFINITY, |a, s| a.max(s.high));
    let mean = specks.iter().fold(DVec3::ZERO, |a, s| a + s.normal).normalize_or_zero();
    let area = |is_counted: &dyn Fn(&Speck) -> bool| {
        specks.iter().filter(|s| is_counted(s)).map(|s| s.normal.length()).fold(0.0, |a, b| a + b)
    };
    let away = area(&|s| s.normal.dot(mean) < AWAY * s.normal.length());
    (high - low).max_element() <= MOST_WIDTH * edge && away <= MOST_AWAY * area(&|_| true)
}

/// What a piece smaller than a texel is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Small {
    speck: Speck,
    /// Factor on the density of its part.
    factor: f64,
    /// See `open`.
    openness: u8,
}

/// The pieces that are smaller than a texel at `density` [texels/m]; the others are `None`.
pub(super) fn small(tracer: &Tracer<'_>, pieces: &[Piece], density: f64) -> Vec<Option<Small>> {
    let scene = tracer.scene();
    parallel::map(pieces.len(), |i| {
        let piece = &pieces[i];
        (piece.page.is_none() && fits(size(piece, density))).then(|| {
            let factor = f64::from(scene.parts[piece.owners[0][0] as usize].treatment.density);
            let openness = openness(tracer, piece, (SURROUNDINGS / (density * factor)) as f32);
            Small { speck: Speck::of(scene, piece), factor, openness }
        })
    })
}

/// Width and height [texels].
fn size(piece: &Piece, density: f64) -> DVec2 {
    let (low, high) = extent(piece);
    (high - low) * density
}

fn fits(size: DVec2) -> bool {
    size.max_element() <= FULL
}

/// What became of pieces that share texels.
#[derive(Debug)]
pub(super) struct Shared {
    /// Texels full of them, a chart each.
    pub(super) texels: Vec<Piece>,
    /// For each of the pieces given, whether it is in one.
    pub(super) is_in: Vec<bool>,
}

/// What may share a texel: first owner, direction, cell and openness.
type Group = (u32, u8, [u32; 3], u8);

/// A piece that may share a texel.
struct Member {
    group: Group,
    index: usize,
    /// Width and height [texels].
    size: DVec2,
}

/// Puts pieces smaller than a texel at `density` [texels/m] together; `small` are those of the pieces.
pub(super) fn share(pieces: &[Piece], small: &[Option<Small>], density: f64) -> Shared {
    let mut members = members(pieces, small, density);
    // Highest first, as shelves want it.
    members.sort_by(|a, b| a.group.cmp(&b.group).then(b.size.y.total_cmp(&a.size.y)).then(a.index.cmp(&b.index)));
    let mut shared = Shared { texels: Vec::new(), is_in: vec![false; pieces.len()] };
    for group in members.chunk_by(|a, b| a.group == b.group) {
        for texel in shelves(group) {
            if let [(first, _), _, ..] = texel.as_slice() {
                let mut all = Piece { faces: vec![], corners: vec![], ..pieces[group[*first].index].clone() };
                for (k, at) in texel {
                    let index = group[k].index;
                    shared.is_in[index] = true;
                    add(&mut all, &pieces[index], at / density);
                }
                shared.texels.push(all);
            }
        }
    }
    shared
}

/// The pieces smaller than a texel, with the cells of a grid over those of their part.
fn members(pieces: &[Piece], small: &[Option<Small>], density: f64) -> Vec<Member> {
    let candidate = |i: usize| small[i].map(|small| (i, small, size(&pieces[i], density)));
    let candidates: Vec<_> = (0..pieces.len()).filter_map(candidate).filter(|(_, _, size)| fits(*size)).collect();
    let owner = |i: usize| pieces[i].owners[0][0];
    let mut members = Vec::with_capacity(candidates.len());
    for of_part in candidates.chunk_by(|a, b| owner(a.0) == owner(b.0)) {
        let low = of_part.iter().fold(DVec3::INFINITY, |a, (_, small, _)| a.min(small.speck.low));
        let high = of_part.iter().fold(DVec3::NEG_INFINITY, |a, (_, small, _)| a.max(small.speck.high));
        let texels = (high - low) * (density * of_part[0].1.factor);
        let cells = texels.ceil().max(DVec3::ONE);
        let scale = cells / (high - low).max(DVec3::splat(f64::MIN_POSITIVE));
        members.extend(of_part.iter().map(|&(index, Small { speck, openness, .. }, size)| {
            let cell = ((speck.low + speck.high) * 0.5 - low) * scale;
            let cell = cell.min(cells - 1.0).as_uvec3().to_array();
            Member { group: (owner(index), speck.direction(), cell, openness), index, size }
        }));
    }
    members
}

/// Places within one texel after the other: index into `group` and lower corner [texels].
fn shelves(group: &[Member]) -> Vec<Vec<(usize, DVec2)>> {
    let (mut texels, mut at, mut height) = (vec![vec![]], DVec2::ZERO, 0.0f64);
    for (k, Member { size, .. }) in group.iter().enumerate() {
        if at.x + size.x > FULL {
            (at, height) = (DVec2::new(0.0, at.y + height), 0.0);
        }
        if at.y + size.y > FULL {
            texels.push(vec![]);
            (at, height) = (DVec2::ZERO, 0.0);
        }
        if let Some(texel) = texels.last_mut() {
            texel.push((k, at));
        }
        at.x += size.x + GAP;
        height = height.max(size.y + GAP);
    }
    texels
}

/// Adds the faces of a piece with its lower corner at a place [m].
fn add(all: &mut Piece, piece: &Piece, at: DVec2) {
    let (low, _) = extent(piece);
    all.faces.extend(&piece.faces);
    all.corners.extend(piece.corners.iter().map(|c| c.map(|p| p - low + at)));
}
