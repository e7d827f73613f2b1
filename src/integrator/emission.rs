//! Emitters that the camera is not to see.

use super::worker::{Counters, intersect};
use crate::accel::{Coherence, Hit};
use crate::math::Ray;
use crate::scene::Scene;

/// Lets camera rays pass through emitting shapes: a ray that met one goes on behind it, until it meets a
/// surface that does not emit, or nothing. Rays and hits become those of the last leg; returned is how far each
/// ray had come before it.
pub fn skip_emitters(
    scene: &Scene,
    rays: &mut [Ray],
    hits: &mut [Option<Hit>],
    counters: &mut Counters,
) -> Vec<f32> {
    let mut pending: Vec<usize> = (0..rays.len()).collect();
    let mut passed: Vec<f32> = vec![0.0; rays.len()];
    let mut onward: Vec<Ray> = Vec::new();
    let mut found: Vec<Option<Hit>> = Vec::new();
    loop {
        pending.retain(|&i| hits[i].is_some_and(|h| scene.shapes[h.geometry as usize].emitter.is_some()));
        if pending.is_empty() {
            break;
        }
        onward.clear();
        for &i in &pending {
            let Some(hit) = hits[i] else { continue };
            let at = scene.interaction(&rays[i], &hit);
            let ray = rays[i];
            passed[i] += hit.t;
            onward.push(Ray { t_max: ray.t_max - hit.t, ..scene.spawn_ray(&at, ray.d, ray.time) });
        }
        intersect(scene, &onward, Coherence::Incoherent, &mut found, counters);
        for ((&i, ray), hit) in pending.iter().zip(&onward).zip(&found) {
            rays[i] = *ray;
            hits[i] = *hit;
        }
    }
    passed
}
