//! The radii of the passes.

use crate::accel::Coherence;
use crate::integrator::{Preparation, Worker};
use crate::math::{Ray, Vec2, Vec3};
use crate::scene::Scene;
use crate::sensor::Camera;

/// Camera rays along each axis that the automatic radius looks at.
const RAYS: u32 = 24;
/// Dirac deltas that such a ray passes, at most.
const MOST_BOUNCES: u32 = 8;
/// The automatic radius in widths of a pixel.
const PIXELS: f32 = 3.0;
/// The automatic radius where the camera sees no surface, as a share of the scene's radius.
const SHARE: f32 = 1e-3;

/// The radius of pass `index`, from 0, after one of `first`: `r²ᵢ₊₁ = r²ᵢ (i + α)/(i + 1)`, i from 1.
/// [Knaus and Zwicker 2011, Eq. 15]
pub(super) fn of_pass(first: f32, alpha: f32, index: u64) -> f32 {
    // The product as far as it is short; from there on by its asymptote, whose relative error is below 1/(12·i).
    const SHORT: u64 = 1 << 12;
    let factor = |i: u64| (i as f64 + f64::from(alpha)) / (i as f64 + 1.0);
    let product: f64 = (1..=index.min(SHORT)).map(factor).product();
    let rest = (index.max(SHORT) as f64 / SHORT as f64).powf(f64::from(alpha) - 1.0);
    (f64::from(first).powi(2) * product * rest).sqrt() as f32
}

/// Three times the width of a pixel on the surfaces that the full image shows, directly or in mirrors and glass: the
/// median over a grid of rays. It depends neither on the seed nor on a crop.
pub(super) fn automatic(preparation: &Preparation<'_>) -> f32 {
    let Preparation { scene, camera, .. } = preparation;
    let mut worker = Worker::new(preparation.sampler);
    let size = Vec2::new(camera.film.width as f32, camera.film.height as f32);
    let mut widths: Vec<f32> = (0..RAYS * RAYS)
        .filter_map(|i| {
            let film = Vec2::new((i % RAYS) as f32 + 0.5, (i / RAYS) as f32 + 0.5) / RAYS as f32 * size;
            pixel_width(scene, camera, film, &mut worker)
        })
        .filter(|width| width.is_finite() && *width > 0.0)
        .collect();
    widths.sort_unstable_by(f32::total_cmp);
    match widths.get(widths.len() / 2) {
        Some(median) => PIXELS * median,
        None => (scene.bounds.radius() * SHARE).max(f32::MIN_POSITIVE.sqrt()),
    }
}

/// The width of a pixel at the first surface with a finite lobe, as if the way there were straight.
fn pixel_width(scene: &Scene, camera: &Camera, film: Vec2, worker: &mut Worker) -> Option<f32> {
    let middle = Vec2::splat(0.5);
    let [first, beside] = [film, film + Vec2::X].map(|film| camera.ray(film, middle, middle.x));
    let (mut ray, mut distance) = (first, 0.0);
    for _ in 0..=MOST_BOUNCES {
        worker.intersect(scene, &[ray], Coherence::Incoherent);
        let hit = worker.hits[0]?;
        distance += hit.t * ray.d.length();
        let at = scene.interaction(&ray, &hit);
        let wo = at.frame.to_local(-ray.d);
        worker.arena.reset();
        let bsdf = scene.bsdf(&at, wo, &worker.arena);
        if !bsdf.is_specular() {
            let along = |ray: &Ray| ray.o + ray.d.normalize_or(Vec3::Z) * distance;
            return Some((along(&first) - along(&beside)).length());
        }
        let sample = bsdf.sample(wo, middle.x, middle)?;
        ray = scene.spawn_ray(&at, at.frame.to_world(sample.wi), ray.time);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radii_shrink_as_the_recurrence_says() {
        let mut squared = 4.0f64;
        for i in 1..=20_000u64 {
            let radius = f64::from(of_pass(2.0, 0.7, i - 1));
            assert!((radius * radius / squared - 1.0).abs() < 1e-4, "pass {i}: {radius}, not {squared}");
            squared *= (i as f64 + f64::from(0.7f32)) / (i as f64 + 1.0);
        }
        assert_eq!(of_pass(2.0, 1.0, 77), 2.0);
    }
}
