//! The flight along a ray through media and their boundaries.

use crate::accel::Hit;
use crate::color::Rgb;
use crate::emitter::{EmitterSample, EmitterSampleX16, ShadowTarget};
use crate::ids::MediumId;
use crate::math::lanes::{bits, each_lane, f32x16, load, mask_from_bits};
use crate::math::ray::offset_origin;
use crate::math::{LANES, Ray, RayX16, Vec3, Vec3x16};
use crate::medium::lanes::{CoefficientsX16, FlightX16};
use crate::medium::{Heterogeneous, Medium, Segment, Stream};
use crate::sampling::SampleKey;
use crate::sampling::hash::combine;
use crate::scene::{Facet, Scene, SceneMedia, SurfaceInteraction, SurfaceInteractionX16};

/// The part of coordinates and lengths that is much more than their rounding.
const ROUNDING: f32 = 1e-4;

/// The start of a ray in a medium.
#[derive(Clone, Copy, Debug)]
pub struct Departure {
    /// The medium in which the ray starts.
    pub medium: Option<MediumId>,
    /// The random numbers of heterogeneous media.
    pub random: Stream,
}

/// A scattering event in a medium.
#[derive(Clone, Copy, Debug)]
pub struct Collision {
    /// The medium.
    pub medium: MediumId,
    /// The point.
    pub p: Vec3,
    /// The ray parameter.
    pub t: f32,
    /// The distance from where the ray entered the medium.
    pub distance: f32,
}

/// At most sixteen rays that enter homogeneous media that scatter. The flights along them are sampled, and have not
/// gone on in these media yet.
pub struct Entries<'a> {
    /// The indices of the rays.
    pub index: [usize; LANES],
    /// A mask of the lanes that count.
    pub lanes: u32,
    /// The media. A lane that does not count may have another medium, or none.
    pub media: [Option<MediumId>; LANES],
    /// Their coefficients.
    pub coefficients: &'a CoefficientsX16,
    /// The rays.
    pub rays: &'a RayX16,
    /// Their unit directions.
    pub directions: Vec3x16,
    /// The distances up to where the rays leave the media.
    pub lengths: f32x16,
    /// The flights.
    pub flight: &'a FlightX16,
    /// The surface at which the ray of a lane leaves its medium, if there is one.
    pub ahead: &'a dyn Fn(usize) -> Option<SurfaceInteraction>,
}

/// What is called when rays enter homogeneous media that scatter.
pub type Enter<'a> = dyn FnMut(&Entries<'_>) + 'a;

/// A ray on its way through media, from one boundary to the next.
#[derive(Clone, Copy, Debug)]
struct Journey {
    /// The rest of the ray.
    leg: Ray,
    /// The ray parameter of its start.
    before: f32,
    departure: Departure,
    /// The throughput by channel.
    beta: [f32; 3],
    /// The free flight: see [`FlightX16`].
    choice: [f32; 3],
    channel: f32,
    left: f32,
}

/// Rays on their way through media.
#[derive(Default)]
pub struct Journeys {
    list: Vec<Journey>,
    /// The events in media that ended them.
    collisions: Vec<Option<Collision>>,
}

impl Journeys {
    /// Removes all.
    pub fn clear(&mut self) {
        self.list.clear();
        self.collisions.clear();
    }

    /// Adds a ray with a throughput. Only the transmittance counts, unless its flight is [sampled](Self::sample).
    pub fn push(&mut self, leg: Ray, departure: Departure, beta: Rgb) {
        let beta = beta.to_array();
        let (choice, channel, left) = ([1.0, 0.0, 0.0], 0.0, f32::INFINITY);
        self.list.push(Journey { leg, before: 0.0, departure, beta, choice, channel, left });
        self.collisions.push(None);
    }

    /// Samples the flights of all rays, whose throughputs are not black. The first numbers choose the channels, the
    /// others the optical depths.
    pub fn sample(&mut self, numbers: &[Vec<f32>; 2]) {
        for (block, journeys) in self.list.chunks_mut(LANES).enumerate() {
            let of = each_lane(|k| journeys[k.min(journeys.len() - 1)]);
            let u = [0, 1].map(|k| load(&numbers[k], block * LANES));
            let beta = std::array::from_fn(|c| f32x16::new(of.map(|journey| journey.beta[c])));
            let mut at = Vec3x16::default();
            (0..LANES).for_each(|k| at.set_lane(k, of[k].leg.o));
            let FlightX16 { choice, channel, left, .. } = FlightX16::sampled(beta, u, at);
            for (k, journey) in journeys.iter_mut().enumerate() {
                journey.choice = std::array::from_fn(|c| choice[c].as_array()[k]);
                (journey.channel, journey.left) = (channel.as_array()[k], left.as_array()[k]);
            }
        }
    }

    /// Returns the throughput of ray `i`.
    pub fn beta(&self, i: usize) -> Rgb {
        self.list[i].beta.into()
    }

    /// Returns the medium in which ray `i` is.
    pub fn medium(&self, i: usize) -> Option<MediumId> {
        self.list[i].departure.medium
    }

    /// Returns the event in a medium at which the journey of ray `i` ended.
    pub fn collision(&self, i: usize) -> Option<&Collision> {
        self.collisions[i].as_ref()
    }

    /// Passes the surface `at` at the end of ray `i`, with the same flight. Returns the ray behind it.
    pub fn pass(&mut self, i: usize, scene: &Scene, media: &SceneMedia, at: &SurfaceInteraction) -> Ray {
        let Journey { leg, before, departure, .. } = &mut self.list[i];
        departure.medium = media.beside(at, leg.d, departure.medium);
        *before += leg.t_max;
        *leg = scene.spawn_ray(at, leg.d, leg.time);
        *leg
    }

    /// Returns the length of the journey of ray `i` up to its end, in the unit of ray parameters.
    pub fn length(&self, i: usize) -> f32 {
        self.list[i].before + self.list[i].leg.t_max
    }

    /// Ends ray `i` at a ray parameter.
    pub fn end_at(&mut self, i: usize, t_max: f32) {
        self.list[i].leg.t_max = t_max;
    }

    /// Follows the rays in the list `active` up to the surfaces that `end` returns, or their greatest parameter,
    /// through boundaries of media that do not scatter them. Those whose flight ends before have a
    /// [`collision`](Self::collision). `first` are the first boundaries that the rays may pass, if they are known.
    pub fn follow(
        &mut self,
        scene: &Scene,
        media: &SceneMedia,
        mut active: Vec<usize>,
        mut first: Option<&[Option<Hit>]>,
        end: impl Fn(usize) -> Option<SurfaceInteraction>,
        mut enter: Option<&mut Enter<'_>>,
    ) {
        let mut hits = Vec::new();
        while !active.is_empty() {
            if media.has_passed() {
                match first.take() {
                    Some(known) => hits.extend_from_slice(known),
                    None => {
                        let legs: Vec<Ray> = active.iter().map(|&i| self.list[i].leg).collect();
                        hits = media.passed(&legs);
                    }
                }
            }
            let mut count = 0;
            for block in (0..active.len()).step_by(LANES) {
                let lanes = (active.len() - block).min(LANES);
                let index = each_lane(|k| active[block + k.min(lanes - 1)]);
                let rays = RayX16::load(&index.map(|i| self.list[i].leg), 0);
                let hits = hits.get(block..block + lanes).unwrap_or(&[]);
                let boundaries = Boundaries::new(scene, &rays, hits, |k| end(index[k]));
                let end = |k: usize| end(index[k]);
                let passing = self.advance(
                    (scene, media),
                    (index, lanes),
                    &rays,
                    &boundaries,
                    end,
                    enter.as_deref_mut(),
                );
                for k in bits(passing) {
                    active[count] = index[k];
                    count += 1;
                }
            }
            active.truncate(count);
            hits.clear();
        }
    }

    /// Lets at most sixteen rays go on to the next boundary. Returns a mask of those that pass it.
    fn advance(
        &mut self,
        (scene, media): (&Scene, &SceneMedia),
        (index, lanes): ([usize; LANES], usize),
        rays: &RayX16,
        boundaries: &Boundaries,
        end: impl Fn(usize) -> Option<SurfaceInteraction>,
        mut enter: Option<&mut Enter<'_>>,
    ) -> u32 {
        let active = (1 << lanes) - 1;
        let speed = rays.d.length_squared().sqrt();
        let length = boundaries.t.fast_min(rays.t_max).fast_max(f32x16::ZERO);
        let ids = index.map(|i| self.list[i].departure.medium);
        let in_medium = ids.map(|id| media.get(id));
        let homogeneous = in_medium.map(|medium| match medium {
            Some(Medium::Homogeneous(medium)) => Some(medium),
            _ => None,
        });
        let ahead = |k: usize| boundaries.at(k).or_else(|| end(k));
        let mut scattered = 0;
        if homogeneous.iter().any(Option::is_some) {
            let coefficients = CoefficientsX16::of(&homogeneous);
            let of = index.map(|i| &self.list[i]);
            let mut flight = FlightX16 {
                beta: std::array::from_fn(|c| f32x16::new(of.map(|journey| journey.beta[c]))),
                choice: std::array::from_fn(|c| f32x16::new(of.map(|journey| journey.choice[c]))),
                channel: f32x16::new(of.map(|journey| journey.channel)),
                left: f32x16::new(of.map(|journey| journey.left)),
            };
            if let Some(enter) = &mut enter {
                let sampled = flight.left.simd_lt(f32x16::splat(f32::INFINITY));
                let lanes = (sampled & coefficients.scatter()).to_bitmask() & active;
                if lanes != 0 {
                    enter(&Entries {
                        index,
                        lanes,
                        media: ids,
                        coefficients: &coefficients,
                        rays,
                        directions: rays.d / speed,
                        lengths: length * speed,
                        flight: &flight,
                        ahead: &ahead,
                    });
                }
            }
            let (ended, distance) = flight.advance(&coefficients, length * speed);
            scattered = ended.to_bitmask() & active;
            for (k, i) in index.into_iter().enumerate().take(lanes) {
                let journey = &mut self.list[i];
                journey.beta = std::array::from_fn(|c| flight.beta[c].as_array()[k]);
                journey.choice = std::array::from_fn(|c| flight.choice[c].as_array()[k]);
                journey.left = flight.left.as_array()[k];
            }
            let t = distance / speed;
            let mut p = rays.o + rays.d * t;
            let close = ((length - t) * speed).simd_le(rounding_x16(rays.o, length * speed));
            for k in bits(close.to_bitmask() & scattered) {
                p.set_lane(k, before_end(p.lane(k), ahead(k).as_ref(), rays.d.lane(k)));
            }
            for k in bits(scattered) {
                let (t, distance) = (self.list[index[k]].before + t.as_array()[k], distance.as_array()[k]);
                self.collisions[index[k]] =
                    ids[k].map(|medium| Collision { medium, p: p.lane(k), t, distance });
            }
        }
        for k in 0..lanes {
            if let Some(Medium::Heterogeneous(medium)) = in_medium[k] {
                let (speed, length) = (speed.as_array()[k], length.as_array()[k]);
                let direction = (rays.d.lane(k).as_dvec3() / f64::from(speed)).as_vec3();
                let length = f64::from(length) * f64::from(speed);
                let segment = Segment { origin: rays.o.lane(k), direction, length };
                scattered |= u32::from(self.track(index[k], medium, &segment, || ahead(k))) << k;
            }
        }
        let passing = boundaries.lanes & active & !scattered;
        match &boundaries.at {
            Some(at) if passing != 0 => self.pass_boundaries((scene, media), &index, rays, at, passing),
            _ => 0,
        }
    }

    /// Continues ray `i` through a heterogeneous medium. Returns whether its flight ends there.
    fn track(
        &mut self,
        i: usize,
        medium: &Heterogeneous,
        segment: &Segment,
        ahead: impl Fn() -> Option<SurfaceInteraction>,
    ) -> bool {
        let Journey { leg: Ray { o, d, .. }, before, departure, beta, left, .. } = &mut self.list[i];
        let (distance, factor) =
            medium.track(segment, (*beta).into(), left.is_finite(), &mut departure.random);
        for (channel, factor) in beta.iter_mut().zip(factor.to_array()) {
            *channel *= factor;
        }
        let (Some(distance), Some(id)) = (distance, departure.medium) else { return false };
        let (o, d) = (*o, *d);
        let t = (distance / f64::from(d.length())) as f32;
        let p = o + d * t;
        let is_close = (segment.length - distance) as f32 <= rounding(o, segment.length as f32);
        let p = if is_close { before_end(p, ahead().as_ref(), d) } else { p };
        self.collisions[i] = Some(Collision { medium: id, p, t: *before + t, distance: distance as f32 });
        true
    }

    /// Passes boundaries, for the lanes of the mask `passing`. Returns a mask of those that go on.
    fn pass_boundaries(
        &mut self,
        (scene, media): (&Scene, &SceneMedia),
        index: &[usize; LANES],
        rays: &RayX16,
        at: &SurfaceInteractionX16,
        passing: u32,
    ) -> u32 {
        let next = scene.spawn_rays(at, rays.d, rays.time);
        // Where the numbers have no step that is small enough, a ray cannot pass the boundary.
        let moves = next.o.x.simd_ne(rays.o.x) | next.o.y.simd_ne(rays.o.y) | next.o.z.simd_ne(rays.o.z);
        let passing = passing & moves.to_bitmask();
        let to_front = rays.d.dot(at.ng).simd_gt(f32x16::ZERO).to_bitmask();
        for k in bits(passing) {
            let (Journey { leg, before, departure, .. }, t) = (&mut self.list[index[k]], at.hit[k].t);
            departure.medium = media.on_side(at.shape(k), to_front >> k & 1 == 1, departure.medium);
            *before += t;
            *leg = Ray { o: next.o.lane(k), t_max: leg.t_max - t, ..*leg };
        }
        passing
    }
}

/// The boundaries on at most sixteen rays.
struct Boundaries {
    at: Option<SurfaceInteractionX16>,
    /// A mask of the rays with a boundary.
    lanes: u32,
    /// Their ray parameters; infinite without one.
    t: f32x16,
}

impl Boundaries {
    /// Returns the boundaries `hits` that rays meet before the surfaces at their ends, which `end` returns.
    fn new(
        scene: &Scene,
        rays: &RayX16,
        hits: &[Option<Hit>],
        end: impl Fn(usize) -> Option<SurfaceInteraction>,
    ) -> Self {
        let mut lanes =
            hits.iter().enumerate().fold(0, |lanes, (k, hit)| lanes | u32::from(hit.is_some()) << k);
        let mut t = f32x16::splat(f32::INFINITY);
        let at = hits.iter().flatten().next().map(|some| {
            let hits = each_lane(|k| hits.get(k).copied().flatten().unwrap_or(*some));
            let at = scene.interactions(rays, &hits);
            let t_hit = f32x16::new(hits.map(|hit| hit.t));
            let speed = rays.d.length_squared().sqrt();
            let before = (rays.t_max - t_hit) * rays.d.dot(at.ng).abs();
            let close = before.simd_le(rounding_x16(rays.o, rays.t_max * speed)).to_bitmask();
            for k in bits(close & lanes) {
                if end(k).is_some_and(|end| is_reached_first(&end, &at.lane(k), rays.d.lane(k))) {
                    lanes &= !(1 << k);
                }
            }
            t = mask_from_bits(lanes).select(t_hit, t);
            at
        });
        Boundaries { at, lanes, t }
    }

    fn at(&self, lane: usize) -> Option<SurfaceInteraction> {
        self.at.as_ref().filter(|_| self.lanes >> lane & 1 == 1).map(|at| at.lane(lane))
    }
}

/// Returns a stream of random numbers for the event of a path after `bounce` others. `purpose` is 0, 1 or 2.
pub fn stream(key: SampleKey, bounce: u32, purpose: u32) -> Stream {
    Stream::new([combine(key.scramble, 3 * bounce + purpose), key.index])
}

/// Returns the medium in which light starts in the direction `wi` at a surface that the ray `d` hits in `medium`.
pub fn medium_after(
    scene: &Scene,
    media: &SceneMedia,
    Facet { shape, material, ng }: Facet,
    (d, wi): (Vec3, Vec3),
    medium: Option<MediumId>,
) -> Option<MediumId> {
    let crosses = (ng.dot(d) < 0.0) == (ng.dot(wi) < 0.0);
    // Nothing is transmitted by a two-sided material. Its normals are turned to the ray.
    let crosses = crosses && !scene.materials.get(material).two_sided;
    if crosses { media.on_side(shape, wi.dot(ng) > 0.0, medium) } else { medium }
}

/// Returns the ray from a point in a medium to that of an emitter sample.
pub fn ray_to_emitter(p: Vec3, sample: &EmitterSample, time: f32) -> Ray {
    match sample.target {
        ShadowTarget::Point(target) => Ray { o: p, d: target - p, t_max: 1.0, time },
        ShadowTarget::Infinity => Ray { time, ..Ray::new(p, sample.wi) },
    }
}

/// Computes [`ray_to_emitter`] for sixteen points.
pub fn rays_to_emitters(p: Vec3x16, sample: &EmitterSampleX16, time: f32x16) -> RayX16 {
    let t_max = sample.at_infinity.select(f32x16::splat(f32::INFINITY), f32x16::ONE);
    RayX16 { o: p, t_max, d: Vec3x16::select(sample.at_infinity, sample.wi, sample.target - p), time }
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

/// Returns a distance much longer than that by which rounding moves a point of a ray that starts at `o` and has the
/// length `length`, unless a surface is a thousand times as large.
fn rounding(o: Vec3, length: f32) -> f32 {
    ROUNDING * (o.abs().max_element() + length)
}

/// Computes [`rounding`] for sixteen rays.
pub fn rounding_x16(o: Vec3x16, length: f32x16) -> f32x16 {
    let o = o.abs();
    f32x16::splat(ROUNDING) * (o.x.fast_max(o.y).fast_max(o.z) + length)
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
