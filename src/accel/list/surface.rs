//! Analytic surfaces of a list.

use super::{RayX8, Vec3x8};
use crate::accel::{Primitive, cylinder};
use crate::math::lanes::bits;
use crate::math::{DVec3, Vec3};
use wide::{f32x8, f64x8};

/// The margin of bounding spheres, relative to squared distances. It exceeds the rounding errors of their tests.
const MARGIN: f32 = 4e-6;

/// An analytic surface and its bounding sphere.
pub(super) struct BoundedSurface {
    pub geometry: u32,
    pub primitive: Primitive,
    center: Vec3,
    radius_squared: f32,
    kernel: Option<Kernel>,
}

/// The hits of a surface.
pub(super) enum SurfaceHits {
    /// Those of eight rays.
    Lanes {
        /// Mask of the rays that hit the surface.
        hit: f32x8,
        t: f32x8,
        /// The surface coordinates.
        u: f32x8,
        v: f32x8,
    },
    /// A mask of the rays that may hit it, for a surface without a kernel.
    Candidates(u32),
}

/// A surface that is intersected with eight rays at a time, in double precision.
enum Kernel {
    Sphere { center: DVec3, radius: f64 },
    Disk { center: DVec3, du: DVec3, dv: DVec3 },
    Cylinder { p0: DVec3, axis: DVec3, height: f64, radius: f64 },
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

    /// Returns the vectors `self + v·s`.
    #[inline(always)]
    fn plus(self, v: Self, s: f64x8) -> Self {
        let ([x, y, z], [a, b, c]) = (self.0, v.0);
        DVec3x8([x + a * s, y + b * s, z + c * s])
    }

    /// Returns the parts perpendicular to a unit vector.
    #[inline(always)]
    fn across(self, axis: DVec3) -> Self {
        let ([x, y, z], along) = (self.0, self.dot(axis));
        let [a, b, c] = axis.to_array().map(f64x8::splat);
        DVec3x8([x - a * along, y - b * along, z - c * along])
    }

    /// Returns the cross products `self × v`.
    #[inline(always)]
    fn cross(self, v: DVec3) -> Self {
        let ([x, y, z], [a, b, c]) = (self.0, v.to_array().map(f64x8::splat));
        DVec3x8([y * c - b * z, z * a - c * x, x * b - a * y])
    }

    /// Returns the cross products `u × self`.
    #[inline(always)]
    fn crossed_by(self, u: DVec3) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, u.to_array().map(f64x8::splat));
        DVec3x8([y * c - b * z, z * a - c * x, x * b - a * y])
    }
}

impl BoundedSurface {
    /// Creates a surface of a list.
    pub fn new(geometry: u32, primitive: Primitive) -> Self {
        let bounds = primitive.bounds();
        let center = bounds.center();
        let to_corner = (bounds.max - center).max(center - bounds.min).length_squared();
        let (radius_squared, kernel) = match primitive {
            Primitive::Sphere { center, radius } => {
                let kernel = Kernel::Sphere { center: center.as_dvec3(), radius: radius.into() };
                (radius * radius, Some(kernel))
            }
            Primitive::Disk { center, du, dv } => {
                let [center, du_64, dv_64] = [center, du, dv].map(|v| v.as_dvec3());
                let kernel = Kernel::Disk { center, du: du_64, dv: dv_64 };
                (du.length_squared() + dv.length_squared(), Some(kernel))
            }
            Primitive::Cylinder { p0, p1, radius } => {
                let (axis, height) = cylinder::axis(p0, p1);
                let kernel = Kernel::Cylinder { p0: p0.as_dvec3(), axis, height, radius: radius.into() };
                (to_corner, Some(kernel))
            }
            Primitive::RoundCone(_) | Primitive::SdfCell(_) => (to_corner, None),
        };
        let radius_squared = radius_squared * (1.0 + MARGIN);
        BoundedSurface { geometry, primitive, center, radius_squared, kernel }
    }

    /// Returns the hits of the rays before the distances `t_max`, which are 0 for inactive lanes; `None` if no ray hits
    /// the surface.
    #[inline(always)]
    pub fn hits(&self, rays: &RayX8<'_>, t_max: f32x8) -> Option<SurfaceHits> {
        let from_center = rays.o.relative_to(self.center);
        let b = from_center.dot_x8(rays.d);
        let c = from_center.dot_x8(from_center) * (1.0 - MARGIN) - self.radius_squared;
        let meets = (b * b).simd_ge(rays.d.dot_x8(rays.d) * c);
        let ahead = b.simd_lt(f32x8::ZERO) | c.simd_lt(f32x8::ZERO);
        let candidates = meets & ahead & t_max.simd_gt(f32x8::ZERO);
        match &self.kernel {
            _ if candidates.none() => None,
            None => Some(SurfaceHits::Candidates(candidates.to_bitmask())),
            Some(kernel) => {
                let (hit, [t, u, v]) = kernel.intersect(rays, t_max, candidates);
                Some(SurfaceHits::Lanes { hit, t, u, v })
            }
        }
    }
}

impl Kernel {
    /// Computes [`Primitive::intersect`] for the rays in a mask, with the same bits. Returns a mask of the rays with a
    /// hit before `t_max`, and the parameter and surface coordinates of the hits.
    #[inline(always)]
    fn intersect(&self, rays: &RayX8<'_>, t_max: f32x8, candidates: f32x8) -> (f32x8, [f32x8; 3]) {
        let rounded = |v: f64x8| f32x8::new(v.to_array().map(|v| v as f32));
        let within = |t: f32x8| t.simd_gt(f32x8::ZERO) & t.simd_lt(t_max);
        let (o, d) = (DVec3x8::new(rays.o), DVec3x8::new(rays.d));
        match *self {
            Kernel::Sphere { center, radius } => {
                let Some(Roots { real, a, c, q }) = circle(o.minus(center), d, radius, candidates) else {
                    return (f32x8::ZERO, [f32x8::ZERO; 3]);
                };
                let t0 = c / q;
                // From outside, this is the nearer root, and if it is beyond the end, the other one is, too.
                let from_outside =
                    c.simd_gt(f64x8::ZERO) & (a * c).simd_lt(q * q * f64x8::splat(1.0 - 1e-15));
                let mut t = rounded(t0);
                if (real & !(mask(from_outside) & t.simd_gt(f32x8::ZERO))).any() {
                    let t1 = q / a;
                    let swap = t1.simd_lt(t0);
                    let (near, far) = (rounded(swap.select(t1, t0)), rounded(swap.select(t0, t1)));
                    t = within(near).select(near, far);
                }
                (real & within(t), [t, f32x8::ZERO, f32x8::ZERO])
            }
            Kernel::Disk { center, du, dv } => {
                let n = du.cross(dv);
                let from_center = o.minus(center);
                let t = -from_center.dot(n) / d.dot(n);
                if (candidates & within(rounded(t))).none() {
                    return (f32x8::ZERO, [f32x8::ZERO; 3]);
                }
                let p = from_center.plus(d, t);
                let n2 = f64x8::splat(n.length_squared());
                let (u, v) = (p.cross(dv).dot(n) / n2, p.crossed_by(du).dot(n) / n2);
                let inside = mask((u * u + v * v).simd_le(f64x8::ONE));
                let t = rounded(t);
                (candidates & inside & within(t), [t, rounded(u), rounded(v)])
            }
            Kernel::Cylinder { p0, axis, height, radius } => {
                let from_p0 = o.minus(p0);
                let Some(Roots { real, a, c, q }) =
                    circle(from_p0.across(axis), d.across(axis), radius, candidates)
                else {
                    return (f32x8::ZERO, [f32x8::ZERO; 3]);
                };
                let (t0, t1) = (c / q, q / a);
                let is_first = t0.simd_lt(t1);
                let roots = [is_first.select(t0, t1), is_first.select(t1, t0)];
                let [(near, v_near), (far, v_far)] = roots.map(|t| {
                    let v = from_p0.plus(d, t).dot(axis) / f64x8::splat(height);
                    let is_on = mask(v.simd_ge(f64x8::ZERO) & v.simd_le(f64x8::ONE));
                    (real & is_on & within(rounded(t)), rounded(v))
                });
                let hit = near | far;
                let t = near.select(rounded(roots[0]), rounded(roots[1]));
                // The angle is computed for hits only.
                let mut u = [0.0; 8];
                let at = roots.map(|t| from_p0.plus(d, t).0.map(f64x8::to_array));
                for lane in bits(hit.to_bitmask()) {
                    let root = usize::from(near.to_bitmask() >> lane & 1 == 0);
                    u[lane] = cylinder::turn(axis, at[root].map(|lanes| lanes[lane]).into());
                }
                (hit, [t, f32x8::new(u), near.select(v_near, v_far)])
            }
        }
    }
}

/// The parameters at which rays cross a sphere or an infinite cylinder: c/q and q/a.
struct Roots {
    /// Mask of the rays that cross it.
    real: f32x8,
    a: f64x8,
    c: f64x8,
    q: f64x8,
}

/// Computes [`cylinder::circle`] for the rays in a mask; `None` if none of them crosses the surface.
#[inline(always)]
fn circle(f: DVec3x8, d: DVec3x8, radius: f64, candidates: f32x8) -> Option<Roots> {
    let r2 = f64x8::splat(radius * radius);
    let (a, b) = (d.dot_x8(d), -f.dot_x8(d));
    let nearest = f.plus(d, b / a);
    let discriminant = r2 - nearest.dot_x8(nearest);
    let real = candidates & mask(discriminant.simd_ge(f64x8::ZERO));
    if real.none() {
        return None;
    }
    let q = b + ((a * discriminant).sqrt() | (b & f64x8::splat(-0.0)));
    Some(Roots { real, a, c: f.dot_x8(f) - r2, q })
}

/// Returns the mask of eight lanes of `f64` for lanes of `f32`.
#[inline(always)]
fn mask(lanes: f64x8) -> f32x8 {
    f32x8::new(lanes.to_array().map(|lane| f32::from_bits(lane.to_bits() as u32)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::primitive::PrimitiveHit;
    use crate::math::lanes::f32x16;
    use crate::math::{Ray, RayX16, Vec3};
    use crate::sampling::hash::{combine, to_unit};

    /// The hits of eight rays have the bits of those of one ray, wherever it starts and ends.
    #[test]
    fn lanes_have_the_bits_of_single_rays() {
        let mut seed = 0;
        let mut random = || {
            seed += 1;
            to_unit(combine(5, seed))
        };
        let mut vector = || Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5);
        let (mut misses, mut found) = (0, 0);
        for round in 0..30_000 {
            let center = vector() * [1.0, 100.0][round / 4 % 2];
            let (du, dv) = (vector(), vector());
            let primitive = match round % 4 {
                0 => Primitive::Sphere { center, radius: du.length() },
                3 => Primitive::Cylinder { p0: center - dv, p1: center + dv, radius: du.length() },
                1 => Primitive::Disk { center, du, dv },
                _ => Primitive::Disk { center, du, dv: du.cross(dv).normalize() * du.length() },
            };
            let rays: Vec<Ray> = (0..8)
                .map(|i| {
                    let on = center + vector().normalize() * du.length();
                    let in_plane = center + du * (0.7 * vector().x) + dv * (0.7 * vector().x);
                    let o = [on, in_plane, center + 3.0 * vector(), center, center + 400.0 * vector()][i % 5];
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
            let surface = BoundedSurface::new(0, primitive);
            let (hits, [t, u, v]) = match surface.hits(&lanes, f32x8::ONE) {
                Some(SurfaceHits::Lanes { hit, t, u, v }) => (hit.to_bitmask(), [t, u, v]),
                Some(SurfaceHits::Candidates(_)) => panic!("it has a kernel"),
                None => (0, [f32x8::ZERO; 3]),
            };
            for (i, ray) in rays.iter().enumerate() {
                let lane = |v: f32x8| v.to_array()[i];
                let hit = PrimitiveHit { t: lane(t), u: lane(u), v: lane(v) };
                let hit = (hits >> i & 1 == 1).then_some(hit);
                let bits = |hit: PrimitiveHit| [hit.t, hit.u, hit.v].map(f32::to_bits);
                assert_eq!(hit.map(bits), primitive.intersect(ray).map(bits), "{primitive:?} {ray:?}");
                (misses, found) = (misses + u32::from(hit.is_none()), found + u32::from(hit.is_some()));
            }
        }
        assert!(found > 10_000 && misses > 10_000, "{found} {misses}");
    }
}
