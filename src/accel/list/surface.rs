//! Analytic surfaces of a list.

use super::{RayX8, Vec3x8};
use crate::accel::Primitive;
use crate::accel::cylinder::CERTAIN;
use crate::math::{DVec3, Vec3};
use wide::{f32x8, f64x8};

/// The relative margin of coordinates in a disk, whose axes may be nearly parallel.
const CERTAIN_IN_DISK: f64 = 1e-9;

/// An analytic surface and its bounding sphere.
pub(super) struct BoundedSurface {
    pub geometry: u32,
    pub primitive: Primitive,
    center: Vec3,
    radius_squared: f32,
    exclusion: Exclusion,
}

/// What excludes most rays that meet the bounding sphere, in double precision.
enum Exclusion {
    Sphere {
        center: DVec3,
        radius_squared: f64,
    },
    /// The normal of a disk, not of unit length, and the vectors whose inner products with a vector in the plane are
    /// its coordinates.
    Disk {
        center: DVec3,
        normal: DVec3,
        coordinates: [DVec3; 2],
    },
    Nothing,
}

/// Eight vectors in double precision.
#[derive(Clone, Copy)]
struct DVec3x8([f64x8; 3]);

impl DVec3x8 {
    #[inline(always)]
    fn new(v: Vec3x8) -> Self {
        DVec3x8(v.0.map(|c| f64x8::new(c.to_array().map(f64::from))))
    }

    #[inline(always)]
    fn minus(self, v: DVec3) -> Self {
        let [x, y, z] = self.0;
        DVec3x8([x - f64x8::splat(v.x), y - f64x8::splat(v.y), z - f64x8::splat(v.z)])
    }

    #[inline(always)]
    fn dot(self, v: DVec3) -> f64x8 {
        let [x, y, z] = self.0;
        x * f64x8::splat(v.x) + y * f64x8::splat(v.y) + z * f64x8::splat(v.z)
    }

    #[inline(always)]
    fn dot_x8(self, o: Self) -> f64x8 {
        let ([x, y, z], [a, b, c]) = (self.0, o.0);
        x * a + y * b + z * c
    }
}

impl BoundedSurface {
    /// Creates a surface of a list whose rays start at most `reach` from its centre.
    pub fn new(geometry: u32, primitive: Primitive, reach: f32) -> Self {
        let bounds = primitive.bounds();
        let center = bounds.center();
        let (radius_squared, exclusion) = match primitive {
            Primitive::Sphere { center, radius } => {
                let exclusion = Exclusion::Sphere {
                    center: center.as_dvec3(),
                    radius_squared: f64::from(radius) * f64::from(radius),
                };
                (radius * radius, exclusion)
            }
            Primitive::Disk { center, du, dv } => {
                let normal = du.as_dvec3().cross(dv.as_dvec3());
                let per_square = 1.0 / normal.length_squared();
                let coordinates = [dv.as_dvec3().cross(normal), normal.cross(du.as_dvec3())];
                let exclusion = Exclusion::Disk {
                    center: center.as_dvec3(),
                    normal,
                    coordinates: coordinates.map(|v| v * per_square),
                };
                (du.length_squared() + dv.length_squared(), exclusion)
            }
            Primitive::Cylinder { .. } | Primitive::RoundCone(_) | Primitive::SdfCell(_) => {
                ((bounds.max - center).length_squared(), Exclusion::Nothing)
            }
        };
        // The margin exceeds the rounding error of the test.
        let radius_squared = radius_squared * 1.01 + 1e-5 * reach * reach;
        BoundedSurface { geometry, primitive, center, radius_squared, exclusion }
    }

    /// Returns a mask of the rays that may hit the surface before the distances `t_max`, which are 0 for inactive
    /// lanes.
    #[inline(always)]
    pub fn candidates(&self, rays: &RayX8<'_>, t_max: f32x8) -> u32 {
        let from_center = rays.o.relative_to(self.center);
        let b = from_center.dot_x8(rays.d);
        let c = from_center.dot_x8(from_center) - self.radius_squared;
        let meets = (b * b).simd_ge(rays.d.dot_x8(rays.d) * c);
        let ahead = b.simd_lt(f32x8::ZERO) | c.simd_lt(f32x8::ZERO);
        let candidates = (meets & ahead & t_max.simd_gt(f32x8::ZERO)).to_bitmask();
        if candidates == 0 { 0 } else { candidates & !self.exclusion.certain(rays, t_max) }
    }
}

impl Exclusion {
    /// Returns a mask of the rays that certainly miss the surface before the distances `t_max`.
    #[inline(always)]
    fn certain(&self, rays: &RayX8<'_>, t_max: f32x8) -> u32 {
        let (zero, one) = (f64x8::ZERO, f64x8::ONE);
        // What is beyond it is so if rounded to `f32`, too.
        let end = f64x8::new(t_max.to_array().map(f64::from));
        let (o, d) = (DVec3x8::new(rays.o), DVec3x8::new(rays.d));
        let excluded = match *self {
            Exclusion::Sphere { center, radius_squared } => {
                let from_center = o.minus(center);
                let (a, b) = (d.dot_x8(d), from_center.dot_x8(d));
                let squared = from_center.dot_x8(from_center);
                let c = squared - f64x8::splat(radius_squared);
                let discriminant = b * b - a * c;
                let margin = a * squared * f64x8::splat(CERTAIN);
                let passes = discriminant.simd_lt(-margin);
                let enters = (-b - (discriminant + margin).max(zero).sqrt()) / a;
                let outside = c.simd_gt(zero);
                passes | (outside & (b.simd_gt(zero) | enters.simd_gt(end)))
            }
            Exclusion::Disk { center, normal, coordinates } => {
                let from_center = o.minus(center);
                let t = -from_center.dot(normal) / d.dot(normal);
                let ([ox, oy, oz], [dx, dy, dz]) = (from_center.0, d.0);
                let p = DVec3x8([ox + dx * t, oy + dy * t, oz + dz * t]);
                let [u, v] = coordinates.map(|axis| p.dot(axis));
                let beyond = (u * u + v * v).simd_gt(one + f64x8::splat(CERTAIN_IN_DISK));
                t.simd_le(zero) | t.simd_gt(end) | beyond
            }
            Exclusion::Nothing => return 0,
        };
        excluded.to_bitmask()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::lanes::f32x16;
    use crate::math::{Ray, RayX16, Vec3};
    use crate::sampling::hash::{combine, to_unit};

    /// No ray that hits a surface is excluded, wherever it starts and ends; most others are.
    #[test]
    fn only_misses_are_excluded() {
        let mut seed = 0;
        let mut random = || {
            seed += 1;
            to_unit(combine(5, seed))
        };
        let mut vector = || Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5);
        let (mut misses, mut excluded) = (0, 0);
        for round in 0..20_000 {
            let center = vector() * [1.0, 100.0][round % 2];
            let (du, dv) = (vector(), vector());
            let primitive = match round % 3 {
                0 => Primitive::Sphere { center, radius: du.length() },
                1 => Primitive::Disk { center, du, dv },
                _ => Primitive::Disk { center, du, dv: du.cross(dv).normalize() * du.length() },
            };
            let rays: Vec<Ray> = (0..8)
                .map(|i| {
                    let on = center + vector().normalize() * du.length();
                    let in_plane = center + du * (0.7 * vector().x) + dv * (0.7 * vector().x);
                    let o = [on, in_plane, center + 3.0 * vector(), center][i % 4];
                    let to = [on, in_plane, vector() + center][(i + round) % 3];
                    let scale = [1.0, 0.9999, 1.0001, 100.0][(i + round / 3) % 4];
                    Ray { t_max: 1.0, ..Ray::new(o, (to - o) * scale) }
                })
                .collect();
            let block = RayX16::load(&rays, 0);
            let half = |v: f32x16| bytemuck::cast::<f32x16, [f32x8; 2]>(v)[0];
            let three = |v: crate::math::Vec3x16| Vec3x8([v.x, v.y, v.z].map(half));
            let lanes = RayX8 {
                rays: &rays,
                o: three(block.o),
                d: three(block.d),
                length: f32x8::ZERO,
                grazing: f32x8::ZERO,
            };
            let surface = BoundedSurface::new(0, primitive, 500.0);
            let candidates = surface.candidates(&lanes, f32x8::ONE);
            for (i, ray) in rays.iter().enumerate() {
                let (hit, candidate) = (primitive.intersect(ray).is_some(), candidates >> i & 1 == 1);
                assert!(candidate || !hit, "{primitive:?} {ray:?}");
                (misses, excluded) = (misses + u32::from(!hit), excluded + u32::from(!candidate));
            }
        }
        assert!(excluded > misses / 2, "{excluded} of {misses}");
    }
}
