//! Orthonormal frames around a normal.
//!
//! Source: Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017, listing 3.

use glam::Vec3;

/// A right-handed orthonormal basis whose third axis is the normal.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// First tangent, unit length.
    pub s: Vec3,
    /// Second tangent, unit length.
    pub t: Vec3,
    /// Normal, unit length.
    pub n: Vec3,
}

impl Frame {
    /// The frame around a unit normal `n`.
    #[must_use]
    pub fn from_normal(n: Vec3) -> Self {
        let sign = 1.0f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            s: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            t: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            n,
        }
    }

    /// Turns local coordinates (z along the normal) into world coordinates.
    #[must_use]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal() {
        for i in 0..1000 {
            let a = i as f32 * 0.377;
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / 1000.0;
            let r = (1.0 - z * z).sqrt();
            let f = Frame::from_normal(Vec3::new(r * libm::cosf(a), r * libm::sinf(a), z).normalize());
            assert!(f.s.dot(f.t).abs() < 1e-6 && f.s.dot(f.n).abs() < 1e-6 && f.t.dot(f.n).abs() < 1e-6);
            assert!((f.s.cross(f.t) - f.n).length() < 1e-6);
        }
    }
}
