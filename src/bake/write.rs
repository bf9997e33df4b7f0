//! The last step of a bake: file contents, report, depfile, and all of them onto the disk together.

use super::{Clock, Error, Outcome, Request, Solution};
use crate::atlas::Atlas;
use crate::base::{Warning, parallel};
use crate::finish::Lightmap;
use crate::output::{atomic, depfile, exr, gltf, names, png, report};
use crate::patches::Patches;
use crate::scene::Scene;
use crate::settings::{DirectMode, Quantity, Settings};
use crate::walk::Walk;
use std::path::PathBuf;

/// Name and version that outputs carry.
const GENERATOR: &str = concat!("texelwalk ", env!("CARGO_PKG_VERSION"));

/// What is known at the end.
pub(super) struct Facts<'a> {
    pub(super) scene: &'a Scene,
    pub(super) atlas: &'a Atlas,
    pub(super) patches: &'a Patches,
    pub(super) solution: &'a Solution,
    pub(super) warnings: Vec<Warning>,
}

type File = (PathBuf, Vec<u8>);

pub(super) fn write(
    request: &Request,
    facts: &Facts<'_>,
    lightmap: Lightmap,
    clock: &mut Clock<'_>,
) -> Result<Outcome, Error> {
    let inputs: Vec<PathBuf> = facts.scene.document.files_read.iter().chain(&request.also_read).cloned().collect();
    let (mut files, warnings) = clock.timed("encode", |_| encode(request, facts, &lightmap))??;
    let outputs: Vec<PathBuf> = files.iter().map(|(path, _)| path.clone()).collect();
    let report = report(request, facts, clock, &outputs, &inputs, warnings);
    if let Some(path) = &request.report {
        files.push((path.clone(), report.to_json(path)?));
    }
    if let Some(path) = &request.depfile {
        files.push((path.clone(), depfile::depfile(&outputs, &inputs)?.into_bytes()));
    }
    let progress = std::sync::Arc::clone(&clock.progress);
    clock.timed("write", |_| atomic::commit(&files, &inputs, &|| progress.cancelled()))??;
    let files = files.into_iter().map(|(path, bytes)| (path, bytes.len() as u64)).collect();
    Ok(Outcome { report, files, lightmap })
}

/// Pages, previews, then the document that refers to them.
fn encode(request: &Request, facts: &Facts<'_>, lightmap: &Lightmap) -> Result<(Vec<File>, Vec<Warning>), Error> {
    let document = names::document_path(&request.input, &request.output);
    let names = names::page_files(&document, facts.atlas.pages);
    let attributes = attributes(&request.settings);
    let mut files: Vec<File> = vec![];
    for (page, name) in lightmap.pages.iter().zip(&names) {
        files.push((name.exr.clone(), exr::lightmap(&name.exr, page, &attributes)?));
        files.push((name.png.clone(), png::preview(&name.png, page)?));
    }
    let how = gltf::Settings {
        quantity: quantity(request.settings.quantity),
        output: document,
        generator: GENERATOR.to_owned(),
    };
    let written = gltf::write_gltf(facts.scene, facts.atlas, &names, &how)?;
    files.extend(written.output);
    let mut warnings = facts.warnings.clone();
    warnings.extend(written.warnings);
    Ok((files, warnings))
}

fn quantity(quantity: Quantity) -> gltf::Quantity {
    match quantity {
        Quantity::Radiosity => gltf::Quantity::Radiosity,
        Quantity::Irradiance => gltf::Quantity::Irradiance,
    }
}

fn attributes(settings: &Settings) -> exr::Attributes {
    let (name, units) = match settings.quantity {
        Quantity::Radiosity => ("radiosity", "cd/m2 (E/pi)"),
        Quantity::Irradiance => ("irradiance", "lx"),
    };
    let all = serde_json::to_string(settings).unwrap_or_default();
    [
        ("texelwalk.version", env!("CARGO_PKG_VERSION")),
        ("texelwalk.quantity", name),
        ("texelwalk.units", units),
        ("texelwalk.settings", all.as_str()),
    ]
    .into_iter()
    .map(|(k, v)| (k.to_owned(), v.to_owned()))
    .collect()
}

fn report(
    request: &Request,
    facts: &Facts<'_>,
    clock: &Clock<'_>,
    outputs: &[PathBuf],
    inputs: &[PathBuf],
    warnings: Vec<Warning>,
) -> report::Report {
    let Facts { scene, atlas, patches, solution, .. } = facts;
    let text = |paths: &[PathBuf]| paths.iter().map(|p| p.display().to_string()).collect();
    let lines: u64 = solution.walks.iter().flat_map(|w| &w.ledger).map(|b| b.lines).sum();
    let rays = lines + solution.gather_rays + solution.shadow_rays;
    let tracing = |s: &&report::Stage| ["direct", "walk", "gather"].contains(&s.name.as_str());
    let tracing_seconds = clock.stages.iter().filter(tracing).map(|s| s.seconds);
    report::Report {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        schema: report::SCHEMA,
        inputs: text(inputs),
        outputs: text(outputs),
        settings: match serde_json::to_value(&request.settings) {
            Ok(serde_json::Value::Object(map)) => map,
            _ => serde_json::Map::new(),
        },
        scene: report::SceneCounts {
            triangles: scene.triangles.len() as u64,
            instances: scene.parts.len() as u64,
            materials: scene.materials.len() as u64,
            lights: scene.lights.len() as u64,
        },
        atlas: report::AtlasCounts {
            pages: atlas.pages,
            page_size: atlas.page_size,
            charts: atlas.charts.len() as u64,
            texels: patches.front as u64,
            utilization: atlas.utilization(),
        },
        walk: walk(request, solution, lines),
        gather: report::Gather {
            rays: solution.gather_rays,
            rays_per_texel: solution.gather_rays as f64 / (patches.front as f64).max(1.0),
        },
        error: report::EstimatedError { estimated_nrmse: estimated_nrmse(patches, solution) },
        rays,
        rays_per_second: rays as f64 / tracing_seconds.fold(0.0, |a, b| a + b).max(1e-9),
        stages: clock.stages.clone(),
        peak_memory_bytes: peak_memory_bytes(),
        warnings,
    }
}

/// Both halves' ledgers, as the mean of two estimates of the same powers.
fn walk(request: &Request, solution: &Solution, lines: u64) -> report::Walk {
    let mean = |f: &dyn Fn(&Walk, usize) -> f64| {
        [0, 1, 2].map(|c| 0.5 * (f(&solution.walks[0], c) + f(&solution.walks[1], c)))
    };
    let shoots = request.settings.direct == DirectMode::Shoot;
    // Escaped lines of the emitters never were on a surface, so they are no part of the balance.
    let after = usize::from(shoots);
    let escaped = mean(&|w, c| w.ledger.iter().skip(after).map(|b| b.escaped[c] + b.culled[c]).fold(0.0, |a, b| a + b));
    let residual = mean(&|w, c| w.ledger.last().map_or(0.0, |b| b.unshot[c]));
    let received = mean(&|w, c| w.ledger.iter().skip(after).map(|b| b.received[c]).fold(0.0, |a, b| a + b));
    let reflected = mean(&|w, c| w.ledger.iter().skip(after).map(|b| b.unshot[c]).fold(0.0, |a, b| a + b));
    report::Walk {
        lines,
        bounces: solution.walks.iter().map(|w| w.ledger.len().saturating_sub(1 + after) as u32).max().unwrap_or(0),
        power_in: solution.power_in,
        power_absorbed: [0, 1, 2].map(|c| solution.power_in[c] + received[c] - reflected[c]),
        power_escaped: escaped,
        power_residual: residual,
    }
}

/// Root mean square of the error over the mean, all channels and covered texels alike: noise of direct light, walk and
/// gather, and bias of sharing.
fn estimated_nrmse(patches: &Patches, solution: &Solution) -> Option<f64> {
    let total = parallel::sum(patches.front, |i| f64::from(solution.irradiance(i).element_sum()));
    let n = 3.0 * patches.front as f64;
    (total > 0.0).then(|| (solution.squared_error / n).sqrt() / (total / n))
}

/// Largest resident set so far [bytes]; 0 where the system does not tell.
fn peak_memory_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.trim().trim_end_matches("kB").trim().parse::<u64>().ok()).unwrap_or(0) * 1024
}
