//! The command line: what to show, from where, and where to write it.
//!
//! In: `BAKED PICTURE.exr [OPTIONS]`, see [`USAGE`]. Out: [`Arguments`], or one sentence that says what is wrong.

use std::path::PathBuf;

/// Shown when the command line is wrong.
pub const USAGE: &str = "usage: texelwalk-bevy BAKED PICTURE.exr [--camera NODE] [--width PX] [--height PX] [--strata N] \
                         [--report FILE.json] [--lamps hidden|for-others] [--bicubic]";

/// Largest side of a texture that every device draws on; its square fits 32 bits.
const MOST_SAMPLES: u32 = 8192;

/// What to do.
#[derive(Clone, Debug)]
pub struct Arguments {
    /// The glTF or GLB that was baked.
    pub baked: PathBuf,
    /// Where the radiance [cd/m²] goes: R, G, B and coverage.
    pub picture: PathBuf,
    /// Where to list what was attached.
    pub report: Option<PathBuf>,
    /// Name of the camera's node; without it, the first camera.
    pub camera: Option<String>,
    pub width: u32,
    pub height: u32,
    /// Samples along each edge of a pixel.
    pub strata: u32,
    /// Keep the lights of the document for meshes without a lightmap.
    pub lamps_for_others: bool,
    pub bicubic: bool,
}

/// Reads the words behind the program's name.
pub fn parse(words: impl Iterator<Item = String>) -> Result<Arguments, String> {
    let (mut paths, mut words) = (vec![], words);
    let mut read = Arguments {
        baked: PathBuf::new(),
        picture: PathBuf::new(),
        report: None,
        camera: None,
        width: 960,
        height: 640,
        strata: 4,
        lamps_for_others: false,
        bicubic: false,
    };
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} needs a value; {USAGE}"));
        match word.as_str() {
            "--camera" => read.camera = Some(value()?),
            "--width" => read.width = number(&word, &value()?)?,
            "--height" => read.height = number(&word, &value()?)?,
            "--strata" => read.strata = number(&word, &value()?)?,
            "--report" => read.report = Some(value()?.into()),
            "--lamps" => read.lamps_for_others = is_for_others(&value()?)?,
            "--bicubic" => read.bicubic = true,
            option if option.starts_with('-') => return Err(format!("{option} is not known; {USAGE}")),
            path => paths.push(PathBuf::from(path)),
        }
    }
    [read.baked, read.picture] = paths.try_into().map_err(|_| USAGE.to_owned())?;
    if read.width.max(read.height) * read.strata > MOST_SAMPLES {
        return Err(format!("more than {MOST_SAMPLES} samples in a row: lower --strata, --width or --height"));
    }
    Ok(read)
}

fn number(option: &str, text: &str) -> Result<u32, String> {
    let parsed = text.parse().ok().filter(|n| (1..=MOST_SAMPLES).contains(n));
    parsed.ok_or(format!("{option} {text}: must be a number from 1 to {MOST_SAMPLES}"))
}

fn is_for_others(text: &str) -> Result<bool, String> {
    match text {
        "hidden" => Ok(false),
        "for-others" => Ok(true),
        _ => Err(format!("--lamps {text}: must be hidden or for-others")),
    }
}
