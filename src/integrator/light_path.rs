//! Light paths: how they begin at emitters and scatter forward. Light tracing and photon tracing share it.

use super::block::Block;
use super::photon::EmissionGuide;
use super::worker::{Continuation, PathWave, Worker, draw_1d, draw_2d};
use crate::bsdf::{Bsdf, Lobe};
use crate::color::Rgb;
use crate::math::lanes::{LANES, f32x16};
use crate::math::{Ray, RayX16, Vec2, Vec3};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::{Scene, SurfaceInteraction};

/// Begins a light path for each key: rays into `worker.paths`, with the key's place as their slot, and the power of each, W,
/// by slot. A key whose emitter sends nothing begins no path.
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
        let (choice, pairs, time) = (numbers.choice[i], numbers.pairs(i), numbers.time(i));
        let light = match guide {
            Some(guide) => guide.sample_light_ray(scene, choice, pairs, time),
            None => scene.sample_light_ray(choice, pairs[0], pairs[1], time),
        };
        if let Some(light) = light.filter(|light| !light.power.is_black()) {
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

/// The random numbers that light paths begin with.
#[derive(Default)]
pub(super) struct EmissionNumbers {
    /// Which emitter.
    pub choice: Vec<f32>,
    points: [Vec<f32>; 2],
    directions: [Vec<f32>; 2],
    times: Vec<f32>,
    /// The time of all paths, if they share it.
    time: Option<f32>,
}

impl EmissionNumbers {
    /// Draws them for every key.
    pub fn draw(&mut self, scene: &Scene, keys: &[SampleKey], worker: &Worker) {
        draw_1d(worker.sampler, Dimension::LIGHT, keys, &mut self.choice);
        draw_2d(worker.sampler, Dimension::LIGHT_POINT, keys, &mut self.points);
        draw_2d(worker.sampler, Dimension::LIGHT_DIRECTION, keys, &mut self.directions);
        self.time = worker.time;
        if scene.needs.time && self.time.is_none() {
            draw_1d(worker.sampler, Dimension::TIME, keys, &mut self.times);
        }
    }

    /// Where on the emitter, and in which direction.
    pub fn pairs(&self, i: usize) -> [Vec2; 2] {
        [&self.points, &self.directions].map(|pair| Vec2::new(pair[0][i], pair[1][i]))
    }

    /// When, in [0, 1] over the shutter interval.
    pub fn time(&self, i: usize) -> f32 {
        self.time.unwrap_or_else(|| self.times.get(i).copied().unwrap_or(0.0))
    }
}

/// A surface point on a light path.
pub(super) struct Vertex<'a> {
    pub at: SurfaceInteraction,
    pub bsdf: &'a Bsdf<'a>,
    /// Towards the light, in the shading frame.
    pub wo: Vec3,
    /// Cosine of that to the geometric normal.
    pub wo_ng: f32,
}

/// Where light goes on to from a surface point.
pub(super) struct ScatteredLight {
    /// The direction in the world.
    pub wi: Vec3,
    /// What the light's power is multiplied by.
    pub weight: Rgb,
    /// Relative index of refraction, as that of a [`BsdfSample`](crate::bsdf::BsdfSample).
    pub eta: f32,
    /// By which lobe.
    pub lobe: Lobe,
}

impl<'a> Vertex<'a> {
    /// Lane `i` of a block.
    pub fn new(block: &Block<'a>, i: usize) -> Self {
        let at = block.at.lane(i);
        let wo_ng = -block.rays.d.lane(i).dot(at.ng);
        Vertex { at, bsdf: block.bsdfs[i], wo: block.wo.lane(i), wo_ng }
    }

    /// What a viewer's cosine is multiplied by, so that shading normals mean the same to light paths as to camera
    /// paths. [Veach 1997, Eq. 5.19]
    fn cosine(&self, wi: Vec3) -> f32 {
        (wi.dot(self.at.ng) * self.wo.z / self.wo_ng).abs()
    }

    /// What is scattered into the world direction `wi`, with the cosine.
    pub fn eval(&self, wi: Vec3) -> Rgb {
        // The viewer's is the known direction.
        let f = self.bsdf.eval(self.at.frame.to_local(wi), self.wo).f;
        if f.is_black() { f } else { f * self.cosine(wi) }
    }

    /// Draws where the light goes on to.
    pub fn scatter(&self, u_lobe: f32, u: Vec2) -> Option<ScatteredLight> {
        let sample = self.bsdf.sample_adjoint(self.wo, u_lobe, u)?;
        let wi = self.at.frame.to_world(sample.wi).normalize();
        let weight = sample.weight * (self.cosine(wi) / sample.wi.z.abs());
        Some(ScatteredLight { wi, weight, eta: sample.eta, lobe: sample.lobe })
    }
}

/// The paths of a block that go on.
pub(super) struct Survivors {
    rays: [Ray; LANES],
    next: Continuation,
    lanes: u32,
}

impl Survivors {
    /// None yet.
    pub fn none() -> Self {
        let ray = Ray::new(Vec3::ZERO, Vec3::Z);
        let next = Continuation {
            rays: RayX16::splat(&ray),
            beta: [f32x16::ZERO; 3],
            pdf: f32x16::ZERO,
            eta: f32x16::ZERO,
        };
        Survivors { rays: [ray; LANES], next, lanes: 0 }
    }

    /// Lane `i` goes on along a ray.
    pub fn push(&mut self, i: usize, ray: Ray, beta: Rgb, eta: f32) {
        self.rays[i] = ray;
        for (channel, value) in self.next.beta.iter_mut().zip(beta.to_array()) {
            channel.as_mut_array()[i] = value;
        }
        self.next.eta.as_mut_array()[i] = eta;
        self.lanes |= 1 << i;
    }

    /// As [`PathWave::compact`].
    pub fn compact(mut self, paths: &mut PathWave, first: usize, to: usize) -> usize {
        self.next.rays = RayX16::load(&self.rays, 0);
        paths.compact(first, to, &self.next, self.lanes)
    }
}
