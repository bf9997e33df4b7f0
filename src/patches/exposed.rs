//! Which part of a texel is really in the open: texels under a table leg or inside a wall take no part in light.
//!
//! In: patches and tracer. Out: `exposed`, the cell mask, and centroids of what is exposed.
//!
//! Source: the point lists per texel of O'Donnell ("Precomputed Global Illumination in Frostbite", GDC 2018), as a mask
//! of 8 × 8 cells. Where we differ: cells are tested only where something stands near or over the texel's centre.
//!
//! A point is hidden when it lies in a solid ([`solids`](super::solids)). Sheets with one side hide only what lies behind
//! them in texels that have a part before them ([`behind`](super::behind)); what double-sided ones hide is found later
//! ([`pockets`](super::pockets)). A point of a single-sided surface is hidden too when another surface lies on it face to
//! face, as the underside of a crate and the floor do, and it is not the other side of the same wall
//! ([`party`](super::party)).
//!
//! Limits: a floor that is closed in by single-sided surfaces which all face away from it counts as hidden. In a texel
//! with many triangles, what lies on one that is not looked at may be missed.

use super::behind::{self, Sheets, span};
use super::cells::{MASK_GRID, cell_index};
use super::clear::Clear;
use super::crossable::Crossable;
use super::facing::{Contact, Facing};
use super::party::PartyWalls;
use super::pieces::Pieces;
use super::solids::{Solids, are_joined, is_inside, which_inside};
use super::{Patches, SurfacePoint};
use crate::base::{Frame, Progress, parallel};
use crate::scene::Scene;
use crate::trace::{Closed, Ray, Tracer};
use glam::{DVec2, Vec3};

/// Height of the short rays that look for things standing on a texel, in texel edges: higher misses skirting boards,
/// lower meets the surface itself where it is curved.
pub(super) const LOW: f32 = 0.06;
/// Length of these rays in texel edges: half a diagonal and a little.
const REACH: f32 = 0.75;

/// Distance from a texel's plane, in texel edges, at which a surface that faces the same way belongs to it: far below
/// [`LOW`].
const FLAT: f32 = 0.005;
/// Cosine to the texel's normal from which a surface counts as parallel.
pub(super) const SAME_PLANE: f32 = 0.9999;
/// Angle up to which a surface may lie on another face to face: more than seals [rad].
const FACING: f32 = 0.2;
/// Cosine between the texel's normal and those of its triangles from which on it is looked at as a whole.
const BENT: f32 = 0.877_582_55;
/// Rounding of positions, relative to the largest coordinate.
const PAD: f32 = 1e-5;

/// Triangles of a texel that are looked at for what seals them. A texel with hundreds of them says little of each; a
/// texel over all of a ball of 10,000 triangles took 5 ms.
const MOST_LOOKS: usize = 64;

/// Triangles near a texel from which on it is taken for one that anything may stand within: boxes of texels as large as
/// the scene hold all of it.
pub(super) const MOST_NEAR: u32 = 512;
/// Points that are looked at in a cell of the mask; what else lies there is taken for the like. A texel below a thousand
/// triangles, each as large as itself, would take 64,000 looks.
const MOST_POINTS: u32 = 8;
/// The same for texels of more than [`MOST_LOOKS`] triangles.
const CRUMPLED_POINTS: u32 = 2;

/// Surfaces that may lie on one, each the other side of the one before. More rounds only cost time where hundreds of faces
/// lie in one plane.
const MOST_SIDES: usize = 2;
/// Share of the surface up to which sides of walls are too few for rays to meet them.
const FEW_SIDES: f64 = 1e-3;

/// Less than this share of a texel counts as none: a single line would make a spike of it.
pub(super) const LEAST_EXPOSED: f32 = 0.04;

/// Surface in one cell of the mask.
#[derive(Clone, Copy, Default)]
struct Cell {
    area: f32,
    open: f32,
    /// Of it, what does not lie behind a sheet.
    before: f32,
    /// Position times area [m³].
    position: Vec3,
}

impl Cell {
    /// Adds surface at a position [m] that is open, and not behind a sheet; where it was not looked at, it is like what was.
    fn add(&mut self, area: f32, position: Vec3, looks: Option<[bool; 2]>) {
        let share = |part: f32| part / self.area.max(f32::MIN_POSITIVE);
        let [open, before] =
            looks.map_or([share(self.open), share(self.before)], |looks| looks.map(|yes| f32::from(u8::from(yes))));
        self.area += area;
        self.open += area * open;
        self.before += area * before;
        self.position += position * area;
    }
}

/// What was found for one texel.
#[derive(Default)]
struct Found {
    /// A sheet may stand within it or beside it.
    walled: bool,
    /// What lies on parts of it face to face, once for each pair of triangles.
    contacts: Vec<Contact>,
    /// The rest means something.
    partly: bool,
    mask: u64,
    exposed: f32,
    position: Vec3,
}

/// Sets mask, exposed share and centroid of every patch, which front patches a sheet may stand within or beside, and which
/// triangles are the two sides of a wall.
pub(super) fn find(patches: &mut Patches, tracer: &Tracer<'_>, closed: &Closed, progress: &Progress) {
    let mut party = PartyWalls::default();
    let solids = Solids { tracer, closed, party: &party };
    let clear = Clear::find(patches, solids, progress);
    let look = |i| if clear.has(patches, i) { Found::default() } else { texel(patches, solids, i) };
    let mut found = parallel::map_watched(patches.front, progress, look);
    for _ in 0..MOST_SIDES {
        let known = party.len();
        let new = PartyWalls::among(Solids { tracer, closed, party: &party }, found.iter().flat_map(|f| &f.contacts));
        party.extend(new);
        if party.len() == known {
            break;
        }
        // Backs of such walls may have made other points look as if they lay in solids, too.
        let large = party.area(tracer.scene()) >= FEW_SIDES * patches.area.iter().map(|a| f64::from(*a)).sum::<f64>();
        let asked = |f: &Found| large && f.partly || f.contacts.iter().any(|contact| party.has(contact.pair()));
        let again: Vec<usize> = (0..patches.front).filter(|&i| asked(&found[i])).collect();
        let solids = Solids { tracer, closed, party: &party };
        let anew = parallel::map_watched(again.len(), progress, |k| texel(patches, solids, again[k]));
        again.iter().zip(anew).for_each(|(&i, anew)| found[i] = anew);
    }
    patches.party = party;
    patches.walled = found.iter().map(|f| f.walled).collect();
    for (i, f) in found.into_iter().enumerate().filter(|(_, f)| f.partly) {
        patches.keep_found(i, &f);
    }
}

impl Patches {
    /// Sets what was found for a front patch, and for its back.
    fn keep_found(&mut self, front: usize, found: &Found) {
        let back = self.back_of[front];
        for patch in [Some(front), (back != super::NO_PATCH).then_some(back as usize)].into_iter().flatten() {
            self.mask[patch] = found.mask;
            self.exposed[patch] = found.exposed;
            if found.exposed > 0.0 {
                self.position[patch] = found.position;
            }
        }
    }
}

impl Patches {
    /// A point of a patch near its centroid, rather on a large piece than on a small one.
    pub(super) fn middle(&self, tracer: &Tracer<'_>, patch: usize) -> Option<SurfacePoint> {
        let (mut best, mut middle) = (f32::INFINITY, None);
        self.cells(patch, 1, |point, _, area| {
            let position = tracer.scene().position(point.triangle, point.b);
            let distance = position.distance_squared(self.position[patch]) - area;
            if distance < best {
                (best, middle) = (distance, Some(point));
            }
        });
        middle
    }
}

fn texel(patches: &Patches, solids: Solids<'_>, patch: usize) -> Found {
    let tracer = solids.tracer;
    let Some(center) = patches.middle(tracer, patch) else { return Found::default() };
    let about = About::new(patches, solids, patch);
    if let Some(contacts) = about.facing.seals_all(patches, solids, patch) {
        return Found { partly: true, contacts, walled: about.sheet, ..Found::default() };
    }
    let near = near(patches, solids, patch, &about);
    if near != Near::Within && !is_hidden(solids, center, &about.facing) {
        return Found { walled: about.sheet && near == Near::Beside, ..Found::default() };
    }
    let (mut cells, contacts) = cells(patches, solids, patch, &about);
    let walled = Found { walled: about.sheet, contacts, ..Found::default() };
    if cells.iter().any(|cell| cell.before > 0.0) {
        cells.iter_mut().for_each(|cell| cell.open = cell.before);
    }
    let (mut mask, mut open, mut total, mut sum) = (0u64, 0.0f32, 0.0f32, Vec3::ZERO);
    for (k, cell) in cells.iter().enumerate() {
        total += cell.area;
        // A cell counts whole or not at all, as the lines that land on it do.
        if cell.area > 0.0 && cell.open >= 0.5 * cell.area {
            mask |= 1 << k;
            open += cell.area;
            sum += cell.position;
        }
    }
    if open >= total {
        return walled;
    }
    if open < LEAST_EXPOSED * total {
        return Found { partly: true, ..walled };
    }
    let position = sum / open.max(f32::MIN_POSITIVE);
    Found { partly: true, mask, exposed: open / total, position, ..walled }
}

/// The surface in the cells of the mask, and what lies on it.
fn cells(
    patches: &Patches,
    solids: Solids<'_>,
    patch: usize,
    about: &About,
) -> ([Cell; (MASK_GRID * MASK_GRID) as usize], Vec<Contact>) {
    let mut cells = [Cell::default(); (MASK_GRID * MASK_GRID) as usize];
    let fragments = patches.fragments.range(patch);
    let most = if fragments.len() > MOST_LOOKS { CRUMPLED_POINTS } else { MOST_POINTS };
    let height = LOW * patches.texel_edge(patch);
    let sheets = about.sheet.then(|| {
        let sheets = if about.crowded { Sheets::anywhere } else { Sheets::near };
        sheets(patches, solids, patch)
    });
    let (mut points, mut areas, mut asked, mut contacts) = (vec![], vec![], vec![], Vec::<Contact>::new());
    let mut looks = [0; (MASK_GRID * MASK_GRID) as usize];
    for f in fragments {
        let first = points.len();
        patches.cell_centroids(patch, f, MASK_GRID, |point, centroid, area| {
            points.push((point, centroid));
            areas.push(area);
        });
        let sealed = about.facing.seal(solids, &points[first..]);
        for (&(point, centroid), by) in points[first..].iter().zip(sealed) {
            let looks = &mut looks[cell_index(centroid, MASK_GRID)];
            *looks += 1;
            asked.push((*looks <= most).then_some(by.is_none()));
            contacts.extend(by.map(|by| Contact { point, by }));
        }
    }
    let asking: Vec<_> =
        points.iter().zip(&asked).filter(|(_, asked)| **asked == Some(true)).map(|(p, _)| *p).collect();
    let mut inside = which_inside(solids, &about.over, &asking, height).into_iter();
    for (((point, centroid), area), asked) in points.into_iter().zip(areas).zip(asked) {
        let open = asked == Some(true) && inside.next() == Some(false);
        let position = solids.tracer.scene().position(point.triangle, point.b);
        let before = open && !sheets.as_ref().is_some_and(|sheets| sheets.hide(position));
        cells[cell_index(centroid, MASK_GRID)].add(area, position, asked.map(|_| [open, before]));
    }
    (cells, middles(contacts))
}

/// For each pair of triangles one contact of some, about the middle one.
fn middles(mut contacts: Vec<Contact>) -> Vec<Contact> {
    contacts.sort_by_key(Contact::pair);
    contacts.chunk_by(|a, b| a.pair() == b.pair()).map(|same| same[same.len() / 2]).collect()
}

/// What lies about a texel.
struct About {
    /// Something may stand within the texel.
    stands: bool,
    facing: Facing,
    /// A sheet may stand within the texel or beside it: a surface with one side that does not close.
    sheet: bool,
    /// What rays a little above the texel may cross.
    over: Crossable,
    /// More than [`MOST_NEAR`] triangles are near.
    crowded: bool,
}

impl About {
    /// One look into a box, which costs less than a dozen rays: where nothing that is near could meet rays along the texel,
    /// they need not be traced. Crumpled texels are not looked at.
    fn new(patches: &Patches, Solids { tracer, closed, .. }: Solids<'_>, patch: usize) -> Self {
        let over = Crossable::anything();
        let unknown = Self { stands: true, facing: Facing::Anywhere, sheet: true, over, crowded: false };
        let (scene, plane) = (tracer.scene(), Plane::of(patches, patch));
        let Some(Around { low, high, bent }) = plane.around(patches, tracer, core::iter::once(patch), BENT) else {
            return unknown;
        };
        let (facing, pad, height) = (-libm::cosf(FACING + bent), rounding(tracer), LOW * plane.edge);
        let (facings, over) = (Facing::In(vec![]), Crossable::nothing(pad));
        let mut about = Self { stands: false, facing: facings, sheet: false, over, crowded: false };
        let mut looks = 0;
        tracer.any_within(low, high, |t| {
            looks += 1;
            let own = !(about.stands && about.sheet) && plane.holds(scene, t);
            let span = span(scene, t, [plane.position, plane.normal]);
            about.stands |= !own && span[0] <= height + pad && height - pad <= span[1];
            about.sheet = about.sheet || !own && behind::is_sheet(scene, closed, t);
            if span[1] > pad {
                about.over.add(scene, t);
            }
            if !matches!(about.facing, Facing::Anywhere) && scene.geometric_normal(t).dot(plane.normal) < facing {
                about.facing.add(scene.corners(t), pad);
            }
            let all = about.stands && about.sheet && about.over.is_anything();
            looks == MOST_NEAR || all && matches!(about.facing, Facing::Anywhere)
        });
        if looks == MOST_NEAR { Self { crowded: true, ..unknown } } else { about }
    }
}

/// Bound of the rounding of positions in a scene [m].
pub(super) fn rounding(tracer: &Tracer<'_>) -> f32 {
    let (from, to) = tracer.bounds();
    PAD * from.abs().max(to.abs()).max_element()
}

/// The plane of a texel.
#[derive(Clone, Copy)]
pub(super) struct Plane {
    position: Vec3,
    normal: Vec3,
    /// Edge of the texel [m].
    edge: f32,
}

impl Plane {
    pub(super) fn of(patches: &Patches, patch: usize) -> Self {
        let (position, normal) = (patches.position[patch], patches.normal[patch]);
        Self { position, normal, edge: patches.texel_edge(patch) }
    }

    /// A triangle lies in it and faces the same way.
    pub(super) fn holds(&self, scene: &Scene, triangle: u32) -> bool {
        let off = scene.corners(triangle).map(|corner| (corner - self.position).dot(self.normal).abs());
        scene.geometric_normal(triangle).dot(self.normal) > SAME_PLANE
            && off.into_iter().fold(0.0, f32::max) < FLAT * self.edge
    }

    /// What has to do with texels in it: their surface, and what stands on them or close beside. `None` if one of them
    /// has a triangle whose normal is farther from the plane's than by a cosine of `most_bent`.
    pub(super) fn around(
        &self,
        patches: &Patches,
        tracer: &Tracer<'_>,
        texels: impl Iterator<Item = usize>,
        most_bent: f32,
    ) -> Option<Around> {
        let scene = tracer.scene();
        let pad = Vec3::splat(rounding(tracer));
        let (mut low, mut high, mut least) = (Vec3::INFINITY, Vec3::NEG_INFINITY, 1.0f32);
        for patch in texels {
            let (normal, edge) = (patches.normal[patch], patches.texel_edge(patch));
            let disc = (Vec3::ONE - normal * normal).max(Vec3::ZERO).map(f32::sqrt) * (REACH * edge);
            let above = patches.position[patch] + normal * (LOW * edge);
            (low, high) = (low.min(above - disc), high.max(above + disc));
            for f in patches.fragments.range(patch) {
                let triangle = patches.fragments.triangle(patch, f);
                least = least.min(scene.geometric_normal(triangle).dot(self.normal));
                if least < most_bent {
                    return None;
                }
                let map = patches.map(triangle, patch);
                for corner in patches.polygon(patch, f).corners() {
                    let corner = scene.position(triangle, map.weights(*corner));
                    (low, high) = (low.min(corner), high.max(corner));
                }
            }
        }
        Some(Around { low: low - pad, high: high + pad, bent: libm::acosf(least) })
    }
}

/// Where things have to do with texels.
pub(super) struct Around {
    /// Lowest coordinates [m].
    pub(super) low: Vec3,
    /// Highest coordinates [m].
    pub(super) high: Vec3,
    /// Largest angle of a triangle with the plane [rad].
    bent: f32,
}

/// What is near a texel.
#[derive(Clone, Copy, PartialEq)]
enum Near {
    Nothing,
    /// A wall at its border, or close to it.
    Beside,
    /// Something may stand within the texel, or a part of it lies on something.
    Within,
}

fn near(patches: &Patches, solids: Solids<'_>, patch: usize, about: &About) -> Near {
    let tracer = solids.tracer;
    if !about.facing.is_nowhere() {
        for f in some_of(patches, patch) {
            let mut sealed = false;
            patches.cell_centroids(patch, f, 2, |point, _, _| {
                sealed = sealed || about.facing.seals(solids, point);
            });
            if sealed {
                return Near::Within;
            }
        }
    }
    if !about.stands {
        return Near::Nothing;
    }
    let edge = patches.texel_edge(patch);
    let frame = Frame::from_normal(patches.normal[patch]);
    let origin = patches.position[patch] + frame.n * (LOW * edge);
    let mut outline: Option<Vec<SurfacePoint>> = None;
    let stands_within = (0..8).any(|k| {
        let (sin, cos) = libm::sincosf(k as f32 * core::f32::consts::FRAC_PI_4);
        let direction = (frame.s * cos + frame.t * sin) * (REACH * edge);
        let hit = tracer.closest_hit(&Ray { origin, direction, t_max: 1.0 });
        hit.is_some_and(|h| {
            let outline = outline.get_or_insert_with(|| self::outline(patches, patch));
            !h.front || !is_in_front(tracer, h.triangle, outline)
        })
    });
    // What stands beside a texel may cover a strip of it, as a board does of the panel behind it.
    let Some(outline) = outline else { return Near::Nothing };
    let covered = || outline.into_iter().any(|point| about.facing.seals(solids, point));
    if stands_within || covered() { Near::Within } else { Near::Beside }
}

/// Fragments of a patch that are looked at: all of them, or of many about [`MOST_LOOKS`].
fn some_of(patches: &Patches, patch: usize) -> impl Iterator<Item = usize> + use<> {
    let all = patches.fragments.range(patch);
    let step = all.len().div_ceil(MOST_LOOKS).max(1);
    all.step_by(step)
}

/// About the centres of the outermost cells: corners of what the triangles cover of a texel, moved in a little.
pub(super) fn outline(patches: &Patches, patch: usize) -> Vec<SurfacePoint> {
    let mut out = vec![];
    for f in some_of(patches, patch) {
        let triangle = patches.fragments.triangle(patch, f);
        let (map, polygon) = (patches.map(triangle, patch), patches.polygon(patch, f));
        let middle = polygon.centroid();
        let moved = polygon.corners().iter().map(|&c| c + (middle - c) / f64::from(MASK_GRID));
        out.extend(moved.map(|c| SurfacePoint { triangle, b: map.weights(c) }));
    }
    out
}

/// All points lie before a triangle's plane, as those of a floor do before the wall that it ends at.
fn is_in_front(tracer: &Tracer<'_>, triangle: u32, points: &[SurfacePoint]) -> bool {
    let scene = tracer.scene();
    let (corner, normal) = (scene.corners(triangle)[0], scene.geometric_normal(triangle));
    points.iter().all(|p| (scene.position(p.triangle, p.b) - corner).dot(normal) > 0.0)
}

/// A point of a front patch is not hidden, if another one is not; both [texels from the texel's corner].
pub(super) fn is_open(patches: &Patches, solids: Solids<'_>, pieces: &Pieces, [open, within]: [DVec2; 2]) -> bool {
    let height = LOW * patches.texel_edge(pieces.front);
    let (open, point) = (pieces.nearest(open), pieces.nearest(within));
    !Facing::Anywhere.seals(solids, point)
        && (are_joined(solids.tracer, open, point, height) || !is_inside(solids, point))
}

/// The point lies in a solid, or something lies on it face to face.
fn is_hidden(solids: Solids<'_>, point: SurfacePoint, facing: &Facing) -> bool {
    facing.seals(solids, point) || is_inside(solids, point)
}
