//! Mathematics, random streams and parallel helpers that know nothing of baking.
//!
//! Every function here is a pure function of its arguments, and gives the same bits on every CPU and thread count:
//! transcendental functions come from `libm` (pure Rust), never from the platform's C library, and nothing uses fused
//! multiply-add.

pub mod around;
pub mod bilinear;
pub mod cholesky;
pub mod color;
pub mod distribution;
pub mod exr_tiles;
pub mod frame;
pub mod groups;
pub mod light_vector;
pub mod low_discrepancy;
pub mod memory_limit;
pub mod nonnegative;
pub mod parallel;
pub(crate) mod percentile;
pub mod plane;
pub mod progress;
pub mod random;
pub mod sets;
pub mod sparse;
pub mod splice;
pub mod warning;
pub mod warp;

pub use around::Around;
pub use color::Rgb;
pub use frame::Frame;
pub use groups::Groups;
pub use light_vector::LightVector;
pub use memory_limit::MemoryLimit;
pub use progress::Progress;
pub use random::Stream;
pub use sets::Sets;
pub use sparse::Sparse;
pub use warning::{Warned, Warning};
