//! Lights of `KHR_lights_punctual` in world space.
//!
//! Defaults of the extension: white, intensity 1, no range, cone 0 to π/4. A node's scale changes neither intensity nor
//! range. Beyond the extension, `extras` of a light may hold `radius` [m] for point and spot lights, and `angle` [rad],
//! the angular diameter, for directional ones.

use super::Error;
use super::Light;
use super::nodes::Walk;
use super::schema::LightEntry;
use super::schema::Root;
use super::treat::Treater;
use crate::base::Rgb;
use crate::base::Warning;
use core::f32::consts::FRAC_PI_2;
use glam::DMat4;

/// All lights of the visible nodes, in document order, and the names of their groups. `sizes` overrides angle [rad] of
/// every sun and radius [m] of every other light; `treater` knows what rules and `extras` say.
pub(super) fn read(
    root: &Root,
    walk: &Walk,
    sizes: [Option<f32>; 2],
    treater: &mut Treater<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<(Vec<Light>, Vec<Option<String>>), Error> {
    let (mut lights, mut groups) = (Vec::new(), Vec::new());
    for placed in walk.placed.iter().filter(|p| p.visible) {
        let Some(reference) = &root.nodes[placed.node].extensions.light else { continue };
        let name = root.node_name(placed.node);
        let index = reference.light.unwrap_or(usize::MAX);
        let entry = root.lights().get(index).ok_or_else(|| {
            let have = root.lights().len();
            Error::invalid(format!("node {name}: its light does not exist, the document has {have}"))
        })?;
        let mut odd =
            |what: String| warnings.push(Warning::new("bad-light", format!("light of node {name}: {what}")).at(&name));
        let (factor, group) = treater.light(placed.node, index);
        if let Some(light) = convert(entry, walk.worlds[placed.node], sizes, factor, &mut odd) {
            lights.push(light);
            groups.push(group);
        }
        if placed.animated {
            let what = format!("node {name} is animated: its light was baked where it stands at rest");
            warnings.push(Warning::new("animated-node", what).at(&name));
        }
    }
    Ok((lights, groups))
}

/// `None` = the light cannot be used, and `odd` heard why. Its intensity is multiplied by `factor`.
fn convert(
    entry: &LightEntry,
    world: DMat4,
    sizes: [Option<f32>; 2],
    factor: f32,
    odd: &mut impl FnMut(String),
) -> Option<Light> {
    let power = Rgb::from_array(entry.color) * (entry.intensity * factor);
    if !(power.is_finite() && power.min_element() >= 0.0) {
        odd("its colour or intensity is negative or not finite; it was left out".to_owned());
        return None;
    }
    let mut extra = |key: &str, limit: f32| {
        let value = entry.extras.get(key)?.as_f64().map(|v| v as f32).filter(|v| (0.0..=limit).contains(v));
        if value.is_none() {
            odd(format!("extras.{key} is not a number from 0 to {limit}; it was ignored"));
        }
        value
    };
    let radius = sizes[1].or_else(|| extra("radius", f32::MAX)).unwrap_or(0.0);
    let angle = sizes[0].or_else(|| extra("angle", core::f32::consts::PI)).unwrap_or(0.0);
    let range = match entry.range {
        Some(range) if range > 0.0 => range,
        Some(range) => {
            odd(format!("a range of {range} is not positive; it was ignored"));
            f32::INFINITY
        }
        None => f32::INFINITY,
    };
    let position = world.w_axis.truncate().as_vec3();
    let axis = -world.z_axis.truncate();
    let direction = (axis / axis.abs().max_element()).normalize_or_zero().as_vec3();
    if entry.kind != "point" && !direction.is_normalized() {
        odd("its node has no direction (scaled to zero); it was left out".to_owned());
        return None;
    }
    match entry.kind.as_str() {
        "directional" => Some(Light::Sun { direction, illuminance: power, angle }),
        "point" => Some(Light::Point { position, intensity: power, range, radius }),
        "spot" => {
            let outer = entry.spot.outer_cone_angle.clamp(0.0, FRAC_PI_2);
            let inner = entry.spot.inner_cone_angle.clamp(0.0, outer);
            if outer != entry.spot.outer_cone_angle || inner != entry.spot.inner_cone_angle {
                odd("its cone angles do not satisfy 0 ≤ inner ≤ outer ≤ π/2; they were clamped".to_owned());
            }
            let (cos_inner, cos_outer) = (libm::cosf(inner), libm::cosf(outer));
            Some(Light::Spot { position, direction, intensity: power, range, radius, cos_inner, cos_outer })
        }
        other => {
            odd(format!("its type {other:?} does not exist; it was left out"));
            None
        }
    }
}
