//! The camera paths of a pass: a wave of paths, one bounce at a time.

use super::gather::{PhotonFilter, PhotonGather};
use crate::accel::Coherence;
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::integrator::block::ShadingBlock;
use crate::integrator::lighting::{self, TechniqueCounts};
use crate::integrator::path::first_hits;
use crate::integrator::path_wave::{Continuation, PathWave};
use crate::integrator::photon::GridPhoton;
use crate::integrator::roulette::Roulette;
use crate::integrator::settings::SppmSettings;
use crate::integrator::worker::{BounceNumbers, RandomNumbers, intersect};
use crate::integrator::{Radiance, RadianceQuery, Wave, Worker};
use crate::math::lanes::{LANES, bits, f32x16, load};
use crate::scene::Scene;

/// The state shared by all camera paths of a wave.
pub(super) struct CameraPaths<'a> {
    pub scene: &'a Scene,
    pub settings: &'a SppmSettings,
    pub query: RadianceQuery,
    pub gather: &'a PhotonGather<'a>,
}

/// The emission that a path may add, and whether the path continues.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CameraPathState {
    /// Dirac deltas only: all emission is added.
    Camera,
    /// A finite lobe last: emission is added with its weight against emitter samples.
    Finite,
    /// A finite lobe, then Dirac deltas: emission is not added, because photons contain it.
    Caustic,
    /// As [`Finite`](CameraPathState::Finite), but the path ends at the next surface, because photons contain the rest.
    Last,
}

impl CameraPathState {
    /// Returns the state after a Dirac delta.
    fn after_delta(self) -> CameraPathState {
        match self {
            CameraPathState::Camera => CameraPathState::Camera,
            _ => CameraPathState::Caustic,
        }
    }
}

/// Returns whether indirect light at a surface with the given BSDF comes from photons.
fn gathers(bsdf: &Bsdf<'_>) -> bool {
    match bsdf {
        Bsdf::Null | Bsdf::Conductor(_) | Bsdf::Dielectric(_) | Bsdf::ThinDielectric(_) => false,
        Bsdf::RoughConductor(_) | Bsdf::RoughDielectric(_) | Bsdf::Hair(_) => false,
        Bsdf::Measured(_) => false,
        Bsdf::Diffuse(_) | Bsdf::Plastic(_) | Bsdf::RoughPlastic(_) => true,
        Bsdf::Principled(_) | Bsdf::PrincipledThin(_) | Bsdf::PolarizedPlastic(_) => true,
        Bsdf::DiffuseTransmitter(_) | Bsdf::RoughDiffuse(_) | Bsdf::Phong(_) | Bsdf::Ward(_) => true,
        Bsdf::Blend(b) => b.bsdfs.iter().any(|b| gathers(b)),
        Bsdf::Coating(b) => gathers(b.inner),
        Bsdf::Mask(b) => gathers(b.inner),
        Bsdf::Tilted(b) => gathers(b.inner),
        Bsdf::TwoSided(b) => b.sides.iter().any(|b| gathers(b)),
    }
}

impl CameraPaths<'_> {
    fn allows(&self, edges: u32) -> bool {
        self.settings.limits.allows(edges)
    }

    /// Returns whether emission found by a path with the given number of edges is added.
    fn wants(&self, state: CameraPathState, edges: u32) -> bool {
        match state {
            CameraPathState::Camera if edges == 1 => {
                self.query.emitted && !self.settings.limits.hide_emitters
            }
            CameraPathState::Camera if self.query.separates_caustics() => self.query.caustic,
            CameraPathState::Caustic => false,
            _ => self.query.wants(edges),
        }
    }

    /// Estimates the radiance along each ray of the wave.
    pub fn trace(&self, wave: Wave<'_>, worker: &mut Worker, out: &mut [Radiance]) {
        let scene = self.scene;
        out.fill(Radiance::NONE);
        worker.paths.begin(wave.rays, wave.keys);
        let mut states = vec![CameraPathState::Camera; out.len()];
        let mut edges = 1;
        while !worker.paths.rays.is_empty() && self.allows(edges) && !worker.interrupt.is_raised() {
            let coherence = if edges == 1 { wave.coherence } else { Coherence::Incoherent };
            intersect(scene, &worker.paths.rays, coherence, &mut worker.hits, &mut worker.counters);
            if edges == 1 {
                first_hits(scene, self.settings.limits.hide_emitters, worker, out);
            }
            let Worker { paths, hits, numbers, sampler, .. } = &mut *worker;
            let wants = |paths: &PathWave, i: usize| self.wants(states[paths.slots[i] as usize], edges);
            lighting::drop_missed(self.scene, paths, hits, out, TechniqueCounts::ONE_EACH, wants);
            let scatter = self.allows(edges + 1);
            let uses = BounceNumbers {
                next_event: self.next_event(edges),
                lobe: scatter,
                direction: scatter,
                roulette: scatter,
            };
            numbers.draw(uses, edges - 1, *sampler, &paths.keys);
            self.shade(edges, &mut states, worker, out);
            worker.trace_shadows(scene, coherence, |slot, value| out[slot].value += value);
            edges += 1;
        }
    }

    fn next_event(&self, edges: u32) -> bool {
        TechniqueCounts::ONE_EACH.samples_emitters(self.scene)
            && self.allows(edges + 1)
            && self.query.wants(edges + 1)
    }

    /// Shades every path of the wave, block by block, and moves the continuing paths to the front.
    fn shade(&self, edges: u32, states: &mut [CameraPathState], worker: &mut Worker, out: &mut [Radiance]) {
        let Worker { hits, shadows, paths, numbers, arena, .. } = worker;
        let mut alive = 0;
        for first in (0..hits.len()).step_by(LANES) {
            arena.reset();
            let block = ShadingBlock::new(self.scene, arena, &paths.rays, hits, first);
            for (i, le) in lighting::emitted(self.scene, &block, paths, TechniqueCounts::ONE_EACH) {
                let slot = paths.slots[first + i] as usize;
                if self.wants(states[slot], edges) {
                    out[slot].value += paths.beta(first + i) * le;
                }
            }
            let state = |i: usize| states[paths.slots[first + i] as usize];
            let going =
                bits(block.active).fold(0, |b, i| b | u32::from(state(i) != CameraPathState::Last) << i);
            if going == 0 || !self.allows(edges + 1) {
                continue;
            }
            for i in bits(going & block.finite) {
                let value = self.gathered(edges, &block, i);
                out[paths.slots[first + i] as usize].value += paths.beta(first + i) * value;
            }
            if self.next_event(edges) && going & block.finite != 0 {
                let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], first));
                let counts = TechniqueCounts::ONE_EACH;
                let sampled = lighting::sample_emitters(self.scene, &block, u_point, counts);
                let value = std::array::from_fn(|c| load(&paths.beta[c], first) * sampled.value[c]);
                shadows.push(&sampled.rays, &paths.slots[first..], &value, sampled.lanes & going);
            }
            let (next, survivors) = self.scatter(edges, &block, going, paths, numbers);
            let survivors = self.may_find_light(&block, &next, survivors);
            for i in bits(survivors) {
                let state = &mut states[paths.slots[first + i] as usize];
                *state = match next.pdf.as_array()[i].is_infinite() {
                    true => state.after_delta(),
                    false if gathers(block.bsdfs[i]) => CameraPathState::Last,
                    false => CameraPathState::Finite,
                };
            }
            alive = paths.compact(first, alive, &next, survivors);
        }
        paths.truncate(alive);
    }

    /// Returns the lanes of `survivors` that may still find light. If photons contain the rest, these are the rays
    /// that can hit emitters.
    fn may_find_light(&self, block: &ShadingBlock<'_>, next: &Continuation, survivors: u32) -> u32 {
        if self.scene.needs.hit_emitters || self.scene.needs.environment {
            return survivors;
        }
        let vain = |i: &usize| next.pdf.as_array()[*i].is_finite() && gathers(block.bsdfs[*i]);
        bits(survivors).filter(vain).fold(survivors, |lanes, i| lanes & !(1 << i))
    }

    /// Returns the radiance from photons at a point.
    fn gathered(&self, edges: u32, block: &ShadingBlock<'_>, i: usize) -> Rgb {
        if !self.query.indirect {
            return Rgb::BLACK;
        }
        let max_edges = self.settings.limits.max_depth.map_or(u32::MAX, |max| max - edges);
        let max_edges = if max_edges >= GridPhoton::MOST_EDGES { u32::MAX } else { max_edges };
        let filter = PhotonFilter { max_edges, indirect: gathers(block.bsdfs[i]) };
        self.gather.radiance(block, i, filter)
    }

    /// Samples the BSDFs and applies Russian roulette; returns the continuations and a mask of the surviving lanes.
    #[inline(always)]
    fn scatter(
        &self,
        edges: u32,
        block: &ShadingBlock<'_>,
        going: u32,
        paths: &PathWave,
        numbers: &RandomNumbers,
    ) -> (Continuation, u32) {
        let first = block.first;
        let u_lobe = load(&numbers.bsdf_lobe, first);
        let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], first));
        let sample = bsdf::lanes::sample_x16(&block.bsdfs, &block.wo, u_lobe, u, going);
        let mut beta: [f32x16; 3] = std::array::from_fn(|c| load(&paths.beta[c], first) * sample.weight[c]);
        let eta = load(&paths.eta, first) * sample.eta;
        let strongest = beta[0].fast_max(beta[1]).fast_max(beta[2]);
        let mut alive = sample.valid & strongest.simd_ne(f32x16::ZERO);
        if let Some(roulette) = Roulette::at(edges, self.settings.limits.rr_depth) {
            // `eta²` removes the scaling of radiance inside a dielectric, which does not change a path's importance.
            let on;
            (beta, on) = roulette.play_x16(beta, eta * eta, load(&numbers.roulette, first));
            alive &= on;
        }
        let wi = block.at.frame.to_world(sample.wi);
        let rays = self.scene.spawn_rays(&block.at, wi, block.rays.time);
        (
            Continuation { rays, from: block.at.p, gloss: None, beta, pdf: sample.pdf, eta },
            alive.to_bitmask() & going,
        )
    }
}
