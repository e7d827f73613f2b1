//! Where light paths should begin: learned from a pilot, drawn with its exact density. [after Jensen 2001, 5.3]
//!
//! A projection map marks the directions in which specular objects lie. Here the marks are learned: light paths are
//! points of a unit hypercube, and a pilot finds which of its cells bring photons to where they are wanted. So every kind
//! of emitter is guided alike, and objects are found in mirrors, too. Powers are divided by the density, so nothing
//! is biased, whatever the pilot has missed.

mod pilot;

use self::pilot::Findings;
use super::cast::{Caster, PathSequence, Until};
use super::tracing::{Deposit, PhotonPaths};
use crate::emitter::LightRay;
use crate::integrator::Worker;
use crate::integrator::light_path::EmissionNumbers;
use crate::math::Vec2;
use crate::sampling::{Distribution1D, Distribution2D, SampleKey};
use crate::scene::Scene;

/// Light paths of the pilot.
const PILOT: u64 = 1 << 17;
/// Paths whose numbers are drawn together.
const CHUNK: usize = 2048;
/// The stream of its numbers; photons have even streams.
const STREAM: u32 = 1;
/// The share of the paths that begin as they would without a guide: emitter, position and direction together, so that no path
/// is more than twice as strong as it would be then, whatever the pilot has missed.
const UNGUIDED: f64 = 0.5;

/// A density of the beginnings of light paths.
#[derive(Clone, Debug)]
pub struct EmissionGuide {
    /// Which emitter: of paths that are not guided, then of those that are.
    choice: Distribution1D,
    lights: Vec<Beginnings>,
}

/// Densities over the positions and the directions of an emitter; uniform where there is none.
type Beginnings = [Option<Distribution2D>; 2];

impl EmissionGuide {
    /// The guide that begins paths in proportion to the emitters' light.
    pub fn uniform(scene: &Scene) -> Self {
        let lights = scene.lights.iter().map(|_| [None, None]).collect();
        EmissionGuide { choice: scene.light_choice.clone(), lights }
    }

    /// Learns which beginnings bring power to deposits that are wanted. `None` where none did.
    pub fn learn(
        caster: &Caster<'_>,
        paths: &PhotonPaths,
        seed: u64,
        wanted: impl Fn(&Deposit) -> bool + Sync,
    ) -> Option<Self> {
        let scene = caster.scene;
        let uniform = EmissionGuide::uniform(scene);
        let pilot = Caster { guide: Some(&uniform), ..*caster };
        let sequence = PathSequence { seed, stream: STREAM, number: 0, first: 0 };
        let until = Until { paths: PILOT, kept: None };
        let power = |d: &Deposit, path: u64| wanted(d).then(|| (path, d.shading_power().max_component()));
        let cast = pilot.cast(paths, sequence, until, power);
        let mut brought = vec![0.0f32; cast.emitted as usize];
        for (path, power) in cast.kept {
            brought[path as usize] += power;
        }
        let mut found: Vec<Findings> = scene.lights.iter().map(|_| Findings::default()).collect();
        let worker = Worker::new(caster.sampler);
        let mut numbers = EmissionNumbers::default();
        for (chunk, brought) in brought.chunks(CHUNK).enumerate() {
            let first = (chunk * CHUNK) as u64;
            let keys: Vec<SampleKey> = (0..brought.len() as u64).map(|i| sequence.key(first + i)).collect();
            numbers.draw(scene, &keys, &worker);
            for (i, brought) in brought.iter().enumerate() {
                if let Some(choice) = scene.light_choice.sample(numbers.choice[i]) {
                    // What the path has brought were its emitter the only one.
                    found[choice.index].add(numbers.pairs(i), f64::from(brought * choice.pmf));
                }
            }
        }
        Self::of(scene, &found)
    }

    fn of(scene: &Scene, found: &[Findings]) -> Option<Self> {
        let (lights, brought): (Vec<_>, Vec<_>) = found.iter().map(Findings::best).unzip();
        let total: f64 = brought.iter().sum();
        if !(total > 0.0 && total.is_finite()) || 2 * lights.len() > Distribution1D::MOST {
            return None;
        }
        let unguided = (0..lights.len()).map(|i| UNGUIDED * f64::from(scene.light_choice.pmf(i)));
        let guided = brought.iter().map(|brought| (1.0 - UNGUIDED) * brought / total);
        let choice = Distribution1D::new(&unguided.chain(guided).collect::<Vec<_>>());
        Some(EmissionGuide { choice, lights })
    }

    /// As [`Scene::sample_light_ray`], by the guide's density.
    pub fn sample_light_ray(
        &self,
        scene: &Scene,
        u_choice: f32,
        [mut point, mut direction]: [Vec2; 2],
        time: f32,
    ) -> Option<LightRay> {
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
        // Both kinds of paths might have begun so.
        let density = self.choice.pmf(index) + self.choice.pmf(self.lights.len() + index) * learned;
        let light = scene.lights[index].sample_ray_by_direction(point, direction, time)?;
        Some(LightRay { power: light.power / density, ..light })
    }
}
