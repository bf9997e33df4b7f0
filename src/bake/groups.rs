//! Light groups: the emitters of a scene, sorted by the name that the document gives them.
//!
//! In: the scene, and its lights where they shine from. Out: one set of emitters per group, in the order of their names;
//! without groups, all in one. Lights and surfaces without a name are in `default`, sky and environment in `sky`.

use crate::light::{Emitters, Source};
use crate::scene::{Light, Scene};
use std::collections::BTreeSet;

const UNNAMED: &str = "default";
const SKY: &str = "sky";

/// Emitters that are solved together.
pub(super) struct Group {
    pub(super) name: String,
    pub(super) emitters: Emitters,
}

/// The groups of a scene that shine; everything in one group if they are not wanted.
pub(super) fn groups(scene: &Scene, lights: &[Light], wanted: bool) -> Vec<Group> {
    if !wanted {
        return vec![Group { name: String::new(), emitters: Emitters::of(scene, lights, |_| true) }];
    }
    let group = |name: &str| {
        let emitters = Emitters::of(scene, lights, |source| name_of(scene, source) == name);
        Group { name: name.to_owned(), emitters }
    };
    names(scene).into_iter().map(group).collect()
}

fn name_of(scene: &Scene, source: Source) -> &str {
    let named = match source {
        Source::Light(i) => scene.groups.lights.get(i),
        Source::Part(i) => scene.groups.parts.get(i),
        Source::Infinity => return SKY,
    };
    named.and_then(|n| n.as_deref()).unwrap_or(UNNAMED)
}

/// Groups that something shines in; never empty.
fn names(scene: &Scene) -> BTreeSet<&str> {
    let lights = (0..scene.lights.len()).map(Source::Light);
    let parts = (0..scene.parts.len()).filter(|&p| scene.glows(&scene.parts[p])).map(Source::Part);
    let infinite = !scene.sky.is_black() || scene.environment.is_some();
    let sources = lights.chain(parts).chain(infinite.then_some(Source::Infinity));
    let mut names: BTreeSet<&str> = sources.map(|source| name_of(scene, source)).collect();
    if names.is_empty() {
        names.insert(UNNAMED);
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Rgb;
    use crate::scene::{Groups, Sky};
    use glam::Vec3;

    #[test]
    fn groups_go_by_name_and_the_rest_has_one() {
        let bulb =
            |x: f32| Light::Point { position: Vec3::splat(x), intensity: Rgb::ONE, range: f32::INFINITY, radius: 0.0 };
        let scene = Scene {
            lights: vec![bulb(0.0), bulb(1.0), bulb(2.0)],
            groups: Groups { lights: vec![Some("key".into()), None, Some("key".into())], parts: vec![] },
            sky: Sky::constant(Rgb::ONE),
            ..Scene::default()
        };
        let found = groups(&scene, &scene.lights, true);
        assert_eq!(found.iter().map(|g| g.name.as_str()).collect::<Vec<_>>(), ["default", "key", "sky"]);
        assert_eq!(groups(&scene, &scene.lights, false).len(), 1);
        assert_eq!(groups(&Scene::default(), &[], true)[0].name, "default");
    }
}
