//! Camera subpaths, and the light that they find.

use super::light_paths::{LightPaths, typical_start_density};
use super::merging::Merging;
use super::sharing::SharedLightPaths;
use super::technique::Techniques;
use super::weights::{Merged, Partial, Start};
use crate::accel::{Coherence, Hit};
use crate::bsdf;
use crate::color::Rgb;
use crate::ids::{EmitterId, MediumId};
use crate::integrator::block::ShadingBlock;
use crate::integrator::emission::skip_emitters;
use crate::integrator::flight::medium_after;
use crate::integrator::light_path::LightVertex;
use crate::integrator::photon::EmissionGuide;
use crate::integrator::roulette::Roulette;
use crate::integrator::settings::PathLimits;
use crate::integrator::worker::{RandomNumbers, Worker, draw_1d, draw_2d, intersect};
use crate::integrator::{Radiance, RadianceQuery, Wave};
use crate::math::lanes::{LANES, bits, f32x16, load};
use crate::math::{Ray, Vec3};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::{Scene, SceneMedia};
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
    /// The light paths of each camera path.
    pub shared: SharedLightPaths,
    /// The media, if they are rendered.
    pub media: Option<&'a SceneMedia>,
    /// The light paths with which camera paths are merged.
    pub merging: Option<&'a Merging>,
}

/// The state of a camera path between two vertices.
#[derive(Clone, Copy)]
pub(super) struct Subpath {
    pub key: SampleKey,
    pub slot: u32,
    pub ray: Ray,
    /// The last vertex. The ray starts beside it.
    pub from: Vec3,
    /// The medium in which the ray starts.
    pub medium: Option<MediumId>,
    /// The product of the weights so far.
    pub beta: Rgb,
    /// The product of the relative indices of refraction.
    pub eta: f32,
    /// The partial weight; `None` before the first vertex.
    pub partial: Option<Partial>,
    /// Whether a finite lobe has scattered the path.
    pub finite: bool,
}

/// The vertices of up to sixteen camera paths. The `wo` of the block point to the viewer.
pub(super) struct CameraVertices<'a> {
    pub block: &'a ShadingBlock<'a>,
    /// The path of each lane.
    pub paths: &'a [Subpath],
    /// The partial weight at the vertex in each lane.
    pub partials: &'a [Partial; LANES],
    /// The number of scatterings before.
    pub depth: u32,
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
            medium: self.media.and_then(|media| media.sensor),
            beta: Rgb::WHITE,
            eta: 1.0,
            partial: None,
            finite: false,
        };
        let mut subpaths: Vec<Subpath> = wave.rays.iter().zip(wave.keys).enumerate().map(subpath).collect();
        let mut next = Vec::new();
        let mut depth = 0;
        while !subpaths.is_empty() && self.limits.allows(depth + 1) && !worker.interrupt.is_raised() {
            let coherence = if depth == 0 { wave.coherence } else { Coherence::Incoherent };
            let whole: Vec<Ray> = subpaths.iter().map(|path| path.ray).collect();
            let (mut rays, mut hits) = (whole.clone(), Vec::new());
            intersect(self.scene, &rays, coherence, &mut hits, &mut worker.counters);
            if depth == 0 {
                self.first_hits(&mut rays, &mut hits, worker, out);
                for (path, ray) in subpaths.iter_mut().zip(&rays) {
                    path.ray = *ray;
                }
            }
            let scattered = self.fly(depth, &whole, &mut subpaths, &mut hits, worker, out);
            let mut alive = 0;
            for i in 0..subpaths.len() {
                match hits[i] {
                    None if subpaths[i].beta.is_black() => {}
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
            self.scatter_in_media(depth, &scattered, worker, &mut next);
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

    /// Returns whether paths may be scattered after `depth` scatterings.
    pub fn goes_on(&self, depth: u32) -> bool {
        self.limits.allows(depth + 2) && (self.query.direct || self.query.indirect)
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
        let (sampled, started) =
            (scene.light_selection.pmf(i, from), typical_start_density(scene, self.guide, i));
        Start::new(&scene.lights[i], d, cosine, sampled, started)
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
        let go_on = self.goes_on(depth);
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
            let paths = &subpaths[first..hits.len().min(first + LANES)];
            let partials = self.arrive(&block, paths);
            let vertices = CameraVertices { block: &block, paths, partials: &partials, depth };
            if self.shows_emission(depth) {
                for i in bits(block.at.emitting & block.active) {
                    out[paths[i].slot as usize].value += self.emitted(&vertices, i);
                }
            }
            if !go_on {
                continue;
            }
            if let Some(merging) = self.merging {
                for i in bits(block.finite).filter(|i| partials[*i].is_merged()) {
                    let wanted =
                        |edges| self.limits.allows(depth + 1 + edges) && self.query.wants(depth + 1 + edges);
                    let vertex = LightVertex::new(&block, i);
                    out[paths[i].slot as usize].value +=
                        paths[i].beta * merging.radiance(self.scene, &vertex, &partials[i], wanted);
                }
            }
            if block.finite != 0 {
                if self.query.wants(depth + 2) {
                    let u = [0, 1].map(|k| load(&worker.numbers.emitter_point[k], first));
                    self.sample_emitters(&vertices, u, &mut worker.shadows);
                }
                self.connect(&vertices, &connection[first..], &mut worker.shadows);
            }
            self.scatter(&vertices, &worker.numbers, next);
        }
    }

    /// Returns the partial weights at the vertices that the rays hit.
    fn arrive(&self, block: &ShadingBlock<'_>, paths: &[Subpath]) -> [Partial; LANES] {
        let cosines = block.rays.d.dot(block.at.ng).abs().to_array();
        let merged = self.merging.map_or_else(Merged::default, Merging::merged);
        let mut partials = [Partial::of_camera(1.0, merged); LANES];
        for ((i, path), partial) in paths.iter().enumerate().zip(&mut partials) {
            let (distance, cos) = (f64::from(block.at.hit[i].t), f64::from(cosines[i]));
            *partial = self.arrive_at(path, block.at.p.lane(i), distance, cos, merged);
        }
        partials
    }

    /// Returns the partial weight of a path at the point `p`, at the distance `distance`, where `cos` is the cosine of
    /// the ray with the geometric normal, or 1 in a medium.
    pub fn arrive_at(&self, path: &Subpath, p: Vec3, distance: f64, cos: f64, merged: Merged) -> Partial {
        match path.partial {
            Some(partial) => partial.at_next(distance * distance, cos),
            None => Partial::of_camera(self.camera.density(p, path.ray.d, path.ray.time) * cos, merged),
        }
    }

    /// Returns the weighted contribution of the vertex of lane `i`, whose shape emits.
    fn emitted(&self, vertices: &CameraVertices<'_>, i: usize) -> Rgb {
        let (path, surface) = (&vertices.paths[i], &vertices.block.at.lane(i));
        let Some(emitter) = self.scene.emitter_at(surface) else { return Rgb::BLACK };
        let radiance = self.scene.emitted(emitter, surface);
        let weight = match path.partial {
            Some(_) => {
                let cosine = path.ray.d.dot(surface.ng).abs();
                vertices.partials[i].of_hit(self.start(emitter, path.from, -path.ray.d, cosine))
            }
            None => 1.0,
        };
        let weight = self.techniques.weight(0, vertices.depth + 2, weight);
        path.beta * radiance * weight as f32
    }

    /// Samples the continuations of the paths, and adds them to `next`.
    fn scatter(&self, vertices: &CameraVertices<'_>, numbers: &RandomNumbers, next: &mut Vec<Subpath>) {
        let CameraVertices { block, paths, partials, depth } = vertices;
        let roulette = Roulette::at(depth + 1, self.limits.rr_depth);
        let u_lobe = load(&numbers.bsdf_lobe, block.first);
        let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], block.first));
        let sample = bsdf::lanes::sample_x16(&block.bsdfs, &block.wo, u_lobe, u, block.active);
        let valid = sample.valid.to_bitmask() & block.active;
        let finite = valid & !sample.pdf.simd_eq(f32x16::splat(f32::INFINITY)).to_bitmask();
        let reverse = match finite {
            0 => f32x16::ZERO,
            _ => bsdf::lanes::pdf_adjoint_x16(&block.bsdfs, &sample.wi, &block.wo, finite),
        };
        let wi = block.at.frame.to_world(sample.wi);
        let cosines = wi.dot(block.at.ng).abs().to_array();
        let rays = self.scene.spawn_rays(&block.at, wi, block.rays.time).to_rays();
        let ([r, g, b], eta) = (sample.weight.map(f32x16::to_array), sample.eta.to_array());
        let (pdf, reverse) = (sample.pdf.to_array(), reverse.to_array());
        for i in bits(valid) {
            let (mut beta, eta) = (paths[i].beta * Rgb::new(r[i], g[i], b[i]), paths[i].eta * eta[i]);
            if let Some(roulette) = roulette {
                let Some(on) = roulette.play(beta, eta * eta, numbers.roulette[block.first + i]) else {
                    continue;
                };
                beta = on;
            }
            if beta.is_black() {
                continue;
            }
            let cos = f64::from(cosines[i]);
            let partial = match finite >> i & 1 {
                0 => partials[i].reflected(cos),
                _ => partials[i].scattered(pdf[i].into(), reverse[i].into(), cos),
            };
            let (ray, from) = (rays[i], block.at.p.lane(i));
            let d = block.rays.d.lane(i);
            let medium = self.media.and_then(|media| {
                medium_after(self.scene, media, block.at.facet(i), (d, ray.d), paths[i].medium)
            });
            let is_spread = paths[i].finite || finite >> i & 1 != 0;
            next.push(Subpath {
                ray,
                from,
                medium,
                beta,
                eta,
                partial: Some(partial),
                finite: is_spread,
                ..paths[i]
            });
        }
    }
}
