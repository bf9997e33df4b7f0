//! Random changes of bytes and of JSON trees, for tests that feed readers with what nobody meant to write.
//!
//! In: data and a [`Random`]. Out: the same data, changed; the same numbers give the same change on every machine. The
//! changes are those of structure-aware fuzzers: bits, interesting integers, cuts, repeats and splices for bytes; other
//! types, extreme numbers, removed, doubled, swapped and cross-linked values for trees.

use serde_json::{Map, Value, json};

/// Numbers by hashing a counter (splitmix64: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014).
pub(crate) struct Random(u64);

impl Random {
    /// The stream of this name.
    pub(crate) fn new(name: &str, seed: u64, index: u64) -> Self {
        let fold = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        let mut random = Self(name.bytes().fold(0xcbf2_9ce4_8422_2325, fold));
        for number in [seed, index] {
            random.0 = random.next() ^ number;
        }
        random
    }

    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Below `n`; 0 if there is nothing below it.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    pub(crate) fn one_in(&mut self, n: usize) -> bool {
        self.below(n) == 0
    }

    pub(crate) fn pick<'a, T>(&mut self, from: &'a [T]) -> &'a T {
        &from[self.below(from.len())]
    }

    /// Few more often than many: 1 with probability ½, 2 with ¼, and so on up to `most`.
    fn few(&mut self, most: u32) -> u32 {
        self.next().trailing_zeros().min(most - 1) + 1
    }
}

/// Integers at which programs err.
const INTERESTING: [u64; 18] = [
    0,
    1,
    2,
    3,
    4,
    7,
    0x7f,
    0x80,
    0xff,
    0x100,
    0x7fff,
    0x8000,
    0xffff,
    0x1_0000,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    u64::MAX,
];

/// Floats at which programs err.
const FLOATS: [f32; 10] =
    [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN_POSITIVE, -0.0, 1e-40, 1e6, -1e7, 1e-4];

/// Changes bytes in one to six places; `donor` is what pieces are taken from besides the data itself.
pub(crate) fn bytes(data: &mut Vec<u8>, donor: &[u8], random: &mut Random) {
    for _ in 0..random.few(6) {
        change_bytes(data, donor, random);
    }
}

fn change_bytes(data: &mut Vec<u8>, donor: &[u8], random: &mut Random) {
    if data.is_empty() {
        data.extend_from_slice(&donor[..random.below(donor.len().min(64))]);
        return;
    }
    let at = random.below(data.len());
    match random.below(12) {
        0..3 => data[at] ^= 1 << random.below(8),
        3 => data[at] = random.next() as u8,
        4..6 => overwrite_number(data, at, random),
        6 => {
            let value = random.pick(&FLOATS).to_le_bytes();
            overwrite(data, at & !3, &value);
        }
        7 if random.one_in(3) => data.truncate(at),
        8 => {
            let end = at + random.below((data.len() - at).min(64));
            data.drain(at..end);
        }
        9 => {
            let end = at + random.below((data.len() - at).min(256));
            let piece = data[at..end].to_vec();
            let to = random.below(data.len());
            data.splice(to..to, piece);
        }
        10 if !donor.is_empty() => {
            let from = random.below(donor.len());
            let piece = &donor[from..from + random.below((donor.len() - from).min(64))];
            overwrite(data, at, piece);
        }
        _ => {
            let length = random.below(16).min(data.len() - at);
            let value = if random.one_in(2) { 0 } else { 0xff };
            data[at..at + length].fill(value);
        }
    }
}

fn overwrite_number(data: &mut [u8], at: usize, random: &mut Random) {
    let size = *random.pick(&[1, 2, 4, 8]);
    let value = *random.pick(&INTERESTING);
    let value = if random.one_in(3) { value.wrapping_sub(random.below(4) as u64) } else { value };
    let at = if random.one_in(2) { at & !(size - 1) } else { at };
    match random.one_in(3) {
        true => overwrite(data, at, &value.to_be_bytes()[8 - size..]),
        false => overwrite(data, at, &value.to_le_bytes()[..size]),
    }
}

fn overwrite(data: &mut [u8], at: usize, with: &[u8]) {
    data.iter_mut().skip(at).zip(with).for_each(|(to, from)| *to = *from);
}

/// Spellings that JSON and TOML readers meet seldom.
const TOKENS: [&str; 30] = [
    "1e999",
    "-1e999",
    "1e-999",
    "-0",
    "NaN",
    "nan",
    "inf",
    "null",
    "true",
    "[]",
    "{}",
    "\"\"",
    "\\u0000",
    "\\ud800",
    "0.1e1",
    "1E400",
    "18446744073709551616",
    "-9223372036854775809",
    "00",
    "+1",
    ",",
    ":",
    "[[",
    "\u{feff}",
    "\t",
    "é",
    "\"a\":",
    "=",
    "#",
    "'''",
];

/// Changes the text of a document: numbers and punctuation become others, or anything [`bytes`] does.
pub(crate) fn text(data: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..random.few(2) {
        if data.is_empty() || random.one_in(4) {
            change_bytes(data, b"{}[]:,\"", random);
            continue;
        }
        let token = random.pick(&TOKENS).as_bytes().to_vec();
        let at = random.below(data.len());
        // A number at or after that place, with all its digits.
        let digit = |b: &u8| b.is_ascii_digit();
        let start = data[at..].iter().position(digit).map_or(at, |n| at + n);
        let length = data[start..].iter().position(|b| !digit(b)).unwrap_or(0);
        data.splice(start..start + length, token);
    }
}

/// Property names that a reader may look for, wherever they stand.
const KEYS: [&str; 34] = [
    "nodes",
    "children",
    "mesh",
    "camera",
    "skin",
    "matrix",
    "scale",
    "bufferView",
    "buffer",
    "byteOffset",
    "byteLength",
    "byteStride",
    "count",
    "componentType",
    "type",
    "normalized",
    "sparse",
    "indices",
    "material",
    "mode",
    "targets",
    "extensions",
    "extras",
    "uri",
    "source",
    "index",
    "texCoord",
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_texture_transform",
    "MOZ_lightmap",
    "KHR_lights_punctual",
    "POSITION",
    "TEXCOORD_1",
];

const STRINGS: [&str; 20] = [
    "",
    "x",
    "../../x",
    "/etc/passwd",
    "data:",
    "data:,",
    "data:;base64,AAAA",
    "data:image/png;base64,iVBORw0KGgo=",
    "%2e%2e/x",
    "a\u{0}b",
    "VEC3",
    "SCALAR",
    "MAT4",
    "MASK",
    "BLEND",
    "spot",
    "directional",
    "image/webp",
    "💡",
    "a/b\\c",
];

/// Changes a tree in one to four places.
pub(crate) fn json(tree: &mut Value, random: &mut Random) {
    for _ in 0..random.few(4) {
        change_tree(tree, random);
    }
}

fn change_tree(tree: &mut Value, random: &mut Random) {
    let size = size_of_tree(tree);
    let at = random.below(size);
    // Values from elsewhere make indices that exist and objects of the wrong kind.
    let elsewhere = match random.below(size) {
        0 => json!({}),
        other => nth(tree, other).clone(),
    };
    match random.below(10) {
        0..3 => *nth(tree, at) = odd(random),
        3..5 => tweak(nth(tree, at), random),
        5 => *nth(tree, at) = elsewhere,
        6 => match nth(tree, at) {
            Value::Array(list) => list.push(elsewhere),
            Value::Object(object) => drop(object.insert((*random.pick(&KEYS)).to_owned(), elsewhere)),
            other => *other = json!([elsewhere]),
        },
        7 => remove(nth(tree, at), random),
        8 => double(nth(tree, at), random),
        _ => {
            if let Value::Object(object) = nth(tree, at) {
                object.insert((*random.pick(&KEYS)).to_owned(), odd(random));
            }
        }
    }
}

fn odd(random: &mut Random) -> Value {
    match random.below(16) {
        0 => json!(null),
        1 => json!(random.one_in(2)),
        2 => json!([]),
        3 => json!({}),
        4 => json!(*random.pick(&STRINGS)),
        5 => json!([0, 0]),
        6..9 => json!(random.below(9)),
        9 => json!(-1),
        10 => json!(*random.pick(&INTERESTING)),
        11 => json!(*random.pick(&[1e308, -1e39, 1e-320, 0.5, -1e7, 1e-4, 1e30, 3.4e38])),
        12 => json!(f64::from(random.below(2000) as u32) / 100.0 - 10.0),
        13 => json!("x".repeat(random.below(3000))),
        14 => json!(*random.pick(&[5120, 5121, 5122, 5123, 5125, 5126])),
        _ => json!([[[[]]]]),
    }
}

fn tweak(value: &mut Value, random: &mut Random) {
    let change = random.below(6);
    *value = match value {
        Value::Number(number) => match (number.as_u64(), change) {
            (Some(n), 0) => json!(n.wrapping_add(1)),
            (Some(n), 1) => json!(n.wrapping_sub(1)),
            (Some(n), 2) => json!(n.saturating_mul(2)),
            (Some(n), 3) => json!(n / 2),
            (Some(n), 4) => json!(format!("{n}")),
            _ => json!(-number.as_f64().unwrap_or(0.0)),
        },
        Value::String(_) => json!(*random.pick(&STRINGS)),
        Value::Bool(b) => json!(!*b),
        _ => odd(random),
    };
}

fn remove(value: &mut Value, random: &mut Random) {
    match value {
        Value::Array(list) if !list.is_empty() => drop(list.remove(random.below(list.len()))),
        Value::Object(object) => {
            let key = object.keys().nth(random.below(object.len())).cloned();
            key.map(|key| object.remove(&key));
        }
        other => *other = Value::Null,
    }
}

fn double(value: &mut Value, random: &mut Random) {
    match value {
        Value::Array(list) if !list.is_empty() => {
            let copy = list[random.below(list.len())].clone();
            let times = if random.one_in(50) { 1000 } else { 1 };
            let at = random.below(list.len() + 1);
            list.splice(at..at, std::iter::repeat_n(copy, times));
        }
        Value::Object(object) if object.len() > 1 => {
            // Two properties change places.
            let keys: Vec<String> = object.keys().cloned().collect();
            let (a, b) = (random.pick(&keys).clone(), random.pick(&keys).clone());
            swap(object, &a, &b);
        }
        _ => {}
    }
}

fn swap(object: &mut Map<String, Value>, a: &str, b: &str) {
    let (x, y) = (object[a].clone(), object[b].clone());
    object[a] = y;
    object[b] = x;
}

fn size_of_tree(value: &Value) -> usize {
    1 + match value {
        Value::Array(list) => list.iter().map(size_of_tree).sum(),
        Value::Object(object) => object.values().map(size_of_tree).sum(),
        _ => 0,
    }
}

/// Value `n` in the order of the text; the tree itself is number 0.
fn nth(value: &mut Value, mut n: usize) -> &mut Value {
    if n == 0 {
        return value;
    }
    n -= 1;
    let children: Vec<&mut Value> = match value {
        Value::Array(list) => list.iter_mut().collect(),
        Value::Object(object) => object.values_mut().collect(),
        _ => vec![],
    };
    for child in children {
        let size = size_of_tree(child);
        if n < size {
            return nth(child, n);
        }
        n -= size;
    }
    unreachable!("n is below the size of the tree")
}
