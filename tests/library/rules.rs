//! Rules by name and by `extras`: density, who receives and casts light, emission, intensity, light groups.

use crate::baked::Baked;
use crate::gltf_builder::{Builder, words};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use texelwalk::atlas;
use texelwalk::base::{Progress, Warned};
use texelwalk::check::{self, Kind};
use texelwalk::output::exr::read_rgba;
use texelwalk::patches::{PatchGraph, Patches};
use texelwalk::scene::{self, Light, Scene, Treatment};
use texelwalk::settings::Options;
use texelwalk::trace::{Ray, Tracer};

const FLOOR: usize = 1;
const CRATE: usize = 2;
const TUBE: usize = 3;

/// A mesh of quads with one material; the corners of each counter-clockwise.
fn mesh(b: &mut Builder, name: &str, material: usize, quads: &[[[f32; 3]; 4]]) -> usize {
    let corners: Vec<f32> = quads.iter().flatten().flatten().copied().collect();
    let position = b.floats("VEC3", &corners);
    let list: Vec<u16> = (0..quads.len() as u16).flat_map(|q| [0, 1, 2, 0, 2, 3].map(|k| 4 * q + k)).collect();
    let indices = b.accessor(5123, "SCALAR", list.len(), &words(&list), json!({}));
    let primitive = json!({"attributes": {"POSITION": position}, "indices": indices, "material": material});
    b.push("meshes", json!({"name": name, "primitives": [primitive]}))
}

/// A level rectangle; seen from above, or from below.
fn level([x0, x1]: [f32; 2], y: f32, [z0, z1]: [f32; 2], up: bool) -> [[f32; 3]; 4] {
    let [a, b, c, d] = [[x0, y, z1], [x1, y, z1], [x1, y, z0], [x0, y, z0]];
    if up { [a, b, c, d] } else { [d, c, b, a] }
}

fn cuboid([x0, x1]: [f32; 2], [y0, y1]: [f32; 2], [z0, z1]: [f32; 2]) -> Vec<[[f32; 3]; 4]> {
    vec![
        level([x0, x1], y0, [z0, z1], false),
        level([x0, x1], y1, [z0, z1], true),
        [[x0, y0, z1], [x1, y0, z1], [x1, y1, z1], [x0, y1, z1]],
        [[x1, y0, z0], [x0, y0, z0], [x0, y1, z0], [x1, y1, z0]],
        [[x1, y0, z1], [x1, y0, z0], [x1, y1, z0], [x1, y1, z1]],
        [[x0, y0, z0], [x0, y0, z1], [x0, y1, z1], [x0, y1, z0]],
    ]
}

/// A floor, a crate that hovers over its middle, a tube of light over a corner, all below the node `Room`; the sun in
/// the zenith.
fn stage() -> Builder {
    let mut b = Builder::new();
    let grey = json!({"baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0});
    b.push("materials", json!({"name": "white", "pbrMetallicRoughness": grey}));
    b.push("materials", json!({"name": "wood", "pbrMetallicRoughness": grey}));
    b.push("materials", json!({"name": "neon/red", "pbrMetallicRoughness": grey, "emissiveFactor": [1, 0.5, 0.25]}));
    let floor = mesh(&mut b, "Ground", 0, &[level([-2.0, 2.0], 0.0, [-2.0, 2.0], true)]);
    let sides = cuboid([-0.4, 0.4], [0.5, 1.0], [-0.4, 0.4]);
    let crates = mesh(&mut b, "Box", 1, &sides);
    let tube = mesh(&mut b, "Tube", 2, &[level([1.2, 1.8], 2.0, [1.2, 1.8], false)]);
    b.push("nodes", json!({"name": "Room", "children": [FLOOR, CRATE, TUBE]}));
    for (name, mesh) in [("Floor", floor), ("Crate", crates), ("Tube.001", tube)] {
        b.push("nodes", json!({"name": name, "mesh": mesh}));
    }
    let half = core::f32::consts::FRAC_1_SQRT_2;
    let light = json!({"KHR_lights_punctual": {"light": 0}});
    b.push("nodes", json!({"name": "Sky", "rotation": [-half, 0, 0, half], "extensions": light}));
    b.push("scenes", json!({"nodes": [0, 4]}));
    b.json["extensionsUsed"] = json!(["KHR_lights_punctual"]);
    let sun = json!({"name": "Sun", "type": "directional", "intensity": 2});
    b.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [sun]}});
    b
}

/// Extras for a JSON pointer.
fn tell(b: &mut Builder, pointer: &str, wishes: Value) {
    b.set(&format!("{pointer}/extras"), json!({"texelwalk": wishes}));
}

struct Run {
    home: tempfile::TempDir,
    out: Output,
}

/// Bakes a document with rules.
fn try_bake(b: &Builder, rules: &str, options: &[&str]) -> Run {
    let home = tempfile::tempdir().unwrap();
    let file = |name: &str| home.path().join(name);
    fs::write(file("in.glb"), b.glb(&[])).unwrap();
    fs::write(file("rules.toml"), rules).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
    command.arg("bake").arg(file("in.glb")).arg("-o").arg(file("out.glb")).arg("--config").arg(file("rules.toml"));
    command.arg("--report").arg(file("r.json"));
    let usual = ["--preset", "preview", "--texels-per-meter", "8"];
    let out = command.args(usual).args(options).output().unwrap();
    Run { home, out }
}

#[track_caller]
fn bake(b: &Builder, rules: &str, options: &[&str]) -> Run {
    let run = try_bake(b, rules, options);
    assert!(run.out.status.success(), "{}", run.said());
    run
}

impl Run {
    fn file(&self, name: &str) -> PathBuf {
        self.home.path().join(name)
    }

    fn said(&self) -> String {
        String::from_utf8_lossy(&self.out.stderr).into_owned()
    }

    fn baked(&self) -> Baked {
        Baked::read(&self.file("out.glb"))
    }

    fn report(&self) -> Value {
        serde_json::from_slice(&fs::read(self.file("r.json")).unwrap()).unwrap()
    }

    /// Code and message of every warning.
    fn warnings(&self) -> Vec<String> {
        let text = |w: &Value| format!("{} {}", w["code"].as_str().unwrap(), w["message"].as_str().unwrap());
        self.report()["warnings"].as_array().unwrap().iter().map(text).collect()
    }

    /// What `check` measures.
    fn measure(&self, kind: Kind) -> check::Measure {
        let baked = check::Baked::load(&self.file("out.glb"), None).unwrap();
        check::check(&baked, &check::Settings::default()).unwrap().measure(kind).unwrap().clone()
    }
}

/// Texels per metre of a node's first primitive: its area on the page over that in the world.
fn density(baked: &Baked, node: usize) -> f32 {
    let size = [baked.page.width as f32, baked.page.height as f32];
    let uv: Vec<glam::Vec2> =
        baked.uv((node, 0)).iter().map(|p| glam::Vec2::new(p[0] * size[0], p[1] * size[1])).collect();
    let world: Vec<glam::Vec3> = baked.positions((node, 0)).iter().map(|p| glam::Vec3::from_array(*p)).collect();
    let (mut texels, mut area) = (0.0, 0.0);
    for [a, b, c] in baked.triangles((node, 0)) {
        texels += (uv[b] - uv[a]).perp_dot(uv[c] - uv[a]).abs();
        area += (world[b] - world[a]).cross(world[c] - world[a]).length();
    }
    (texels / area).sqrt()
}

/// Light of the floor at a point, by its texel.
fn floor_light(baked: &Baked, at: [f32; 2]) -> f32 {
    let (x, y) = baked.texel_of(FLOOR, at).unwrap();
    baked.page.pixels[y * baked.page.width as usize + x][1]
}

/// Mean light of the floor over a grid of points.
fn floor_mean(baked: &Baked) -> f32 {
    let points = (0..961).map(|k| [(k % 31 - 15) as f32 * 0.125, (k / 31 - 15) as f32 * 0.125]);
    points.map(|at| floor_light(baked, at)).sum::<f32>() / 961.0
}

fn mean(page: &texelwalk::output::exr::ImageF32) -> f32 {
    page.pixels.iter().map(|p| p[1] * p[3]).sum::<f32>() / page.pixels.iter().map(|p| p[3]).sum::<f32>()
}

#[test]
fn density_is_a_factor_of_the_scenes() {
    let mut b = stage();
    // Of the tube, coordinates of its own are kept.
    let uv = b.floats("VEC2", &[0.1, 0.1, 0.1, 0.9, 0.9, 0.9, 0.9, 0.1]);
    b.set("/meshes/2/primitives/0/attributes/TEXCOORD_1", json!(uv));
    let rules = "[[rules]]\nmeshes = [\"Box\"]\ndensity = 2\n[[rules]]\nmaterials = [\"white\"]\ndensity = 0.5\n\
                 [[rules]]\nnodes = [\"Tube*\"]\ndensity = 4";
    let factors = [(FLOOR, 0.5), (CRATE, 2.0), (TUBE, 4.0)];
    let run = bake(&b, rules, &[]);
    let baked = run.baked();
    for (node, factor) in factors {
        let reached = density(&baked, node) / (8.0 * factor);
        assert!((reached - 1.0).abs() < 0.1, "node {node}: {reached} of {factor}");
    }
    // Where pages run out, the ratios stay.
    let tight = bake(&b, rules, &["--page-size", "32", "--max-pages", "1"]);
    assert!(tight.warnings()[0].starts_with("density-lowered"), "{:?}", tight.warnings());
    let lowered = tight.baked();
    let shares = factors.map(|(node, factor)| density(&lowered, node) / factor);
    assert!(shares[0] < 7.0 && shares.iter().all(|s| (s / shares[0] - 1.0).abs() < 0.1), "{shares:?}");

    // Such densities are no fault, unless nobody has asked for them.
    let measure = run.measure(Kind::Density);
    assert!(!measure.fault && measure.value < 1.1 && measure.notes.len() == 2, "{measure:?}");
    let mut forgotten = baked;
    let manifest = forgotten.json["scenes"][0]["extras"]["lightmap"].as_object_mut().unwrap();
    assert!(manifest.remove("treatments").is_some());
    let folder = tempfile::tempdir().unwrap();
    let planted = check::Baked::load(&forgotten.write(folder.path()), None).unwrap();
    let report = check::check(&planted, &check::Settings::default()).unwrap();
    assert!(report.measure(Kind::Density).unwrap().fault);
    assert!(report.density.iter().all(|d| d.factor == 1.0));

    let treated = run.report()["treated"].clone();
    let told: Vec<(&str, f64)> = treated
        .as_array()
        .unwrap()
        .iter()
        .map(|t| (t["node"].as_str().unwrap(), t["density"].as_f64().unwrap()))
        .collect();
    assert_eq!(told, [("Floor", 0.5), ("Crate", 2.0), ("Tube.001", 4.0)]);
}

#[test]
fn what_receives_nothing_stays_as_it_is_and_casts_a_shadow() {
    let b = stage();
    let direct = ["--gather", "0", "--bounces", "0"];
    let run = bake(
        &b,
        "[[rules]]\nnodes = [\"Crate\"]\nreceives = false\n[[rules]]\nmaterials = [\"neon*\"]\nemission = 0",
        &direct,
    );
    let baked = run.baked();
    assert_eq!(baked.json["meshes"][1], b.json["meshes"][1]);
    assert_eq!(baked.json["nodes"][CRATE], b.json["nodes"][CRATE]);
    assert_eq!(baked.json["materials"][1], b.json["materials"][1]);
    assert!(baked.bin.starts_with(&b.bin));
    assert!(baked.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"].is_u64());
    assert_eq!(floor_light(&baked, [0.0, 0.0]), 0.0, "the crate stands in the sun");
    let sun = 2.0 * core::f32::consts::FRAC_1_PI;
    assert!((floor_light(&baked, [-1.5, 1.5]) / sun - 1.0).abs() < 1e-3);
    assert_eq!(run.measure(Kind::UvMissing).value, 0.0);
    assert_eq!(run.measure(Kind::UvMissing).of, 2);
}

#[test]
fn what_casts_nothing_is_not_there_for_others() {
    let b = stage();
    let mut empty = stage();
    empty.set("/nodes/0/children", json!([FLOOR, TUBE]));
    let options = ["--gather", "64", "--threads", "2"];
    let alone = bake(&empty, "", &options);
    // Neither receiving nor casting: it is not charted and not met, so everything else is the same, bit by bit.
    let nothing = bake(&b, "[[rules]]\nnodes = [\"Crate\"]\nreceives = false\ncasts = false", &options);
    assert_eq!(nothing.baked().page.pixels, alone.baked().page.pixels);

    let ghost = bake(&b, "[[rules]]\nnodes = [\"Crate\"]\ncasts = false", &options);
    assert!(ghost.warnings().is_empty(), "{:?}", ghost.warnings());
    let baked = ghost.baked();
    let ratio = floor_mean(&baked) / floor_mean(&alone.baked());
    assert!((ratio - 1.0).abs() < 3e-3, "{ratio}");
    let solid = floor_light(&bake(&b, "", &options).baked(), [0.0, 0.0]);
    assert!(solid < 0.5 * floor_light(&baked, [0.0, 0.0]), "the crate lets {solid} through otherwise");
    // It is lit itself: by the sun from above, by the floor from below.
    assert!(baked.uv((CRATE, 0)).len() >= 24);
    let crate_light = |y: f32| {
        let [width, height] = [baked.page.width as f32, baked.page.height as f32];
        let positions = baked.positions((CRATE, 0));
        let face: Vec<usize> = (0..positions.len()).filter(|v| positions[*v][1] == y).collect();
        let level = baked.triangles((CRATE, 0)).into_iter().find(|t| t.iter().all(|v| face.contains(v))).unwrap();
        let uv = baked.uv((CRATE, 0));
        let at = |c: usize| level.iter().map(|v| uv[*v][c]).sum::<f32>() / 3.0;
        let (x, row) = ((at(0) * width) as usize, (at(1) * height) as usize);
        baked.page.pixels[row * baked.page.width as usize + x][1]
    };
    assert!(crate_light(1.0) > 2.0 * core::f32::consts::FRAC_1_PI, "{}", crate_light(1.0));
    assert!((0.1..0.4).contains(&crate_light(0.5)), "{}", crate_light(0.5));
    // Light that it gets and passes on is not counted twice.
    let power = |run: &Run| run.report()["walk"]["power_in"][1].as_f64().unwrap();
    assert!((power(&ghost) / power(&alone) - 1.0).abs() < 0.01, "{} {}", power(&ghost), power(&alone));

    // Under the sun alone it is exact.
    let direct = ["--gather", "0", "--bounces", "0"];
    let dark = "[[rules]]\nmaterials = [\"neon*\"]\nemission = 0\n";
    let [ghost, alone] = [
        bake(&b, &format!("{dark}[[rules]]\nnodes = [\"Crate\"]\ncasts = false"), &direct),
        bake(&empty, dark, &direct),
    ];
    let lit = [&ghost, &alone].map(Run::baked);
    for k in 0..225 {
        // Away from the edges of the tube's shadow, of which texels have samples of their own.
        let at = [(k % 15) as f32 * 0.19 - 1.8, (k / 15) as f32 * 0.19 - 1.8];
        let [ghost, alone] = [floor_light(&lit[0], at), floor_light(&lit[1], at)];
        assert!(ghost == alone && alone > 0.6, "{at:?}: {ghost} {alone}");
    }
    assert!(ghost.warnings()[0].starts_with("unseen-receiver"), "{:?}", ghost.warnings());

    // Pictures show it all the same.
    let picture = ghost.file("view.exr");
    let render = |document: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
        command.args(["render", "--auto", "--width", "64", "--height", "64", "--samples", "1", "-o"]);
        command.arg(&picture).arg(document);
        assert!(command.output().unwrap().status.success());
        read_rgba(&picture).unwrap().pixels
    };
    assert_ne!(render(&ghost.file("out.glb")), render(&alone.file("out.glb")));
    let scene = scene::load(&ghost.file("in.glb"), &settings("[[rules]]\nnodes = [\"Crate\"]\ncasts = false")).unwrap();
    let ray = Ray { origin: glam::Vec3::new(0.0, 1.5, 0.0), direction: glam::Vec3::NEG_Y, t_max: f32::INFINITY };
    let [first, all] =
        [Tracer::new(&scene.output), Tracer::of_all(&scene.output)].map(|t| t.closest_hit(&ray).unwrap().t);
    assert_eq!([first, all], [1.5, 0.5]);
}

#[test]
fn what_is_emitted_grows_with_its_factors() {
    let b = stage();
    let bake = |emission: &str, intensity: &str| {
        let rules = format!(
            "[[rules]]\nmaterials = [\"neon*\"]\nemission = {emission}\n[[rules]]\nlights = [\"S?n\"]\nintensity = {intensity}"
        );
        bake(&b, &rules, &["--gather", "16"]).baked()
    };
    for (one, two) in [(bake("1", "0"), bake("2", "0")), (bake("0", "0.5"), bake("0", "1"))] {
        assert!(mean(&one.page) > 1e-3, "{}", mean(&one.page));
        for (a, b) in one.page.pixels.iter().zip(&two.page.pixels) {
            (0..3).for_each(|c| assert!((2.0 * a[c] - b[c]).abs() <= 2e-3 * b[c] + 1e-6, "{a:?} {b:?}"));
        }
    }
    assert_eq!(mean(&bake("0", "0").page), 0.0);
    // What the document shows is not changed.
    let shown = bake("2", "0").json["materials"][2]["emissiveFactor"].clone();
    assert_eq!(shown, json!([1, 0.5, 0.25]));
}

/// The stage with wishes in the document, and rules that say the same.
fn told_twice() -> (Builder, &'static str) {
    let mut b = stage();
    tell(&mut b, "/nodes/1", json!({"density": 0.5}));
    tell(&mut b, "/meshes/1", json!({"casts": false, "density": 2}));
    tell(&mut b, "/materials/2", json!({"emission": 3, "receives": 0, "light_group": "tubes"}));
    tell(&mut b, "/extensions/KHR_lights_punctual/lights/0", json!({"intensity": 0.5, "light_group": "day"}));
    let rules = "[[rules]]\nnodes = [\"Floor\"]\ndensity = 0.5\n\
                 [[rules]]\nmeshes = [\"Box\"]\ncasts = false\ndensity = 2\n\
                 [[rules]]\nmaterials = [\"neon*\"]\nemission = 3\nreceives = false\nlight-group = \"tubes\"\n\
                 [[rules]]\nlights = [\"Sun\"]\nintensity = 0.5\nlight-group = \"day\"";
    (b, rules)
}

#[test]
fn extras_and_rules_say_the_same() {
    let (told, rules) = told_twice();
    let options = ["--gather", "16", "--light-groups"];
    let [by_extras, by_rules] = [bake(&told, "", &options), bake(&stage(), rules, &options)];
    let [a, b] = [by_extras.baked(), by_rules.baked()];
    assert_eq!(a.page.pixels, b.page.pixels);
    assert_eq!(a.bin, b.bin);
    for name in ["out.lightmap-tubes0.exr", "out.lightmap-day0.exr"] {
        let [a, b] = [&by_extras, &by_rules].map(|run| read_rgba(&run.file(name)).unwrap());
        assert_eq!(a.pixels, b.pixels, "{name}");
        assert!(mean(&a) > 1e-3, "{name}");
    }
    assert_eq!(by_extras.report()["treated"], by_rules.report()["treated"]);
    assert_eq!(by_extras.report()["light_groups"].as_array().unwrap().len(), 2);
    assert_eq!([by_extras.warnings(), by_rules.warnings()], [vec![], vec![]] as [Vec<String>; 2]);
    // Both are checked as they were baked.
    for run in [by_extras, by_rules] {
        assert!(!run.measure(Kind::Density).fault && !run.measure(Kind::UvMissing).fault);
    }
}

#[test]
fn light_at_vertices_follows_rules_too() {
    let rules = "[[rules]]\nnodes = [\"Crate\"]\nreceives = false\n[[rules]]\nnodes = [\"Floor\"]\ndensity = 4";
    let run = bake(&stage(), rules, &["--target", "vertex"]);
    let bytes = fs::read(run.file("out.glb")).unwrap();
    let scene = scene::load(&run.file("out.glb"), &scene::Settings::default()).unwrap().output;
    assert!(bytes.starts_with(b"glTF"));
    let lit = |mesh: usize| scene.document.root.meshes[mesh].primitives[0].attributes.contains_key("_LIGHTMAP");
    assert_eq!([0, 1, 2].map(lit), [true, false, true]);
    let plain = bake(&stage(), "", &["--target", "vertex"]);
    let texels = |run: &Run| run.report()["atlas"]["texels"].as_u64().unwrap();
    assert!(texels(&run) > 10 * texels(&plain), "{} {}", texels(&run), texels(&plain));
}

fn settings(rules: &str) -> scene::Settings {
    let rules = Options::from_toml(rules).unwrap().settings().unwrap().rules;
    scene::Settings { rules, ..scene::Settings::default() }
}

fn load(b: &Builder, rules: &str) -> Warned<Scene> {
    scene::load_bytes(b.glb(&[]), Path::new("a.glb"), &settings(rules)).unwrap()
}

fn treatments(b: &Builder, rules: &str) -> Vec<Treatment> {
    load(b, rules).output.parts.iter().map(|p| p.treatment).collect()
}

fn codes(b: &Builder, rules: &str) -> Vec<&'static str> {
    load(b, rules).warnings.iter().map(|w| w.code).collect()
}

#[test]
fn the_most_particular_wish_counts() {
    let mut b = stage();
    let crate_density = |b: &Builder, rules: &str| treatments(b, rules)[1].density;
    assert_eq!(crate_density(&b, ""), 1.0);
    for (place, density) in [("/materials/1", 2.0), ("/meshes/1", 3.0), ("/nodes/0", 4.0), ("/nodes/2", 5.0)] {
        tell(&mut b, place, json!({"density": density}));
        assert_eq!(crate_density(&b, ""), density);
        // Whatever the document says, rules come after it, in their order, whatever they match by.
        let [by_material, by_node] = ["materials = [\"wood\"]\ndensity = 6", "nodes = [\"Crate\"]\ndensity = 7"];
        assert_eq!(crate_density(&b, &format!("[[rules]]\n{by_material}")), 6.0);
        assert_eq!(crate_density(&b, &format!("[[rules]]\n{by_material}\n[[rules]]\n{by_node}")), 7.0);
        assert_eq!(crate_density(&b, &format!("[[rules]]\n{by_node}\n[[rules]]\n{by_material}")), 6.0);
    }
    // Wishes for a node hold below it, and each key is looked for by itself.
    let b = stage();
    let all = treatments(&b, "[[rules]]\nnodes = [\"Room\"]\ncasts = false\n[[rules]]\nnodes = [\"Cr*\"]\ndensity = 2");
    assert!(all.iter().all(|t| !t.casts));
    assert_eq!([all[0].density, all[1].density], [1.0, 2.0]);
    let intensity = |b: &Builder, rules: &str| match load(b, rules).output.lights[..] {
        [Light::Sun { illuminance, .. }] => illuminance.x,
        _ => panic!("one sun"),
    };
    let mut b = stage();
    assert_eq!(intensity(&b, ""), 2.0);
    tell(&mut b, "/extensions/KHR_lights_punctual/lights/0", json!({"intensity": 2}));
    assert_eq!(intensity(&b, ""), 4.0);
    tell(&mut b, "/nodes/4", json!({"intensity": 3}));
    assert_eq!(intensity(&b, ""), 6.0);
    assert_eq!(intensity(&b, "[[rules]]\nnodes = [\"Sky\"]\nlights = [\"Sun\"]\nintensity = 4"), 8.0);
}

#[test]
fn names_must_fit_all_at_once() {
    let mut b = stage();
    let densities = |b: &Builder, rule: &str| -> Vec<f32> {
        treatments(b, &format!("[[rules]]\n{rule}\ndensity = 2")).iter().map(|t| t.density).collect()
    };
    assert_eq!(densities(&b, "nodes = [\"Room\"]\nmaterials = [\"w*\"]"), [2.0, 2.0, 1.0]);
    assert_eq!(densities(&b, "nodes = [\"Floor\"]\nmaterials = [\"wood\"]"), [1.0; 3]);
    assert_eq!(densities(&b, "meshes = [\"Ground\", \"T?be\"]"), [2.0, 1.0, 2.0]);
    // What has no name is called as messages call it.
    for place in ["/nodes/1", "/meshes/1", "/materials/2"] {
        b.set(&format!("{place}/name"), Value::Null);
    }
    b.json["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("material");
    let by = |rule: &str| densities(&b, rule);
    assert_eq!(by("nodes = [\"node 1\"]"), [2.0, 1.0, 1.0]);
    assert_eq!(by("meshes = [\"mesh 1\"]"), [1.0, 2.0, 1.0]);
    assert_eq!(by("materials = [\"material [0-9]\", \"default material\"]"), [2.0, 1.0, 2.0]);
}

#[test]
fn odd_wishes_are_told_with_their_place() {
    let mut b = stage();
    tell(&mut b, "/nodes/2", json!({"densty": 2, "receives": "no"}));
    b.set("/nodes/1/extras", json!({"other": {"density": "x"}}));
    tell(&mut b, "/materials/2", json!({"density": 1000}));
    tell(&mut b, "/extensions/KHR_lights_punctual/lights/0", json!({"casts": false}));
    let run =
        bake(&b, "[[rules]]\nnodes = [\"nobody*\"]\ndensity = 2\n[[rules]]\nmaterials = [\"wood\"]\nemission = 2", &[]);
    let warnings = run.warnings();
    let expected = [
        "bad-extras material 2 \"neon/red\": extras.texelwalk.density is 1000",
        "bad-extras light 0 \"Sun\": extras.texelwalk.casts means nothing here",
        "bad-extras node Crate: extras.texelwalk.densty means nothing here",
        "bad-extras node Crate: extras.texelwalk.receives is \"no\", not true or false",
        "unused-rule rule 1 of the configuration matches nothing that it could change: {\"nodes\":[\"nobody*\"],\"density\":2.0}",
        "unused-rule rule 2 of the configuration matches nothing that it could change: {\"materials\":[\"wood\"],\"emission\":2.0}",
    ];
    assert_eq!(warnings.len(), expected.len(), "{warnings:#?}");
    for (told, expected) in warnings.iter().zip(expected) {
        assert!(told.starts_with(expected), "{told}\n{expected}");
    }
    assert_eq!(run.report()["warnings"][2]["node"], "Crate");
    assert_eq!(
        try_bake(&stage(), "[[rules]]\nnodes = [\"x\"]\ncasts = true", &["--strict"]).out.status.code(),
        Some(5)
    );
    let wrong = [
        ("[[rules]]\nnodes = [\"a\"]\ndensity = 0", "density"),
        ("[[rules]]\nnode = [\"a\"]\ndensity = 1", "node"),
        ("[[rules]]\nnodes = [\"[\"]\ndensity = 1", "no pattern"),
        ("[[rules]]\ndensity = 1", "needs names"),
        ("[rules]\ndensity = 1", "rules"),
    ];
    for (rules, word) in wrong {
        let run = try_bake(&stage(), rules, &[]);
        assert_eq!(run.out.status.code(), Some(2), "{rules}: {}", run.said());
        assert!(run.said().contains(word) && run.said().contains("rule"), "{rules}: {}", run.said());
        assert!(!run.file("out.glb").exists());
    }
}

#[test]
fn what_a_rule_cannot_give_is_a_warning() {
    let mut b = stage();
    assert_eq!(codes(&b, "[[rules]]\nnodes = [\"Tube*\"]\ncasts = false"), ["dark-emitter"]);
    assert_eq!(codes(&b, "[[rules]]\nnodes = [\"Tube*\"]\ncasts = false\nemission = 0"), [""; 0]);
    let huge = settings("[[rules]]\nmaterials = [\"neon*\"]\nemission = 3e38");
    b.set("/materials/2/extensions", json!({"KHR_materials_emissive_strength": {"emissiveStrength": 10}}));
    let error = scene::load_bytes(b.glb(&[]), Path::new("a.glb"), &huge).unwrap_err().to_string();
    assert!(error.contains("Tube.001") && error.contains("not finite"), "{error}");

    // What moves is told, unless somebody has said what to do with it.
    let mut b = stage();
    let delta = b.floats("VEC3", &[0.0; 72]);
    b.set("/meshes/1/primitives/0/targets", json!([{"POSITION": delta}]));
    let moved = json!({"channels": [{"target": {"node": 1, "path": "translation"}, "sampler": 0}], "samplers": []});
    b.push("animations", moved);
    let told = |rules: &str| -> Vec<String> {
        load(&b, rules).warnings.iter().map(|w| format!("{} {}", w.code, w.message)).collect()
    };
    let plain = told("");
    assert!(plain[0].contains("Floor") && plain[0].contains("was baked where it stands"), "{plain:?}");
    assert!(plain[1].contains("Crate") && plain[1].contains("it blocks light"), "{plain:?}");
    let off = "[[rules]]\nnodes = [\"Room\"]\nreceives = false";
    assert!(
        matches!(&told(off)[..], [one] if one.contains("it blocks light where it stands at rest")),
        "{:?}",
        told(off)
    );
    assert_eq!(told(&format!("{off}\ncasts = false\nemission = 0")), [""; 0]);
    let through = told("[[rules]]\nnodes = [\"Crate\"]\ncasts = false");
    assert!(through[1].contains("it gets no lightmap"), "{through:?}");
}

#[test]
fn inspect_shows_what_holds() {
    let (told, rules) = told_twice();
    let home = tempfile::tempdir().unwrap();
    let inspect = |b: &Builder, rules: &str, more: &[&str]| {
        let (input, config) = (home.path().join("a.glb"), home.path().join("a.toml"));
        fs::write(&input, b.glb(&[])).unwrap();
        fs::write(&config, rules).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_texelwalk"));
        let out = command.arg("inspect").arg(&input).arg("--config").arg(&config).args(more).output().unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stdout).unwrap()
    };
    let text = inspect(&told, "", &[]);
    assert_eq!(text, inspect(&stage(), rules, &[]));
    for part in ["[density ×0.5]", "[density ×2, casts no light]", "none     neon/red  [emission ×3, group tubes]"] {
        assert!(text.contains(part), "{part} is missing in\n{text}");
    }
    assert!(text.contains("sun 1.000 1.000 1.000 lx, group day"), "{text}");
    let facts: Value = serde_json::from_str(&inspect(&stage(), rules, &["--json"])).unwrap();
    assert_eq!(facts["parts"][1]["density"], 2.0);
    assert_eq!(facts["parts"][1]["casts"], false);
    assert_eq!(facts["parts"][2]["receives"], false);
    assert_eq!(facts["parts"][2]["emission"], 3.0);
}

#[test]
fn texels_of_every_size_are_linked_across_charts() {
    // Two sheets of large texels that abut; the crate has so many small ones that the median is theirs.
    let mut b = stage();
    let other = mesh(&mut b, "More", 0, &[level([2.0, 6.0], 0.0, [-2.0, 2.0], true)]);
    let node = b.push("nodes", json!({"name": "Floor.001", "mesh": other}));
    b.set("/scenes/0/nodes", json!([0, 4, node]));
    let scene =
        load(&b, "[[rules]]\nnodes = [\"Floor*\"]\ndensity = 0.25\n[[rules]]\nnodes = [\"Crate\"]\ndensity = 4").output;
    let tracer = Tracer::new(&scene);
    let settings = atlas::Settings { texels_per_meter: 8.0, ..atlas::Settings::default() };
    let atlas = atlas::build(&Tracer::new(&scene), &settings).unwrap().output;
    let patches = Patches::new(&tracer, &atlas, &Progress::default());
    let graph = PatchGraph::new(&patches, &tracer, &Progress::default());
    let across = |name: &str| {
        let part = |i: usize| scene.part(patches.triangles(i).next().unwrap()).name.as_str();
        let own = (0..patches.front).filter(|&i| part(i) == name);
        own.flat_map(|i| graph.across(i)).filter(|&j| part(j as usize) != name).count()
    };
    assert!(across("Floor") >= 8 && across("Floor") == across("Floor.001"), "{}", across("Floor"));
    assert!(atlas.charts.len() > 3);
}
