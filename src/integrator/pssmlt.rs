//! Metropolis light transport in primary sample space: Markov chains of random numbers, from which bidirectional paths
//! are traced. [Veach & Guibas 1997; Kelemen et al. 2002]
//!
//! Every sample of a pixel is a pass with chains of its own. A pass traces independent paths, and starts chains at some
//! of them, in proportion to the luminance `I` of what they contribute. A state that is so chosen already has the
//! density `I/b` of the chain, where `b` is the mean of `I` [Veach 1997, 11.3.1]. So chains need not run in, and short
//! ones suffice, as in energy redistribution [Cline et al. 2005]. Each state adds `b/I` times its contributions to the
//! film. Emitters that the camera sees, and light scattered once, are sampled by ordinary paths.

use super::bdpt::LensConnections;
use super::bdpt::technique::Techniques;
use super::bdpt::weights::Merged;
use super::photon::{EmissionGuide, PathSequence, VisibleSurfaces};
use super::preparation::Workers;
use super::progressive::{PreparedPass, Progressive, SamplePass};
use super::settings::{HiddenLight, PathLimits, PathSettings, Plugin, Source};
use super::worker::{draw_1d, draw_2d};
use super::{Integrator, PathIntegrator, Preparation, Radiance, RadianceQuery, Splat, Wave, Worker};
use crate::accel::Coherence;
use crate::error::{Error, Result};
use crate::math::{DVec2, Ray, Vec2};
use crate::memory::Reservation;
use crate::sampling::hash::{combine, pcg3d, to_unit};
use crate::sampling::{CHAIN_STEPS, Dimension, SampleKey};
use crate::scene::Scene;
use rayon::prelude::*;

/// The chains that one thread runs side by side, as a wave.
const SIDE_BY_SIDE: usize = 256;
/// The independent paths of a pass for each state of its chains.
const STARTS: f64 = 0.25;
/// The paths that are traced for the memory plan: how much a path contributes to depends on the scene.
const PILOT: u64 = 1024;
/// The stream of their random numbers.
const PILOT_STREAM: u32 = 7;
/// The greatest number of edges of the light that ordinary paths sample.
const ORDINARY_EDGES: u32 = 2;

/// The integrator. Its passes need [`Progressive::begin_sample`].
pub struct Pssmlt {
    limits: PathLimits,
    guide: Option<EmissionGuide>,
    /// Renders what the chains do not.
    ordinary: PathIntegrator,
    /// The reserved memory for the contributions of a pass.
    reserved: Option<Reservation>,
}

impl Pssmlt {
    /// Returns a tracer of states, for a film with the given margin.
    fn tracer<'a>(&'a self, preparation: &Preparation<'a>, margin: f64) -> StateTracer<'a> {
        let Preparation { scene, camera, .. } = *preparation;
        let query = RadianceQuery { emitted: false, direct: false, ..RadianceQuery::ALL };
        let (limits, merged) = (self.limits, Merged::default());
        StateTracer {
            lens: LensConnections {
                scene,
                camera,
                guide: self.guide.as_ref(),
                techniques: Techniques::All,
                limits,
                query,
                margin,
                merged,
                media: None,
                caustics: None,
            },
        }
    }
}

/// Returns the state at which a chain may start: path `i` of a sequence.
fn start(sequence: PathSequence, i: u64) -> SampleKey {
    let key = sequence.key(i);
    SampleKey { scramble: combine(key.scramble, key.index), index: 0, replicate: 0 }
}

impl Plugin for Pssmlt {
    const NAME: &'static str = "pssmlt";
    const HIDDEN_LIGHT: HiddenLight = HiddenLight::Direct;
    type Settings = PathLimits;

    fn read(source: &mut dyn Source) -> Result<PathLimits> {
        let elsewhere = ["bidirectional", "luminance_samples", "two_stage", "p_large", "direct_samples"];
        source.ignore(&elsewhere, "paths are bidirectional, and chains start at paths of their pass");
        PathLimits::read(source)
    }

    fn with_limits(limits: PathLimits) -> PathLimits {
        limits
    }

    fn limits(limits: &PathLimits) -> PathLimits {
        *limits
    }

    fn create(limits: &PathLimits) -> Box<dyn Integrator> {
        let max_depth = Some(limits.depth_within(ORDINARY_EDGES));
        let ordinary = PathIntegrator::new(PathSettings::independent(PathLimits { max_depth, ..*limits }));
        Box::new(Pssmlt { limits: *limits, guide: None, ordinary, reserved: None })
    }
}

impl Integrator for Pssmlt {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn shares_noise(&self) -> bool {
        true
    }

    fn shows_environment(&self) -> bool {
        !self.limits.hide_emitters
    }

    fn traces_light_paths(&self) -> bool {
        true
    }

    fn prepares(&self) -> bool {
        true
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        let visible_surfaces = VisibleSurfaces::of(preparation);
        self.guide = EmissionGuide::towards(&visible_surfaces, preparation, self.limits);
        let mut worker = Worker::new(preparation.sampler.mutated()).with_interrupt(preparation.interrupt);
        let sequence = PathSequence { seed: preparation.seed, stream: PILOT_STREAM, number: 0, first: 0 };
        let keys: Vec<SampleKey> = (0..PILOT).map(|i| start(sequence, i)).collect();
        let states = self.tracer(preparation, 0.0).trace(&keys, &mut worker);
        let sum = |f: &dyn Fn(&State) -> f64| states.iter().map(f).sum::<f64>();
        let importance = sum(&|state| state.importance.into()).max(f64::MIN_POSITIVE);
        let splats = sum(&|state| f64::from(state.importance) * state.splats.len() as f64) / importance;
        // Each step adds what the state and its mutation contribute.
        let steps = preparation.camera.film.full_area() as f64;
        let needed = 2.0 * splats * steps * Splat::BYTES_IN_A_PASS as f64;
        self.reserved = Some(preparation.memory.reserve(needed as u64).map_err(|refusal| {
            let what = "the contributions of the chains of a pass";
            Error::scene(refusal.sentence(what, "render a smaller image")).about(Self::NAME)
        })?);
        Ok(())
    }

    fn progressive(&self) -> Option<&dyn Progressive> {
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
        self.ordinary.li(scene, wave, query, worker, out);
    }
}

impl Progressive for Pssmlt {
    fn begin_sample(&self, pass: &SamplePass<'_>) -> PreparedPass {
        let mut prepared = PreparedPass { time: pass.time(), ..PreparedPass::default() };
        if !self.limits.allows(ORDINARY_EDGES + 1) {
            return prepared;
        }
        let Preparation { camera, sampler, pool, interrupt, .. } = *pass.preparation;
        let workers = Workers::new(pool, sampler.mutated(), interrupt).at_time(prepared.time);
        let tracer = self.tracer(pass.preparation, pass.margin);
        let pixels = camera.film.full_area();
        let chains = pixels.div_ceil(CHAIN_STEPS.into()) as usize;
        let starts = (pixels as f64 * STARTS).ceil() as u64;
        let sequence = pass.light_paths(starts);
        let start = |i: u64| start(sequence, i);
        pool.install(|| {
            let first: Vec<u64> = (0..starts).step_by(SIDE_BY_SIDE).collect();
            let traced: Vec<Vec<f32>> = first
                .into_par_iter()
                .map(|first| {
                    let keys: Vec<SampleKey> =
                        (first..starts.min(first + SIDE_BY_SIDE as u64)).map(start).collect();
                    workers.with(|worker| {
                        let states = tracer.trace(&keys, worker);
                        states.into_iter().map(|state| state.importance).collect()
                    })
                })
                .collect();
            let importance = traced.concat();
            let mean = importance.iter().map(|i| f64::from(*i)).sum::<f64>() / starts as f64;
            if mean == 0.0 {
                return;
            }
            let offset = to_unit(combine(start(0).scramble, 0x6d6c_7473));
            let chosen = choose(&importance, chains, offset.into());
            let states = chains as f64 * f64::from(CHAIN_STEPS);
            let weight = (mean * pixels as f64 / states) as f32;
            let batches: Vec<(usize, &[usize])> = chosen.chunks(SIDE_BY_SIDE).enumerate().collect();
            let traced: Vec<(Vec<Splat>, u64)> = batches
                .into_par_iter()
                .map(|(batch, chosen)| {
                    let key = |(i, start_index): (usize, &usize)| SampleKey {
                        replicate: (batch * SIDE_BY_SIDE + i) as u32,
                        ..start(*start_index as u64)
                    };
                    let keys: Vec<SampleKey> = chosen.iter().enumerate().map(key).collect();
                    workers.with(|worker| tracer.run_chains(keys, weight, worker))
                })
                .collect();
            for (splats, invalid) in traced {
                prepared.splats.push(splats);
                prepared.invalid += invalid;
            }
        });
        prepared.counters = workers.counters();
        prepared
    }
}

/// Chooses `count` indices in proportion to the weights, by systematic sampling with a uniform random offset.
fn choose(weights: &[f32], count: usize, offset: f64) -> Vec<usize> {
    let sum: f64 = weights.iter().map(|w| f64::from(*w)).sum();
    let mut chosen = Vec::with_capacity(count);
    let mut until = 0.0;
    for (i, weight) in weights.iter().enumerate() {
        until += f64::from(*weight);
        while chosen.len() < count && (chosen.len() as f64 + offset) * sum < until * count as f64 {
            chosen.push(i);
        }
    }
    // Rounding may leave the last one out.
    let last = weights.iter().rposition(|weight| *weight > 0.0).unwrap_or(0);
    chosen.resize(count, last);
    chosen
}

/// What the paths of one state contribute.
#[derive(Clone, Default)]
struct State {
    splats: Vec<Splat>,
    /// The luminance of all contributions: the density of the chain, but for a constant.
    importance: f32,
    /// Contributions that were dropped because they were not finite.
    invalid: u64,
}

impl State {
    fn add(&mut self, splat: Splat) {
        if !splat.value.is_valid() {
            self.invalid += 1;
        } else if !splat.value.is_black() {
            self.importance += splat.value.luminance();
            self.splats.push(splat);
        }
    }
}

/// Traces the paths of states.
struct StateTracer<'a> {
    lens: LensConnections<'a>,
}

impl StateTracer<'_> {
    /// Traces the paths of the state of each key.
    fn trace(&self, keys: &[SampleKey], worker: &mut Worker) -> Vec<State> {
        let LensConnections { scene, camera, margin, .. } = self.lens;
        let (mut positions, mut lens, mut times) = <([Vec<f32>; 2], [Vec<f32>; 2], Vec<f32>)>::default();
        draw_2d(worker.sampler, Dimension::PIXEL, keys, &mut positions);
        draw_2d(worker.sampler, Dimension::LENS, keys, &mut lens);
        if scene.needs.time && worker.time.is_none() {
            draw_1d(worker.sampler, Dimension::TIME, keys, &mut times);
        }
        let size = DVec2::new(camera.film.width.into(), camera.film.height.into());
        // The pixels at the border also see what is beyond it by the extent of the filter.
        let (low, wide) = (DVec2::splat(-margin), size + 2.0 * margin);
        let area = (wide.x * wide.y / (size.x * size.y)) as f32;
        let film = |i: usize| low + wide * DVec2::new(positions[0][i].into(), positions[1][i].into());
        let rays: Vec<Ray> = (0..keys.len())
            .map(|i| {
                let time = worker.time.unwrap_or_else(|| times.get(i).copied().unwrap_or(0.0));
                camera.ray(film(i), Vec2::new(lens[0][i], lens[1][i]), time)
            })
            .collect();
        let mut states = vec![State::default(); keys.len()];
        let mut radiance = vec![Radiance::NONE; keys.len()];
        let wave = Wave { rays: &rays, keys, coherence: Coherence::Incoherent, groups: &[] };
        self.lens.trace_pairs(wave, worker, &mut radiance, |i, splat| states[i as usize].add(splat));
        for (i, (state, radiance)) in states.iter_mut().zip(&radiance).enumerate() {
            state.add(Splat { film: film(i), value: radiance.value * area });
        }
        states
    }

    /// Runs a chain from each key. Returns the contributions of all states, each state with the weight `weight/I`, and
    /// the number of invalid ones.
    fn run_chains(&self, mut keys: Vec<SampleKey>, weight: f32, worker: &mut Worker) -> (Vec<Splat>, u64) {
        let mut out = Vec::new();
        let mut invalid = 0;
        let mut current = self.trace(&keys, worker);
        // The number of steps that a state has counted for.
        let mut counts = vec![0.0; keys.len()];
        let mut deposit = |state: &State, count: f32| {
            let scale = count * weight / state.importance;
            if count > 0.0 && scale.is_finite() {
                let scaled = |splat: &Splat| Splat { film: splat.film, value: splat.value * scale };
                out.extend(state.splats.iter().map(scaled));
            }
        };
        for step in 0..CHAIN_STEPS {
            if worker.interrupt.is_raised() {
                break;
            }
            let proposed: Vec<SampleKey> =
                keys.iter().map(|key| SampleKey { index: key.index | 1 << step, ..*key }).collect();
            for (i, state) in self.trace(&proposed, worker).into_iter().enumerate() {
                invalid += state.invalid;
                let accepted = (state.importance / current[i].importance).min(1.0);
                // Both states count, in proportion to the probabilities of going on with them.
                // [Veach 1997, 11.3.2]
                counts[i] += 1.0 - accepted;
                let [u, ..] = pcg3d(combine(keys[i].scramble, keys[i].replicate), step, 0x6163_6370);
                if to_unit(u) < accepted {
                    deposit(&current[i], counts[i]);
                    (current[i], keys[i], counts[i]) = (state, proposed[i], accepted);
                } else {
                    deposit(&state, accepted);
                }
            }
        }
        for (state, count) in current.iter().zip(&counts) {
            deposit(state, *count);
        }
        (out, invalid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Systematic sampling: each index appears as often as its share demands, rounded down or up.
    #[test]
    fn starts_are_chosen_in_proportion() {
        let weights = [0.0, 3.0, 1.0, 0.0, 0.5, 5.5, 0.0];
        for offset in [0.0, 0.3, 0.999_999_9] {
            for count in [1, 7, 100] {
                let chosen = choose(&weights, count, offset);
                assert_eq!(chosen.len(), count);
                for (i, weight) in weights.iter().enumerate() {
                    let n = chosen.iter().filter(|j| **j == i).count() as f64;
                    let expected = f64::from(*weight) / 10.0 * count as f64;
                    assert!((n - expected).abs() < 1.0 + 1e-6, "{count} {offset} {i}: {n}");
                }
            }
        }
    }
}
