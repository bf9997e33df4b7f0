//! Normal maps: the normal at a point of a surface that a texture bends.
//!
//! In: a point and its shading normal. Out: the normal that the material's normal map makes of it.
//!
//! Source: glTF 2.0, section 3.9.3: red is to the right of the picture, green up, blue away from the surface; `scale`
//! multiplies red and green. Where we differ: `TANGENT` is not read, nor is `MikkTSpace` computed. Tangents follow the
//! picture over each triangle, at right angles to the interpolated normal there, as three.js does where a mesh has none. On
//! flat and on evenly unrolled surfaces that is the same.
//!
//! Symbols: n shading normal   t, b directions in which u grows and v falls, at right angles to n
//!
//! Invariants: unit length, on the triangle's front side. Where a map says nothing that makes sense (coordinates without
//! area, blue below zero), the shading normal stays.

use super::{NormalMap, Scene};
use glam::{Vec2, Vec3};

impl Scene {
    /// A triangle has a normal map.
    #[must_use]
    pub fn has_relief(&self, triangle: u32) -> bool {
        self.material(triangle).normal_map.is_some()
    }

    /// Unit normal that light falls on, on the front side of a triangle whose geometric normal is known: the shading
    /// normal, bent by the normal map if there is one.
    #[must_use]
    pub fn relief_normal_over(&self, triangle: u32, b: Vec2, geometric: Vec3) -> Vec3 {
        let normal = self.shading_normal_over(triangle, b, geometric);
        let Some(map) = &self.material(triangle).normal_map else { return normal };
        let bent = self.bent(map, triangle, b, normal).unwrap_or(normal);
        if bent.dot(geometric) > 0.0 { bent } else { normal }
    }

    /// The normal of [`Scene::relief_normal_over`] where it is the same all over the triangle; most faces of exported boxes
    /// and walls have one normal at all their corners.
    #[must_use]
    pub fn even_normal(&self, triangle: u32, geometric: Vec3) -> Option<Vec3> {
        if self.has_relief(triangle) {
            return None;
        }
        let [p, q, r] = if self.part(triangle).flat { [geometric; 3] } else { self.corner_normals(triangle) };
        (p == q && q == r).then(|| self.shading_normal_over(triangle, Vec2::splat(1.0 / 3.0), geometric))
    }

    fn bent(&self, map: &NormalMap, triangle: u32, b: Vec2, n: Vec3) -> Option<Vec3> {
        let uv = self.corner_uvs(triangle, &map.texture);
        let at = self.texture_uv(triangle, b, &map.texture);
        let texel = self.textures[map.texture.texture].sample_linear(at).truncate() * 2.0 - 1.0;
        let [p, q, r] = self.corners(triangle);
        let (e1, e2, d1, d2) = (q - p, r - p, uv[1] - uv[0], uv[2] - uv[0]);
        let turn = d1.perp_dot(d2).signum();
        let (right, down) = ((e1 * d2.y - e2 * d1.y) * turn, (e2 * d1.x - e1 * d2.x) * turn);
        let t = (right - n * n.dot(right)).try_normalize()?;
        let side = n.cross(t);
        let b = if side.dot(down) > 0.0 { -side } else { side };
        let bent = (t * texel.x + b * texel.y) * map.scale + n * texel.z;
        bent.try_normalize().filter(|bent| texel.z > 0.0 && bent.is_finite())
    }
}
