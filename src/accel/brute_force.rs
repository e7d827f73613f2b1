//! Every ray against every primitive, in double precision: the oracle that tests hold the other back ends against.

use super::geometry::valid_triangle;
use super::{Accel, Geometry, Hit, NO_INSTANCE, is_valid_ray};
use crate::math::{Bounds, DVec3, Ray, Vec3};

/// A back end without any structure. Its cost is linear in the number of primitives.
pub struct BruteForce {
    geometry: Vec<Geometry>,
    bounds: Bounds,
}

impl BruteForce {
    /// Takes the geometry as it is; nothing is built.
    pub fn new(mut geometry: Vec<Geometry>) -> Self {
        let bounds = super::geometry::check(&mut geometry).bounds;
        BruteForce { geometry, bounds }
    }
}

impl Accel for BruteForce {
    fn name(&self) -> &'static str {
        "brute force"
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn memory_bytes(&self) -> usize {
        0
    }

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        if !is_valid_ray(ray) {
            return None;
        }
        let mut nearest: Option<Hit> = None;
        let mut ray = *ray;
        for (geometry, entry) in self.geometry.iter().enumerate() {
            for primitive in 0..entry.len() {
                if let Some((t, u, v)) = intersect_one(entry, primitive, &ray) {
                    ray.t_max = t;
                    let (geometry, primitive) = (geometry as u32, primitive as u32);
                    nearest = Some(Hit { t, u, v, geometry, primitive, instance: NO_INSTANCE });
                }
            }
        }
        nearest
    }

    fn occluded(&self, ray: &Ray) -> bool {
        is_valid_ray(ray)
            && self.geometry.iter().any(|e| (0..e.len()).any(|i| intersect_one(e, i, ray).is_some()))
    }
}

fn intersect_one(entry: &Geometry, primitive: usize, ray: &Ray) -> Option<(f32, f32, f32)> {
    match entry {
        Geometry::Triangles { positions, indices } => {
            intersect_triangle(valid_triangle(positions, indices[primitive])?, ray)
        }
        Geometry::Analytic(surface) if surface.is_valid() => surface.intersect(ray).map(|h| (h.t, h.u, h.v)),
        Geometry::Analytic(_) => None,
    }
}

/// A triangle by signed volumes in double precision, edges included. Returns t and the barycentric weights of the
/// second and third corner.
fn intersect_triangle(corners: [Vec3; 3], ray: &Ray) -> Option<(f32, f32, f32)> {
    let o = ray.o.as_dvec3();
    let d = ray.d.as_dvec3();
    let [a, b, c] = corners.map(|p| p.as_dvec3() - o);
    let volume = |p: DVec3, q: DVec3| d.dot(q.cross(p));
    let (u, v, w) = (volume(c, b), volume(a, c), volume(b, a));
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return None;
    }
    let det = u + v + w;
    let n = (b - a).cross(c - a);
    let t = (n.dot(a) / n.dot(d)) as f32;
    if det == 0.0 || !(t > 0.0 && t < ray.t_max) {
        return None;
    }
    Some((t, (v / det) as f32, (w / det) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn u_and_v_weigh_the_second_and_third_corner() {
        let corners = [Vec3::ZERO, Vec3::new(2.0, 0.0, 0.0), Vec3::new(0.0, 3.0, 0.0)];
        let p = corners[1] * 0.25 + corners[2] * 0.5;
        for side in [1.0, -1.0] {
            let ray = Ray::new(p + Vec3::Z * side, -Vec3::Z * side);
            let (t, u, v) = intersect_triangle(corners, &ray).expect("hit from both sides");
            assert!((t - 1.0).abs() < 1e-6 && (u - 0.25).abs() < 1e-6 && (v - 0.5).abs() < 1e-6);
        }
        assert_eq!(intersect_triangle(corners, &Ray::new(Vec3::new(-0.1, 1.0, 1.0), -Vec3::Z)), None);
    }
}
