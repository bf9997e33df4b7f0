//! Lights of `KHR_lights_punctual` and `EXT_lights_ies` in world space.
//!
//! Defaults of the extension: white, intensity 1, no range, cone 0 to π/4. A node's scale changes neither intensity nor
//! range. Beyond the extension, `extras` of a light may hold `radius` [m] for point and spot lights, and `angle` [rad],
//! the angular diameter, for directional ones, up to [`MOST_ANGLE`].

use super::Error;
use super::Light;
use super::Profile;
use super::lamps::Profiles;
use super::nodes::Walk;
use super::schema::LightEntry;
use super::schema::NodeProfile;
use super::schema::Root;
use super::treat::Treater;
use crate::base::Rgb;
use crate::base::Warning;
use core::f32::consts::FRAC_PI_2;
use glam::{DMat4, Mat3};
use std::sync::Arc;

/// Largest angular diameter of a sun [rad], 60°: what is larger is a sky.
const MOST_ANGLE: f32 = core::f32::consts::FRAC_PI_3;

/// All lights of the visible nodes, in document order.
#[derive(Default)]
pub(super) struct Found {
    pub(super) lights: Vec<Light>,
    /// Node of each.
    pub(super) nodes: Vec<usize>,
    /// Name of the group of each.
    pub(super) groups: Vec<Option<String>>,
}

/// `sizes` overrides angle [rad] of every sun and radius [m] of every other light; `treater` knows what rules and
/// `extras` say, `profiles` what IES files do.
pub(super) fn read(
    root: &Root,
    walk: &Walk,
    profiles: &Profiles,
    sizes: [Option<f32>; 2],
    treater: &mut Treater<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Found, Error> {
    let mut found = Found::default();
    for placed in walk.placed.iter().filter(|p| p.visible) {
        let (extensions, world) = (&root.nodes[placed.node].extensions, walk.worlds[placed.node]);
        if extensions.light.is_none() && extensions.ies.is_none() {
            continue;
        }
        let name = root.node_name(placed.node);
        let mut odd =
            |what: String| warnings.push(Warning::new("bad-light", format!("light of node {name}: {what}")).at(&name));
        if let Some(reference) = &extensions.light {
            let index = reference.light.unwrap_or(usize::MAX);
            let entry = root.lights().get(index).ok_or_else(|| {
                let have = root.lights().len();
                Error::invalid(format!("node {name}: its light does not exist, the document has {have}"))
            })?;
            let (factor, group) = treater.light(placed.node, index);
            let profile = profiles.of_lights.get(&index);
            found.add(placed.node, convert(entry, world, profile, sizes, factor, &mut odd), group);
        }
        if let Some(reference) = &extensions.ies
            && let Some(index) = reference.light
            && let Some(profile) = profiles.measured.get(&index)
        {
            let (factor, group) = treater.profile(placed.node, index);
            found.add(placed.node, measured(reference, world, profile, sizes[1], factor, &mut odd), group);
        }
        if placed.animated {
            let what = format!("node {name} is animated: its light was baked where it stands at rest");
            warnings.push(Warning::new("animated-node", what).at(&name));
        }
    }
    Ok(found)
}

impl Found {
    fn add(&mut self, node: usize, light: Option<Light>, group: Option<String>) {
        if let Some(light) = light {
            self.lights.push(light);
            self.nodes.push(node);
            self.groups.push(group);
        }
    }
}

/// A lamp of `EXT_lights_ies`.
fn measured(
    reference: &NodeProfile,
    world: DMat4,
    profile: &Arc<Profile>,
    radius: Option<f32>,
    factor: f32,
    odd: &mut impl FnMut(String),
) -> Option<Light> {
    let color = Rgb::from_array(reference.color);
    let clamped = color.clamp(Rgb::ZERO, Rgb::ONE);
    if color != clamped {
        odd("its colour is outside [0, 1] and was clamped".to_owned());
    }
    let power = if color.is_finite() { clamped * (reference.multiplier * factor) } else { color };
    lamp(world, profile, power, f32::INFINITY, radius.unwrap_or(0.0), odd)
}

/// A lamp with a profile, whose candela are multiplied by `power`.
fn lamp(
    world: DMat4,
    profile: &Arc<Profile>,
    power: Rgb,
    range: f32,
    radius: f32,
    odd: &mut impl FnMut(String),
) -> Option<Light> {
    let usable = |v: Rgb| v.is_finite() && v.min_element() >= 0.0;
    if !(usable(power) && usable(power * profile.peak())) {
        odd("its colour or intensity is negative or not finite; it was left out".to_owned());
        return None;
    }
    let [x, z] = [world.x_axis, world.z_axis].map(|axis| axis.truncate());
    let [x, z] = [x, z].map(|axis| (axis / axis.abs().max_element()).normalize_or_zero());
    let x = (x - z * x.dot(z)).normalize_or_zero();
    let y = z.cross(x) * if world.determinant() < 0.0 { -1.0 } else { 1.0 };
    if !(x.is_normalized() && z.is_normalized()) {
        odd("its node has no direction (scaled to zero); it was left out".to_owned());
        return None;
    }
    let axes = Mat3::from_cols(x.as_vec3(), y.as_vec3(), z.as_vec3());
    let position = world.w_axis.truncate().as_vec3();
    Some(Light::Profiled { position, axes, factor: power, range, radius, profile: Arc::clone(profile) })
}

/// `None` = the light cannot be used, and `odd` heard why. Its intensity is multiplied by `factor`.
fn convert(
    entry: &LightEntry,
    world: DMat4,
    profile: Option<&Arc<Profile>>,
    sizes: [Option<f32>; 2],
    factor: f32,
    odd: &mut impl FnMut(String),
) -> Option<Light> {
    let own = if profile.is_some() { 1.0 } else { entry.intensity };
    let power = Rgb::from_array(entry.color) * (own * factor);
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
    let angle = sizes[0].or_else(|| extra("angle", MOST_ANGLE)).unwrap_or(0.0);
    let range = match entry.range {
        Some(range) if range > 0.0 => range,
        Some(range) => {
            odd(format!("a range of {range} is not positive; it was ignored"));
            f32::INFINITY
        }
        None => f32::INFINITY,
    };
    if let Some(profile) = profile {
        return lamp(world, profile, power, range, radius, odd);
    }
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
            if outer == 0.0 {
                odd("its outerConeAngle is 0 or less, so it lights nothing; it was left out".to_owned());
                return None;
            }
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
