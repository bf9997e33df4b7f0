//! A point of a patch as a point of another one sees it, and what a look at light from there finds.

use crate::base::Rgb;
use crate::trace::Ray;
use glam::Vec3;

/// Where from, where to.
#[derive(Debug, Clone, Copy)]
pub struct Sight {
    /// What is seen.
    pub patch: usize,
    /// Where it is seen from [m].
    pub position: Vec3,
    /// Shading normal there.
    pub normal: Vec3,
    /// Unit direction to what is seen.
    pub direction: Vec3,
    /// How far away it is [m].
    pub distance: f32,
    /// Cosine between the direction and the normal of what is seen, not below 0.
    pub facing: f32,
}

/// What one look at all lights from a point of a patch finds.
#[derive(Debug, Clone, Copy)]
pub struct Looked {
    /// Direct irradiance, of all lights, surfaces and the sky [lx].
    pub direct: Rgb,
    /// The ray by cosine that goes on, without end; `None` if a bent normal sends it below the surface.
    pub onward: Option<Ray>,
    /// Shading normal.
    pub normal: Vec3,
    /// Shadow rays that were shot.
    pub rays: u64,
}
