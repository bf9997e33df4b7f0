//! Options that are a choice between names.

use crate::atlas::{self, Uv};
use serde::{Deserialize, Serialize};

/// The named settings that ship with texelwalk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// Seconds: coarse texels, few rays.
    Preview,
    /// The default: shared walk and a final gather.
    Production,
    /// Twice the density and four times the rays of `production`.
    Final,
    /// The paper's method: splatting walk, direct light shot, no gather.
    Paper,
}

impl Preset {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Preview, Self::Production, Self::Final, Self::Paper];

    /// Its name in options.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Preview => "preview",
            Self::Production => "production",
            Self::Final => "final",
            Self::Paper => "paper",
        }
    }

    /// The file's text.
    pub(super) fn text(self) -> &'static str {
        match self {
            Self::Preview => include_str!("../../pipelines/presets/preview.toml"),
            Self::Production => include_str!("../../pipelines/presets/production.toml"),
            Self::Final => include_str!("../../pipelines/presets/final.toml"),
            Self::Paper => include_str!("../../pipelines/presets/paper.toml"),
        }
    }
}

/// What a line of the walk does at its hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SplatMode {
    /// Classic random walk: all to the patch that was hit.
    None,
    /// The paper's splat by uncertainty (--alpha, --beta); biased.
    Paper,
    /// Conductance sharing as far as the noise needs it; converges to the truth.
    Share,
}

/// How direct light is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DirectMode {
    /// Shadow rays from every texel.
    Gather,
    /// Lines from the emitters, as in the paper.
    Shoot,
}

/// What a texel holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// E/π: multiply by base colour to get the radiance that is reflected [cd/m²].
    Radiosity,
    /// E: irradiance [lx].
    Irradiance,
}

/// Which lightmap UVs are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UvMode {
    /// Keep a usable `TEXCOORD_1`, chart anew otherwise.
    Auto,
    /// Keep `TEXCOORD_1`; fail where it is missing or unusable.
    Keep,
    /// Always chart anew.
    Generate,
}

impl super::Settings {
    /// What the atlas stage is asked for, without a limit of time.
    #[must_use]
    pub fn atlas(&self) -> atlas::Settings {
        atlas::Settings {
            texels_per_meter: self.texels_per_meter,
            page_size: self.page_size,
            max_pages: self.max_pages,
            padding: self.padding,
            mips: self.mips,
            uv: match self.uv {
                UvMode::Auto => Uv::Auto,
                UvMode::Keep => Uv::Keep,
                UvMode::Generate => Uv::Generate,
            },
            // Vertices have a value each, whatever the texels.
            share_texels: self.target == Target::Lightmap,
            time_limit: None,
            cancel: None,
        }
    }
}

/// What is baked to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// Pictures, and the mesh's place on them.
    Lightmap,
    /// Attributes of the vertices.
    Vertex,
}

/// Which vertex attribute carries the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VertexAttribute {
    /// `_LIGHTMAP`, three floats as they are.
    Lightmap,
    /// `COLOR_0`, light times vertex colour over a scale, in [0, 1].
    Color0,
    /// Both.
    Both,
}

/// What `--aov` can put beside the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Aov {
    /// Standard error of each texel, root mean square over the channels.
    Stderr,
    /// Light straight from its sources.
    Direct,
    /// Light after at least one reflection.
    Indirect,
    /// Diffuse reflectance.
    Albedo,
    /// Unit normal in the world.
    Normal,
    /// Position in the world, in metres.
    Position,
    /// Number of the chart, from 1.
    Chart,
    /// Texels per metre.
    Density,
    /// Part of the texel that is exposed surface.
    Coverage,
    /// Share of the hemisphere, by cosine, that is open as far as --ao-distance.
    Ao,
    /// Mean direction of that share, unit, in the world.
    Bent,
}

/// What is baked besides light on the surface as it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Directional {
    /// Nothing.
    None,
    /// Four pages of coefficients: light is L0 + L1x·n.x + L1y·n.y + L1z·n.z for the normal n in the world.
    Sh,
    /// A page with the dominant direction and how dominant it is, as Unity reads it.
    Dominant,
}

impl Directional {
    /// It is the default.
    pub(super) fn is_none(&self) -> bool {
        *self == Self::None
    }
}

impl Target {
    /// It is the default.
    pub(super) fn is_lightmap(&self) -> bool {
        *self == Self::Lightmap
    }
}
