//! What a bake may be told about single objects, and the rules of a configuration file that tell it by names.
//!
//! A [`Rule`] names nodes, meshes, materials or lights by patterns and holds [`Wishes`]. `extras` of the document hold
//! wishes, too (`extras.rs`). `treat.rs` puts them together; what comes of it for a primitive is its [`Treatment`].
//!
//! Patterns are those of shells, case-sensitive: `*` any text, `?` any character, `[ab]` and `[a-z]` one of these, `[!a]`
//! none of these; `[*]` is the character itself. They match whole names, `/` is a character like others.

use super::Instances;
use glob::Pattern;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Smallest and largest factor of the density: a texel 64 times as long, or as short, as others.
pub(super) const DENSITY: [f32; 2] = [1.0 / 64.0, 64.0];

/// How a primitive is baked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Treatment {
    /// Factor of the texels per metre.
    pub density: f32,
    /// It gets a lightmap, if it can have one; see [`Part::receives`](super::Part).
    pub receives: bool,
    /// Others are lit as if it were there: it blocks, reflects and emits light.
    pub casts: bool,
    /// Factor of the light that it emits.
    pub emission: f32,
    /// What it gets where several nodes place its mesh.
    pub instances: Instances,
}

impl Default for Treatment {
    fn default() -> Self {
        Self { density: 1.0, receives: true, casts: true, emission: 1.0, instances: Instances::Unique }
    }
}

/// What is said about something; `None` = nothing.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Wishes {
    pub(super) density: Option<f32>,
    pub(super) receives: Option<bool>,
    pub(super) casts: Option<bool>,
    pub(super) emission: Option<f32>,
    pub(super) intensity: Option<f32>,
    pub(super) light_group: Option<String>,
    pub(super) instances: Option<Instances>,
}

impl Wishes {
    /// These, and those of `below` where these say nothing.
    pub(super) fn over(self, below: &Self) -> Self {
        Self {
            density: self.density.or(below.density),
            receives: self.receives.or(below.receives),
            casts: self.casts.or(below.casts),
            emission: self.emission.or(below.emission),
            intensity: self.intensity.or(below.intensity),
            light_group: self.light_group.or_else(|| below.light_group.clone()),
            instances: self.instances.or(below.instances),
        }
    }

    /// The treatment of a primitive.
    pub(super) fn treatment(&self) -> Treatment {
        let usual = Treatment::default();
        Treatment {
            density: self.density.unwrap_or(usual.density),
            receives: self.receives.unwrap_or(usual.receives),
            casts: self.casts.unwrap_or(usual.casts),
            emission: self.emission.unwrap_or(usual.emission),
            instances: self.instances.unwrap_or(usual.instances),
        }
    }
}

/// A pattern for names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Glob(Pattern);

impl Glob {
    /// The whole name fits the pattern.
    #[must_use]
    pub fn matches(&self, name: &str) -> bool {
        self.0.matches(name)
    }
}

impl<'de> Deserialize<'de> for Glob {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Pattern::new(&text).map(Self).map_err(|e| D::Error::custom(format!("{text:?} is no pattern: {}", e.msg)))
    }
}

impl Serialize for Glob {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.0.as_str())
    }
}

/// A rule: what it is about, and what it says. The names are the keys of a configuration file.
///
/// Of nodes, meshes, materials and lights, all that are given must match, each by one of its patterns. A node's pattern
/// also matches what is below the node.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, rename_all = "kebab-case", deny_unknown_fields)]
pub struct Rule {
    /// Names of nodes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub nodes: Vec<Glob>,
    /// Names of meshes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub meshes: Vec<Glob>,
    /// Names of materials.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub materials: Vec<Glob>,
    /// Names of lights.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<Glob>,
    /// Factor of the texels per metre, from 1/64 to 64.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub density: Option<f32>,
    /// Surfaces get a lightmap.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub receives: Option<bool>,
    /// Surfaces block, reflect and emit light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub casts: Option<bool>,
    /// Factor of the light that surfaces emit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub emission: Option<f32>,
    /// Factor of the light of lights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intensity: Option<f32>,
    /// What meshes get that several nodes place: `unique`, `shared` or `skip`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instances: Option<Instances>,
    /// Light group of lights and of what glows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_group: Option<String>,
}

impl Rule {
    /// What is wrong with the rule, if anything.
    ///
    /// # Errors
    /// If it can match nothing, says nothing, or a value is out of its range.
    pub fn check(&self) -> Result<(), String> {
        let surfaces = !(self.meshes.is_empty() && self.materials.is_empty());
        if self.nodes.is_empty() && self.lights.is_empty() && !surfaces {
            return Err("it needs names: nodes, meshes, materials or lights".into());
        }
        if surfaces && !self.lights.is_empty() {
            return Err("lights have no meshes and materials, so nothing can match it".into());
        }
        let for_surfaces = [self.density.is_some(), self.receives.is_some(), self.casts.is_some()];
        let for_surfaces = for_surfaces.contains(&true) || self.emission.is_some() || self.instances.is_some();
        if for_surfaces && !self.lights.is_empty() {
            return Err("density, receives, casts, emission and instances are for surfaces, not for lights".into());
        }
        if self.intensity.is_some() && surfaces {
            return Err("intensity is for lights; surfaces have emission".into());
        }
        if !for_surfaces && self.intensity.is_none() && self.light_group.is_none() {
            return Err(
                "it says nothing: density, receives, casts, emission, instances, intensity or light-group".into()
            );
        }
        let [low, high] = DENSITY;
        if let Some(bad) = self.density.filter(|v| !(low..=high).contains(v)) {
            return Err(format!("density {bad} is out of range; it must lie between 1/64 and 64"));
        }
        for (key, value) in [("emission", self.emission), ("intensity", self.intensity)] {
            if let Some(bad) = value.filter(|v| !(v.is_finite() && *v >= 0.0)) {
                return Err(format!("{key} {bad} is out of range; it must be finite and not negative"));
            }
        }
        if self.light_group.as_ref().is_some_and(|name| name.trim().is_empty()) {
            return Err("light-group has no name".into());
        }
        Ok(())
    }

    pub(super) fn wishes(&self) -> Wishes {
        Wishes {
            density: self.density,
            receives: self.receives,
            casts: self.casts,
            emission: self.emission,
            intensity: self.intensity,
            light_group: self.light_group.as_ref().map(|name| name.trim().to_owned()),
            instances: self.instances,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rule(text: &str) -> Rule {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn patterns_match_whole_names() {
        let rule = rule("nodes = [\"lamp*\", \"Chandelier_??\", \"[ab].00[!1]\", \"all/of/*\", \"[*]\"]");
        let matches = |name: &str| rule.nodes.iter().any(|glob| glob.matches(name));
        for name in ["lamp", "lamp/shade.001", "Chandelier_éa", "a.002", "all/of/them/too", "*"] {
            assert!(matches(name), "{name}");
        }
        for name in ["Lamp", "a lamp", "Chandelier_1", "c.002", "a.001", "all/of", "x"] {
            assert!(!matches(name), "{name}");
        }
        assert!(toml::from_str::<Rule>("nodes = [\"[a\"]").unwrap_err().to_string().contains("no pattern"));
    }

    #[test]
    fn rules_that_make_no_sense_are_refused() {
        let wrong = |text: &str| rule(text).check().unwrap_err();
        assert!(wrong("density = 1").contains("names"));
        assert!(wrong("nodes = [\"a\"]").contains("says nothing"));
        assert!(wrong("lights = [\"a\"]\nmaterials = [\"a\"]\nlight-group = \"a\"").contains("nothing can match"));
        assert!(wrong("lights = [\"a\"]\ndensity = 1").contains("for surfaces"));
        assert!(wrong("meshes = [\"a\"]\nintensity = 1").contains("for lights"));
        assert!(wrong("nodes = [\"a\"]\nlight-group = \" \"").contains("no name"));
        for bad in ["0", "65", "-1", "nan", "inf", "0.0156"] {
            assert!(wrong(&format!("nodes = [\"a\"]\ndensity = {bad}")).contains("density"), "{bad}");
        }
        for bad in ["-1", "nan", "inf"] {
            assert!(wrong(&format!("nodes = [\"a\"]\nemission = {bad}")).contains("emission"), "{bad}");
            assert!(wrong(&format!("nodes = [\"a\"]\nintensity = {bad}")).contains("intensity"), "{bad}");
        }
        for good in ["density = 64", "density = 0.015625", "emission = 0", "casts = false", "light-group = \"b\""] {
            rule(&format!("nodes = [\"a\"]\n{good}")).check().unwrap();
        }
        assert!(toml::from_str::<Rule>("node = [\"a\"]").is_err());
    }

    #[test]
    fn what_is_above_wins_key_by_key() {
        let below = Wishes { density: Some(2.0), casts: Some(false), ..Wishes::default() };
        let both = Wishes { density: Some(0.5), emission: Some(0.0), ..Wishes::default() }.over(&below);
        let expected = Treatment { density: 0.5, casts: false, emission: 0.0, ..Treatment::default() };
        assert_eq!(both.treatment(), expected);
    }
}
