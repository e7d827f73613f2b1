//! Rays, and where they may start and end without an epsilon.

use super::robust::nudge;
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

/// Moves a surface point off its surface, to the side that `w` points to, by no more than the rounding
/// error that the point carries.
///
/// `p_error` bounds the absolute error of `p` per component, `ng` is the geometric normal (unit length).
/// The offset carries every plane that the error box of `p` touches below the new origin. [pbrt 6.8.6]
#[inline]
pub fn offset_origin(p: Vec3, p_error: Vec3, ng: Vec3, w: Vec3) -> Vec3 {
    let d = ng.abs().dot(p_error);
    let offset = if w.dot(ng) < 0.0 { -ng * d } else { ng * d };
    let po = p + offset;
    // Rounding may have eaten the offset: go one ulp further, away from p.
    Vec3::new(nudge(po.x, offset.x), nudge(po.y, offset.y), nudge(po.z, offset.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_offset_lies_on_the_side_of_w() {
        let p = Vec3::new(1e6, 1.0, -3.0);
        let e = p.abs() * 1e-6;
        for w in [Vec3::Y, -Vec3::Y] {
            let o = offset_origin(p, e, Vec3::Y, w);
            assert!((o - p).dot(w) > 0.0);
            assert!((o - p).length() < 1e-5);
        }
    }
}
