//! The surfaces visible in the full image, estimated with a few camera rays. The result depends neither on the seed
//! nor on a crop.

use crate::accel::Coherence;
use crate::integrator::{Preparation, Worker};
use crate::math::{Bounds, DVec2, Ray, Vec2, Vec3};
use crate::scene::Scene;
use crate::sensor::Camera;

/// The number of camera rays along each axis.
const RAYS: u32 = 32;
/// The greatest number of Dirac deltas along a ray.
const MAX_BOUNCES: u32 = 8;
/// The automatic radius in pixel widths.
const PIXELS: f32 = 3.0;
/// The automatic radius relative to the scene's radius, for a camera that sees no surface.
const SHARE: f32 = 1e-3;
/// The margin around the bounding box of the points found, relative to its radius.
const MARGIN: f32 = 0.1;

/// The surfaces with finite lobes in the full image, seen directly or in mirrors and glass.
pub struct VisibleSurfaces {
    /// Their bounding box, with a margin.
    bounds: Bounds,
    /// The median width of a pixel on them.
    pixel: Option<f32>,
}

impl VisibleSurfaces {
    /// Traces camera rays for the camera of the preparation.
    pub fn of(preparation: &Preparation<'_>) -> Self {
        let Preparation { scene, camera, .. } = preparation;
        let mut worker = Worker::new(preparation.sampler);
        let size = DVec2::new(camera.film.width.into(), camera.film.height.into());
        let points: Vec<VisiblePoint> = (0..RAYS * RAYS)
            .filter_map(|i| {
                let film =
                    DVec2::new(f64::from(i % RAYS) + 0.5, f64::from(i / RAYS) + 0.5) / f64::from(RAYS) * size;
                visible_point(scene, camera, film, &mut worker)
            })
            .collect();
        let positive = |width: &f32| width.is_finite() && *width > 0.0;
        let mut widths: Vec<f32> = points.iter().map(|point| point.pixel).filter(positive).collect();
        widths.sort_unstable_by(f32::total_cmp);
        let tight = Bounds::of(points.iter().map(|point| point.p));
        let margin = Vec3::splat(MARGIN * tight.radius());
        VisibleSurfaces {
            bounds: Bounds { min: tight.min - margin, max: tight.max + margin },
            pixel: widths.get(widths.len() / 2).copied(),
        }
    }

    /// Returns whether a point is inside the bounds of visible surfaces.
    pub fn contains(&self, p: Vec3) -> bool {
        p.cmpge(self.bounds.min).all() && p.cmple(self.bounds.max).all()
    }

    /// Returns three pixel widths in scene units.
    pub fn radius(&self, scene: &Scene) -> f32 {
        PIXELS * self.pixel(scene)
    }

    /// Returns the median width of a pixel in scene units; a small part of the scene if the camera sees no surface.
    pub fn pixel(&self, scene: &Scene) -> f32 {
        self.pixel.unwrap_or_else(|| (scene.bounds.radius() * SHARE / PIXELS).max(f32::MIN_POSITIVE.sqrt()))
    }
}

/// A point seen by a camera ray, and the width of a pixel there.
struct VisiblePoint {
    p: Vec3,
    pixel: f32,
}

/// Finds the first surface with a finite lobe. The pixel width is computed from the length of the path, as if the
/// path were straight.
fn visible_point(scene: &Scene, camera: &Camera, film: DVec2, worker: &mut Worker) -> Option<VisiblePoint> {
    let middle = Vec2::splat(0.5);
    let [first, beside] = [film, film + DVec2::X].map(|film| camera.ray(film, middle, middle.x));
    let (mut ray, mut distance) = (first, 0.0);
    for _ in 0..=MAX_BOUNCES {
        worker.intersect(scene, &[ray], Coherence::Incoherent);
        let hit = worker.hits[0]?;
        distance += hit.t * ray.d.length();
        let at = scene.interaction(&ray, &hit);
        let wo = at.frame.to_local(-ray.d);
        worker.arena.reset();
        let bsdf = scene.bsdf(&at, Some(wo), &worker.arena);
        if !bsdf.is_specular() {
            let along = |ray: &Ray| ray.o + ray.d.normalize_or(Vec3::Z) * distance;
            return Some(VisiblePoint { p: at.p, pixel: (along(&first) - along(&beside)).length() });
        }
        let sample = bsdf.sample(wo, middle.x, middle)?;
        ray = scene.spawn_ray(&at, at.frame.to_world(sample.wi), ray.time);
    }
    None
}
