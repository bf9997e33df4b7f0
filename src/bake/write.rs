//! The last step of a bake: file contents, report, depfile, and all of them onto the disk together.

use super::clock::Clock;
use super::{Error, Outcome, Request, Solution, outputs};
use crate::atlas::Atlas;
use crate::base::{Warning, parallel};
use crate::finish::Lightmap;
use crate::output::directional::Texture;
use crate::output::{Files, atomic, depfile, exr, formats, gltf, names, png, report, usd};
use crate::patches::Patches;
use crate::scene::Scene;
use crate::seams::Steps;
use crate::settings::{Quantity, Settings, VertexAttribute};
use crate::trace::Tracer;
use crate::vertices::{Fit, VertexLight};
use glam::DVec3;
use std::path::PathBuf;

/// Name and version that outputs carry.
const GENERATOR: &str = concat!("texelwalk ", env!("CARGO_PKG_VERSION"));

/// Makes files of a page.
type Job<'a> = Box<dyn Fn() -> Result<Files, Error> + Send + Sync + 'a>;

/// What files are made from, besides light.
pub(super) struct Facts<'a> {
    pub(super) request: &'a Request,
    pub(super) tracer: &'a Tracer<'a>,
    pub(super) scene: &'a Scene,
    pub(super) atlas: &'a Atlas,
    pub(super) patches: &'a Patches,
}

/// What goes into files.
pub(super) struct Results {
    pub(super) lightmap: Lightmap,
    /// By name of the group of lights.
    pub(super) groups: Vec<(String, Lightmap)>,
    /// Light by normal, if it is asked for.
    pub(super) directional: Vec<(Texture, Lightmap)>,
    /// Layers by page.
    pub(super) aovs: Vec<Vec<exr::AovLayer>>,
    /// At the seams, before they were stitched and after.
    pub(super) steps: [Steps; 2],
    /// Light at vertices instead of pages, if that is the target.
    pub(super) vertices: Option<VertexLight>,
    /// Error of every front patch as a part of its light, if the HTML report is wanted.
    pub(super) noise: Vec<f32>,
}

impl Facts<'_> {
    pub(super) fn write(
        &self,
        solution: &Solution,
        results: Results,
        mut warnings: Vec<Warning>,
        clock: &mut Clock<'_>,
    ) -> Result<Outcome, Error> {
        let request = self.request;
        let inputs = request.inputs(self.scene);
        let (mut files, more) = clock.timed("encode", |_| self.encode(&results))??;
        warnings.extend(more);
        let pictures = match &request.html {
            Some(_) => clock.timed("pictures", |_| self.pictures(&results))??,
            None => None,
        };
        let outputs: Vec<PathBuf> = files.iter().map(|(path, _)| path).chain(&request.html).cloned().collect();
        let report = self.report(solution, &results, clock, [&outputs, &inputs], warnings);
        if let Some((path, pictures)) = request.html.clone().zip(pictures) {
            let html = self.html(&pictures, &report, &files);
            files.push((path, html.into()));
        }
        if let Some(path) = &request.report {
            files.push((path.clone(), report.to_json(path)?.into()));
        }
        if let Some(path) = &request.depfile {
            files.push((path.clone(), depfile::depfile(&outputs, &inputs)?.into_bytes().into()));
        }
        let progress = std::sync::Arc::clone(&clock.progress);
        clock.lasting("write", |_| {
            atomic::commit(&files, &inputs, request.placer.as_deref(), &|| progress.cancelled())
        })?;
        let files = files.into_iter().map(|(path, bytes)| (path, bytes.len() as u64)).collect();
        Ok(Outcome { report, files, lightmap: results.lightmap })
    }

    /// What is baked, then the document that refers to it.
    pub(super) fn encode(&self, results: &Results) -> Result<(Files, Vec<Warning>), Error> {
        match &results.vertices {
            None => self.encode_pages(results),
            Some(light) => self.encode_vertices(light),
        }
    }

    fn encode_vertices(&self, light: &VertexLight) -> Result<(Files, Vec<Warning>), Error> {
        let settings = &self.request.settings;
        let document = names::document_path(&self.request.input, &self.request.output);
        let wanted = settings.vertex_attribute.unwrap_or(VertexAttribute::Lightmap);
        let how = gltf::VertexSettings {
            common: gltf_settings(settings, document),
            attributes: gltf::Attributes {
                lightmap: wanted != VertexAttribute::Color0,
                color: wanted != VertexAttribute::Lightmap,
            },
            scale: settings.vertex_scale,
            unlit: settings.unlit,
        };
        let written = gltf::write_vertex_gltf(self.scene, light, &how)?;
        let mut warnings = written.warnings;
        let mut files = self.encode_usd(usd::Light::Vertices(light))?;
        files.extend(written.output);
        if !light.fit.reached {
            let (error, target) = (light.fit.error, settings.subdivide.unwrap_or_default());
            let message = format!(
                "the error of vertex light is {error:.4}, above --subdivide {target}: no triangle is \
                 large enough to be cut; use smaller texels"
            );
            warnings.push(Warning::new("subdivide-missed", message));
        }
        Ok((files, warnings))
    }

    /// Pages, previews, what else lies beside them, then the document.
    fn encode_pages(&self, results: &Results) -> Result<(Files, Vec<Warning>), Error> {
        let settings = &self.request.settings;
        let document = names::document_path(&self.request.input, &self.request.output);
        let plan = formats::Plan::new(&settings.format, settings.mips, &results.lightmap);
        let mut names = names::page_files(&document, self.atlas.pages);
        plan.name(&mut names, settings.exr_image);
        for page in &mut names {
            page.directional = results.directional.iter().map(|(t, _)| (*t, t.path(&page.exr))).collect();
        }
        let mut files = self.encode_images(results, &plan, &names)?;
        files.extend(self.encode_usd(usd::Light::Pages(self.atlas, &names))?);
        let how = gltf_settings(settings, document);
        let written = gltf::write_gltf(self.scene, self.atlas, &names, &how)?;
        files.extend(written.output);
        if settings.preview_gltf {
            files.extend(files.last().map(|(path, bytes)| gltf::preview(path, bytes)).transpose()?);
        }
        Ok((files, written.warnings))
    }

    /// All that lies on pages, several files at a time.
    fn encode_images(
        &self,
        results: &Results,
        plan: &formats::Plan,
        names: &[names::PageFiles],
    ) -> Result<Files, Error> {
        let attributes = &attributes(&self.request.settings);
        let mut jobs: Vec<Job<'_>> = vec![];
        for (page, name) in results.lightmap.pages.iter().zip(names) {
            jobs.push(Box::new(|| Ok(plan.encode(&name.exr, page, attributes)?)));
            jobs.push(Box::new(|| Ok(vec![(name.png.clone(), png::preview(&name.png, page)?.into())])));
        }
        for (k, page) in names.iter().enumerate() {
            for ((texture, path), (_, map)) in page.directional.iter().zip(&results.directional) {
                let of_texture = with(attributes, "texelwalk.directional", texture.name());
                let job = move || Ok(vec![(path.clone(), exr::lightmap(path, &map.pages[k], &of_texture)?.into())]);
                jobs.push(Box::new(job));
            }
        }
        for (paths, (name, map)) in self.group_paths(results).into_iter().zip(&results.groups) {
            for (path, page) in paths.into_iter().zip(&map.pages) {
                let of_group = with(attributes, "texelwalk.light_group", name);
                jobs.push(Box::new(move || Ok(plan.encode(&path, page, &of_group)?)));
            }
        }
        let document = names::document_path(&self.request.input, &self.request.output);
        let aovs = (0..).zip(&results.aovs).zip(&results.lightmap.pages);
        for ((k, layers), page) in aovs.filter(|((_, layers), _)| !layers.is_empty()) {
            let path = names::aov_file(&document, k);
            let size = [page.width, page.height];
            jobs.push(Box::new(move || {
                Ok(vec![(path.clone(), exr::aovs(&path, size, layers.clone(), attributes)?.into())])
            }));
        }
        let files: Result<Vec<Files>, Error> = parallel::map(jobs.len(), |k| jobs[k]()).into_iter().collect();
        Ok(files?.into_iter().flatten().collect())
    }

    /// The USD layers, if they are asked for.
    fn encode_usd(&self, light: usd::Light<'_>) -> Result<Files, Error> {
        let Some(output) = self.request.usd.clone() else { return Ok(vec![]) };
        let settings = &self.request.settings;
        let how = usd::Settings { quantity: quantity(settings.quantity), output, generator: GENERATOR.to_owned() };
        Ok(usd::write_usd(self.scene, light, &how)?)
    }

    /// EXR files of each group, by page.
    fn group_paths(&self, results: &Results) -> Vec<Vec<PathBuf>> {
        let document = names::document_path(&self.request.input, &self.request.output);
        let names: Vec<&str> = results.groups.iter().map(|(name, _)| name.as_str()).collect();
        outputs::group_paths(&document, &names, self.atlas.pages)
    }

    fn group_files(&self, results: &Results) -> Vec<report::LightGroup> {
        let in_all_formats =
            |page: &PathBuf| self.request.settings.format.iter().map(|f| f.path(page)).collect::<Vec<_>>();
        let one = |(paths, (name, _)): (Vec<PathBuf>, &(String, Lightmap))| report::LightGroup {
            name: name.clone(),
            files: paths.iter().flat_map(in_all_formats).map(|p| p.display().to_string()).collect(),
        };
        self.group_paths(results).into_iter().zip(&results.groups).map(one).collect()
    }

    fn directional_files(&self, results: &Results) -> Vec<report::DirectionalTexture> {
        let document = names::document_path(&self.request.input, &self.request.output);
        let pages = names::page_files(&document, self.atlas.pages);
        let one = |(texture, _): &(Texture, Lightmap)| report::DirectionalTexture {
            name: texture.name().to_owned(),
            files: pages.iter().map(|page| texture.path(&page.exr).display().to_string()).collect(),
        };
        results.directional.iter().map(one).collect()
    }

    fn report(
        &self,
        solution: &Solution,
        results: &Results,
        clock: &Clock<'_>,
        [outputs, inputs]: [&[PathBuf]; 2],
        warnings: Vec<Warning>,
    ) -> report::Report {
        let Facts { request, scene, atlas, patches, .. } = self;
        let text = |paths: &[PathBuf]| paths.iter().map(|p| p.display().to_string()).collect();
        let rays = solution.power.lines + solution.gather_rays + solution.shadow_rays;
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
                triangles: scene.triangle_count() as u64,
                instances: scene.parts.len() as u64,
                materials: scene.document.root.materials.len() as u64,
                lights: scene.lights.len() as u64,
            },
            atlas: report::AtlasCounts {
                pages: atlas.pages,
                page_size: atlas.page_size,
                charts: atlas.charts.len() as u64,
                texels: patches.front as u64,
                utilization: atlas.utilization(),
                mip_levels: atlas.mips,
            },
            treated: super::treated::facts(scene),
            contacts: request.settings.cut_contacts.then_some(report::Contacts {
                triangles_cut: scene.cuts.cut,
                triangles_made: scene.cuts.made,
                lines_continued: scene.cuts.continued,
            }),
            walk: solution.power,
            gather: report::Gather {
                rays: solution.gather_rays,
                rays_per_texel: solution.gather_rays as f64 / (patches.front as f64).max(1.0),
            },
            error: report::EstimatedError {
                estimated_nrmse: solution.estimated_nrmse(patches),
                estimated_nrmse_99: solution.estimated_nrmse_99(patches),
            },
            refinement: solution.refinement.clone(),
            seams: seams(&results.steps, scene.offset),
            light_groups: self.group_files(results),
            directional: self.directional_files(results),
            vertices: results.vertices.as_ref().map(|light| vertices(&light.fit)),
            rays,
            rays_per_second: rays as f64 / tracing_seconds.fold(0.0, |a, b| a + b).max(1e-9),
            stages: clock.stages.clone(),
            peak_memory_bytes: peak_memory_bytes(),
            warnings,
        }
    }
}

/// Attributes with one more.
fn with(attributes: &exr::Attributes, key: &str, value: &str) -> exr::Attributes {
    let mut attributes = attributes.clone();
    attributes.insert(key.to_owned(), value.to_owned());
    attributes
}

fn gltf_settings(settings: &Settings, output: PathBuf) -> gltf::Settings {
    gltf::Settings {
        quantity: quantity(settings.quantity),
        output,
        generator: GENERATOR.to_owned(),
        quantize_uv: settings.quantize_uv,
    }
}

fn seams([before, after]: &[Steps; 2], offset: DVec3) -> report::Seams {
    report::Seams {
        points: after.points,
        step_before: before.p999,
        step: after.p999,
        worst: after.worst,
        worst_at: (after.place.as_dvec3() + offset).as_vec3().to_array(),
    }
}

fn vertices(fit: &Fit) -> report::Vertices {
    report::Vertices {
        vertices: fit.vertices,
        unknowns: fit.unknowns,
        triangles: fit.triangles,
        fit_nrmse: fit.error,
        sampled_nrmse: fit.error_sampled,
        averaged_nrmse: fit.error_averaged,
    }
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

/// Largest resident set so far [bytes]; 0 where the system does not tell.
fn peak_memory_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.trim().trim_end_matches("kB").trim().parse::<u64>().ok()).unwrap_or(0) * 1024
}
