//! Which lit parts are equal but for a rigid motion, and so can have the same charts.
//!
//! In: a scene. Out: for each part, the first one equal to it. Parts are equal if they place the same primitive, in the same
//! size and shape (equal dot products of the axes, so a rigid motion apart), and are treated alike as far as charts are
//! concerned. A mirrored part has its triangles wound the other way and is equal to other mirrored ones only.
//!
//! Limit: placements in many different sizes are charted one by one.

use super::{Part, Scene};
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

/// Which parts are equal.
#[derive(Debug)]
pub struct EqualParts {
    /// For each part, the first part equal to it: itself, if there is none before it, or if it is not lit or was cut at
    /// contacts.
    pub first: Vec<u32>,
}

impl EqualParts {
    /// Of a list of parts; `alone` says which are equal to no other one.
    pub(super) fn new(parts: &[Part], alone: impl Fn(usize) -> bool) -> Self {
        let mut first: BTreeMap<Kind, u32> = BTreeMap::new();
        let of = |(p, part): (u32, &Part)| match alone(p as usize) || !part.receives {
            true => p,
            false => *first.entry(Kind::of(part)).or_insert(p),
        };
        Self { first: (0..).zip(parts).map(of).collect() }
    }

    /// The wanted parts in sets of equal ones, in the order of their first.
    #[must_use]
    pub fn sets(&self, wanted: impl Fn(usize) -> bool) -> Vec<Vec<u32>> {
        let mut sets: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (p, first) in self.first.iter().enumerate().filter(|(p, _)| wanted(*p)) {
            sets.entry(*first).or_default().push(p as u32);
        }
        sets.into_values().collect()
    }
}

impl Scene {
    /// Which of its parts are equal.
    #[must_use]
    pub fn equal_parts(&self) -> EqualParts {
        EqualParts::new(&self.parts, |p| self.is_cut(p))
    }
}
