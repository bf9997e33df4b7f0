//! Lamps with a measured distribution: light on a plane against the function that the table was made of, flux, readings of
//! every version and symmetry, and files that must be refused.

use crate::gltf_builder::{Builder, data_uri, words};
use crate::solve::Stage;
use glam::{DQuat, DVec3, Mat3, Vec3};
use serde_json::json;
use std::f64::consts::{FRAC_PI_2, PI};
use std::fs;
use std::path::Path;
use texelwalk::base::Rgb;
use texelwalk::scene::{self, Light, Scene, ies};
use texelwalk::walk::{Settings, Splat};

/// What is measured: candela in a direction of the lamp's frame, which aims along −z.
type Candela = fn(DVec3) -> f64;

/// No symmetry at all, and smooth, so that a table every 5° has it within 0.1 %.
fn lopsided(d: DVec3) -> f64 {
    500.0 * (1.0 + 0.5 * d.x + 0.3 * d.y) * (0.6 - 0.4 * d.z)
}

/// The same on both sides of the planes x = 0 and y = 0.
fn four_sided(d: DVec3) -> f64 {
    100.0 * (1.0 + 2.0 * d.x * d.x + 0.5 * d.y * d.y) * (0.6 - 0.4 * d.z)
}

/// Direction of the angles [degree] of a photometric type.
fn direction(kind: u32, h: f64, v: f64) -> DVec3 {
    let ((sh, ch), (sv, cv)) = (libm::sincos(h.to_radians()), libm::sincos(v.to_radians()));
    match kind {
        1 => DVec3::new(sv * ch, sv * sh, -cv),
        2 => DVec3::new(ch * sv, -sh, -ch * cv),
        _ => DVec3::new(sv, -cv * sh, -cv * ch),
    }
}

fn steps(low: f64, high: f64, by: f64) -> Vec<f64> {
    (0..=((high - low) / by).round() as usize).map(|k| low + k as f64 * by).collect()
}

/// An IES file; `multiplier` is taken out of the table again.
fn file(kind: u32, horizontal: &[f64], vertical: &[f64], multiplier: f64, candela: Candela) -> String {
    let list = |angles: &[f64]| angles.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let column =
        |&h: &f64| list(&vertical.iter().map(|&v| candela(direction(kind, h, v)) / multiplier).collect::<Vec<_>>());
    let columns: Vec<String> = horizontal.iter().map(column).collect();
    format!(
        "IESNA:LM-63-2002\r\n[TEST] none\r\nTILT=NONE\r\n1 -1 {multiplier} {} {} {kind} 2 0 0 0\r\n1 1 60\r\n{}\r\n{}\r\n{}\r\n",
        vertical.len(),
        horizontal.len(),
        list(vertical),
        list(horizontal),
        columns.join("\r\n")
    )
}

fn full(kind: u32, candela: Candela) -> String {
    match kind {
        1 => file(1, &steps(0.0, 360.0, 5.0), &steps(0.0, 180.0, 5.0), 2.5, candela),
        _ => file(kind, &steps(-90.0, 90.0, 5.0), &steps(-90.0, 90.0, 5.0), 0.5, candela),
    }
}

/// A floor of 3 × 3 m at y = 0 that faces up.
fn floor() -> Builder {
    let mut b = Builder::new();
    let position = b.floats("VEC3", &[0., 0., 0., 0., 0., 3., 3., 0., 3., 3., 0., 0.]);
    let indices = b.accessor(5123, "SCALAR", 6, &words(&[0, 1, 2, 0, 2, 3]), json!({}));
    b.push("meshes", json!({"primitives": [{"attributes": {"POSITION": position}, "indices": indices}]}));
    b.push("nodes", json!({"mesh": 0}));
    b
}

fn tilted() -> DQuat {
    DQuat::from_axis_angle(DVec3::new(0.3, 0.2, 0.9).normalize(), 0.6) * DQuat::from_rotation_x(-FRAC_PI_2)
}

const AT: [f64; 3] = [1.2, 1.1, 1.7];

/// The floor with a lamp of `EXT_lights_ies` above it, scaled, which must not matter.
fn lit_floor(text: &str, in_view: bool) -> Builder {
    let mut b = floor();
    let entry = if in_view {
        let view = b.view(text.as_bytes(), json!({}));
        json!({"bufferView": view, "mimeType": "application/x-ies-lm-63"})
    } else {
        json!({"uri": data_uri("application/x-ies-lm-63", text.as_bytes()), "name": "lamp"})
    };
    b.json["extensionsUsed"] = json!(["EXT_lights_ies"]);
    b.json["extensions"] = json!({"EXT_lights_ies": {"lights": [entry]}});
    let own = json!({"light": 0, "multiplier": 2.0, "color": [1.0, 0.5, 0.25]});
    b.push(
        "nodes",
        json!({"translation": AT, "rotation": tilted().to_array(), "scale": [3, 3, 3],
        "extensions": {"EXT_lights_ies": own}}),
    );
    b
}

fn load(builder: &Builder) -> Scene {
    scene::load_bytes(builder.glb(&[]), Path::new("/nowhere/a.glb"), &scene::Settings::default()).unwrap().output
}

/// E = I cos θ/d² on the floor.
fn expected(at: Vec3, candela: impl Fn(DVec3) -> f64) -> f64 {
    let to = at.as_dvec3() - DVec3::from_array(AT);
    candela(tilted().inverse() * to.normalize()) * -to.y / to.length().powi(3)
}

#[test]
fn a_floor_is_lit_as_the_table_says() {
    for (kind, in_view) in [(1, false), (2, true), (3, false)] {
        let scene = load(&lit_floor(&full(kind, lopsided), in_view));
        let stage = Stage::new(&scene, 20.0);
        // Types A and B measure the half that the lamp aims to; its edge falls on no texel that is asked.
        let measured = |d: DVec3| if kind == 1 || d.z < 0.0 { lopsided(d) } else { 0.0 };
        let aim = |p: Vec3| (tilted().inverse() * (p.as_dvec3() - DVec3::from_array(AT)).normalize()).z;
        let mut worst = 0.0f64;
        for (i, e) in stage.direct(4).iter().enumerate().take(stage.patches.front) {
            let at = stage.patches.position[i];
            if kind != 1 && aim(at).abs() < 0.1 {
                continue;
            }
            let expected = expected(at, measured) * 2.0;
            worst = worst.max((f64::from(e.x) - expected).abs() / expected.max(1.0));
            assert!((f64::from(e.y) - 0.5 * f64::from(e.x)).abs() < 1e-4 * f64::from(e.x));
            assert!((f64::from(e.z) - 0.25 * f64::from(e.x)).abs() < 1e-4 * f64::from(e.x));
        }
        assert!(worst < 0.01, "type {kind}: {worst}");
        assert!(scene.lights.len() == 1 && stage.patches.front > 3000);
    }
}

/// ∫ of [`lopsided`] over all directions, by hand: 500 · (0.6 · 4π), the rest is odd in x, y or z.
const LUMENS: f64 = 500.0 * 0.6 * 4.0 * PI;

#[test]
fn what_is_shot_is_the_integral_and_lands_where_shadow_rays_say() {
    let scene = load(&lit_floor(&full(1, lopsided), false));
    let [Light::Profiled { profile, axes, .. }] = &scene.lights[..] else { panic!("{:?}", scene.lights) };
    assert!((f64::from(profile.flux()) / LUMENS - 1.0).abs() < 2e-3, "{}", profile.flux());
    assert!((*axes * axes.transpose()).abs_diff_eq(Mat3::IDENTITY, 1e-6));

    let stage = Stage::new(&scene, 6.0);
    let settings = Settings { splat: Splat::None, lines: 1_000_000, bounces: Some(0), low_discrepancy: false, seed: 3 };
    let walk = stage.walk_with(None, &settings);
    let shot = walk.ledger[0].shot[0];
    assert!((shot / (2.0 * LUMENS) - 1.0).abs() < 3e-3, "{shot} lm are shot");
    let gathered = stage.direct(16);
    for quarter in 0..4 {
        let here = |i: usize| {
            let p = stage.patches.position[i];
            usize::from(p.x > 1.5) + 2 * usize::from(p.z > 1.5) == quarter
        };
        let (a, b) = (stage.mean(&walk.direct, here), stage.mean(&gathered, here));
        assert!((a / b - 1.0).abs() < 1e-2, "quarter {quarter}: shot {a}, gathered {b}");
    }
}

#[test]
fn a_glowing_sphere_with_a_profile_gives_the_same_by_lines_and_by_shadow_rays() {
    let how = scene::Settings { light_radius: Some(0.2), ..scene::Settings::default() };
    let document = lit_floor(&full(1, lopsided), false).glb(&[]);
    let scene = scene::load_bytes(document, Path::new("/nowhere/a.glb"), &how).unwrap().output;
    let stage = Stage::new(&scene, 6.0);
    let settings = Settings { splat: Splat::None, lines: 1_000_000, bounces: Some(0), low_discrepancy: false, seed: 4 };
    let shot = stage.mean(&stage.walk_with(None, &settings).direct, |_| true);
    let gathered = stage.mean(&stage.direct(64), |_| true);
    assert!((shot / gathered - 1.0).abs() < 5e-3, "shot {shot}, gathered {gathered}");
}

/// Many lamps go through the hierarchy of lights; their sum must stay what it is.
#[test]
fn twenty_lamps_are_twenty_times_one() {
    let one = load(&lit_floor(&full(2, lopsided), false));
    let mut many = load(&lit_floor(&full(2, lopsided), false));
    many.lights = vec![many.lights[0].clone(); 20];
    let [a, b] = [(&one, 4), (&many, 64)].map(|(scene, samples)| {
        let stage = Stage::new(scene, 6.0);
        stage.mean(&stage.direct(samples), |_| true)
    });
    assert!((b / (20.0 * a) - 1.0).abs() < 5e-3, "{a} and {b}");
}

#[test]
fn every_symmetry_and_version_is_read() {
    let (half, whole) = (steps(0.0, 90.0, 5.0), steps(0.0, 180.0, 5.0));
    let around = |first: f64, last: f64| file(1, &steps(first, last, 5.0), &whole, 1.0, four_sided);
    let down = [half.clone(), whole.clone()];
    let sides = |kind: u32, h: f64, v: f64| file(kind, &steps(h, 90.0, 5.0), &steps(v, 90.0, 5.0), 1.0, four_sided);
    let mut files =
        vec![around(0.0, 90.0), around(0.0, 180.0), around(90.0, 270.0), around(0.0, 355.0), around(0.0, 360.0)];
    for kind in [2, 3] {
        files.extend([
            sides(kind, 0.0, 0.0),
            sides(kind, -90.0, 0.0),
            sides(kind, 0.0, -90.0),
            sides(kind, -90.0, -90.0),
        ]);
    }
    files.push(around(0.0, 90.0).replace("TILT=NONE", "TILT=INCLUDE\r\n1\r\n3\r\n0 45 90\r\n1 0.9 0.8"));
    files.push(
        around(0.0, 90.0).replace("IESNA:LM-63-2002", "IES:LM-63-2019").replace("\r\n1 1 60", "\r\n1 1.10100 60"),
    );
    files.push(around(0.0, 90.0).replace("IESNA:LM-63-2002\r\n", "").replace("\r\n1 1 60", "\r\n0.5 2 60"));
    files.push(around(0.0, 90.0).replace("IESNA:LM-63-2002", "IESNA91").replace("\r\n1 1 60", "\r\n0.5,2,60"));
    files.push(around(0.0, 90.0).replace("\r\n", "\n") + "\x1a");
    files.push(around(0.0, 90.0).replace("\r\n", "\r"));
    for (k, text) in files.iter().enumerate() {
        let read = ies::read(text.as_bytes()).unwrap_or_else(|e| panic!("file {k}: {e}"));
        assert_eq!(read.tilts, text.contains("INCLUDE"));
        for d in [[0.1, 0.2, -1.0], [-0.5, 0.3, -0.4], [0.4, -0.7, -0.3], [-0.3, -0.2, -0.9], [0.0, 0.0, -1.0]] {
            let d = DVec3::from_array(d).normalize();
            let got = f64::from(read.profile.candela(d.as_vec3()));
            assert!((got / four_sided(d) - 1.0).abs() < 5e-3, "file {k}, {d}: {got} against {}", four_sided(d));
        }
    }
    // What was not measured is dark: below only, and above only.
    for (vertical, dark) in [(&down[0], Vec3::Z), (&steps(90.0, 180.0, 5.0), -Vec3::Z)] {
        let profile = ies::read(file(1, &[0.0], vertical, 1.0, lopsided).as_bytes()).unwrap().profile;
        assert_eq!(profile.candela(dark), 0.0);
        assert!(profile.candela(-dark) > 0.0);
    }
}

#[test]
fn extras_name_a_file_beside_the_document() {
    let folder = tempfile::tempdir().unwrap();
    let home = folder.path().join("in");
    fs::create_dir(&home).unwrap();
    fs::write(folder.path().join("a lamp.ies"), full(1, lopsided)).unwrap();
    let load = |kind: &str, own: serde_json::Value| {
        let mut b = floor();
        let light =
            json!({"type": kind, "intensity": 77, "color": [1, 0.5, 1], "extras": {"texelwalk": own, "radius": 0.1}});
        b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [light]}});
        b.push("nodes", json!({"translation": AT, "extensions": {"KHR_lights_punctual": {"light": 0}}}));
        scene::load_bytes(b.gltf(), &home.join("in.gltf"), &scene::Settings::default())
    };
    for kind in ["point", "spot"] {
        let loaded = load(kind, json!({"ies": "../a%20lamp.ies", "intensity": 3})).unwrap();
        assert_eq!(loaded.warnings, vec![]);
        let scene = loaded.output;
        let [Light::Profiled { factor, radius, profile, .. }] = &scene.lights[..] else { panic!("{:?}", scene.lights) };
        assert_eq!((*factor, *radius), (Rgb::new(3.0, 1.5, 3.0), 0.1));
        assert!((profile.candela(-Vec3::Z) - 500.0).abs() < 1.0);
        let read: Vec<_> = scene.document.files_read.iter().map(|f| f.file_name().unwrap().to_owned()).collect();
        assert_eq!(read, ["in.gltf", "a lamp.ies"]);
    }
    for uri in ["/etc/passwd", "file:///etc/passwd", "https://example.org/a.ies", "none.ies", ".", "../in"] {
        let error = load("point", json!({"ies": uri})).unwrap_err().to_string();
        assert!(error.contains("IES") || error.contains("regular file"), "{uri}: {error}");
    }
    fs::write(home.join("bad.ies"), "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1 5\n0 90\n0\n10 nan\n")
        .unwrap();
    let error = load("point", json!({"ies": "bad.ies"})).unwrap_err().to_string();
    assert!(error.contains("bad.ies") && error.contains("line 7") && error.contains("\"nan\""), "{error}");
    for (kind, own) in [("directional", json!({"ies": "../a lamp.ies"})), ("point", json!({"ies": 3}))] {
        let loaded = load(kind, own).unwrap();
        assert!(!matches!(loaded.output.lights[0], Light::Profiled { .. }));
        assert!(
            loaded.warnings.iter().any(|w| w.code == "bad-extras" && w.message.contains("ies")),
            "{:?}",
            loaded.warnings
        );
    }
}

#[test]
fn what_is_written_elsewhere_still_finds_its_files() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a lamp.ies"), full(1, lopsided)).unwrap();
    let mut b = floor();
    let light = json!({"type": "point", "extras": {"texelwalk": {"ies": "a%20lamp.ies"}}});
    b.json["extensionsUsed"] = json!(["EXT_lights_ies", "KHR_lights_punctual"]);
    b.json["extensions"] =
        json!({"KHR_lights_punctual": {"lights": [light]}, "EXT_lights_ies": {"lights": [{"uri": "a%20lamp.ies"}]}});
    let own = json!({"KHR_lights_punctual": {"light": 0}, "EXT_lights_ies": {"light": 0}});
    b.push("nodes", json!({"translation": AT, "extensions": own}));
    let (input, output) = (folder.path().join("in.glb"), folder.path().join("out/deep/out.gltf"));
    fs::write(&input, b.glb(&[])).unwrap();
    fs::create_dir_all(output.parent().unwrap()).unwrap();
    let depfile = folder.path().join("out.d");
    let mut bake = std::process::Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    bake.arg("bake").arg(&input).arg("-o").arg(&output).arg("--depfile").arg(&depfile);
    let done = bake.args(["-q", "--preset", "preview"]).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(fs::read_to_string(depfile).unwrap().contains("a\\ lamp.ies"));
    let again = scene::load(&output, &scene::Settings::default()).unwrap().output;
    assert!(again.lights.len() == 2 && again.lights.iter().all(|l| matches!(l, Light::Profiled { .. })));
    let json: serde_json::Value = serde_json::from_slice(&fs::read(&output).unwrap()).unwrap();
    assert_eq!(json["extensions"]["EXT_lights_ies"]["lights"][0]["uri"], "../../a%20lamp.ies");
}

#[test]
fn files_that_lie_are_refused_with_the_line() {
    let file = |numbers: &str| format!("IESNA:LM-63-2002\nTILT=NONE\n{numbers}");
    let good = "1 -1 1 2 1 1 2 0 0 0\n1 1 5\n0 90\n0\n10 5";
    assert!(ies::read(file(good).as_bytes()).is_ok());
    let refused = [
        (String::new(), "TILT"),
        ("\0\u{ff}PNG".to_owned(), "TILT"),
        ("IESNA:LM-63-2002\nTILT=NONE".to_owned(), "line 2: the file ends"),
        (file("1 -1 1 2 1 1 2 0 0 0\n1 1 5\n0 90\n0\n10"), "line 7: the file ends where candela"),
        (file("1 -1 1 4000000000 1 1 2 0 0 0\n"), "line 3: the number of vertical angles is 4000000000"),
        (file("1 -1 1 8192 8192 1 2 0 0 0\n"), "8192 × 8192 angles"),
        (file("1 -1 1 2.5 1 1 2 0 0 0\n"), "whole number"),
        (file("1 -1 1 -2 1 1 2 0 0 0\n"), "whole number"),
        (file("1 -1 inf 2 1 1 2 0 0 0\n"), "\"inf\" is not a number"),
        (file("1 -1 0 2 1 1 2 0 0 0\n"), "multiplier is 0, not positive"),
        (file(&good.replace("2 1 1 2 0", "2 1 4 2 0")), "photometric type is 4"),
        (file(&good.replace("0 90", "90 0")), "line 5: vertical angles must ascend"),
        (file(&good.replace("0 90", "0 0")), "must ascend"),
        (file(&good.replace("0 90", "0 190")), "must ascend from 0 to 180"),
        (file(&good.replace("10 5", "10 -5")), "line 7: a candela value is -5"),
        (file(&good.replace("10 5", "10 1e39")), "no distribution"),
        (file(&good.replace("10 5", "10 five")), "\"five\" is not a number"),
        (file("1 -1 1 2 2 1 2 0 0 0\n1 1 5\n0 90\n0 45\n1 1 1 1"), "no distribution"),
        (file("1 -1 1 1 1 1 2 0 0 0\n1 1 5\n0\n0\n1"), "no distribution"),
        (file("1 -1 1 2 1 2 2 0 0 0\n1 1 5\n0 90\n0\n1 1"), "no distribution"),
        (file(good).replace("NONE", "INCLUDE"), "line 3"),
        (file("1 3000000 1 1").replace("NONE", "INCLUDE"), "number of tilt angles"),
    ];
    for (text, why) in refused {
        let error = ies::read(text.as_bytes()).err().unwrap_or_else(|| panic!("accepted: {text}")).to_string();
        assert!(error.contains(why), "{text:?}: {error}");
    }
    assert!(ies::read(&vec![b' '; (1 << 24) + 1]).unwrap_err().to_string().contains("16 MiB"));
}
