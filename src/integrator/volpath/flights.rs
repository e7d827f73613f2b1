//! Flights of a wave of paths through media that rays may enter without being scattered.
//!
//! A wave of rays goes from boundary to boundary together ([`Journeys`]). The paths that media scatter wait for the
//! others, which are shaded at the surfaces that they meet.

use super::Path;
use super::equiangular::LegPoint;
use super::near_emitters::{First, NearNumbers};
use super::scattering::{EventNumbers, Scattered};
use super::tracer::Tracer;
use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::integrator::flight::{Departure, Entries, Journeys, stream};
use crate::integrator::path::between::{Between, Sides};
use crate::integrator::path_wave::{InMedia, PathWave};
use crate::integrator::worker::{draw_1d, draw_2d, intersect};
use crate::integrator::{Radiance, Worker};
use crate::math::Ray;
use crate::medium::Medium;
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;

/// The flights of a wave.
pub struct Flights<'a> {
    tracer: Tracer<'a>,
    buffers: Buffers,
}

/// The state of the paths that meet media.
#[derive(Default)]
pub struct Buffers {
    /// The indices of the paths in the wave.
    travellers: Vec<usize>,
    /// Their keys, and their entries of the output.
    keys: Vec<SampleKey>,
    slots: Vec<u32>,
    /// Their rays.
    journeys: Journeys,
    /// The first boundaries that the rays pass, if there are any in the scene.
    boundaries: Vec<Option<Hit>>,
    /// Where points near emitters are sampled on them.
    firsts: Vec<First>,
    /// The points of this event and of the last one on their rays.
    leg_points: [Vec<LegPoint>; 2],
    /// The random numbers of distances, of points near emitters, and of events.
    free_flight: [Vec<f32>; 2],
    near_numbers: NearNumbers,
    event_numbers: EventNumbers,
    /// The paths that media have scattered.
    scattered: Vec<Scattered>,
}

impl<'a> Flights<'a> {
    /// Begins with paths that have not left the camera. The contents of the buffers do not matter.
    pub fn new(tracer: Tracer<'a>, buffers: Buffers) -> Self {
        Flights { tracer, buffers }
    }

    /// Ends the flights.
    pub fn into_buffers(self) -> Buffers {
        self.buffers
    }

    /// Returns the path with an index in the wave.
    fn path(depth: u32, i: usize, paths: &PathWave) -> Path {
        let InMedia { on_leg, emitter_share, .. } = paths.in_media[i];
        Path { ray: paths.rays[i], from: paths.from[i], pdf: paths.pdf[i], emitter_share, depth, on_leg }
    }

    /// Returns whether rays pass emitters as if they were not there.
    fn hides_emitters(&self, depth: u32) -> bool {
        depth == 0 && self.tracer.limits.hide_emitters && self.tracer.scene.needs.hit_emitters
    }

    /// Finds the paths that meet media, and samples their flights.
    fn depart(&mut self, depth: u32, worker: &Worker) {
        let media = self.tracer.media;
        let hides = self.hides_emitters(depth);
        let Worker { paths, hits, sampler, .. } = worker;
        let to_surface = |i: usize| match hits[i] {
            Some(hit) => Ray { t_max: hit.t, ..paths.rays[i] },
            None => paths.rays[i],
        };
        let passed = media.has_passed().then(|| {
            let rays: Vec<Ray> = (0..hits.len()).map(to_surface).collect();
            media.passed(&rays)
        });
        let meets = |i: &usize| {
            let is_passing = passed.as_ref().is_some_and(|passed| passed[*i].is_some());
            hides || is_passing || paths.in_media[*i].medium.is_some()
        };
        let Buffers { travellers, keys, slots, journeys, boundaries, free_flight, .. } = &mut self.buffers;
        travellers.clear();
        travellers.extend((0..hits.len()).filter(meets));
        boundaries.clear();
        if let Some(passed) = &passed {
            boundaries.extend(travellers.iter().map(|&i| passed[i]));
        }
        keys.clear();
        slots.clear();
        journeys.clear();
        for &i in &*travellers {
            keys.push(paths.keys[i]);
            slots.push(paths.slots[i]);
            let random = stream(paths.keys[i], depth, 0);
            let departure = Departure { medium: paths.in_media[i].medium, random };
            journeys.push(to_surface(i), departure, paths.beta(i));
        }
        // Where paths end, scattering in media is loss.
        if self.tracer.scatters(depth) {
            draw_2d(*sampler, Dimension::free_flight(depth), keys, free_flight);
            journeys.sample(free_flight);
        }
    }

    /// Follows the paths up to events in media, or up to surfaces. Hidden emitters do not end them.
    fn fly(&mut self, depth: u32, worker: &mut Worker) {
        let hides = self.hides_emitters(depth);
        let Tracer { scene, media, query, .. } = self.tracer;
        let Worker { paths, hits, counters, sampler, shadows, .. } = worker;
        let Buffers {
            travellers,
            keys,
            slots,
            journeys,
            boundaries,
            firsts,
            leg_points: [leg_points, last_leg_points],
            near_numbers,
            ..
        } = &mut self.buffers;
        let near = self.tracer.scatters(depth) && self.tracer.has_near && query.wants(depth + 2);
        if near {
            let NearNumbers { emitter_point, distance } = near_numbers;
            draw_2d(*sampler, Dimension::emitter_point(depth).repeat(1), keys, emitter_point);
            draw_1d(*sampler, Dimension::equiangular(depth), keys, distance);
        }
        firsts.clear();
        firsts.resize(travellers.len(), First::Ahead);
        std::mem::swap(leg_points, last_leg_points);
        leg_points.clear();
        let end = |k: usize, paths: &PathWave, hits: &[Option<Hit>]| {
            let i = travellers[k];
            hits[i].map(|hit| scene.interaction(&paths.rays[i], &hit))
        };
        let mut enter = |entries: &Entries<'_>| {
            let numbers = (&*near_numbers, &slots[..], &keys[..]);
            self.tracer.light_near_emitters(depth, entries, numbers, (firsts, leg_points), shadows);
        };
        let all = || (0..travellers.len()).collect::<Vec<usize>>();
        let at_end = |k| end(k, paths, hits);
        journeys.follow(scene, media, all(), Some(boundaries), at_end, near.then_some(&mut enter));
        // Camera rays pass hidden emitters.
        let mut active = if hides { all() } else { Vec::new() };
        loop {
            active.retain(|&k| journeys.collision(k).is_none() && is_emitter(scene, &hits[travellers[k]]));
            if active.is_empty() {
                break;
            }
            let mut behind = Vec::with_capacity(active.len());
            for &k in &active {
                let at = end(k, paths, hits).expect("a hidden emitter was hit");
                let ray = &mut paths.rays[travellers[k]];
                *ray = journeys.pass(k, scene, media, &at);
                behind.push(*ray);
            }
            let mut found = Vec::new();
            intersect(scene, &behind, Coherence::Incoherent, &mut found, counters);
            for (&k, hit) in active.iter().zip(found) {
                hits[travellers[k]] = hit;
                journeys.end_at(k, hit.map_or(f32::INFINITY, |hit| hit.t));
            }
            let at_end = |k| end(k, paths, hits);
            journeys.follow(scene, media, active.clone(), None, at_end, near.then_some(&mut enter));
        }
    }

    /// Gives the wave the throughputs and media of the paths. Those that media have scattered wait for the others.
    fn arrive(&mut self, depth: u32, worker: &mut Worker, out: &mut [Radiance]) {
        let Tracer { scene, media, .. } = self.tracer;
        let Worker { paths, hits, .. } = worker;
        let Buffers {
            travellers,
            keys,
            slots,
            journeys,
            firsts,
            leg_points: [leg_points, last_leg_points],
            scattered,
            ..
        } = &mut self.buffers;
        for (k, &i) in travellers.iter().enumerate() {
            let (beta, medium, collision) = (journeys.beta(k), journeys.medium(k), journeys.collision(k));
            paths.set_beta(i, beta);
            paths.in_media[i].medium = medium;
            let slot = slots[k];
            if depth == 0 {
                let to_surface = || hits[i].map_or(f32::INFINITY, |_| journeys.length(k));
                out[slot as usize].distance = collision.map_or_else(to_surface, |collision| collision.t);
            }
            let InMedia { on_leg, emitter_share, .. } = paths.in_media[i];
            match collision {
                // The wave knows the weight of what the ray finds.
                None if on_leg.is_none() && emitter_share == 1.0 => {}
                None => {
                    let at = |hit: &Hit| scene.interaction(&paths.rays[i], hit);
                    if hits[i].is_none() || is_emitter(scene, &hits[i]) {
                        let path = Flights::path(depth, i, paths);
                        let found =
                            self.tracer.found(&path, hits[i].as_ref().map(at).as_ref(), last_leg_points);
                        out[slot as usize].value += beta * found;
                    }
                    // What the ray finds is weighted by 0 from now on.
                    paths.pdf[i] = 0.0;
                }
                Some(collision) => {
                    if !beta.is_black() {
                        let Ray { d, time, .. } = paths.rays[i];
                        // In a grid, the density of points is not known.
                        let on_leg = match media.get(medium) {
                            Some(Medium::Homogeneous(_)) => firsts[k].end(collision.distance, leg_points),
                            _ => None,
                        };
                        scattered.push(Scattered {
                            key: keys[k],
                            slot,
                            p: collision.p,
                            d,
                            time,
                            medium: collision.medium,
                            beta,
                            eta: paths.eta[i],
                            on_leg,
                            pdf: 0.0,
                            emitter_share: 1.0,
                        });
                    }
                    paths.set_beta(i, Rgb::BLACK);
                    hits[i] = None;
                }
            }
        }
    }
}

/// Returns whether a hit is that of an emitter.
fn is_emitter(scene: &Scene, hit: &Option<Hit>) -> bool {
    hit.is_some_and(|hit| scene.shapes[hit.geometry as usize].emitter.is_some())
}

impl<'a> Between<'a> for Flights<'a> {
    fn sides(&self) -> Sides<'a> {
        Sides { scene: self.tracer.scene, media: self.tracer.media }
    }

    fn passes_hidden(&self) -> bool {
        true
    }

    fn advance(&mut self, depth: u32, worker: &mut Worker, out: &mut [Radiance]) {
        if depth == 0 {
            let start = InMedia::in_medium(self.tracer.media.sensor);
            worker.paths.in_media.resize(worker.paths.rays.len(), start);
        }
        self.depart(depth, worker);
        self.fly(depth, worker);
        self.arrive(depth, worker, out);
        let Buffers { scattered, leg_points: [leg_points, _], event_numbers, .. } = &mut self.buffers;
        let numbers = (worker.sampler, event_numbers);
        self.tracer.scatter_in_media(depth, scattered, leg_points, numbers, &mut worker.shadows);
    }

    fn rejoin(&mut self, paths: &mut PathWave) {
        paths.push_scattered(&self.buffers.scattered);
        self.buffers.scattered.clear();
    }
}
