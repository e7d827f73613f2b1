//! Light tracing: paths that begin at emitters and are connected to the camera at every surface point.
//! [Arvo 1986; Veach 1997, 8.3]
//!
//! Emitters that the camera sees directly are found by camera rays, as in every other integrator. Light paths
//! contribute all scattered light. Surfaces seen in a mirror or through smooth glass are black, because no light path
//! that ends there can be connected to the camera.

use super::block::ShadingBlock;
use super::light_path::{self, LightVertex, Survivors};
use super::roulette::Roulette;
use super::settings::{HiddenLight, PathLimits, PathSettings, Plugin, Source};
use super::worker::{draw_1d, draw_2d, intersect};
use super::{Integrator, PathIntegrator, Radiance, RadianceQuery, Wave, Worker};
use crate::accel::Coherence;
use crate::color::Rgb;
use crate::error::Result;
use crate::math::lanes::{LANES, bits};
use crate::math::{DVec2, Ray, Vec2};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;
use crate::sensor::Camera;

/// A contribution of light to the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// Position on the film in pixels from the top left corner of the full image.
    pub film: DVec2,
    /// The contribution to the sum of a pixel's samples, before the reconstruction filter.
    pub value: Rgb,
}

impl Splat {
    /// The bytes of a splat while it is kept until the end of a pass, and sorted into rows.
    pub const BYTES_IN_A_PASS: u64 = 64;
}

/// The part of an integrator that traces paths from the emitters and connects them to the camera.
pub trait LightTracer: Sync {
    /// Traces a light path for each key and adds its contributions to the film. `margin` is the extent of the
    /// reconstruction filter beyond the image, in pixels.
    fn trace(
        &self,
        scene: &Scene,
        camera: &Camera,
        margin: f64,
        keys: &[SampleKey],
        worker: &mut Worker,
        out: &mut Vec<Splat>,
    );
}

/// Traces paths from the emitters.
pub struct Ptracer {
    settings: PathLimits,
    /// Renders the directly visible emitters.
    emitters: PathIntegrator,
}

impl Ptracer {
    /// Creates the integrator.
    pub fn new(settings: PathLimits) -> Self {
        let emitters = PathLimits {
            max_depth: Some(settings.max_depth.map_or(1, |depth| depth.min(1))),
            hide_emitters: settings.hide_emitters,
            ..PathLimits::default()
        };
        Ptracer { settings, emitters: PathIntegrator::new(PathSettings::independent(emitters)) }
    }

    /// Returns whether a path may have the given number of edges.
    fn allows(&self, edges: u32) -> bool {
        self.settings.allows(edges)
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

impl LightTracer for Ptracer {
    fn trace(
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
        let powers = light_path::emit(scene, keys, None, worker);
        let mut films = Vec::new();
        let mut depth = 0;
        while !worker.paths.rays.is_empty() && self.allows(depth + 2) && !worker.interrupt.is_raised() {
            {
                let Worker { paths, hits, counters, .. } = &mut *worker;
                intersect(scene, &paths.rays, Coherence::Incoherent, hits, counters);
                paths.keep_hits(hits);
            }
            self.draw(depth, worker, camera);
            films.clear();
            let roulette = Roulette::at(depth + 1, self.settings.rr_depth);
            let hide_emitters = self.settings.hide_emitters && scene.needs.hit_emitters;
            let bounce = LightBounce { scene, camera, margin, roulette, hide_emitters };
            bounce.shade(self.allows(depth + 3), &powers, worker, &mut films);
            let splat = |slot: usize, value| out.push(Splat { film: films[slot], value });
            match hide_emitters {
                false => worker.trace_shadows(scene, Coherence::Incoherent, splat),
                true => worker.trace_shadows_past_emitters(scene, splat),
            }
            depth += 1;
        }
    }
}

impl Plugin for Ptracer {
    const NAME: &'static str = "ptracer";
    const HIDDEN_LIGHT: HiddenLight = HiddenLight::Direct;
    type Settings = PathLimits;

    fn read(source: &mut dyn Source) -> Result<PathLimits> {
        PathLimits::read(source)
    }

    fn with_limits(limits: PathLimits) -> PathLimits {
        limits
    }

    fn limits(limits: &PathLimits) -> PathLimits {
        *limits
    }

    fn create(settings: &PathLimits) -> Box<dyn Integrator> {
        Box::new(Ptracer::new(*settings))
    }
}

impl Integrator for Ptracer {
    fn name(&self) -> &'static str {
        "ptracer"
    }

    fn shares_noise(&self) -> bool {
        true
    }

    fn shows_environment(&self) -> bool {
        !self.settings.hide_emitters
    }

    fn light_tracer(&self) -> Option<&dyn LightTracer> {
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

/// The state shared by all light paths of a bounce.
struct LightBounce<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    margin: f64,
    roulette: Option<Roulette>,
    /// Whether emitting shapes are invisible to the camera.
    hide_emitters: bool,
}

impl LightBounce<'_> {
    /// Connects every path to the camera and moves the continuing paths to the front.
    fn shade(&self, go_on: bool, powers: &[Rgb], worker: &mut Worker, films: &mut Vec<DVec2>) {
        let Worker { hits, paths, numbers, shadows, arena, .. } = worker;
        let mut alive = 0;
        for first in (0..hits.len()).step_by(LANES) {
            arena.reset();
            let block = ShadingBlock::of_light(self.scene, arena, &paths.rays, hits, first);
            let mut survivors = Survivors::none();
            for i in bits(block.active) {
                let j = first + i;
                let vertex = LightVertex::new(&block, i);
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
                let Some(on) = vertex.scatter(numbers.bsdf_lobe[j], u) else { continue };
                let (mut beta, eta) = (beta * on.weight, paths.eta[j] * on.eta);
                if let Some(roulette) = self.roulette {
                    let Some(on) = roulette.play(beta, 1.0, numbers.roulette[j]) else { continue };
                    beta = on;
                }
                if beta.is_black() {
                    continue;
                }
                let ray = self.scene.spawn_ray(&vertex.at, on.wi, vertex.at.time);
                survivors.push(i, ray, beta, eta);
            }
            alive = survivors.compact(paths, first, alive);
        }
        paths.truncate(alive);
    }

    /// Returns the ray from a surface point to the camera, its position on the film, and the contribution of a path
    /// with power 1.
    fn connect(&self, vertex: &LightVertex<'_>, u_lens: Vec2) -> Option<(Ray, DVec2, Rgb)> {
        if vertex.bsdf.is_specular() {
            return None;
        }
        let at = &vertex.at;
        if self.hide_emitters && self.scene.shapes[at.shape().index()].emitter.is_some() {
            return None;
        }
        let seen = self.camera.importance(at.p, u_lens, at.time, self.margin)?;
        let value = vertex.eval(seen.wi) * seen.weight;
        let ray = self.scene.shadow_ray_to(at, seen.target, seen.wi);
        (!value.is_black()).then_some((ray, seen.film, value))
    }
}
