//! Watertight ray–triangle test: a cheap filter in single precision, then the decision in double precision.
//!
//! Source: Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013. Where we differ, and why:
//! * the paper computes in f32 and falls back to f64 where an edge function is exactly 0. Here f64 always decides: f32
//!   may assign a hit near an edge to the neighbour of the right triangle (its error is 10⁻⁷ of the distance). Most
//!   triangles never get there: eight at a time go through an f32 filter with a rigorous error bound;
//! * no fallback beyond f64 is needed: a rounded difference of rounded products has the sign of the exact one or is 0
//!   (rounding is monotone), and swapping the ends of an edge negates it exactly. 0 counts as inside. So triangles that
//!   share an edge never both refuse a ray on the basis of that edge, nor all triangles around a vertex.
//!
//! Symbols: the ray's largest direction axis becomes z; x, y are the others, in the order that keeps winding.
//!   a b c  corners relative to the ray's origin, sheared so that the ray is the z axis
//!   u v w  edge functions: twice the signed areas that belong to corners a, b, c     det  their sum
//!   ε      2⁻²⁴, half the spacing of f32 at 1
//!
//! Invariant: the filter never refuses a triangle that the exact test accepts. Limit: for a ray that starts exactly on
//! a triangle, t is 0 only up to rounding (±10⁻¹⁷ of the distances); such rays take their start from `origin`.

use super::build::Packet;
use super::lanes::Lanes;
use glam::{DVec3, Vec2, Vec3};

/// 16ε; see [`ShearLanes::filter`].
const ERROR: f32 = 1.0 / (1u32 << 20) as f32;

/// An axis of the world. Indexing by it needs no check.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Axis {
    X,
    Y,
    Z,
}

use Axis::{X, Y, Z};

/// Which axes of the world are x, y, z of the sheared space: by largest axis, then by the direction's sign along it.
const ORDERS: [[[Axis; 3]; 2]; 3] = [[[Y, Z, X], [Z, Y, X]], [[Z, X, Y], [X, Z, Y]], [[X, Y, Z], [Y, X, Z]]];

/// What the tests need of a ray.
pub(super) struct Shear {
    axes: [Axis; 3],
    /// Origin, by axis of the sheared space.
    origin: [f64; 3],
    /// x/z and y/z of the direction, and 1/z.
    slope: [f64; 3],
    /// Length of the direction along its largest axis.
    scale: f64,
    /// Direction/scale, by axis of the world.
    pub(super) unit: Vec3,
}

/// Where the line of a ray meets a triangle, on either side of the origin.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Crossing {
    t: f64,
    /// Edge functions of corners 1 and 2, and the sum of all three.
    v: f64,
    w: f64,
    det: f64,
}

impl Crossing {
    /// Distance in units of the direction.
    #[inline(always)]
    pub(super) fn t(&self) -> f64 {
        self.t
    }

    /// Weights of corners 1 and 2.
    #[inline(always)]
    pub(super) fn weights(&self) -> Vec2 {
        Vec2::new((self.v / self.det) as f32, (self.w / self.det) as f32)
    }

    /// The ray came from the front side.
    #[inline(always)]
    pub(super) fn front(&self) -> bool {
        self.det > 0.0
    }
}

impl Shear {
    /// For a direction that is finite and not zero. Branch-free: no two rays of a walk are alike.
    #[inline(always)]
    pub(super) fn new(origin: Vec3, direction: DVec3) -> Self {
        let d = direction.to_array();
        let size = direction.abs();
        let y_over_x = usize::from(size.y >= size.x);
        let z = if size.z >= size.x.max(size.y) { 2 } else { y_over_x };
        let axes = ORDERS[z][usize::from(d[z] < 0.0)];
        let [x, y, _] = axes;
        let inverse = 1.0 / d[z];
        let o = origin.to_array();
        Self {
            axes,
            origin: [f64::from(o[x as usize]), f64::from(o[y as usize]), f64::from(o[z])],
            slope: [d[x as usize] * inverse, d[y as usize] * inverse, inverse],
            scale: d[z].abs(),
            unit: (direction * inverse.abs()).as_vec3(),
        }
    }

    /// Length of the direction along its largest axis.
    #[inline(always)]
    pub(super) fn scale(&self) -> f64 {
        self.scale
    }

    /// The decision for triangle `lane` of a packet.
    #[inline(always)]
    pub(super) fn cross(&self, packet: &Packet, lane: usize) -> Option<Crossing> {
        let [x, y, z] = [self.axes[0] as usize, self.axes[1] as usize, self.axes[2] as usize];
        let [p, q, r] = &packet.corners;
        self.cross_corners([
            [p[x].0[lane], p[y].0[lane], p[z].0[lane]],
            [q[x].0[lane], q[y].0[lane], q[z].0[lane]],
            [r[x].0[lane], r[y].0[lane], r[z].0[lane]],
        ])
    }

    /// The decision for a triangle by its corners.
    #[inline(always)]
    pub(super) fn cross_points(&self, corners: [Vec3; 3]) -> Option<Crossing> {
        let [x, y, z] = [self.axes[0] as usize, self.axes[1] as usize, self.axes[2] as usize];
        // Not by `map`: its closure is a call in code for newer processors.
        let [p, q, r] = corners;
        self.cross_corners([[p[x], p[y], p[z]], [q[x], q[y], q[z]], [r[x], r[y], r[z]]])
    }

    #[inline(always)]
    fn sheared(&self, p: [f32; 3]) -> [f64; 3] {
        let [sx, sy, sz] = self.slope;
        let z = f64::from(p[2]) - self.origin[2];
        [f64::from(p[0]) - self.origin[0] - sx * z, f64::from(p[1]) - self.origin[1] - sy * z, sz * z]
    }

    #[inline(always)]
    fn cross_corners(&self, corners: [[f32; 3]; 3]) -> Option<Crossing> {
        let (a, b, c) = (self.sheared(corners[0]), self.sheared(corners[1]), self.sheared(corners[2]));
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let det = u + v + w;
        // Bitwise: one branch, mostly not taken, instead of seven.
        let mixed = ((u < 0.0) | (v < 0.0) | (w < 0.0)) & ((u > 0.0) | (v > 0.0) | (w > 0.0));
        if mixed | (det == 0.0) {
            return None;
        }
        Some(Crossing { t: (u * a[2] + v * b[2] + w * c[2]) / det, v, w, det })
    }
}

/// A [`Shear`] for eight triangles at a time.
pub(super) struct ShearLanes<L> {
    origin: [L; 3],
    slope: [L; 2],
}

impl<L: Lanes> ShearLanes<L> {
    #[inline(always)]
    pub(super) fn new(shear: &Shear) -> Self {
        // The origin was f32 before.
        let [x, y, z] = shear.origin;
        let [sx, sy, _] = shear.slope;
        Self {
            origin: [L::splat(x as f32), L::splat(y as f32), L::splat(z as f32)],
            slope: [L::splat(sx as f32), L::splat(sy as f32)],
        }
    }

    /// Bit i is set if triangle i of the packet may be met by the line of the ray.
    ///
    /// Error bound: with h the largest distance of a corner along the z axis and s the largest |x| + |y| of a sheared
    /// corner, each sheared coordinate is off by at most ε(2|x| + 4h), so each edge function by at most
    /// ε(6s² + 8sh) + 32ε²h² and terms of higher order; 16ε(s + 16εh)(s + 16εh + h) covers them. h and s are not taken
    /// from all corners but from corner 0 and `Packet::margin`, which bounds how far the others are off; it is at least
    /// 2⁻⁵⁰ m, which covers what is lost to underflow. NaN after an overflow compares false, which does not refuse.
    #[inline(always)]
    pub(super) fn filter(&self, packet: &Packet, shear: &Shear) -> u32 {
        self.filter_within::<false>(packet, shear, 0.0)
    }

    /// The same for corners that are known to be within `slack` [m] of where the packet has them, and a ray as far off,
    /// if `LOOSE`.
    ///
    /// A sheared coordinate is then off by 4 `slack` at most, and with s larger by as much an edge function by 2 · 4
    /// `slack` · s and terms of higher order; 16 `slack` · s covers them.
    #[inline(always)]
    pub(super) fn filter_within<const LOOSE: bool>(&self, packet: &Packet, shear: &Shear, slack: f32) -> u32 {
        let [kx, ky, kz] = [shear.axes[0] as usize, shear.axes[1] as usize, shear.axes[2] as usize];
        let [ox, oy, oz] = self.origin;
        let [sx, sy] = self.slope;
        let [p, q, r] = &packet.corners;
        let az = L::load(&p[kz]).minus(oz);
        let bz = L::load(&q[kz]).minus(oz);
        let cz = L::load(&r[kz]).minus(oz);
        let ax = L::load(&p[kx]).minus(ox).minus(sx.times(az));
        let ay = L::load(&p[ky]).minus(oy).minus(sy.times(az));
        let bx = L::load(&q[kx]).minus(ox).minus(sx.times(bz));
        let by = L::load(&q[ky]).minus(oy).minus(sy.times(bz));
        let cx = L::load(&r[kx]).minus(ox).minus(sx.times(cz));
        let cy = L::load(&r[ky]).minus(oy).minus(sy.times(cz));
        let u = cx.times(by).minus(cy.times(bx));
        let v = ax.times(cy).minus(ay.times(cx));
        let w = bx.times(ay).minus(by.times(ax));
        let margin = L::load(&packet.margin);
        let sixteenth = L::splat(ERROR);
        let h = az.size().plus(margin);
        let mut s = ax.size().plus(ay.size()).plus(margin.plus(h.times(sixteenth)));
        let mut error = s.times(s.plus(h)).times(sixteenth);
        if LOOSE {
            s = s.plus(L::splat(8.0 * slack));
            error = s.times(s.plus(h)).times(sixteenth).plus(s.times(L::splat(16.0 * slack)));
        }
        let negative = u.least(v).least(w).plus(error).below(L::splat(0.0));
        let positive = L::splat(0.0).below(u.most(v).most(w).minus(error));
        !(negative & positive)
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::Portable;
    use super::*;
    use crate::base::random::Stage;
    use crate::base::random::Stream;

    fn cross(origin: Vec3, direction: Vec3, corners: [Vec3; 3]) -> Option<Crossing> {
        let s = Shear::new(origin, direction.as_dvec3());
        s.cross_corners(corners.map(|p| s.axes.map(|k| p[k as usize])))
    }

    const CORNERS: [Vec3; 3] = [Vec3::new(0.0, 0.0, 0.0), Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];

    #[test]
    fn weights_distance_and_side_are_right_along_every_axis_and_sign() {
        for axis in 0..3 {
            let turn = |p: Vec3| Vec3::new(p[(3 - axis) % 3], p[(4 - axis) % 3], p[(5 - axis) % 3]);
            let corners = CORNERS.map(turn);
            for side in [1.0, -1.0] {
                let h = cross(turn(Vec3::new(0.25, 0.5, 3.0 * side)), turn(Vec3::new(0.0, 0.0, -2.0 * side)), corners);
                let h = h.unwrap();
                let found = (h.t(), h.weights(), h.front());
                assert_eq!(found, (1.5, Vec2::new(0.25, 0.5), side > 0.0), "axis {axis} side {side}");
            }
        }
    }

    #[test]
    fn edges_and_corners_count() {
        for p in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.0, 0.5], [0.5, 0.5]] {
            let h = cross(Vec3::new(p[0], p[1], 1.0), Vec3::NEG_Z, CORNERS).unwrap();
            assert_eq!(h.weights().to_array(), p);
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
            let mut packet = Packet::empty();
            packet.set(2, corners, 0);
            let exact = shear.cross(&packet, 2).is_some();
            let passed = ShearLanes::<Portable>::new(&shear).filter(&packet, &shear) & 4;
            assert!(passed != 0 || !exact, "{corners:?} {origin} {target}");
            accepted += usize::from(exact);
            refused += usize::from(passed == 0);
        }
        assert!(accepted > 50_000, "{accepted}");
        assert!(refused > 20_000, "{refused}");
    }
}
