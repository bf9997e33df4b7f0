//! What the options of `bake` mean: presets, configuration files, defaults, checks.
//!
//! An option is looked for on the command line, then in `--config`, then in the preset (`production` unless another is
//! named). The presets are the files in `pipelines/presets`; their keys and those of a configuration file are the long
//! option names.

mod alternatives;
mod choices;
mod color;
mod directional;
mod formats;
mod instances;
mod memory;
mod rules;
mod target;

pub use choices::{Aov, DirectMode, Directional, Preset, Quantity, SplatMode, Target, UvMode, VertexAttribute};
pub use instances::InstancesMode;
pub use memory::ByteCount;

use crate::atlas::MOST_MIPS;
use crate::base::Rgb;
use crate::output::formats::Format;
use crate::scene::{Rule, Sky};
use color::parse_color;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// Options of `bake` that a preset or a configuration file may hold.
#[derive(Debug, Clone, Default, clap::Args, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Options {
    /// Lightmap texels per metre, in world space
    #[arg(long, value_name = "X", help_heading = "Lightmap", conflicts_with = "texel_size")]
    pub texels_per_meter: Option<f32>,
    /// Edge of a texel in metres; the same as --texels-per-meter 1/M
    #[arg(long, value_name = "M", help_heading = "Lightmap")]
    pub texel_size: Option<f32>,
    /// Largest side of a lightmap page in texels
    #[arg(long, value_name = "PX", help_heading = "Lightmap")]
    pub page_size: Option<u32>,
    /// Most pages; the density is lowered until everything fits
    #[arg(long, value_name = "N", help_heading = "Lightmap")]
    pub max_pages: Option<u32>,
    /// Empty texels between charts, filled by dilation
    #[arg(long, value_name = "PX", help_heading = "Lightmap")]
    pub padding: Option<u32>,
    /// Mip levels in which charts do not mix, by squares of 2^N texels that belong to one chart alone; 2 and more do the
    /// same for 4 × 4 blocks, and --format ktx2 asks for 2
    #[arg(long, value_name = "N", help_heading = "Lightmap")]
    pub mips: Option<u32>,
    /// Which lightmap UVs to use
    #[arg(long, value_enum, value_name = "MODE", help_heading = "Lightmap")]
    pub uv: Option<UvMode>,
    /// What meshes get that several nodes place
    #[arg(long, value_enum, value_name = "MODE", help_heading = "Lightmap")]
    pub instances: Option<InstancesMode>,
    /// Cut triangles, and charts, along the lines where other surfaces meet them, so that walls thinner than two texels
    /// are tight; adds vertices [default: false]
    #[arg(
        long,
        value_name = "BOOL",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "true",
        help_heading = "Lightmap"
    )]
    pub cut_contacts: Option<bool>,
    /// What a texel holds
    #[arg(long, value_enum, value_name = "QUANTITY", help_heading = "Lightmap")]
    pub quantity: Option<Quantity>,
    /// Files for every page, with commas; the glTF names the first as the lightmap and lists all with their decoding
    /// [default: exr]
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',', help_heading = "Lightmap")]
    pub format: Option<Vec<Format>>,
    /// List the EXR among the glTF's images too, behind `EXT_texture_exr` (not a registered extension; Rust's gltf crate
    /// refuses such files) [default: false]
    #[arg(
        long,
        value_name = "BOOL",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "true",
        help_heading = "Lightmap"
    )]
    pub exr_image: Option<bool>,
    /// Write a second document, NAME.preview.gltf or .glb, that shows the EXR as unlit base colour; for Blender and other
    /// loaders of EXR images that know no lightmaps [default: false]
    #[arg(
        long,
        value_name = "BOOL",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "true",
        help_heading = "Lightmap"
    )]
    pub preview_gltf: Option<bool>,
    /// Further layers for every page, in NAME.aov0.exr, with commas
    #[arg(long, value_enum, value_name = "LIST", value_delimiter = ',', help_heading = "Lightmap")]
    pub aov: Option<Vec<Aov>>,
    /// How far --aov ao and bent look, in metres; inf has no limit [default: 1]
    #[arg(long, value_name = "M", help_heading = "Lightmap")]
    pub ao_distance: Option<f32>,
    /// Pages that tell how the light changes with the normal, for normal maps; besides the lightmap [default: none]
    #[arg(long, value_enum, value_name = "MODE", help_heading = "Lightmap")]
    pub directional: Option<Directional>,
    /// A lightmap for each group of lights, NAME.lightmap-GROUP0.exr, besides their sum; as many times the work
    /// [default: false]
    #[arg(
        long,
        value_name = "BOOL",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "true",
        help_heading = "Lightmap"
    )]
    pub light_groups: Option<bool>,
    /// Write lightmap coordinates as normalised 16-bit integers, half their bytes [default: false]
    #[arg(
        long,
        value_name = "BOOL",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "true",
        help_heading = "Lightmap"
    )]
    pub quantize_uv: Option<bool>,

    /// Bake to pictures, or to the vertices of the meshes [default: lightmap]
    #[arg(long, value_enum, value_name = "TARGET", help_heading = "Vertices")]
    pub target: Option<Target>,
    /// Cut triangles until the error of light that is linear over them is at most X of the mean, for example 0.05
    #[arg(long, value_name = "X", help_heading = "Vertices")]
    pub subdivide: Option<f64>,
    /// Which attribute carries the light [default: lightmap]
    #[arg(long, value_enum, value_name = "NAME", help_heading = "Vertices")]
    pub vertex_attribute: Option<VertexAttribute>,
    /// Light that a `COLOR_0` of 1 stands for, in cd/m² [default: the largest there is]
    #[arg(long, value_name = "X", help_heading = "Vertices")]
    pub vertex_scale: Option<f32>,
    /// Make materials unlit, so that any viewer shows base colour times `COLOR_0` [default: false]
    #[arg(
        long,
        value_name = "BOOL",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "true",
        help_heading = "Vertices"
    )]
    pub unlit: Option<bool>,

    /// What a line of the walk does at its hit
    #[arg(long, value_enum, value_name = "MODE", help_heading = "Solver")]
    pub splat: Option<SplatMode>,
    /// --splat paper: uncertainty in bits where splatting starts
    #[arg(long, value_name = "BITS", help_heading = "Solver")]
    pub alpha: Option<f32>,
    /// --splat paper: uncertainty in bits from which everything is splatted
    #[arg(long, value_name = "BITS", help_heading = "Solver")]
    pub beta: Option<f32>,
    /// How direct light is found
    #[arg(long, value_enum, value_name = "MODE", help_heading = "Solver")]
    pub direct: Option<DirectMode>,
    /// Normal maps bend the normals that light falls on, for engines that show the lightmap without them [default: false]
    #[arg(
        long,
        value_name = "BOOL",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "true",
        help_heading = "Solver"
    )]
    pub normal_maps: Option<bool>,
    /// Shadow rays per texel to lights and surfaces, to sky and environment, and to each sun with a size; more in
    /// penumbrae
    #[arg(long, value_name = "N", help_heading = "Solver")]
    pub direct_samples: Option<u32>,
    /// Lines of the walk over all bounces
    #[arg(long, value_name = "N", help_heading = "Solver", conflicts_with = "lines_per_texel")]
    pub lines: Option<u64>,
    /// Lines of the walk per texel
    #[arg(long, value_name = "X", help_heading = "Solver")]
    pub lines_per_texel: Option<f64>,
    /// Final-gather rays per texel; 0 = the walk alone
    #[arg(long, value_name = "N", help_heading = "Solver")]
    pub gather: Option<u32>,
    /// Most bounces of reflected light; without it, until what is left is negligible
    #[arg(long, value_name = "N", help_heading = "Solver")]
    pub bounces: Option<u32>,
    /// Refine until the estimated relative error is X, for example 0.02; the budget above only sets the proportions
    #[arg(long, value_name = "X", help_heading = "Solver")]
    pub target_error: Option<f64>,
    /// Refine until S seconds have passed since the start, or until --target-error; the result then depends on the
    /// machine
    #[arg(long, value_name = "S", help_heading = "Solver")]
    pub time_limit: Option<f64>,
    /// Chooses the random numbers
    #[arg(long, value_name = "N", help_heading = "Solver")]
    pub seed: Option<u64>,

    /// Scene of the document to bake; its default scene otherwise
    #[arg(long, value_name = "N", help_heading = "Scene")]
    pub scene: Option<usize>,
    /// Variant of the materials to bake (`KHR_materials_variants`); those of the primitives themselves otherwise
    #[arg(long, value_name = "NAME", help_heading = "Scene")]
    pub variant: Option<String>,
    /// Radiance of the sky in cd/m², as R,G,B or one number; world +y is up
    #[arg(long, value_name = "R,G,B", value_parser = parse_color, help_heading = "Scene")]
    #[serde(default, deserialize_with = "color::read")]
    pub sky: Option<[f32; 3]>,
    /// Radiance at the horizon; the sky is a gradient up to --sky at the zenith
    #[arg(long, value_name = "R,G,B", value_parser = parse_color, help_heading = "Scene")]
    #[serde(default, deserialize_with = "color::read")]
    pub sky_horizon: Option<[f32; 3]>,
    /// Radiance from below the horizon [default: as the horizon]
    #[arg(long, value_name = "R,G,B", value_parser = parse_color, help_heading = "Scene")]
    #[serde(default, deserialize_with = "color::read")]
    pub sky_ground: Option<[f32; 3]>,
    /// Angular diameter of every sun in degrees (the real one: 0.53) [default: what the document says, else 0]
    #[arg(long, value_name = "DEGREES", help_heading = "Scene")]
    pub sun_angle: Option<f32>,
    /// Radius of every point and spot light in metres [default: what the document says, else 0]
    #[arg(long, value_name = "M", help_heading = "Scene")]
    pub light_radius: Option<f32>,
    /// Equirectangular picture of what is far away, added to the sky: Radiance HDR or OpenEXR, middle column at +x, in
    /// cd/m²
    #[arg(long, value_name = "FILE", help_heading = "Scene")]
    pub environment: Option<PathBuf>,
    /// Factor of the environment's radiance [default: 1]
    #[arg(long, value_name = "X", help_heading = "Scene")]
    pub environment_intensity: Option<f32>,
    /// Rotation of the environment around +y, counter-clockwise from above [default: 0]
    #[arg(long, value_name = "DEGREES", help_heading = "Scene")]
    pub environment_rotation: Option<f32>,

    /// Worker threads; the result never depends on it [default: all CPUs]
    #[arg(long, value_name = "N", help_heading = "Run")]
    pub threads: Option<usize>,
    /// Refuse a bake that would need more memory than this, before it is needed: 500MB, 8GiB [default: what
    /// the machine, or the container, has]
    #[arg(long, value_name = "SIZE", help_heading = "Run")]
    pub memory_limit: Option<ByteCount>,
    /// What to do otherwise with what has certain names; later rules win. Not on the command line.
    #[arg(skip)]
    pub rules: Option<Vec<Rule>>,
}

/// Settings of a bake, complete and checked.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Settings {
    /// Density [texels/m].
    pub texels_per_meter: f32,
    /// Largest page side [texels].
    pub page_size: u32,
    /// Most pages.
    pub max_pages: Option<u32>,
    /// Empty texels between charts.
    pub padding: u32,
    /// Mip levels in which charts do not mix.
    pub mips: u32,
    /// Which UVs.
    pub uv: UvMode,
    /// What meshes get that several nodes place.
    #[serde(skip_serializing_if = "InstancesMode::is_unique")]
    pub instances: InstancesMode,
    /// Triangles are cut where other surfaces meet them.
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub cut_contacts: bool,
    /// What a texel holds.
    pub quantity: Quantity,
    /// Files of every page, each once; the first is the lightmap of the glTF.
    #[serde(skip_serializing_if = "formats::exr_alone")]
    pub format: Vec<Format>,
    /// The EXR is among the glTF's images.
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub exr_image: bool,
    /// A document that shows the EXR as base colour.
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub preview_gltf: bool,
    /// Further layers, each once.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub aov: Vec<Aov>,
    /// How far `ao` and `bent` look [m]; without it, [`Settings::AO_DISTANCE`]. JSON has no infinity and says null.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ao_distance: Option<f32>,
    /// Light by normal.
    #[serde(skip_serializing_if = "Directional::is_none")]
    pub directional: Directional,
    /// A lightmap per group of lights.
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub light_groups: bool,
    /// Lightmap coordinates have 16 bits.
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub quantize_uv: bool,
    /// What is baked to.
    #[serde(skip_serializing_if = "Target::is_lightmap")]
    pub target: Target,
    /// Error to cut triangles to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub subdivide: Option<f64>,
    /// Which vertex attribute carries the light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertex_attribute: Option<VertexAttribute>,
    /// Light of a `COLOR_0` of 1 [cd/m²].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vertex_scale: Option<f32>,
    /// Materials become unlit.
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub unlit: bool,
    /// What a line does at its hit.
    pub splat: SplatMode,
    /// The paper's α [bit].
    pub alpha: f32,
    /// The paper's β [bit].
    pub beta: f32,
    /// How direct light is found.
    pub direct: DirectMode,
    /// Normal maps bend the normals that light falls on.
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub normal_maps: bool,
    /// Shadow rays per texel and kind of light.
    pub direct_samples: u32,
    /// Lines of the walk; overrides `lines_per_texel`.
    pub lines: Option<u64>,
    /// Lines of the walk per texel.
    pub lines_per_texel: f64,
    /// Final-gather rays per texel.
    pub gather: u32,
    /// Most bounces.
    pub bounces: Option<u32>,
    /// Estimated error at which to stop refining.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_error: Option<f64>,
    /// Seconds of the whole bake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_limit: Option<f64>,
    /// Chooses the random numbers.
    pub seed: u64,
    /// Scene of the document.
    pub scene: Option<usize>,
    /// Name of the variant of the materials.
    pub variant: Option<String>,
    /// Radiance of the sky: zenith, horizon, ground [cd/m²].
    pub sky: [[f32; 3]; 3],
    /// Angular diameter of the suns [degrees].
    pub sun_angle: Option<f32>,
    /// Radius of point and spot lights [m].
    pub light_radius: Option<f32>,
    /// Environment map.
    pub environment: Option<PathBuf>,
    /// Factor of its radiance.
    pub environment_intensity: f32,
    /// Its rotation [degrees].
    pub environment_rotation: f32,
    /// What to do otherwise with what has certain names.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rules: Vec<Rule>,
    /// Most memory that may be needed [bytes]; no output depends on it.
    #[serde(skip)]
    pub memory_limit: Option<u64>,
}

/// An option that cannot be used, and why.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Invalid(String);

macro_rules! or_else {
    ($a:expr, $b:expr, $($field:ident),+) => { Options { $($field: $a.$field.or($b.$field)),+ } };
}

impl Options {
    /// The options of a preset.
    ///
    /// # Errors
    /// Never for the files that ship; a test reads all of them.
    pub fn preset(preset: Preset) -> Result<Self, Invalid> {
        Self::from_toml(preset.text())
    }

    /// The options of a configuration file's text.
    ///
    /// # Errors
    /// If it is not TOML, a key or value is unknown (the message has the line), or two keys say the same.
    pub fn from_toml(text: &str) -> Result<Self, Invalid> {
        let options: Self = toml::from_str(text).map_err(|e| Invalid(e.to_string()))?;
        options.check_alternatives()?;
        Ok(options)
    }

    /// These options, and those of `below` where these have none. An option and its alternative count as one.
    #[must_use]
    pub fn over(self, mut below: Self) -> Self {
        if self.texel_size.is_some() || self.texels_per_meter.is_some() {
            (below.texel_size, below.texels_per_meter) = (None, None);
        }
        if self.lines.is_some() || self.lines_per_texel.is_some() {
            (below.lines, below.lines_per_texel) = (None, None);
        }
        or_else!(
            self,
            below,
            texels_per_meter,
            texel_size,
            page_size,
            max_pages,
            padding,
            mips,
            uv,
            instances,
            cut_contacts,
            quantity,
            format,
            exr_image,
            preview_gltf,
            aov,
            ao_distance,
            directional,
            light_groups,
            quantize_uv,
            target,
            subdivide,
            vertex_attribute,
            vertex_scale,
            unlit,
            splat,
            alpha,
            beta,
            direct,
            normal_maps,
            direct_samples,
            lines,
            lines_per_texel,
            gather,
            bounces,
            target_error,
            time_limit,
            seed,
            scene,
            variant,
            sky,
            sky_horizon,
            sky_ground,
            sun_angle,
            light_radius,
            environment,
            environment_intensity,
            environment_rotation,
            threads,
            memory_limit,
            rules
        )
    }

    /// Checks every value and fills the gaps that no preset fills.
    ///
    /// # Errors
    /// If a value is out of its range; the message names the option and the range.
    pub fn settings(&self) -> Result<Settings, Invalid> {
        let density = self.texel_size.map(|m| 1.0 / m).or(self.texels_per_meter).unwrap_or(16.0);
        self.threads.map_or(Ok(1), |n| within("--threads", n, 1, MOST_THREADS))?;
        let zenith = self.sky.unwrap_or([0.0; 3]);
        let horizon = self.sky_horizon.unwrap_or(zenith);
        let settings = Settings {
            texels_per_meter: within("--texels-per-meter", density, 1e-4, 1e5)?,
            page_size: within("--page-size", self.page_size.unwrap_or(2048), 16, 16_384)?,
            max_pages: self.max_pages.map(|n| within("--max-pages", n, 1, 4096)).transpose()?,
            padding: within("--padding", self.padding.unwrap_or(2), 0, 64)?,
            mips: within("--mips", self.mips.unwrap_or(0), 0, MOST_MIPS)?.max(self.least_mips()),
            uv: self.uv.unwrap_or(UvMode::Auto),
            instances: self.instances(),
            cut_contacts: self.cut_contacts.unwrap_or(false),
            quantity: self.quantity.unwrap_or(Quantity::Radiosity),
            format: self.formats()?,
            exr_image: self.exr_image.unwrap_or(false),
            preview_gltf: self.preview_gltf.unwrap_or(false),
            aov: self.aov.iter().flatten().copied().collect::<BTreeSet<_>>().into_iter().collect(),
            ao_distance: self.ao_distance.map(|m| within("--ao-distance", m, 1e-6, f32::INFINITY)).transpose()?,
            directional: self.directional.unwrap_or(Directional::None),
            light_groups: self.light_groups.unwrap_or(false),
            quantize_uv: self.quantize_uv.unwrap_or(false),
            target: self.target.unwrap_or(Target::Lightmap),
            subdivide: self.subdivide.map(|x| positive("--subdivide", x)).transpose()?,
            vertex_attribute: self.vertex_attribute,
            vertex_scale: self.vertex_scale.map(|x| within("--vertex-scale", x, 1e-6, 1e9)).transpose()?,
            unlit: self.unlit.unwrap_or(false),
            splat: self.splat.unwrap_or(SplatMode::Share),
            alpha: within("--alpha", self.alpha.unwrap_or(5.0), 0.0, 100.0)?,
            beta: within("--beta", self.beta.unwrap_or(15.0), 0.0, 100.0)?,
            direct: self.direct.unwrap_or(DirectMode::Gather),
            normal_maps: self.normal_maps.unwrap_or(false),
            direct_samples: within("--direct-samples", self.direct_samples.unwrap_or(16), 1, 65_536)?,
            lines: self.lines.map(|n| within("--lines", n, 1, 1 << 32)).transpose()?,
            lines_per_texel: within("--lines-per-texel", self.lines_per_texel.unwrap_or(32.0), 1e-3, 1e6)?,
            gather: within("--gather", self.gather.unwrap_or(64), 0, 1 << 20)?,
            bounces: self.bounces,
            target_error: self.target_error.map(|x| positive("--target-error", x)).transpose()?,
            time_limit: self.time_limit.map(|s| positive("--time-limit", s)).transpose()?,
            seed: self.seed.unwrap_or(0),
            scene: self.scene,
            variant: self.variant.clone(),
            sky: [zenith, horizon, self.sky_ground.unwrap_or(horizon)],
            sun_angle: self.sun_angle.map(|a| within("--sun-angle", a, 0.0, 60.0)).transpose()?,
            light_radius: self.light_radius.map(|r| within("--light-radius", r, 0.0, 1e6)).transpose()?,
            environment: self.environment.clone(),
            environment_intensity: within(
                "--environment-intensity",
                self.environment_intensity.unwrap_or(1.0),
                0.0,
                1e9,
            )?,
            environment_rotation: within(
                "--environment-rotation",
                self.environment_rotation.unwrap_or(0.0),
                -1e4,
                1e4,
            )?,
            rules: self.rules()?,
            memory_limit: self.memory_limit.map(ByteCount::bytes),
        };
        if settings.beta <= settings.alpha {
            return Err(Invalid(format!("--beta {} must be above --alpha {}", settings.beta, settings.alpha)));
        }
        if settings.sky.iter().flatten().any(|v| !v.is_finite() || *v < 0.0) {
            return Err(Invalid("--sky: radiance must be finite and not negative".into()));
        }
        settings.check_target()?;
        settings.check_directional()?;
        Ok(settings)
    }
}

impl Settings {
    /// The sky of these settings.
    #[must_use]
    pub fn sky(&self) -> Sky {
        let [zenith, horizon, ground] = self.sky.map(Rgb::from_array);
        Sky { zenith, horizon, ground }
    }
}

fn within<T: PartialOrd + core::fmt::Display>(option: &str, value: T, low: T, high: T) -> Result<T, Invalid> {
    if value >= low && value <= high {
        return Ok(value);
    }
    Err(Invalid(format!("{option} {value} is out of range; it must lie between {low} and {high}")))
}

/// Threads that can be asked for.
pub const MOST_THREADS: usize = 1024;
/// Far above any error or number of seconds that means something, and small enough to be a time.
const MOST: f64 = 1e9;

fn positive(option: &str, value: f64) -> Result<f64, Invalid> {
    if value > 0.0 && value <= MOST {
        return Ok(value);
    }
    Err(Invalid(format!("{option} {value} is out of range; it must be above 0 and at most {MOST}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_parse_and_are_complete() {
        for preset in Preset::ALL {
            let options = Options::preset(preset).unwrap();
            options.settings().unwrap();
            assert!(options.splat.is_some() && options.direct.is_some() && options.gather.is_some(), "{preset:?}");
            assert!(options.texels_per_meter.is_some() && options.lines_per_texel.is_some(), "{preset:?}");
        }
    }

    #[test]
    fn the_upper_layer_wins_and_alternatives_count_as_one() {
        let low = Options::from_toml("texels-per-meter = 8\nlines-per-texel = 4\ngather = 3").unwrap();
        let high = Options::from_toml("texel-size = 0.5\nlines = 100").unwrap();
        let s = high.over(low).settings().unwrap();
        assert_eq!((s.texels_per_meter, s.lines, s.gather), (2.0, Some(100), 3));
    }

    #[test]
    fn unknown_keys_and_bad_values_are_refused() {
        assert!(Options::from_toml("gatherr = 3").unwrap_err().to_string().contains("gatherr"));
        assert!(Options::from_toml("splat = \"both\"").is_err());
        let wrong = |text: &str| Options::from_toml(text).unwrap().settings().unwrap_err().to_string();
        assert!(wrong("alpha = 7\nbeta = 7").contains("--beta"));
        assert!(wrong("texel-size = 0.0").contains("--texels-per-meter"));
        assert!(wrong("texels-per-meter = nan").contains("--texels-per-meter"));
        assert!(wrong("sky = [-1, 0, 0]").contains("--sky"));
        for bad in ["0.0", "-1.0", "nan", "inf"] {
            assert!(wrong(&format!("target-error = {bad}")).contains("--target-error"));
            assert!(wrong(&format!("time-limit = {bad}")).contains("--time-limit"));
        }
    }
}
