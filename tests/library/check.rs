//! `texelwalk check`: every planted fault is found as what it is, and clean bakes have none.

#![allow(clippy::expect_used, reason = "tests")]

use crate::baked::{Baked, Chart};
use crate::quads;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;
use texelwalk::check::{self, Kind, Report, Settings};

const PROGRAM: &str = env!("CARGO_BIN_EXE_texelwalk");

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

fn run(arguments: &[&str]) -> Output {
    Command::new(PROGRAM).args(arguments).output().unwrap()
}

#[track_caller]
fn expect(arguments: &[&str], code: i32) -> Output {
    let out = run(arguments);
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(code), "{arguments:?}\n{said}");
    assert!(!said.contains("panicked"), "{said}");
    out
}

fn path(p: &Path) -> &str {
    p.to_str().unwrap()
}

/// A cheap bake of a fixture; the document that it wrote.
fn bake(name: &str, folder: &Path, options: &[&str]) -> PathBuf {
    let input = fixture(name);
    let quick = ["--preset", "preview", "--gather", "32", "--direct-samples", "2", "-q"];
    expect(&[&["bake", path(&input), "-o", path(folder)], quick.as_slice(), options].concat(), 0);
    folder.join(input.file_name().unwrap())
}

/// Two rooms, one of them dark, with three clean mip levels.
fn two_rooms() -> &'static Baked {
    static BAKED: OnceLock<Baked> = OnceLock::new();
    BAKED.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let options = ["--texels-per-meter", "8", "--mips", "3", "--sky", "0.2"];
        Baked::read(&bake("two-rooms/two-rooms.glb", folder.path(), &options))
    })
}

fn report(document: &Path, settings: &Settings) -> Report {
    check::check(&check::Baked::load(document, None).unwrap(), settings).unwrap()
}

fn faults(baked: &Baked) -> Vec<&'static str> {
    let folder = tempfile::tempdir().unwrap();
    report(&baked.write(folder.path()), &Settings::default()).faults
}

/// What wrong light on a chart leads to, wherever it comes from.
const LIGHT: [&str; 7] = ["mip-bleeding", "seam-step", "leaks", "dark-strip", "uncovered", "invalid", "firefly"];

/// A chart and the one nearest to its right, with the gap between them [texels].
fn neighbors(baked: &Baked) -> (Chart, f32) {
    let charts = baked.charts();
    let beside = |a: &Chart, b: &Chart| {
        let common = a.high[1].min(b.high[1]) - a.low[1].max(b.low[1]);
        (common > 3.0 && b.low[0] > a.high[0]).then(|| b.low[0] - a.high[0])
    };
    let wide = |a: &&Chart| a.high[0] - a.low[0] > 6.0;
    let gap = |a: &Chart| charts.iter().filter_map(|b| beside(a, b)).fold(f32::INFINITY, f32::min);
    charts.iter().filter(wide).map(|a| (a.clone(), gap(a))).find(|(_, gap)| *gap < 40.0).unwrap()
}

fn shift(baked: &mut Baked, chart: &Chart, texels: f32) {
    let by = texels / baked.page.width as f32;
    baked.change_uv(chart.place, &chart.vertices, |[u, v]| [u + by, v]);
}

/// The floor's texels under the wall between the rooms that nothing can see.
fn under_the_wall(baked: &mut Baked) -> Vec<(usize, usize)> {
    let floor = baked.node("Floor");
    let points = (0..13).flat_map(|i| (1..180).map(move |k| [3.5 + 0.02 * i as f32, 0.0194 * k as f32]));
    let mut texels: Vec<(usize, usize)> = points.filter_map(|p| baked.texel_of(floor, p)).collect();
    texels.sort_unstable();
    texels.dedup();
    texels.retain(|t| baked.texel(*t)[3] == 0.0);
    assert!(texels.len() > 20, "only {} texels are buried", texels.len());
    texels
}

/// A texel of the lit room's floor, far from anything.
fn lit_texel(baked: &Baked) -> (usize, usize) {
    baked.texel_of(baked.node("Floor"), [0.6, 3.0]).unwrap()
}

fn paint(baked: &mut Baked, texels: &[(usize, usize)], value: f32) {
    for t in texels {
        let alpha = baked.texel(*t)[3];
        *baked.texel(*t) = [value, value, value, alpha];
    }
}

/// All texels without coverage that are at least so far from one with.
fn beyond(baked: &Baked, distance: usize) -> Vec<(usize, usize)> {
    let (width, height) = (baked.page.width as usize, baked.page.height as usize);
    let all = (0..width * height).map(|i| (i % width, i / width));
    all.filter(|t| baked.distance_to_cover(*t) >= distance).collect()
}

/// A step between two charts: the one at the worst seam gets three times the light, with its padding, the texels nearest to it.
fn brighten_a_seam(baked: &mut Baked) {
    let folder = tempfile::tempdir().unwrap();
    let clean = report(&baked.write(folder.path()), &Settings::default());
    let at = clean.measure(Kind::SeamStep).unwrap().places[0].texel.unwrap().map(|v| v as f32 + 0.5);
    let charts = baked.charts();
    let distance = |chart: usize, p: [f32; 2]| {
        let c = &charts[chart];
        let out = |axis: usize| (c.low[axis] - p[axis]).max(p[axis] - c.high[axis]).max(0.0);
        out(0).max(out(1))
    };
    let nearest = |p: [f32; 2]| (0..charts.len()).min_by(|a, b| distance(*a, p).total_cmp(&distance(*b, p))).unwrap();
    let chart = nearest(at);
    let (width, height) = (baked.page.width as usize, baked.page.height as usize);
    let all = (0..width * height).map(|i| (i % width, i / width));
    for texel in all.filter(|t| nearest([t.0 as f32 + 0.5, t.1 as f32 + 0.5]) == chart) {
        baked.texel(texel)[..3].iter_mut().for_each(|v| *v *= 3.0);
    }
}

type Edit = fn(&mut Baked);

/// What is planted, what must be found, what may be found besides.
const PLANTED: [(&str, &str, &[&str], Edit); 27] = [
    ("a material without lightmap", "uv-missing", &[], |b| {
        let material = b.primitive((b.node("Divider"), 0))["material"].as_u64().unwrap() as usize;
        b.json["materials"][material]["extensions"].as_object_mut().unwrap().remove("MOZ_lightmap");
    }),
    ("a coordinate that is no number", "uv-missing", &LIGHT_AND_LAYOUT, |b| {
        let divider = (b.node("Divider"), 0);
        b.change_uv(divider, &[0], |_| [f32::NAN, 0.5]);
    }),
    ("a primitive beside its page", "uv-range", &[], |b| {
        let divider = (b.node("Divider"), 0);
        let all: Vec<usize> = (0..b.uv(divider).len()).collect();
        b.change_uv(divider, &all, |[u, v]| [u + 1.0, v]);
    }),
    ("coordinates beyond all size", "uv-range", &[], |b| {
        let divider = (b.node("Divider"), 0);
        b.change_uv(divider, &[0, 1, 2, 3], |[u, v]| [u * 1e30, v * -1e30]);
    }),
    ("a chart on another one", "uv-overlap", &LIGHT_AND_LAYOUT, |b| {
        let (chart, gap) = neighbors(b);
        shift(b, &chart, gap + 3.3);
    }),
    ("a triangle folded over its neighbour", "uv-overlap", &LIGHT_AND_LAYOUT, |b| {
        let floor = (b.node("Floor"), 0);
        let triangles = b.triangles(floor);
        let shared = |t: &[usize; 3], v: &usize| t.contains(v);
        let pair = triangles.iter().enumerate().find_map(|(i, a)| {
            let fits = |b: &&[usize; 3]| b.iter().filter(|v| shared(a, v)).count() == 2;
            triangles[i + 1..].iter().find(fits).map(|b| (*a, *b))
        });
        let (a, other) = pair.unwrap();
        let (own, odd) =
            (*a.iter().find(|v| !shared(&other, v)).unwrap(), *other.iter().find(|v| !shared(&a, v)).unwrap());
        let uv = b.uv(floor)[own];
        b.change_uv(floor, &[odd], |_| uv);
    }),
    ("triangles without area on the page", "uv-degenerate", &LIGHT_AND_LAYOUT, |b| {
        let floor = (b.node("Divider"), 0);
        let [v0, v1, v2] = b.triangles(floor)[0];
        let uv = b.uv(floor)[v0];
        b.change_uv(floor, &[v0, v1, v2], |_| uv);
    }),
    ("charts that touch", "padding", &LIGHT, |b| {
        let (chart, gap) = neighbors(b);
        shift(b, &chart, gap - 0.25);
    }),
    ("a chart in what its neighbour's mip levels read", "mip-bleeding", &LIGHT, |b| {
        let (chart, gap) = neighbors(b);
        shift(b, &chart, gap - 3.0);
    }),
    ("black around the charts", "uncovered", &["mip-bleeding", "seam-step", "dark-strip"], |b| {
        let texels: Vec<(usize, usize)> = beyond(b, 1);
        paint(b, &texels, 0.0);
    }),
    ("black two texels away from the charts", "mip-bleeding", &[], |b| {
        let texels: Vec<(usize, usize)> = beyond(b, 2);
        paint(b, &texels, 0.0);
    }),
    ("white around the charts", "uncovered", &["mip-bleeding", "seam-step", "leaks", "dark-strip"], |b| {
        let texels: Vec<(usize, usize)> = beyond(b, 1);
        paint(b, &texels, 2.0);
    }),
    ("white two texels away from the charts", "mip-bleeding", &[], |b| {
        let texels: Vec<(usize, usize)> = beyond(b, 2);
        paint(b, &texels, 2.0);
    }),
    ("a chart brighter than its neighbour", "seam-step", &[], brighten_a_seam),
    ("light spread under a wall", "leaks", &[], |b| {
        let texels = under_the_wall(b);
        paint(b, &texels, 1.0);
    }),
    ("darkness spread under a wall", "dark-strip", &[], |b| {
        let texels = under_the_wall(b);
        paint(b, &texels, 0.0);
    }),
    ("a black texel", "invalid", &[], |b| {
        let texel = lit_texel(b);
        paint(b, &[texel], 0.0);
    }),
    ("a texel that is no number", "values", &["invalid"], |b| {
        let texel = lit_texel(b);
        b.texel(texel)[1] = f32::NAN;
    }),
    ("an infinite texel beside a chart", "values", &["mip-bleeding", "uncovered"], |b| {
        let texel = beyond(b, 2)[0];
        b.texel(texel)[0] = f32::INFINITY;
    }),
    ("a negative texel", "values", &["invalid"], |b| {
        let texel = lit_texel(b);
        b.texel(texel)[2] = -0.5;
    }),
    ("a texel that is far too bright", "firefly", &[], |b| {
        let texel = lit_texel(b);
        b.texel(texel)[..3].iter_mut().for_each(|v| *v *= 40.0);
    }),
    ("a floor at half the density", "density", &LIGHT, |b| {
        let floor = b.node("Floor");
        for chart in b.charts().into_iter().filter(|c| c.place.0 == floor) {
            let middle = [0, 1].map(|c| 0.5 * (chart.low[c] + chart.high[c]) / [b.page.width, b.page.height][c] as f32);
            b.change_uv(chart.place, &chart.vertices, |uv| [0, 1].map(|c| middle[c] + 0.5 * (uv[c] - middle[c])));
        }
    }),
    (
        "a squeezed floor",
        "stretch",
        &["density", "mip-bleeding", "seam-step", "leaks", "dark-strip", "uncovered"],
        |b| {
            let floor = b.node("Floor");
            for chart in b.charts().into_iter().filter(|c| c.place.0 == floor) {
                let middle = 0.5 * (chart.low[0] + chart.high[0]) / b.page.width as f32;
                b.change_uv(chart.place, &chart.vertices, |[u, v]| [middle + 0.3 * (u - middle), v]);
            }
        },
    ),
    ("a page of another size than announced", "page", &[], |b| {
        b.json["scenes"][0]["extras"]["lightmap"]["pages"][0]["width"] = 64.into();
    }),
    ("a page that nothing uses", "page", &[], |b| {
        let pages = b.json["scenes"][0]["extras"]["lightmap"]["pages"].as_array_mut().unwrap();
        let mut second = pages[0].clone();
        second["texture"] = 0.into();
        pages.push(second);
    }),
    ("an intensity of another quantity than the manifest's", "page", &[], |b| {
        let material = b.primitive((b.node("Divider"), 0))["material"].as_u64().unwrap() as usize;
        b.json["materials"][material]["extensions"]["MOZ_lightmap"]["intensity"] = 1.into();
    }),
    ("a black page", "page", &[], |b| b.page.pixels.iter_mut().for_each(|p| *p = [0.0, 0.0, 0.0, p[3]])),
];

const LIGHT_AND_LAYOUT: [&str; 12] = [
    "mip-bleeding",
    "seam-step",
    "leaks",
    "dark-strip",
    "uncovered",
    "invalid",
    "firefly",
    "padding",
    "uv-overlap",
    "uv-degenerate",
    "density",
    "stretch",
];

#[test]
fn every_planted_fault_is_found() {
    let clean = faults(two_rooms());
    assert!(clean.is_empty(), "the clean bake has {clean:?}");
    let mut wrong = vec![];
    for (title, expected, besides, edit) in PLANTED {
        let mut planted = two_rooms().clone();
        edit(&mut planted);
        let found = faults(&planted);
        if !found.contains(&expected) || found.iter().any(|f| *f != expected && !besides.contains(f)) {
            wrong.push(format!("{title}: found {found:?} instead of {expected}"));
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn what_falls_back_on_a_page_must_be_there() {
    let folder = tempfile::tempdir().unwrap();
    let document = two_rooms().write(folder.path());
    expect(&["check", path(&document), "--fail"], 0);
    let preview = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().path());
    fs::remove_file(preview.filter(|p| p.extension().unwrap() == "png").last().unwrap()).unwrap();
    let told = expect(&["check", path(&document), "--fail"], 7).stdout;
    assert!(String::from_utf8_lossy(&told).contains("two-rooms.lightmap0.png is missing"));
}

#[test]
fn a_black_page_beside_lit_ones_is_a_fault_where_light_reaches_it() {
    // A floor under a lamp, and a closed room without one, on pages of their own.
    let floor = |low: f32| quads::Quad::floor(low, 3.0, quads::grey(0.5));
    let cellar = quads::Quad::room([20.0, 0.0, 20.0], [3.0; 3], quads::grey(0.5));
    let lamp = serde_json::json!({"type": "point", "intensity": 50.0});
    let scene = quads::Scene { quads: [vec![floor(0.0), floor(3.5)], cellar].concat(), lights: vec![] };
    let options = ["--preset", "preview", "--texels-per-meter", "8", "--page-size", "40"];
    let baked = scene.with(lamp, glam::Vec3::new(3.0, 2.0, 3.0), glam::Vec3::Y).bake(&options);
    let document = baked.path("out.gltf");
    let notes = || report(&document, &Settings::default()).measure(Kind::Page).unwrap().notes.clone();
    assert_eq!(notes(), Vec::<String>::new());
    let pages: Vec<PathBuf> = (0..8).map(|k| baked.path(&format!("out.lightmap{k}.exr"))).collect();
    let read = |p: &PathBuf| texelwalk::output::exr::read_rgba(p).unwrap();
    let is_lit = |p: &PathBuf| read(p).pixels.iter().any(|t| t[3] > 0.0 && t[0] > 0.0);
    let lit: Vec<usize> = (0..8).filter(|k| is_lit(&pages[*k])).collect();
    assert_eq!(lit.len(), 2);
    let image = read(&pages[lit[1]]);
    let size = (image.width as usize, image.height as usize);
    let black = |x: usize, y: usize| (0.0f32, 0.0f32, 0.0f32, image.pixels[y * size.0 + x][3]);
    exr::prelude::write_rgba_file(&pages[lit[1]], size.0, size.1, black).unwrap();
    let notes = notes();
    assert!(notes.len() == 1 && notes[0].starts_with(&format!("page {} is black", lit[1])), "{notes:?}");
}

#[test]
fn light_through_a_wall_is_a_fault_where_it_is_long() {
    for (value, kind) in [(1.0, Kind::Leaks), (0.0, Kind::DarkStrip)] {
        let found = |rows: usize| {
            let mut planted = two_rooms().clone();
            let mut texels = under_the_wall(&mut planted);
            let extent = |c: fn(&(usize, usize)) -> usize, t: &[(usize, usize)]| {
                let (low, high) = (t.iter().map(c).min().unwrap(), t.iter().map(c).max().unwrap());
                (high - low, (low + high) / 2)
            };
            let (columns, x) = extent(|t| t.0, &texels);
            let (lines, y) = extent(|t| t.1, &texels);
            texels.retain(|t| if columns > lines { t.0.abs_diff(x) < rows } else { t.1.abs_diff(y) < rows });
            paint(&mut planted, &texels, value);
            let folder = tempfile::tempdir().unwrap();
            report(&planted.write(folder.path()), &Settings::default()).measure(kind).unwrap().clone()
        };
        let (short, long) = (found(1), found(5));
        assert!(!short.fault && short.worst > 0.2 && short.count == 0 && !short.places.is_empty(), "{short:?}");
        assert!(long.fault && long.value > 0.1 && long.count >= 6 && long.worst >= long.value, "{long:?}");
    }
}

#[test]
fn what_nobody_gets_to_see_is_no_fault() {
    let found = |gap: f32| {
        let mut planted = two_rooms().clone();
        let at = lit_texel(&planted);
        paint(&mut planted, &[at], 1000.0);
        let ceiling = planted.node("Ceiling");
        planted.json["nodes"][ceiling]["translation"] = serde_json::json!([0.0, gap - 2.5, 0.0]);
        let folder = tempfile::tempdir().unwrap();
        report(&planted.write(folder.path()), &Settings::default()).measure(Kind::Firefly).unwrap().count
    };
    assert_eq!([0.02, 0.1, 0.2, 2.5].map(found), [0, 0, 1, 1]);
}

#[test]
fn sheets_that_lie_on_each_other_have_no_seam() {
    let points = |places: &[f32]| {
        let floor = |x: &f32| quads::Quad::new([*x, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], quads::grey(0.5));
        let scene = quads::Scene { quads: places.iter().map(floor).collect(), lights: vec![] };
        let baked = scene.bake(&["--preset", "preview", "--sky", "1", "--texels-per-meter", "8"]);
        report(&baked.path("out.gltf"), &Settings::default()).measure(Kind::SeamStep).unwrap().of
    };
    assert_eq!(points(&[0.0, 0.0]), 0);
    assert!(points(&[0.0, 1.0]) >= 56 && points(&[0.0, 0.0, 1.0]) >= 56);
}

#[test]
fn seams_beside_strips_that_nobody_sees_do_not_count() {
    // A strip so many texels wide beside a floor.
    let points = |width: f32| {
        let quad =
            |x: f32, wide: f32| quads::Quad::new([x, 0.0, 0.0], [0.0, 0.0, 1.0], [wide, 0.0, 0.0], quads::grey(0.5));
        let scene = quads::Scene { quads: vec![quad(0.0, 1.0), quad(1.0, width / 8.0)], lights: vec![] };
        let baked = scene.bake(&["--preset", "preview", "--sky", "1", "--texels-per-meter", "8"]);
        report(&baked.path("out.gltf"), &Settings::default()).measure(Kind::SeamStep).unwrap().of
    };
    assert_eq!(points(0.05), 0);
    assert!(points(0.3) >= 56 && points(3.0) >= 56);
}

#[test]
fn places_are_where_the_fault_is() {
    let mut planted = two_rooms().clone();
    let texel = lit_texel(&planted);
    planted.texel(texel)[..3].iter_mut().for_each(|v| *v *= 40.0);
    let folder = tempfile::tempdir().unwrap();
    let found = report(&planted.write(folder.path()), &Settings::default());
    let firefly = found.measure(Kind::Firefly).unwrap();
    assert_eq!((firefly.count, firefly.places.len()), (1, 1));
    let place = &firefly.places[0];
    assert_eq!((place.node.as_str(), place.page, place.mesh), ("Floor", Some(0), [0, 0]));
    assert_eq!(place.texel, Some([texel.0 as i32, texel.1 as i32]));
    let [x, y, z] = place.position;
    assert!((x - 0.6).abs() < 0.13 && y.abs() < 1e-5 && (z - 3.0).abs() < 0.13, "{:?}", place.position);
    assert!((place.value - 40.0).abs() < 10.0, "{}", place.value);
    let text = found.to_text();
    assert!(text.contains("on Floor (mesh 0 primitive 0), page 0 texel"), "{text}");
}

#[test]
fn padding_that_is_asked_for_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let document = two_rooms().write(folder.path());
    let pairs = |padding| {
        let settings = Settings { padding: Some(padding), ..Settings::default() };
        report(&document, &settings).measure(Kind::Padding).unwrap().value
    };
    // Half a texel of the third mip level beyond either chart.
    assert_eq!((pairs(4), pairs(8)), (0.0, 0.0));
    assert!(pairs(24) > 0.0);
}

#[test]
fn mip_levels_are_judged_as_far_as_they_are_promised() {
    let folder = tempfile::tempdir().unwrap();
    let options = ["--texels-per-meter", "8", "--mips", "0", "--sky", "0.2"];
    let mut baked = Baked::read(&bake("two-rooms/two-rooms.glb", folder.path(), &options));
    let mut said = |levels: Option<u32>| {
        let manifest = baked.json["scenes"][0]["extras"]["lightmap"].as_object_mut().unwrap();
        manifest.remove("mipLevels");
        levels.map(|n| manifest.insert("mipLevels".into(), n.into()));
        let found = report(&baked.write(folder.path()), &Settings::default());
        let measure = found.measure(Kind::MipBleeding).unwrap();
        assert!(measure.notes[0].contains("level 3: "), "{}", measure.notes[0]);
        (measure.fault, measure.value)
    };
    assert_eq!(said(Some(0)), (false, 0.0));
    let (one, two, other) = (said(Some(1)), said(Some(2)), said(None));
    assert!(two.0 && other.0 && one.1 < two.1 && two.1 > 0.1 && other.1 > 0.1, "{one:?} {two:?} {other:?}");
}

#[test]
fn the_same_report_at_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let mut planted = two_rooms().clone();
    let texels = under_the_wall(&mut planted);
    paint(&mut planted, &texels, 1.0);
    let document = planted.write(folder.path());
    let at = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| report(&document, &Settings::default()).to_json())
    };
    let one = at(1);
    assert!(one.contains("\"leaks\""));
    assert!([2, 3].into_iter().all(|threads| at(threads) == one));
}

#[test]
fn the_command_tells_faults_by_its_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let mut planted = two_rooms().clone();
    let texel = lit_texel(&planted);
    planted.texel(texel)[..3].iter_mut().for_each(|v| *v *= 40.0);
    let document = planted.write(folder.path());
    let all = |more: &[&str], code: i32| expect(&[&["check", path(&document)], more].concat(), code);
    assert!(String::from_utf8_lossy(&all(&[], 0).stdout).contains("faults: firefly"));
    all(&["--fail"], 7);
    let clean = all(&["--fail", "--limit", "firefly=1"], 0);
    assert!(String::from_utf8_lossy(&clean.stdout).contains("no faults"));
    for bad in ["firefly", "nonsense=1", "firefly=-1", "firefly=nan", "firefly=much"] {
        all(&["--limit", bad], 2);
    }
    let json: serde_json::Value = serde_json::from_slice(&all(&["--json", "-"], 0).stdout).unwrap();
    assert_eq!(json["faults"], serde_json::json!(["firefly"]));
    let names: Vec<&str> = json["measures"].as_array().unwrap().iter().map(|m| m["name"].as_str().unwrap()).collect();
    assert_eq!(names, Kind::ALL.map(Kind::name));

    let (pictures, file) = (folder.path().join("pictures"), folder.path().join("check.json"));
    all(&["--json", path(&file), "--pictures", path(&pictures)], 0);
    assert_eq!(serde_json::from_slice::<serde_json::Value>(&fs::read(&file).unwrap()).unwrap(), json);
    let picture = image::open(pictures.join("firefly-1.png")).unwrap().into_rgb8();
    let (width, height) = picture.dimensions();
    let magenta = picture.pixels().filter(|p| p[0] == 255 && p[1] == 0 && p[2] > 150).count();
    assert!(magenta > 400, "{magenta} pixels of a ring");
    // The spot inside the ring on the right outshines the floor outside.
    let at = |x: u32| u32::from(picture.get_pixel(x, height / 2)[1]);
    assert!(at(width * 3 / 4 + 2) > at(width * 3 / 4 + 100) + 50);
    assert_eq!(fs::read_dir(&pictures).unwrap().count(), 1);
}

#[test]
fn hostile_documents_get_an_error_or_a_fault_and_never_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let home = folder.path();
    let mut planted = two_rooms().clone();
    let check = |baked: &Baked, code: i32| expect(&["check", path(&baked.write(home)), "--fail"], code);

    // A page that is gone, or is no picture, is a fault that is named.
    let document = planted.write(home);
    let page =
        fs::read_dir(home).unwrap().map(|e| e.unwrap().path()).find(|p| p.extension().unwrap() == "exr").unwrap();
    let bytes = fs::read(&page).unwrap();
    for broken in [Some(bytes[..200].to_vec()), Some(b"no picture".to_vec()), None] {
        match broken {
            Some(bytes) => fs::write(&page, bytes).unwrap(),
            None => fs::remove_file(&page).unwrap(),
        }
        let out = expect(&["check", path(&document), "--fail"], 7);
        assert!(String::from_utf8_lossy(&out.stdout).contains("faults: page"));
    }

    expect(&["check", path(&home.join("absent.glb"))], 4);
    fs::write(home.join("garbage.glb"), b"glTF garbage").unwrap();
    expect(&["check", path(&home.join("garbage.glb"))], 3);
    expect(&["check", path(&fixture("two-rooms/two-rooms.glb"))], 3);

    let texture = planted.json["materials"][0]["extensions"]["MOZ_lightmap"]["index"].take();
    planted.json["materials"][0]["extensions"]["MOZ_lightmap"]["index"] = 999.into();
    check(&planted, 3);
    planted.json["materials"][0]["extensions"]["MOZ_lightmap"]["index"] = texture;

    // A hundred thousand triangles over the whole page.
    let divider = (planted.node("Divider"), 0);
    let [a, b, c] = planted.triangles(divider)[0];
    planted.change_uv(divider, &[a], |_| [0.0, 0.0]);
    planted.change_uv(divider, &[b], |_| [1.0, 0.0]);
    planted.change_uv(divider, &[c], |_| [0.0, 1.0]);
    let indices = planted.primitive(divider)["indices"].as_u64().unwrap() as usize;
    let start = planted.bin.len();
    planted.bin.extend([a, b, c].iter().flat_map(|v| (*v as u32).to_le_bytes()).collect::<Vec<u8>>().repeat(100_000));
    let views = planted.json["bufferViews"].as_array_mut().unwrap();
    views.push(serde_json::json!({"buffer": 0, "byteOffset": start, "byteLength": 1_200_000}));
    let view = views.len() - 1;
    planted.json["accessors"][indices] =
        serde_json::json!({"bufferView": view, "componentType": 5125, "count": 300_000, "type": "SCALAR"});
    planted.json["buffers"][0]["byteLength"] = planted.bin.len().into();
    let out = check(&planted, 3);
    assert!(String::from_utf8_lossy(&out.stderr).contains("no lightmap layout"));
}

/// Scenes with the density of a quick bake [texels/m], and seeds of which the mean counts.
const CLEAN: [(&str, &str, u32); 7] = [
    ("cornell/cornell.gltf", "4", 1),
    ("office/office.glb", "4", 12),
    ("two-rooms/two-rooms.glb", "8", 1),
    ("courtyard/courtyard.gltf", "4", 1),
    ("chairs/chairs.glb", "6", 1),
    ("room/room.glb", "4", 1),
    ("freedoom/freedoom-map01.glb", "0.5", 1),
];

/// What coarse bakes exceed, and by how much at most: texels wider than boards mix what is on both sides of them, and charts
/// narrower than a texel cannot agree with all their neighbours. Steps at those are noise for the most part: courtyard has 17
/// to 46 %, room 23 to 49 %, office 5 to 15 % with twelve seeds, 9 % in the mean.
const KNOWN: [(&str, Kind, f64); 8] = [
    ("office/office.glb", Kind::SeamStep, 0.1),
    ("office/office.glb", Kind::DarkStrip, 0.6),
    ("courtyard/courtyard.gltf", Kind::SeamStep, 0.35),
    ("courtyard/courtyard.gltf", Kind::DarkStrip, 0.5),
    ("room/room.glb", Kind::SeamStep, 0.55),
    ("room/room.glb", Kind::DarkStrip, 0.3),
    ("freedoom/freedoom-map01.glb", Kind::SeamStep, 0.3),
    ("freedoom/freedoom-map01.glb", Kind::Firefly, 3.0),
];

#[test]
#[ignore = "slow: bakes seven scenes"]
fn clean_bakes_have_no_faults_but_the_known_ones() {
    let mut wrong = vec![];
    for (name, density, seeds) in CLEAN {
        let one = |seed: u32| {
            let (folder, seed) = (tempfile::tempdir().unwrap(), seed.to_string());
            let options = ["--texels-per-meter", density, "--mips", "2", "--sky", "0.2", "--seed", &seed];
            let found = report(&bake(name, folder.path(), &options), &Settings::default());
            assert_eq!(found.measures.len(), Kind::ALL.len());
            found.measures
        };
        let all: Vec<_> = (0..seeds).map(one).collect();
        for (k, measure) in all[0].iter().enumerate().filter(|(k, _)| all.iter().any(|found| found[*k].fault)) {
            let value = all.iter().map(|found| found[k].value).fold(0.0, |a, b| a + b) / f64::from(seeds);
            let known = KNOWN.iter().find(|(scene, kind, _)| *scene == name && kind.name() == measure.name);
            if known.is_none_or(|(.., most)| value > *most) {
                wrong.push(format!("{name}: {} is {value:.4}", measure.name));
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}
