//! Directions to sky and environment map.
//!
//! One ray a sample, from a mixture: by cosine, which suits what is even, and by the map's excess over its mean, which
//! finds suns and windows. Its density is exact, so either alone may fail to reach a direction.
//!
//! Source: Pharr, Jakob, Humphreys, *Physically Based Rendering*, 4th edition, §2.2.3 (one-sample balance heuristic) and
//! §12.5.3; the excess over the mean is "MIS compensation" (Karlík et al., SIGGRAPH Asia 2019). A constant map has no
//! excess, so it costs what a constant sky costs.
//!
//! Limits: the choice knows neither the horizon of a texel nor the gradient sky.

use crate::base::color::luminance;
use crate::base::distribution::Grid;
use crate::base::{Frame, Rgb, warp};
use crate::scene::{Environment, Scene};
use core::f32::consts::PI;
use glam::{Vec2, Vec3};

/// Least share of the map's light that its excess must have for it to be sampled.
const LEAST: f32 = 0.05;
/// Most of the samples that go by the map: cosine alone reaches everything.
const MOST: f32 = 0.9;

/// How to choose directions to what is infinitely far away.
#[derive(Debug, Default)]
pub(super) struct Infinity {
    grid: Grid,
    /// Share of the samples that the grid chooses.
    share: f32,
    black: bool,
}

impl Infinity {
    pub(super) fn new(scene: &Scene) -> Self {
        let black = scene.sky.is_black() && scene.environment.is_none();
        let Some(map) = &scene.environment else { return Self { black, ..Self::default() } };
        let total = luminance(map.total());
        let mean = total / (4.0 * PI);
        let [width, height] = map.size();
        let solid_angles: Vec<f32> = (0..height).map(|y| map.solid_angle(y)).collect();
        let excess = |x: usize, y: usize| (luminance(map.pixel(x, y)) - mean).max(0.0) * solid_angles[y];
        let grid = Grid::new(width, height, excess);
        let share = if total > 0.0 { grid.total() / total } else { 0.0 };
        let share = if share < LEAST { 0.0 } else { share.min(MOST) };
        Self { grid, share, black: black || (total <= 0.0 && scene.sky.is_black()) }
    }

    pub(super) fn is_black(&self) -> bool {
        self.black
    }

    /// Flux per area across a sphere's disc, for shooting: the integral of radiance over all directions [lx].
    pub(super) fn total(scene: &Scene) -> Rgb {
        let sky = &scene.sky;
        let gradient = (sky.zenith + sky.horizon) * PI + sky.ground * (2.0 * PI);
        gradient + scene.environment.as_ref().map_or(Rgb::ZERO, Environment::total)
    }

    /// A direction above a surface for `pick` in [0, 1), and its density per steradian.
    pub(super) fn above(&self, scene: &Scene, normal: Vec3, pick: f32, u: Vec2) -> (Vec3, f32) {
        let frame = Frame::from_normal(normal);
        let direction =
            self.by_map(scene, pick, u).unwrap_or_else(|| frame.to_world(warp::square_to_cosine_hemisphere(u)));
        let cosine = normal.dot(direction).max(0.0) / PI;
        (direction, (1.0 - self.share) * cosine + self.share * self.density(scene, direction))
    }

    /// A direction of the whole sphere, and its density per steradian.
    pub(super) fn anywhere(&self, scene: &Scene, pick: f32, u: Vec2) -> (Vec3, f32) {
        let direction = self.by_map(scene, pick, u).unwrap_or_else(|| warp::square_to_sphere(u));
        (direction, (1.0 - self.share) / (4.0 * PI) + self.share * self.density(scene, direction))
    }

    fn by_map(&self, scene: &Scene, pick: f32, u: Vec2) -> Option<Vec3> {
        let map = scene.environment.as_ref().filter(|_| pick < self.share)?;
        let (pixel, place) = self.grid.sample(u)?;
        Some(map.toward(pixel, place))
    }

    /// Density per steradian by which the map chooses a direction.
    pub(super) fn density(&self, scene: &Scene, toward: Vec3) -> f32 {
        let Some(map) = scene.environment.as_ref().filter(|_| self.share > 0.0) else { return 0.0 };
        let [x, y] = map.pixel_at(toward);
        self.grid.probability(x, y) / map.solid_angle(y)
    }
}
