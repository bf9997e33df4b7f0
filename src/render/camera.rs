//! Where to stand: a camera of the document, or a place that is found by looking around.
//!
//! Automatic: rays near the horizon from the middle of the scene tell whether it is a space to stand in (most of them
//! meet fronts of surfaces) or a thing to walk around. In a space the candidates are its corners as far as the view
//! from the middle goes, at eye height, looking across; around a thing they are eight places on a circle, looking at
//! its centre from above. The one from which the most surface is seen, and in a space from afar, wins.

use super::Error;
use super::Shot;
use crate::scene::Camera;
use crate::scene::Projection;
use crate::trace::Ray;
use core::f32::consts::PI;
use glam::Vec3;

/// Which camera to use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum View {
    /// The document's first camera, or automatic if it has none.
    Default,
    /// A camera of the document.
    Camera(usize),
    /// Automatic.
    Auto,
    /// From one point toward another.
    Toward(Toward),
}

/// A camera that looks at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Toward {
    /// Where it stands [m].
    pub position: Vec3,
    /// What it looks at [m].
    pub target: Vec3,
    /// Vertical field of view [rad].
    pub yfov: f32,
    /// What rises above the plane through the target with this normal by more than this height [m] is cut away.
    pub cut: Option<(Vec3, f32)>,
}

/// A placed camera.
pub(super) struct Eye {
    pub(super) name: String,
    position: Vec3,
    right: Vec3,
    up: Vec3,
    forward: Vec3,
    lens: Lens,
    aspect: f32,
    /// What lies on the side of this plane that its normal points to is cut away.
    cut: Option<(Vec3, Vec3)>,
}

enum Lens {
    /// Tangent of half the vertical field of view.
    Perspective(f32),
    /// Half height [m].
    Orthographic(f32),
}

/// Vertical field of view inside a space [rad].
const YFOV_INSIDE: f32 = 1.13;

/// Vertical field of view around a thing [rad].
const YFOV_OUTSIDE: f32 = 0.61;

/// Share of rays near the horizon that must meet fronts for a space.
const ENCLOSED: f32 = 0.7;

/// Rays to look around with, and to judge a candidate with (16 × 9).
const PROBES: usize = 256;
const JUDGES: [usize; 2] = [16, 9];

pub(super) fn eye(shot: &Shot<'_>, view: View, aspect: f32) -> Result<Eye, Error> {
    let cameras = &shot.scene.cameras;
    let camera = match view {
        View::Camera(index) => {
            let camera = cameras.iter().find(|camera| camera.number == index);
            camera.ok_or(Error::NoCamera { index, count: cameras.len() })?
        }
        View::Default if !cameras.is_empty() => &cameras[0],
        View::Default | View::Auto => return Ok(auto(shot, aspect)),
        View::Toward(Toward { position, target, yfov, cut }) => {
            let cut = cut.map(|(normal, height)| (target + normal * height, normal));
            return Ok(Eye { cut, ..Eye::looking(position, target, yfov, aspect) });
        }
    };
    Ok(Eye::of(camera, aspect))
}

impl Eye {
    fn of(camera: &Camera, aspect: f32) -> Self {
        let m = camera.world_from_camera;
        let axis = |v: Vec3| m.transform_vector3(v).normalize_or_zero();
        let lens = match camera.projection {
            Projection::Perspective { yfov, .. } => Lens::Perspective(libm::tanf(yfov * 0.5)),
            Projection::Orthographic { ymag, .. } => Lens::Orthographic(ymag.abs()),
        };
        let (position, name) = (m.transform_point3(Vec3::ZERO), camera.name.clone());
        Self {
            name,
            position,
            right: axis(Vec3::X),
            up: axis(Vec3::Y),
            forward: axis(Vec3::NEG_Z),
            lens,
            aspect,
            cut: None,
        }
    }

    fn looking(position: Vec3, target: Vec3, yfov: f32, aspect: f32) -> Self {
        let forward = (target - position).try_normalize().unwrap_or(Vec3::NEG_Z);
        let right = forward.cross(Vec3::Y).try_normalize().unwrap_or(Vec3::X);
        let up = right.cross(forward);
        let lens = Lens::Perspective(libm::tanf(yfov * 0.5));
        Self { name: "auto".to_owned(), position, right, up, forward, lens, aspect, cut: None }
    }

    /// The ray through pixel `i` of a picture, at `offset` in [0, 1)² from its upper left corner.
    pub(super) fn through(&self, i: usize, [width, height]: [usize; 2], offset: [f32; 2]) -> Ray {
        let x = ((i % width) as f32 + offset[0]) / width as f32 * 2.0 - 1.0;
        let y = 1.0 - ((i / width) as f32 + offset[1]) / height as f32 * 2.0;
        let (origin, direction) = match self.lens {
            Lens::Perspective(half) => {
                (self.position, self.forward + self.right * (x * half * self.aspect) + self.up * (y * half))
            }
            Lens::Orthographic(half) => {
                (self.position + self.right * (x * half * self.aspect) + self.up * (y * half), self.forward)
            }
        };
        let direction = direction.normalize_or_zero();
        let Some((point, normal)) = self.cut else { return Ray { origin, direction, t_max: f32::INFINITY } };
        let (above, down) = ((origin - point).dot(normal), -direction.dot(normal));
        match (above > 0.0, down > 0.0) {
            (true, true) => Ray { origin: origin + direction * (above / down), direction, t_max: f32::INFINITY },
            // It stays where everything is cut away.
            (true, false) => Ray { origin, direction, t_max: 0.0 },
            (false, _) => Ray { origin, direction, t_max: f32::INFINITY },
        }
    }
}

fn auto(shot: &Shot<'_>, aspect: f32) -> Eye {
    let (low, high) = shot.tracer.bounds();
    let candidates = if enclosed(shot, low, high) { inside(shot, low, high) } else { around(low, high, aspect) };
    let reach = (high - low).length().max(f32::MIN_POSITIVE);
    let mut best: Option<(f32, Eye)> = None;
    for (position, target, yfov) in candidates {
        let eye = Eye::looking(position, target, yfov, aspect);
        let score = score(shot, &eye, reach);
        if best.as_ref().is_none_or(|(most, _)| score > *most) {
            best = Some((score, eye));
        }
    }
    best.map_or_else(|| Eye::looking(high, low, YFOV_OUTSIDE, aspect), |(_, eye)| eye)
}

/// The middle of the scene and four places around it.
fn middles(low: Vec3, high: Vec3) -> [Vec3; 5] {
    let (size, center) = (high - low, (low + high) * 0.5);
    let eye_height = low.y + size.y * 0.55;
    [[0.0, 0.0], [0.2, 0.2], [0.2, -0.2], [-0.2, 0.2], [-0.2, -0.2]]
        .map(|[x, z]| Vec3::new(center.x + x * size.x, eye_height, center.z + z * size.z))
}

/// Directions within 30° of the horizon, evenly spread.
fn belt() -> impl Iterator<Item = Vec3> {
    (0..PROBES).map(|i| {
        let y = ((i as f32 + 0.5) / PROBES as f32) - 0.5;
        // The golden angle keeps neighbours in height far apart in azimuth.
        let azimuth = i as f32 * 2.399_963_2;
        let r = (1.0 - y * y).sqrt();
        Vec3::new(r * libm::cosf(azimuth), y, r * libm::sinf(azimuth))
    })
}

fn enclosed(shot: &Shot<'_>, low: Vec3, high: Vec3) -> bool {
    let mut met = 0;
    for origin in middles(low, high) {
        for direction in belt() {
            let hit = shot.tracer.closest_hit(&Ray { origin, direction, t_max: f32::INFINITY });
            met += usize::from(hit.is_some_and(|hit| hit.front));
        }
    }
    met as f32 >= ENCLOSED * (5 * PROBES) as f32
}

/// Position, target, field of view of the candidates in a space.
fn inside(shot: &Shot<'_>, low: Vec3, high: Vec3) -> Vec<(Vec3, Vec3, f32)> {
    let mut out = Vec::new();
    for middle in middles(low, high) {
        for corner in 0..4 {
            let x = if corner & 1 == 0 { low.x } else { high.x };
            let z = if corner & 2 == 0 { low.z } else { high.z };
            let to_corner = Vec3::new(x, middle.y, z) - middle;
            let Some(direction) = to_corner.try_normalize() else { continue };
            let hit = shot.tracer.closest_hit(&Ray { origin: middle, direction, t_max: f32::INFINITY });
            let free = hit.map_or(f32::INFINITY, |hit| hit.t * 0.88).min(to_corner.length() * 0.88);
            let position = middle + direction * free;
            let mut target = middle - direction * to_corner.length() * 0.5;
            target.y = low.y + (high.y - low.y) * 0.38;
            out.push((position, target, YFOV_INSIDE));
        }
    }
    out
}

/// Position, target, field of view of the candidates around a thing.
fn around(low: Vec3, high: Vec3, aspect: f32) -> Vec<(Vec3, Vec3, f32)> {
    let (center, radius) = ((low + high) * 0.5, (high - low).length() * 0.5);
    let half_y = YFOV_OUTSIDE * 0.5;
    let half = half_y.min(libm::atanf(libm::tanf(half_y) * aspect));
    let distance = radius.max(1e-6) / libm::sinf(half);
    let place = |k: usize| {
        let azimuth = PI * (0.25 + 0.25 * k as f32 + 0.05);
        let direction = Vec3::new(libm::sinf(azimuth), 0.55, libm::cosf(azimuth)).normalize();
        (center + direction * distance, center, YFOV_OUTSIDE)
    };
    (0..8).map(place).collect()
}

/// More for more lightmapped surface, and for surface that is farther away.
fn score(shot: &Shot<'_>, eye: &Eye, reach: f32) -> f32 {
    let sees = |i: usize| {
        let ray = eye.through(i, JUDGES, [0.5, 0.5]);
        let Some(hit) = shot.first_hit(&ray) else { return 0.0 };
        let lit = shot.lightmaps.is_empty() || shot.lightmaps.texels(shot.scene, hit.triangle).is_some();
        let interest = if lit { 1.0 } else { 0.3 };
        interest * libm::logf(1.0 + 20.0 * hit.t / reach)
    };
    (0..JUDGES[0] * JUDGES[1]).map(sees).fold(0.0, |a, b| a + b)
}
