//! Textures of directional lightmaps: their names, and what documents say of them.
//!
//! In: the pages of a bake. Out: a file per page and texture, and the entry `directional` beside a page's `uri`:
//!
//! | mode | texture | file | holds |
//! |---|---|---|---|
//! | `sh` | `l0`, `l1x`, `l1y`, `l1z` | `NAME.lightmap0.l0.exr` … | four colours, half floats of either sign in the unit of the lightmap |
//! | `dominant` | `direction` | `NAME.lightmap0.direction.exr` | rgb = d/2 + 1/2, a = (1 + d·n₀)/2, all in [0, 1] |
//!
//! n is a unit normal in the world of the document (+y up), as the scene was baked:
//! * `sh`: light = l0 + l1x·n.x + l1y·n.y + l1z·n.z, not below 0. These are L0 and the three L1 of spherical harmonics
//!   with their constants multiplied in, so a shader needs none.
//! * `dominant`: light = texel · (1/2 + n·(rgb − 1/2))/a, half-Lambert as in Unity's `DecodeDirectionalLightmap`. d is
//!   where most light comes from; its length says how much of it, from 0 to 1. n₀ is the normal that the texel was
//!   baked with.
//!
//! With n = n₀ both are the lightmap itself. In the alpha of `sh` is the coverage, as in the lightmap's.

use super::Error;
use super::names::relative_uri;
use super::splice::quoted;
use std::path::Path;
use std::path::PathBuf;

/// One of the textures that say how light changes with the normal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Texture {
    /// Light that does not depend on the normal.
    L0,
    /// Light per x of the normal.
    L1x,
    /// Light per y of the normal.
    L1y,
    /// Light per z of the normal.
    L1z,
    /// Dominant direction and rebalancing factor.
    Direction,
}

impl Texture {
    /// Its name in documents and file names.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::L0 => "l0",
            Self::L1x => "l1x",
            Self::L1y => "l1y",
            Self::L1z => "l1z",
            Self::Direction => "direction",
        }
    }

    /// Where it goes for a page whose lightmap is `page_exr`.
    #[must_use]
    pub fn path(self, page_exr: &Path) -> PathBuf {
        page_exr.with_extension(format!("{}.exr", self.name()))
    }
}

/// `, "directional": {…}` for a page in a document in `folder`; nothing without textures.
pub(super) fn json(files: &[(Texture, PathBuf)], folder: &Path) -> Result<String, Error> {
    let (mode, decode) = match files.first() {
        None => return Ok(String::new()),
        Some((Texture::Direction, _)) => ("dominant", "rgb*(dot(n,direction.rgb-0.5)+0.5)/direction.a"),
        Some(_) => ("sh", "l0+l1x*n.x+l1y*n.y+l1z*n.z"),
    };
    let mut entries = String::new();
    for (texture, path) in files {
        entries += &format!(", \"{}\": {}", texture.name(), quoted(&relative_uri(folder, path)?));
    }
    Ok(format!(", \"directional\": {{\"mode\": \"{mode}\"{entries}, \"decode\": \"{decode}\"}}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_name_mode_files_and_formula() {
        let page = Path::new("out/my.room.lightmap1.exr");
        let files = |textures: &[Texture]| textures.iter().map(|t| (*t, t.path(page))).collect::<Vec<_>>();
        let entry = |textures: &[Texture]| {
            let json = json(&files(textures), Path::new("out")).unwrap();
            serde_json::from_str::<serde_json::Value>(&format!("{{\"uri\": \"x\"{json}}}")).unwrap()
        };
        assert!(entry(&[]).get("directional").is_none());
        let sh = entry(&[Texture::L0, Texture::L1x, Texture::L1y, Texture::L1z]);
        assert_eq!(sh["directional"]["mode"], "sh");
        assert_eq!(sh["directional"]["l1z"], "my.room.lightmap1.l1z.exr");
        let dominant = entry(&[Texture::Direction]);
        assert_eq!(dominant["directional"]["direction"], "my.room.lightmap1.direction.exr");
        assert!(dominant["directional"]["decode"].as_str().unwrap().contains("direction.a"));
    }
}
