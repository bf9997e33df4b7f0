//! Pages without any light although light reaches them.
//!
//! In: [`Subject`]. Out: sentences. If nothing on any page is lit, that is a fault whatever the scene has: nobody keeps a
//! lightmap for it. Beside lit pages, a black one may hold a sealed cellar and be right. So points on its surface look for
//! light: at the punctual lights of the document, and by rays into the open for what glows or shows light of another page and
//! reflects it. If enough of them find some, the page should not be black.
//!
//! Limits: skies are no part of a document, so what they alone light is not missed.

use super::subject::Subject;
use crate::base::low_discrepancy::Sequence;
use crate::base::{Frame, parallel, warp};
use crate::patches::SurfacePoint;
use crate::scene::Light;
use crate::trace::{Ground, Ray};
use glam::{Vec2, Vec3};

/// Texels of a page that look for light, and rays of each.
const TEXELS: usize = 512;
const RAYS: u32 = 16;

/// One in so many must find light.
const ONE_OF: usize = 8;

/// What is wrong with black pages.
pub(super) fn faults(subject: &Subject<'_>) -> Vec<String> {
    let patches = &subject.patches;
    let mut texels: Vec<Vec<usize>> = vec![vec![]; subject.lightmaps.pages().len()];
    let mut lit = vec![false; texels.len()];
    for i in (0..patches.front).filter(|&i| patches.exposed[i] > 0.0) {
        let page = patches.page(i) as usize;
        texels[page].push(i);
        lit[page] |= subject.light(i).max_element() > 0.0;
    }
    let black = (0..texels.len()).filter(|&page| !lit[page] && !texels[page].is_empty());
    if !lit.contains(&true) {
        return black.map(|page| format!("page {page} is black throughout, as is all of the lightmap")).collect();
    }
    let reached = |page: &usize| {
        let texels = &texels[*page];
        let step = texels.len().div_ceil(TEXELS);
        let count = texels.len().div_ceil(step);
        let found = parallel::map(count, |k| sees_light(subject, texels[k * step]));
        found.into_iter().filter(|found| *found).count() * ONE_OF >= count
    };
    let sentence = |page| format!("page {page} is black throughout, though light of the scene reaches its surface");
    black.filter(reached).map(sentence).collect()
}

/// Light arrives at the front of a texel.
fn sees_light(subject: &Subject<'_>, texel: usize) -> bool {
    let point = subject.middle(texel);
    let (tracer, scene) = (subject.tracer, subject.scene);
    let ground = Ground::new(scene.corners(point.triangle));
    let normal = ground.normal();
    let lamp = |light: &Light| {
        let toward = toward(light, scene.position(point.triangle, point.b));
        toward.is_some_and(|(direction, t_max)| {
            let origin = tracer.leave(&ground, point.b, direction);
            direction.dot(normal) > 0.0 && !tracer.occluded(&Ray { origin, direction, t_max })
        })
    };
    let (frame, sequence) = (Frame::from_normal(normal), Sequence::new(texel as u64));
    let ray = |k: u32| {
        let [u, v, ..] = sequence.point(k);
        let direction = frame.to_world(warp::square_to_cosine_hemisphere(Vec2::new(u, v)));
        let origin = tracer.leave(&ground, point.b, direction);
        let hit = tracer.closest_hit(&Ray { origin, direction, t_max: f32::INFINITY });
        hit.is_some_and(|hit| {
            let seen = hit.front || scene.material(hit.triangle).is_two_sided();
            seen && shines(subject, SurfacePoint { triangle: hit.triangle, b: hit.b })
        })
    };
    scene.lights.iter().any(lamp) || (0..RAYS).any(ray)
}

/// A place glows, or reflects light that its lightmap has.
fn shines(subject: &Subject<'_>, SurfacePoint { triangle, b }: SurfacePoint) -> bool {
    let scene = subject.scene;
    let light = subject.lightmaps.irradiance(scene, triangle, b).map_or(0.0, |light| light.max_element());
    scene.emission(triangle, b).max_element() > 0.0 || light * scene.reflectance(triangle, b).max_element() > 0.0
}

/// Direction from a place to a light that shines there, and how far away it is [m].
fn toward(light: &Light, place: Vec3) -> Option<(Vec3, f32)> {
    let near = |position: Vec3, range: f32, radius: f32| {
        let way = position - place;
        let distance = way.length();
        (distance > radius && distance < range).then(|| (way / distance, distance - radius))
    };
    match *light {
        Light::Sun { direction, illuminance, .. } => {
            (illuminance.max_element() > 0.0).then_some((-direction, f32::INFINITY))
        }
        Light::Point { position, intensity, range, radius } => {
            near(position, range, radius).filter(|_| intensity.max_element() > 0.0)
        }
        Light::Spot { position, direction, intensity, range, radius, cos_outer, .. } => near(position, range, radius)
            .filter(|(way, _)| intensity.max_element() > 0.0 && direction.dot(-*way) > cos_outer),
        Light::Profiled { position, axes, factor, range, radius, ref profile } => near(position, range, radius)
            .filter(|(way, _)| factor.max_element() > 0.0 && profile.candela(axes.transpose() * -*way) > 0.0),
    }
}
