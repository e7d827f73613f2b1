//! The vertices of camera paths in participating media.
//!
//! Free flights have the same density in both directions, but for the ends of an edge. The weights leave the
//! transmittance out. So they are not those of the power heuristic, but their sum is still 1: all techniques of a path
//! compute the same.

use super::camera_paths::{CameraPaths, Subpath};
use super::connections::{CameraEnd, of_connection};
use super::light_paths::{StoredVertex, typical_start_density};
use super::vertex::{IN_MEDIUM, MediumPoint, Vertex};
use super::weights::{self, End, Merged, Partial, Start};
use crate::accel::Hit;
use crate::color::Rgb;
use crate::emitter::ShadowTarget;
use crate::integrator::Radiance;
use crate::integrator::flight::{Collision, Departure, Journeys, ray_to_emitter, stream, surfaces};
use crate::integrator::roulette::Roulette;
use crate::integrator::shadows::ShadowQueue;
use crate::integrator::worker::{Worker, draw_1d, draw_2d};
use crate::math::{Ray, Vec2, Vec3};
use crate::sampling::{Dimension, SampleKey};

/// The vertex of a camera path in a medium.
pub(super) struct ScatteredPath<'a> {
    path: Subpath,
    point: MediumPoint<'a>,
    partial: Partial,
}

impl<'a> CameraPaths<'a> {
    /// Lets paths fly through media up to the surfaces that they hit. Those that a medium scatters have no hit and are
    /// black afterwards: returns their vertices. `rays` are the whole rays; those of the paths begin behind hidden
    /// emitters.
    pub fn fly(
        &self,
        depth: u32,
        rays: &[Ray],
        subpaths: &mut [Subpath],
        hits: &mut [Option<Hit>],
        worker: &Worker,
        out: &mut [Radiance],
    ) -> Vec<ScatteredPath<'a>> {
        let Some(media) = self.media else { return Vec::new() };
        let keys: Vec<SampleKey> = subpaths.iter().map(|path| path.key).collect();
        let last: Vec<Ray> = subpaths.iter().map(|path| path.ray).collect();
        let surfaces = surfaces(self.scene, &last, hits);
        let mut journeys = Journeys::default();
        for (i, path) in subpaths.iter().enumerate() {
            // The distance of a surface is that on the whole ray.
            let t_max = match &surfaces[i] {
                Some(_) if depth == 0 => out[path.slot as usize].distance,
                Some(at) => at.hit.t,
                None => rays[i].t_max,
            };
            let departure = Departure { medium: path.medium, random: stream(path.key, depth, 0) };
            journeys.push(Ray { t_max, ..rays[i] }, departure, path.beta);
        }
        // Where paths end, scattering in media is loss.
        if self.goes_on(depth) {
            let mut flights = Default::default();
            draw_2d(worker.sampler, Dimension::free_flight(depth), &keys, &mut flights);
            journeys.sample(&flights);
        }
        journeys.follow(self.scene, media, (0..rays.len()).collect(), None, |i| surfaces[i], None);
        let mut scattered = Vec::new();
        for (i, path) in subpaths.iter_mut().enumerate() {
            (path.medium, path.beta) = (journeys.medium(i), journeys.beta(i));
            if let Some(&Collision { p, t, medium, .. }) = journeys.collision(i) {
                if depth == 0 {
                    out[path.slot as usize].distance = t;
                }
                if !path.beta.is_black() {
                    let point =
                        MediumPoint { p, d: path.ray.d, time: path.ray.time, phase: media.phase(medium) };
                    let partial = self.arrive_at(path, p, t.into(), 1.0, Merged::default());
                    scattered.push(ScatteredPath { path: *path, point, partial });
                }
                path.beta = Rgb::BLACK;
            }
            if path.beta.is_black() {
                hits[i] = None;
            }
        }
        scattered
    }

    /// Samples an emitter at each vertex in a medium, and connects it to vertices of its light paths: queues shadow
    /// rays with the weighted contributions. Adds the continuations of the paths to `next`.
    pub fn scatter_in_media(
        &self,
        depth: u32,
        scattered: &[ScatteredPath<'_>],
        worker: &mut Worker,
        next: &mut Vec<Subpath>,
    ) {
        if scattered.is_empty() {
            return;
        }
        let keys: Vec<SampleKey> = scattered.iter().map(|vertex| vertex.path.key).collect();
        let Worker { numbers, sampler, shadows, .. } = worker;
        let mut connection = Vec::new();
        draw_2d(*sampler, Dimension::emitter_point(depth), &keys, &mut numbers.emitter_point);
        draw_1d(*sampler, Dimension::connection(depth), &keys, &mut connection);
        draw_2d(*sampler, Dimension::bsdf_direction(depth), &keys, &mut numbers.bsdf_direction);
        draw_1d(*sampler, Dimension::roulette(depth), &keys, &mut numbers.roulette);
        let roulette = Roulette::at(depth + 1, self.limits.rr_depth);
        let pair = |numbers: &[Vec<f32>; 2], i: usize| Vec2::new(numbers[0][i], numbers[1][i]);
        for (i, vertex) in scattered.iter().enumerate() {
            let ScatteredPath { path, point, partial } = vertex;
            if self.query.wants(depth + 2) {
                self.sample_emitter(vertex, depth, pair(&numbers.emitter_point, i), shadows);
            }
            let vertex = Vertex::Medium(*point);
            let ratio = partial.ratios(vertex.usual_density()) as f32;
            for k in 0..self.connections(path) {
                let end = CameraEnd { path, depth, p: point.p, ratio };
                if let Some(chosen) = self.choose(&end, |_| IN_MEDIUM, (k, connection[i])) {
                    self.connect_one(path, &vertex, (*partial, depth), chosen, k, shadows);
                }
            }
            let mut beta = path.beta;
            if let Some(roulette) = roulette {
                let Some(on) = roulette.play(beta, path.eta * path.eta, numbers.roulette[i]) else {
                    continue;
                };
                beta = on;
            }
            let wi = point.phase.sample(point.d, pair(&numbers.bsdf_direction, i));
            let density = point.density(wi).into();
            let partial = Some(partial.scattered(density, density, 1.0));
            let ray = Ray { time: point.time, ..Ray::new(point.p, wi) };
            next.push(Subpath { ray, from: point.p, beta, partial, finite: true, ..*path });
        }
    }

    /// Samples an emitter at a vertex in a medium. Queues a shadow ray with the weighted contribution.
    fn sample_emitter(&self, vertex: &ScatteredPath<'_>, depth: u32, u: Vec2, shadows: &mut ShadowQueue) {
        let (scene, ScatteredPath { path, point, partial }) = (self.scene, vertex);
        let selection = &scene.light_selection;
        let Some(choice) = selection.sample(point.p, u.x) else { return };
        let u = Vec2::new(choice.u, u.y);
        let Some(sample) = scene.sample_chosen(selection, choice.emitter, point.p, u, point.time) else {
            return;
        };
        let density = point.density(sample.wi);
        // A direction without density carries nothing.
        if sample.pdf <= 0.0 || density == 0.0 {
            return;
        }
        let started = typical_start_density(scene, self.guide, choice.emitter);
        let light = &scene.lights[choice.emitter];
        let start = Start::new(light, -sample.wi, sample.cosine, choice.pmf, started);
        let distance2 = match sample.target {
            ShadowTarget::Point(target) => f64::from((target - point.p).length_squared()),
            ShadowTarget::Infinity => 1.0,
        };
        let weight = partial.of_emitter_sample(start, distance2, 1.0, density.into(), density.into());
        let weight = self.techniques.weight(1, depth + 2, weight) as f32;
        let value = path.beta * sample.radiance * (density * weight / (sample.pdf * choice.pmf));
        if !value.is_black() {
            let ray = ray_to_emitter(point.p, &sample, point.time);
            let departure = Departure { medium: path.medium, random: stream(path.key, depth, 1) };
            shadows.push_through_media(ray, path.slot, value, departure);
        }
    }

    /// Connects a vertex of a camera path to a vertex of its light path `k`, of which one at least is in a medium. The
    /// latter comes with the factor of its choice. Queues a shadow ray with the weighted contribution.
    pub fn connect_one(
        &self,
        path: &Subpath,
        vertex: &Vertex<'_>,
        (partial, depth): (Partial, u32),
        (light, factor): (&StoredVertex<'_>, f32),
        k: u32,
        shadows: &mut ShadowQueue,
    ) {
        let Some(media) = self.media else { return };
        let way = light.vertex.p() - vertex.p();
        let distance2 = way.length_squared();
        let wi: Vec3 = way / distance2.sqrt();
        let (incident, emerging) = (vertex.incident(wi), light.vertex.emerging(-wi));
        let value = path.beta * incident.value * emerging.value * light.power;
        if value.is_black() {
            return;
        }
        let per_area = |pdf: f32, cosine: f32| f64::from(pdf) * f64::from(cosine) / f64::from(distance2);
        let weight = weights::of_connection(
            &End {
                partial,
                to_other: per_area(incident.forward, light.vertex.cosine(wi)),
                reverse: incident.reverse.into(),
            },
            &End {
                partial: light.partial,
                to_other: per_area(emerging.forward, vertex.cosine(wi)),
                reverse: emerging.reverse.into(),
            },
        );
        let weight = self.techniques.weight(light.edges + 1, depth + 2, weight) as f32;
        let value = value * (weight * factor / distance2);
        if !value.is_black() {
            let ray = vertex.ray_to(self.scene, light.vertex.target(way), wi);
            let medium = vertex.medium_towards(self.scene, media, wi, path.medium);
            let random = stream(of_connection(path.key, k), depth, 2);
            shadows.push_through_media(ray, path.slot, value, Departure { medium, random });
        }
    }
}
