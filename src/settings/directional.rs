//! What `--directional`, `--normal-maps` and `--ao-distance` need of other options.

use super::{Aov, DirectMode, Directional, Invalid, Settings};

impl Settings {
    /// How far `ao` and `bent` look unless told otherwise [m].
    pub const AO_DISTANCE: f32 = 1.0;

    /// Light is baked by normal as well.
    #[must_use]
    pub fn is_directional(&self) -> bool {
        self.directional != Directional::None
    }

    /// A layer of what is open around the texels is wanted.
    #[must_use]
    pub fn wants_openness(&self) -> bool {
        self.aov.iter().any(|aov| matches!(aov, Aov::Ao | Aov::Bent))
    }

    /// Lines of the walk leave light on texels, but not where it came from.
    pub(super) fn check_directional(&self) -> Result<(), Invalid> {
        if self.is_directional() && (self.gather == 0 || self.direct == DirectMode::Shoot) {
            let why = "--directional needs rays that know where light comes from: --gather above 0 and --direct gather";
            return Err(Invalid(why.into()));
        }
        if self.normal_maps && self.is_directional() {
            let why =
                "--normal-maps and --directional exclude each other: engines apply normal maps to directional pages";
            return Err(Invalid(why.into()));
        }
        if self.normal_maps && self.direct == DirectMode::Shoot {
            return Err(Invalid("--normal-maps needs rays from the surface: --direct gather".into()));
        }
        if self.ao_distance.is_some() && !self.wants_openness() {
            return Err(Invalid("--ao-distance needs --aov ao or bent".into()));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::settings::Options;

    #[test]
    fn what_makes_no_sense_is_refused() {
        let read = |text: &str| Options::from_toml(text).unwrap().settings();
        let wrong = |text: &str| read(text).unwrap_err().to_string();
        assert!(wrong("directional = \"sh\"\ngather = 0").contains("--gather above 0"));
        assert!(wrong("directional = \"dominant\"\ndirect = \"shoot\"").contains("--direct gather"));
        assert_eq!(wrong("directional = \"sh\"\ntarget = \"vertex\""), "--directional needs --target lightmap");
        assert!(wrong("directional = \"sh\"\nnormal-maps = true").contains("exclude each other"));
        assert!(wrong("direct = \"shoot\"\nnormal-maps = true").contains("--direct gather"));
        assert_eq!(wrong("ao-distance = 2"), "--ao-distance needs --aov ao or bent");
        for bad in ["0", "-1", "nan"] {
            assert!(wrong(&format!("aov = [\"ao\"]\nao-distance = {bad}")).contains("--ao-distance"));
        }
        let good = read("aov = [\"bent\"]\nao-distance = inf\ndirectional = \"sh\"").unwrap();
        assert!(good.ao_distance == Some(f32::INFINITY) && good.is_directional());
        assert!(read("gather = 0\ndirectional = \"none\"").is_ok());
        let plain = serde_json::to_string(&read("").unwrap()).unwrap();
        assert!(!plain.contains("directional") && !plain.contains("ao-distance"));
    }
}
