//! A back end that tests every ray against every primitive in double precision. Tests compare the other back ends
//! with it.

use super::assembly::{Assembly, CheckedAssembly, FilterQuery};
use super::geometry::valid_triangle;
use super::primitive::RayF64;
use super::{Accel, Geometry, Hit, NO_INSTANCE, is_valid_ray};
use crate::error::Result;
use crate::math::{Bounds, DVec3, Ray, Vec3};

/// An accelerator without a data structure. Its cost is linear in the number of primitives.
pub struct BruteForce {
    assembly: Assembly,
    checked: CheckedAssembly,
}

impl BruteForce {
    /// Stores the assembly; nothing is built.
    ///
    /// # Errors
    /// As [`build`](super::build).
    pub fn new(assembly: impl Into<Assembly>) -> Result<Self> {
        let mut assembly = assembly.into();
        let checked = assembly.check()?;
        Ok(BruteForce { assembly, checked })
    }

    /// Returns the nearest accepted hit of one geometry. `line` is `ray` in the space of the geometry's group.
    fn intersect_geometry(
        &self,
        (geometry, instance): (u32, u32),
        line: &mut RayF64,
        ask: &dyn Fn(&Hit) -> bool,
    ) -> Option<Hit> {
        let mut nearest = None;
        let hit = |(t, u, v), primitive| Hit { t, u, v, geometry, primitive, instance };
        match &self.assembly.geometry[geometry as usize] {
            Geometry::Triangles { positions, indices } => {
                for (primitive, &triangle) in (0..).zip(indices.iter()) {
                    let Some(corners) = valid_triangle(positions, triangle) else { continue };
                    let found = intersect_triangle(corners, line).map(|found| hit(found, primitive));
                    if let Some(found) = found.filter(ask) {
                        line.t_max = found.t;
                        nearest = Some(found);
                    }
                }
            }
            Geometry::Analytic(surface) if surface.is_valid() => {
                let place = |h: &super::PrimitiveHit| hit((h.t, h.u, h.v), 0);
                nearest = surface.intersect_line(line, |h| ask(&place(h))).map(|h| place(&h));
                line.t_max = nearest.map_or(line.t_max, |hit| hit.t);
            }
            Geometry::Analytic(_) => {}
            Geometry::Surfaces(surfaces) => {
                for (primitive, surface) in surfaces.valid() {
                    let place = |h: &super::PrimitiveHit| hit((h.t, h.u, h.v), primitive);
                    if let Some(found) = surface.intersect_line(line, |h| ask(&place(h))) {
                        line.t_max = found.t;
                        nearest = Some(place(&found));
                    }
                }
            }
        }
        nearest
    }
}

impl Accel for BruteForce {
    fn name(&self) -> &'static str {
        "brute force"
    }

    fn bounds(&self) -> Bounds {
        self.checked.bounds
    }

    fn memory_bytes(&self) -> usize {
        0
    }

    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        if !is_valid_ray(ray, self.checked.ray_limit) {
            return None;
        }
        let query = FilterQuery::new(self.assembly.filter.as_ref(), ray);
        let mut nearest = None;
        let mut line = RayF64::from(ray);
        for &geometry in &self.checked.world {
            let ask = |hit: &Hit| query.accepts(ray, hit);
            nearest = self.intersect_geometry((geometry, NO_INSTANCE), &mut line, &ask).or(nearest);
        }
        for (i, instance) in (0..).zip(&self.assembly.instances) {
            let inverse = instance.world_inverse(ray.time);
            let mut local = RayF64 {
                o: inverse.transform_point3(line.o),
                d: inverse.transform_vector3(line.d),
                t_max: line.t_max,
            };
            let local_ray = Ray { o: local.o.as_vec3(), d: local.d.as_vec3(), ..*ray };
            let ask = |hit: &Hit| query.accepts(&local_ray, hit);
            for &geometry in &self.assembly.groups[instance.group as usize] {
                nearest = self.intersect_geometry((geometry, i), &mut local, &ask).or(nearest);
            }
            line.t_max = local.t_max;
        }
        nearest
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.intersect(ray).is_some()
    }
}

/// Intersects a triangle by signed volumes in double precision, edges included. Returns t and the barycentric weights
/// of the second and third corner.
fn intersect_triangle(corners: [Vec3; 3], line: &RayF64) -> Option<(f32, f32, f32)> {
    let (o, d) = (line.o, line.d);
    let [a, b, c] = corners.map(|p| p.as_dvec3() - o);
    let volume = |p: DVec3, q: DVec3| d.dot(q.cross(p));
    let (u, v, w) = (volume(c, b), volume(a, c), volume(b, a));
    if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
        return None;
    }
    let det = u + v + w;
    let n = (b - a).cross(c - a);
    let t = line.within(n.dot(a) / n.dot(d))?;
    (det != 0.0).then_some((t, (v / det) as f32, (w / det) as f32))
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
            let (t, u, v) = intersect_triangle(corners, &RayF64::from(&ray)).expect("hit from both sides");
            assert!((t - 1.0).abs() < 1e-6 && (u - 0.25).abs() < 1e-6 && (v - 0.5).abs() < 1e-6);
        }
        assert_eq!(
            intersect_triangle(corners, &RayF64::from(&Ray::new(Vec3::new(-0.1, 1.0, 1.0), -Vec3::Z))),
            None
        );
    }
}
