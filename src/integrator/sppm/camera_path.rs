//! The camera's part of a pass: a wave of paths, one bounce at a time.

use super::gather::{Gather, Wanted};
use crate::accel::Coherence;
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::integrator::block::Block;
use crate::integrator::lighting::{self, TechniqueCounts};
use crate::integrator::path::first_hits;
use crate::integrator::photon::GridPhoton;
use crate::integrator::roulette::Roulette;
use crate::integrator::settings::SppmSettings;
use crate::integrator::worker::{Continuation, Numbers, PathWave, draw_1d, draw_2d, intersect};
use crate::integrator::{Radiance, RadianceQuery, Wave, Worker};
use crate::math::lanes::{LANES, bits, f32x16, load};
use crate::sampling::Dimension;
use crate::scene::Scene;

/// What every camera path of a wave has in common.
pub(super) struct CameraPaths<'a> {
    pub scene: &'a Scene,
    pub settings: &'a SppmSettings,
    pub query: RadianceQuery,
    pub gather: &'a Gather<'a>,
}

/// What light a path may find at an emitter, and whether it goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Only Dirac deltas lie behind it: all that it finds.
    Camera,
    /// A finite lobe lies behind it: what no emitter sample has found.
    Finite,
    /// A finite lobe, then Dirac deltas: nothing, for photons have brought it.
    Caustic,
    /// As [`Finite`](State::Finite), and there it ends, for photons have brought the rest.
    Last,
}

impl State {
    /// After a Dirac delta.
    fn after_delta(self) -> State {
        match self {
            State::Camera => State::Camera,
            _ => State::Caustic,
        }
    }
}

/// Whether the other light at a surface with that BSDF is gathered from photons.
fn gathers(bsdf: &Bsdf<'_>) -> bool {
    match bsdf {
        Bsdf::Null | Bsdf::Conductor(_) | Bsdf::Dielectric(_) | Bsdf::ThinDielectric(_) => false,
        Bsdf::RoughConductor(_) | Bsdf::RoughDielectric(_) => false,
        Bsdf::Diffuse(_) | Bsdf::Plastic(_) | Bsdf::RoughPlastic(_) => true,
        Bsdf::Principled(_) | Bsdf::PrincipledThin(_) => true,
        Bsdf::Blend(b) => b.bsdfs.iter().any(|b| gathers(b)),
        Bsdf::Mask(b) => gathers(b.inner),
        Bsdf::Tilted(b) => gathers(b.inner),
        Bsdf::TwoSided(b) => b.sides.iter().any(|b| gathers(b)),
    }
}

impl CameraPaths<'_> {
    fn allows(&self, edges: u32) -> bool {
        self.settings.max_depth.is_none_or(|max| edges <= max)
    }

    /// Whether light at an emitter is wanted that a path of so many edges finds.
    fn wants(&self, state: State, edges: u32) -> bool {
        match state {
            State::Camera if edges == 1 => self.query.emitted && !self.settings.hide_emitters,
            State::Camera if self.query.separates_caustics() => self.query.caustic,
            State::Caustic => false,
            _ => self.query.wants(edges),
        }
    }

    /// The radiance along each ray of the wave.
    pub fn trace(&self, wave: Wave<'_>, worker: &mut Worker, out: &mut [Radiance]) {
        let scene = self.scene;
        out.fill(Radiance::NONE);
        worker.paths.begin(wave.rays, wave.keys);
        let mut states = vec![State::Camera; out.len()];
        let mut edges = 1;
        while !worker.paths.rays.is_empty() && self.allows(edges) && !worker.interrupt.is_raised() {
            let coherence = if edges == 1 { wave.coherence } else { Coherence::Incoherent };
            intersect(scene, &worker.paths.rays, coherence, &mut worker.hits, &mut worker.counters);
            if edges == 1 {
                first_hits(scene, self.settings.hide_emitters, worker, out);
            }
            self.drop_missed(edges, &states, worker, out);
            self.draw(edges, worker);
            self.shade(edges, &mut states, worker, out);
            worker.trace_shadows(scene, coherence, |slot, value| out[slot].value += value);
            edges += 1;
        }
    }

    fn next_event(&self, edges: u32) -> bool {
        self.scene.needs.emitter_sampling && self.allows(edges + 1) && self.query.wants(edges + 1)
    }

    fn draw(&self, edges: u32, worker: &mut Worker) {
        let Worker { sampler, paths, numbers, .. } = worker;
        let (bounce, keys) = (edges - 1, &paths.keys);
        if self.next_event(edges) {
            draw_1d(*sampler, Dimension::emitter_choice(bounce), keys, &mut numbers.emitter_choice);
            draw_2d(*sampler, Dimension::emitter_point(bounce), keys, &mut numbers.emitter_point);
        }
        if self.allows(edges + 1) {
            draw_1d(*sampler, Dimension::bsdf_lobe(bounce), keys, &mut numbers.bsdf_lobe);
            draw_2d(*sampler, Dimension::bsdf_direction(bounce), keys, &mut numbers.bsdf_direction);
            draw_1d(*sampler, Dimension::roulette(bounce), keys, &mut numbers.roulette);
        }
    }

    /// Takes the paths that hit nothing out of the wave, with the light that they found there.
    fn drop_missed(&self, edges: u32, states: &[State], worker: &mut Worker, out: &mut [Radiance]) {
        let Worker { paths, hits, .. } = worker;
        paths.keep_hits(hits, |paths, i| {
            let slot = paths.slots[i] as usize;
            if self.scene.needs.environment && self.wants(states[slot], edges) {
                let d = paths.rays[i].d;
                let le = lighting::environment(self.scene, d, paths.pdf[i], TechniqueCounts::ONE_EACH);
                out[slot].value += paths.beta(i) * le;
            }
        });
    }

    /// Shades every path of the wave, block by block, and moves those that go on to the front.
    fn shade(&self, edges: u32, states: &mut [State], worker: &mut Worker, out: &mut [Radiance]) {
        let Worker { hits, shadows, paths, numbers, arena, .. } = worker;
        let mut alive = 0;
        for first in (0..hits.len()).step_by(LANES) {
            arena.reset();
            let block = Block::new(self.scene, arena, &paths.rays, hits, first);
            for (i, le) in lighting::emitted(self.scene, &block, &paths.pdf, TechniqueCounts::ONE_EACH) {
                let slot = paths.slots[first + i] as usize;
                if self.wants(states[slot], edges) {
                    out[slot].value += paths.beta(first + i) * le;
                }
            }
            let state = |i: usize| states[paths.slots[first + i] as usize];
            let going = bits(block.active).fold(0, |b, i| b | u32::from(state(i) != State::Last) << i);
            if going == 0 || !self.allows(edges + 1) {
                continue;
            }
            for i in bits(going & block.finite) {
                let value = self.gathered(edges, &block, i);
                out[paths.slots[first + i] as usize].value += paths.beta(first + i) * value;
            }
            if self.next_event(edges) && going & block.finite != 0 {
                let u_choice = load(&numbers.emitter_choice, first);
                let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], first));
                let counts = TechniqueCounts::ONE_EACH;
                let sampled = lighting::sample_emitters(self.scene, &block, u_choice, u_point, counts);
                let value = std::array::from_fn(|c| load(&paths.beta[c], first) * sampled.value[c]);
                shadows.push(&sampled.rays, &paths.slots[first..], &value, sampled.lanes & going);
            }
            let (next, survivors) = self.scatter(edges, &block, going, paths, numbers);
            let survivors = self.not_in_vain(&block, &next, survivors);
            for i in bits(survivors) {
                let state = &mut states[paths.slots[first + i] as usize];
                *state = match next.pdf.as_array()[i].is_infinite() {
                    true => state.after_delta(),
                    false if gathers(block.bsdfs[i]) => State::Last,
                    false => State::Finite,
                };
            }
            alive = paths.compact(first, alive, &next, survivors);
        }
        paths.truncate(alive);
    }

    /// The lanes of `survivors` that may find light: where photons have brought the rest, only rays that can hit emitters.
    fn not_in_vain(&self, block: &Block<'_>, next: &Continuation, survivors: u32) -> u32 {
        if self.scene.needs.hit_emitters || self.scene.needs.environment {
            return survivors;
        }
        let vain = |i: &usize| next.pdf.as_array()[*i].is_finite() && gathers(block.bsdfs[*i]);
        bits(survivors).filter(vain).fold(survivors, |lanes, i| lanes & !(1 << i))
    }

    /// What photons bring to a point.
    fn gathered(&self, edges: u32, block: &Block<'_>, i: usize) -> Rgb {
        if !self.query.indirect {
            return Rgb::BLACK;
        }
        let max_edges = self.settings.max_depth.map_or(u32::MAX, |max| max - edges);
        let max_edges = if max_edges >= GridPhoton::MOST_EDGES { u32::MAX } else { max_edges };
        let wanted = Wanted { max_edges, indirect: gathers(block.bsdfs[i]) };
        self.gather.radiance(block, i, wanted)
    }

    /// Samples the BSDFs and plays roulette; the bits are the lanes that go on.
    #[inline(always)]
    fn scatter(
        &self,
        edges: u32,
        block: &Block<'_>,
        going: u32,
        paths: &PathWave,
        numbers: &Numbers,
    ) -> (Continuation, u32) {
        let first = block.first;
        let u_lobe = load(&numbers.bsdf_lobe, first);
        let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], first));
        let sample = bsdf::lanes::sample_x16(&block.bsdfs, &block.wo, u_lobe, u, going);
        let mut beta: [f32x16; 3] = std::array::from_fn(|c| load(&paths.beta[c], first) * sample.weight[c]);
        let eta = load(&paths.eta, first) * sample.eta;
        let strongest = beta[0].fast_max(beta[1]).fast_max(beta[2]);
        let mut alive = sample.valid & strongest.simd_ne(f32x16::ZERO);
        if let Some(roulette) = Roulette::at(edges, self.settings.rr_depth) {
            // Radiance is scaled by η² inside a dielectric, which says nothing about its importance.
            let on;
            (beta, on) = roulette.play_x16(beta, eta * eta, load(&numbers.roulette, first));
            alive &= on;
        }
        let wi = block.at.frame.to_world(sample.wi);
        let rays = self.scene.spawn_rays(&block.at, wi, block.rays.time);
        (Continuation { rays, beta, pdf: sample.pdf, eta }, alive.to_bitmask() & going)
    }
}
