//! The media in which light paths start.
//!
//! The boundaries of media tell what is on their two sides, but an emitter need not be beside one. So random walks
//! start at each emitter, and outside of the scene for light from infinity. They are reflected by opaque surfaces, and
//! end at the first boundary that transmits light: the medium on its near side is that in which they started. An opaque
//! boundary tells nothing, for scenes need not name the media that no light can reach.

use crate::accel::{Coherence, Hit};
use crate::emitter::Light;
use crate::error::{Error, Result};
use crate::ids::{EmitterId, MediumId, ShapeId};
use crate::integrator::flight::surfaces;
use crate::math::{Ray, Vec2};
use crate::sampling::hash::{pcg3d, to_unit};
use crate::sampling::warp;
use crate::scene::{Scene, SceneMedia, SurfaceInteraction};
use std::collections::HashMap;

/// The number of walks from each emitter, and the greatest number of surfaces that a walk meets.
const WALKS: u32 = 256;
const MOST_SURFACES: u32 = 64;

/// The medium around each emitter.
#[derive(Clone, Debug, Default)]
pub struct EmitterMedia(Vec<Option<MediumId>>);

/// What random walks have found.
#[derive(Default)]
struct Found {
    /// The number of walks that ended at a boundary, for each medium on the near side.
    media: HashMap<Option<MediumId>, u32>,
    /// Whether a walk has escaped to infinity.
    escaped: bool,
}

impl EmitterMedia {
    /// Finds the media.
    ///
    /// # Errors
    /// If an emitter is in several media.
    pub fn find(scene: &Scene, media: &SceneMedia) -> Result<Self> {
        let outside = at_infinity(scene, media);
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

/// Returns two random numbers for a step of a walk.
fn numbers(number: u32, walk: u32, step: u32) -> Vec2 {
    let [x, y, _] = pcg3d(number, walk, step);
    Vec2::new(to_unit(x), to_unit(y))
}

/// Returns the medium at infinity: that outside of the boundaries which walks into the scene meet. If they meet none,
/// that around the sensor has no end.
fn at_infinity(scene: &Scene, media: &SceneMedia) -> Option<MediumId> {
    let bounds = scene.bounds.union(media.bounds());
    let start = |walk: u32| {
        let [from, to] = [0, 1].map(|step| warp::square_to_sphere(numbers(u32::MAX, walk, step)));
        let (center, radius) = (bounds.center(), bounds.radius());
        let (from, to) = (center + from * (2.0 * radius), center + to * (0.5 * radius));
        Ray { time: 0.5, ..Ray::new(from, (to - from).normalize()) }
    };
    let found = walk(scene, media, (0..WALKS).map(start), u32::MAX);
    let most = found.media.into_iter().max_by_key(|(id, count)| (*count, id.map(|id| id.0)));
    most.map_or(media.sensor, |(id, _)| id)
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
    let number = emitter as u32;
    let start = |walk: u32| {
        let [point, direction] = [0, 1].map(|step| numbers(number, walk, step));
        Some(scene.lights[emitter].sample_ray(point, direction, 0.5)?.ray)
    };
    let Found { media: found, escaped } = walk(scene, media, (0..WALKS).filter_map(start), number);
    let mut found = found.into_keys();
    match (found.next(), found.next()) {
        (None, _) => Ok(if escaped { outside } else { media.sensor }),
        (Some(id), None) => Ok(id),
        (Some(_), Some(_)) => {
            let message = format!(
                "emitter {emitter} is in several media, so that light paths cannot start there; use volpath"
            );
            Err(Error::scene(message))
        }
    }
}

/// Follows random walks.
fn walk(scene: &Scene, media: &SceneMedia, starts: impl Iterator<Item = Ray>, number: u32) -> Found {
    let mut walks: Vec<(u32, Ray)> = (0..).zip(starts).collect();
    let mut found = Found::default();
    for step in 0..MOST_SURFACES {
        let rays: Vec<Ray> = walks.iter().map(|(_, ray)| *ray).collect();
        let mut met = nearest(scene, media, &rays).into_iter();
        walks.retain_mut(|(walk, ray)| {
            let Some(at) = met.next().flatten() else {
                found.escaped = true;
                return false;
            };
            let transmits = scene.materials.get(at.material).transmits;
            if transmits && media.is_boundary(at.shape()) {
                *found.media.entry(media.beside(&at, -ray.d, None)).or_default() += 1;
                return false;
            }
            let d = match transmits {
                true => ray.d,
                false => {
                    let d = warp::square_to_sphere(numbers(number, *walk, step + 2));
                    if (d.dot(at.ng) < 0.0) == (ray.d.dot(at.ng) < 0.0) { -d } else { d }
                }
            };
            *ray = scene.spawn_ray(&at, d, ray.time);
            true
        });
    }
    found
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
