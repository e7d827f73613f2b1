//! Rays, and where they may start and end without an epsilon.

use glam::Vec3;

/// A ray `o + t·d` for `0 < t < t_max`. `d` need not be of unit length; a shadow ray has the vector to
/// its target as `d` and `t_max = 1`.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Ray {
    /// Origin.
    pub o: Vec3,
    /// The upper bound of the parameter; infinity for an open ray.
    pub t_max: f32,
    /// Direction.
    pub d: Vec3,
    /// Time in [0, 1] over the shutter interval.
    pub time: f32,
}

impl Ray {
    /// An open ray at time 0.
    #[inline]
    pub fn new(o: Vec3, d: Vec3) -> Self {
        Ray { o, t_max: f32::INFINITY, d, time: 0.0 }
    }

    /// The point at parameter `t`.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.o + self.d * t
    }
}

/// How far a point may lie off the plane with the unit normal `ng` that it was computed for, given the bound
/// `p_error` on its absolute error per component. [pbrt 6.8.6]
#[inline(always)]
pub fn plane_error(p_error: Vec3, ng: Vec3) -> f32 {
    ng.abs().dot(p_error)
}

/// Moves a surface point off its surface by `error` (see [`plane_error`]), to the side that `w` points to. The
/// error bounds leave room for the rounding of this sum, too.
#[inline(always)]
pub fn offset_origin(p: Vec3, error: f32, ng: Vec3, w: Vec3) -> Vec3 {
    p + ng * error.copysign(w.dot(ng))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_offset_lies_on_the_side_of_w() {
        let p = Vec3::new(1e6, 1.0, -3.0);
        let e = p.abs() * 1e-6;
        for w in [Vec3::Y, -Vec3::Y] {
            let o = offset_origin(p, plane_error(e, Vec3::Y), Vec3::Y, w);
            assert!((o - p).dot(w) > 0.0);
            assert!((o - p).length() < 1e-5);
        }
    }
}
