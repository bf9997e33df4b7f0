//! What would be baked: parts with their area and texels, lights, materials, and what was odd.
//!
//! In: a document and bake settings. Out: [`Facts`], as a table or as JSON. Loads and charts, but traces no ray.

use crate::atlas::{self, Atlas, NO_CHART};
use crate::bake::Error;
use crate::base::Warning;
use crate::scene::{self, Alpha, Light, Scene};
use crate::settings::Settings;
use std::fmt::Write;
use std::path::Path;

/// Everything that `inspect` tells. The names are the keys of its JSON.
#[derive(Debug, serde::Serialize)]
pub struct Facts {
    /// The document.
    pub input: String,
    /// One entry per primitive as placed by a node.
    pub parts: Vec<PartFacts>,
    /// Materials that parts use.
    pub materials: Vec<MaterialFacts>,
    /// Punctual lights.
    pub lights: Vec<String>,
    /// Names of the variants of the materials.
    pub variants: Vec<String>,
    /// Names of the cameras.
    pub cameras: Vec<String>,
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
    /// What was odd.
    pub warnings: Vec<Warning>,
}

/// One primitive as placed by one node.
#[derive(Debug, serde::Serialize)]
pub struct PartFacts {
    /// Name of the node.
    pub node: String,
    /// Index of the mesh and of the primitive in it.
    pub mesh: [usize; 2],
    /// Triangles.
    pub triangles: usize,
    /// World area [m²].
    pub area: f64,
    /// Charts.
    pub charts: usize,
    /// Name of the material.
    pub material: String,
    /// Which UVs: `kept`, `charted`, or `none` for what receives no light.
    pub uv: &'static str,
    /// Factor of the texels per metre, by rules or `extras`.
    pub density: f32,
    /// It gets a lightmap.
    pub receives: bool,
    /// Others are lit as if it were there.
    pub casts: bool,
    /// Factor of the light that it emits.
    pub emission: f32,
    /// Group of what it emits, if that has a name.
    pub light_group: Option<String>,
}

/// One material as light sees it.
#[derive(Debug, serde::Serialize)]
pub struct MaterialFacts {
    /// Its name.
    pub name: String,
    /// Factor of the diffuse reflectance, textures left out.
    pub reflectance: [f32; 3],
    /// Emitted radiance, textures left out [cd/m²].
    pub emission: [f32; 3],
    /// Both sides are lit.
    pub double_sided: bool,
    /// `opaque`, `mask` or `blend`.
    pub alpha: &'static str,
    /// Blocks light and receives none.
    pub unlit: bool,
}

/// Looks at a document as `bake` would see it.
///
/// # Errors
/// As for `bake`, without writing.
pub fn inspect(input: &Path, settings: &Settings) -> Result<Facts, Error> {
    let (sky, rules, variant) = (settings.sky(), settings.rules.clone(), settings.variant.clone());
    let how = scene::Settings {
        scene: settings.scene,
        sky,
        rules,
        variant,
        instances: settings.scene_instances(),
        ..scene::Settings::default()
    };
    let loaded = scene::load(input, &how)?;
    let scene = loaded.output;
    let charted = atlas::build(
        &scene,
        &atlas::Settings {
            texels_per_meter: settings.texels_per_meter,
            page_size: settings.page_size,
            max_pages: settings.max_pages,
            padding: settings.padding,
            mips: settings.mips,
            uv: settings.atlas_uv(),
            ..atlas::Settings::default()
        },
    )?;
    let atlas = charted.output;
    let mut used: Vec<usize> = scene.parts.iter().map(|p| p.material).collect();
    used.sort_unstable();
    used.dedup();
    Ok(Facts {
        input: input.display().to_string(),
        parts: (0..scene.parts.len()).map(|i| part(&scene, &atlas, i)).collect(),
        materials: used.into_iter().map(|m| material(&scene, m)).collect(),
        lights: (0..scene.lights.len()).map(|i| light(&scene, i)).chain(image_light(&scene)).collect(),
        variants: scene.document.root.variants().into_iter().map(str::to_owned).collect(),
        cameras: scene.cameras.iter().map(|c| c.name.clone()).collect(),
        texels_per_meter: atlas.texels_per_meter,
        pages: atlas.pages,
        page_size: atlas.page_size,
        charts: atlas.charts.len(),
        texels: atlas.covered_texels,
        utilization: atlas.utilization(),
        warnings: loaded.warnings.into_iter().chain(charted.warnings).collect(),
    })
}

fn part(scene: &Scene, atlas: &Atlas, index: usize) -> PartFacts {
    let (part, charted) = (&scene.parts[index], &atlas.parts[index]);
    let mut charts: Vec<u32> = charted.chart.iter().copied().filter(|&c| c != NO_CHART).collect();
    charts.sort_unstable();
    charts.dedup();
    PartFacts {
        node: part.name.clone(),
        mesh: [part.mesh, part.primitive],
        triangles: part.triangles.len(),
        area: part.triangles.clone().map(|t| scene.area(t)).fold(0.0, |a, b| a + b),
        charts: charts.len(),
        material: scene.materials[part.material].name.clone(),
        uv: match (part.receives, charted.kept) {
            (false, _) => "none",
            (true, true) => "kept",
            (true, false) => "charted",
        },
        density: part.treatment.density,
        receives: part.receives,
        casts: part.treatment.casts,
        emission: part.treatment.emission,
        light_group: scene.groups.parts.get(index).cloned().flatten(),
    }
}

impl PartFacts {
    /// What is not as usual, as words to put behind a row.
    fn notes(&self) -> String {
        let mut notes = vec![];
        if self.density != 1.0 {
            notes.push(format!("density ×{}", self.density));
        }
        if !self.casts {
            notes.push("casts no light".to_owned());
        }
        if self.emission != 1.0 {
            notes.push(format!("emission ×{}", self.emission));
        }
        notes.extend(self.light_group.iter().map(|group| format!("group {group}")));
        if notes.is_empty() { String::new() } else { format!("  [{}]", notes.join(", ")) }
    }
}

fn material(scene: &Scene, index: usize) -> MaterialFacts {
    let m = &scene.materials[index];
    MaterialFacts {
        name: m.name.clone(),
        reflectance: (m.base_color.truncate() * ((1.0 - m.metallic) * (1.0 - m.transmission))).to_array(),
        emission: m.emission.to_array(),
        double_sided: m.double_sided,
        alpha: match m.alpha {
            Alpha::Opaque => "opaque",
            Alpha::Mask(_) => "mask",
            Alpha::Blend => "blend",
        },
        unlit: m.unlit,
    }
}

fn light(scene: &Scene, index: usize) -> String {
    let group = scene.groups.lights.get(index).and_then(Option::as_ref);
    let group = group.map_or(String::new(), |name| format!(", group {name}"));
    let what = match &scene.lights[index] {
        Light::Sun { illuminance: i, .. } => format!("sun {:.3} {:.3} {:.3} lx", i.x, i.y, i.z),
        Light::Point { intensity: i, .. } => format!("point {:.3} {:.3} {:.3} cd", i.x, i.y, i.z),
        Light::Spot { intensity: i, .. } => format!("spot {:.3} {:.3} {:.3} cd", i.x, i.y, i.z),
        Light::Profiled { factor, profile, .. } => {
            let [i, flux] = [profile.peak(), profile.flux()].map(|of| *factor * of);
            format!("lamp {:.3} {:.3} {:.3} cd at most, {:.3} {:.3} {:.3} lm", i.x, i.y, i.z, flux.x, flux.y, flux.z)
        }
    };
    what + &group
}

/// The light of the document's own environment.
fn image_light(scene: &Scene) -> Option<String> {
    let map = scene.environment.as_ref()?;
    let mean = map.total() / (4.0 * core::f32::consts::PI);
    Some(format!("image-based {:.3} {:.3} {:.3} cd/m2 in mean", mean.x, mean.y, mean.z))
}

impl Facts {
    /// JSON with a final line break.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).map_or(String::new(), |s| s + "\n")
    }

    /// Tables for people.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut out = String::new();
        let _ = self.write_tables(&mut out);
        out
    }

    fn write_tables(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "{}", self.input)?;
        writeln!(out, "\n{:<28} {:>10} {:>10} {:>7}  {:<8} material", "node", "triangles", "area m2", "charts", "uv")?;
        for p in &self.parts {
            let row = (&p.node, p.triangles, p.area, p.charts, p.uv, &p.material);
            writeln!(
                out,
                "{:<28} {:>10} {:>10.3} {:>7}  {:<8} {}{}",
                row.0,
                row.1,
                row.2,
                row.3,
                row.4,
                row.5,
                p.notes()
            )?;
        }
        writeln!(out, "\n{:<28} {:<20} {:<20} alpha", "material", "reflectance", "emission cd/m2")?;
        let triple = |v: [f32; 3]| format!("{:.3} {:.3} {:.3}", v[0], v[1], v[2]);
        for m in &self.materials {
            let mut notes = m.alpha.to_owned();
            for (set, word) in [(m.double_sided, ", double-sided"), (m.unlit, ", unlit")] {
                notes += if set { word } else { "" };
            }
            writeln!(out, "{:<28} {:<20} {:<20} {notes}", m.name, triple(m.reflectance), triple(m.emission))?;
        }
        for l in &self.lights {
            writeln!(out, "light: {l}")?;
        }
        for v in &self.variants {
            writeln!(out, "variant: {v}")?;
        }
        for (i, c) in self.cameras.iter().enumerate() {
            writeln!(out, "camera {i}: {c}")?;
        }
        let used = self.utilization * 100.0;
        let [width, height] = self.page_size;
        writeln!(
            out,
            "\n{} texels in {} charts on {} page(s) of {width}x{height} ({used:.0} % used) at {} texels/m",
            self.texels, self.charts, self.pages, self.texels_per_meter
        )?;
        for w in &self.warnings {
            let node = w.node.as_ref().map_or(String::new(), |n| format!(" [{n}]"));
            writeln!(out, "warning: {}{node}: {}", w.code, w.message)?;
        }
        Ok(())
    }
}
