//! Everything that shines in a scene, sorted by how it is best looked at.
//!
//! * Suns without size, and point and spot lights without size if they are few: one look each, exact but for shadow
//!   edges.
//! * Suns with a size: a sample each.
//! * Emissive surfaces, lights with a size, and many lights: one hierarchy ([`tree`](super::tree)), a choice per
//!   sample.
//! * Sky and environment map: [`infinity`](super::infinity).

use super::bounds::Bounds;
use super::divide;
use super::infinity::Infinity;
use super::lit;
use super::openings::{COUNTED, Openings};
use super::piece::Piece;
use super::punctual;
use super::site::Site;
use super::tree::{Cut, Tree};
use super::twice;
use super::unhidden::MOST_PIECES;
use crate::base::Rgb;
use crate::base::color::luminance;
use crate::scene::{Light, Scene};
use crate::trace::Hit;
use glam::{Vec2, Vec3};

/// Point and spot lights without size up to which each is looked at.
const FEW: usize = 16;
/// Pieces and lights from which on blocks of texels look for them together.
const MANY: usize = 32;
/// Most lights that are looked at one by one; a bit each.
pub(super) const MOST_HARD: usize = 64;

/// Share of the light above which near surfaces are worth rays that look for them.
const CLOSE: f32 = 1.0 / 16.0;

/// The light sources of a scene.
#[derive(Debug, Default)]
pub struct Emitters {
    pieces: Vec<Piece>,
    /// They are few and glow evenly, so that what all of them bring has a closed form.
    even: bool,
    /// Number of emissive triangles.
    triangles: usize,
    /// Point and spot lights in the tree; their leaves follow those of the pieces.
    bulbs: Vec<Light>,
    tree: Tree,
    /// Lights that are looked at one by one.
    pub(super) hard: Vec<Light>,
    /// Suns that are sampled.
    pub(super) suns: Vec<Light>,
    pub(super) infinity: Infinity,
    /// All lights, as the scene has them.
    pub(super) lights: Vec<Light>,
}

/// Something that may shine, by what a document calls it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Index into `Scene::lights`.
    Light(usize),
    /// Surfaces that glow, by index into `Scene::parts`.
    Part(usize),
    /// Sky and environment.
    Infinity,
}

/// A leaf of the tree.
#[derive(Debug, Clone, Copy)]
pub(super) enum Leaf<'a> {
    Piece(&'a Piece),
    Bulb(&'a Light),
}

impl Emitters {
    /// Collects what shines.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        Self::of(scene, &scene.lights, |_| true)
    }

    /// Collects what shines and is kept, `lights` in the place of the scene's.
    #[must_use]
    pub fn of(scene: &Scene, lights: &[Light], keep: impl Fn(Source) -> bool) -> Self {
        let glowing = |p: usize| scene.glows(&scene.parts[p]) && keep(Source::Part(p));
        let glowing: Vec<bool> = (0..scene.parts.len()).map(glowing).collect();
        let glows = |t: &u32| glowing[scene.part_index(*t)];
        let kept = |(i, light): (usize, &Light)| keep(Source::Light(i)).then(|| light.clone());
        let lights: Vec<Light> = lights.iter().enumerate().filter_map(kept).collect();
        let all = (0..scene.triangle_count() as u32).filter(|t| scene.glows(scene.part(*t)));
        let emissive: Vec<u32> = twice::once(scene, all).into_iter().filter(glows).collect();
        let pieces = divide::pieces(scene, &emissive);
        let mut triangles: Vec<u32> = pieces.iter().map(|p| p.triangle).collect();
        triangles.dedup();

        let lit = |l: &&Light| punctual::power(l).max_element() > 0.0;
        let is_sun = |l: &&Light| matches!(l, Light::Sun { .. });
        let (suns, finite): (Vec<&Light>, Vec<&Light>) = lights.iter().filter(lit).partition(is_sun);
        let (soft_suns, hard_suns): (Vec<&Light>, Vec<&Light>) = suns.into_iter().partition(|l| punctual::is_soft(l));
        let few = finite.iter().filter(|l| !punctual::is_soft(l)).count() <= FEW;
        let (hard, bulbs): (Vec<&Light>, Vec<&Light>) = finite.into_iter().partition(|l| few && !punctual::is_soft(l));
        let mut hard: Vec<Light> = hard.into_iter().chain(hard_suns).cloned().collect();
        let beyond = hard.split_off(hard.len().min(MOST_HARD));
        let bulbs: Vec<Light> = bulbs.into_iter().cloned().collect();
        let bounds: Vec<Bounds> =
            pieces.iter().map(piece_bounds).chain(bulbs.iter().filter_map(punctual::bounds)).collect();
        let is_even = |p: &Piece| p.solid && scene.material(p.triangle).emission_texture.is_none();
        Self {
            triangles: triangles.len(),
            even: pieces.len() <= MOST_PIECES && pieces.iter().all(is_even),
            tree: Tree::new(&bounds),
            suns: soft_suns.into_iter().cloned().chain(beyond).collect(),
            infinity: if keep(Source::Infinity) { Infinity::new(scene) } else { Infinity::none() },
            pieces,
            bulbs,
            hard,
            lights,
        }
    }

    /// Nothing glows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// The pieces, if they are few and glow evenly.
    pub(super) fn even_pieces(&self) -> &[Piece] {
        if self.even { &self.pieces } else { &[] }
    }

    /// Number of emissive triangles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.triangles
    }

    /// Flux of all emissive surfaces [lm].
    #[must_use]
    pub fn flux(&self) -> Rgb {
        self.pieces.iter().map(Piece::flux).fold(Rgb::ZERO, |a, b| a + b)
    }

    /// Radiance of the sky in a unit direction that the final gather adds at a surface with this normal, where its patch has
    /// these openings and `rays` rays for each sample of [`direct`](super::direct); what is left is [`Direct`](super::Direct)'s
    /// [cd/m²].
    #[must_use]
    pub fn gathered_sky(
        &self,
        scene: &Scene,
        (openings, patch): (&Openings, usize),
        normal: Vec3,
        direction: Vec3,
        rays: f32,
    ) -> Rgb {
        let density = self.infinity.density_above(scene, normal, openings.sky(patch), direction, COUNTED);
        scene.light_from_infinity(direction) * lit::gathered(normal.dot(direction), density, rays)
    }

    /// Something shines from infinity.
    #[must_use]
    pub fn has_sky(&self) -> bool {
        !self.infinity.is_black()
    }

    /// Something shines from a finite distance.
    pub(super) fn any_finite(&self) -> bool {
        self.has_finite() || self.hard.iter().any(|l| !matches!(l, Light::Sun { .. }))
    }

    /// There is something to choose from.
    pub(super) fn has_finite(&self) -> bool {
        !self.tree.is_empty()
    }

    /// So many that finding the nodes to choose from takes longer than weighing them.
    pub(super) fn are_many(&self) -> bool {
        self.pieces.len() + self.bulbs.len() >= MANY
    }

    fn leaf(&self, k: u32) -> Leaf<'_> {
        let k = k as usize;
        self.pieces.get(k).map_or_else(|| Leaf::Bulb(&self.bulbs[k - self.pieces.len()]), Leaf::Piece)
    }

    fn estimate(&self, k: u32, site: &Site) -> f32 {
        match self.leaf(k) {
            Leaf::Piece(piece) => piece.estimate(site),
            Leaf::Bulb(light) => punctual::estimate(light, site),
        }
    }

    /// The nodes to choose from at a site.
    pub(super) fn cut(&self, site: &Site) -> Cut {
        let mut cut = self.tree.cut(site, |k, site| self.estimate(k, site));
        let solid = |k: u32| self.pieces.get(k as usize).is_some_and(|piece| piece.solid);
        cut.is_close = !self.pieces.is_empty() && self.tree.near_share(&cut, solid) > CLOSE;
        cut
    }

    /// The same with nodes that were found for a block of texels around it, all of them far.
    pub(super) fn refitted(&self, nodes: &[u32], site: &Site) -> Cut {
        self.tree.refitted(nodes, site, |k, site| self.estimate(k, site))
    }

    /// Weighs what is near for one point of the texel.
    pub(super) fn weigh(&self, cut: &mut Cut, point: &Site) {
        self.tree.weigh(cut, point, |k, site| self.estimate(k, site));
    }

    /// A leaf for `pick` in [0, 1), and its probability.
    pub(super) fn pick(&self, cut: &Cut, point: &Site, pick: f64) -> Option<(Leaf<'_>, f32)> {
        let (k, probability) = self.tree.pick(cut, point, |k, site| self.estimate(k, site), pick)?;
        Some((self.leaf(k), probability))
    }

    /// The pieces of a triangle, with their numbers.
    fn pieces_of(&self, triangle: u32) -> impl Iterator<Item = (usize, &Piece)> {
        let first = self.pieces.partition_point(|p| p.triangle < triangle);
        (first..).zip(self.pieces[first..].iter().take_while(move |p| p.triangle == triangle))
    }

    /// What a ray in a unit direction finds where it meets something solid that glows [cd/m²].
    pub(super) fn glow(&self, scene: &Scene, direction: Vec3, hit: &Hit) -> Rgb {
        let piece = self.pieces_of(hit.triangle).next().filter(|(_, piece)| piece.solid);
        piece.map_or(Rgb::ZERO, |(_, piece)| piece.toward(scene, direction, hit.b))
    }

    /// What a ray in a unit direction from a point finds where it meets something solid that glows [cd/m²], and the density
    /// per steradian with which [`Emitters::pick`] and [`Piece::sample`] choose that direction; `None` where nothing glows.
    pub(super) fn met(&self, scene: &Scene, cut: &Cut, point: &Site, direction: Vec3, hit: &Hit) -> Option<(Rgb, f32)> {
        let own = self.pieces_of(hit.triangle);
        let (k, piece) = own.max_by(|x, y| x.1.depth(hit.b).total_cmp(&y.1.depth(hit.b)))?;
        let probability = self.tree.probability(cut, point, |k, site| self.estimate(k, site), k as u32);
        let (radiance, solid_angle) = piece.seen(scene, point.position, direction, hit.b);
        piece.solid.then(|| (radiance, probability / solid_angle.max(f32::MIN_POSITIVE)))
    }

    /// Point, normal and flux for a line that leaves a surface, by flux in `pick`; the flux is that over its density.
    pub(super) fn leave(&self, scene: &Scene, running: &[f64], pick: f64, u: Vec2) -> Option<(u32, Vec2, Vec3, Rgb)> {
        let total = *running.last()?;
        let target = pick * total;
        let k = running.partition_point(|&s| s <= target).min(running.len() - 1);
        let low = if k == 0 { 0.0 } else { running[k - 1] };
        let (piece, own) = (&self.pieces[k], running[k] - low);
        let back = piece.two_sided && target - low > 0.5 * own;
        let (b, flux) = piece.leave(scene, u);
        let flux = flux.as_dvec3() * (total / own.max(f64::MIN_POSITIVE));
        Some((piece.triangle, b, if back { -piece.normal } else { piece.normal }, flux.as_vec3()))
    }

    /// Running sum of what the pieces are chosen by.
    pub(super) fn running_flux(&self) -> Vec<f64> {
        let mut sum = 0.0;
        let add = |p: &Piece| {
            sum += p.weight();
            sum
        };
        self.pieces.iter().map(add).collect()
    }
}

fn piece_bounds(piece: &Piece) -> Bounds {
    let [a, b, c] = piece.corners;
    Bounds {
        low: a.min(b).min(c),
        high: a.max(b).max(c),
        axis: piece.normal,
        cos_o: 1.0,
        cos_e: 0.0,
        two_sided: piece.two_sided,
        power: luminance(piece.radiance) * piece.area,
        range: f32::INFINITY,
    }
}
