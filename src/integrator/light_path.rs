//! Light paths: emission and scattering, shared by light tracing and photon tracing.

use super::block::ShadingBlock;
use super::path_wave::{Continuation, PathWave};
use super::photon::EmissionGuide;
use super::worker::{Worker, draw_1d, draw_2d};
use crate::bsdf::{Bsdf, BsdfEval, Lobe};
use crate::color::Rgb;
use crate::emitter::LightRay;
use crate::ids::EmitterId;
use crate::math::lanes::{LANES, f32x16};
use crate::math::{Ray, RayX16, Vec2, Vec3, Vec3x16};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::{Scene, SurfaceInteraction};

/// Starts a light path for each key: pushes rays to `worker.paths`, with the key's index as their slot, and returns
/// the power of each slot in W. A key whose emitter emits nothing starts no path.
pub(super) fn emit(
    scene: &Scene,
    keys: &[SampleKey],
    guide: Option<&EmissionGuide>,
    worker: &mut Worker,
) -> Vec<Rgb> {
    let mut numbers = EmissionNumbers::default();
    numbers.draw(scene, keys, worker);
    let (mut rays, mut alive, mut slots) = (Vec::new(), Vec::new(), Vec::new());
    let mut powers = vec![Rgb::BLACK; keys.len()];
    for (i, key) in keys.iter().enumerate() {
        if let Some((_, light)) = numbers.start(scene, guide, i) {
            rays.push(light.ray);
            alive.push(*key);
            slots.push(i as u32);
            powers[i] = light.power;
        }
    }
    worker.paths.begin(&rays, &alive);
    worker.paths.slots = slots;
    powers
}

/// The random numbers used to start light paths.
#[derive(Default)]
pub(super) struct EmissionNumbers {
    /// Choice of the emitter.
    pub choice: Vec<f32>,
    points: [Vec<f32>; 2],
    directions: [Vec<f32>; 2],
    times: Vec<f32>,
    /// The time of all paths, if it is shared.
    time: Option<f32>,
}

impl EmissionNumbers {
    /// Draws the numbers for every key.
    pub fn draw(&mut self, scene: &Scene, keys: &[SampleKey], worker: &Worker) {
        draw_1d(worker.sampler, Dimension::LIGHT, keys, &mut self.choice);
        draw_2d(worker.sampler, Dimension::LIGHT_POINT, keys, &mut self.points);
        draw_2d(worker.sampler, Dimension::LIGHT_DIRECTION, keys, &mut self.directions);
        self.time = worker.time;
        if scene.needs.time && self.time.is_none() {
            draw_1d(worker.sampler, Dimension::TIME, keys, &mut self.times);
        }
    }

    /// Samples a light ray, with the guide's density if there is one. Returns the emitter beside it, or `None` if it
    /// emits nothing.
    pub fn start(
        &self,
        scene: &Scene,
        guide: Option<&EmissionGuide>,
        i: usize,
    ) -> Option<(EmitterId, LightRay)> {
        let (choice, pairs, time) = (self.choice[i], self.pairs(i), self.time(i));
        let start = match guide {
            Some(guide) => guide.sample_light_start(scene, choice, pairs, time),
            None => scene.sample_light_start(choice, pairs, time),
        };
        start.filter(|(_, light)| !light.power.is_black())
    }

    /// Returns the numbers for the position on the emitter and for the direction.
    pub fn pairs(&self, i: usize) -> [Vec2; 2] {
        [&self.points, &self.directions].map(|pair| Vec2::new(pair[0][i], pair[1][i]))
    }

    /// Returns the time, in [0, 1] over the shutter interval.
    pub fn time(&self, i: usize) -> f32 {
        self.time.unwrap_or_else(|| self.times.get(i).copied().unwrap_or(0.0))
    }
}

/// A surface vertex of a light path.
pub(super) struct LightVertex<'a> {
    pub at: SurfaceInteraction,
    pub bsdf: &'a Bsdf<'a>,
    /// The direction towards the light, in the shading frame.
    pub wo: Vec3,
    /// The cosine between that direction and the geometric normal.
    pub wo_ng: f32,
}

/// A sample of the direction in which a light path continues.
pub(super) struct ScatteredLight {
    /// The direction in world space.
    pub wi: Vec3,
    /// The factor on the path's power.
    pub weight: Rgb,
    /// The relative index of refraction, as in [`BsdfSample`](crate::bsdf::BsdfSample).
    pub eta: f32,
    /// The sampled lobe.
    pub lobe: Lobe,
}

impl<'a> LightVertex<'a> {
    /// Creates the vertex of lane `i` of a block.
    pub fn new(block: &ShadingBlock<'a>, i: usize) -> Self {
        let at = block.at.lane(i);
        let wo_ng = -block.rays.d.lane(i).dot(at.ng);
        LightVertex { at, bsdf: block.bsdfs[i], wo: block.wo.lane(i), wo_ng }
    }

    /// Returns the corrected cosine of the direction towards the viewer, for which light paths and camera paths agree
    /// at shading normals. [Veach 1997, Eq. 5.19]
    fn cosine(&self, wi: Vec3) -> f32 {
        (wi.dot(self.at.ng) * self.wo.z / self.wo_ng).abs()
    }

    /// Returns the BSDF times the corrected cosine for scattering into the world-space direction `wi`.
    pub fn eval(&self, wi: Vec3) -> Rgb {
        self.eval_with_density(wi).0
    }

    /// Computes [`eval`](Self::eval). Returns the density with which a camera path from the direction `wi` samples the
    /// direction to the light, beside it.
    pub fn eval_with_density(&self, wi: Vec3) -> (Rgb, f32) {
        // `wo` of the BSDF is the direction towards the viewer.
        let BsdfEval { f, pdf } = self.bsdf.eval(self.at.frame.to_local(wi), self.wo);
        if f.is_black() { (f, pdf) } else { (f * self.cosine(wi), pdf) }
    }

    /// Samples the direction in which the light path continues.
    pub fn scatter(&self, u_lobe: f32, u: Vec2) -> Option<ScatteredLight> {
        let sample = self.bsdf.sample_adjoint(self.wo, u_lobe, u)?;
        let wi = self.at.frame.to_world(sample.wi).normalize();
        let weight = sample.weight * (self.cosine(wi) / sample.wi.z.abs());
        Some(ScatteredLight { wi, weight, eta: sample.eta, lobe: sample.lobe })
    }
}

/// The paths of a block that continue.
pub(super) struct Survivors {
    rays: [Ray; LANES],
    next: Continuation,
    lanes: u32,
}

impl Survivors {
    /// Creates an empty set.
    pub fn none() -> Self {
        let ray = Ray::new(Vec3::ZERO, Vec3::Z);
        let next = Continuation {
            rays: RayX16::splat(&ray),
            from: Vec3x16::default(),
            gloss: None,
            beta: [f32x16::ZERO; 3],
            pdf: f32x16::ZERO,
            eta: f32x16::ZERO,
        };
        Survivors { rays: [ray; LANES], next, lanes: 0 }
    }

    /// Adds the continuation of lane `i`.
    pub fn push(&mut self, i: usize, ray: Ray, beta: Rgb, eta: f32) {
        self.rays[i] = ray;
        for (channel, value) in self.next.beta.iter_mut().zip(beta.to_array()) {
            channel.as_mut_array()[i] = value;
        }
        self.next.eta.as_mut_array()[i] = eta;
        self.lanes |= 1 << i;
    }

    /// Compacts the paths as [`PathWave::compact`] does.
    pub fn compact(mut self, paths: &mut PathWave, first: usize, to: usize) -> usize {
        self.next.rays = RayX16::load(&self.rays, 0);
        paths.compact(first, to, &self.next, self.lanes)
    }
}
