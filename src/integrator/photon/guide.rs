//! Where light paths should begin: learned from a pilot, drawn with its exact density. [after Jensen 2001, 5.3]
//!
//! A projection map marks the directions in which specular objects lie. Here the marks are learned: light paths are
//! points of a unit hypercube, and a pilot finds which of its cells bring photons to where they are wanted. So every kind
//! of emitter is guided alike, and objects are found in mirrors, too. Powers are divided by the density, so nothing
//! is biased, whatever the pilot has missed.

use super::cast::{Caster, PathSequence, Until};
use super::tracing::{Deposit, PhotonPaths};
use crate::emitter::LightRay;
use crate::integrator::Worker;
use crate::integrator::light_path::EmissionNumbers;
use crate::math::Vec2;
use crate::sampling::{Distribution1D, Distribution2D, SampleKey};
use crate::scene::Scene;

/// Cells along each axis of the unit squares of positions and directions.
const CELLS: usize = 64;
/// Light paths of the pilot.
const PILOT: u64 = 1 << 17;
/// The stream of its numbers; photons have the stream 0.
const STREAM: u32 = 1;
/// The share of the paths that begin as they would without a guide, for each of emitter, position and direction.
const UNGUIDED: f64 = 0.25;

/// A density of the beginnings of light paths.
#[derive(Clone, Debug)]
pub struct EmissionGuide {
    choice: Distribution1D,
    /// Over the positions and the directions of each emitter that has brought anything.
    lights: Vec<Option<[Distribution2D; 2]>>,
}

/// What the pilot has found in the cells of a unit square.
struct Square {
    squares: Vec<f64>,
    counts: Vec<u32>,
}

impl EmissionGuide {
    /// Learns which beginnings bring power to deposits that are wanted. `None` where none did.
    pub fn learn(
        caster: &Caster<'_>,
        paths: &PhotonPaths,
        seed: u64,
        wanted: impl Fn(&Deposit) -> bool + Sync,
    ) -> Option<Self> {
        let unguided = Caster { guide: None, ..*caster };
        let sequence = PathSequence { seed, stream: STREAM, half: 0, first: 0 };
        let until = Until { paths: PILOT, kept: None };
        let power = |d: &Deposit, path: u64| wanted(d).then(|| (path, d.shading_power().max_component()));
        let cast = unguided.cast(paths, sequence, until, power);
        let mut brought = vec![0.0f32; cast.emitted as usize];
        for (path, power) in cast.kept {
            brought[path as usize] += power;
        }
        let scene = caster.scene;
        let mut lights: Vec<[Square; 2]> =
            scene.lights.iter().map(|_| [Square::new(), Square::new()]).collect();
        let mut worker = Worker::new(caster.sampler);
        let mut numbers = EmissionNumbers::default();
        for (chunk, brought) in brought.chunks(2048).enumerate() {
            let first = chunk as u64 * 2048;
            let keys: Vec<SampleKey> = (0..brought.len() as u64).map(|i| sequence.key(first + i)).collect();
            numbers.draw(scene, &keys, &mut worker);
            for (i, brought) in brought.iter().enumerate() {
                let Some(choice) = scene.light_choice.sample(numbers.choice[i]) else { continue };
                // What the emitter has brought were it the only one.
                let value = f64::from(brought * choice.pmf);
                for (square, u) in lights[choice.index].iter_mut().zip(numbers.pairs(i)) {
                    square.add(u, value);
                }
            }
        }
        Self::of(scene, &lights)
    }

    fn of(scene: &Scene, lights: &[[Square; 2]]) -> Option<Self> {
        let brought: Vec<f64> = lights.iter().map(|[_, directions]| directions.mean()).collect();
        let total: f64 = brought.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let mix = |(i, brought): (usize, &f64)| {
            UNGUIDED * f64::from(scene.light_choice.pmf(i)) + (1.0 - UNGUIDED) * brought / total
        };
        let choice = Distribution1D::new(&brought.iter().enumerate().map(mix).collect::<Vec<_>>());
        let guide = |(squares, brought): (&[Square; 2], &f64)| {
            (*brought > 0.0).then(|| squares.each_ref().map(Square::distribution))
        };
        Some(EmissionGuide { choice, lights: lights.iter().zip(&brought).map(guide).collect() })
    }

    /// As [`Scene::sample_light_ray`], by the guide's density.
    pub fn sample_light_ray(
        &self,
        scene: &Scene,
        u_choice: f32,
        [mut point, mut direction]: [Vec2; 2],
        time: f32,
    ) -> Option<LightRay> {
        let choice = self.choice.sample(u_choice)?;
        let mut density = choice.pmf;
        if let Some([points, directions]) = &self.lights[choice.index] {
            for (u, distribution) in [(&mut point, points), (&mut direction, directions)] {
                let (warped, pdf) = distribution.sample(*u)?;
                *u = warped.min(Vec2::splat(1f32.next_down()));
                density *= pdf;
            }
        }
        let light = scene.lights[choice.index].sample_ray(point, direction, time)?;
        Some(LightRay { power: light.power / density, ..light })
    }
}

impl Square {
    fn new() -> Self {
        Square { squares: vec![0.0; CELLS * CELLS], counts: vec![0; CELLS * CELLS] }
    }

    fn add(&mut self, u: Vec2, value: f64) {
        let [x, y] = (u * CELLS as f32).to_array().map(|x| (x as usize).min(CELLS - 1));
        self.squares[y * CELLS + x] += value * value;
        self.counts[y * CELLS + x] += 1;
    }

    /// The root of the second moment in each cell: the density with the least variance. 0 where no path was.
    fn deviations(&self) -> impl Iterator<Item = f64> + '_ {
        self.squares.iter().zip(&self.counts).map(|(sum, &n)| (sum / f64::from(n.max(1))).sqrt())
    }

    fn mean(&self) -> f64 {
        self.deviations().sum::<f64>() / (CELLS * CELLS) as f64
    }

    fn distribution(&self) -> Distribution2D {
        let mean = self.mean();
        let weights: Vec<f64> = self.deviations().map(|v| UNGUIDED * mean + (1.0 - UNGUIDED) * v).collect();
        Distribution2D::new(CELLS, CELLS, &weights)
    }
}
