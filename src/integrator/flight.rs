//! The flight along a ray through media and their boundaries.

use crate::accel::Hit;
use crate::color::Rgb;
use crate::emitter::{EmitterSample, ShadowTarget};
use crate::ids::MediumId;
use crate::math::lanes::each_lane;
use crate::math::ray::offset_origin;
use crate::math::{LANES, Ray, RayX16, Vec3};
use crate::medium::{FreeFlight, Medium, Segment, Stream};
use crate::sampling::SampleKey;
use crate::sampling::hash::combine;
use crate::scene::{Scene, SceneMedia, SurfaceInteraction, SurfaceInteractionX16};
use std::ops::Range;

/// The start of a ray that nothing scatters.
#[derive(Clone, Copy, Debug)]
pub struct Departure {
    /// The medium in which the ray starts.
    pub medium: Option<MediumId>,
    /// The random numbers of heterogeneous media.
    pub random: Stream,
}

impl Departure {
    /// Starts on a ray.
    pub fn unscattered(self, ray: Ray) -> Journey {
        Journey::new(ray, self.medium, FreeFlight::unscattered(self.random))
    }
}

/// A scattering event in a medium.
pub struct Collision<'a> {
    /// The medium.
    pub medium: &'a Medium,
    /// The point.
    pub p: Vec3,
    /// The ray parameter.
    pub t: f32,
    /// The distance from where the ray entered the medium.
    pub distance: f64,
}

/// A part of a ray in a medium.
pub struct Entry<'a, 's> {
    /// The medium.
    pub id: MediumId,
    /// The medium.
    pub medium: &'a Medium,
    /// The part of the ray.
    pub segment: Segment,
    /// The surface at its end, if there is one.
    pub ahead: &'s dyn Fn() -> Option<SurfaceInteraction>,
}

/// A ray on its way through media, from one boundary to the next.
#[derive(Clone, Copy, Debug)]
pub struct Journey {
    /// The medium in which the ray is.
    pub medium: Option<MediumId>,
    /// The flight along it.
    pub flight: FreeFlight,
    /// The rest of the ray.
    leg: Ray,
    /// The ray parameter of its start.
    before: f32,
}

impl Journey {
    /// Starts on a ray in a medium.
    pub fn new(ray: Ray, medium: Option<MediumId>, flight: FreeFlight) -> Self {
        Journey { medium, flight, leg: ray, before: 0.0 }
    }

    /// Passes the surface `at` at its end, with the same flight. Returns the ray behind it.
    pub fn pass(&mut self, scene: &Scene, media: &SceneMedia, at: &SurfaceInteraction) -> Ray {
        let Ray { d, t_max, time, .. } = self.leg;
        self.medium = media.beside(at, d, self.medium);
        self.before += t_max;
        self.leg = scene.spawn_ray(at, d, time);
        self.leg
    }

    /// Returns the length of the journey up to the end of its ray, in the unit of ray parameters.
    pub fn length(&self) -> f32 {
        self.before + self.leg.t_max
    }

    /// Ends the journey at a ray parameter.
    pub fn end_at(&mut self, t_max: f32) {
        self.leg.t_max = t_max;
    }

    /// Goes on to the next `boundary`, unless the surface `end` is reached before. Returns whether the journey goes on;
    /// if it ends in a medium, `collision` is the event.
    fn step<'a>(
        &mut self,
        scene: &Scene,
        media: &'a SceneMedia,
        boundary: Option<&SurfaceInteraction>,
        end: impl Fn() -> Option<SurfaceInteraction>,
        enter: impl FnOnce(&Entry<'a, '_>, &FreeFlight),
        collision: &mut Option<Collision<'a>>,
    ) -> bool {
        let Ray { o, d, t_max, time } = self.leg;
        let speed = f64::from(d.length());
        let boundary = boundary.filter(|at| {
            let before = (t_max - at.hit.t) * d.dot(at.ng).abs();
            let is_close = before <= rounding(o, d * t_max);
            !(is_close && end().is_some_and(|end| is_reached_first(&end, at, d)))
        });
        if let Some((id, medium)) = self.medium.and_then(|id| Some((id, media.get(Some(id))?))) {
            let length = boundary.map_or(t_max, |at| at.hit.t).max(0.0);
            let direction = (d.as_dvec3() / speed).as_vec3();
            let segment = Segment { origin: o, direction, length: f64::from(length) * speed };
            let ahead = || boundary.copied().or_else(&end);
            enter(&Entry { id, medium, segment, ahead: &ahead }, &self.flight);
            if let Some(distance) = self.flight.advance(medium, &segment) {
                let t = (distance / speed) as f32;
                let p = o + d * t;
                let is_close = (length - t) * d.length() <= rounding(o, d * length);
                let p = if is_close { before_end(p, ahead().as_ref(), d) } else { p };
                *collision = Some(Collision { medium, p, t: self.before + t, distance });
                return false;
            }
        }
        let Some(at) = boundary else { return false };
        let next = scene.spawn_ray(at, d, time);
        // Where the numbers have no step that is small enough, a ray cannot pass the boundary.
        if next.o == o {
            return false;
        }
        self.medium = media.beside(at, d, self.medium);
        self.before += at.hit.t;
        self.leg = Ray { t_max: t_max - at.hit.t, ..next };
        true
    }
}

/// Follows rays up to the surfaces that `end` returns, or their greatest parameter, through boundaries of media that do
/// not scatter them. Returns the scattering events in media of those whose flight ends before. `first` are the first
/// boundaries that rays may pass, if they are known. `enter` is called for each part of a ray that is in a medium,
/// before the flight through it.
pub fn follow<'a>(
    scene: &Scene,
    media: &'a SceneMedia,
    journeys: &mut [Journey],
    mut first: Option<&[Option<Hit>]>,
    end: impl Fn(usize) -> Option<SurfaceInteraction>,
    mut enter: impl FnMut(usize, &Entry<'a, '_>, &FreeFlight),
) -> Vec<Option<Collision<'a>>> {
    if !media.has_passed() {
        let step = |(i, journey): (usize, &mut Journey)| {
            let mut collision = None;
            let enter = |entry: &Entry<'a, '_>, flight: &FreeFlight| enter(i, entry, flight);
            journey.step(scene, media, None, || end(i), enter, &mut collision);
            collision
        };
        return journeys.iter_mut().enumerate().map(step).collect();
    }
    let mut collisions: Vec<_> = journeys.iter().map(|_| None).collect();
    let mut active: Vec<usize> = (0..journeys.len()).collect();
    let mut legs = Vec::with_capacity(active.len());
    while !active.is_empty() {
        legs.clear();
        legs.extend(active.iter().map(|&i| journeys[i].leg));
        let found;
        let hits = match first.take() {
            Some(hits) => hits,
            None => {
                found = media.passed(&legs);
                &found
            }
        };
        let mut count = 0;
        for block in (0..legs.len()).step_by(LANES) {
            let in_block = block..legs.len().min(block + LANES);
            let boundaries = Boundaries::new(scene, &legs, hits, in_block.clone());
            for j in in_block {
                let i = active[j];
                let boundary = boundaries.at(j - block);
                let enter = |entry: &Entry<'a, '_>, flight: &FreeFlight| enter(i, entry, flight);
                let goes_on =
                    journeys[i].step(scene, media, boundary.as_ref(), || end(i), enter, &mut collisions[i]);
                active[count] = i;
                count += usize::from(goes_on);
            }
        }
        active.truncate(count);
    }
    collisions
}

/// The boundaries on at most sixteen legs.
struct Boundaries {
    at: Option<SurfaceInteractionX16>,
    lanes: u32,
}

impl Boundaries {
    fn new(scene: &Scene, legs: &[Ray], hits: &[Option<Hit>], block: Range<usize>) -> Self {
        let hits = &hits[block.clone()];
        let lanes = hits.iter().enumerate().fold(0, |lanes, (k, hit)| lanes | u32::from(hit.is_some()) << k);
        let some = hits.iter().flatten().next();
        let at = some.map(|some| {
            let hits = each_lane(|k| hits.get(k).copied().flatten().unwrap_or(*some));
            scene.interactions(&RayX16::load(legs, block.start), &hits)
        });
        Boundaries { at, lanes }
    }

    fn at(&self, lane: usize) -> Option<SurfaceInteraction> {
        self.at.as_ref().filter(|_| self.lanes >> lane & 1 == 1).map(|at| at.lane(lane))
    }
}

/// The end of a flight.
pub struct Landing<'a> {
    /// The medium in which it ends.
    pub medium: Option<MediumId>,
    /// The factor of the throughput.
    pub weight: Rgb,
    /// The scattering event, if the flight ends in the medium.
    pub collision: Option<Collision<'a>>,
}

/// Follows rays up to the surfaces that `end` returns, beside the ray parameter there, or to infinity. `start` returns
/// the medium in which a ray starts, and its flight.
pub fn fly<'a, 's>(
    scene: &Scene,
    media: &'a SceneMedia,
    rays: &[Ray],
    end: impl Fn(usize) -> Option<(&'s SurfaceInteraction, f32)>,
    start: impl Fn(usize) -> (Option<MediumId>, FreeFlight),
) -> Vec<Landing<'a>> {
    let depart = |(i, ray): (usize, &Ray)| {
        let (medium, flight) = start(i);
        let t_max = end(i).map_or(ray.t_max, |(_, t)| t);
        Journey::new(Ray { t_max, ..*ray }, medium, flight)
    };
    let mut journeys: Vec<Journey> = rays.iter().enumerate().map(depart).collect();
    let end = |i: usize| Some(*end(i)?.0);
    let collisions = follow(scene, media, &mut journeys, None, end, |_, _, _| {});
    let land = |(Journey { medium, flight, .. }, collision): (Journey, Option<Collision<'a>>)| {
        let weight = match &collision {
            Some(collision) => flight.scattered(collision.medium),
            None => flight.passed(),
        };
        Landing { medium, weight, collision }
    };
    journeys.into_iter().zip(collisions).map(land).collect()
}

/// Returns a stream of random numbers for the event of a path after `bounce` others. `purpose` is 0, 1 or 2.
pub fn stream(key: SampleKey, bounce: u32, purpose: u32) -> Stream {
    Stream::new([combine(key.scramble, 3 * bounce + purpose), key.index])
}

/// Returns the medium in which light starts in the direction `wi` at a surface that the ray `d` hits in `medium`.
pub fn medium_after(
    scene: &Scene,
    media: &SceneMedia,
    at: &SurfaceInteraction,
    (d, wi): (Vec3, Vec3),
    medium: Option<MediumId>,
) -> Option<MediumId> {
    let crosses = (at.ng.dot(d) < 0.0) == (at.ng.dot(wi) < 0.0);
    // Nothing is transmitted by a two-sided material. Its normals are turned to the ray.
    let crosses = crosses && !scene.materials.get(at.material).two_sided;
    if crosses { media.beside(at, wi, medium) } else { medium }
}

/// Returns the ray from a point in a medium to that of an emitter sample.
pub fn ray_to_emitter(p: Vec3, sample: &EmitterSample, time: f32) -> Ray {
    match sample.target {
        ShadowTarget::Point(target) => Ray { o: p, d: target - p, t_max: 1.0, time },
        ShadowTarget::Infinity => Ray { time, ..Ray::new(p, sample.wi) },
    }
}

/// Returns the surface points that rays hit.
pub fn surfaces(scene: &Scene, rays: &[Ray], hits: &[Option<Hit>]) -> Vec<Option<SurfaceInteraction>> {
    let mut found: Vec<_> = hits.iter().map(|_| None).collect();
    let hitting: Vec<usize> = (0..hits.len()).filter(|&i| hits[i].is_some()).collect();
    for block in hitting.chunks(LANES) {
        let lane = |k: usize| block[k.min(block.len() - 1)];
        let of_block: [Ray; LANES] = std::array::from_fn(|k| rays[lane(k)]);
        let hits: [Hit; LANES] = std::array::from_fn(|k| hits[lane(k)].expect("a hit"));
        let at = scene.interactions(&RayX16::load(&of_block, 0), &hits);
        for (k, &i) in block.iter().enumerate() {
            found[i] = Some(at.lane(k));
        }
    }
    found
}

/// Returns the unit normal of a surface in the hemisphere of `d`.
fn normal_along(at: &SurfaceInteraction, d: Vec3) -> Vec3 {
    if at.ng.dot(d) < 0.0 { -at.ng } else { at.ng }
}

/// Returns a distance much longer than that by which rounding moves a point of a ray from `o` that ends at `o + to`,
/// unless a surface is a thousand times as large.
pub fn rounding(o: Vec3, to: Vec3) -> f32 {
    1e-4 * (o.abs().max_element() + to.length())
}

/// Returns whether a ray in the direction `d` hits the surface `end` before it has passed the boundary `at`: a ray that
/// starts behind the boundary would not hit it. This is so where surface and boundary coincide.
fn is_reached_first(end: &SurfaceInteraction, at: &SurfaceInteraction, d: Vec3) -> bool {
    let behind = offset_origin(at.p, at.error, at.ng, d);
    (end.p - behind).dot(normal_along(at, d)) <= 0.0
}

/// Returns a point on a ray in the direction `d`, which is before the surface `ahead` but for rounding, such that rays
/// from it start before the surface.
pub fn before_end(p: Vec3, ahead: Option<&SurfaceInteraction>, d: Vec3) -> Vec3 {
    let Some(at) = ahead else { return p };
    let n = normal_along(at, d);
    let beyond = (p - offset_origin(at.p, at.error, at.ng, -d)).dot(n);
    if beyond > 0.0 { p - n * beyond } else { p }
}
