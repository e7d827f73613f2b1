//! Rays, and offsets of their origins and ends that are derived from error bounds.

use super::lanes::{LANES, Vec3x16, f32x16, with_sign};
use super::robust::gamma;
use glam::Vec3;
use wide::f32x8;

/// A ray `o + t·d` for `0 < t < t_max`. `d` need not be of unit length. For a shadow ray, `d` is the vector to the
/// target and `t_max = 1`.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Ray {
    /// Origin.
    pub o: Vec3,
    /// Upper bound of the ray parameter; infinite for an unbounded ray.
    pub t_max: f32,
    /// Direction.
    pub d: Vec3,
    /// Time in [0, 1] over the shutter interval.
    pub time: f32,
}

impl Ray {
    /// Creates an unbounded ray at time 0.
    #[inline]
    pub fn new(o: Vec3, d: Vec3) -> Self {
        Ray { o, t_max: f32::INFINITY, d, time: 0.0 }
    }

    /// Returns the point at the parameter `t`.
    #[inline]
    pub fn at(&self, t: f32) -> Vec3 {
        self.o + self.d * t
    }
}

/// Returns a bound on the distance of a computed point from its plane with the unit normal `ng`, given the bound
/// `p_error` on its absolute error per component. [pbrt 6.8.6]
#[inline(always)]
pub fn plane_error(p_error: Vec3, ng: Vec3) -> f32 {
    ng.abs().dot(p_error)
}

/// Offsets a surface point from its surface by `error` (see [`plane_error`]) to the side of `w`. The error bounds
/// include the rounding of this sum.
#[inline(always)]
pub fn offset_origin(p: Vec3, error: f32, ng: Vec3, w: Vec3) -> Vec3 {
    p + ng * error.copysign(w.dot(ng))
}

/// Returns a bound on the apparent distance of a ray's end from the plane of a triangle, in addition to the error of
/// the end point itself. The ray's direction is a rounded difference, and back ends compute the distance to the plane
/// from differences of the origin and the corners, so these errors grow with the ray's length, for any angle to the
/// plane. `to` is the vector along the ray.
#[inline(always)]
pub fn end_error(to: Vec3) -> f32 {
    to.abs().max_element() * gamma(16)
}

/// Computes [`end_error`] for sixteen rays.
#[inline(always)]
pub fn end_error_x16(to: Vec3x16) -> f32x16 {
    let [x, y, z] = [to.x, to.y, to.z].map(f32x16::abs);
    x.fast_max(y).fast_max(z) * f32x16::splat(gamma(16))
}

/// Computes [`plane_error`] for sixteen points.
#[inline(always)]
pub fn plane_error_x16(p_error: Vec3x16, ng: Vec3x16) -> f32x16 {
    ng.abs().dot(p_error)
}

/// Computes [`offset_origin`] for sixteen points.
#[inline(always)]
pub fn offset_origin_x16(p: Vec3x16, error: f32x16, ng: Vec3x16, w: Vec3x16) -> Vec3x16 {
    p + ng * with_sign(error, w.dot(ng))
}

/// Sixteen rays as a structure of arrays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayX16 {
    /// Origins.
    pub o: Vec3x16,
    /// Upper bounds of the ray parameters.
    pub t_max: f32x16,
    /// Directions.
    pub d: Vec3x16,
    /// Times.
    pub time: f32x16,
}

impl RayX16 {
    /// Creates rays that are equal in every lane.
    #[inline]
    pub fn splat(ray: &Ray) -> Self {
        RayX16 {
            o: Vec3x16::splat(ray.o),
            t_max: f32x16::splat(ray.t_max),
            d: Vec3x16::splat(ray.d),
            time: f32x16::splat(ray.time),
        }
    }

    /// Returns the rays `first..first + 16`, with zeros beyond the end.
    #[inline]
    pub fn load(rays: &[Ray], first: usize) -> Self {
        let rows = match rays[first..].first_chunk::<LANES>() {
            Some(chunk) => *chunk,
            None => {
                let mut padded: [Ray; LANES] = bytemuck::Zeroable::zeroed();
                padded[..rays.len() - first].copy_from_slice(&rays[first..]);
                padded
            }
        };
        let (low, high) = bytemuck::cast::<_, [[f32x8; 8]; 2]>(rows).into();
        let (low, high) = (f32x8::transpose(low), f32x8::transpose(high));
        let [x, y, z, t_max, dx, dy, dz, time] =
            std::array::from_fn(|i| bytemuck::cast::<[f32x8; 2], f32x16>([low[i], high[i]]));
        RayX16 { o: Vec3x16::new(x, y, z), t_max, d: Vec3x16::new(dx, dy, dz), time }
    }

    /// Returns the rays as an array.
    #[inline]
    pub fn to_rays(&self) -> [Ray; LANES] {
        let columns = [self.o.x, self.o.y, self.o.z, self.t_max, self.d.x, self.d.y, self.d.z, self.time];
        let (mut low, mut high) = ([f32x8::ZERO; 8], [f32x8::ZERO; 8]);
        for (i, column) in columns.into_iter().enumerate() {
            [low[i], high[i]] = bytemuck::cast(column);
        }
        bytemuck::cast([f32x8::transpose(low), f32x8::transpose(high)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_rays_are_loaded_and_given_back() {
        let ray = |i: usize| Ray {
            o: Vec3::new(i as f32, 1.5, -2.0),
            t_max: 3.0,
            d: Vec3::new(0.0, i as f32, 1.0),
            time: 0.25 * i as f32,
        };
        let rays: Vec<Ray> = (0..19).map(ray).collect();
        let block = RayX16::load(&rays, 2);
        assert_eq!(block.to_rays(), rays[2..18]);
        assert_eq!(block.d.lane(4), rays[6].d);
        let tail = RayX16::load(&rays, 16).to_rays();
        assert_eq!(tail[..3], rays[16..]);
        assert_eq!(tail[3].d, Vec3::ZERO);
    }

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
