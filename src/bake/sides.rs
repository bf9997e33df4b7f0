//! Which side of double-sided surfaces the lightmap stores: the front, or the back where the front is never lit or seen.
//!
//! In: patches, and emitters of all groups. Out: patches with such charts turned, and a warning (`turned-side`) for each
//! node that has some. Only charts whose front looks into a narrow gap come into question; what light both their sides get
//! is found by a small bake without a gather, which costs nothing where there are none.
//!
//! Limits: decided by chart. A gap that some light reaches, as a drawer that is ajar, keeps its front.

use super::clock::{Clock, Stop};
use super::groups;
use super::solve::{Budget, Setup, Solver};
use crate::atlas::Atlas;
use crate::base::random::mix;
use crate::base::{Warning, color};
use crate::patches::{PatchGraph, Patches};
use crate::settings::{Directional, Settings};
use crate::trace::Tracer;
use std::collections::BTreeMap;

/// Light on the front over that on the back, below which a gap is dark.
const DARK: f64 = 0.05;
/// Part of the lines and shadow rays of the bake.
const BUDGET: f64 = 0.25;
/// Keeps the seed apart from those of the bake.
const SIDES: u64 = 0x0073_6964_6573;

/// Turns charts whose front is dark while their back is lit.
pub(super) fn turn(
    tracer: &Tracer<'_>,
    atlas: &Atlas,
    patches: &mut Patches,
    settings: &Settings,
    clock: &mut Clock<'_>,
) -> Result<Vec<Warning>, Stop> {
    if patches.front_of.is_empty() {
        return Ok(vec![]);
    }
    let narrow = clock.timed("sides", |progress| patches.narrow_charts(tracer, atlas, progress))?;
    if narrow.is_empty() {
        return Ok(vec![]);
    }
    let lit = light(tracer, patches, settings, clock)?;
    let mut sums: BTreeMap<u32, [f64; 2]> = narrow.into_iter().map(|chart| (chart, [0.0; 2])).collect();
    for (k, &front) in patches.front_of.iter().enumerate() {
        let Some(sum) = sums.get_mut(&patches.chart(front as usize)) else { continue };
        for (sum, patch) in sum.iter_mut().zip([front as usize, patches.front + k]) {
            *sum += f64::from(lit[patch] * patches.exposed_area(patch));
        }
    }
    sums.retain(|_, [front, back]| *front < DARK * *back);
    let charts = sums.into_keys().collect();
    clock.timed("turn", |progress| patches.turn(tracer, charts, progress))?;
    Ok(warnings(tracer, atlas, patches))
}

/// Mean irradiance of all patches, roughly [lx].
fn light(tracer: &Tracer<'_>, patches: &Patches, settings: &Settings, clock: &mut Clock<'_>) -> Result<Vec<f32>, Stop> {
    let graph = clock.timed("links", |progress| PatchGraph::new(patches, tracer, progress))?;
    let settings = Settings { gather: 0, directional: Directional::None, ..settings.clone() };
    let all = groups::groups(tracer.scene(), false);
    let setup = Setup { settings: &settings, tracer, patches, graph: &graph, openness: &[] };
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
            "{:.1} cm² of double-sided surface face with their front into a dark gap; the lightmap stores their back; \
             turn the faces round if that is not meant",
            1e4 * area
        );
        Warning::new("turned-side", what).at(scene.node_name(node))
    };
    areas.into_iter().map(warning).collect()
}
