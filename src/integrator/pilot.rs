//! Camera rays for pilots: samples that are not part of the image, from which a preparation decides how to render.

use super::worker::{Worker, draw_1d, draw_2d};
use super::{Group, Integrator, NO_RAY, Preparation, Radiance, RadianceQuery, Wave};
use crate::accel::Coherence;
use crate::math::{DVec2, Ray, Vec2};
use crate::sampling::{Dimension, SampleKey, Sampler};
use crate::scene::Scene;
use crate::sensor::Camera;

/// Camera rays with their keys.
pub struct PilotRays {
    /// The rays; those of a pixel are consecutive.
    pub rays: Vec<Ray>,
    /// The keys of the samples.
    pub keys: Vec<SampleKey>,
}

impl PilotRays {
    /// Returns `samples` rays through each of the pixels, which are positions in the full image. `stream` makes the
    /// random numbers others than those of the image and of other pilots.
    pub fn new(
        preparation: &Preparation<'_>,
        pixels: impl Iterator<Item = (u32, u32)> + Clone,
        samples: usize,
        stream: u64,
    ) -> Self {
        let Preparation { scene, camera, sampler, seed, .. } = *preparation;
        PilotRays::through(scene, camera, sampler, seed ^ stream, pixels, samples, |u| u.as_dvec2())
    }

    /// Returns `samples` rays through each of the pixels. `place` maps two random numbers to a position relative to the
    /// top left corner of the pixel.
    pub fn through(
        scene: &Scene,
        camera: &Camera,
        sampler: Sampler,
        seed: u64,
        pixels: impl Iterator<Item = (u32, u32)> + Clone,
        samples: usize,
        place: impl Fn(Vec2) -> DVec2,
    ) -> Self {
        let key = |(x, y), sample| sampler.key(seed, x, y, sample);
        let keys: Vec<SampleKey> =
            pixels.clone().flat_map(|p| (0..samples as u64).map(move |i| key(p, i))).collect();
        let mut numbers = [(); 2].map(|()| [Vec::new(), Vec::new()]);
        draw_2d(sampler, Dimension::PIXEL, &keys, &mut numbers[0]);
        draw_2d(sampler, Dimension::LENS, &keys, &mut numbers[1]);
        let mut times = vec![0.0; keys.len()];
        if scene.needs.time {
            draw_1d(sampler, Dimension::TIME, &keys, &mut times);
        }
        let pair = |of: usize, i: usize| Vec2::new(numbers[of][0][i], numbers[of][1][i]);
        let ray = |(i, (x, y)): (usize, (u32, u32))| {
            let film = DVec2::new(f64::from(x), f64::from(y)) + place(pair(0, i));
            camera.ray(film, pair(1, i), times[i])
        };
        let each = pixels.flat_map(|pixel| std::iter::repeat_n(pixel, samples));
        PilotRays { rays: each.enumerate().map(ray).collect(), keys }
    }

    /// Traces the rays, of which there are `samples` through each pixel. If `reused` is true, the pixels, at most
    /// sixteen, are a group. Returns the radiance along the rays and their [cost](super::Counters::cost).
    pub fn trace(
        &self,
        scene: &Scene,
        integrator: &dyn Integrator,
        samples: usize,
        reused: bool,
        worker: &mut Worker,
    ) -> (Vec<Radiance>, f64) {
        let ray = |i: usize, sample: usize| {
            let ray = i * samples + sample;
            if ray < self.rays.len() { ray as u32 } else { NO_RAY }
        };
        let group = |sample: usize| std::array::from_fn(|i| ray(i, sample));
        let groups: Vec<Group> = if reused { (0..samples).map(group).collect() } else { Vec::new() };
        let mut radiance = vec![Radiance::NONE; self.rays.len()];
        let before = worker.counters;
        let wave =
            Wave { rays: &self.rays, keys: &self.keys, coherence: Coherence::Coherent, groups: &groups };
        integrator.li(scene, wave, RadianceQuery::ALL, worker, &mut radiance);
        (radiance, worker.counters.cost(scene) - before.cost(scene))
    }
}
