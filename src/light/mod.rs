//! Direct light: irradiance of every patch straight from lights, emissive surfaces and sky.
//!
//! Two ways: [`direct`] gathers it by shadow rays from every patch; [`shoot`] makes the lines that leave the emitters,
//! for the walk to trace as in the paper. [`glare`] looks in the same way for patches that are as bright as lamps.
//!
//! Units: sun E = I cos θ [lx]; point and spot E = I cos θ/d² [cd] with the window and cone of `KHR_lights_punctual`;
//! surfaces and sky by radiance [cd/m²]. No hidden factor anywhere.

mod allot;
mod bounds;
mod common;
mod cone;
mod direct;
mod divide;
mod emitters;
pub mod glare;
mod hard;
mod infinity;
mod lit;
mod look;
mod lost;
mod moved;
mod neighbors;
mod openings;
mod piece;
mod probe;
mod punctual;
pub mod shoot;
mod site;
mod slope;
mod survey;
mod tree;
mod twice;
mod unhidden;

pub use direct::{Direct, direct};
pub use divide::flux_of_parts;
pub use emitters::{Emitters, Source};
pub use lost::lost;
pub use moved::moved;
pub use openings::Openings;
pub use probe::Probe;

/// How to gather direct light.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Shadow rays per texel to what is near, to the sky, and to each sun with a size; fewer where they agree, up to 16
    /// times as many where they do not. The error falls with its square root.
    pub samples: u32,
    /// Rays of the final gather for each of these samples: they see the sky, too. 0 where there are none.
    pub gather_rays: f32,
    /// Chooses the random numbers.
    pub seed: u64,
    /// Find light vectors, too.
    pub directional: bool,
}
