//! What the HTML report is made from.

use super::write::{Facts, Results};
use super::{Error, stored};
use crate::html::{self, Change, Pictures, Subject};
use crate::output::File;
use crate::output::report::Report;
use crate::settings::{Options, Settings};
use crate::trace::Tracer;
use serde_json::{Map, Value};
use std::path::Path;

impl Facts<'_> {
    /// The pictures of the HTML report, if it is wanted.
    pub(super) fn pictures(&self, results: &Results) -> Result<Option<Pictures>, Error> {
        let Some(path) = &self.request.html else { return Ok(None) };
        // What casts no light can be seen all the same.
        let unseen = self.scene.parts.iter().any(|part| !part.treatment.casts);
        let all = unseen.then(|| Tracer::of_all(self.scene));
        let subject = Subject {
            path,
            tracer: all.as_ref().unwrap_or(self.tracer),
            atlas: self.atlas,
            patches: self.patches,
            lightmap: &results.lightmap,
            groups: &results.groups,
            vertices: results.vertices.as_ref(),
            noise: &results.noise,
            intensity: 1.0 / stored(self.request.settings.quantity),
        };
        Ok(Some(html::pictures(&subject)?))
    }

    /// The HTML report; `files` are those it tells of.
    pub(super) fn html(&self, pictures: &Pictures, report: &Report, files: &[File]) -> Vec<u8> {
        let request = self.request;
        let preset = Options::preset(request.preset).and_then(|options| options.settings()).ok();
        let changes = preset.map_or(vec![], |preset| changes(&request.settings, &preset));
        let files: Vec<(String, u64)> = files.iter().map(|(path, bytes)| (name(path), bytes.len() as u64)).collect();
        let facts = html::Facts {
            title: &name(&request.input),
            preset: request.preset.name(),
            changes: &changes,
            texels_per_meter: self.atlas.texels_per_meter,
            files: &files,
        };
        html::page(pictures, report, &facts)
    }
}

/// Without its folder, so that the report is the same wherever it is made.
fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Settings that differ, by their option names.
fn changes(settings: &Settings, preset: &Settings) -> Vec<Change> {
    let [own, below] = [settings, preset].map(fields);
    let options: std::collections::BTreeSet<&String> = own.keys().chain(below.keys()).collect();
    let differs = options.into_iter().filter(|option| own.get(*option) != below.get(*option));
    let change = |option: &String| Change {
        // Rules can be given in a file alone.
        option: if option == "rules" { option.clone() } else { format!("--{option}") },
        value: shown(own.get(option)),
        preset: shown(below.get(option)),
    };
    differs.map(change).collect()
}

fn fields(settings: &Settings) -> Map<String, Value> {
    match serde_json::to_value(settings) {
        Ok(Value::Object(map)) => map,
        _ => Map::new(),
    }
}

/// As it is typed, more or less.
fn shown(value: Option<&Value>) -> String {
    match value {
        None | Some(Value::Null) => "not set".to_owned(),
        Some(Value::String(text)) => text.clone(),
        Some(Value::Array(items)) => items.iter().map(|item| shown(Some(item))).collect::<Vec<_>>().join(", "),
        Some(other) => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_differs_is_told_and_nothing_else() {
        let settings = |text: &str| Options::from_toml(text).unwrap().settings().unwrap();
        let below = settings("gather = 3");
        assert_eq!(changes(&below, &below), []);
        let told = |text: &str| {
            let all = changes(&settings(text), &below);
            all.into_iter().map(|c| format!("{} {} {}", c.option, c.value, c.preset)).collect::<Vec<_>>()
        };
        assert_eq!(told("gather = 5\naov = [\"chart\", \"stderr\"]"), ["--aov stderr, chart not set", "--gather 5 3"]);
        assert_eq!(told("gather = 3\ntime-limit = 2.5"), ["--time-limit 2.5 not set"]);
    }
}
