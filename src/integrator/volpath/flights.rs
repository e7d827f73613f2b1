//! Flights of a wave of paths through media that rays may enter without being scattered.
//!
//! A wave of rays goes from boundary to boundary together ([`follow`]). The paths that media scatter wait for the
//! others, which are shaded at the surfaces that they meet.

use super::equiangular::LegPoint;
use super::event::{First, Tracer};
use super::{Path, WaveNumbers};
use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::integrator::flight::{Collision, Entry, Journey, follow, stream};
use crate::integrator::path::between::{Between, Sides};
use crate::integrator::worker::{InMedia, PathWave, intersect};
use crate::integrator::{Radiance, Worker};
use crate::math::Ray;
use crate::medium::FreeFlight;

/// The flights of a wave.
pub struct Flights<'a> {
    tracer: Tracer<'a>,
    numbers: WaveNumbers,
    /// The points of this event and of the last one on their rays.
    leg_points: [Vec<LegPoint>; 2],
    /// The paths that media have scattered.
    scattered: Vec<Path>,
}

impl<'a> Flights<'a> {
    /// Begins with paths that have not left the camera.
    pub fn new(tracer: Tracer<'a>) -> Self {
        let numbers = WaveNumbers::new(tracer.has_near);
        Flights { tracer, numbers, leg_points: Default::default(), scattered: Vec::new() }
    }

    /// Returns the path with an index in the wave.
    fn path(depth: u32, i: usize, paths: &PathWave) -> Path {
        let InMedia { medium, on_leg, emitter_share, .. } = paths.in_media[i];
        Path {
            key: paths.keys[i],
            slot: paths.slots[i] as usize,
            ray: paths.rays[i],
            medium,
            from: paths.from[i],
            pdf: paths.pdf[i],
            emitter_share,
            beta: paths.beta(i),
            eta: paths.eta[i],
            depth,
            on_leg,
        }
    }
}

impl<'a> Between<'a> for Flights<'a> {
    fn sides(&self) -> Sides<'a> {
        Sides { scene: self.tracer.scene, media: self.tracer.media }
    }

    fn passes_hidden(&self) -> bool {
        true
    }

    fn advance(&mut self, depth: u32, worker: &mut Worker, out: &mut [Radiance]) {
        let Tracer { scene, media, limits, .. } = self.tracer;
        let Worker { paths, hits, counters, sampler, shadows, .. } = worker;
        if depth == 0 {
            paths.in_media.resize(paths.rays.len(), InMedia::in_medium(media.sensor));
        }
        let emits =
            |hit: &Option<Hit>| hit.is_some_and(|hit| scene.shapes[hit.geometry as usize].emitter.is_some());
        let hides = depth == 0 && limits.hide_emitters && scene.needs.hit_emitters;
        let to_surface = |(ray, hit): (&Ray, &Option<Hit>)| match hit {
            Some(hit) => Ray { t_max: hit.t, ..*ray },
            None => *ray,
        };
        let rays: Vec<Ray> = paths.rays.iter().zip(&*hits).map(to_surface).collect();
        let boundaries = media.passed(&rays);
        let meets = |i: &usize| hides || paths.in_media[*i].medium.is_some() || boundaries[*i].is_some();
        let travellers: Vec<usize> = (0..rays.len()).filter(meets).collect();
        let boundaries: Vec<Option<Hit>> = travellers.iter().map(|&i| boundaries[i]).collect();
        let before: Vec<Path> = travellers.iter().map(|&i| Flights::path(depth, i, paths)).collect();
        self.numbers.draw(depth, &before, *sampler);
        let numbers = |k: usize| self.numbers.of(k, depth);
        let start = |(k, (path, &i)): (usize, (&Path, &usize))| {
            Journey::new(
                rays[i],
                path.medium,
                self.tracer.flight(path, self.numbers.free_flight(k), stream(path.key, depth, 0)),
            )
        };
        let mut journeys: Vec<Journey> = before.iter().zip(&travellers).enumerate().map(start).collect();
        let mut firsts = vec![First::Ahead; travellers.len()];
        let mut samples = Vec::with_capacity(travellers.len());
        let [leg_points, last_leg_points] = &mut self.leg_points;
        std::mem::swap(leg_points, last_leg_points);
        leg_points.clear();
        let end = |k: usize, paths: &PathWave, hits: &[Option<Hit>]| {
            let i = travellers[k];
            hits[i].map(|hit| scene.interaction(&paths.rays[i], &hit))
        };
        let mut enter = |k: usize, entry: &Entry<'a, '_>, flight: &FreeFlight| {
            let found = (&mut samples, &mut *leg_points);
            firsts[k].enter(&self.tracer, &before[k], (entry, flight), || numbers(k), found);
        };
        let at_end = |k| end(k, paths, hits);
        let mut collisions: Vec<Option<Collision<'a>>> =
            follow(scene, media, &mut journeys, Some(&boundaries), at_end, &mut enter);
        // Camera rays pass hidden emitters.
        let mut active: Vec<usize> = if hides { (0..travellers.len()).collect() } else { Vec::new() };
        loop {
            active.retain(|&k| collisions[k].is_none() && emits(&hits[travellers[k]]));
            if active.is_empty() {
                break;
            }
            let mut behind = Vec::with_capacity(active.len());
            for &k in &active {
                let at = end(k, paths, hits).expect("a hidden emitter was hit");
                let ray = &mut paths.rays[travellers[k]];
                *ray = journeys[k].pass(scene, media, &at);
                behind.push(*ray);
            }
            let mut found = Vec::new();
            intersect(scene, &behind, Coherence::Incoherent, &mut found, counters);
            for (&k, hit) in active.iter().zip(found) {
                hits[travellers[k]] = hit;
                journeys[k].end_at(hit.map_or(f32::INFINITY, |hit| hit.t));
            }
            let mut legs: Vec<Journey> = active.iter().map(|&k| journeys[k]).collect();
            let (at_end, enter) = (
                |j: usize| end(active[j], paths, hits),
                |j: usize, entry: &Entry<'a, '_>, flight: &FreeFlight| enter(active[j], entry, flight),
            );
            let found = follow(scene, media, &mut legs, None, at_end, enter);
            for ((&k, leg), collision) in active.iter().zip(legs).zip(found) {
                (journeys[k], collisions[k]) = (leg, collision);
            }
        }
        for (k, (collision, &i)) in collisions.into_iter().zip(&travellers).enumerate() {
            let Journey { medium, flight, .. } = &journeys[k];
            let weight = match &collision {
                Some(collision) => flight.scattered(collision.medium),
                None => flight.passed(),
            };
            let path = Path { medium: *medium, beta: before[k].beta * weight, ..before[k] };
            paths.set_beta(i, path.beta);
            paths.in_media[i].medium = *medium;
            if depth == 0 {
                let to_surface = || hits[i].map_or(f32::INFINITY, |_| journeys[k].length());
                out[path.slot].distance = collision.as_ref().map_or_else(to_surface, |collision| collision.t);
            }
            match collision {
                // The wave knows the weight of what the ray finds.
                None if path.on_leg.is_none() && path.emitter_share == 1.0 => {}
                None => {
                    let at = |hit: &Hit| scene.interaction(&paths.rays[i], hit);
                    if hits[i].is_none() || emits(&hits[i]) {
                        let found =
                            self.tracer.found(&path, hits[i].as_ref().map(at).as_ref(), last_leg_points);
                        out[path.slot].value += path.beta * found;
                    }
                    // What the ray finds is weighted by 0 from now on.
                    paths.pdf[i] = 0.0;
                }
                Some(collision) => {
                    if !path.beta.is_black() {
                        let on_leg = firsts[k].end(collision.distance, leg_points);
                        let point = on_leg.map(|index| &leg_points[index as usize]);
                        let (path, numbers) = (Path { on_leg, ..path }, numbers(k));
                        let next =
                            self.tracer.scatter_in_medium(path, &collision, point, &numbers, &mut samples);
                        self.scattered.extend(next);
                    }
                    paths.set_beta(i, Rgb::BLACK);
                    hits[i] = None;
                }
            }
        }
        self.tracer.sample_emitters(&samples, shadows);
    }

    fn rejoin(&mut self, paths: &mut PathWave) {
        for Path { key, slot, ray, medium, pdf, emitter_share, beta, eta, on_leg, .. } in
            self.scattered.drain(..)
        {
            paths.push_scattered(key, slot as u32, ray, pdf, beta, eta);
            paths.in_media.push(InMedia { medium, events: 0, on_leg, emitter_share });
        }
    }
}
