//! Watertight ray–triangle test: a cheap filter in single precision, then the decision in double precision.
//!
//! Source: Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013. Where we differ, and why:
//! * the paper computes in f32 and falls back to f64 where an edge function is exactly 0. Here f64 always decides: f32
//!   may assign a hit near an edge to the neighbour of the right triangle (its error is 10⁻⁷ of the distance). Most
//!   triangles never get there: four at a time go through an f32 filter with a rigorous error bound;
//! * no fallback beyond f64 is needed: a rounded difference of rounded products has the sign of the exact one or is 0
//!   (rounding is monotone), and swapping the ends of an edge negates it exactly. 0 counts as inside. So triangles that
//!   share an edge never both refuse a ray on the basis of that edge, nor all triangles around a vertex.
//!
//! Symbols: the ray's largest direction axis becomes z; x, y are the others, in the order that keeps winding.
//!   a b c  corners relative to the ray's origin, sheared so that the ray is the z axis
//!   u v w  edge functions: twice the signed areas that belong to corners a, b, c     det  their sum
//!   ε      2⁻²⁴, half the spacing of f32 at 1
//!
//! Invariant: the filter never refuses a triangle that the exact test accepts. Limit: for a ray that starts exactly on a
//! triangle, t is 0 only up to rounding (±10⁻¹⁷ of the distances); such rays take their start from `origin`.

use super::build::Packet;
use glam::{DVec3, Vec3, Vec4};

/// What the tests need of a ray.
pub(super) struct Shear {
    /// x, y, z of the sheared space as axes of the world.
    axes: [usize; 3],
    /// Origin, by axis of the sheared space.
    origin: [f64; 3],
    /// x/z and y/z of the direction, and 1/z.
    slope: [f64; 3],
    origin_lanes: [Vec4; 3],
    slope_lanes: [Vec4; 2],
}

/// Where the line of a ray meets a triangle, on either side of the origin.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Crossing {
    pub(super) t: f64,
    /// Weights of corners 1 and 2.
    pub(super) b: [f64; 2],
    pub(super) front: bool,
}

impl Shear {
    /// For a direction that is finite and not zero.
    pub(super) fn new(origin: Vec3, direction: DVec3) -> Self {
        let d = direction.to_array();
        let size = direction.abs();
        let z = if size.x > size.y && size.x > size.z {
            0
        } else if size.y > size.z {
            1
        } else {
            2
        };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if d[z] < 0.0 {
            (x, y) = (y, x);
        }
        let slope = [d[x] / d[z], d[y] / d[z], 1.0 / d[z]];
        Self {
            axes: [x, y, z],
            origin: [x, y, z].map(|k| f64::from(origin[k])),
            slope,
            origin_lanes: [x, y, z].map(|k| Vec4::splat(origin[k])),
            slope_lanes: [Vec4::splat(slope[0] as f32), Vec4::splat(slope[1] as f32)],
        }
    }

    /// Bit i is set if triangle i of the packet may be met by the line of the ray; only bits below `count` can be.
    ///
    /// Error bound: with h the largest distance of a corner along the z axis and s the largest |x| + |y| of a sheared
    /// corner, each sheared coordinate is off by at most ε(2|x| + 4h), so each edge function by at most
    /// ε(6s² + 8sh) + 32ε²h² and terms of higher order; 16εs(s + h) + (16εh)² covers them. NaN after an overflow
    /// compares false, which does not refuse.
    #[inline]
    pub(super) fn filter(&self, packet: &Packet, count: usize) -> u32 {
        const EPSILON: f32 = 1.0 / 16_777_216.0;
        let [kx, ky, kz] = self.axes;
        let [sx, sy] = self.slope_lanes;
        let mut x = [Vec4::ZERO; 3];
        let mut y = [Vec4::ZERO; 3];
        let mut size = Vec4::ZERO;
        let mut depth = Vec4::ZERO;
        for i in 0..3 {
            let p = &packet.corners[i];
            let z = p[kz] - self.origin_lanes[2];
            x[i] = (p[kx] - self.origin_lanes[0]) - sx * z;
            y[i] = (p[ky] - self.origin_lanes[1]) - sy * z;
            size = size.max(x[i].abs() + y[i].abs());
            depth = depth.max(z.abs());
        }
        let u = x[2] * y[1] - y[2] * x[1];
        let v = x[0] * y[2] - y[0] * x[2];
        let w = x[1] * y[0] - y[1] * x[0];
        let far = depth * (16.0 * EPSILON);
        let error = size * (size + depth) * (16.0 * EPSILON) + far * far + Vec4::splat(f32::MIN_POSITIVE);
        let refused = u.min(v).min(w).cmplt(-error) & u.max(v).max(w).cmpgt(error);
        !refused.bitmask() & ((1 << count) - 1)
    }

    /// The decision for triangle `lane` of a packet.
    #[inline]
    pub(super) fn cross(&self, packet: &Packet, lane: usize) -> Option<Crossing> {
        let [x, y, z] = self.axes;
        let [p, q, r] = &packet.corners;
        self.cross_corners([
            [p[x][lane], p[y][lane], p[z][lane]],
            [q[x][lane], q[y][lane], q[z][lane]],
            [r[x][lane], r[y][lane], r[z][lane]],
        ])
    }

    #[inline]
    fn cross_corners(&self, corners: [[f32; 3]; 3]) -> Option<Crossing> {
        let [sx, sy, sz] = self.slope;
        let shear = |p: [f32; 3]| {
            let z = f64::from(p[2]) - self.origin[2];
            [f64::from(p[0]) - self.origin[0] - sx * z, f64::from(p[1]) - self.origin[1] - sy * z, sz * z]
        };
        let (a, b, c) = (shear(corners[0]), shear(corners[1]), shear(corners[2]));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        if det == 0.0 {
            return None;
        }
        let t = (u * a[2] + v * b[2] + w * c[2]) / det;
        Some(Crossing { t, b: [v / det, w / det], front: det > 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Stage;
    use crate::base::random::Stream;

    fn cross(origin: Vec3, direction: Vec3, corners: [Vec3; 3]) -> Option<Crossing> {
        let s = Shear::new(origin, direction.as_dvec3());
        s.cross_corners(corners.map(|p| s.axes.map(|k| p[k])))
    }

    const CORNERS: [Vec3; 3] = [Vec3::new(0.0, 0.0, 0.0), Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];

    #[test]
    fn weights_distance_and_side_are_right_along_every_axis_and_sign() {
        for axis in 0..3 {
            let turn = |p: Vec3| Vec3::new(p[(3 - axis) % 3], p[(4 - axis) % 3], p[(5 - axis) % 3]);
            let corners = CORNERS.map(turn);
            for side in [1.0, -1.0] {
                let h = cross(turn(Vec3::new(0.25, 0.5, 3.0 * side)), turn(Vec3::new(0.0, 0.0, -2.0 * side)), corners);
                let expected = Crossing { t: 1.5, b: [0.25, 0.5], front: side > 0.0 };
                assert_eq!(h, Some(expected), "axis {axis} side {side}");
            }
        }
    }

    #[test]
    fn edges_and_corners_count() {
        for p in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.0, 0.5], [0.5, 0.5]] {
            let h = cross(Vec3::new(p[0], p[1], 1.0), Vec3::NEG_Z, CORNERS).unwrap();
            assert_eq!(h.b, p.map(f64::from));
        }
        assert_eq!(cross(Vec3::new(0.5, 0.500_000_06, 1.0), Vec3::NEG_Z, CORNERS), None);
        assert_eq!(cross(Vec3::new(0.5, -1e-30, 1.0), Vec3::NEG_Z, CORNERS), None);
    }

    #[test]
    fn rays_in_the_plane_and_triangles_without_area_are_not_met() {
        assert_eq!(cross(Vec3::new(-1.0, 0.25, 0.0), Vec3::X, CORNERS), None);
        let thin = [Vec3::ZERO, Vec3::X, Vec3::new(0.5, 0.0, 0.0)];
        assert_eq!(cross(Vec3::new(0.25, 0.0, 1.0), Vec3::NEG_Z, thin), None);
        assert_eq!(cross(Vec3::new(0.25, 0.0, 1.0), Vec3::NEG_Z, [Vec3::X; 3]), None);
    }

    /// The filter lets through whatever the exact test accepts, for rays aimed at edges and corners, from far and near.
    #[test]
    fn the_filter_refuses_no_hit() {
        let mut s = Stream::new(3, Stage::Render, 0, 0);
        let mut accepted = 0;
        let mut refused = 0;
        for i in 0..200_000 {
            let scale = [1e-3, 1.0, 1e3][i % 3];
            let far = [1.0, 100.0, 1e5][i / 3 % 3];
            let mut point = |size: f32| Vec3::from_array([(); 3].map(|()| (s.next_f32() - 0.5) * size));
            let corners = [point(scale), point(scale), point(scale)];
            let origin = point(scale * far);
            let [mut f, mut g] = [s.next_f32(), s.next_f32()];
            if i % 2 == 0 {
                g = 0.0;
            }
            if i % 4 == 0 {
                f = f.round();
            }
            let target = corners[0] + (corners[1] - corners[0]) * f + (corners[2] - corners[0]) * g;
            let shear = Shear::new(origin, (target - origin).as_dvec3());
            let lanes = corners.map(|p| [0, 1, 2].map(|k| Vec4::splat(p[k])));
            let packet = Packet { corners: lanes, triangles: [0; 4] };
            let exact = shear.cross(&packet, 2).is_some();
            let passed = shear.filter(&packet, 4);
            assert!(passed == 15 || (passed == 0 && !exact), "{corners:?} {origin} {target}");
            accepted += usize::from(exact);
            refused += usize::from(passed == 0);
        }
        assert!(accepted > 50_000, "{accepted}");
        assert!(refused > 20_000, "{refused}");
    }
}
