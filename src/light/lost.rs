//! Lights that light nothing but what closes them in: a lamp within its bulb, a sun outside of a dome that stands for the sky.
//!
//! In: tracer, and the lights where they shine from. Out: a warning (`lost-light`) for each.
//!
//! Punctual lights have no surface, so they are put where the lamp is that they stand for, often into its bulb. Renderers
//! without shadows do not mind; baked, the room stays dark, and if others light it nobody knows why. Rays in the directions
//! in which a light shines, or from all over the scene's outline against a sun, tell: if all of them end nearby, or all that
//! meet anything meet backs of single-sided surfaces, it is lost.
//!
//! Limits: a sample. A hole through which less than one ray in a few hundred finds may be overlooked, as a window far away
//! may be that is all that a sun shines through. Of lit shells as of a bulb nothing is said beyond 60 cm, whatever is around:
//! it may be a cellar.

use super::punctual;
use crate::base::{Frame, Warning, parallel, warp};
use crate::scene::{Light, Scene};
use crate::trace::{Ray, Tracer};
use glam::{Vec2, Vec3};
use std::collections::BTreeMap;

/// Rays of a lamp, and of a sun.
const RAYS: u32 = 256;
const FAR_RAYS: u32 = 1024;
/// Farthest that the rays of a lamp get which is closed in, as a share of the scene's diagonal: a room of 8 m has bulbs and
/// shades of up to 40 cm.
const NEAR: f32 = 0.05;
/// The most of that [m]: a cellar of 4 m below a terrain of 60 m is no bulb.
const MOST_NEAR: f32 = 0.6;
/// One in so many rays must meet something, or it says nothing that none meets a front.
const ONE_OF: u32 = 8;

/// What the rays of a light met.
#[derive(Default)]
struct Met {
    rays: u32,
    /// Rays that met something, by the node that they met first.
    nodes: BTreeMap<usize, u32>,
    /// Rays that lit something.
    lit: u32,
    /// Longest way of them [m].
    reach: f32,
}

/// Warns of punctual lights that light nothing, or only what is close around them. Of sky and environment nothing is said:
/// builds give the same to all scenes, closed rooms included.
#[must_use]
pub fn lost(tracer: &Tracer<'_>, lights: &[Light]) -> Vec<Warning> {
    let scene = tracer.scene();
    let met = parallel::map(lights.len(), |k| Met::of(tracer, &lights[k]));
    let name = |k: usize| {
        let node = scene.light_nodes.get(k).map(|node| scene.document.root.node_name(*node));
        node.unwrap_or_else(|| format!("light {k}"))
    };
    let warning = |(k, met): (usize, Met)| {
        let far = matches!(lights[k], Light::Sun { .. });
        met.fault(tracer, &format!("the light of node {}", name(k)), far).map(|fault| fault.at(name(k)))
    };
    met.into_iter().enumerate().filter_map(warning).collect()
}

impl Met {
    fn of(tracer: &Tracer<'_>, light: &Light) -> Self {
        let mut met = Self::default();
        if punctual::power(light).max_element() <= 0.0 {
            return met;
        }
        let lamp = |met: &mut Self, [at, toward]: [Vec3; 2], [radius, range]: [f32; 2]| {
            let (origin, t_max) = (at + toward * radius, (range - radius).max(f32::MIN_POSITIVE));
            met.add(tracer, &Ray { origin, direction: toward, t_max });
        };
        match *light {
            Light::Sun { direction, .. } => {
                points(FAR_RAYS).for_each(|u| met.add(tracer, &inward(tracer, direction, u)));
            }
            Light::Point { position, range, radius, .. } => {
                points(RAYS).for_each(|u| lamp(&mut met, [position, warp::square_to_sphere(u)], [radius, range]));
            }
            Light::Spot { position, direction, range, radius, cos_outer, .. } => points(RAYS).for_each(|u| {
                let toward = Frame::from_normal(direction).to_world(warp::square_to_cone(u, cos_outer));
                lamp(&mut met, [position, toward], [radius, range]);
            }),
            Light::Profiled { position, axes, range, radius, ref profile, .. } => {
                let toward = points(RAYS).map(warp::square_to_sphere);
                let shines = toward.filter(|toward| profile.candela(axes.transpose() * *toward) > 0.0);
                shines.for_each(|toward| lamp(&mut met, [position, toward], [radius, range]));
            }
        }
        met
    }

    fn add(&mut self, tracer: &Tracer<'_>, ray: &Ray) {
        self.rays += 1;
        let Some(hit) = tracer.closest_hit(ray) else { return };
        let part = tracer.scene().part(hit.triangle);
        *self.nodes.entry(part.node).or_default() += 1;
        self.lit += u32::from(hit.front || tracer.scene().materials[part.material].is_two_sided());
        self.reach = self.reach.max(hit.t);
    }

    fn fault(&self, tracer: &Tracer<'_>, what: &str, far: bool) -> Option<Warning> {
        let scene = tracer.scene();
        let met: u32 = self.nodes.values().sum();
        let most = self.nodes.iter().max_by_key(|(node, rays)| (**rays, core::cmp::Reverse(**node)));
        let around = scene.document.root.node_name(*most?.0);
        let advice = "let that cast no light (casts = false in a rule or in extras)";
        let (low, high) = tracer.bounds();
        let message = if !far && met == self.rays && self.reach < (NEAR * low.distance(high)).min(MOST_NEAR) {
            format!(
                "{what} is closed in by {around} and gets no farther than {:.2} m; {advice}, or move it out",
                self.reach
            )
        } else if self.lit == 0 && met * ONE_OF >= self.rays && all_cast(scene) {
            format!(
                "{what} lights next to nothing: its rays meet the backs of single-sided surfaces, most of them of {around}; \
                 {advice}, or move or turn what is wrong"
            )
        } else {
            return None;
        };
        Some(Warning::new("lost-light", message))
    }
}

/// What is lit blocks rays, so they can meet it.
fn all_cast(scene: &Scene) -> bool {
    scene.parts.iter().all(|part| part.treatment.casts || !part.receives)
}

/// Points of the unit square, evenly distributed.
fn points(n: u32) -> impl Iterator<Item = Vec2> {
    (0..n).map(move |k| Vec2::new((k as f32 + 0.5) / n as f32, (k as f32 * 0.618_034).fract()))
}

/// A ray of parallel light through the ball around the scene; `u` picks where.
fn inward(tracer: &Tracer<'_>, direction: Vec3, u: Vec2) -> Ray {
    let (low, high) = tracer.bounds();
    let (middle, radius) = ((low + high) * 0.5, 0.5 * low.distance(high));
    let at = warp::square_to_disk(u) * radius;
    let frame = Frame::from_normal(direction);
    let origin = middle + frame.s * at.x + frame.t * at.y - direction * (1.5 * radius);
    Ray { origin, direction, t_max: f32::INFINITY }
}
