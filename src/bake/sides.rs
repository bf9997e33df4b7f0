//! Which side of double-sided surfaces the lightmap stores: the front, or the back where the front is never lit or seen.
//!
//! In: patches, and lights where they shine from. Out: patches with such charts turned, and a warning (`turned-side`) for each
//! node that has some. Only charts come into question whose front looks into a narrow gap, into a slit, or, where nothing
//! shines from infinity, into the void; what light both their sides get is found by a small bake without a gather, which
//! costs nothing where there are none.
//!
//! Limits: decided by chart. A gap that some light reaches, as a drawer that is ajar, keeps its front. Walls with their
//! fronts outward keep them under a sky or sun, and so do those that face a yard.

use super::clock::{Clock, Stop};
use super::groups;
use super::solve::{Budget, Setup, Solver};
use crate::atlas::Atlas;
use crate::base::random::mix;
use crate::base::{Warning, color};
use crate::patches::{Before, PatchGraph, Patches};
use crate::scene::{Light, Scene};
use crate::settings::{Directional, Settings};
use crate::trace::Tracer;
use std::collections::BTreeMap;

/// Light on the front over that on the back, below which a gap or the void is dark.
const DARK: f64 = 0.05;
/// The same for slits. Texels wider than a slit lend it light from around: 15 mm below tapes, texels of 17 cm hold up to
/// a quarter of the light above.
const DIM: f64 = 0.5;
/// Part of the lines and shadow rays of the bake.
const BUDGET: f64 = 0.25;
/// Keeps the seed apart from those of the bake.
const SIDES: u64 = 0x0073_6964_6573;

/// What turning charts has found out.
#[derive(Default)]
pub(super) struct Turned {
    pub(super) warnings: Vec<Warning>,
    /// Links of the patches, if they had to be found and no chart was turned.
    pub(super) graph: Option<PatchGraph>,
}

/// Turns charts whose front is dark while their back is lit; `lights` in the place of the scene's.
pub(super) fn turn(
    tracer: &Tracer<'_>,
    lights: &[Light],
    atlas: &Atlas,
    patches: &mut Patches,
    settings: &Settings,
    clock: &mut Clock<'_>,
) -> Result<Turned, Stop> {
    if patches.front_of.is_empty() {
        return Ok(Turned::default());
    }
    let mut averted = clock.timed("sides", |progress| patches.averted_charts(tracer, atlas, progress))?;
    if shines_from_infinity(tracer.scene()) {
        averted.retain(|(_, before)| *before != Before::Void);
    }
    if averted.is_empty() {
        return Ok(Turned::default());
    }
    let graph = clock.timed("links", |progress| PatchGraph::new(patches, tracer, progress))?;
    let lit = light(tracer, lights, patches, &graph, settings, clock)?;
    let charts = dark(patches, &averted, &lit);
    if charts.is_empty() {
        return Ok(Turned { warnings: vec![], graph: Some(graph) });
    }
    clock.timed("turn", |progress| patches.turn(tracer, charts, progress))?;
    Ok(Turned { warnings: warnings(tracer, atlas, patches), graph: None })
}

/// There is an outside to look from: what faces the open is lit, or rightly in the shade.
fn shines_from_infinity(scene: &Scene) -> bool {
    let far = |light: &Light| matches!(light, Light::Sun { .. });
    !scene.sky.is_black() || scene.environment.is_some() || scene.lights.iter().any(far)
}

/// Of charts, those whose front gets little of the light that their back gets.
fn dark(patches: &Patches, averted: &[(u32, Before)], lit: &[f32]) -> Vec<u32> {
    let mut sums: BTreeMap<u32, [f64; 2]> = averted.iter().map(|&(chart, _)| (chart, [0.0; 2])).collect();
    for (k, &front) in patches.front_of.iter().enumerate() {
        let Some(sum) = sums.get_mut(&patches.chart(front as usize)) else { continue };
        for (sum, patch) in sum.iter_mut().zip([front as usize, patches.front + k]) {
            *sum += f64::from(lit[patch] * patches.exposed_area(patch));
        }
    }
    let is_dark = |&&(chart, before): &&(u32, Before)| {
        let most = if before == Before::Slit { DIM } else { DARK };
        sums.get(&chart).is_some_and(|[front, back]| *front < most * *back)
    };
    averted.iter().filter(is_dark).map(|&(chart, _)| chart).collect()
}

/// Mean irradiance of all patches, roughly [lx].
fn light(
    tracer: &Tracer<'_>,
    lights: &[Light],
    patches: &Patches,
    graph: &PatchGraph,
    settings: &Settings,
    clock: &mut Clock<'_>,
) -> Result<Vec<f32>, Stop> {
    let settings = Settings { gather: 0, directional: Directional::None, ..settings.clone() };
    let all = groups::groups(tracer.scene(), lights, false);
    let setup = Setup { settings: &settings, tracer, patches, graph, ways: None, outlook: None, openness: &[] };
    let mut solver = Solver::new(&setup, &all[0].emitters, mix(settings.seed ^ SIDES));
    solver.pass(&setup, &Budget::new(&settings, patches, BUDGET, 0), clock)?;
    Ok(solver.roughly().into_iter().map(color::mean).collect())
}

fn warnings(tracer: &Tracer<'_>, atlas: &Atlas, patches: &Patches) -> Vec<Warning> {
    let scene = tracer.scene();
    let mut areas: BTreeMap<usize, f64> = BTreeMap::new();
    for &front in &patches.front_of {
        let chart = patches.chart(front as usize);
        if patches.is_turned_chart(chart) {
            let part = &scene.parts[atlas.charts[chart as usize].part as usize];
            *areas.entry(part.node).or_default() += f64::from(patches.area[front as usize]);
        }
    }
    let warning = |(node, area)| {
        let what = format!(
            "{:.1} cm² of double-sided surface face with their front into a dark gap or the void; the lightmap stores their \
             back; turn the faces round if that is not meant",
            1e4 * area
        );
        Warning::new("turned-side", what).at(scene.node_name(node))
    };
    areas.into_iter().map(warning).collect()
}
