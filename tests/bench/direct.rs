//! Error and cost of direct light on the fixtures, against a reference of the same function with many times the samples.
//!
//! `cargo bench --bench direct -- DIR reference SAMPLES` writes references into DIR, `-- DIR NAME SAMPLES…` measures
//! against them and prints comma-separated values: scene, name, samples, texels, shadow rays per texel, CPU seconds, NRMSE
//! over all texels, root mean square of the relative error (denominator: texel plus a tenth of the mean), and the NRMSE
//! that the halves estimate. The variable SCENES chooses scenes.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "bench")]

#[path = "../support/solve.rs"]
mod solve;

use solve::{Stage, fixture};
use std::path::Path;
use texelwalk::base::Rgb;
use texelwalk::scene::{self, Sky};

/// Fixture, texels per metre, radiance of its sky.
const SCENES: [(&str, &str, f32, f32); 5] = [
    ("cornell", "cornell/cornell.gltf", 8.0, 0.0),
    ("office", "office/office.glb", 10.0, 0.0),
    ("room", "room/room.glb", 10.0, 0.0),
    ("courtyard", "courtyard/courtyard.gltf", 4.0, 0.4),
    ("freedoom", "freedoom/freedoom-map01.glb", 0.5, 0.0),
];

/// CPU seconds of this process so far.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<f64> =
        stat.rsplit(')').next().unwrap().split_whitespace().skip(11).take(2).map(|v| v.parse().unwrap()).collect();
    (fields[0] + fields[1]) / 100.0
}

fn errors(reference: &[Rgb], test: &[Rgb]) -> (f64, f64) {
    let n = reference.len() as f64;
    let mean = reference.iter().map(|v| f64::from(v.element_sum()) / 3.0).fold(0.0, |a, b| a + b) / n;
    let (mut square, mut relative) = (0.0, 0.0);
    for (r, t) in reference.iter().zip(test) {
        let d = f64::from((*t - *r).length_squared()) / 3.0;
        square += d;
        relative += d / (f64::from(r.element_sum()) / 3.0 + 0.1 * mean).powi(2);
    }
    ((square / n).sqrt() / mean, (relative / n).sqrt())
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let (folder, name) = (Path::new(&arguments[0]), arguments[1].as_str());
    let only = std::env::var("SCENES").unwrap_or_default();
    for (scene_name, file, density, sky) in SCENES.iter().filter(|s| only.is_empty() || only.contains(s.0)) {
        let sky = Sky { ground: Rgb::ZERO, ..Sky::constant(Rgb::splat(*sky)) };
        let settings = scene::Settings { sky, ..scene::Settings::default() };
        let scene = scene::load(&fixture(file), &settings).unwrap().output;
        let stage = Stage::new(&scene, *density);
        let path = folder.join(scene_name);
        if name == "reference" {
            let [a, b] = stage.direct_halves(arguments[2].parse().unwrap(), 7).halves;
            let values: Vec<Rgb> = a.iter().zip(b).map(|(a, b)| (*a + b) * 0.5).collect();
            std::fs::write(
                &path,
                values.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect::<Vec<u8>>(),
            )
            .unwrap();
            continue;
        }
        let bytes = std::fs::read(&path).unwrap_or_default();
        let numbers: Vec<f32> = bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let reference: Vec<Rgb> = numbers.chunks(3).map(Rgb::from_slice).collect();
        for samples in &arguments[2..] {
            let start = cpu_seconds();
            let light = stage.direct_halves(samples.parse().unwrap(), 1);
            let seconds = cpu_seconds() - start;
            let [a, b] = &light.halves;
            let values: Vec<Rgb> = a.iter().zip(b).map(|(a, b)| (*a + *b) * 0.5).collect();
            let difference: Vec<Rgb> = a.iter().zip(b).map(|(a, b)| (*a - *b) * 0.5).collect();
            let estimated = (difference.iter().map(|d| f64::from(d.length_squared()) / 3.0).fold(0.0, |a, b| a + b)
                / values.len() as f64)
                .sqrt()
                / (values.iter().map(|v| f64::from(v.element_sum()) / 3.0).fold(0.0, |a, b| a + b)
                    / values.len() as f64);
            let rays = light.rays as f64 / values.len() as f64;
            if name == "dump" {
                std::fs::write(
                    folder.join(format!("{scene_name}-{samples}")),
                    values.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect::<Vec<u8>>(),
                )
                .unwrap();
            }
            let (all, relative) = if reference.is_empty() { (0.0, 0.0) } else { errors(&reference, &values) };
            println!(
                "{scene_name},{name},{samples},{},{rays:.1},{seconds:.2},{all:.5},{relative:.5},{estimated:.5}",
                values.len()
            );
        }
    }
}
