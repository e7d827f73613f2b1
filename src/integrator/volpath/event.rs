//! One event of a path: scattering in a medium or at a surface, and the light found there.

use super::flight::{Collision, follow, transmittance};
use super::{Path, Shadow};
use crate::accel::{Coherence, Hit};
use crate::bsdf::Lobe;
use crate::color::Rgb;
use crate::emitter::{EmitterSample, LightSelection, ShadowTarget};
use crate::ids::MediumId;
use crate::integrator::roulette::Roulette;
use crate::integrator::{PathLimits, Radiance, RadianceQuery, Worker};
use crate::math::{Ray, Vec2, Vec3};
use crate::medium::{FreeFlight, Stream};
use crate::sampling::mis::power_heuristic;
use crate::scene::{Scene, SceneMedia, SurfaceInteraction};
use bumpalo::Bump;
use std::time::Instant;

/// What all paths share.
pub struct Tracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its media.
    pub media: &'a SceneMedia,
    /// The limits of paths.
    pub limits: PathLimits,
    /// The light to find.
    pub query: RadianceQuery,
}

/// The random numbers of an event.
#[derive(Clone, Copy, Debug)]
pub struct EventNumbers {
    /// Channel and optical depth of the flight.
    pub free_flight: Vec2,
    /// Choice of the emitter and position on it.
    pub emitter_point: Vec2,
    /// Choice of the lobe.
    pub lobe: f32,
    /// Direction.
    pub direction: Vec2,
    /// Russian roulette.
    pub roulette: f32,
    /// The flight through heterogeneous media.
    pub flight_stream: Stream,
    /// The transmittance of heterogeneous media up to the emitter.
    pub shadow_stream: Stream,
}

impl Tracer<'_> {
    /// Follows a path to its next event, which is at the surface `hit` if the ray is not scattered before. Adds the
    /// light that it finds and the shadow ray of the event. Returns the path after the event, if it goes on.
    pub fn event(
        &self,
        mut path: Path,
        hit: Option<&Hit>,
        numbers: &EventNumbers,
        arena: &Bump,
        shadows: &mut Vec<Shadow>,
        radiance: &mut Radiance,
    ) -> Option<Path> {
        if !path.beta.is_valid() {
            // The sample is counted as invalid.
            radiance.value += path.beta;
            return None;
        }
        let surface = hit.map(|hit| self.scene.interaction(&path.ray, hit));
        // Where paths end, scattering in media is loss.
        let mut flight = match self.scatters(&path) {
            true => FreeFlight::sampled(path.beta, numbers.free_flight, path.ray.o, numbers.flight_stream),
            false => FreeFlight::unscattered(numbers.flight_stream),
        };
        let end = (hit.map_or(f32::INFINITY, |hit| hit.t), surface.as_ref());
        let collision = follow(self.scene, self.media, &path.ray, end, &mut path.medium, &mut flight);
        if path.depth == 0 {
            radiance.distance = path.passed + collision.as_ref().map_or(end.0, |collision| collision.t);
        }
        path.beta *= match &collision {
            Some(collision) => flight.scattered(collision.medium),
            None => flight.passed(),
        };
        if path.beta.is_black() {
            return None;
        }
        match (collision, surface) {
            (Some(collision), _) => self.scatter_in_medium(path, &collision, numbers, shadows),
            (None, Some(at)) => {
                if self.adds_emission(&path) {
                    radiance.value += path.beta * self.emitted(&path, &at);
                }
                if path.depth == 0 && self.limits.hide_emitters && self.emits(&at) {
                    return Some(self.pass(path, &at));
                }
                self.scatter_at_surface(path, &at, numbers, arena, shadows)
            }
            (None, None) => {
                if self.adds_emission(&path) {
                    radiance.value += path.beta * self.environment(&path);
                }
                None
            }
        }
    }

    /// Returns whether the path may be scattered once more.
    fn scatters(&self, path: &Path) -> bool {
        self.limits.allows(path.depth + 2) && (self.query.direct || self.query.indirect)
    }

    /// Returns whether emission found by the path's ray is added.
    fn adds_emission(&self, path: &Path) -> bool {
        self.query.wants(path.depth + 1) && !(path.depth == 0 && self.limits.hide_emitters)
    }

    /// Samples a direction to an emitter at the path's next event, which is at `p`; `None` if its light is not wanted.
    fn sample_emitter(&self, path: &Path, p: Vec3, numbers: &EventNumbers) -> Option<EmitterSample> {
        if !self.query.wants(path.depth + 2) {
            return None;
        }
        self.scene.sample_emitter(self.selection(), p, numbers.emitter_point, path.ray.time)
    }

    fn selection(&self) -> &LightSelection {
        &self.scene.light_selection
    }

    fn emits(&self, at: &SurfaceInteraction) -> bool {
        self.scene.shapes[at.shape().index()].emitter.is_some()
    }

    /// Returns the weighted radiance of the emitter at a surface; black if nothing is emitted towards the path.
    fn emitted(&self, path: &Path, at: &SurfaceInteraction) -> Rgb {
        let Some(emitter) = self.scene.emitter_at(at) else { return Rgb::BLACK };
        let radiance = self.scene.emitted(emitter, at);
        if path.pdf.is_infinite() {
            return radiance;
        }
        let other = self.scene.emitter_pdf(self.selection(), emitter, path.from, path.ray.o, at);
        radiance * power_heuristic(path.pdf, other)
    }

    /// Returns the weighted radiance of the environment and the sun.
    fn environment(&self, path: &Path) -> Rgb {
        let d = path.ray.d;
        let mut sum = Rgb::BLACK;
        // Each emitter is weighted against its own samples, as if it were alone.
        for emitter in self.scene.distant_emitters() {
            let mut radiance = self.scene.distant_radiance(emitter, d);
            if path.pdf.is_finite() {
                let pmf = self.selection().pmf(emitter.index(), path.from);
                let other = pmf * self.scene.distant_density(self.selection(), emitter, d);
                radiance *= power_heuristic(path.pdf, other);
            }
            sum += radiance;
        }
        sum
    }

    /// Continues a path straight through a surface.
    fn pass(&self, path: Path, at: &SurfaceInteraction) -> Path {
        let Ray { d, time, t_max, .. } = path.ray;
        let t = at.hit.t;
        Path {
            ray: Ray { t_max: t_max - t, ..self.scene.spawn_ray(at, d, time) },
            medium: self.media.beside(at, d, path.medium),
            passed: path.passed + t,
            ..path
        }
    }

    /// Returns the medium in which light starts in the direction `wi` at a surface that the ray `d` hits in `medium`.
    fn medium_after(
        &self,
        at: &SurfaceInteraction,
        d: Vec3,
        wi: Vec3,
        medium: Option<MediumId>,
    ) -> Option<MediumId> {
        let crosses = (at.ng.dot(d) < 0.0) == (at.ng.dot(wi) < 0.0);
        // Nothing is transmitted by a two-sided material. Its normals are turned to the ray.
        let crosses = crosses && !self.scene.materials.get(at.material).two_sided;
        if crosses { self.media.beside(at, wi, medium) } else { medium }
    }

    fn scatter_at_surface(
        &self,
        path: Path,
        at: &SurfaceInteraction,
        numbers: &EventNumbers,
        arena: &Bump,
        shadows: &mut Vec<Shadow>,
    ) -> Option<Path> {
        if !self.scatters(&path) {
            return None;
        }
        let Ray { d, time, .. } = path.ray;
        let wo = at.frame.to_local(-d);
        let bsdf = self.scene.bsdf(at, Some(wo), arena);
        let emitter = if bsdf.is_specular() { None } else { self.sample_emitter(&path, at.p, numbers) };
        if let Some(sample) = emitter {
            let wi = at.frame.to_local(sample.wi);
            let eval = bsdf.eval(wo, wi);
            let value = path.beta * eval.f * wi.z.abs() * weighted(&sample, eval.pdf);
            let medium = self.medium_after(at, d, sample.wi, path.medium);
            let ray = || self.scene.shadow_ray(at, &sample);
            push_shadow(shadows, value, ray, medium, path.slot, numbers.shadow_stream);
        }
        let sample = bsdf.sample(wo, numbers.lobe, numbers.direction)?;
        let wi = at.frame.to_world(sample.wi);
        let material = self.scene.materials.get(at.material);
        // Rays hit an emitter with holes everywhere. To pass a hole is not an event.
        if material.holes && sample.lobe == Lobe::Specular && sample.wi == -wo {
            return Some(Path { beta: path.beta * sample.weight, pdf: sample.pdf, ..self.pass(path, at) });
        }
        let next = Path {
            ray: self.scene.spawn_ray(at, wi, time),
            medium: self.medium_after(at, d, wi, path.medium),
            from: at.p,
            pdf: sample.pdf,
            beta: path.beta * sample.weight,
            eta: path.eta * sample.eta,
            depth: path.depth + 1,
            ..path
        };
        self.survivor(next, numbers)
    }

    fn scatter_in_medium(
        &self,
        path: Path,
        collision: &Collision<'_>,
        numbers: &EventNumbers,
        shadows: &mut Vec<Shadow>,
    ) -> Option<Path> {
        let Ray { d, time, .. } = path.ray;
        let (p, phase) = (collision.p, collision.medium.phase());
        if let Some(sample) = self.sample_emitter(&path, p, numbers) {
            let density = phase.eval(d.dot(sample.wi));
            let value = path.beta * density * weighted(&sample, density);
            let ray = || match sample.target {
                ShadowTarget::Point(target) => Ray { o: p, d: target - p, t_max: 1.0, time },
                ShadowTarget::Infinity => Ray { time, ..Ray::new(p, sample.wi) },
            };
            push_shadow(shadows, value, ray, path.medium, path.slot, numbers.shadow_stream);
        }
        let wi = phase.sample(d, numbers.direction);
        let next = Path {
            ray: Ray { time, ..Ray::new(p, wi) },
            from: p,
            pdf: phase.eval(d.dot(wi)),
            depth: path.depth + 1,
            ..path
        };
        self.survivor(next, numbers)
    }

    /// Plays Russian roulette after an event.
    fn survivor(&self, path: Path, numbers: &EventNumbers) -> Option<Path> {
        if path.beta.is_black() {
            return None;
        }
        match Roulette::at(path.depth, self.limits.rr_depth) {
            None => Some(path),
            Some(roulette) => {
                let beta = roulette.play(path.beta, path.eta * path.eta, numbers.roulette)?;
                Some(Path { beta, ..path })
            }
        }
    }

    /// Traces shadow rays, adds the contributions of the unoccluded ones and empties the list.
    pub fn add_shadows(
        &self,
        shadows: &mut Vec<Shadow>,
        coherence: Coherence,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        let rays: Vec<Ray> = shadows.iter().map(|shadow| shadow.ray).collect();
        let mut occluded = vec![false; rays.len()];
        let started = Instant::now();
        self.scene.accel.occluded_wave(&rays, &mut occluded, coherence);
        worker.counters.occlusion_time += started.elapsed();
        worker.counters.occlusion_rays += rays.len() as u64;
        for (shadow, occluded) in shadows.drain(..).zip(occluded) {
            if !occluded {
                let Shadow { ray, medium, slot, value, random } = shadow;
                out[slot].value += value * transmittance(self.scene, self.media, &ray, medium, random);
            }
        }
    }
}

/// Returns the radiance of an emitter sample, divided by its density and weighted. `other` is the density per unit
/// solid angle with which the BSDF or the phase function samples its direction.
fn weighted(sample: &EmitterSample, other: f32) -> Rgb {
    let weight = if sample.delta { 1.0 } else { power_heuristic(sample.pdf, other) };
    // A direction without density carries nothing.
    if sample.pdf > 0.0 { sample.radiance * (weight / sample.pdf) } else { Rgb::BLACK }
}

/// Adds a shadow ray, if it may carry light.
fn push_shadow(
    shadows: &mut Vec<Shadow>,
    value: Rgb,
    ray: impl Fn() -> Ray,
    medium: Option<MediumId>,
    slot: usize,
    random: Stream,
) {
    if !value.is_black() {
        shadows.push(Shadow { ray: ray(), medium, slot, value, random });
    }
}
