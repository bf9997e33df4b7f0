//! Triangles cut along contacts: the surface stays what it was, nothing comes apart, and it is the same every time.

use crate::sealed::{Place, bake_glb};
use crate::solve;
use glam::{Vec2, Vec3};
use std::collections::BTreeMap;
use texelwalk::atlas::{self, NO_CHART};
use texelwalk::base::Progress;
use texelwalk::contacts::{self, Settings};
use texelwalk::patches::Patches;
use texelwalk::scene::Scene;
use texelwalk::trace::{Ray, Tracer};

const SETTINGS: Settings = Settings { texels_per_meter: 16.0, keep_uv: false };

fn area(scene: &Scene, part: usize) -> f64 {
    scene.parts[part].triangles.clone().map(|t| scene.area(t)).sum()
}

/// Length of the edges of a part that an odd number of its triangles have: its border, and any crack.
fn open_edges(scene: &Scene, part: usize) -> f64 {
    let mut edges: BTreeMap<[[u32; 3]; 2], (u32, f64)> = BTreeMap::new();
    for t in scene.parts[part].triangles.clone() {
        let corners = scene.corners(t);
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let bits = [a, b].map(|p| p.to_array().map(|x| (x + 0.0).to_bits()));
            let edge = edges.entry([bits[0].min(bits[1]), bits[0].max(bits[1])]).or_insert((0, 0.0));
            edge.0 += 1;
            edge.1 = f64::from(a.distance(b));
        }
    }
    edges.values().filter(|(count, _)| count % 2 == 1).map(|(_, length)| length).sum()
}

#[test]
fn area_is_kept_and_no_cracks_open() {
    for (name, least) in [("office/office.glb", 50), ("courtyard/courtyard.gltf", 20), ("two-rooms/two-rooms.glb", 10)]
    {
        let (before, after) = (solve::load(name), contacts::cut(solve::load(name), &SETTINGS));
        assert!(after.cuts.cut >= least, "{name}: {:?}", after.cuts.cut);
        assert_eq!(after.triangles.len() as u64, before.triangles.len() as u64 - after.cuts.cut + after.cuts.made);
        for p in 0..before.parts.len() {
            let (old, new) = (area(&before, p), area(&after, p));
            assert!((new - old).abs() <= 2e-5 * old, "{name}, {}: {old} m² became {new}", before.parts[p].name);
            let (old, new) = (open_edges(&before, p), open_edges(&after, p));
            assert!((new - old).abs() <= 1e-4 * (1.0 + old), "{name}, {}: {old} m became {new}", before.parts[p].name);
        }
        for t in 0..after.triangles.len() as u32 {
            assert!(after.area(t) > 0.0, "{name}: triangle {t} has no area");
        }
    }
}

/// Twice the area over the longest side [m].
fn height(scene: &Scene, triangle: u32) -> f64 {
    let [a, b, c] = scene.corners(triangle).map(|p| p.as_dvec3());
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    2.0 * scene.area(triangle) / longest
}

#[test]
fn lines_that_cross_a_diagonal_or_touch_a_corner_make_no_needles() {
    for name in ["office/office.glb", "courtyard/courtyard.gltf", "two-rooms/two-rooms.glb", "chairs/chairs.glb"] {
        let after = contacts::cut(solve::load(name), &SETTINGS);
        let thin = (0..after.triangles.len() as u32).map(|t| height(&after, t)).filter(|height| *height < 1e-4);
        assert_eq!(thin.count(), 0, "{name}");
    }
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let cut = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| contacts::cut(solve::load("office/office.glb"), &SETTINGS))
    };
    let (a, b) = (cut(1), cut(3));
    assert_eq!(a.triangles, b.triangles);
    assert_eq!(a.vertices.position, b.vertices.position);
    assert_eq!((a.cuts.origins, a.cuts.borders), (b.cuts.origins, b.cuts.borders));
}

/// A floor with things on it that stand, cross and lie face to face.
fn furnished() -> Place {
    let mut place = Place::default();
    place.sheet("floor", [-2.0, -1.5], [2.0, 1.5]);
    place.solid("wall", Vec3::new(-1.0, 0.0, 0.2), Vec3::new(1.1, 0.8, 0.21));
    place.solid("post", Vec3::new(-1.5, -0.3, -0.9), Vec3::new(-1.46, 0.5, -0.86));
    place.solid("crate", Vec3::new(0.3, 0.0, -1.0), Vec3::new(0.9, 0.5, -0.4));
    place.solid("lid", Vec3::new(0.2, 0.5, -1.1), Vec3::new(1.0, 0.55, -0.3));
    place.solid("far away", Vec3::new(1.6, 0.3, 1.0), Vec3::new(1.8, 0.5, 1.2));
    place
}

#[test]
fn the_written_document_shows_the_same_surface() {
    let baked = furnished().bake("texels-per-meter = 8.0\ngather = 2\nlines-per-texel = 1\ncut-contacts = true");
    let (before, after) = (&baked.source, &baked.scene);
    let contacts = baked.outcome.report.contacts.unwrap();
    assert!(contacts.triangles_cut >= 6 && contacts.lines_continued >= 1, "{contacts:?}");
    for p in 0..before.parts.len() {
        assert!((area(before, p) - area(after, p)).abs() < 1e-5, "{}", before.parts[p].name);
        assert!((open_edges(before, p) - open_edges(after, p)).abs() < 1e-4, "{}", before.parts[p].name);
        let same = before.parts[p].triangles.len() == after.parts[p].triangles.len();
        assert!(same || before.parts[p].name != "far away", "nothing touches it");
    }
    let (old, new) = (Tracer::new(before), Tracer::new(after));
    for k in 0..400 {
        let at = Vec2::new((k as f32 * 0.618_034).fract() - 0.5, (k as f32 * 0.754_878).fract() - 0.5);
        let ray = Ray { origin: Vec3::new(3.9 * at.x, 2.0, 2.9 * at.y), direction: Vec3::NEG_Y, t_max: 9.0 };
        let (a, b) = (old.closest_hit(&ray).unwrap(), new.closest_hit(&ray).unwrap());
        assert_eq!(before.part(a.triangle).name, after.part(b.triangle).name);
        assert!((a.t - b.t).abs() < 1e-5);
        assert!(after.shading_normal(b.triangle, b.b).dot(before.shading_normal(a.triangle, a.b)) > 0.999_99);
    }
}

#[test]
fn attributes_are_interpolated() {
    // Vertex colours that run over a floor, and the foot of a wall on it.
    let mut scene = solve::load("courtyard/courtyard.gltf");
    for v in 0..scene.vertices.position.len() {
        let p = scene.vertices.position[v];
        scene.vertices.color[v] = (p * 0.1 + 0.5).extend(1.0);
    }
    let scene = contacts::cut(scene, &SETTINGS);
    let mut added = 0;
    for (p, part) in scene.parts.iter().enumerate() {
        let Some(origins) = scene.cuts.origins_of(p) else { continue };
        assert_eq!(origins.len(), part.vertices.len());
        for (v, origin) in part.vertices.clone().zip(origins).filter(|(_, o)| !o.is_source()) {
            let (place, color) = (scene.vertices.position[v as usize], scene.vertices.color[v as usize]);
            assert!((place * 0.1 + 0.5 - color.truncate()).abs().max_element() < 1e-5, "{place} {color}");
            assert_eq!(origin.weight.iter().sum::<f32>(), 1.0);
            added += 1;
        }
    }
    assert!(added > 50, "{added}");
}

#[test]
fn the_sides_of_a_wall_and_what_lies_under_it_have_charts_of_their_own() {
    let mut place = Place::default();
    place.sheet("floor", [-2.0, -1.5], [2.0, 1.5]);
    place.solid("wall", Vec3::new(-1.0, 0.0, 0.2), Vec3::new(1.1, 0.8, 0.21));
    let baked = place.bake("texels-per-meter = 16.0\ngather = 2\nlines-per-texel = 1");
    let scene = contacts::cut(baked.source, &SETTINGS);
    let tracer = Tracer::new(&scene);
    let atlas = atlas::build(&Tracer::new(&scene), &atlas::Settings::default()).unwrap().output;
    let chart = |x: f32, z: f32| {
        let part = scene.parts.iter().position(|p| p.name == "floor").unwrap();
        let range = scene.parts[part].triangles.clone();
        let inside = |t: &u32| {
            let [a, b, c] = scene.corners(*t).map(|p| Vec2::new(p.x, p.z));
            let side = |p: Vec2, q: Vec2| (q - p).perp_dot(Vec2::new(x, z) - p);
            side(a, b) <= 0.0 && side(b, c) <= 0.0 && side(c, a) <= 0.0
        };
        let t = range.clone().find(inside).unwrap();
        atlas.parts[part].chart((t - range.start) as usize)
    };
    let (north, under, south) = (chart(0.0, 0.19), chart(0.0, 0.205), chart(0.0, 0.22));
    assert!(north != under && under != south && north != south && north != NO_CHART);
    assert_eq!(chart(0.0, -1.4), north);
    assert_eq!(chart(0.0, 1.4), south);
    assert_ne!(chart(1.9, 0.0), chart(1.9, 0.4), "the line goes on beyond the end of the wall");
    let patches = Patches::new(&tracer, &atlas, &Progress::default());
    for i in (0..patches.front).filter(|&i| patches.chart(i) == under) {
        assert_eq!(patches.exposed[i], 0.0);
    }
}

#[test]
fn legs_and_crates_make_holes_and_no_lines() {
    let mut place = Place::default();
    place.sheet("floor", [-2.0, -1.5], [2.0, 1.5]);
    for (x, z) in [(0.0, 0.0), (1.2, 0.0), (0.0, 0.7), (1.2, 0.7)] {
        place.solid("leg", Vec3::new(x, 0.0, z), Vec3::new(x + 0.03, 0.7, z + 0.03));
    }
    place.solid("crate", Vec3::new(-1.5, 0.0, -0.8), Vec3::new(-0.9, 0.5, -0.2));
    let scene = contacts::cut(place.bake("texels-per-meter = 4.0\ngather = 0\nlines-per-texel = 1").source, &SETTINGS);
    assert!(scene.cuts.cut == 2 && scene.cuts.continued == 0, "{:?}", (scene.cuts.cut, scene.cuts.continued));
    let atlas = atlas::build(&Tracer::new(&scene), &atlas::Settings::default()).unwrap().output;
    let floor = scene.parts.iter().position(|p| p.name == "floor").unwrap();
    let mut charts = atlas.parts[floor].charts().collect::<Vec<_>>();
    charts.sort_unstable();
    charts.dedup();
    assert_eq!(charts.len(), 6, "the floor around, and what lies under each thing");
}

#[test]
fn a_scene_without_contacts_stays_as_it_is() {
    let mut place = Place::default();
    place.solid("one", Vec3::ZERO, Vec3::ONE);
    place.solid("two", Vec3::splat(2.0), Vec3::splat(3.0));
    let baked = place.bake("texels-per-meter = 2.0\ngather = 0\nlines-per-texel = 1");
    let scene = contacts::cut(baked.source, &SETTINGS);
    assert_eq!((scene.cuts.cut, scene.cuts.borders.len(), scene.triangles.len()), (0, 0, 24));
    // A smooth hollow, all of whose faces rise from each other's edges, does not come apart.
    let mut bowl = solve::load("furnace/polyhedron-0.5.gltf");
    bowl = contacts::cut(bowl, &SETTINGS);
    assert_eq!((bowl.cuts.cut, bowl.cuts.borders.len()), (0, 0));
}

#[test]
fn instances_are_cut_each_in_its_own_way() {
    // One mesh twice: a tile with a wall on it, and one without.
    let mut place = Place::default();
    place.sheet("tile", [0.0, 0.0], [1.0, 1.0]);
    place.solid("wall", Vec3::new(0.4, 0.0, 0.2), Vec3::new(0.41, 0.5, 0.8));
    let glb = place.glb_with(|builder| {
        let node =
            builder.push("nodes", serde_json::json!({"name": "second", "mesh": 0, "translation": [1.0, 0.0, 0.0]}));
        builder.json["scenes"][0]["nodes"].as_array_mut().unwrap().push(serde_json::json!(node));
    });
    let baked = bake_glb(&glb, "texels-per-meter = 8.0\ngather = 2\nlines-per-texel = 1\ncut-contacts = true");
    let triangles = |name: &str| baked.scene.parts.iter().find(|p| p.name == name).unwrap().triangles.len();
    assert!(triangles("tile") > 6 && triangles("second") < 6, "{} {}", triangles("tile"), triangles("second"));
    let meshes: Vec<usize> = baked.scene.parts.iter().map(|p| p.mesh).collect();
    assert_ne!(meshes[0], meshes[meshes.len() - 1]);
}
