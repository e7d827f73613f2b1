//! The path integrator. [Kajiya 1986; Veach 1997]
//!
//! A wave of paths advances one bounce at a time: it finds all nearest hits, then shades in blocks of sixteen, then
//! traces all shadow rays. In shading, each path adds at most one shadow ray with its pending contribution and at
//! most one next ray, and terminated paths are removed.

use super::block::ShadingBlock;
use super::lighting::{self, TechniqueCounts};
use super::roulette::Roulette;
use super::settings::{PathLimits, Plugin, Source};
use super::worker::{BounceNumbers, Continuation, RandomNumbers, ShadowQueue, intersect};
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker, emission};
use crate::accel::Coherence;
use crate::bsdf;
use crate::error::Result;
use crate::math::lanes::{LANES, bits, f32x16, load};
use crate::scene::Scene;

/// Unidirectional path tracing with next-event estimation, combined by the power heuristic.
pub struct PathIntegrator {
    settings: PathLimits,
}

/// The state shared by all paths of a bounce.
struct PathBounce<'a> {
    scene: &'a Scene,
    /// Whether emitters are sampled at this bounce.
    next_event: bool,
    /// Whether emission found by the rays of this bounce is added.
    add_emission: bool,
    /// Whether emission is added for rays with specular lobes only, if caustics are separated.
    add_caustics: Option<bool>,
    /// Russian roulette, if it applies at this bounce.
    roulette: Option<Roulette>,
}

impl PathIntegrator {
    /// Creates the integrator.
    pub fn new(settings: PathLimits) -> Self {
        PathIntegrator { settings }
    }

    /// Returns whether a path may have the given number of edges.
    fn allows(&self, edges: u32) -> bool {
        self.settings.allows(edges)
    }
}

impl Plugin for PathIntegrator {
    const NAME: &'static str = "path";
    type Settings = PathLimits;

    fn read(source: &mut dyn Source) -> Result<PathLimits> {
        PathLimits::read(source)
    }

    fn with_limits(limits: PathLimits) -> PathLimits {
        limits
    }

    fn limits(limits: &PathLimits) -> PathLimits {
        *limits
    }

    fn create(settings: &PathLimits) -> Box<dyn Integrator> {
        Box::new(PathIntegrator::new(*settings))
    }
}

impl Integrator for PathIntegrator {
    fn name(&self) -> &'static str {
        "path"
    }

    fn shows_environment(&self) -> bool {
        !self.settings.hide_emitters
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        out.fill(Radiance::NONE);
        worker.paths.begin(wave.rays, wave.keys);
        worker.specular_only.clear();
        worker.specular_only.resize(if query.separates_caustics() { out.len() } else { 0 }, true);
        let samples_emitters = TechniqueCounts::ONE_EACH.samples_emitters(scene);
        let mut depth = 0;
        while !worker.paths.rays.is_empty() && self.allows(depth + 1) && !worker.interrupt.is_raised() {
            let coherence = if depth == 0 { wave.coherence } else { Coherence::Incoherent };
            intersect(scene, &worker.paths.rays, coherence, &mut worker.hits, &mut worker.counters);
            if depth == 0 {
                first_hits(scene, self.settings.hide_emitters, worker, out);
            }
            let bounce = PathBounce {
                scene,
                next_event: samples_emitters && self.allows(depth + 2) && query.wants(depth + 2),
                add_emission: query.wants(depth + 1) && !(depth == 0 && self.settings.hide_emitters),
                add_caustics: (depth > 0 && query.separates_caustics()).then_some(query.caustic),
                roulette: Roulette::at(depth + 1, self.settings.rr_depth),
            };
            let Worker { paths, hits, numbers, specular_only, sampler, .. } = &mut *worker;
            lighting::drop_missed(scene, paths, hits, out, TechniqueCounts::ONE_EACH, |paths, i| {
                bounce.adds(specular_only, paths.slots[i])
            });
            let scatter = self.allows(depth + 2) && (query.direct || query.indirect || query.caustic);
            if scatter {
                let uses = BounceNumbers {
                    next_event: bounce.next_event,
                    lobe: scene.needs.lobe_choice,
                    direction: true,
                    roulette: bounce.roulette.is_some(),
                };
                numbers.draw(uses, depth, *sampler, &paths.keys);
            }
            bounce.shade(scatter, worker, out);
            if bounce.next_event {
                worker.trace_shadows(scene, coherence, |slot, value| out[slot].value += value);
            }
            depth += 1;
        }
    }
}

/// Writes the distances of the first surfaces, behind hidden emitters if `hide_emitters` is true.
pub(super) fn first_hits(scene: &Scene, hide_emitters: bool, worker: &mut Worker, out: &mut [Radiance]) {
    for (out, hit) in out.iter_mut().zip(&worker.hits) {
        out.distance = hit.map_or(f32::INFINITY, |h| h.t);
    }
    if hide_emitters && scene.needs.hit_emitters {
        let Worker { paths, hits, counters, .. } = worker;
        let passed = emission::skip_emitters(scene, &mut paths.rays, hits, counters);
        for ((out, hit), passed) in out.iter_mut().zip(&*hits).zip(passed) {
            out.distance = hit.map_or(f32::INFINITY, |h| passed + h.t);
        }
    }
}

impl PathBounce<'_> {
    /// Returns whether emission found by the path of a slot is added.
    #[inline(always)]
    fn adds(&self, specular_only: &[bool], slot: u32) -> bool {
        match self.add_caustics {
            Some(caustics) if specular_only[slot as usize] => caustics,
            _ => self.add_emission,
        }
    }

    /// Returns whether emission may be added for any path.
    #[inline(always)]
    fn may_add(&self) -> bool {
        self.add_emission || self.add_caustics == Some(true)
    }

    /// Shades every path of the wave, block by block, and moves the continuing paths to the front.
    fn shade(&self, scatter: bool, worker: &mut Worker, out: &mut [Radiance]) {
        let Worker { hits, shadows, paths, numbers, arena, specular_only, .. } = worker;
        let mut alive = 0;
        for first in (0..hits.len()).step_by(LANES) {
            arena.reset();
            let block = ShadingBlock::new(self.scene, arena, &paths.rays, hits, first);
            if self.may_add() {
                for (i, le) in lighting::emitted(self.scene, &block, paths, TechniqueCounts::ONE_EACH) {
                    let slot = paths.slots[first + i];
                    if self.adds(specular_only, slot) {
                        out[slot as usize].value += paths.beta(first + i) * le;
                    }
                }
            }
            if scatter {
                let beta = [0, 1, 2].map(|c| load(&paths.beta[c], first));
                if self.next_event && block.finite != 0 {
                    self.light(&block, &beta, &paths.slots[first..], numbers, shadows);
                }
                let (next, survivors) = self.scatter(&block, beta, load(&paths.eta, first), numbers);
                if !specular_only.is_empty() {
                    for i in bits(survivors) {
                        let only = &mut specular_only[paths.slots[first + i] as usize];
                        *only &= next.pdf.as_array()[i].is_infinite();
                    }
                }
                alive = paths.compact(first, alive, &next, survivors);
            }
        }
        paths.truncate(alive);
    }

    /// Queues a shadow ray from each point of the block.
    #[inline(always)]
    fn light(
        &self,
        block: &ShadingBlock<'_>,
        beta: &[f32x16; 3],
        slots: &[u32],
        numbers: &RandomNumbers,
        shadows: &mut ShadowQueue,
    ) {
        let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], block.first));
        let sampled = lighting::sample_emitters(self.scene, block, u_point, TechniqueCounts::ONE_EACH);
        let value = std::array::from_fn(|c| beta[c] * sampled.value[c]);
        shadows.push(&sampled.rays, slots, &value, sampled.lanes);
    }

    /// Samples the BSDFs and applies Russian roulette; returns the continuations and a mask of the surviving lanes.
    #[inline(always)]
    fn scatter(
        &self,
        block: &ShadingBlock<'_>,
        beta: [f32x16; 3],
        eta: f32x16,
        numbers: &RandomNumbers,
    ) -> (Continuation, u32) {
        let u_lobe = load(&numbers.bsdf_lobe, block.first);
        let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], block.first));
        let sample = bsdf::lanes::sample_x16(&block.bsdfs, &block.wo, u_lobe, u, block.active);
        let mut beta: [f32x16; 3] = std::array::from_fn(|c| beta[c] * sample.weight[c]);
        let eta = eta * sample.eta;
        let strongest = beta[0].fast_max(beta[1]).fast_max(beta[2]);
        let mut alive = sample.valid & strongest.simd_ne(f32x16::ZERO);
        if let Some(roulette) = self.roulette {
            // `eta²` removes the scaling of radiance inside a dielectric, which does not change a path's importance.
            let on;
            (beta, on) = roulette.play_x16(beta, eta * eta, load(&numbers.roulette, block.first));
            alive &= on;
        }
        let wi = block.at.frame.to_world(sample.wi);
        let rays = self.scene.spawn_rays(&block.at, wi, block.rays.time);
        (
            Continuation { rays, from: block.at.p, beta, pdf: sample.pdf, eta },
            alive.to_bitmask() & block.active,
        )
    }
}
