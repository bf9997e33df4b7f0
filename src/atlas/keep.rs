//! Keeps a `TEXCOORD_1` that is a usable lightmap layout, as one rigid block per node, or per page of a scene that was laid
//! out as a whole (`beside`). Parts that were cut at contacts are charted anew: their layout has texels on both sides.
//!
//! The primitives of a node's mesh are laid out together if they share one layout and are treated alike, else one by one;
//! those whose materials name another lightmap have another layout.
//! The block gets the [`page`] that it was made for, of a size at which its density is the wanted one, times the factor of its
//! parts.
//! Usable means: finite, inside [0, 1]², no place covered twice, all triangles of one orientation but for [`OUTLIERS`] of
//! the area, no visible triangle collapsed, and for all but [`OUTLIERS`] of the area a density within a factor
//! [`MAX_STRETCH`] of the mean in every direction. With [`Uv::Auto`], charts must also not share texels at the wanted
//! density, unless as those made here do (`specks`); those that do become one chart. And for all but [`OUTLIERS`] of the
//! area, look-ups in one must not read another, unless no padding is asked for: layouts that were packed for a larger page
//! would bleed. With [`Uv::Keep`], every part that gets a lightmap must have one.

use super::Error;
use super::Settings;
use super::Uv;
use super::align::Face;
use super::align::Piece;
use super::apart::Touched;
use super::beside;
use super::connect;
use super::guard::Guard;
use super::overlap;
use super::shape::extent;
use super::shape::fraction_bits;
use super::shape::shape;
use super::sides::page;
use super::specks::Speck;
use super::specks::belong_together;
use crate::base::Warning;
use crate::base::parallel;
use crate::scene::EqualParts;
use crate::scene::Scene;
use glam::DVec2;
use glam::DVec3;
use std::collections::BTreeMap;

/// Density of a triangle in any direction over the mean, and its inverse, per length.
const MAX_STRETCH: f64 = 4.0;

/// Share of the area that may be stretched more.
const OUTLIERS: f64 = 0.02;

/// Coordinates may leave [0, 1] by this much (exporters write 1.0000001).
const BORDER: f32 = 1e-4;

/// Overlap samples per triangle.
const SAMPLES: usize = 64;

/// Nodes that a message names.
const MOST_NAMES: usize = 5;

/// The parts of each block of a layout, see [`Piece::owners`].
type Owners = Vec<Vec<u32>>;

/// What can be kept.
#[derive(Debug)]
pub(super) struct Kept {
    /// Blocks, by the sets of nodes that they are of, or of one page.
    pub(super) pieces: Vec<Piece>,
    /// For each part of the scene, whether it is in a block.
    pub(super) part_is_kept: Vec<bool>,
    /// `uv-regenerated` for each part that is not, though it has a `TEXCOORD_1`, with the first part that it speaks of.
    pub(super) warnings: Vec<(u32, Warning)>,
}

/// Blocks of all usable `TEXCOORD_1`.
pub(super) fn kept_blocks(
    scene: &Scene,
    settings: &Settings,
    equal_parts: &EqualParts,
    guard: &Guard,
) -> Result<Kept, Error> {
    let mut kept = Kept { pieces: Vec::new(), part_is_kept: vec![false; scene.parts.len()], warnings: Vec::new() };
    if settings.uv == Uv::Generate {
        return Ok(kept);
    }
    if settings.uv == Uv::Keep {
        all_have_one(scene)?;
    }
    let candidate = |p: &usize| {
        let part = &scene.parts[*p];
        part.receives && part.has_uv1 && !part.triangles.is_empty() && !scene.is_cut(*p)
    };
    let candidates: Vec<usize> = (0..scene.parts.len()).filter(candidate).collect();
    let groups = groups(scene, &candidates);
    let groups: Vec<&[usize]> = groups.iter().map(Vec::as_slice).collect();
    let equal = equal(&groups, &equal_parts.first);
    let results = parallel::map(equal.len(), |g| {
        guard.check()?;
        let first = groups[equal[g][0]];
        let all = |own: &[usize]| -> Owners {
            let of = |group: &usize| own.iter().map(|k| groups[*group][*k] as u32).collect();
            equal[g].iter().map(of).collect()
        };
        let whole: Vec<usize> = (0..first.len()).collect();
        Ok(match block(scene, first, settings) {
            Err(_) if first.len() > 1 => {
                whole.iter().map(|k| (all(&[*k]), block(scene, &[first[*k]], settings))).collect()
            }
            together => vec![(all(&whole), together)],
        })
    });
    for result in results {
        let blocks: Vec<(Owners, Result<Piece, String>)> = result?;
        for (owners, piece) in blocks {
            kept.add(scene, owners, piece, settings)?;
        }
    }
    kept.join_pages(scene, settings, guard)?;
    kept.warnings.sort_by_key(|(part, _)| *part);
    Ok(kept)
}

/// All parts that get a lightmap have a `TEXCOORD_1`.
fn all_have_one(scene: &Scene) -> Result<(), Error> {
    let without = scene.parts.iter().filter(|p| p.receives && !p.has_uv1 && !p.triangles.is_empty());
    let mut nodes: Vec<&str> = without.map(|p| p.name.as_str()).collect();
    nodes.dedup();
    let all = nodes.len();
    nodes.truncate(MOST_NAMES);
    match all - nodes.len() {
        _ if all == 0 => Ok(()),
        0 => Err(Error::MissingUv { nodes: nodes.join(", ") }),
        more => Err(Error::MissingUv { nodes: format!("{} and {more} more nodes", nodes.join(", ")) }),
    }
}

impl Kept {
    /// Makes one block of blocks that lie side by side on one page, if that is a usable layout.
    fn join_pages(&mut self, scene: &Scene, settings: &Settings, guard: &Guard) -> Result<(), Error> {
        let mut gone = vec![false; self.pieces.len()];
        let mut joined = Vec::new();
        let lightmap = |piece: &Piece| lightmap(scene, piece.owners[0][0] as usize);
        for set in beside::sets(&self.pieces, lightmap, settings, guard)? {
            let parts = |i: &usize| self.pieces[*i].owners[0].iter().map(|p| *p as usize);
            let mut all: Vec<usize> = set.iter().flat_map(parts).collect();
            all.sort_unstable();
            if let Ok(piece) = block(scene, &all, settings) {
                joined.push(piece);
                set.iter().for_each(|i| gone[*i] = true);
            }
        }
        let mut gone = gone.into_iter();
        self.pieces.retain(|_| !gone.next().unwrap_or(false));
        self.pieces.extend(joined);
        Ok(())
    }

    /// A layout that is one block for each of `owners`, or what is wrong with it.
    fn add(
        &mut self,
        scene: &Scene,
        owners: Owners,
        piece: Result<Piece, String>,
        settings: &Settings,
    ) -> Result<(), Error> {
        let name = |parts: &[u32]| scene.parts[parts[0] as usize].name.clone();
        match piece {
            Ok(piece) => {
                owners.iter().flatten().for_each(|p| self.part_is_kept[*p as usize] = true);
                self.pieces.push(Piece { owners: owners.into(), ..piece });
            }
            Err(reason) if settings.uv == Uv::Keep => {
                return Err(Error::UnusableUv { node: name(&owners[0]), reason });
            }
            Err(reason) => self.warnings.extend(owners.iter().map(|parts| {
                let (name, primitive) = (name(parts), scene.parts[parts[0] as usize].primitive);
                let message = format!(
                    "TEXCOORD_1 of {name}, primitive {primitive}, is no usable lightmap layout ({reason}); new charts \
                     were made"
                );
                (parts[0], Warning::new("uv-regenerated", message).at(name))
            })),
        }
        Ok(())
    }
}

/// Parts of a node that are treated alike and whose lightmap, if they have one, is the same.
fn groups(scene: &Scene, candidates: &[usize]) -> Vec<Vec<usize>> {
    let of_node = |a: &usize, b: &usize| {
        let (a, b) = (&scene.parts[*a], &scene.parts[*b]);
        (a.node, a.mesh) == (b.node, b.mesh)
    };
    let mut groups = Vec::new();
    for node in candidates.chunk_by(of_node) {
        let mut alike: BTreeMap<_, Vec<usize>> = BTreeMap::new();
        for p in node {
            let treatment = &scene.parts[*p].treatment;
            let key = (treatment.density.to_bits(), treatment.casts, lightmap(scene, *p));
            alike.entry(key).or_default().push(*p);
        }
        let mut alike: Vec<Vec<usize>> = alike.into_values().collect();
        alike.sort_unstable_by_key(|group| group[0]);
        groups.extend(alike);
    }
    groups
}

/// The texture that the material of a part says is read by `TEXCOORD_1` for its lightmap.
fn lightmap(scene: &Scene, part: usize) -> Option<usize> {
    let material = &scene.materials[scene.parts[part].material];
    material.lightmap_texture.filter(|_| material.lightmap_uv_set == Some(1))
}

/// Groups whose parts are equal one by one, each set in the order of `groups`, sets by their first.
fn equal(groups: &[&[usize]], first_equal: &[u32]) -> Vec<Vec<usize>> {
    let mut sets: BTreeMap<Vec<u32>, Vec<usize>> = BTreeMap::new();
    for (g, group) in groups.iter().enumerate() {
        sets.entry(group.iter().map(|p| first_equal[*p]).collect()).or_default().push(g);
    }
    let mut sets: Vec<Vec<usize>> = sets.into_values().collect();
    sets.sort_unstable_by_key(|set| set[0]);
    sets
}

/// What each part's own `TEXCOORD_1` is worth as a lightmap layout: `usable`, or what is wrong with it; `None` where there
/// is none.
pub(super) fn layouts(scene: &Scene, settings: &Settings) -> Vec<Option<String>> {
    let settings = Settings { uv: Uv::Auto, ..settings.clone() };
    parallel::map(scene.parts.len(), |p| {
        let part = &scene.parts[p];
        let quality = || block(scene, &[p], &settings).map_or_else(|why| why, |_| "usable".to_owned());
        (part.has_uv1 && !part.triangles.is_empty()).then(quality)
    })
}

/// The layout of some parts as a block, or what is wrong with it. Lengths are times the density factor of each part.
fn block(scene: &Scene, parts: &[usize], settings: &Settings) -> Result<Piece, String> {
    let (mut faces, mut corners, mut areas, mut worlds) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (member, p) in (0..).zip(parts) {
        let part = &scene.parts[*p];
        let (first, factor) = (part.vertices.start, f64::from(part.treatment.density));
        for (t, triangle) in scene.part_triangles(part).enumerate() {
            let [Some(a), Some(b), Some(c)] = triangle.map(|v| scene.vertex_uv(1, first + v)) else {
                return Err("the set is missing".to_owned());
            };
            let uv = [a, b, c];
            if !uv.iter().all(|p| p.is_finite()) {
                return Err(format!("triangle {t} has coordinates that are not finite"));
            }
            if !uv.iter().all(|p| p.min_element() >= -BORDER && p.max_element() <= 1.0 + BORDER) {
                return Err(format!("triangle {t} leaves the range from 0 to 1"));
            }
            let world = triangle.map(|v| scene.vertex_position(first + v).as_dvec3() * factor);
            let area = 0.5 * (world[1] - world[0]).cross(world[2] - world[0]).length();
            if area > 0.0 {
                faces.push(Face { part: member, triangle: t as u32, chart: 0 });
                corners.push(uv.map(|p| p.as_dvec2()));
                areas.push(area);
                worlds.push(world);
            }
        }
    }
    let area: f64 = areas.iter().sum();
    let Some(page) = page(&worlds, &corners) else {
        return Err("it has no area".to_owned());
    };
    corners.iter_mut().flatten().for_each(|p| *p *= page);
    let outliers: f64 =
        (0..faces.len()).filter(|i| !is_even(worlds[*i], corners[*i])).map(|i| areas[i]).fold(0.0, |a, b| a + b);
    if outliers > OUTLIERS * area {
        let percent = 100.0 * outliers / area;
        return Err(format!("{percent:.0} % of its area is stretched by more than a factor of {MAX_STRETCH}"));
    }
    if overlap::coverage(&corners, SAMPLES).overlaps() {
        return Err("triangles overlap".to_owned());
    }
    if is_mirrored_in_part(&corners) {
        return Err("some of its charts are mirrored".to_owned());
    }
    let component = connect::components(&corners);
    let mut chart_parts = Vec::new();
    for (face, chart) in faces.iter_mut().zip(component) {
        face.chart = chart;
        if chart as usize == chart_parts.len() {
            chart_parts.push(face.part);
        }
    }
    let owners = [parts.iter().map(|p| *p as u32).collect()].into();
    let piece = Piece { owners, parts: chart_parts, faces, corners, page: Some(page) };
    if settings.uv == Uv::Auto {
        check_texels(&piece, &worlds, settings)?;
    }
    Ok(piece)
}

/// Triangles of both orientations: directions stored per texel would mean different things on either.
fn is_mirrored_in_part(corners: &[[DVec2; 3]]) -> bool {
    let doubled = |c: &[DVec2; 3]| super::flatten::twice_area(*c);
    let all: f64 = corners.iter().map(|c| doubled(c).abs()).sum();
    let right: f64 = corners.iter().map(|c| doubled(c).max(0.0)).sum();
    right.min(all - right) > OUTLIERS * all
}

/// Charts must be apart at the wanted density (or at that of a whole page, if that is less), or belong together.
fn check_texels(piece: &Piece, worlds: &[[DVec3; 3]], settings: &Settings) -> Result<(), String> {
    let (low, high) = extent(piece);
    let density = f64::from(settings.texels_per_meter).min(f64::from(settings.page_size) / (high - low).max_element());
    let bits = fraction_bits(settings.page_size);
    let shape = shape(piece, density, bits);
    let mut touched = Touched::new(piece, &shape, bits);
    let sets = touched.sets.numbers();
    check_shared(piece, &sets, worlds, density)?;
    if settings.padding == 0 {
        return Ok(());
    }
    check_mixed(piece, &touched.mixed(piece, &shape, bits, &sets), density)
}

/// All but [`OUTLIERS`] of the area must lie in charts that are not `mixed`.
fn check_mixed(piece: &Piece, mixed: &[bool], density: f64) -> Result<(), String> {
    let (mut all, mut bad) = (0.0, 0.0);
    for (face, corners) in piece.faces.iter().zip(&piece.corners) {
        let area = super::flatten::twice_area(*corners).abs();
        all += area;
        bad += if mixed[face.chart as usize] { area } else { 0.0 };
    }
    if bad > OUTLIERS * all {
        let count = mixed.iter().filter(|mixed| **mixed).count();
        return Err(format!("look-ups in {count} of its charts read others at {density:.3} texels/m"));
    }
    Ok(())
}

/// Charts of one of these sets, which share texels, must belong together.
fn check_shared(piece: &Piece, sets: &[u32], worlds: &[[DVec3; 3]], density: f64) -> Result<(), String> {
    let apart = sets.iter().map(|n| n + 1).max().unwrap_or(0) as usize;
    if apart == piece.parts.len() {
        return Ok(());
    }
    let mut specks = vec![Speck::NONE; piece.parts.len()];
    piece.faces.iter().zip(worlds).for_each(|(face, world)| specks[face.chart as usize].add(*world));
    let mut members = vec![vec![]; apart];
    sets.iter().zip(specks).for_each(|(set, speck)| members[*set as usize].push(speck));
    let wrong = members.iter().filter(|set| set.len() > 1 && !belong_together(set, 1.0 / density));
    match wrong.map(|set| set.len() - 1).sum::<usize>() {
        0 => Ok(()),
        sharing => Err(format!("{sharing} of its charts share texels with others at {density:.3} texels/m")),
    }
}

/// The density of a triangle is within [`MAX_STRETCH`] in every direction.
///
/// The largest and smallest density are the singular values of the map from the surface to the plane.
fn is_even(world: [DVec3; 3], flat: [DVec2; 3]) -> bool {
    let (e1, e2) = (world[1] - world[0], world[2] - world[0]);
    let (d1, d2) = (flat[1] - flat[0], flat[2] - flat[0]);
    let length = e1.length();
    let (x2, y2) = (e2.dot(e1) / length, e1.cross(e2).length() / length);
    let dx = d1 / length;
    let dy = (d2 - dx * x2) / y2;
    let (sum, determinant) = (dx.length_squared() + dy.length_squared(), dx.perp_dot(dy).abs());
    let root = (sum * sum - 4.0 * determinant * determinant).max(0.0).sqrt();
    let largest = (0.5 * (sum + root)).sqrt();
    let smallest = determinant / largest;
    largest <= MAX_STRETCH && smallest >= 1.0 / MAX_STRETCH
}
