//! What the full image shows, from a few camera rays: it depends neither on the seed nor on a crop.

use crate::accel::Coherence;
use crate::integrator::{Preparation, Worker};
use crate::math::{Bounds, DVec2, Ray, Vec2, Vec3};
use crate::scene::Scene;
use crate::sensor::Camera;

/// Camera rays along each axis.
const RAYS: u32 = 32;
/// Dirac deltas that a ray passes, at most.
const MOST_BOUNCES: u32 = 8;
/// The automatic radius in widths of a pixel.
const PIXELS: f32 = 3.0;
/// The automatic radius where the camera sees no surface, as a share of the scene's radius.
const SHARE: f32 = 1e-3;
/// How far what is seen reaches beside the box around the points found, as a share of its radius.
const MARGIN: f32 = 0.1;

/// The surfaces with finite lobes that the full image shows, directly or in mirrors and glass.
pub(super) struct View {
    /// Around them, with a margin.
    bounds: Bounds,
    /// Median width of a pixel on them.
    pixel: Option<f32>,
}

impl View {
    /// What the camera of the preparation sees.
    pub fn of(preparation: &Preparation<'_>) -> Self {
        let Preparation { scene, camera, .. } = preparation;
        let mut worker = Worker::new(preparation.sampler);
        let size = DVec2::new(camera.film.width.into(), camera.film.height.into());
        let points: Vec<Seen> = (0..RAYS * RAYS)
            .filter_map(|i| {
                let film =
                    DVec2::new(f64::from(i % RAYS) + 0.5, f64::from(i / RAYS) + 0.5) / f64::from(RAYS) * size;
                seen(scene, camera, film, &mut worker)
            })
            .collect();
        let positive = |width: &f32| width.is_finite() && *width > 0.0;
        let mut widths: Vec<f32> = points.iter().map(|point| point.pixel).filter(positive).collect();
        widths.sort_unstable_by(f32::total_cmp);
        let tight = Bounds::of(points.iter().map(|point| point.p));
        let margin = Vec3::splat(MARGIN * tight.radius());
        View {
            bounds: Bounds { min: tight.min - margin, max: tight.max + margin },
            pixel: widths.get(widths.len() / 2).copied(),
        }
    }

    /// Whether a point lies where something is seen, as far as the rays can tell.
    pub fn contains(&self, p: Vec3) -> bool {
        p.cmpge(self.bounds.min).all() && p.cmple(self.bounds.max).all()
    }

    /// Three widths of a pixel, in scene units.
    pub fn radius(&self, scene: &Scene) -> f32 {
        let otherwise = (scene.bounds.radius() * SHARE).max(f32::MIN_POSITIVE.sqrt());
        self.pixel.map_or(otherwise, |pixel| PIXELS * pixel)
    }
}

/// A point that a camera ray leads to, and the width of a pixel there.
struct Seen {
    p: Vec3,
    pixel: f32,
}

/// The first surface with a finite lobe; the pixel's width is that at its distance, as if the way there were straight.
fn seen(scene: &Scene, camera: &Camera, film: DVec2, worker: &mut Worker) -> Option<Seen> {
    let middle = Vec2::splat(0.5);
    let [first, beside] = [film, film + DVec2::X].map(|film| camera.ray(film, middle, middle.x));
    let (mut ray, mut distance) = (first, 0.0);
    for _ in 0..=MOST_BOUNCES {
        worker.intersect(scene, &[ray], Coherence::Incoherent);
        let hit = worker.hits[0]?;
        distance += hit.t * ray.d.length();
        let at = scene.interaction(&ray, &hit);
        let wo = at.frame.to_local(-ray.d);
        worker.arena.reset();
        let bsdf = scene.bsdf(&at, Some(wo), &worker.arena);
        if !bsdf.is_specular() {
            let along = |ray: &Ray| ray.o + ray.d.normalize_or(Vec3::Z) * distance;
            return Some(Seen { p: at.p, pixel: (along(&first) - along(&beside)).length() });
        }
        let sample = bsdf.sample(wo, middle.x, middle)?;
        ray = scene.spawn_ray(&at, at.frame.to_world(sample.wi), ray.time);
    }
    None
}
