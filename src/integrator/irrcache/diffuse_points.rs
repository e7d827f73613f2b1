//! The surface points of the image that need irradiance: diffuse surfaces seen by camera rays directly, or after
//! specular or glossy reflection and refraction.

use crate::accel::Coherence;
use crate::bsdf::Split;
use crate::integrator::Worker;
use crate::integrator::block::ShadingBlock;
use crate::integrator::worker::{draw_1d, draw_2d, intersect};
use crate::math::lanes::bits;
use crate::math::ray::offset_origin;
use crate::math::{Frame, Ray, Vec2, Vec3};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;

/// A point on a diffuse surface.
#[derive(Clone, Copy, Debug)]
pub struct DiffusePoint {
    /// The position in world space.
    pub p: Vec3,
    /// Bound on the distance of `p` from the surface.
    pub error: f32,
    /// Geometric normal on the side from which the point is seen.
    pub ng: Vec3,
    /// Shading normal on that side.
    pub n: Vec3,
    /// Time in [0, 1] over the shutter interval.
    pub time: f32,
    /// Size of a pixel at the point, seen from the camera along the path, in scene units.
    pub pixel: f32,
    /// Growth of the pixel's size per unit of length.
    pub growth: f32,
}

impl DiffusePoint {
    /// Returns the ray from the point in the direction `d`, which is local to `frame`.
    pub fn ray(&self, frame: &Frame, d: Vec3) -> Ray {
        let d = frame.to_world(d);
        Ray { o: offset_origin(self.p, self.error, self.ng, d), t_max: f32::INFINITY, d, time: self.time }
    }
}

/// A ray with the width of a pixel along it.
#[derive(Clone, Copy, Debug)]
pub struct RayCone {
    /// The ray.
    pub ray: Ray,
    /// The key of its sample.
    pub key: SampleKey,
    /// Size of a pixel at the ray's origin.
    pub size: f32,
    /// Growth of the pixel's size per unit of length.
    pub growth: f32,
}

/// The greatest number of specular or glossy bounces before a diffuse surface.
const MAX_DEPTH: u32 = 16;

/// Appends the points that the rays hit, in order. Rays continue at surfaces that are not purely diffuse.
pub fn find(scene: &Scene, mut cones: Vec<RayCone>, worker: &mut Worker, found: &mut Vec<DiffusePoint>) {
    for depth in 0..MAX_DEPTH {
        let rays: Vec<Ray> = cones.iter().map(|cone| cone.ray).collect();
        let coherence = if depth == 0 { Coherence::Coherent } else { Coherence::Incoherent };
        let Worker { hits, counters, arena, numbers, sampler, .. } = worker;
        intersect(scene, &rays, coherence, hits, counters);
        let mut hit = hits.iter().map(Option::is_some);
        cones.retain(|_| hit.next() == Some(true));
        hits.retain(Option::is_some);
        let rays: Vec<Ray> = cones.iter().map(|cone| cone.ray).collect();
        let keys: Vec<SampleKey> = cones.iter().map(|cone| cone.key).collect();
        draw_1d(*sampler, Dimension::bsdf_lobe(depth), &keys, &mut numbers.bsdf_lobe);
        draw_2d(*sampler, Dimension::bsdf_direction(depth), &keys, &mut numbers.bsdf_direction);
        let mut next = Vec::new();
        for first in (0..rays.len()).step_by(crate::math::LANES) {
            arena.reset();
            let block = ShadingBlock::new(scene, arena, &rays, hits, first);
            for i in bits(block.active) {
                let cone = &cones[first + i];
                let (at, wo) = (block.at.lane(i), block.wo.lane(i));
                let Split { diffuse, rest } = block.bsdfs[i].split(wo, arena);
                let distance = at.hit.t * cone.ray.d.length();
                let size = cone.size + cone.growth * distance;
                if diffuse.is_some_and(|b| !b.radiance_per_irradiance(wo).is_black()) {
                    let side = 1f32.copysign(wo.z);
                    let toward = 1f32.copysign(-at.ng.dot(cone.ray.d));
                    // A pixel seen at an angle covers a larger area of the surface.
                    let pixel = size / wo.z.abs().max(0.1).sqrt();
                    let (n, ng) = (at.frame.n * side, at.ng * toward);
                    found.push(DiffusePoint {
                        p: at.p,
                        error: at.error,
                        ng,
                        n,
                        time: at.time,
                        pixel,
                        growth: cone.growth,
                    });
                }
                let Some(rest) = rest else { continue };
                let u = [0, 1].map(|k| numbers.bsdf_direction[k][first + i]);
                if let Some(sample) = rest.sample(wo, numbers.bsdf_lobe[first + i], Vec2::from_array(u)) {
                    let ray = scene.spawn_ray(&at, at.frame.to_world(sample.wi), at.time);
                    next.push(RayCone { ray, size, ..*cone });
                }
            }
        }
        if next.is_empty() {
            return;
        }
        cones = next;
    }
}
