//! The flight along a ray through media and their boundaries.

use crate::color::Rgb;
use crate::ids::MediumId;
use crate::math::ray::offset_origin;
use crate::math::{Ray, Vec3};
use crate::medium::{FreeFlight, Medium, Segment, Stream};
use crate::scene::{Scene, SceneMedia, SurfaceInteraction};

/// A scattering event in a medium.
pub struct Collision<'a> {
    /// The medium.
    pub medium: &'a Medium,
    /// The point.
    pub p: Vec3,
    /// The ray parameter.
    pub t: f32,
}

/// Follows a ray up to the parameter `t_end`, through boundaries of media that do not scatter it. `end` is the surface
/// at `t_end`, if there is one. `current` is the medium in which the ray starts, and is replaced by the one in which it
/// ends. Returns the scattering event in a medium, if `flight` ends before.
pub fn follow<'a>(
    scene: &Scene,
    media: &'a SceneMedia,
    ray: &Ray,
    (t_end, end): (f32, Option<&SurfaceInteraction>),
    current: &mut Option<MediumId>,
    flight: &mut FreeFlight,
) -> Option<Collision<'a>> {
    let speed = f64::from(ray.d.length());
    let mut leg = Ray { t_max: t_end, ..*ray };
    let mut before = 0.0;
    loop {
        let boundary = media.passed(&leg).map(|hit| (hit.t, scene.interaction(&leg, &hit)));
        let boundary = boundary.filter(|(_, at)| !end.is_some_and(|end| is_reached_first(end, at, ray.d)));
        let length = boundary.as_ref().map_or(leg.t_max, |(t, _)| *t).max(0.0);
        let segment = Segment {
            origin: leg.o,
            direction: (ray.d.as_dvec3() / speed).as_vec3(),
            length: f64::from(length) * speed,
        };
        let mut flown = |medium: &Medium| flight.advance(medium, &segment);
        let medium = media.get(*current);
        if let Some((medium, distance)) = medium.and_then(|medium| Some((medium, flown(medium)?))) {
            let t = (distance / speed) as f32;
            let ahead = boundary.as_ref().map(|(_, at)| at).or(end);
            let p = leg.o + leg.d * t;
            let p = ahead.map_or(p, |at| before_surface(p, at, ray.d));
            return Some(Collision { medium, p, t: before + t });
        }
        let (t, at) = boundary?;
        *current = media.beside(&at, ray.d, *current);
        before += t;
        leg = Ray { t_max: leg.t_max - t, ..scene.spawn_ray(&at, ray.d, ray.time) };
    }
}

/// Returns the transmittance of the media along a ray that starts in `medium`; in heterogeneous media, an unbiased
/// estimate of it.
pub fn transmittance(
    scene: &Scene,
    media: &SceneMedia,
    ray: &Ray,
    medium: Option<MediumId>,
    random: Stream,
) -> Rgb {
    let mut flight = FreeFlight::unscattered(random);
    let mut current = medium;
    follow(scene, media, ray, (ray.t_max, None), &mut current, &mut flight);
    flight.passed()
}

/// Returns the unit normal of a surface in the hemisphere of `d`.
fn normal_along(at: &SurfaceInteraction, d: Vec3) -> Vec3 {
    if at.ng.dot(d) < 0.0 { -at.ng } else { at.ng }
}

/// Returns whether a ray in the direction `d` hits the surface `end` before it has passed the boundary `at`: a ray that
/// starts behind the boundary would not hit it. This is so where surface and boundary coincide.
fn is_reached_first(end: &SurfaceInteraction, at: &SurfaceInteraction, d: Vec3) -> bool {
    let behind = offset_origin(at.p, at.error, at.ng, d);
    (end.p - behind).dot(normal_along(at, d)) <= 0.0
}

/// Returns a point on a ray in the direction `d`, which is before the surface `at` but for rounding, such that rays
/// from it start before the surface.
fn before_surface(p: Vec3, at: &SurfaceInteraction, d: Vec3) -> Vec3 {
    let n = normal_along(at, d);
    let beyond = (p - offset_origin(at.p, at.error, at.ng, -d)).dot(n);
    if beyond > 0.0 { p - n * beyond } else { p }
}
