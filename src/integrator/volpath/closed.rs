//! The search for holes in the boundaries of media.

use crate::accel::Coherence;
use crate::ids::{MediumId, ShapeId};
use crate::integrator::worker::{Counters, intersect};
use crate::math::{Bounds, Ray, Vec2, Vec3};
use crate::sampling::hash::{pcg3d, to_unit};
use crate::sampling::warp;
use crate::scene::Scene;

/// The number of rays that look for holes, and of their steps.
const PROBES: usize = 1024;
const PROBE_STEPS: u32 = 8;
/// The least side of the box where they begin, relative to its longest side.
const LEAST_SIDE: f32 = 0.1;
/// Selects their random numbers.
const STREAM: u32 = 0x686f_6c65;

/// Returns whether all media [fill bodies](crate::scene::SceneMedia::fill_bodies) that are closed, as far as rays can
/// tell: no ray leaves a body but through the inner side of its boundary. Emitter samples find the light that falls
/// through a hole.
pub fn are_closed(scene: &Scene) -> bool {
    let Some(media) = scene.media.as_ref().filter(|media| media.fill_bodies()) else { return false };
    let is_boundary = |i: &usize| media.is_boundary(ShapeId::from(*i));
    let boundaries = (0..scene.shapes.len()).filter(is_boundary);
    let boxes: Vec<Bounds> = boundaries.map(|i| scene.shapes[i].world.geometry().bounds()).collect();
    let number = |i: usize, k: u32| pcg3d(i as u32, k, STREAM).map(to_unit);
    // Rays from around the box of a boundary to points in it. In the plane of a flat lid, they would meet the edges of
    // the surfaces beside it, where rays leave the body.
    let begin = |i: usize| {
        let Bounds { min, max } = boxes[i % boxes.len()];
        let thick = (max - min).max(Vec3::splat(LEAST_SIDE * (max - min).max_element()));
        let [from, to] = [0, 1].map(|k| Vec3::from(number(i, k)) - 0.5);
        let (from, to) =
            [(from, thick * 2.0), (to, max - min)].map(|(at, size)| min.midpoint(max) + size * at).into();
        (Ray::new(from, (to - from).normalize_or(Vec3::Z)), None)
    };
    // Each ray, and the medium of the body in which it is, if that is known.
    let count = if boxes.is_empty() { 0 } else { PROBES };
    let mut probes: Vec<(Ray, Option<MediumId>)> = (0..count).map(begin).collect();
    let (mut hits, mut counters) = (Vec::new(), Counters::default());
    for step in 2..PROBE_STEPS {
        let rays: Vec<Ray> = probes.iter().map(|(ray, _)| *ray).collect();
        intersect(scene, &rays, Coherence::Incoherent, &mut hits, &mut counters);
        let mut next = Vec::new();
        for (i, ((ray, medium), hit)) in probes.iter().zip(&hits).enumerate() {
            let Some(hit) = hit else {
                match medium {
                    Some(_) => return false,
                    None => continue,
                }
            };
            let at = scene.interaction(ray, hit);
            let (arrives, bounds) = (-at.ng.dot(ray.d).signum(), media.is_boundary(at.shape()));
            // A boundary that is met from outside belongs to another body inside.
            let beyond = media.beside(&at, -at.ng, *medium);
            if bounds && arrives > 0.0 && medium.is_some() && beyond == *medium {
                return false;
            }
            // Behind a boundary, rays start in its body; others go on from the side from which they came.
            let side = at.ng * if bounds { -1.0 } else { arrives };
            let [x, y, _] = number(i, step);
            let d = warp::square_to_sphere(Vec2::new(x, y));
            let d = if d.dot(side) < 0.0 { -d } else { d };
            next.push((scene.spawn_ray(&at, d, ray.time), beyond));
        }
        probes = next;
    }
    true
}
