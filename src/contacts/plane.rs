//! The plane of a triangle, with coordinates in it.

use glam::{DVec2, DVec3};

/// A plane with two axes [m].
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    origin: DVec3,
    s: DVec3,
    t: DVec3,
    pub(super) normal: DVec3,
}

impl Plane {
    /// The plane of three corners; `None` without area.
    pub(super) fn new([a, b, c]: [DVec3; 3]) -> Option<Self> {
        let normal = (b - a).cross(c - a).try_normalize()?;
        let s = (b - a).try_normalize()?;
        Some(Self { origin: a, s, t: normal.cross(s), normal })
    }

    /// Height over the plane [m].
    pub(super) fn height(&self, p: DVec3) -> f64 {
        (p - self.origin).dot(self.normal)
    }

    /// The point with these coordinates [m].
    pub(super) fn point(&self, at: DVec2) -> DVec3 {
        self.origin + self.s * at.x + self.t * at.y
    }

    /// Coordinates of the foot of a point [m].
    pub(super) fn at(&self, p: DVec3) -> DVec2 {
        DVec2::new((p - self.origin).dot(self.s), (p - self.origin).dot(self.t))
    }
}

/// Barycentric weights of a point in a flat triangle.
pub(super) fn weights([a, b, c]: [DVec2; 3], p: DVec2) -> [f64; 3] {
    let area = (b - a).perp_dot(c - a);
    let (w1, w2) = ((p - a).perp_dot(c - a) / area, (b - a).perp_dot(p - a) / area);
    [1.0 - w1 - w2, w1, w2]
}

/// Part of the way from `a` to `b` at which the foot of a point lies, and its distance from the line [m].
pub(super) fn along([a, b]: [DVec2; 2], p: DVec2) -> (f64, f64) {
    let edge = b - a;
    let length = edge.length().max(f64::MIN_POSITIVE);
    ((p - a).dot(edge) / (length * length), edge.perp_dot(p - a).abs() / length)
}

/// The part of a line within a triangle wound counter-clockwise, moved out by `margin` [m].
pub(super) fn clip(triangle: [DVec2; 3], line: [DVec2; 2], margin: f64) -> Option<[DVec2; 2]> {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    let direction = line[1] - line[0];
    for k in 0..3 {
        let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
        let inward = (b - a).perp().try_normalize()?;
        let (height, slope) = ((line[0] - a).dot(inward) + margin, direction.dot(inward));
        if slope.abs() < f64::MIN_POSITIVE {
            if height < 0.0 {
                return None;
            }
        } else if slope > 0.0 {
            from = from.max(-height / slope);
        } else {
            to = to.min(-height / slope);
        }
    }
    (from < to).then(|| [line[0] + direction * from, line[0] + direction * to])
}
