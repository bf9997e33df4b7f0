//! What can be typed: commands, options, help. What the options of `bake` mean is in `settings`.

use crate::check::Kind;
use crate::settings::{Options, Preset};
use clap::{Arg, Parser, Subcommand};
use std::path::PathBuf;

const AFTER_HELP: &str = "\
Start here:
  texelwalk inspect room.glb                what would be baked
  texelwalk bake room.glb -o out/           out/room.glb, out/room.lightmap0.exr
  texelwalk render out/room.glb -o view.png a picture of the result

Exit codes: 0 ok, 1 bake failed, 2 usage, 3 input invalid or unsupported, 4 file system,
5 warnings under --strict, 7 compare found a difference or check a fault, 130 interrupted.";

/// Bakes diffuse global illumination into lightmaps or vertex colours for glTF assets: no GPU, no window, the same
/// bytes every time.
#[derive(Debug, Parser)]
#[command(name = "texelwalk", version, after_help = AFTER_HELP, max_term_width = 100)]
pub struct Cli {
    /// What to do
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Bake a glTF's lighting into a lightmap, or into its vertices (the main job)
    Bake(Box<Bake>),
    /// Say what would be baked: meshes, texels, lights, faults
    Inspect(Inspect),
    /// Compare two EXR pictures: MSE, NRMSE, PSNR, largest difference
    Compare(Compare),
    /// Make a picture of a baked glTF, lit by its lightmap alone
    Render(Render),
    /// Measure whether a baked glTF's lightmap is clean: coordinates, padding, seams, leaks, odd texels
    Check(Check),
    /// Put files in place for a bake that may be killed. Started by texelwalk itself: it does only what it is told on
    /// standard input, in a form that nobody types, and renames and removes nothing but texelwalk's temporary files
    #[cfg(unix)]
    #[command(hide = true)]
    Place,
}

/// Takes what looks like a negative number for the option's value, so that it is told its range.
fn with_negative(option: Arg) -> Arg {
    let takes = option.get_long().is_some() && option.get_action().takes_values();
    option.allow_negative_numbers(takes)
}

/// `bake`.
#[derive(Debug, clap::Args)]
#[command(mut_args(with_negative))]
pub struct Bake {
    /// The .gltf or .glb to bake
    #[arg(value_name = "IN")]
    pub input: PathBuf,
    /// Where to write: a .glb, a .gltf, or a folder (keeps the input's name)
    #[arg(short, long, value_name = "OUT")]
    pub output: PathBuf,
    /// Named settings to start from
    #[arg(long, value_enum, default_value = "production")]
    pub preset: Preset,
    /// TOML file with options by their long names, and [[rules]] for what nodes, meshes, materials and lights with
    /// certain names do otherwise: density, receives, casts, emission, intensity, light-group (README, Rules); the command
    /// line wins
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Everything a preset may set
    #[command(flatten)]
    pub options: Options,
    /// Also write the bake as OpenUSD: NAME.usda to open, NAME.geometry.usda, and NAME.lightmap.usda, which adds the
    /// light to a stage with the same prims
    #[arg(long, value_name = "NAME.usda", value_parser = usda)]
    pub usd: Option<PathBuf>,
    /// Write a JSON report of the bake
    #[arg(long, value_name = "FILE", help_heading = "Run")]
    pub report: Option<PathBuf>,
    /// Write a report for people, one HTML page: pictures, heat maps, times, warnings
    #[arg(long, value_name = "FILE", help_heading = "Run")]
    pub html: Option<PathBuf>,
    /// Write a make-style rule: outputs depend on the files that were read
    #[arg(long, value_name = "FILE", help_heading = "Run")]
    pub depfile: Option<PathBuf>,
    /// Print the report on standard output
    #[arg(long, help_heading = "Run")]
    pub json: bool,
    /// Exit with code 5 if there were warnings (outputs are still written)
    #[arg(long, help_heading = "Run")]
    pub strict: bool,
    /// Nothing on standard error but errors
    #[arg(short, long, help_heading = "Run", conflicts_with = "verbose")]
    pub quiet: bool,
    /// More detail on standard error
    #[arg(short, long, help_heading = "Run")]
    pub verbose: bool,
}

/// The name of a text layer.
fn usda(typed: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(typed);
    let named = path.extension().is_some_and(|e| e == "usda") && path.file_stem().is_some();
    if named { Ok(path) } else { Err("the name must end in .usda, because text layers are written".to_owned()) }
}

/// `inspect`.
#[derive(Debug, clap::Args)]
#[command(mut_args(with_negative))]
pub struct Inspect {
    /// The .gltf or .glb to look at
    #[arg(value_name = "IN")]
    pub input: PathBuf,
    /// Named settings to start from
    #[arg(long, value_enum, default_value = "production")]
    pub preset: Preset,
    /// TOML file with options and [[rules]], as for bake
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Density to count texels at
    #[arg(long, value_name = "X")]
    pub texels_per_meter: Option<f32>,
    /// Scene of the document
    #[arg(long, value_name = "N")]
    pub scene: Option<usize>,
    /// Print JSON instead of tables
    #[arg(long)]
    pub json: bool,
}

/// `compare`.
#[derive(Debug, clap::Args)]
#[command(mut_args(with_negative))]
pub struct Compare {
    /// The picture to trust
    #[arg(value_name = "REF")]
    pub reference: PathBuf,
    /// The picture to judge
    #[arg(value_name = "TEST")]
    pub test: PathBuf,
    /// Compare only where this picture's first channel is above 0
    #[arg(long, value_name = "M")]
    pub mask: Option<PathBuf>,
    /// Exit with code 7 if the NRMSE is above X
    #[arg(long, value_name = "X", value_parser = most_error)]
    pub fail: Option<f64>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// `render`.
#[derive(Debug, clap::Args)]
#[command(mut_args(with_negative))]
pub struct Render {
    /// A glTF that `bake` wrote
    #[arg(value_name = "BAKED")]
    pub input: PathBuf,
    /// The picture to write: .png with exposure and tone curve, or .exr with radiance in cd/m²
    #[arg(short, long, value_name = "PNG|EXR", value_parser = picture)]
    pub output: PathBuf,
    /// Camera of the document, by number [default: the first]
    #[arg(long, value_name = "N", conflicts_with = "auto")]
    pub camera: Option<usize>,
    /// Choose a view even if the document has cameras
    #[arg(long)]
    pub auto: bool,
    /// Width in pixels
    #[arg(long, value_name = "PX", default_value_t = 960)]
    pub width: u32,
    /// Height in pixels
    #[arg(long, value_name = "PX", default_value_t = 640)]
    pub height: u32,
    /// Samples per pixel
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub samples: u32,
    /// Exposure in stops [default: by the picture's log-average]
    #[arg(long, value_name = "STOPS", value_parser = stops)]
    pub exposure: Option<f32>,
    /// Show charts or texel density instead of light
    #[arg(long, value_enum, default_value = "none")]
    pub overlay: crate::render::Overlay,
    /// Scene of the document
    #[arg(long, value_name = "N")]
    pub scene: Option<usize>,
}

/// `check`.
#[derive(Debug, clap::Args)]
#[command(mut_args(with_negative))]
pub struct Check {
    /// A glTF with a lightmap
    #[arg(value_name = "BAKED")]
    pub input: PathBuf,
    /// Exit with code 7 if a measure is above its limit
    #[arg(long)]
    pub fail: bool,
    /// Another limit for a measure, for example seam-step=0.02 (shares are in [0, 1]); may be repeated
    #[arg(long = "limit", value_name = "NAME=VALUE", value_parser = limit)]
    pub limits: Vec<(Kind, f64)>,
    /// Empty texels that must lie between charts [default: as bilinear look-ups need]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    pub padding: Option<u32>,
    /// Write the measures as JSON; - is standard output, instead of the table
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write pictures of the worst places of every fault into a folder
    #[arg(long, value_name = "DIR")]
    pub pictures: Option<PathBuf>,
    /// Scene of the document
    #[arg(long, value_name = "N")]
    pub scene: Option<usize>,
    /// Number of threads [default: all]
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
}

/// The name of a picture that can be written.
fn picture(typed: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(typed);
    let known = |e: &std::ffi::OsStr| ["png", "exr"].iter().any(|known| e.eq_ignore_ascii_case(known));
    if path.extension().is_some_and(known) { Ok(path) } else { Err("the name must end in .png or .exr".to_owned()) }
}

/// An exposure.
fn stops(typed: &str) -> Result<f32, String> {
    let stops: f32 = typed.parse().map_err(|_| format!("{typed} is no number"))?;
    if stops.is_finite() { Ok(stops) } else { Err("it must be finite".to_owned()) }
}

/// An error that a comparison may find; nothing is above NaN, so it would let all pass.
fn most_error(typed: &str) -> Result<f64, String> {
    let most: f64 = typed.parse().map_err(|_| format!("{typed} is no number"))?;
    if most >= 0.0 { Ok(most) } else { Err("it must be a number from 0 on".to_owned()) }
}

/// A limit as it is typed.
fn limit(typed: &str) -> Result<(Kind, f64), String> {
    let (name, value) = typed.split_once('=').ok_or("write it as NAME=VALUE")?;
    let known = || Kind::ALL.map(Kind::name).join(", ");
    let kind = Kind::ALL.into_iter().find(|k| k.name() == name);
    let kind = kind.ok_or_else(|| format!("there is no measure {name}; there are {}", known()))?;
    let value: f64 = value.parse().map_err(|_| format!("{value} is no number"))?;
    if value >= 0.0 { Ok((kind, value)) } else { Err("a limit cannot be below 0".to_owned()) }
}
