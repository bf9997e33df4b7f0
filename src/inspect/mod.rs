//! What would be baked: parts with their area and texels, lights, materials, memory, time, and what was odd.
//!
//! In: a document and bake settings. Out: [`Facts`], as a table or as JSON. Loads and charts, but looks for no
//! light; rays only tell how open charts smaller than a texel are.
//!
//! What a bake ignores, and why, is in the warnings: extensions, parts, animations, each with its place.

mod light;
mod surface;
mod table;
mod time;

pub use light::LightFacts;
pub use surface::{MaterialFacts, PartFacts};
pub use time::Time;

use crate::atlas;
use crate::bake::Error;
use crate::base::Warning;
use crate::light as lights;
use crate::memory::Estimate;
use crate::scene;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::trace::Tracer;
use std::path::Path;

/// Everything that `inspect` tells. The names are the keys of its JSON.
#[derive(Debug, serde::Serialize)]
pub struct Facts {
    /// The document.
    pub input: String,
    /// One entry per primitive as placed by a node.
    pub parts: Vec<PartFacts>,
    /// Triangles of all parts.
    pub triangles: usize,
    /// World area of all parts [m²].
    pub area: f64,
    /// Size of all surface along the axes [m].
    pub size: [f32; 3],
    /// Materials that parts use.
    pub materials: Vec<MaterialFacts>,
    /// Punctual lights, then the document's environment.
    pub lights: Vec<LightFacts>,
    /// Names of the variants of the materials.
    pub variants: Vec<String>,
    /// Names of the cameras by their number; `None` if it cannot be used.
    pub cameras: Vec<Option<String>>,
    /// Density that was reached [texels/m].
    pub texels_per_meter: f32,
    /// Lightmap pages.
    pub pages: u32,
    /// Width and height of the pages [texels].
    pub page_size: [u32; 2],
    /// Charts on all pages.
    pub charts: usize,
    /// Texels that charts cover.
    pub texels: u64,
    /// Covered part of the pages in [0, 1].
    pub utilization: f64,
    /// Memory that a bake with these settings takes.
    pub memory: Estimate,
    /// How long that bake takes on a machine of the kind that it was fitted on.
    pub time: Time,
    /// What was odd, and what is ignored.
    pub warnings: Vec<Warning>,
}

/// Looks at a document as `bake` would see it.
///
/// # Errors
/// As for `bake`, without writing.
pub fn inspect(input: &Path, settings: &Settings) -> Result<Facts, Error> {
    let how = scene::Settings {
        scene: settings.scene,
        sky: settings.sky(),
        rules: settings.rules.clone(),
        variant: settings.variant.clone(),
        instances: settings.scene_instances(),
        normal_maps: settings.normal_maps,
        albedo_density: Some(settings.texels_per_meter),
        ..scene::Settings::default()
    };
    let loaded = scene::load(input, &how)?;
    let scene = loaded.output;
    scene.own_colors()?;
    let how = settings.atlas();
    let tracer = Tracer::new(&scene);
    let charted = atlas::build(&tracer, &how)?;
    let atlas = charted.output;
    let memory = Estimate::new(&scene, &atlas, settings);
    let time = Time::new(&scene, &atlas, settings);
    let mut used: Vec<usize> = scene.parts.iter().map(|p| p.material).collect();
    used.sort_unstable();
    used.dedup();
    let materials: Vec<MaterialFacts> = used.iter().map(|&m| surface::material(&scene, m)).collect();
    let flux = lights::flux_of_parts(&scene);
    let layouts = atlas::existing_layouts(&scene, &how);
    let parts: Vec<PartFacts> = (layouts.into_iter().enumerate())
        .map(|(i, layout)| surface::part(&scene, &atlas, i, layout, flux[i]))
        .collect();
    Ok(Facts {
        input: input.display().to_string(),
        triangles: scene.triangle_count(),
        size: scene.extent().to_array(),
        area: parts.iter().map(|p| p.area).fold(0.0, |a, b| a + b),
        parts,
        materials,
        lights: (0..scene.lights.len()).map(|i| light::light(&scene, i)).chain(light::image(&scene)).collect(),
        variants: scene.document.root.variants().into_iter().map(str::to_owned).collect(),
        cameras: names_of_cameras(&scene),
        texels_per_meter: atlas.texels_per_meter,
        pages: atlas.pages,
        page_size: atlas.page_size,
        charts: atlas.charts.len(),
        texels: atlas.covered_texels,
        utilization: atlas.utilization(),
        memory,
        time,
        warnings: loaded
            .warnings
            .into_iter()
            .chain(charted.warnings)
            .chain(scene.missing_materials())
            .chain(scene.metals_by_default())
            .chain(scene.nothing_lit())
            .chain(scene.coarse_coordinates(atlas.texels_per_meter))
            .chain(lights::lost(&tracer, &lights::moved(&tracer)))
            .collect(),
    })
}

impl Facts {
    /// JSON with a final line break.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).map_or(String::new(), |s| s + "\n")
    }
}

fn names_of_cameras(scene: &Scene) -> Vec<Option<String>> {
    let count = scene.cameras.last().map_or(0, |last| last.number + 1);
    let mut names = vec![None; count];
    scene.cameras.iter().for_each(|camera| names[camera.number] = Some(camera.name.clone()));
    names
}
