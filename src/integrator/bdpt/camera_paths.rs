//! Camera subpaths, and all techniques that end at their vertices.

use super::light_paths::{LightPaths, StoredVertex, start_pmf};
use super::merging::Merging;
use super::technique::Techniques;
use super::weights::{self, End, Merged, Partial, Start};
use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::ids::EmitterId;
use crate::integrator::block::ShadingBlock;
use crate::integrator::emission::skip_emitters;
use crate::integrator::light_path::LightVertex;
use crate::integrator::photon::EmissionGuide;
use crate::integrator::roulette::Roulette;
use crate::integrator::settings::PathLimits;
use crate::integrator::worker::{RandomNumbers, Worker, draw_1d, draw_2d, intersect};
use crate::integrator::{Radiance, RadianceQuery, Wave};
use crate::math::lanes::{LANES, bits};
use crate::math::ray::{end_error, offset_origin};
use crate::math::{Ray, Vec2, Vec3};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;
use crate::sensor::Camera;

/// The camera paths of a wave, and the light paths to which they are connected.
pub struct CameraPaths<'a> {
    pub scene: &'a Scene,
    /// The camera to which light paths are connected.
    pub camera: &'a Camera,
    /// The density of the starts of light paths.
    pub guide: Option<&'a EmissionGuide>,
    pub limits: PathLimits,
    /// The techniques that contribute.
    pub techniques: Techniques,
    pub query: RadianceQuery,
    pub light: LightPaths<'a>,
    /// The light path of each camera path.
    pub light_path: Vec<u32>,
    /// The light paths with which camera paths are merged.
    pub merging: Option<&'a Merging>,
}

/// The state of a camera path between two vertices.
#[derive(Clone, Copy)]
struct Subpath {
    key: SampleKey,
    slot: u32,
    ray: Ray,
    /// The last vertex. The ray starts beside it.
    from: Vec3,
    /// The product of the weights so far.
    beta: Rgb,
    /// The product of the relative indices of refraction.
    eta: f32,
    /// The partial weight; `None` before the first vertex.
    partial: Option<Partial>,
}

/// A vertex of a camera path.
struct CameraVertex<'a> {
    /// The surface point. Its `wo` points to the viewer.
    vertex: LightVertex<'a>,
    beta: Rgb,
    partial: Partial,
}

/// The random numbers at a vertex.
struct VertexNumbers {
    emitter_point: Vec2,
    connection: f32,
    lobe: f32,
    direction: Vec2,
    roulette: f32,
}

impl CameraPaths<'_> {
    /// Traces all camera paths of a wave and adds what all techniques contribute, but for connections of light paths to
    /// the camera.
    pub fn trace(&self, wave: Wave<'_>, worker: &mut Worker, out: &mut [Radiance]) {
        let subpath = |(slot, (ray, key)): (usize, (&Ray, &SampleKey))| Subpath {
            key: *key,
            slot: slot as u32,
            ray: *ray,
            from: ray.o,
            beta: Rgb::WHITE,
            eta: 1.0,
            partial: None,
        };
        let mut subpaths: Vec<Subpath> = wave.rays.iter().zip(wave.keys).enumerate().map(subpath).collect();
        let mut next = Vec::new();
        let mut depth = 0;
        while !subpaths.is_empty() && self.limits.allows(depth + 1) && !worker.interrupt.is_raised() {
            let coherence = if depth == 0 { wave.coherence } else { Coherence::Incoherent };
            let mut rays: Vec<Ray> = subpaths.iter().map(|path| path.ray).collect();
            let mut hits = Vec::new();
            intersect(self.scene, &rays, coherence, &mut hits, &mut worker.counters);
            if depth == 0 {
                self.first_hits(&mut rays, &mut hits, worker, out);
                for (path, ray) in subpaths.iter_mut().zip(&rays) {
                    path.ray = *ray;
                }
            }
            let mut alive = 0;
            for i in 0..subpaths.len() {
                match hits[i] {
                    None => self.add_environment(&subpaths[i], depth, out),
                    Some(_) => {
                        (subpaths[alive], rays[alive], hits[alive]) = (subpaths[i], rays[i], hits[i]);
                        alive += 1;
                    }
                }
            }
            subpaths.truncate(alive);
            rays.truncate(alive);
            hits.truncate(alive);
            self.shade(depth, &subpaths, &rays, &hits, worker, &mut next, out);
            worker.trace_shadows(self.scene, coherence, |slot, value| out[slot].value += value);
            std::mem::swap(&mut subpaths, &mut next);
            next.clear();
            depth += 1;
        }
    }

    /// Writes the distances of the first surfaces, behind hidden emitters if they are hidden.
    fn first_hits(
        &self,
        rays: &mut [Ray],
        hits: &mut [Option<Hit>],
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        let mut passed = Vec::new();
        if self.limits.hide_emitters && self.scene.needs.hit_emitters {
            passed = skip_emitters(self.scene, rays, hits, &mut worker.counters);
        }
        for (i, (out, hit)) in out.iter_mut().zip(hits).enumerate() {
            let before = passed.get(i).copied().unwrap_or(0.0);
            out.distance = hit.map_or(f32::INFINITY, |h| before + h.t);
        }
    }

    /// Returns whether emission at a vertex after `depth` scatterings counts.
    fn shows_emission(&self, depth: u32) -> bool {
        self.query.wants(depth + 1) && !(depth == 0 && self.limits.hide_emitters)
    }

    /// Adds the radiance of the environment and the sun for a path that leaves the scene.
    fn add_environment(&self, path: &Subpath, depth: u32, out: &mut [Radiance]) {
        if !self.scene.needs.environment || !self.shows_emission(depth) {
            return;
        }
        let d = path.ray.d;
        for emitter in self.scene.distant_emitters() {
            let radiance = self.scene.distant_radiance(emitter, d);
            let weight = match path.partial {
                Some(partial) => partial.of_hit(self.start(emitter, path.from, -d, 1.0)),
                None => 1.0,
            };
            let weight = self.techniques.weight(0, depth + 2, weight);
            out[path.slot as usize].value += path.beta * radiance * weight as f32;
        }
    }

    /// Returns the densities of an emitter that emits in the direction `d` with the cosine `cosine` at its surface, for
    /// sampling from the point `from`.
    fn start(&self, emitter: EmitterId, from: Vec3, d: Vec3, cosine: f32) -> Start {
        let (scene, i) = (self.scene, emitter.index());
        let light = &scene.lights[i];
        let (sampled, started) = (scene.light_selection.pmf(i, from), start_pmf(scene, self.guide, i));
        Start {
            cosine: cosine.into(),
            delta: light.is_delta(),
            distant: light.is_distant(),
            ..Start::new(light.start_density(d, cosine), sampled, started)
        }
    }

    /// Adds the contributions of all vertices of the wave, queues shadow rays, and adds the continuations to `next`.
    #[expect(clippy::too_many_arguments, reason = "the state of a wave")]
    fn shade(
        &self,
        depth: u32,
        subpaths: &[Subpath],
        rays: &[Ray],
        hits: &[Option<Hit>],
        worker: &mut Worker,
        next: &mut Vec<Subpath>,
        out: &mut [Radiance],
    ) {
        let go_on = self.limits.allows(depth + 2) && (self.query.direct || self.query.indirect);
        let roulette = Roulette::at(depth + 1, self.limits.rr_depth);
        let mut connection = Vec::new();
        if go_on {
            let keys: Vec<SampleKey> = subpaths.iter().map(|path| path.key).collect();
            let (sampler, numbers) = (worker.sampler, &mut worker.numbers);
            draw_2d(sampler, Dimension::emitter_point(depth), &keys, &mut numbers.emitter_point);
            draw_1d(sampler, Dimension::connection(depth), &keys, &mut connection);
            draw_1d(sampler, Dimension::bsdf_lobe(depth), &keys, &mut numbers.bsdf_lobe);
            draw_2d(sampler, Dimension::bsdf_direction(depth), &keys, &mut numbers.bsdf_direction);
            draw_1d(sampler, Dimension::roulette(depth), &keys, &mut numbers.roulette);
        }
        for first in (0..hits.len()).step_by(LANES) {
            worker.arena.reset();
            let block = ShadingBlock::of_light(self.scene, &worker.arena, rays, hits, first);
            for i in bits(block.active) {
                let path = &subpaths[first + i];
                let vertex = LightVertex::new(&block, i);
                let partial = self.arrive(path, &vertex);
                let at = CameraVertex { vertex, beta: path.beta, partial };
                if self.shows_emission(depth) {
                    out[path.slot as usize].value += self.emitted(path, &at, depth);
                }
                if !go_on {
                    continue;
                }
                if let Some(merging) = self.merging
                    && at.partial.is_merged()
                    && block.finite >> i & 1 == 1
                {
                    let wanted =
                        |edges| self.limits.allows(depth + 1 + edges) && self.query.wants(depth + 1 + edges);
                    out[path.slot as usize].value +=
                        at.beta * merging.radiance(&at.vertex, &at.partial, wanted);
                }
                let numbers = VertexNumbers::of(&worker.numbers, &connection, first + i);
                if block.finite >> i & 1 == 1 {
                    let shadows = &mut worker.shadows;
                    if self.query.wants(depth + 2)
                        && let Some((ray, value)) = self.sample_emitter(&at, &numbers, depth)
                    {
                        shadows.push_one(ray, path.slot, value);
                    }
                    if let Some((ray, value)) = self.connect(&at, depth, path.slot, numbers.connection) {
                        shadows.push_one(ray, path.slot, value);
                    }
                }
                next.extend(self.scatter(path, &at, &numbers, roulette));
            }
        }
    }

    /// Returns the partial weight at the vertex that a ray hits.
    fn arrive(&self, path: &Subpath, vertex: &LightVertex<'_>) -> Partial {
        let (distance, cos) = (f64::from(vertex.at.hit.t), f64::from(vertex.wo_ng.abs()));
        match path.partial {
            Some(partial) => partial.at_next(distance * distance, cos),
            None => {
                let density = self.camera.density(vertex.at.p, path.ray.d, path.ray.time) * cos;
                Partial::of_camera(density, self.merging.map_or_else(Merged::default, Merging::merged))
            }
        }
    }

    /// Returns the weighted contribution of a vertex on an emitter.
    fn emitted(&self, path: &Subpath, at: &CameraVertex<'_>, depth: u32) -> Rgb {
        let surface = &at.vertex.at;
        let Some(emitter) = self.scene.emitter_at(surface) else { return Rgb::BLACK };
        let radiance = self.scene.emitted(emitter, surface);
        let weight = match path.partial {
            Some(_) => {
                let start = self.start(emitter, path.from, -path.ray.d, at.vertex.wo_ng.abs());
                at.partial.of_hit(start)
            }
            None => 1.0,
        };
        let weight = self.techniques.weight(0, depth + 2, weight);
        at.beta * radiance * weight as f32
    }

    /// Samples an emitter. Returns the shadow ray and the weighted contribution if it is unoccluded.
    fn sample_emitter(
        &self,
        at: &CameraVertex<'_>,
        numbers: &VertexNumbers,
        depth: u32,
    ) -> Option<(Ray, Rgb)> {
        let (scene, CameraVertex { vertex, beta, partial }) = (self.scene, at);
        let (surface, u) = (&vertex.at, numbers.emitter_point);
        let (choice, sample) =
            scene.sample_emitter_choice(&scene.light_selection, surface.p, u, surface.time)?;
        let density = sample.pdf * choice.pmf;
        let wi = surface.frame.to_local(sample.wi);
        let scattered = vertex.bsdf.eval(vertex.wo, wi);
        let value = *beta * scattered.f * sample.radiance * (wi.z.abs() / density);
        if value.is_black() || density <= 0.0 {
            return None;
        }
        let light = &scene.lights[choice.emitter];
        let started = start_pmf(scene, self.guide, choice.emitter);
        let start = Start {
            cosine: sample.cosine.into(),
            delta: light.is_delta(),
            distant: light.is_distant(),
            ..Start::new(light.start_density(-sample.wi, sample.cosine), choice.pmf, started)
        };
        let ray = scene.shadow_ray(surface, &sample);
        let distance2 = f64::from(ray.d.length_squared());
        let cos = f64::from(sample.wi.dot(surface.ng).abs());
        let reverse = vertex.bsdf.pdf_adjoint(wi, vertex.wo);
        let weight = partial.of_emitter_sample(start, distance2, cos, scattered.pdf.into(), reverse.into());
        let weight = self.techniques.weight(1, depth + 2, weight);
        Some((ray, value * weight as f32))
    }

    /// Connects a vertex to one vertex of its light path. Returns the shadow ray and the weighted contribution if it is
    /// unoccluded. The vertex is chosen with a probability that is nearly in proportion to its contribution.
    fn connect(&self, at: &CameraVertex<'_>, depth: u32, slot: u32, u: f32) -> Option<(Ray, Rgb)> {
        let wanted = |light: &&StoredVertex<'_>| {
            let edges = depth + light.edges + 2;
            self.limits.allows(edges) && self.query.wants(edges)
        };
        let (mut sum, mut chosen, mut u) = (0.0f32, None, u);
        let light_path = self.light_path[slot as usize] as usize;
        for light in self.light.of(light_path).filter(wanted) {
            let importance = importance(&at.vertex, light);
            if importance == 0.0 {
                continue;
            }
            sum += importance;
            let share = importance / sum;
            if u < share || chosen.is_none() {
                u = (u / share).min(1f32.next_down());
                chosen = Some((light, importance));
            } else {
                u = (u - share) / (1.0 - share);
            }
        }
        let (light, importance) = chosen?;
        let value =
            contribution(at, light, |weight| self.techniques.weight(light.edges + 1, depth + 2, weight));
        if value.is_black() {
            return None;
        }
        let (from, to) = (&at.vertex.at, &light.vertex.at);
        let way = to.p - from.p;
        let target = offset_origin(to.p, to.error + end_error(way), to.ng, -way);
        let ray = self.scene.shadow_ray_to(from, target, way.normalize());
        Some((ray, value * (sum / importance)))
    }

    /// Samples the continuation of a path.
    fn scatter(
        &self,
        path: &Subpath,
        at: &CameraVertex<'_>,
        numbers: &VertexNumbers,
        roulette: Option<Roulette>,
    ) -> Option<Subpath> {
        let CameraVertex { vertex, beta, partial } = at;
        let sample = vertex.bsdf.sample(vertex.wo, numbers.lobe, numbers.direction)?;
        let (mut beta, eta) = (*beta * sample.weight, path.eta * sample.eta);
        if let Some(roulette) = roulette {
            beta = roulette.play(beta, eta * eta, numbers.roulette)?;
        }
        if beta.is_black() {
            return None;
        }
        let wi = vertex.at.frame.to_world(sample.wi);
        let cos = f64::from(wi.dot(vertex.at.ng).abs());
        let partial = match sample.pdf.is_infinite() {
            true => partial.reflected(cos),
            false => {
                let reverse = vertex.bsdf.pdf_adjoint(sample.wi, vertex.wo);
                partial.scattered(sample.pdf.into(), reverse.into(), cos)
            }
        };
        let ray = self.scene.spawn_ray(&vertex.at, wi, path.ray.time);
        Some(Subpath { ray, from: vertex.at.p, beta, eta, partial: Some(partial), ..*path })
    }
}

/// Returns an estimate of the contribution of a connection, which is positive if the contribution is: that of diffuse
/// surfaces. Shading normals and lobes may be anywhere, so the cosines have a least value.
fn importance(at: &LightVertex<'_>, light: &StoredVertex<'_>) -> f32 {
    const LEAST: f32 = 0.05;
    let way = light.vertex.at.p - at.at.p;
    let distance2 = way.length_squared();
    if distance2 == 0.0 {
        return 0.0;
    }
    let wi = way / distance2.sqrt();
    let cosines = wi.dot(at.at.ng).abs().max(LEAST) * wi.dot(light.vertex.at.ng).abs().max(LEAST);
    light.power.max_component() * cosines / distance2
}

/// Returns the contribution of the connection of two vertices if nothing is in between. `weighted` returns its final
/// weight.
fn contribution(at: &CameraVertex<'_>, light: &StoredVertex<'_>, weighted: impl Fn(f64) -> f64) -> Rgb {
    let (camera_end, light_end) = (&at.vertex, &light.vertex);
    let way = light_end.at.p - camera_end.at.p;
    let distance2 = way.length_squared();
    if distance2 == 0.0 {
        return Rgb::BLACK;
    }
    let wi = way / distance2.sqrt();
    let local = camera_end.at.frame.to_local(wi);
    let scattered = camera_end.bsdf.eval(camera_end.wo, local);
    if scattered.f.is_black() {
        return Rgb::BLACK;
    }
    let (emerging, reverse_of_light) = light_end.eval_with_density(-wi);
    if emerging.is_black() {
        return Rgb::BLACK;
    }
    let forward_of_light = light_end.bsdf.pdf_adjoint(light_end.wo, light_end.at.frame.to_local(-wi));
    let reverse_of_camera = camera_end.bsdf.pdf_adjoint(local, camera_end.wo);
    let per_area = |pdf: f32, n: Vec3| f64::from(pdf) * f64::from(wi.dot(n).abs()) / f64::from(distance2);
    let weight = weights::of_connection(
        &End {
            partial: at.partial,
            to_other: per_area(scattered.pdf, light_end.at.ng),
            reverse: reverse_of_camera.into(),
        },
        &End {
            partial: light.partial,
            to_other: per_area(forward_of_light, camera_end.at.ng),
            reverse: reverse_of_light.into(),
        },
    );
    let geometry = local.z.abs() / distance2 * weighted(weight) as f32;
    at.beta * scattered.f * emerging * light.power * geometry
}

impl VertexNumbers {
    fn of(numbers: &RandomNumbers, connection: &[f32], i: usize) -> Self {
        let pair = |pair: &[Vec<f32>; 2]| Vec2::new(pair[0][i], pair[1][i]);
        VertexNumbers {
            emitter_point: pair(&numbers.emitter_point),
            connection: connection[i],
            lobe: numbers.bsdf_lobe[i],
            direction: pair(&numbers.bsdf_direction),
            roulette: numbers.roulette[i],
        }
    }
}
