//! Guided emission of light paths: a density learned from a pilot pass, sampled exactly. [after Jensen 2001, 5.3]
//!
//! A projection map marks the directions in which specular objects lie. Here this information is learned: a light
//! path is a point of a unit hypercube, and the pilot estimates which cells of the hypercube contribute photons where
//! they are needed. This works for all kinds of emitters, and for objects seen through mirrors. Powers are divided by
//! the density, so the result is unbiased even if the pilot missed contributions.

mod pilot;

pub use self::pilot::PathHistogram;
use self::pilot::{Learned, PilotResults};
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

/// The number of paths whose random numbers are drawn together.
const CHUNK: usize = 2048;
/// The stream of the pilot's random numbers. Photons have even streams.
const STREAM: u32 = 1;
/// The number of deposits for each pixel of the full image after which no more is learned: a small image is traced in
/// less time than the pilot.
const DEPOSITS_OF_A_PIXEL: u64 = 16;
/// The fraction of paths started without guiding: emitter, position and direction together. The power of a path is
/// therefore at most twice its unguided power, whatever the pilot missed.
const UNGUIDED: f64 = 0.5;

/// A density for starting light paths.
#[derive(Clone, Debug)]
pub struct EmissionGuide {
    /// The choice of the emitter: first for unguided paths, then for guided ones.
    choice: Distribution1D,
    lights: Vec<EmissionDensities>,
    /// See [`typical_density`](Self::typical_density).
    typical: Vec<f32>,
}

/// The densities over positions on an emitter and over directions; uniform if `None`.
type EmissionDensities = [Option<Distribution2D>; 2];

impl EmissionGuide {
    /// The number of light paths from which a guide is learned, unless a caller needs fewer.
    pub const PILOT: PathLimit = PathLimit { paths: 1 << 17, kept: None };

    /// Returns the guide that starts paths in proportion to the emitters' power.
    pub fn uniform(scene: &Scene) -> Self {
        let lights = scene.lights.iter().map(|_| [None, None]).collect();
        let typical = (0..scene.lights.len()).map(|i| scene.light_choice.pmf(i)).collect();
        EmissionGuide { choice: scene.light_choice.clone(), lights, typical }
    }

    /// Learns which starts of light paths within the limits bring scattered light to visible surfaces.
    pub fn towards(
        visible: &VisibleSurfaces,
        preparation: &Preparation<'_>,
        limits: PathLimits,
    ) -> Option<Self> {
        let Preparation { scene, camera, sampler, seed, pool, interrupt, .. } = *preparation;
        let tracer = LightPathTracer { scene, sampler, guide: None, pool, interrupt, time: None };
        let paths = PhotonPaths::scattered(limits);
        let until = PathLimit { kept: Some(DEPOSITS_OF_A_PIXEL * camera.film.full_area()), ..Self::PILOT };
        Self::learn(&tracer, &paths, until, seed, |deposit: &Deposit| visible.contains(deposit.p))
    }

    /// Learns which starts contribute power to the deposits selected by `wanted`. Returns `None` if there are none.
    pub fn learn(
        tracer: &LightPathTracer<'_>,
        paths: &PhotonPaths,
        until: PathLimit,
        seed: u64,
        wanted: impl Fn(&Deposit) -> bool + Sync,
    ) -> Option<Self> {
        let scene = tracer.scene;
        let uniform = EmissionGuide::uniform(scene);
        let pilot = LightPathTracer { guide: Some(&uniform), ..*tracer };
        let sequence = PathSequence { seed, stream: STREAM, number: 0, first: 0 };
        let power = |d: &Deposit, path: u64| wanted(d).then(|| (path, d.shading_power().max_component()));
        let cast = pilot.cast(paths, sequence, until, power);
        let mut brought = vec![0.0f32; cast.emitted as usize];
        for (path, power) in cast.kept {
            brought[path as usize] += power;
        }
        let mut found: Vec<PilotResults> = scene.lights.iter().map(|_| PilotResults::default()).collect();
        let worker = Worker::new(tracer.sampler);
        let mut numbers = EmissionNumbers::default();
        for (chunk, brought) in brought.chunks(CHUNK).enumerate() {
            let first = (chunk * CHUNK) as u64;
            let keys: Vec<SampleKey> = (0..brought.len() as u64).map(|i| sequence.key(first + i)).collect();
            numbers.draw(scene, &keys, &worker);
            for (i, brought) in brought.iter().enumerate() {
                let choice = scene.light_choice.sample(numbers.choice[i]);
                if let Some(choice) = choice {
                    // The contribution of the path, for the case that its emitter is the only one.
                    let pairs = numbers.pairs(i);
                    found[choice.index].add(pairs, f64::from(brought * choice.pmf));
                }
            }
        }
        Self::of(scene, &found)
    }

    fn of(scene: &Scene, found: &[PilotResults]) -> Option<Self> {
        let learned: Vec<Learned> = found.iter().map(PilotResults::best).collect();
        let total: f64 = learned.iter().map(|light| light.root_of_moment).sum();
        if !(total > 0.0 && total.is_finite()) || 2 * learned.len() > Distribution1D::MAX_ENTRIES {
            return None;
        }
        let unguided = (0..learned.len()).map(|i| UNGUIDED * f64::from(scene.light_choice.pmf(i)));
        let guided = learned.iter().map(|light| (1.0 - UNGUIDED) * light.root_of_moment / total);
        let choice = Distribution1D::new(&unguided.chain(guided).collect::<Vec<_>>());
        let pmf = |i: usize| f64::from(choice.pmf(i));
        let typical =
            |(i, light): (usize, &Learned)| light.typical_density(pmf(i), pmf(learned.len() + i)) as f32;
        let typical = learned.iter().enumerate().map(typical).collect();
        Some(EmissionGuide {
            choice,
            lights: learned.into_iter().map(|light| light.densities).collect(),
            typical,
        })
    }

    /// Returns the probability of choosing an emitter times the typical density of the starts from it that bring wanted
    /// light, relative to uniform random numbers. Weights use it as if all starts had it: the density of a given start
    /// is known to light paths only.
    pub fn typical_density(&self, emitter: usize) -> f32 {
        self.typical[emitter]
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
