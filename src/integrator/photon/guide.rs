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
/// Paths whose numbers are drawn together.
const CHUNK: usize = 2048;
/// The stream of its numbers; photons have the stream 0.
const STREAM: u32 = 1;
/// The share of the paths that begin as they would without a guide, for each of emitter, position and direction.
const UNGUIDED: f64 = 0.5;

/// A density of the beginnings of light paths.
#[derive(Clone, Debug)]
pub struct EmissionGuide {
    choice: Distribution1D,
    lights: Vec<Beginnings>,
}

/// Densities over the positions and the directions of an emitter; uniform where there is none.
type Beginnings = [Option<Distribution2D>; 2];

/// What the pilot has found in the cells of a unit square.
struct Square {
    squares: Vec<f64>,
    counts: Vec<u32>,
}

/// A path of the pilot that has brought something: from where on its emitter, in which direction, and how much, W.
struct Success {
    pairs: [Vec2; 2],
    value: f64,
}

/// What the pilot has found out about an emitter.
struct Found {
    squares: [Square; 2],
    successes: Vec<Success>,
    paths: u64,
}

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
        let sequence = PathSequence { seed, stream: STREAM, half: 0, first: 0 };
        let until = Until { paths: PILOT, kept: None };
        let power = |d: &Deposit, path: u64| wanted(d).then(|| (path, d.shading_power().max_component()));
        let cast = pilot.cast(paths, sequence, until, power);
        let mut brought = vec![0.0f32; cast.emitted as usize];
        for (path, power) in cast.kept {
            brought[path as usize] += power;
        }
        let mut found: Vec<Found> = scene.lights.iter().map(|_| Found::nothing()).collect();
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

    fn of(scene: &Scene, found: &[Found]) -> Option<Self> {
        let (lights, brought): (Vec<_>, Vec<_>) = found.iter().map(Found::best).unzip();
        let total: f64 = brought.iter().sum();
        if !(total > 0.0 && total.is_finite()) {
            return None;
        }
        let mix = |(i, brought): (usize, &f64)| {
            UNGUIDED * f64::from(scene.light_choice.pmf(i)) + (1.0 - UNGUIDED) * brought / total
        };
        let choice = Distribution1D::covering(&brought.iter().enumerate().map(mix).collect::<Vec<_>>());
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
        let choice = self.choice.sample(u_choice)?;
        let mut density = choice.pmf;
        let [points, directions] = &self.lights[choice.index];
        for (u, distribution) in [(&mut point, points), (&mut direction, directions)] {
            if let Some(distribution) = distribution {
                let (warped, pdf) = distribution.sample(*u)?;
                *u = warped.min(Vec2::splat(1f32.next_down()));
                density *= pdf;
            }
        }
        let light = scene.lights[choice.index].sample_ray_by_direction(point, direction, time)?;
        Some(LightRay { power: light.power / density, ..light })
    }
}

impl Found {
    fn nothing() -> Self {
        Found { squares: [Square::new(), Square::new()], successes: Vec::new(), paths: 0 }
    }

    fn add(&mut self, pairs: [Vec2; 2], value: f64) {
        for (square, u) in self.squares.iter_mut().zip(pairs) {
            square.add(u, value);
        }
        if value > 0.0 {
            self.successes.push(Success { pairs, value });
        }
        self.paths += 1;
    }

    /// The densities that would have made the second moment of the pilot's paths least, and its root then. Positions and
    /// directions are taken for independent; where they are not, one density or none may be better than both.
    fn best(&self) -> (Beginnings, f64) {
        let learned = self.squares.each_ref().map(Square::distribution);
        let moment = |[points, directions]: &Beginnings| {
            let density = |distribution: &Option<Distribution2D>, u: Vec2| match distribution {
                Some(distribution) => f64::from(distribution.pdf(u)),
                None => 1.0,
            };
            let squares = self.successes.iter().map(|success| {
                let [point, direction] = success.pairs;
                success.value * success.value / (density(points, point) * density(directions, direction))
            });
            squares.sum::<f64>() / self.paths.max(1) as f64
        };
        let pick = |i: usize, yes: bool| if yes { learned[i].clone() } else { None };
        let choices = [(false, false), (false, true), (true, false), (true, true)];
        let all = choices.map(|(point, direction)| [pick(0, point), pick(1, direction)]);
        let least = all.into_iter().map(|beginnings| (moment(&beginnings), beginnings));
        match least.min_by(|(a, _), (b, _)| a.total_cmp(b)) {
            Some((moment, beginnings)) => (beginnings, moment.sqrt()),
            None => ([None, None], 0.0),
        }
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

    /// `None` where nothing was found.
    fn distribution(&self) -> Option<Distribution2D> {
        let mean = self.mean();
        let weights: Vec<f64> = self.deviations().map(|v| UNGUIDED * mean + (1.0 - UNGUIDED) * v).collect();
        (mean > 0.0).then(|| Distribution2D::new(CELLS, CELLS, &weights))
    }
}
