//! Guided emission of light paths: a density learned from a pilot pass, sampled exactly. [after Jensen 2001, 5.3]
//!
//! A projection map marks the directions in which specular objects lie. Here this information is learned: a light
//! path is a point of a unit hypercube, and the pilot estimates which cells of the hypercube contribute photons where
//! they are needed. This works for all kinds of emitters, and for objects seen through mirrors. Powers are divided by
//! the density, so the result is unbiased even if the pilot missed contributions.

mod pilot;

use self::pilot::PilotResults;
use super::cast::{LightPathTracer, PathLimit, PathSequence};
use super::tracing::{Deposit, PhotonPaths};
use super::visible_surfaces::VisibleSurfaces;
use crate::emitter::LightRay;
use crate::ids::EmitterId;
use crate::integrator::light_path::EmissionNumbers;
use crate::integrator::settings::PathLimits;
use crate::integrator::{Preparation, Worker};
use crate::math::Vec2;
use crate::sampling::{Distribution1D, Distribution2D, SampleKey};
use crate::scene::Scene;

/// The number of light paths of the pilot.
const PILOT: u64 = 1 << 17;
/// The number of paths whose random numbers are drawn together.
const CHUNK: usize = 2048;
/// The stream of the pilot's random numbers. Photons have even streams.
const STREAM: u32 = 1;
/// The fraction of paths started without guiding: emitter, position and direction together. The power of a path is
/// therefore at most twice its unguided power, whatever the pilot missed.
const UNGUIDED: f64 = 0.5;

/// A density for starting light paths.
#[derive(Clone, Debug)]
pub struct EmissionGuide {
    /// The choice of the emitter: first for unguided paths, then for guided ones.
    choice: Distribution1D,
    lights: Vec<EmissionDensities>,
    /// See [`gain`](Self::gain).
    gain: f64,
}

/// The densities over positions on an emitter and over directions; uniform if `None`.
type EmissionDensities = [Option<Distribution2D>; 2];

impl EmissionGuide {
    /// Returns the guide that starts paths in proportion to the emitters' power.
    pub fn uniform(scene: &Scene) -> Self {
        let lights = scene.lights.iter().map(|_| [None, None]).collect();
        EmissionGuide { choice: scene.light_choice.clone(), lights, gain: 1.0 }
    }

    /// Learns which starts of light paths within the limits bring scattered light to visible surfaces.
    pub fn towards(
        visible: &VisibleSurfaces,
        preparation: &Preparation<'_>,
        limits: PathLimits,
    ) -> Option<Self> {
        let Preparation { scene, sampler, seed, pool, interrupt, .. } = *preparation;
        let tracer = LightPathTracer { scene, sampler, guide: None, pool, interrupt, time: None };
        let paths = PhotonPaths::scattered(limits);
        Self::learn(&tracer, &paths, seed, |_| true, |deposit: &Deposit| visible.contains(deposit.p))
    }

    /// Learns which starts from the emitters selected by `emitter` contribute power to the deposits selected by
    /// `wanted`. Returns `None` if there are none.
    pub fn learn(
        tracer: &LightPathTracer<'_>,
        paths: &PhotonPaths,
        seed: u64,
        emitter: impl Fn(usize) -> bool,
        wanted: impl Fn(&Deposit) -> bool + Sync,
    ) -> Option<Self> {
        let scene = tracer.scene;
        let uniform = EmissionGuide::uniform(scene);
        let pilot = LightPathTracer { guide: Some(&uniform), ..*tracer };
        let sequence = PathSequence { seed, stream: STREAM, number: 0, first: 0 };
        let until = PathLimit { paths: PILOT, kept: None };
        let power = |d: &Deposit, path: u64| wanted(d).then(|| (path, d.shading_power().max_component()));
        let cast = pilot.cast(paths, sequence, until, power);
        let mut brought = vec![0.0f32; cast.emitted as usize];
        for (path, power) in cast.kept {
            brought[path as usize] += power;
        }
        let mut found: Vec<PilotResults> = scene.lights.iter().map(|_| PilotResults::default()).collect();
        let worker = Worker::new(tracer.sampler);
        let mut numbers = EmissionNumbers::default();
        let mut useful = Vec::new();
        for (chunk, brought) in brought.chunks(CHUNK).enumerate() {
            let first = (chunk * CHUNK) as u64;
            let keys: Vec<SampleKey> = (0..brought.len() as u64).map(|i| sequence.key(first + i)).collect();
            numbers.draw(scene, &keys, &worker);
            for (i, brought) in brought.iter().enumerate() {
                let choice = scene.light_choice.sample(numbers.choice[i]);
                if let Some(choice) = choice.filter(|choice| emitter(choice.index)) {
                    // The contribution of the path, for the case that its emitter is the only one.
                    let pairs = numbers.pairs(i);
                    found[choice.index].add(pairs, f64::from(brought * choice.pmf));
                    if *brought > 0.0 {
                        useful.push((choice.index, pairs, f64::from(*brought)));
                    }
                }
            }
        }
        let mut guide = Self::of(scene, &found)?;
        let total: f64 = useful.iter().map(|(_, _, brought)| brought).sum();
        let ratio = |(light, pairs, brought): &(usize, [Vec2; 2], f64)| brought * guide.ratio(*light, *pairs);
        guide.gain = useful.iter().map(ratio).sum::<f64>() / total;
        Some(guide)
    }

    /// Returns the density of a start of a light path from an emitter, relative to that of a path with uniform random
    /// numbers from the same emitter.
    fn ratio(&self, light: usize, pairs: [Vec2; 2]) -> f64 {
        let learned: f32 = pairs
            .iter()
            .zip(&self.lights[light])
            .map(|(u, density)| density.as_ref().map_or(1.0, |density| density.pdf(*u)))
            .product();
        let (unguided, guided) = (self.choice.pmf(light), self.choice.pmf(self.lights.len() + light));
        f64::from((unguided + guided * learned) / (unguided + guided))
    }

    /// Returns the mean of the density of starts relative to that without the densities of positions and directions,
    /// over the paths of the pilot that were wanted, weighted by what they brought.
    pub fn gain(&self) -> f64 {
        self.gain
    }

    fn of(scene: &Scene, found: &[PilotResults]) -> Option<Self> {
        let (lights, brought): (Vec<_>, Vec<_>) = found.iter().map(PilotResults::best).unzip();
        let total: f64 = brought.iter().sum();
        if !(total > 0.0 && total.is_finite()) || 2 * lights.len() > Distribution1D::MAX_ENTRIES {
            return None;
        }
        let unguided = (0..lights.len()).map(|i| UNGUIDED * f64::from(scene.light_choice.pmf(i)));
        let guided = brought.iter().map(|brought| (1.0 - UNGUIDED) * brought / total);
        let choice = Distribution1D::new(&unguided.chain(guided).collect::<Vec<_>>());
        Some(EmissionGuide { choice, lights, gain: 1.0 })
    }

    /// Returns the probability of choosing an emitter.
    pub fn pmf(&self, emitter: usize) -> f32 {
        self.choice.pmf(emitter) + self.choice.pmf(self.lights.len() + emitter)
    }

    /// Samples a light ray as [`Scene::sample_light_start`] does, with the guide's density.
    pub fn sample_light_start(
        &self,
        scene: &Scene,
        u_choice: f32,
        [mut point, mut direction]: [Vec2; 2],
        time: f32,
    ) -> Option<(EmitterId, LightRay)> {
        let choice = self.choice.sample(u_choice)?.index;
        let (guided, index) = (choice >= self.lights.len(), choice % self.lights.len());
        let mut learned = 1.0;
        for (u, distribution) in [&mut point, &mut direction].into_iter().zip(&self.lights[index]) {
            let Some(distribution) = distribution else { continue };
            if guided {
                let (warped, pdf) = distribution.sample(*u)?;
                *u = warped.min(Vec2::splat(1f32.next_down()));
                learned *= pdf;
            } else {
                learned *= distribution.pdf(*u);
            }
        }
        // Guided and unguided paths can start this way, so their densities are added.
        let density = self.choice.pmf(index) + self.choice.pmf(self.lights.len() + index) * learned;
        let light = scene.lights[index].sample_ray_by_direction(point, direction, time)?;
        Some((EmitterId::from(index), LightRay { power: light.power / density, ..light }))
    }
}
