//! Places of the image whose irradiance is wanted: the diffuse surfaces that camera rays find, directly or by way of mirrors,
//! glass and gloss.

use crate::accel::Coherence;
use crate::bsdf::Split;
use crate::integrator::Worker;
use crate::integrator::block::Block;
use crate::integrator::worker::{draw_1d, draw_2d, intersect};
use crate::math::lanes::bits;
use crate::math::ray::offset_origin;
use crate::math::{Frame, Ray, Vec2, Vec3};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;

/// A point of a diffuse surface.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// The point, in the world.
    pub p: Vec3,
    /// Bound on its distance from the surface.
    pub error: f32,
    /// Geometric normal of the side that it is seen from.
    pub ng: Vec3,
    /// Shading normal of that side.
    pub n: Vec3,
    /// Time in [0, 1] over the shutter interval.
    pub time: f32,
    /// Size of a pixel there, seen from the camera along the path, in the world's units.
    pub pixel: f32,
    /// How much the pixel grows per unit of length.
    pub growth: f32,
}

impl Place {
    /// The ray that leaves it in the direction `d`, which is local to `frame`.
    pub fn ray(&self, frame: &Frame, d: Vec3) -> Ray {
        let d = frame.to_world(d);
        Ray { o: offset_origin(self.p, self.error, self.ng, d), t_max: f32::INFINITY, d, time: self.time }
    }
}

/// A camera ray, and how wide the pixel is along it.
#[derive(Clone, Copy, Debug)]
pub struct Sight {
    /// The ray.
    pub ray: Ray,
    /// Its sample's key.
    pub key: SampleKey,
    /// Size of the pixel where the ray begins.
    pub size: f32,
    /// How much the pixel grows per unit of length.
    pub growth: f32,
}

/// The longest chain of mirrors to look for diffuse surfaces behind.
const MAX_DEPTH: u32 = 16;

/// Appends the places that the camera rays find, in their order; with `deep` also those behind surfaces that are not diffuse.
pub fn find(scene: &Scene, mut sights: Vec<Sight>, deep: bool, worker: &mut Worker, found: &mut Vec<Place>) {
    for depth in 0..MAX_DEPTH {
        let rays: Vec<Ray> = sights.iter().map(|sight| sight.ray).collect();
        let coherence = if depth == 0 { Coherence::Coherent } else { Coherence::Incoherent };
        let Worker { hits, counters, arena, numbers, sampler, .. } = worker;
        intersect(scene, &rays, coherence, hits, counters);
        let mut hit = hits.iter().map(Option::is_some);
        sights.retain(|_| hit.next() == Some(true));
        hits.retain(Option::is_some);
        let rays: Vec<Ray> = sights.iter().map(|sight| sight.ray).collect();
        if deep {
            let keys: Vec<SampleKey> = sights.iter().map(|sight| sight.key).collect();
            draw_1d(*sampler, Dimension::bsdf_lobe(depth), &keys, &mut numbers.bsdf_lobe);
            draw_2d(*sampler, Dimension::bsdf_direction(depth), &keys, &mut numbers.bsdf_direction);
        }
        let mut next = Vec::new();
        for first in (0..rays.len()).step_by(crate::math::LANES) {
            arena.reset();
            let block = Block::new(scene, arena, &rays, hits, first);
            for i in bits(block.active) {
                let sight = &sights[first + i];
                let (at, wo) = (block.at.lane(i), block.wo.lane(i));
                let Split { diffuse, rest } = block.bsdfs[i].split(wo, arena);
                let distance = at.hit.t * sight.ray.d.length();
                let size = sight.size + sight.growth * distance;
                if diffuse.is_some_and(|b| !b.radiance_per_irradiance(wo).is_black()) {
                    let side = 1f32.copysign(wo.z);
                    let toward = 1f32.copysign(-at.ng.dot(sight.ray.d));
                    // A pixel that is seen at an angle covers more of the surface.
                    let pixel = size / wo.z.abs().max(0.1).sqrt();
                    let (n, ng) = (at.frame.n * side, at.ng * toward);
                    found.push(Place {
                        p: at.p,
                        error: at.error,
                        ng,
                        n,
                        time: at.time,
                        pixel,
                        growth: sight.growth,
                    });
                }
                let Some(rest) = rest.filter(|_| deep) else { continue };
                let u = [0, 1].map(|k| numbers.bsdf_direction[k][first + i]);
                if let Some(sample) = rest.sample(wo, numbers.bsdf_lobe[first + i], Vec2::from_array(u)) {
                    let ray = scene.spawn_ray(&at, at.frame.to_world(sample.wi), at.time);
                    next.push(Sight { ray, size, ..*sight });
                }
            }
        }
        if next.is_empty() {
            return;
        }
        sights = next;
    }
}
