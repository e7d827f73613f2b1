//! Orthonormal frames. In the local coordinates of a frame, z is the normal.

use super::lanes::{Vec3x16, f32x16, with_sign};
use glam::Vec3;

/// A right-handed orthonormal frame (s, t, n).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// First tangent.
    pub s: Vec3,
    /// Second tangent.
    pub t: Vec3,
    /// Normal.
    pub n: Vec3,
}

impl Frame {
    /// Creates a frame around the unit vector `n` with arbitrary tangents. [Duff 2017, listing 3]
    #[inline]
    pub fn from_normal(n: Vec3) -> Self {
        let sign = 1f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Frame {
            s: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            t: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            n,
        }
    }

    /// Creates a frame around the unit vector `n` whose first tangent is as close as possible to `dpdu`. Without a
    /// valid `dpdu`, it is that of [`from_normal`](Self::from_normal).
    #[inline]
    pub fn from_normal_tangent(n: Vec3, dpdu: Vec3) -> Self {
        let s = dpdu - n * n.dot(dpdu);
        let l2 = s.length_squared();
        if !(l2 > 0.0 && l2.is_finite()) {
            return Frame::from_normal(n);
        }
        let s = s / l2.sqrt();
        Frame { s, t: n.cross(s), n }
    }

    /// Transforms from world space to local coordinates.
    #[inline]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(v.dot(self.s), v.dot(self.t), v.dot(self.n))
    }

    /// Transforms from local coordinates to world space.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }
}

/// Sixteen frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameX16 {
    /// First tangents.
    pub s: Vec3x16,
    /// Second tangents.
    pub t: Vec3x16,
    /// Normals.
    pub n: Vec3x16,
}

impl FrameX16 {
    /// Computes [`Frame::from_normal`] in each lane.
    #[inline(always)]
    pub fn from_normal(n: Vec3x16) -> Self {
        let sign = with_sign(f32x16::ONE, n.z);
        let a = -f32x16::ONE / (sign + n.z);
        let b = n.x * n.y * a;
        FrameX16 {
            s: Vec3x16::new(f32x16::ONE + sign * n.x * n.x * a, sign * b, -sign * n.x),
            t: Vec3x16::new(b, sign + n.y * n.y * a, -n.y),
            n,
        }
    }

    /// Transforms from world space to local coordinates.
    #[inline(always)]
    pub fn to_local(&self, v: Vec3x16) -> Vec3x16 {
        Vec3x16::new(v.dot(self.s), v.dot(self.t), v.dot(self.n))
    }

    /// Transforms from local coordinates to world space.
    #[inline(always)]
    pub fn to_world(&self, v: Vec3x16) -> Vec3x16 {
        self.s * v.x + self.t * v.y + self.n * v.z
    }

    /// Returns the frame of one lane.
    #[inline]
    pub fn lane(&self, i: usize) -> Frame {
        Frame { s: self.s.lane(i), t: self.t.lane(i), n: self.n.lane(i) }
    }

    /// Replaces the frame of one lane.
    #[inline]
    pub fn set_lane(&mut self, i: usize, f: Frame) {
        self.s.set_lane(i, f.s);
        self.t.set_lane(i, f.t);
        self.n.set_lane(i, f.n);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_orthonormal_and_right_handed_also_at_the_poles() {
        for n in [Vec3::Z, -Vec3::Z, Vec3::X, Vec3::new(0.6, 0.0, -0.8), Vec3::new(1e-7, 1e-7, -1.0)] {
            let n = n.normalize();
            for f in [Frame::from_normal(n), Frame::from_normal_tangent(n, Vec3::new(0.3, 1.0, 0.2))] {
                assert!((f.s.cross(f.t) - f.n).length() < 1e-5, "{f:?}");
                assert!((f.s.length() - 1.0).abs() < 1e-5);
                let v = Vec3::new(0.1, -0.7, 0.4);
                assert!((f.to_world(f.to_local(v)) - v).length() < 1e-5);
            }
        }
    }

    #[test]
    fn sixteen_frames_are_the_frames_of_their_lanes() {
        let mut n = Vec3x16::splat(Vec3::Z);
        n.set_lane(5, Vec3::new(0.6, 0.0, -0.8));
        let frames = FrameX16::from_normal(n);
        for i in [0, 5] {
            assert_eq!(frames.lane(i), Frame::from_normal(n.lane(i)));
        }
        let v = Vec3x16::splat(Vec3::new(0.1, -0.7, 0.4));
        assert_eq!(frames.to_world(frames.to_local(v)).lane(5), {
            let f = frames.lane(5);
            f.to_world(f.to_local(v.lane(5)))
        });
    }

    #[test]
    fn a_useless_tangent_falls_back() {
        assert_eq!(Frame::from_normal_tangent(Vec3::Z, Vec3::Z), Frame::from_normal(Vec3::Z));
        assert_eq!(Frame::from_normal_tangent(Vec3::Z, Vec3::NAN), Frame::from_normal(Vec3::Z));
    }
}
