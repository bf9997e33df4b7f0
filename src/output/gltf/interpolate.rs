//! Attributes of vertices that were added between others.
//!
//! In: an accessor's elements and the origins of the output vertices, the source's own first. Out: elements for all of
//! them, in the accessor's own component type. Numbers are interpolated and rounded to the type; normals and tangents
//! are made as long as one again, a tangent keeps its handedness; integers of custom attributes that stand for
//! themselves (feature numbers, say) are taken from the nearest vertex.

use super::append::component_size;
use crate::scene::AccessorData;
use crate::scene::Origin;

/// What to do with an attribute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Weighted sum.
    Sum,
    /// Weighted sum of so many components, then unit length; the others from the nearest vertex.
    Direction,
    /// From the nearest vertex.
    Nearest,
}

/// The accessor with an element for each origin; `None` if it has too few to begin with.
pub(super) fn extended(data: &AccessorData, name: &str, origins: &[Origin]) -> Option<AccessorData> {
    let size = component_size(data.component_type);
    let element = data.components * size;
    let complete = data.bytes.len() >= data.count * element;
    if !complete || origins.iter().flat_map(|o| o.source).any(|v| v as usize >= data.count) {
        return None;
    }
    let kind = kind(data, name);
    let mut bytes = Vec::with_capacity(origins.len() * element);
    for origin in origins {
        if origin.is_source() || kind == Kind::Nearest {
            let at = nearest(origin) * element;
            bytes.extend_from_slice(&data.bytes[at..at + element]);
        } else {
            blend(data, origin, kind).iter().for_each(|v| push(data, *v, &mut bytes));
        }
    }
    Some(AccessorData { count: origins.len(), bytes, ..*data })
}

fn kind(data: &AccessorData, name: &str) -> Kind {
    const F32: u32 = 5126;
    match name {
        "NORMAL" | "TANGENT" => Kind::Direction,
        _ if name.starts_with('_') && data.component_type != F32 && !data.normalized => Kind::Nearest,
        _ => Kind::Sum,
    }
}

/// The source vertex with the largest weight.
fn nearest(origin: &Origin) -> usize {
    let best = (1..3).fold(0, |best, k| if origin.weight[k] > origin.weight[best] { k } else { best });
    origin.source[best] as usize
}

/// Component values as stored, not yet normalised or rounded.
fn blend(data: &AccessorData, origin: &Origin, kind: Kind) -> Vec<f64> {
    let mut sums = vec![0.0; data.components];
    for (source, weight) in origin.source.iter().zip(origin.weight).filter(|(_, w)| *w > 0.0) {
        for (c, sum) in sums.iter_mut().enumerate() {
            *sum += f64::from(weight) * value(data, *source as usize * data.components + c);
        }
    }
    if kind == Kind::Direction && sums.len() >= 3 {
        let length = sums[..3].iter().fold(0.0, |sum, v| sum + v * v).sqrt();
        let unit = most(data);
        if length > 0.0 {
            sums[..3].iter_mut().for_each(|v| *v *= unit / length);
        }
        if let Some(handedness) = sums.get_mut(3) {
            *handedness = value(data, nearest(origin) * data.components + 3);
        }
    }
    sums
}

/// The stored value that stands for one.
fn most(data: &AccessorData) -> f64 {
    match data.component_type {
        5120 => 127.0,
        5121 => 255.0,
        5122 => 32767.0,
        5123 => 65535.0,
        _ => 1.0,
    }
}

fn value(data: &AccessorData, component: usize) -> f64 {
    let size = component_size(data.component_type);
    super::append::component(data.component_type, &data.bytes[component * size..(component + 1) * size])
}

fn push(data: &AccessorData, value: f64, bytes: &mut Vec<u8>) {
    let whole = libm::round(value);
    match data.component_type {
        5120 => bytes.push((whole as i8).to_le_bytes()[0]),
        5121 => bytes.push(whole as u8),
        5122 => bytes.extend((whole as i16).to_le_bytes()),
        5123 => bytes.extend((whole as u16).to_le_bytes()),
        5125 => bytes.extend((whole as u32).to_le_bytes()),
        _ => bytes.extend((value as f32).to_le_bytes()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn floats(components: usize, values: &[f32]) -> AccessorData {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        AccessorData { count: values.len() / components, components, component_type: 5126, normalized: false, bytes }
    }

    fn middle() -> [Origin; 3] {
        [Origin::source(0), Origin::source(1), Origin { source: [0, 1, 0], weight: [0.75, 0.25, 0.0] }]
    }

    #[test]
    fn numbers_are_interpolated_in_their_type() {
        let uv = extended(&floats(2, &[0.0, 8.0, 4.0, 0.0]), "TEXCOORD_0", &middle()).unwrap();
        let last: Vec<f32> = uv.bytes[16..].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        assert_eq!((uv.count, last), (3, vec![1.0, 6.0]));
        let bytes =
            AccessorData { count: 2, components: 1, component_type: 5121, normalized: true, bytes: vec![0, 255] };
        assert_eq!(extended(&bytes, "COLOR_0", &middle()).unwrap().bytes, [0, 255, 64]);
    }

    #[test]
    fn directions_keep_their_length_and_feature_numbers_stay_numbers() {
        let tangents = floats(4, &[1.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0]);
        let out = extended(&tangents, "TANGENT", &middle()).unwrap();
        let last: Vec<f32> = out.bytes[32..].chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
        assert!((last[0].hypot(last[1]) - 1.0).abs() < 1e-6 && last[3] == -1.0 && last[0] > last[1]);
        let ids = AccessorData { count: 2, components: 1, component_type: 5121, normalized: false, bytes: vec![3, 9] };
        assert_eq!(extended(&ids, "_FEATURE_ID_0", &middle()).unwrap().bytes, [3, 9, 3]);
        assert!(extended(&ids, "_FEATURE_ID_0", &[Origin::source(2)]).is_none());
    }
}
