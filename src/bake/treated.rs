//! What rules and `extras` did: for the report, and where the settings cannot give what they ask for.

use crate::base::Warning;
use crate::output::report;
use crate::scene::{Instances, Scene, Treatment};
use crate::settings::{DirectMode, Settings};

/// Primitives that are not treated as usual, in the order of the scene.
pub(super) fn facts(scene: &Scene) -> Vec<report::Treated> {
    let group = |p: usize| scene.groups.parts.get(p).cloned().flatten();
    let usual = |p: usize| Treatment { instances: Instances::default(), ..scene.parts[p].treatment };
    let told = |&p: &usize| usual(p) != Treatment::default() || group(p).is_some();
    let fact = |p: usize| {
        let part = &scene.parts[p];
        let Treatment { density, receives, casts, emission, .. } = part.treatment;
        let mesh = [part.mesh, part.primitive];
        report::Treated { node: part.name.clone(), mesh, density, receives, casts, emission, light_group: group(p) }
    };
    (0..scene.parts.len()).filter(told).map(fact).collect()
}

/// What casts no light is met by no line, so gather rays are all that finds reflected light for it, and without shadow
/// rays it has no direct light either.
pub(super) fn warning(scene: &Scene, settings: &Settings) -> Option<Warning> {
    let unseen = || scene.parts.iter().filter(|part| part.receives && !part.treatment.casts);
    let missing = match (settings.direct, settings.gather) {
        (DirectMode::Shoot, 0) => "any light; use --direct gather and --gather",
        (DirectMode::Shoot, _) => "direct light; use --direct gather",
        (DirectMode::Gather, 0) => "reflected light; use --gather",
        (DirectMode::Gather, _) => return None,
    };
    let first = unseen().next()?;
    let what = format!(
        "{} primitive(s) that cast no light, first of all of node {}, do not get {missing}: no line of the walk meets them",
        unseen().count(),
        first.name
    );
    Some(Warning::new("unseen-receiver", what).at(&first.name))
}
