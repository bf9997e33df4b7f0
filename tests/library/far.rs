//! Scenes that are far from the world's origin, as maps have them: baked like their twins at the origin.

use crate::sealed::{Baked, Place, bake_glb};
use glam::{DVec3, Vec3};
use serde_json::json;
use texelwalk::base::Warning;
use texelwalk::check;
use texelwalk::inspect::inspect;
use texelwalk::settings::{Options, Preset};

const OPTIONS: &str = "texels-per-meter = 8.0\naov = [\"position\"]\nsky = [0.4, 0.5, 0.7]";

/// A crate and a wall on a floor, on a node that is moved; lights move with it.
fn bake(at: DVec3, options: &str) -> Baked {
    bake_scaled(at, 1.0, options)
}

/// The same in another size.
fn bake_scaled(at: DVec3, scale: f64, options: &str) -> Baked {
    let mut place = Place::default();
    place.sheet("floor", [-1.5, -1.2], [1.5, 1.2]);
    place.solid("crate", Vec3::new(0.1, 0.0, 0.2), Vec3::new(0.6, 0.4, 0.7));
    place.solid("wall", Vec3::new(-0.8, 0.0, -0.39), Vec3::new(0.9, 0.6, -0.38));
    let scale = [scale; 3];
    let glb = place.glb_with(|b| {
        let roots = b.json["scenes"][0]["nodes"].clone();
        let root =
            b.push("nodes", json!({"name": "map", "translation": at.to_array(), "scale": scale, "children": roots}));
        b.json["scenes"][0]["nodes"] = json!([root]);
    });
    bake_glb(&glb, options)
}

fn texels(baked: &Baked) -> &[[f32; 4]] {
    &baked.outcome.lightmap.pages[0].pixels
}

#[test]
fn a_million_metres_away_the_light_is_the_same() {
    for at in [DVec3::new(1e6, -2e5, 1e6), DVec3::new(0.0, 0.0, 6.3e6)] {
        let far = bake(at, OPTIONS);
        let offset = far.source.offset;
        assert!((offset - at).abs().max_element() < 2.0, "{offset}");
        let near = bake(at - offset, OPTIONS);
        assert_eq!(near.source.offset, DVec3::ZERO);
        assert!(texels(&near).iter().filter(|t| t[3] > 0.0 && t[1] > 0.0).count() > 500);
        assert_eq!(texels(&near), texels(&far), "{at}");
    }
}

#[test]
fn places_are_told_where_they_are_in_the_document() {
    let at = DVec3::new(2e5, 0.0, -3e5);
    let far = bake(at, OPTIONS);
    let checked = check::Baked::load(&far.path, None).unwrap();
    let report = check::check(&checked, &check::Settings::default()).unwrap().in_document(checked.scene.offset);
    let places: Vec<Vec3> = report.measures.iter().flat_map(|m| &m.places).map(|p| p.position.into()).collect();
    assert!(!places.is_empty());
    assert!(places.iter().all(|p| p.as_dvec3().distance(at) < 4.0), "{places:?}");
    // The position layer is in the document's world, too.
    let layers = far.folder.path().join("out.aov0.exr");
    let image = exr::prelude::read_first_flat_layer_from_file(layers).unwrap();
    let x = image.layer_data.channel_data.list.iter().find(|c| c.name.to_string() == "position.X").unwrap();
    let inside = x.sample_data.values_as_f32().filter(|v| *v != 0.0);
    assert!(inside.map(|v| (f64::from(v) - at.x).abs()).fold(0.0, f64::max) < 2.0);
}

/// 12 cm at 3.9 km: f32 resolves a fifteenth of a texel there.
#[test]
fn small_scenes_are_moved_from_nearer_than_large_ones() {
    let options = OPTIONS.replace("8.0", "200.0");
    let at = DVec3::new(3900.0, 0.0, 20.0);
    let far = bake_scaled(at, 0.04, &options);
    let offset = far.source.offset;
    assert!((offset - at).abs().max_element() < 2.0, "{offset}");
    let near = bake_scaled(at - offset, 0.04, &options);
    assert_eq!(near.source.offset, DVec3::ZERO);
    assert!(texels(&near).iter().filter(|t| t[3] > 0.0 && t[1] > 0.0).count() > 500);
    assert_eq!(texels(&near), texels(&far));
    // Of 3 m, and nearer than 128 times that.
    assert_eq!(bake(DVec3::new(350.0, 0.0, 0.0), OPTIONS).source.offset, DVec3::ZERO);
}

/// Two floors in one scene, so far apart.
fn apart(distance: f32) -> Vec<String> {
    let mut place = Place::default();
    for x in [-0.5 * distance, 0.5 * distance] {
        place.sheet("floor", [x - 1.0, -1.0], [x + 1.0, 1.0]);
    }
    let baked = bake_glb(&place.glb_with(|_| ()), OPTIONS);
    let options = Options::from_toml(OPTIONS).unwrap().over(Options::preset(Preset::Preview).unwrap());
    let settings = options.settings().unwrap();
    let of = |w: &Warning| w.code == "coarse-coordinates";
    let facts = inspect(&baked.folder.path().join("in.glb"), &settings).unwrap();
    let told: Vec<Warning> = baked.outcome.report.warnings.into_iter().filter(of).collect();
    assert_eq!(told, facts.warnings.into_iter().filter(of).collect::<Vec<_>>(), "bake and inspect say the same");
    told.into_iter().map(|w| w.message).collect()
}

#[test]
fn what_no_move_brings_together_is_told() {
    assert!(apart(10_000.0).is_empty());
    let told = apart(224_000.0);
    assert!(
        told.len() == 1 && told[0].contains("of 2 parts") && told[0].contains("1/16 in the worst case"),
        "{told:?}"
    );
}
