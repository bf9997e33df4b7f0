//! A point of a patch as a point of another one sees it.

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
