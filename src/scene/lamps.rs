//! Lamps with a measured distribution: `EXT_lights_ies`, and IES files that `extras` of ordinary lights name.
//!
//! In: document, visible nodes. Out: [`Profiles`], read once each, for `punctual`.
//!
//! * `EXT_lights_ies`: intensity = candela × `multiplier` × `color`. A node's scale changes nothing.
//! * `extras.texelwalk.ies` of a point or spot light of `KHR_lights_punctual`: a URI as those of images. Intensity =
//!   candela × `color`; the light's own `intensity` and cone do not count, its range does.
//!
//! Both aim along −z of the node, and `intensity` of rules and of `extras.texelwalk` multiplies both.
//!
//! Warnings: `bad-extras`, `ies-tilt`.

use super::ies;
use super::nodes::Walk;
use super::schema::{LightEntry, label, optional};
use super::{Document, Error, Profile};
use crate::base::Warning;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::Arc;

/// `EXT_lights_ies` of the document.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default)]
pub struct ProfileList {
    /// Files, by index.
    pub lights: Vec<ProfileEntry>,
}

/// A file of `EXT_lights_ies`.
#[derive(Debug, Default, Clone, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub struct ProfileEntry {
    /// Name.
    pub name: Option<String>,
    /// Where it is.
    pub uri: Option<String>,
    /// Or the view that holds it.
    #[serde(deserialize_with = "optional")]
    pub buffer_view: Option<usize>,
}

/// `EXT_lights_ies` of a node.
#[derive(Debug, Clone, Deserialize)]
#[serde(default)]
pub struct NodeProfile {
    /// Index of the file.
    #[serde(deserialize_with = "optional")]
    pub light: Option<usize>,
    /// Factor of the intensity.
    pub multiplier: f32,
    /// Factor by channel, linear.
    pub color: [f32; 3],
}

impl Default for NodeProfile {
    fn default() -> Self {
        Self { light: None, multiplier: 1.0, color: [1.0; 3] }
    }
}

/// What was read.
#[derive(Debug, Default)]
pub(super) struct Profiles {
    /// By index into `EXT_lights_ies`.
    pub(super) measured: BTreeMap<usize, Arc<Profile>>,
    /// By index into `KHR_lights_punctual`.
    pub(super) of_lights: BTreeMap<usize, Arc<Profile>>,
}

/// Where a file is.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Source {
    Uri(String),
    View(usize),
}

/// Reads the files that visible nodes need.
pub(super) fn read(document: &mut Document, walk: &Walk, warnings: &mut Vec<Warning>) -> Result<Profiles, Error> {
    let mut profiles = Profiles::default();
    let mut known = BTreeMap::<Source, Arc<Profile>>::new();
    for placed in walk.placed.iter().filter(|p| p.visible) {
        let name = document.root.node_name(placed.node);
        let extensions = &document.root.nodes[placed.node].extensions;
        let (measured, light) = (extensions.ies.clone(), extensions.light.as_ref().and_then(|l| l.light));
        if let Some(index) = measured.map(|m| m.light.unwrap_or(usize::MAX))
            && !profiles.measured.contains_key(&index)
        {
            let (source, place) = source_of(document, index).map_err(|e| e.within(&format!("node {name}")))?;
            let profile = load(document, source, &place, &mut known, warnings)?;
            profiles.measured.insert(index, profile);
        }
        if let Some(index) = light.filter(|l| !profiles.of_lights.contains_key(l))
            && let Some(entry) = document.root.lights().get(index)
            && let Some(uri) = wish(entry, index, warnings)
        {
            let place = format!("IES file of light {}", label(entry.name.as_deref(), "light", index));
            let profile = load(document, Source::Uri(uri), &place, &mut known, warnings)?;
            profiles.of_lights.insert(index, profile);
        }
    }
    Ok(profiles)
}

/// An entry of `EXT_lights_ies`, and what to call it.
fn source_of(document: &Document, index: usize) -> Result<(Source, String), Error> {
    let all = document.root.profiles();
    let Some(entry) = all.get(index) else {
        let what = format!("its IES light does not exist, the document has {}", all.len());
        return Err(Error::invalid(what));
    };
    let place = format!("IES light {}", label(entry.name.as_deref(), "light", index));
    match (&entry.uri, entry.buffer_view) {
        (_, Some(view)) => Ok((Source::View(view), place)),
        (Some(uri), None) => Ok((Source::Uri(uri.clone()), place)),
        (None, None) => Err(Error::invalid(format!("{place} has neither a URI nor a buffer view"))),
    }
}

/// `extras.texelwalk.ies` of a light.
fn wish(entry: &LightEntry, index: usize, warnings: &mut Vec<Warning>) -> Option<String> {
    let value = entry.extras.get("texelwalk")?.get("ies")?;
    let uri = value.as_str().filter(|_| ["point", "spot"].contains(&entry.kind.as_str()));
    if uri.is_none() {
        let name = label(entry.name.as_deref(), "light", index);
        let what = format!(
            "light {name}: extras.texelwalk.ies is {value}; only point and spot lights can have the name of a file there, \
             it was ignored"
        );
        warnings.push(Warning::new("bad-extras", what));
    }
    uri.map(str::to_owned)
}

fn load(
    document: &mut Document,
    source: Source,
    place: &str,
    known: &mut BTreeMap<Source, Arc<Profile>>,
    warnings: &mut Vec<Warning>,
) -> Result<Arc<Profile>, Error> {
    if let Some(profile) = known.get(&source) {
        return Ok(Arc::clone(profile));
    }
    let (bytes, named) = match &source {
        Source::View(view) => (document.buffer_view(*view).map_err(|e| e.within(place))?.to_vec(), String::new()),
        Source::Uri(uri) => {
            let shown =
                if uri.starts_with("data:") { String::new() } else { format!(" ({})", label(Some(uri), "", 0)) };
            (document.resource(uri, place, ies::MAX_BYTES + 1)?, shown)
        }
    };
    let read = ies::read(&bytes).map_err(|e| e.within(&format!("{place}{named}")))?;
    if read.tilts {
        let what = format!("{place}{named}: what its TILT says about lamps that are not upright was not applied");
        warnings.push(Warning::new("ies-tilt", what));
    }
    let profile = Arc::new(read.profile);
    known.insert(source, Arc::clone(&profile));
    Ok(profile)
}
