//! Emitters that are hidden from the camera.

use super::worker::{Counters, intersect};
use crate::accel::{Coherence, Hit};
use crate::math::Ray;
use crate::scene::Scene;

/// Lets camera rays pass through emitting shapes. A ray that hits an emitting shape is continued behind it, until it
/// hits a surface that does not emit, or nothing. Rays and hits are replaced by those of the last segment. Returns
/// the distance of each ray before its last segment.
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
