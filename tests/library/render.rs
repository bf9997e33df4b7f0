//! Pictures of lightmapped scenes: values by hand, views that make sense, and a whole document on disk.

use crate::support;
use glam::Mat4;
use glam::Vec2;
use glam::Vec3;
use glam::Vec4;
use texelwalk::atlas;
use texelwalk::atlas::NO_CHART;
use texelwalk::finish::Page;
use texelwalk::output;
use texelwalk::output::exr::ImageF32;
use texelwalk::output::gltf::Quantity;
use texelwalk::render::Error;
use texelwalk::render::Lightmaps;
use texelwalk::render::Overlay;
use texelwalk::render::Picture;
use texelwalk::render::Settings;
use texelwalk::render::Toward;
use texelwalk::render::View;
use texelwalk::render::render;
use texelwalk::scene;
use texelwalk::scene::Camera;
use texelwalk::scene::Projection;
use texelwalk::scene::Scene;
use texelwalk::trace::Tracer;

/// A 2 × 2 m square in z = 0 that faces +z, of reflectance 0.5, with its lightmap over all of it, and a camera before it.
fn square() -> Scene {
    let [a, b, c, d] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 0.0));
    let mut material = support::white();
    material.base_color = Vec4::new(0.5, 0.5, 0.5, 1.0);
    let mut scene = support::scene_with_material(&[[a, b, c], [a, c, d]], material);
    let uv = |p: &Vec3| Vec2::new((p.x + 1.0) * 0.5, (1.0 - p.y) * 0.5);
    scene.vertices.uv.push(scene.vertices.position.iter().map(uv).collect());
    scene.parts[0].has_uv1 = true;
    scene.cameras.push(Camera {
        number: 0,
        name: "front".into(),
        world_from_camera: Mat4::from_translation(Vec3::new(0.0, 0.0, 5.0)),
        projection: Projection::Orthographic { xmag: 1.0, ymag: 1.0 },
    });
    scene
}

fn page(size: u32, value: impl Fn(u32, u32) -> f32) -> ImageF32 {
    let pixels = (0..size * size).map(|i| value(i % size, i / size)).map(|v| [v, 2.0 * v, 0.0, 0.0]).collect();
    ImageF32 { width: size, height: size, pixels, has_alpha: true }
}

fn tone(c: f32) -> f32 {
    c * (1.0 + c / 36.0) / (1.0 + c)
}

fn settings(size: u32) -> Settings {
    Settings { width: size, height: size, samples: 1, exposure: Some(0.0), ..Settings::default() }
}

fn shows(picture: &Picture, x: u32, y: u32, expected: [f32; 3]) {
    let pixel = picture.pixels[(y * picture.width + x) as usize];
    let close = pixel.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4);
    assert!(close, "({x}, {y}): {pixel:?}, expected {expected:?}");
}

#[test]
fn a_constant_lightmap_shows_as_reflectance_times_irradiance_over_pi() {
    let scene = square();
    let lightmaps = Lightmaps::new(vec![page(4, |_, _| 1.2)], &[Some((0, 1, core::f32::consts::PI))]);
    let picture = render(&scene, &lightmaps, &settings(8)).unwrap();
    let expected = [tone(0.6), tone(1.2), 0.0];
    (0..64).for_each(|i| shows(&picture, i % 8, i / 8, expected));
    let brighter = Settings { exposure: Some(1.0), samples: 9, ..settings(8) };
    shows(&render(&scene, &lightmaps, &brighter).unwrap(), 3, 3, [tone(1.2), tone(2.4), 0.0]);
    assert_eq!(picture.camera, "front");
}

#[test]
fn a_linear_picture_is_radiance_without_curve_exposure_or_background() {
    let scene = square();
    let lightmaps = Lightmaps::new(vec![page(4, |_, _| 12.0)], &[Some((0, 1, core::f32::consts::PI))]);
    let linear = Settings { linear: true, exposure: Some(3.0), ..settings(8) };
    let picture = render(&scene, &lightmaps, &linear).unwrap();
    (0..64).for_each(|i| shows(&picture, i % 8, i / 8, [6.0, 12.0, 0.0]));
    assert!(picture.coverage.iter().all(|&c| c == 1.0) && picture.exposure == 0.0);
    let away = render(&scene, &lightmaps, &Settings { width: 64, height: 8, ..linear }).unwrap();
    assert_eq!((away.pixels[0], away.coverage[0]), ([0.0; 3], 0.0));
}

#[test]
fn the_overlay_of_light_leaves_materials_out() {
    let mut scene = square();
    scene.materials[0].base_color = Vec4::new(0.0, 0.1, 0.9, 1.0);
    scene.materials[0].emission = Vec3::ONE;
    let lightmaps = Lightmaps::new(vec![page(4, |_, _| 1.0)], &[Some((0, 1, core::f32::consts::PI))]);
    let plaster = Settings { overlay: Overlay::Light, ..settings(8) };
    shows(&render(&scene, &lightmaps, &plaster).unwrap(), 3, 3, [tone(0.7), tone(1.4), 0.0]);
    let shape = Settings { overlay: Overlay::Shape, ..settings(8) };
    shows(&render(&scene, &lightmaps, &shape).unwrap(), 3, 3, [1.0; 3]);
}

#[test]
fn a_cutaway_shows_what_lies_below_its_plane() {
    let scene = square();
    let lightmaps = Lightmaps::new(vec![page(4, |_, _| 1.0)], &[Some((0, 1, core::f32::consts::PI))]);
    let middle = |position: Vec3, cut: Option<(Vec3, f32)>| {
        let view = View::Toward(Toward { position, target: Vec3::ZERO, yfov: 0.5, cut });
        let picture = render(&scene, &lightmaps, &Settings { view, ..settings(9) }).unwrap();
        picture.coverage[40]
    };
    let (before, behind) = (Vec3::new(0.5, 0.3, 3.0), Vec3::new(0.5, 0.3, -3.0));
    assert_eq!(middle(before, None), 1.0);
    assert_eq!(middle(before, Some((Vec3::Z, 0.1))), 1.0);
    assert_eq!(middle(before, Some((Vec3::Z, -0.1))), 0.0, "the square itself is cut away");
    assert_eq!(middle(behind, None), 0.0, "backs are not seen");
    assert_eq!(middle(before, Some((Vec3::NEG_Z, 0.1))), 1.0, "what is cut away lies behind");
}

#[test]
fn rows_run_down_and_columns_to_the_right() {
    let scene = square();
    let value = |x: u32, y: u32| if (x, y) == (3, 0) { 1.0 } else { 0.0 };
    let lightmaps = Lightmaps::new(vec![page(4, value)], &[Some((0, 1, core::f32::consts::PI))]);
    let picture = render(&scene, &lightmaps, &settings(32)).unwrap();
    let reds: Vec<f32> = picture.pixels.iter().map(|p| p[0]).collect();
    let brightest = (0..reds.len()).max_by(|a, b| reds[*a].total_cmp(&reds[*b])).unwrap();
    assert!(brightest % 32 >= 26 && brightest / 32 <= 5, "{} {}", brightest % 32, brightest / 32);
    shows(&picture, 4, 28, [0.0; 3]);
}

#[test]
fn auto_exposure_brings_any_light_to_the_same_picture() {
    let scene = square();
    let at = |level: f32| {
        let lightmaps = Lightmaps::new(vec![page(4, |_, _| level)], &[Some((0, 1, 1.0))]);
        render(&scene, &lightmaps, &Settings { exposure: None, ..settings(8) }).unwrap()
    };
    let (dim, bright) = (at(0.01), at(100.0));
    dim.pixels.iter().zip(&bright.pixels).for_each(|(a, b)| assert!((a[1] - b[1]).abs() < 1e-4));
    assert!((dim.exposure - bright.exposure - 13.287_712).abs() < 1e-3);
    let luminance = 0.2126 + 0.7152 * 2.0;
    shows(&dim, 2, 2, [tone(0.22 / luminance), tone(0.44 / luminance), 0.0]);
    let black = at(0.0);
    assert_eq!(black.exposure, 0.0);
}

#[test]
fn emission_sky_backs_and_missing_lightmaps() {
    let mut scene = square();
    scene.materials[0].emission = Vec3::new(0.0, 0.0, 3.0);
    let none = Lightmaps::default();
    shows(&render(&scene, &none, &settings(4)).unwrap(), 1, 1, [0.0, 0.0, tone(3.0)]);
    // From behind the one-sided square is not there: neutral background, or the sky.
    let turned = Mat4::from_rotation_y(core::f32::consts::PI) * Mat4::from_translation(Vec3::new(0.0, 0.0, 5.0));
    scene.cameras[0].world_from_camera = turned;
    shows(&render(&scene, &none, &settings(4)).unwrap(), 1, 1, [0.05; 3]);
    scene.sky = scene::Sky::constant(Vec3::splat(0.7));
    shows(&render(&scene, &none, &settings(4)).unwrap(), 1, 1, [tone(0.7); 3]);
    scene.materials[0].double_sided = true;
    shows(&render(&scene, &none, &settings(4)).unwrap(), 1, 1, [0.0, 0.0, tone(3.0)]);
    scene.materials[0].unlit = true;
    shows(&render(&scene, &none, &settings(4)).unwrap(), 1, 1, [0.5; 3]);
}

#[test]
fn a_plain_picture_needs_no_light_and_a_series_shares_its_rays() {
    let mut scene = square();
    let plain = Settings { overlay: Overlay::Plain, ..settings(4) };
    shows(&render(&scene, &Lightmaps::default(), &plain).unwrap(), 1, 1, [0.5; 3]);
    scene.materials[0].emission = Vec3::new(0.0, 0.25, 3.0);
    let lit = Lightmaps::new(vec![page(4, |_, _| 1.2)], &[Some((0, 1, core::f32::consts::PI))]);
    shows(&render(&scene, &lit, &plain).unwrap(), 1, 1, [0.5, 0.75, 1.0]);
    let overlays = [Overlay::Charts, Overlay::None, Overlay::Plain];
    let series = texelwalk::render::series(&Tracer::new(&scene), &lit, &settings(4), &overlays).unwrap();
    for (picture, overlay) in series.iter().zip(overlays) {
        assert_eq!(picture, &render(&scene, &lit, &Settings { overlay, ..settings(4) }).unwrap());
    }
    assert!(series.len() == 3 && series[0] != series[1] && series[1] != series[2]);
}

/// The twelve triangles of a box with its fronts outward, or inward.
fn box_triangles(inward: bool) -> Vec<[Vec3; 3]> {
    let corner = |i: u32| Vec3::new((i & 1) as f32 * 4.0, (i >> 1 & 1) as f32 * 3.0, (i >> 2 & 1) as f32 * 5.0);
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    triangles.map(|[a, b, c]| if inward { [a, c, b] } else { [a, b, c] }.map(corner)).collect()
}

#[test]
fn automatic_views_stand_in_rooms_and_walk_around_things() {
    for inward in [true, false] {
        let mut scene = support::scene_from_triangles(&box_triangles(inward));
        scene.materials[0].emission = Vec3::ONE;
        let picture =
            render(&scene, &Lightmaps::default(), &Settings { width: 48, height: 27, ..settings(1) }).unwrap();
        assert_eq!(picture.camera, "auto");
        let background = picture.pixels.iter().filter(|p| (p[0] - 0.05).abs() < 1e-3).count();
        let share = background as f32 / picture.pixels.len() as f32;
        assert!(if inward { share == 0.0 } else { (0.3..0.95).contains(&share) }, "{inward}: {share}");
    }
}

#[test]
fn the_same_picture_at_every_thread_count() {
    let scene = square();
    let lightmaps = Lightmaps::new(vec![page(16, |x, y| (x * y) as f32)], &[Some((0, 1, 1.0))]);
    let settings = Settings { exposure: None, samples: 4, view: View::Auto, ..settings(40) };
    let at = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| render(&scene, &lightmaps, &settings).unwrap())
    };
    assert!(at(1) == at(3) && at(1) == at(8));
}

#[test]
fn impossible_pictures_are_refused() {
    let scene = square();
    let take = |settings: Settings| render(&scene, &Lightmaps::default(), &settings).unwrap_err();
    assert_eq!(take(Settings { view: View::Camera(1), ..settings(4) }), Error::NoCamera { index: 1, count: 1 });
    for bad in [Settings { width: 0, ..settings(4) }, Settings { samples: 0, ..settings(4) }] {
        assert!(matches!(take(bad), Error::Size { .. }));
    }
    let empty = Scene::default();
    assert!(render(&empty, &Lightmaps::default(), &settings(4)).is_ok());
}

/// With `TEXELWALK_TEST_OUTPUT=folder` the pictures stay there.
#[test]
fn a_document_on_disk_with_its_pages() {
    for name in ["cornell/cornell.gltf", "office/office.glb", "room/room.glb"] {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name);
        let before = scene::load(&path, &scene::Settings::default()).unwrap().output;
        let settings = atlas::Settings { texels_per_meter: 8.0, page_size: 512, ..atlas::Settings::default() };
        let atlas = atlas::build(&Tracer::new(&before), &settings).unwrap().output;
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("baked.glb");
        let files = output::names::page_files(&output, atlas.pages);
        let how = output::gltf::Settings {
            quantity: Quantity::Radiosity,
            output: output.clone(),
            generator: "texelwalk".into(),
            quantize_uv: false,
        };
        let mut written = output::gltf::write_gltf(&before, &atlas, &files, &how).unwrap().output;
        for page in &files {
            let [width, height] = atlas.page_size;
            let value = |i: u32| 0.3 + 0.7 * ((i % width) as f32 / width as f32);
            let pixels = (0..width * height).map(|i| [value(i), value(i), value(i), 1.0]).collect();
            let content = Page { width, height, pixels };
            let exr = output::exr::lightmap(&page.exr, &content, &Default::default()).unwrap();
            written.push((page.exr.clone(), exr.into()));
            written.push((page.png.clone(), output::png::preview(&page.png, &content).unwrap().into()));
        }
        output::atomic::commit(&written, &[path], None, &|| false).unwrap();
        let baked = scene::load(&output, &scene::Settings::default()).unwrap().output;
        let lightmaps = Lightmaps::load(&baked).unwrap();
        let charted = atlas.parts.iter().flat_map(|p| p.charts()).filter(|c| *c != NO_CHART).count();
        let mapped = (0..baked.triangles.len() as u32).filter(|&t| lightmaps.texels(&baked, t).is_some()).count();
        assert_eq!(charted, mapped, "{name}");
        for (view, overlay, suffix) in [
            (View::Default, Overlay::None, "default"),
            (View::Auto, Overlay::None, "auto"),
            (View::Auto, Overlay::Charts, "charts"),
            (View::Auto, Overlay::Density, "density"),
        ] {
            let settings =
                Settings { width: 480, height: 270, samples: 4, exposure: None, view, overlay, linear: false };
            let picture = render(&baked, &lightmaps, &settings).unwrap();
            if let Some(keep) = std::env::var_os("TEXELWALK_TEST_OUTPUT") {
                let file = std::path::Path::new(&keep).join(format!("{}-{suffix}.png", name.replace('/', "-")));
                let png = output::png::picture(&file, [picture.width, picture.height], &picture.pixels).unwrap();
                std::fs::write(file, png).unwrap();
            }
            let lit = picture.pixels.iter().filter(|p| p[0].max(p[1]).max(p[2]) > 0.06).count();
            assert!(lit * 5 > picture.pixels.len(), "{name}, {suffix}: too little is to be seen");
        }
        std::fs::remove_file(&files[0].exr).unwrap();
        assert!(Lightmaps::load(&baked).unwrap_err().to_string().contains("lightmap0.exr"));
    }
}
