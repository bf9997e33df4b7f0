//! What the solver finds: irradiance of the front patches, as two halves that share no random number.
//!
//! Their mean is the result, their difference tells its error.

use crate::base::{LightVector, Rgb, parallel};

/// Irradiance of the front patches by two halves of the random numbers [lx].
#[derive(Debug, Default, Clone)]
pub(super) struct Halves {
    /// Straight from the emitters, but for what the gather found of the sky.
    pub(super) direct: [Vec<Rgb>; 2],
    /// After reflections, and what the gather found of the sky.
    pub(super) indirect: [Vec<Rgb>; 2],
    /// Mean of what the gather found of the sky, part of `indirect`.
    pub(super) sky: Vec<Rgb>,
    /// Light vectors of `direct` and of `indirect` [lx]; empty unless directional light is baked.
    pub(super) vectors: [Vec<LightVector>; 2],
}

impl Halves {
    /// Mean of the halves [lx].
    pub(super) fn irradiance(&self) -> Vec<Rgb> {
        parallel::map(self.direct[0].len(), |i| self.at(i))
    }

    /// Mean of the halves at one front patch [lx].
    pub(super) fn at(&self, i: usize) -> Rgb {
        let half = |h: usize| self.direct[h][i] + self.indirect[h][i];
        (half(0) + half(1)) * 0.5
    }

    /// Light vectors of all light [lx]; empty if they are not wanted.
    pub(super) fn light_vectors(&self) -> Vec<LightVector> {
        let [direct, indirect] = &self.vectors;
        direct.iter().zip(indirect).map(|(a, b)| *a + *b).collect()
    }

    /// Light of other sources comes on top.
    pub(super) fn add(&mut self, other: &Self) {
        for (own, others) in [(&mut self.direct, &other.direct), (&mut self.indirect, &other.indirect)] {
            for (own, others) in own.iter_mut().zip(others) {
                own.iter_mut().zip(others).for_each(|(a, b)| *a += *b);
            }
        }
        self.sky.iter_mut().zip(&other.sky).for_each(|(a, b)| *a += *b);
        for (own, others) in self.vectors.iter_mut().zip(&other.vectors) {
            own.iter_mut().zip(others).for_each(|(a, b)| *a += *b);
        }
    }
}
