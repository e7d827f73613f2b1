//! The media in which light paths start.
//!
//! The boundaries of media tell what is on their two sides, but an emitter need not be beside one. So random walks
//! start at each emitter. They are reflected by opaque surfaces, and end at the first boundary that transmits light, or
//! at infinity: the medium on the near side is that around the emitter.

use crate::accel::{Coherence, Hit};
use crate::emitter::Light;
use crate::error::{Error, Result};
use crate::ids::{EmitterId, MediumId, ShapeId};
use crate::integrator::flight::surfaces;
use crate::math::{Ray, Vec2};
use crate::sampling::hash::{pcg3d, to_unit};
use crate::sampling::warp;
use crate::scene::{Scene, SceneMedia, SurfaceInteraction};
use crate::sensor::Camera;
use std::collections::HashMap;

/// The number of walks from each emitter, and the greatest number of surfaces that a walk meets.
const WALKS: u32 = 64;
const MOST_SURFACES: u32 = 64;
/// The share of the walks that must find the same medium. Scenes have gaps through which others escape.
const AGREEMENT: f64 = 0.95;

/// The medium around each emitter.
#[derive(Clone, Debug, Default)]
pub struct EmitterMedia(Vec<Option<MediumId>>);

impl EmitterMedia {
    /// Finds the media. That at infinity is the one in which a ray from the sensor ends that goes through all surfaces.
    ///
    /// # Errors
    /// If an emitter is in several media.
    pub fn find(scene: &Scene, media: &SceneMedia, camera: &Camera) -> Result<Self> {
        let middle = Vec2::splat(0.5);
        let film = [camera.film.width, camera.film.height].map(|length| f64::from(length) / 2.0);
        let outside = medium_at_infinity(scene, media, camera.ray(film.into(), middle, middle.x));
        let mut declared = vec![None; scene.lights.len()];
        for (id, shape) in scene.shapes.iter().enumerate() {
            if let Some(emitter) = shape.emitter {
                declared[emitter.index()] = media.exterior(ShapeId::from(id));
            }
        }
        let find = |(i, light): (usize, &Light)| match (light.is_distant(), declared[i]) {
            (true, _) => Ok(outside),
            (false, Some(id)) => Ok(Some(id)),
            (false, None) => around(scene, media, i, outside),
        };
        scene.lights.iter().enumerate().map(find).collect::<Result<_>>().map(EmitterMedia)
    }

    /// Returns the medium around an emitter; `None` for vacuum.
    pub fn of(&self, emitter: EmitterId) -> Option<MediumId> {
        self.0[emitter.index()]
    }
}

/// Returns the medium around an emitter that is not at infinity. If all walks stay between opaque surfaces, the sensor
/// is there, too, or never sees light of the emitter.
///
/// # Errors
/// If the walks find several.
fn around(
    scene: &Scene,
    media: &SceneMedia,
    emitter: usize,
    outside: Option<MediumId>,
) -> Result<Option<MediumId>> {
    let number = |walk: u32, step: u32| {
        let [x, y, _] = pcg3d(emitter as u32, walk, step);
        Vec2::new(to_unit(x), to_unit(y))
    };
    let start = |walk: u32| {
        let light = scene.lights[emitter].sample_ray(number(walk, 0), number(walk, 1), 0.5)?;
        Some((walk, light.ray))
    };
    let mut walks: Vec<(u32, Ray)> = (0..WALKS).filter_map(start).collect();
    let mut votes: HashMap<Option<MediumId>, u32> = HashMap::new();
    for step in 0..MOST_SURFACES {
        let rays: Vec<Ray> = walks.iter().map(|(_, ray)| *ray).collect();
        let mut met = nearest(scene, media, &rays).into_iter();
        walks.retain_mut(|(walk, ray)| {
            let Some(at) = met.next().flatten() else {
                *votes.entry(outside).or_default() += 1;
                return false;
            };
            let transmits = scene.materials.get(at.material).transmits;
            if transmits && media.is_boundary(at.shape()) {
                *votes.entry(media.beside(&at, -ray.d, None)).or_default() += 1;
                return false;
            }
            let d = match transmits {
                true => ray.d,
                false => {
                    let d = warp::square_to_sphere(number(*walk, step + 2));
                    if (d.dot(at.ng) < 0.0) == (ray.d.dot(at.ng) < 0.0) { -d } else { d }
                }
            };
            *ray = scene.spawn_ray(&at, d, ray.time);
            true
        });
    }
    let sum: u32 = votes.values().sum();
    match votes.into_iter().max_by_key(|(id, count)| (*count, id.map(|id| id.0))) {
        None => Ok(media.sensor),
        Some((id, count)) if f64::from(count) >= AGREEMENT * f64::from(sum) => Ok(id),
        Some(_) => {
            let message = format!(
                "emitter {emitter} is in several media, so that light paths cannot start there; use volpath"
            );
            Err(Error::scene(message))
        }
    }
}

/// Returns the medium in which a ray ends that goes through all surfaces, from the sensor.
fn medium_at_infinity(scene: &Scene, media: &SceneMedia, mut ray: Ray) -> Option<MediumId> {
    let mut medium = media.sensor;
    while let Some(at) = &nearest(scene, media, &[ray])[0] {
        let next = scene.spawn_ray(at, ray.d, ray.time);
        if next.o == ray.o {
            break;
        }
        medium = media.beside(at, ray.d, medium);
        ray = next;
    }
    medium
}

/// Returns the nearest surface points on rays, those of boundaries included that rays may pass.
fn nearest(scene: &Scene, media: &SceneMedia, rays: &[Ray]) -> Vec<Option<SurfaceInteraction>> {
    let mut hits = vec![None; rays.len()];
    scene.accel.intersect_wave(rays, &mut hits, Coherence::Incoherent);
    for (hit, passed) in hits.iter_mut().zip(media.passed(rays)) {
        let is_first = |passed: &Hit| hit.is_none_or(|hit: Hit| passed.t < hit.t);
        *hit = passed.filter(is_first).or(*hit);
    }
    surfaces(scene, rays, &hits)
}
