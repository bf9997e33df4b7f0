//! Names of light groups, `extras.texelwalk.light_group` of a light, of the node that places it, or of a material.

use super::schema::Root;
use crate::base::Warning;
use serde_json::Value;

/// Which group each source of light belongs to, where the document says so.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct Groups {
    /// By index into `Scene::lights`.
    pub lights: Vec<Option<String>>,
    /// By index into `Scene::materials`.
    pub materials: Vec<Option<String>>,
}

/// The name in a value; what is no name is a warning about `owner`.
pub(super) fn name(value: Option<&Value>, owner: &str, warnings: &mut Vec<Warning>) -> Option<String> {
    match value? {
        Value::String(name) if !name.trim().is_empty() => Some(name.trim().to_owned()),
        other => {
            let what = format!("{owner}: extras.texelwalk.light_group is {other}, not a name; it was ignored");
            warnings.push(Warning::new("bad-light-group", what));
            None
        }
    }
}

/// Names of the materials' groups.
pub(super) fn of_materials(root: &Root, warnings: &mut Vec<Warning>) -> Vec<Option<String>> {
    let one = |(i, m): (usize, &super::schema::MaterialEntry)| {
        name(m.light_group.as_ref(), &format!("material {i}"), warnings)
    };
    root.materials.iter().enumerate().map(one).collect()
}
