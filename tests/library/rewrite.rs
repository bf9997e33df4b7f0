//! The fixtures, charted and rewritten: the baked document loads as the same scene, with lightmap coordinates.

use std::path::Path;
use std::path::PathBuf;
use texelwalk::atlas;
use texelwalk::atlas::NO_CHART;
use texelwalk::output::gltf::Quantity;
use texelwalk::output::gltf::Settings;
use texelwalk::output::gltf::write_gltf;
use texelwalk::output::names::page_files;
use texelwalk::scene;
use texelwalk::scene::Scene;
use texelwalk::trace::Tracer;

fn fixtures() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let folders = std::fs::read_dir(root).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_dir());
    let files = folders.flat_map(|f| std::fs::read_dir(f).unwrap().map(|e| e.unwrap().path()).collect::<Vec<_>>());
    let mut all: Vec<PathBuf> = files.filter(|p| p.extension().is_some_and(|e| e == "gltf" || e == "glb")).collect();
    all.sort();
    assert!(all.len() >= 3, "fixtures are missing");
    all
}

fn load(path: &Path) -> Scene {
    scene::load(path, &scene::Settings::default()).unwrap().output
}

/// Corner positions and lightmap coordinates of every triangle of a node, in a fixed order.
fn triangles(scene: &Scene, uv: impl Fn(usize, usize, usize) -> Option<[f32; 2]>) -> Vec<(usize, String)> {
    let mut all = Vec::new();
    for (p, part) in scene.parts.iter().enumerate() {
        // A triangle without area has no chart; where its corners lie on the lightmap does not matter.
        for t in part.triangles.clone().filter(|&t| scene.area(t) > 0.0) {
            let corners = scene.corners(t);
            let mut corners: Vec<String> = (0..3)
                .map(|k| format!("{:?} {:?}", corners[k].to_array(), uv(p, t as usize, k).filter(|_| part.receives)))
                .collect();
            // Which corner comes first is free, their order is not.
            let first = (0..3).min_by_key(|&k| corners[k].clone()).unwrap();
            corners.rotate_left(first);
            all.push((part.node, corners.join(" ")));
        }
    }
    all.sort();
    all
}

#[test]
fn a_baked_fixture_loads_as_the_same_scene() {
    for path in fixtures() {
        let before = load(&path);
        let settings = atlas::Settings { texels_per_meter: 4.0, page_size: 256, ..atlas::Settings::default() };
        let atlas = atlas::build(&Tracer::new(&before), &settings).unwrap().output;
        assert!(atlas.pages > 0, "{}", path.display());
        let folder = tempfile::tempdir().unwrap();
        for extension in ["glb", "gltf"] {
            let output = folder.path().join("out").with_extension(extension);
            let pages = page_files(&output, atlas.pages);
            let settings = Settings {
                quantity: Quantity::Irradiance,
                output: output.clone(),
                generator: "texelwalk".into(),
                quantize_uv: false,
            };
            for (file, bytes) in write_gltf(&before, &atlas, &pages, &settings).unwrap().output {
                std::fs::write(file, bytes.to_vec()).unwrap();
            }
            let mut image = Vec::new();
            image.extend_from_slice(&texelwalk::output::png::picture(&output, [1, 1], &[[1.0; 3]]).unwrap());
            pages.iter().for_each(|page| std::fs::write(&page.png, &image).unwrap());
            let after = load(&output);
            let [width, height] = atlas.page_size.map(|n| n as f32);
            let wanted = |p: usize, t: usize, k: usize| {
                let (part, charted) = (&before.parts[p], &atlas.parts[p]);
                let local = t - part.triangles.start as usize;
                let uv = charted.uv(*charted.layout.triangles.get(local)?.get(k)?);
                (charted.chart(local) != NO_CHART).then_some([uv.x / width, uv.y / height])
            };
            let found = |p: usize, t: usize, k: usize| {
                let set = after.materials[after.parts[p].material].lightmap_uv_set?;
                Some(after.vertices.uv.get(set)?[after.triangles[t][k] as usize].to_array())
            };
            let name = format!("{} as {extension}", path.display());
            assert_eq!(before.lights.len(), after.lights.len(), "{name}");
            let (wanted, found) = (triangles(&before, wanted), triangles(&after, found));
            let differing = wanted.iter().zip(&found).find(|(a, b)| a != b);
            assert!(differing.is_none() && wanted.len() == found.len(), "{name}: {differing:#?}");
        }
    }
}
