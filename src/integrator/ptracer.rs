//! Light tracing: paths that begin at emitters and are connected to the camera at every surface point.
//! [Arvo 1986; Veach 1997, 8.3]
//!
//! Emitters that the camera sees directly are found by camera rays, as in every other integrator; light paths bring all
//! that is scattered. What is seen in a mirror or through glass is black: no light path that ends so can be connected.

use super::block::Block;
use super::settings::{PathSettings, PtracerSettings};
use super::worker::{Continuation, draw_1d, draw_2d, intersect};
use super::{Integrator, PathIntegrator, Radiance, RadianceQuery, Wave, Worker};
use crate::accel::Coherence;
use crate::bsdf::{Bsdf, Lobe};
use crate::color::Rgb;
use crate::math::lanes::{LANES, bits, f32x16};
use crate::math::{Ray, RayX16, Vec2, Vec3};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::{Scene, SurfaceInteraction};
use crate::sensor::Camera;

/// Light that arrives at the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Position on the film in pixels from the top left corner of the full image.
    pub film: Vec2,
    /// What it adds to the sum of a pixel's samples, before the reconstruction filter.
    pub value: Rgb,
}

/// Traces paths from the emitters.
pub struct Ptracer {
    settings: PtracerSettings,
    /// Shows the emitters.
    emitters: PathIntegrator,
}

impl Ptracer {
    /// The integrator with its settings.
    pub fn new(settings: PtracerSettings) -> Self {
        let emitters = PathSettings {
            max_depth: Some(settings.max_depth.map_or(1, |depth| depth.min(1))),
            hide_emitters: settings.hide_emitters,
            ..PathSettings::default()
        };
        Ptracer { settings, emitters: PathIntegrator::new(emitters) }
    }

    /// Whether a path may have that many edges.
    fn allows(&self, edges: u32) -> bool {
        self.settings.max_depth.is_none_or(|max| edges <= max)
    }

    /// Begins a light path for each key: rays into `worker.paths`, and the power of each.
    fn emit(&self, scene: &Scene, keys: &[SampleKey], worker: &mut Worker) -> Vec<Rgb> {
        let (mut choice, mut times) = (Vec::new(), Vec::new());
        let (mut points, mut directions) = (<[Vec<f32>; 2]>::default(), <[Vec<f32>; 2]>::default());
        draw_1d(worker.sampler, Dimension::LIGHT, keys, &mut choice);
        draw_2d(worker.sampler, Dimension::LIGHT_POINT, keys, &mut points);
        draw_2d(worker.sampler, Dimension::LIGHT_DIRECTION, keys, &mut directions);
        if scene.needs.time {
            draw_1d(worker.sampler, Dimension::TIME, keys, &mut times);
        }
        let pair = |numbers: &[Vec<f32>; 2], i: usize| Vec2::new(numbers[0][i], numbers[1][i]);
        let (mut rays, mut alive, mut powers) = (Vec::new(), Vec::new(), Vec::new());
        for (i, key) in keys.iter().enumerate() {
            let time = times.get(i).copied().unwrap_or(0.0);
            let light = scene.sample_light_ray(choice[i], pair(&points, i), pair(&directions, i), time);
            if let Some(light) = light.filter(|light| !light.power.is_black()) {
                rays.push(light.ray);
                alive.push(*key);
                powers.push(light.power);
            }
        }
        worker.paths.begin(&rays, &alive);
        powers
    }

    /// Traces a light path for each key and adds what arrives at the film. `margin` is how far beside the image, in pixels,
    /// the reconstruction filter reaches.
    pub fn trace(
        &self,
        scene: &Scene,
        camera: &Camera,
        margin: f64,
        keys: &[SampleKey],
        worker: &mut Worker,
        out: &mut Vec<Splat>,
    ) {
        if !self.allows(2) {
            return;
        }
        let powers = self.emit(scene, keys, worker);
        let mut films = Vec::new();
        let mut depth = 0;
        while !worker.paths.rays.is_empty() && self.allows(depth + 2) {
            {
                let Worker { paths, hits, counters, .. } = &mut *worker;
                intersect(scene, &paths.rays, Coherence::Incoherent, hits, counters);
                paths.keep_hits(hits, |_, _| {});
            }
            self.draw(depth, worker, camera);
            films.clear();
            let bounce = Bounce { scene, camera, margin, roulette: depth + 1 >= self.settings.rr_depth };
            bounce.shade(self.allows(depth + 3), &powers, worker, &mut films);
            worker.trace_shadows(scene, Coherence::Incoherent, |slot, value| {
                out.push(Splat { film: films[slot], value });
            });
            depth += 1;
        }
    }

    fn draw(&self, depth: u32, worker: &mut Worker, camera: &Camera) {
        let Worker { sampler, paths, numbers, .. } = worker;
        draw_1d(*sampler, Dimension::bsdf_lobe(depth), &paths.keys, &mut numbers.bsdf_lobe);
        draw_2d(*sampler, Dimension::bsdf_direction(depth), &paths.keys, &mut numbers.bsdf_direction);
        draw_1d(*sampler, Dimension::roulette(depth), &paths.keys, &mut numbers.roulette);
        if camera.has_lens() {
            draw_2d(*sampler, Dimension::emitter_point(depth), &paths.keys, &mut numbers.emitter_point);
        }
    }
}

impl Integrator for Ptracer {
    fn name(&self) -> &'static str {
        "ptracer"
    }

    fn shows_environment(&self) -> bool {
        !self.settings.hide_emitters
    }

    fn light_tracer(&self) -> Option<&Ptracer> {
        Some(self)
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        self.emitters.li(scene, wave, query, worker, out);
    }
}

/// What every light path of a bounce has in common.
struct Bounce<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    margin: f64,
    roulette: bool,
}

impl Bounce<'_> {
    /// Connects every path to the camera, and moves those that go on to the front.
    fn shade(&self, go_on: bool, powers: &[Rgb], worker: &mut Worker, films: &mut Vec<Vec2>) {
        let Worker { hits, paths, numbers, shadows, arena, .. } = worker;
        let mut alive = 0;
        for first in (0..hits.len()).step_by(LANES) {
            arena.reset();
            let block = Block::new(self.scene, arena, &paths.rays, hits, first);
            let mut next = Continuation {
                rays: RayX16::splat(&Ray::new(Vec3::ZERO, Vec3::Z)),
                beta: [f32x16::ZERO; 3],
                pdf: f32x16::ZERO,
                eta: f32x16::ZERO,
            };
            let mut rays = [Ray::new(Vec3::ZERO, Vec3::Z); LANES];
            let mut survivors = 0;
            for i in bits(block.active) {
                let j = first + i;
                let vertex = Vertex::new(&block, i);
                let beta = paths.beta(j);
                let u_lens = match self.camera.has_lens() {
                    true => Vec2::new(numbers.emitter_point[0][j], numbers.emitter_point[1][j]),
                    false => Vec2::ZERO,
                };
                if let Some((ray, film, value)) = self.connect(&vertex, u_lens) {
                    shadows.push_one(ray, films.len() as u32, beta * powers[paths.slots[j] as usize] * value);
                    films.push(film);
                }
                if !go_on {
                    continue;
                }
                let u = Vec2::new(numbers.bsdf_direction[0][j], numbers.bsdf_direction[1][j]);
                let Some((wi, weight, eta)) = vertex.scatter(numbers.bsdf_lobe[j], u) else { continue };
                let (mut beta, eta) = (beta * weight, paths.eta[j] * eta);
                if self.roulette {
                    let survival = beta.max_component().min(0.95);
                    if numbers.roulette[j] >= survival {
                        continue;
                    }
                    beta = beta / survival;
                }
                if beta.is_black() {
                    continue;
                }
                rays[i] = self.scene.spawn_ray(&vertex.at, wi, vertex.at.time);
                for (channel, value) in next.beta.iter_mut().zip(beta.to_array()) {
                    channel.as_mut_array()[i] = value;
                }
                next.eta.as_mut_array()[i] = eta;
                survivors |= 1 << i;
            }
            next.rays = RayX16::load(&rays, 0);
            alive = paths.compact(first, alive, &next, survivors);
        }
        paths.truncate(alive);
    }

    /// The ray from a surface point to the camera, where it arrives on the film, and what a path of power 1 adds there.
    fn connect(&self, vertex: &Vertex<'_>, u_lens: Vec2) -> Option<(Ray, Vec2, Rgb)> {
        if vertex.bsdf.is_specular() {
            return None;
        }
        let at = &vertex.at;
        let seen = self.camera.importance(at.p, u_lens, at.time, self.margin)?;
        let value = vertex.eval(seen.wi)? * seen.weight;
        let ray = self.scene.shadow_ray_to(at, seen.target, seen.wi);
        (!value.is_black()).then_some((ray, seen.film, value))
    }
}

/// A surface point on a light path.
struct Vertex<'a> {
    at: SurfaceInteraction,
    bsdf: &'a Bsdf<'a>,
    /// Towards the light, in the shading frame.
    wo: Vec3,
    /// Cosine of that to the geometric normal.
    wo_ng: f32,
}

impl<'a> Vertex<'a> {
    fn new(block: &Block<'a>, i: usize) -> Self {
        let at = block.at.lane(i);
        let wo_ng = -block.rays.d.lane(i).dot(at.ng);
        Vertex { at, bsdf: block.bsdfs[i], wo: block.wo.lane(i), wo_ng }
    }

    /// What a direction's cosine is multiplied by, so that shading normals mean the same to light paths as to camera paths;
    /// `None` where the two normals disagree about a side. [Veach 1997, 5.3.2]
    fn cosine(&self, wi_local: Vec3, wi: Vec3) -> Option<f32> {
        let wi_ng = wi.dot(self.at.ng);
        let agree = self.wo_ng * self.wo.z > 0.0 && wi_ng * wi_local.z > 0.0;
        agree.then(|| (wi_ng * self.wo.z / self.wo_ng).abs())
    }

    /// What is scattered into the world direction `wi`, with the cosine.
    fn eval(&self, wi: Vec3) -> Option<Rgb> {
        let local = self.at.frame.to_local(wi);
        let cosine = self.cosine(local, wi)?;
        // To the camera, `wi` is the known direction.
        Some(self.bsdf.eval(local, self.wo).f * cosine)
    }

    /// Draws a world direction, with the weight of light and the relative index of refraction.
    fn scatter(&self, u_lobe: f32, u: Vec2) -> Option<(Vec3, Rgb, f32)> {
        let sample = self.bsdf.sample(self.wo, u_lobe, u)?;
        let wi = self.at.frame.to_world(sample.wi).normalize();
        let cosine = self.cosine(sample.wi, wi)?;
        let weight = match sample.lobe {
            // Radiance is scaled at a boundary, light is not.
            Lobe::Specular => sample.weight * (sample.eta * sample.eta * cosine / sample.wi.z.abs()),
            _ => self.bsdf.eval(sample.wi, self.wo).f * (cosine / sample.pdf),
        };
        Some((wi, weight, sample.eta))
    }
}
