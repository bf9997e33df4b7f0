//! Light by normal (`--directional`) against bakes of the same surfaces with other normals, and openness (`--aov
//! ao,bent`) against closed forms.

#![allow(clippy::print_stderr, reason = "figures of the slow tests")]

use crate::quads;
use crate::quads::{Baked, Quad, Scene, black, glowing, grey};
use glam::Vec3;
use serde_json::json;
use std::f32::consts::FRAC_PI_2;

const UP: Vec3 = Vec3::Y;

fn sin_cos(angle: f32) -> [f32; 2] {
    libm::sincosf(angle).into()
}

/// A direction at this angle to +y [degrees].
fn tilted(tilt: f32, around: f32) -> Vec3 {
    let ([sin, cos], [z, x]) = (sin_cos(tilt.to_radians()), sin_cos(around.to_radians()));
    Vec3::new(sin * x, cos, sin * z)
}

/// A black floor of 2 × 2 m with this normal, and a black board that stands on it.
fn floor_and_board(normal: Vec3) -> Vec<Quad> {
    let board = Quad::new([0.2, 0.0, -0.3], [0.3, 0.0, 0.5], [0.0, 0.6, 0.0], black());
    let back = Quad::new([0.5, 0.0, 0.2], [-0.3, 0.0, -0.5], [0.0, 0.6, 0.0], black());
    vec![Quad::floor(-1.0, 2.0, black()).shaded(normal), board, back]
}

fn lamp(kind: &str, intensity: f32) -> serde_json::Value {
    json!({"type": kind, "intensity": intensity, "color": [1.0, 0.7, 0.4]})
}

/// A scene by the floor's normal.
struct Case {
    name: &'static str,
    scene: Box<dyn Fn(Vec3) -> Scene>,
    options: Vec<&'static str>,
    /// Largest mean difference over mean light.
    most: f32,
}

fn cases() -> Vec<Case> {
    let scene = |normal| Scene { quads: floor_and_board(normal), lights: vec![] };
    let sun = move |normal| scene(normal).with(lamp("directional", 3.0), Vec3::ZERO, tilted(35.0, 70.0));
    let point = move |normal| scene(normal).with(lamp("point", 2.0), Vec3::new(0.3, 1.3, -0.2), UP);
    let lit_by = move |normal, quad| {
        let mut scene = scene(normal);
        scene.quads.push(quad);
        scene
    };
    let panel = Quad::new([0.4, 1.5, -0.8], [1.2, 0.4, 0.0], [0.0, 0.0, 1.6], glowing([5.0, 4.0, 2.0]));
    let wall = Quad::new([1.6, 0.0, -0.8], [0.0, 0.0, 1.6], [0.0, 1.6, 0.0], glowing([5.0, 4.0, 2.0]));
    let room = move |normal| {
        let mut scene = Scene { quads: Quad::room([-2.0, 0.0, -2.0], [4.0, 2.5, 4.0], grey(0.6)), lights: vec![] };
        scene.quads.splice(0..1, floor_and_board(normal));
        scene.with(lamp("point", 8.0), Vec3::new(-1.1, 1.8, 0.4), UP)
    };
    let case = |name, scene, options: &[&'static str], most| Case { name, scene, options: options.to_vec(), most };
    let sky = ["--sky", "0.4,0.6,1.2", "--sky-horizon", "1.5,1.0,0.5"];
    vec![
        case("sun", Box::new(sun), &[], 0.002),
        case("point light", Box::new(point), &[], 0.002),
        case("panel", Box::new(move |n| lit_by(n, panel.clone())), &["--direct-samples", "64"], 0.05),
        case("sky", Box::new(scene), &sky, 0.05),
        case("room", Box::new(room), &["--gather", "512", "--lines-per-texel", "128"], 0.05),
        // Light from the horizon up is not linear in the normal.
        case("glowing wall", Box::new(move |n| lit_by(n, wall.clone())), &["--direct-samples", "64"], 0.28),
    ]
}

/// Texels of the floor.
fn on_floor(baked: &Baked) -> Vec<usize> {
    let [x, y, z] = ["X", "Y", "Z"].map(|c| baked.layer(&format!("position.{c}")));
    let lightmap = baked.page("lightmap0.exr");
    let inside = |i: &usize| {
        let i = *i;
        lightmap[i][3] > 0.0 && y[i].abs() < 1e-4 && x[i].abs() < 1.0 && z[i].abs() < 1.0
    };
    (0..x.len()).filter(inside).collect()
}

fn light(pixel: [f32; 4]) -> Vec3 {
    Vec3::from_slice(&pixel[..3])
}

/// L0 + L1·n at every texel.
fn evaluated(baked: &Baked, normal: impl Fn(usize) -> Vec3) -> Vec<Vec3> {
    let [l0, x, y, z] = ["l0", "l1x", "l1y", "l1z"].map(|name| baked.page(&format!("lightmap0.{name}.exr")));
    let at = |i: usize| light(x[i]) * normal(i).x + light(y[i]) * normal(i).y + light(z[i]) * normal(i).z;
    (0..l0.len()).map(|i| (light(l0[i]) + at(i)).max(Vec3::ZERO)).collect()
}

/// Mean difference over mean light, and the 99th percentile of texels' difference over the mean light.
fn error(found: &[Vec3], truth: &[[f32; 4]], texels: &[usize]) -> (f32, f32) {
    let n = texels.len() as f32;
    let mean = texels.iter().map(|&i| light(truth[i]).element_sum()).fold(0.0, |a, b| a + b) / n;
    let mut off: Vec<f32> = texels.iter().map(|&i| (found[i] - light(truth[i])).abs().element_sum() / mean).collect();
    off.sort_by(f32::total_cmp);
    (off.iter().fold(0.0, |a, b| a + b) / n, off[texels.len() * 99 / 100])
}

#[test]
fn light_by_normal_is_what_a_bake_with_that_normal_has() {
    let common = ["--texels-per-meter", "8", "--aov", "position"];
    for Case { name, scene, options, most } in cases() {
        let options: Vec<&str> = common.iter().chain(&options).copied().collect();
        let flat = scene(UP).bake(&[options.as_slice(), &["--directional", "sh"]].concat());
        let texels = on_floor(&flat);
        assert!(texels.len() >= 230, "{name}: {} texels", texels.len());
        for (tilt, around) in [(15.0, 10.0), (30.0, 70.0), (30.0, 160.0), (30.0, 250.0), (30.0, 340.0)] {
            let normal = tilted(tilt, around);
            let again = scene(normal).bake(&options);
            let truth = again.page("lightmap0.exr");
            let (mean, high) = error(&evaluated(&flat, |_| normal), &truth, &texels);
            eprintln!("{name}, {tilt}° toward {around}°: mean {mean:.4}, 99th percentile of texels {high:.4}");
            assert!(mean < most && high < 0.03 + 4.0 * most, "{name}, {tilt}° toward {around}°: {mean}, {high}");
            // What does not know the normal is farther off.
            let (plain, _) = error(&evaluated(&flat, |_| UP), &truth, &texels);
            assert!(plain > 1.8 * mean, "{name}, {tilt}° toward {around}°: {plain} without tilting");
        }
    }
}

#[test]
fn at_its_own_normal_a_texel_is_that_of_the_lightmap() {
    for mode in ["sh", "dominant"] {
        let options = ["--directional", mode, "--aov", "normal", "--texels-per-meter", "8", "--sky", "0.3,0.4,0.5"];
        let baked = quads::bake_fixture("cornell/cornell.gltf", &options);
        let [x, y, z] = ["X", "Y", "Z"].map(|c| baked.layer(&format!("normal.{c}")));
        let normal = |i: usize| Vec3::new(x[i], y[i], z[i]);
        let lightmap = baked.page("lightmap0.exr");
        let found = if mode == "sh" { evaluated(&baked, normal) } else { half_lambert(&baked, &lightmap, normal) };
        let mut seen = 0;
        for i in (0..lightmap.len()).filter(|&i| lightmap[i][3] > 0.0 && normal(i) != Vec3::ZERO) {
            let (light, found) = (light(lightmap[i]), found[i]);
            assert!(
                (found - light).abs().max_element() <= 5e-3 * light.max_element() + 1e-6,
                "{mode}: {light} {found}"
            );
            seen += 1;
        }
        assert!(seen > 5000, "{seen}");
    }
}

/// What Unity's `DecodeDirectionalLightmap` makes of every texel.
fn half_lambert(baked: &Baked, lightmap: &[[f32; 4]], normal: impl Fn(usize) -> Vec3) -> Vec<Vec3> {
    let direction = baked.page("lightmap0.direction.exr");
    assert!(direction.iter().flatten().all(|v| (0.0..=1.0).contains(v)));
    assert!(direction.iter().all(|d| d[3] >= 0.499), "nothing from below the surface");
    let factor = |i: usize| (normal(i).dot(light(direction[i]) - 0.5) + 0.5) / direction[i][3].max(1e-4);
    (0..lightmap.len()).map(|i| light(lightmap[i]) * factor(i)).collect()
}

#[test]
fn the_dominant_direction_is_where_light_comes_from() {
    let scene = Scene { quads: vec![Quad::floor(-1.0, 2.0, black())], lights: vec![] };
    let toward = tilted(40.0, 200.0);
    let sunny = Scene { quads: scene.quads.clone(), lights: vec![] }.with(lamp("directional", 2.0), Vec3::ZERO, toward);
    let options = ["--directional", "dominant", "--texels-per-meter", "4"];
    for (scene, options, expected, most) in
        [(sunny, options.to_vec(), toward, 0.01), (scene, [&options[..], &["--sky", "1"]].concat(), UP, 0.06)]
    {
        let baked = scene.bake(&options);
        let (page, lightmap) = (baked.page("lightmap0.direction.exr"), baked.page("lightmap0.exr"));
        for i in (0..page.len()).filter(|&i| lightmap[i][3] > 0.0) {
            let d = (light(page[i]) - 0.5) * 2.0;
            assert!((d - expected).length() < most, "{d} instead of {expected}");
            assert!((page[i][3] - 0.5 * (1.0 + d.y)).abs() < 1e-3);
        }
    }
}

#[test]
fn nothing_else_changes_and_documents_name_the_textures() {
    let common = ["--texels-per-meter", "4", "--sky", "0.5", "--aov", "direct,stderr"];
    let plain = quads::bake_fixture("cornell/cornell.gltf", &common);
    for (mode, names) in [("sh", &["l0", "l1x", "l1y", "l1z"][..]), ("dominant", &["direction"])] {
        let baked = quads::bake_fixture("cornell/cornell.gltf", &[&common[..], &["--directional", mode]].concat());
        let bits = |b: &Baked| b.page("lightmap0.exr").iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&plain), bits(&baked));
        for name in ["direct.R", "direct.G", "direct.B", "stderr.Y"] {
            assert_eq!(plain.layer(name), baked.layer(name));
        }
        let mut more: Vec<String> = baked.names().into_iter().filter(|n| !plain.names().contains(n)).collect();
        more.sort();
        assert_eq!(more, names.iter().map(|n| format!("out.lightmap0.{n}.exr")).collect::<Vec<_>>());
        // Headers of EXR files have the settings.
        let other = plain.names().into_iter().filter(|n| !n.ends_with(".exr") && !n.ends_with(".gltf"));
        let unchanged: Vec<String> = other.inspect(|n| assert!(plain.bytes(n) == baked.bytes(n), "{n}")).collect();
        assert!(unchanged.contains(&"out.lightmap0.png".to_owned()) && unchanged.len() > 1, "{unchanged:?}");
        let mut document = baked.document();
        let page = &mut document["scenes"][0]["extras"]["lightmap"]["pages"][0];
        assert_eq!(page["directional"]["mode"], mode);
        assert!(names.iter().all(|n| page["directional"][*n] == format!("out.lightmap0.{n}.exr")));
        page.as_object_mut().unwrap().remove("directional").unwrap();
        let texture = document["textures"].as_array_mut().unwrap().last_mut().unwrap();
        texture["extras"]["lightmap"].as_object_mut().unwrap().remove("directional").unwrap();
        assert_eq!(document, plain.document());
        let listed = baked.report["directional"].as_array().unwrap();
        assert_eq!(listed.iter().map(|t| t["name"].as_str().unwrap()).collect::<Vec<_>>(), names);
        assert!(listed[0]["files"][0].as_str().unwrap().ends_with(&more[0]));
    }
    assert_eq!(plain.report["directional"], json!([]));
}

#[test]
fn threads_do_not_matter() {
    let options = ["--directional", "sh", "--aov", "ao,bent", "--texels-per-meter", "4", "--light-groups"];
    let bake = |threads| quads::bake_fixture("cornell/cornell.gltf", &[&options[..], &["--threads", threads]].concat());
    let [one, two] = ["1", "2"].map(bake);
    assert_eq!(one.names(), two.names());
    for name in one.names() {
        assert!(one.bytes(&name) == two.bytes(&name), "{name}");
    }
}

#[test]
fn the_open_is_open_and_the_closed_is_closed() {
    let plane = Scene { quads: vec![Quad::floor(-1.0, 2.0, grey(0.5))], lights: vec![] };
    let baked = plane.bake(&["--aov", "ao,bent", "--ao-distance", "inf", "--texels-per-meter", "4", "--gather", "2"]);
    let (ao, lightmap) = (baked.layer("ao.Y"), baked.page("lightmap0.exr"));
    let [x, y, z] = ["X", "Y", "Z"].map(|c| baked.layer(&format!("bent.{c}")));
    let width = baked.width("lightmap0.exr");
    let covered = |i: usize| lightmap.get(i).is_some_and(|p| p[3] > 0.0);
    let mut beside = 0;
    for i in 0..ao.len() {
        let near = covered(i) || covered(i + 1) || covered(i.wrapping_sub(1)) || covered(i + width);
        if near {
            assert!((ao[i] - 1.0).abs() < 1e-6 && Vec3::new(x[i], y[i], z[i]).distance(UP) < 0.03);
            assert!((Vec3::new(x[i], y[i], z[i]).length() - 1.0).abs() < 1e-5);
            beside += usize::from(!covered(i));
        }
    }
    assert!(beside > 10, "borders are filled");

    let room = Scene { quads: Quad::room([-1.0; 3], [2.0; 3], grey(0.5)), lights: vec![] };
    let closed = room.bake(&["--aov", "ao", "--ao-distance", "inf", "--texels-per-meter", "4", "--gather", "2"]);
    assert!(closed.layer("ao.Y").iter().all(|v| *v == 0.0));
    let near = room.bake(&["--aov", "ao", "--ao-distance", "0.4", "--texels-per-meter", "4", "--gather", "2"]);
    assert!(near.layer("ao.Y").contains(&1.0), "the middle of a wall is farther from all others");
}

#[test]
fn openness_before_a_wall_is_that_of_the_closed_form() {
    const HEIGHT: f32 = 1.0;
    let wall = Quad::new([0.0, 0.0, -40.0], [0.0, HEIGHT, 0.0], [0.0, 0.0, 80.0], grey(0.5)).facing(Vec3::X);
    let floor = Quad::new([0.0, 0.0, -0.5], [0.0, 0.0, 1.0], [2.0, 0.0, 0.0], grey(0.5)).facing(UP);
    let scene = Scene { quads: vec![floor, wall], lights: vec![] };
    let options = ["--aov", "ao,bent,position,coverage", "--texels-per-meter", "8", "--gather", "2"];
    let baked = scene.bake(&[&options[..], &["--ao-distance", "inf"]].concat());
    let [px, py] = ["X", "Y"].map(|c| baked.layer(&format!("position.{c}")));
    let [bx, by] = ["X", "Y"].map(|c| baked.layer(&format!("bent.{c}")));
    let (ao, coverage) = (baked.layer("ao.Y"), baked.layer("coverage.Y"));
    let (mut seen, mut sum) = (0, 0.0);
    for i in (0..ao.len()).filter(|&i| coverage[i] > 0.99 && py[i].abs() < 1e-4 && px[i] > 0.1) {
        // A wall without ends that reaches up to an elevation of φ covers (1 − cos φ)/2.
        let d = px[i];
        let expected = 0.5 * (1.0 + d / d.hypot(HEIGHT));
        let bent = open_direction(HEIGHT.atan2(d));
        assert!((ao[i] - expected).abs() < 0.02, "{d} m: {} instead of {expected}", ao[i]);
        assert!(Vec3::new(bx[i], by[i], 0.0).distance(bent) < 0.06, "{d} m: {} {} instead of {bent}", bx[i], by[i]);
        sum += ao[i] - expected;
        seen += 1;
    }
    assert!(seen > 100 && (sum / seen as f32).abs() < 2e-3, "{} over {seen}", sum / seen as f32);

    let short = scene.bake(&[&options[..], &["--ao-distance", "0.5"]].concat());
    let (ao, px) = (short.layer("ao.Y"), short.layer("position.X"));
    let far = (0..ao.len()).filter(|&i| px[i] > 0.6);
    assert!(far.clone().count() > 50 && far.clone().all(|i| ao[i] == 1.0));
}

/// Mean direction by cosine of the hemisphere above +y less what a wall at −x without ends covers up to this elevation.
fn open_direction(wall: f32) -> Vec3 {
    let (n, mut sum) = (400, Vec3::ZERO);
    for j in 0..n {
        for k in 0..n {
            // Elevation toward −x in the plane across the wall, and angle along it: x = −cos a cos e, y = cos a sin e.
            let e = std::f32::consts::PI * (j as f32 + 0.5) / n as f32;
            let a = FRAC_PI_2 * (2.0 * (k as f32 + 0.5) / n as f32 - 1.0);
            if e > wall {
                let ([along, across], [up, back]) = (sin_cos(a), sin_cos(e));
                let direction = Vec3::new(-across * back, across * up, along);
                sum += direction * (direction.y * across);
            }
        }
    }
    Vec3::new(sum.x, sum.y, 0.0).normalize()
}
