//! Random streams that are hashes of what they are for, never of who draws them.
//!
//! A stream is keyed by (seed, stage, two indices); its k-th number is a hash of the key and k. So a line or a texel
//! gets the same numbers on any thread, in any order, and from any split of the work.
//!
//! Source: the mixing function is the finaliser of `SplitMix64` (Steele, Lea, Flood, OOPSLA 2014), variant 13 of
//! Stafford's search ("Better bit mixing", 2011).

/// Which stage draws; part of every key, so that stages never share numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Stage {
    /// Direct light.
    Light = 1,
    /// Shooting walk.
    Walk = 2,
    /// Final gather.
    Gather = 3,
    /// Sub-texel validity and link visibility.
    Patches = 4,
    /// Pictures of the result.
    Render = 5,
    /// Stochastic alpha.
    Alpha = 6,
    /// How open the surroundings are.
    Openness = 7,
    /// Ways out of narrow places.
    Pockets = 8,
    /// Light where near rays of the gather hit.
    Anew = 9,
    /// Where textures are looked at.
    Textures = 10,
}

/// Mixes 64 bits; a bijection in which every input bit changes half of the output bits.
#[must_use]
pub const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// A counter-based stream of random numbers.
#[derive(Clone, Copy, Debug)]
pub struct Stream {
    state: u64,
}

impl Stream {
    /// The stream for index pair (`a`, `b`) of a stage, for example (bounce, line) or (texel, sample).
    #[must_use]
    pub const fn new(seed: u64, stage: Stage, a: u64, b: u64) -> Self {
        let k = mix(seed.wrapping_add(GOLDEN.wrapping_mul(stage as u64)));
        let k = mix(k.wrapping_add(GOLDEN).wrapping_add(a.wrapping_mul(0xd6e8_feb8_6659_fd93)));
        Self { state: mix(k ^ b.wrapping_mul(0xa076_1d64_78bd_642f).wrapping_add(GOLDEN)) }
    }

    /// Next 64 random bits.
    pub const fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }

    /// Next 32 random bits.
    pub const fn next_u32(&mut self) -> u32 {
        (self.next_u64() >> 32) as u32
    }

    /// Next uniform number in [0, 1).
    pub const fn next_f32(&mut self) -> f32 {
        unit_f32(self.next_u32())
    }

    /// Next uniform number in [0, 1) with 53 bits.
    pub const fn next_f64(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }
}

/// The top 24 of 32 bits as a number in [0, 1); 1.0 cannot come out.
#[must_use]
pub const fn unit_f32(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_mean_and_variance() {
        let n = 1_000_000;
        let (mut sum, mut squares) = (0.0f64, 0.0f64);
        for i in 0..n {
            let x = f64::from(Stream::new(7, Stage::Walk, 3, i).next_f32());
            sum += x;
            squares += x * x;
        }
        let mean = sum / n as f64;
        assert!((mean - 0.5).abs() < 4.0 * (1.0 / 12.0 / n as f64).sqrt());
        assert!((squares / n as f64 - mean * mean - 1.0 / 12.0).abs() < 1e-3);
    }

    #[test]
    fn neighbouring_streams_are_uncorrelated() {
        let n = 200_000u64;
        for lag in 1..4 {
            let mut sum = 0.0f64;
            for i in 0..n {
                let a = f64::from(Stream::new(1, Stage::Gather, i, 0).next_f32()) - 0.5;
                let b = f64::from(Stream::new(1, Stage::Gather, i + lag, 0).next_f32()) - 0.5;
                sum += a * b;
            }
            let correlation = sum / n as f64 * 12.0;
            assert!(correlation.abs() < 4.5 / (n as f64).sqrt(), "lag {lag}: {correlation}");
        }
    }
}
