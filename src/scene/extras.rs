//! Wishes of the document itself: the object `extras.texelwalk` of a node, mesh, material or light.
//!
//! Keys: `density`, `receives`, `casts`, `emission`, `instances`, `intensity`, `light_group`, as in rules. Meshes and
//! materials have no `intensity`, lights only `intensity`, `light_group` and `ies`. Truth may be written as 0 and 1, as
//! some exporters do.
//!
//! Extras may hold anything, and what others put there does not matter. What is wrong within `texelwalk` is ignored with a
//! warning that names the owner and the key: `bad-extras`, and `bad-light-group` for names of groups.

use super::rules::{DENSITY, Wishes};
use crate::base::Warning;
use serde::{Deserialize, Deserializer};
use serde_json::Value;
use serde_json::value::RawValue;

/// Keys that a node may have: for the surfaces and lights that it places, and for those below it.
pub(super) const OF_NODES: &[&str] =
    &["density", "receives", "casts", "emission", "instances", "intensity", "light_group"];
/// Keys of meshes and materials.
pub(super) const OF_SURFACES: &[&str] = &["density", "receives", "casts", "emission", "instances", "light_group"];
/// Keys of lights.
pub(super) const OF_LIGHTS: &[&str] = &["ies", "intensity", "light_group"];

/// The value of `extras.texelwalk`.
#[derive(Debug, Clone, Default)]
pub enum Own {
    /// There is none.
    #[default]
    Missing,
    /// As it is.
    Value(Value),
    /// It is there, but no value; why.
    Unreadable(String),
}

impl<'de> Deserialize<'de> for Own {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Default, Deserialize)]
        #[serde(default)]
        struct Extras {
            texelwalk: Option<Value>,
        }
        let extras = Box::<RawValue>::deserialize(deserializer)?;
        if !(extras.get().starts_with('{') && extras.get().contains("\"texelwalk\"")) {
            return Ok(Self::Missing);
        }
        Ok(match serde_json::from_str::<Extras>(extras.get()) {
            Ok(Extras { texelwalk }) => texelwalk.map_or(Self::Missing, Self::Value),
            Err(e) => Self::Unreadable(e.to_string()),
        })
    }
}

/// Reads wishes; `keys` are those that make sense for `owner`.
pub(super) fn read(own: &Own, keys: &[&str], owner: &str, warnings: &mut Vec<Warning>) -> Wishes {
    let mut wishes = Wishes::default();
    let mut odd = |code, what: String| warnings.push(Warning::new(code, format!("{owner}: extras.texelwalk{what}")));
    let object = match own {
        Own::Missing => return wishes,
        Own::Value(Value::Object(object)) => object,
        Own::Value(other) => {
            odd("bad-extras", format!(" is {other}, not an object; it was ignored"));
            return wishes;
        }
        Own::Unreadable(why) => {
            odd("bad-extras", format!(" cannot be read ({why}); it was ignored"));
            return wishes;
        }
    };
    for (key, value) in object {
        let mut wrong = |code, expected: &str| odd(code, format!(".{key} is {value}, not {expected}; it was ignored"));
        match key.as_str() {
            known if !keys.contains(&known) => {
                odd("bad-extras", format!(".{key} means nothing here; it was ignored, there are {}", keys.join(", ")));
            }
            // Of lights: `lamps` reads it.
            "ies" => {}
            "density" => {
                let [low, high] = DENSITY;
                wishes.density = number(value).filter(|v| (low..=high).contains(v));
                if wishes.density.is_none() {
                    wrong("bad-extras", "a number between 1/64 and 64");
                }
            }
            "receives" | "casts" => {
                let truth = truth(value);
                if truth.is_none() {
                    wrong("bad-extras", "true or false");
                }
                *(if key == "casts" { &mut wishes.casts } else { &mut wishes.receives }) = truth;
            }
            "emission" | "intensity" => {
                let factor = number(value).filter(|v| v.is_finite() && *v >= 0.0);
                if factor.is_none() {
                    wrong("bad-extras", "a finite number that is not negative");
                }
                *(if key == "emission" { &mut wishes.emission } else { &mut wishes.intensity }) = factor;
            }
            "instances" => {
                wishes.instances = serde_json::from_value(value.clone()).ok();
                if wishes.instances.is_none() {
                    wrong("bad-extras", "\"unique\", \"shared\" or \"skip\"");
                }
            }
            _ => {
                wishes.light_group = value.as_str().map(str::trim).filter(|n| !n.is_empty()).map(str::to_owned);
                if wishes.light_group.is_none() {
                    wrong("bad-light-group", "a name");
                }
            }
        }
    }
    wishes
}

fn number(value: &Value) -> Option<f32> {
    value.as_f64().map(|v| v as f32)
}

fn truth(value: &Value) -> Option<bool> {
    value.as_bool().or(match value.as_f64() {
        Some(0.0) => Some(false),
        Some(1.0) => Some(true),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_all(json: &str) -> (Wishes, Vec<String>) {
        let (own, mut warnings) = (serde_json::from_str(json).unwrap(), vec![]);
        let wishes = read(&own, OF_SURFACES, "mesh 3 \"Chair\"", &mut warnings);
        (wishes, warnings.into_iter().map(|w| format!("{} {}", w.code, w.message)).collect())
    }

    #[test]
    fn good_extras_are_read_and_those_of_others_ignored() {
        let (wishes, warnings) = read_all(
            r#"{"texelwalk": {"density": 2, "receives": 0, "casts": true, "emission": 0.5, "light_group": " a "}, "x": 3}"#,
        );
        let expected = Wishes {
            density: Some(2.0),
            receives: Some(false),
            casts: Some(true),
            emission: Some(0.5),
            intensity: None,
            light_group: Some("a".to_owned()),
            instances: None,
        };
        assert_eq!((wishes, warnings), (expected, vec![]));
        for other in [r#"{"density": "x"}"#, "[[1], \"texelwalk\"]", "\"texelwalk\"", "null", r#"{"texelwalk": null}"#]
        {
            assert_eq!(read_all(other), (Wishes::default(), vec![]), "{other}");
        }
    }

    #[test]
    fn every_odd_value_is_a_warning_with_owner_and_key() {
        let odd = [
            (r#"{"texelwalk": 5}"#, "texelwalk is 5, not an object"),
            (r#"{"texelwalk": {"density": 1e999}}"#, "cannot be read"),
            (r#"{"texelwalk": {"densty": 2}}"#, ".densty means nothing here"),
            (r#"{"texelwalk": {"intensity": 2}}"#, ".intensity means nothing here"),
            (r#"{"texelwalk": {"density": 65}}"#, ".density is 65"),
            (r#"{"texelwalk": {"density": "2"}}"#, ".density is \"2\""),
            (r#"{"texelwalk": {"receives": 2}}"#, ".receives is 2, not true or false"),
            (r#"{"texelwalk": {"casts": null}}"#, ".casts is null"),
            (r#"{"texelwalk": {"emission": -1}}"#, ".emission is -1"),
            (r#"{"texelwalk": {"emission": 1e300}}"#, ".emission is 1e+300"),
            (r#"{"texelwalk": {"light_group": " "}}"#, "bad-light-group"),
        ];
        for (json, expected) in odd {
            let (wishes, warnings) = read_all(json);
            assert_eq!(wishes, Wishes::default(), "{json}");
            assert_eq!(warnings.len(), 1, "{json}: {warnings:?}");
            assert!(warnings[0].contains(expected) && warnings[0].contains("mesh 3 \"Chair\""), "{}", warnings[0]);
        }
    }
}
