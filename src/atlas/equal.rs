//! Which parts can have the same charts.
//!
//! In: a scene. Out: for each part, the first one equal to it. Parts are equal if they place the same primitive, in the same
//! size and shape (equal dot products of the axes, so a rigid motion apart), and are treated alike as far as charts are
//! concerned. A mirrored part has its triangles wound the other way and is equal to other mirrored ones only.
//!
//! Limit: placements in many different sizes are charted one by one.

use crate::scene::Part;
use crate::scene::Scene;
use std::collections::BTreeMap;

/// Steps of a unit in which dot products are told apart: rotations that were rounded to f32 differ by a hundredth of one.
const STEPS: f64 = (1u32 << 17) as f64;
/// Powers of two are common sizes, so units change elsewhere.
const OFF_POWERS: f64 = 1.4;

/// What equal parts have in common.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Kind {
    /// Mesh, primitive, material.
    what: [usize; 3],
    /// Winding, and whether it casts shadows, which decides what is laid out together.
    flags: [bool; 2],
    /// Bits of the density factor.
    density: u32,
    /// Dot products of the axes, rounded to steps of a unit that is about as large as the largest one.
    axes: [i64; 6],
    /// The exponent of their unit.
    exponent: i64,
}

impl Kind {
    fn of(part: &Part) -> Self {
        let longest = part.axes[..3].iter().fold(0.0, |a: f64, b| a.max(*b));
        let exponent = if longest > 0.0 { libm::ilogb(longest * OFF_POWERS) } else { 0 };
        Self {
            what: [part.mesh, part.primitive, part.material],
            flags: [part.mirrored, part.treatment.casts],
            density: part.treatment.density.to_bits(),
            axes: part.axes.map(|x| libm::round(libm::scalbn(x, -exponent) * STEPS) as i64),
            exponent: exponent.into(),
        }
    }
}

/// For each part, the first part equal to it: itself, if there is none before it, or if it was cut at contacts.
pub(super) fn first_equal(scene: &Scene) -> Vec<u32> {
    let mut first: BTreeMap<Kind, u32> = BTreeMap::new();
    let of = |(p, part): (u32, &Part)| match scene.is_cut(p as usize) || !part.receives {
        true => p,
        false => *first.entry(Kind::of(part)).or_insert(p),
    };
    (0..).zip(&scene.parts).map(of).collect()
}

/// The wanted parts in sets of equal ones, in the order of their first.
pub(super) fn sets(first_equal: &[u32], wanted: impl Fn(usize) -> bool) -> Vec<Vec<u32>> {
    let mut sets: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (p, first) in first_equal.iter().enumerate().filter(|(p, _)| wanted(*p)) {
        sets.entry(*first).or_default().push(p as u32);
    }
    sets.into_values().collect()
}
