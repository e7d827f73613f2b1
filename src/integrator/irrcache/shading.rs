//! Rendering with a finished cache.
//!
//! A path ends at the first diffuse surface, whose indirect light the cache provides. Direct light there comes from
//! emitter samples alone if all emitters are sampled by solid angle. Otherwise, or if there may be caustics, one more
//! ray searches for emitters, directly (weighted against the emitter sample) and through specular lobes. With caustic
//! photon maps, caustics are a density estimate of these, and no ray searches for them.

use super::interpolation::Interpolation;
use crate::accel::Coherence;
use crate::bsdf::{self, BsdfEval, Lobe, SpecularLobe, Split};
use crate::color::Rgb;
use crate::integrator::block::ShadingBlock;
use crate::integrator::lighting::{self, TechniqueCounts};
use crate::integrator::path::first_hits;
use crate::integrator::path_wave::{Continuation, PathWave};
use crate::integrator::photon::CausticMaps;
use crate::integrator::photon::kdtree::NeighbourBuffer;
use crate::integrator::roulette::Roulette;
use crate::integrator::settings::PathLimits;
use crate::integrator::shadows::ShadowQueue;
use crate::integrator::worker::{BounceNumbers, RandomNumbers, intersect};
use crate::integrator::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::math::lanes::{LANES, bits, f32x16, load};
use crate::math::{Ray, RayX16, Vec2, Vec3};
use crate::sampling::SampleKey;
use crate::sampling::mis::power_heuristic;
use crate::scene::Scene;
use std::sync::Arc;

/// An integrator that takes indirect light from caches.
pub struct CachedPath {
    /// The caches of the replicates; their number is a power of two.
    pub caches: Vec<Interpolation>,
    /// The settings for path length and visible emitters.
    pub path: PathLimits,
    /// Whether only the cached light is shown.
    pub only_cached: bool,
    /// Caustic photon maps; without them, paths search for caustics.
    pub caustics: Option<Arc<CausticMaps>>,
    /// Whether the cache is not used at surfaces that are nearer to the ray's origin than the records' mean radius.
    pub far_only: bool,
}

impl CachedPath {
    /// Returns the cache of a sample's replicate.
    #[inline]
    pub fn cache(&self, key: SampleKey) -> &Interpolation {
        &self.caches[key.replicate as usize % self.caches.len()]
    }

    /// Returns the cached irradiance of lane `i`.
    #[inline]
    fn irradiance(
        &self,
        block: &ShadingBlock<'_>,
        i: usize,
        key: SampleKey,
        n: Vec3,
        facing: Vec3,
    ) -> Option<Rgb> {
        let (cache, p) = (self.cache(key), block.at.p.lane(i));
        match self.far_only {
            true => {
                let distance = block.at.hit[i].t * block.rays.d.lane(i).length();
                cache.irradiance_from(distance, p, n, facing)
            }
            false => cache.irradiance(p, n, facing),
        }
    }
}

/// The state shared by all paths of a bounce.
struct CachedBounce<'a> {
    cached: &'a CachedPath,
    scene: &'a Scene,
    /// Whether emitters are sampled at this bounce.
    next_event: bool,
    /// Whether emission found by the rays of this bounce is added.
    add_emission: bool,
    /// Whether emission is added for rays with specular lobes only, if caustics are separated.
    add_caustics: Option<bool>,
    /// Whether cached light is added at this bounce.
    add_cached: bool,
    /// The caustic maps to use at this bounce.
    caustics: Option<&'a CausticMaps>,
    /// Whether diffuse surfaces send a probe ray that searches for emitters.
    probes: bool,
    /// Whether paths may continue.
    scatter: bool,
    /// Russian roulette, if it applies at this bounce.
    roulette: Option<Roulette>,
}

impl Integrator for CachedPath {
    fn name(&self) -> &'static str {
        "irrcache"
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
        let CachedPath { path, only_cached, .. } = self;
        let allows = |edges: u32| path.allows(edges);
        let wants = |edges: u32| query.wants(edges) && !only_cached;
        let spread = scene.lights.iter().all(|light| light.is_sampled_by_solid_angle());
        worker.paths.begin(wave.rays, wave.keys);
        worker.probing.clear();
        worker.probing.resize(out.len(), false);
        worker.specular_only.clear();
        let separate = query.separates_caustics() || self.caustics.is_some();
        worker.specular_only.resize(if separate { out.len() } else { 0 }, true);
        let mut photons = NeighbourBuffer::default();
        let mut depth = 0;
        while !worker.paths.rays.is_empty() && allows(depth + 1) && !worker.interrupt.is_raised() {
            let coherence = if depth == 0 { wave.coherence } else { Coherence::Incoherent };
            intersect(scene, &worker.paths.rays, coherence, &mut worker.hits, &mut worker.counters);
            if depth == 0 {
                first_hits(scene, path.hide_emitters, worker, out);
            }
            let bounce = CachedBounce {
                cached: self,
                scene,
                next_event: scene.needs.emitter_sampling && allows(depth + 2) && wants(depth + 2),
                add_emission: wants(depth + 1) && !(depth == 0 && path.hide_emitters),
                add_caustics: (depth > 0 && query.separates_caustics())
                    .then_some(query.caustic && !only_cached),
                add_cached: allows(depth + 3) && query.indirect,
                caustics: self.caustics.as_deref().filter(|_| allows(depth + 3) && wants(depth + 3)),
                probes: ((scene.needs.deltas > 0) && query.indirect && self.caustics.is_none() || !spread)
                    && !only_cached,
                scatter: allows(depth + 2),
                roulette: Roulette::at(depth + 1, path.rr_depth),
            };
            let Worker { paths, hits, numbers, specular_only, sampler, .. } = &mut *worker;
            let wants = |paths: &PathWave, i: usize| bounce.adds(specular_only, paths.slots[i], paths.pdf[i]);
            lighting::drop_missed(scene, paths, hits, out, TechniqueCounts::UNCOMPENSATED, wants);
            let uses = BounceNumbers {
                next_event: bounce.next_event,
                lobe: bounce.scatter,
                direction: bounce.scatter,
                roulette: bounce.roulette.is_some(),
            };
            numbers.draw(uses, depth, *sampler, &paths.keys);
            bounce.shade(worker, &mut photons, out);
            worker.trace_shadows(scene, coherence, |slot, value| out[slot].value += value);
            depth += 1;
        }
    }
}

/// The continuation of the path of one lane.
struct PathContinuation {
    wi: Vec3,
    weight: Rgb,
    pdf: f32,
    eta: f32,
}

/// The lobes of a lane: the diffuse part, whose indirect light is cached, and the rest.
struct CachedLane<'a> {
    diffuse: Option<&'a bsdf::Bsdf<'a>>,
    rest: Option<&'a bsdf::Bsdf<'a>>,
    /// The probability that the path continues as a probe ray from the diffuse part.
    probe: f32,
}

impl CachedBounce<'_> {
    /// Returns whether emission found by a ray with the density `pdf` is added.
    #[inline(always)]
    fn adds(&self, specular_only: &[bool], slot: u32, pdf: f32) -> bool {
        let only = specular_only.get(slot as usize).copied();
        match self.add_caustics {
            Some(caustics) if only == Some(true) => caustics,
            // The caustic maps contain this light.
            _ if only == Some(false) && pdf.is_infinite() && self.cached.caustics.is_some() => false,
            _ => self.add_emission,
        }
    }

    /// Shades every path of the wave and moves the continuing paths to the front.
    fn shade(&self, worker: &mut Worker, photons: &mut NeighbourBuffer, out: &mut [Radiance]) {
        let Worker { hits, shadows, paths, numbers, arena, probing, specular_only, .. } = worker;
        let mut alive = 0;
        for first in (0..hits.len()).step_by(LANES) {
            arena.reset();
            let block = ShadingBlock::new(self.scene, arena, &paths.rays, hits, first);
            if self.add_emission || self.add_caustics == Some(true) {
                for (i, le) in lighting::emitted(self.scene, &block, paths, TechniqueCounts::UNCOMPENSATED) {
                    let slot = paths.slots[first + i];
                    if self.adds(specular_only, slot, paths.pdf[first + i]) {
                        out[slot as usize].value += paths.beta(first + i) * le;
                    }
                }
            }
            if !self.scatter {
                continue;
            }
            if let Some(caustics) = self.caustics {
                for i in bits(block.finite) {
                    let (j, slot) = (first + i, paths.slots[first + i] as usize);
                    if !probing[slot] {
                        let light = caustics.reflected(&block, i, paths.keys[j], photons);
                        out[slot].value += paths.beta(j) * light;
                    }
                }
            }
            let done = self.add_cached_light(&block, paths, probing, out);
            if self.next_event && done != 0 {
                self.sample_emitters_at(&block, done, paths, numbers, shadows);
            }
            let shade_remaining = block.active & !done;
            if shade_remaining != 0 {
                let (next, survivors) = self.shade_remaining(
                    &block,
                    shade_remaining,
                    paths,
                    numbers,
                    probing,
                    shadows,
                    out,
                    arena,
                );
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

    /// Adds the cached light of purely diffuse lanes that need no probe ray. Returns a mask of the lanes that need
    /// only an emitter sample.
    #[inline]
    fn add_cached_light(
        &self,
        block: &ShadingBlock<'_>,
        paths: &PathWave,
        probing: &[bool],
        out: &mut [Radiance],
    ) -> u32 {
        if self.probes {
            return 0;
        }
        let mut done = 0;
        for i in bits(block.active) {
            let bsdf::Bsdf::Diffuse(diffuse) = block.bsdfs[i] else { continue };
            let slot = paths.slots[block.first + i] as usize;
            if probing[slot] {
                continue;
            }
            let wo = block.wo.lane(i);
            let factor = block.bsdfs[i].radiance_per_irradiance(wo);
            if !self.add_cached || factor.is_black() || diffuse.reflectance.is_black() {
                done |= 1 << i;
                continue;
            }
            let n = block.at.frame.n.lane(i);
            let known = self.cached.irradiance(block, i, paths.keys[block.first + i], n, n);
            if let Some(irradiance) = known {
                out[slot].value += paths.beta(block.first + i) * factor * irradiance;
                done |= 1 << i;
            }
        }
        done
    }

    /// Queues shadow rays for the lanes that end here. Emitter samples have weight 1, because no other technique
    /// searches for emitters.
    #[inline]
    fn sample_emitters_at(
        &self,
        block: &ShadingBlock<'_>,
        done: u32,
        paths: &PathWave,
        numbers: &RandomNumbers,
        shadows: &mut ShadowQueue,
    ) {
        let at = &block.at;
        let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], block.first));
        let selection = &self.scene.light_selection;
        let sample = self.scene.sample_emitters(selection, &at.p.into(), u_point, block.rays.time, done);
        let wi = at.frame.to_local(sample.wi);
        let scattered = bsdf::lanes::eval_x16(&block.bsdfs, &block.wo, &wi, done);
        let factor = wi.z.abs() / sample.pdf;
        let value: [f32x16; 3] = std::array::from_fn(|c| {
            load(&paths.beta[c], block.first) * scattered.f[c] * sample.radiance[c] * factor
        });
        let some = value.iter().fold(f32x16::ZERO, |some, v| some | v.simd_gt(f32x16::ZERO));
        let lanes = (sample.valid & some & sample.pdf.simd_gt(f32x16::ZERO)).to_bitmask() & done;
        let rays = self.scene.shadow_rays(at, &sample, block.rays.time);
        shadows.push(&rays, &paths.slots[block.first..], &value, lanes);
    }

    /// Shades the remaining lanes, one by one.
    #[allow(clippy::too_many_arguments)]
    fn shade_remaining<'a>(
        &self,
        block: &ShadingBlock<'a>,
        shade_remaining: u32,
        paths: &PathWave,
        numbers: &RandomNumbers,
        probing: &mut [bool],
        shadows: &mut ShadowQueue,
        out: &mut [Radiance],
        arena: &'a bumpalo::Bump,
    ) -> (Continuation, u32) {
        let mut next = Continuation {
            from: block.at.p,
            gloss: None,
            rays: RayX16::splat(&Ray::new(Vec3::ZERO, Vec3::Z)),
            beta: [f32x16::ZERO; 3],
            pdf: f32x16::ZERO,
            eta: f32x16::ZERO,
        };
        let mut rays = [Ray::new(Vec3::ZERO, Vec3::Z); LANES];
        let mut survivors = 0;
        for i in bits(shade_remaining) {
            let j = block.first + i;
            let slot = paths.slots[j] as usize;
            let u_lobe = numbers.bsdf_lobe[j];
            let u = Vec2::new(numbers.bsdf_direction[0][j], numbers.bsdf_direction[1][j]);
            let continuation = if probing[slot] && self.cached.caustics.is_some() {
                None
            } else if probing[slot] {
                specular_sample(block.bsdfs[i], block.wo.lane(i), u_lobe)
            } else {
                let lane = self.split_lane(block, i, paths, out, arena);
                if self.next_event && block.finite >> i & 1 == 1 {
                    self.sample_emitter_at(block, i, &lane, paths, numbers, shadows);
                }
                lane.sample(block.wo.lane(i), u_lobe, u, &mut probing[slot])
            };
            let Some(PathContinuation { wi, weight, pdf, eta }) = continuation else { continue };
            let (mut beta, eta) = (paths.beta(j) * weight, paths.eta[j] * eta);
            if let Some(roulette) = self.roulette {
                let Some(on) = roulette.play(beta, eta * eta, numbers.roulette[j]) else { continue };
                beta = on;
            }
            if beta.is_black() {
                continue;
            }
            let at = block.at.lane(i);
            rays[i] = self.scene.spawn_ray(&at, at.frame.to_world(wi), at.time);
            for (channel, value) in next.beta.iter_mut().zip(beta.to_array()) {
                channel.as_mut_array()[i] = value;
            }
            next.pdf.as_mut_array()[i] = pdf;
            next.eta.as_mut_array()[i] = eta;
            survivors |= 1 << i;
        }
        next.rays = RayX16::load(&rays, 0);
        (next, survivors)
    }

    /// Splits the BSDF of a lane and adds the cached light of its diffuse part. Without cached light, all lobes are
    /// traced.
    fn split_lane<'a>(
        &self,
        block: &ShadingBlock<'a>,
        i: usize,
        paths: &PathWave,
        out: &mut [Radiance],
        arena: &'a bumpalo::Bump,
    ) -> CachedLane<'a> {
        let (bsdf, wo) = (block.bsdfs[i], block.wo.lane(i));
        let traced = CachedLane { diffuse: None, rest: Some(bsdf), probe: 0.0 };
        let Split { diffuse: Some(diffuse), rest } = bsdf.split(wo, arena) else { return traced };
        if self.add_cached {
            let frame = block.at.frame.lane(i);
            let n = frame.n * 1f32.copysign(wo.z);
            let facing = frame.to_world(diffuse.receiving_normal(wo));
            let known = self.cached.irradiance(block, i, paths.keys[block.first + i], n, facing);
            let Some(irradiance) = known else { return traced };
            let slot = paths.slots[block.first + i] as usize;
            let value = paths.beta(block.first + i) * diffuse.radiance_per_irradiance(wo) * irradiance;
            out[slot].value += value;
        }
        let probe = match (self.probes, rest.is_some()) {
            (false, _) => 0.0,
            (true, true) => 0.5,
            (true, false) => 1.0,
        };
        CachedLane { diffuse: Some(diffuse), rest, probe }
    }

    /// Queues a shadow ray for all lobes of one lane.
    fn sample_emitter_at(
        &self,
        block: &ShadingBlock<'_>,
        i: usize,
        lane: &CachedLane<'_>,
        paths: &PathWave,
        numbers: &RandomNumbers,
        shadows: &mut ShadowQueue,
    ) {
        let j = block.first + i;
        let at = block.at.lane(i);
        let u = Vec2::new(numbers.emitter_point[0][j], numbers.emitter_point[1][j]);
        let sample = self.scene.sample_emitter(&self.scene.light_selection, at.p, u, at.time);
        let Some(sample) = sample.filter(|sample| sample.pdf > 0.0) else { return };
        let (wo, wi) = (block.wo.lane(i), at.frame.to_local(sample.wi));
        let weighted = |bsdf: Option<&bsdf::Bsdf<'_>>, probability: f32| {
            let BsdfEval { f, pdf } = bsdf.map_or(BsdfEval::ZERO, |bsdf| bsdf.eval(wo, wi));
            f * if sample.delta { 1.0 } else { power_heuristic(sample.pdf, probability * pdf) }
        };
        let f = weighted(lane.diffuse, lane.probe) + weighted(lane.rest, 1.0 - lane.probe);
        let value = paths.beta(j) * f * sample.radiance * (wi.z.abs() / sample.pdf);
        if !value.is_black() {
            shadows.push_one(self.scene.shadow_ray(&at, &sample), paths.slots[j], value);
        }
    }
}

impl CachedLane<'_> {
    /// Samples the continuation of the path: a probe ray from the diffuse part, or a ray from the other lobes.
    fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, probing: &mut bool) -> Option<PathContinuation> {
        let (bsdf, probability, u_lobe) = match u_lobe < self.probe {
            true => (self.diffuse?, self.probe, u_lobe / self.probe),
            false => (self.rest?, 1.0 - self.probe, (u_lobe - self.probe) / (1.0 - self.probe)),
        };
        let sample = bsdf.sample(wo, u_lobe.min(1f32.next_down()), u)?;
        *probing = self.probe > 0.0
            && sample.lobe == Lobe::Diffuse
            && self.diffuse.is_some_and(|d| std::ptr::eq(d, bsdf));
        let weight = sample.weight / probability;
        Some(PathContinuation { wi: sample.wi, weight, pdf: sample.pdf * probability, eta: sample.eta })
    }
}

/// Samples one of the Dirac deltas in proportion to its weight.
fn specular_sample(bsdf: &bsdf::Bsdf<'_>, wo: Vec3, u: f32) -> Option<PathContinuation> {
    let mut sum = 0.0;
    bsdf.specular_lobes(wo, &mut |lobe| sum += lobe.weight.mean());
    let mut left = u * sum;
    let mut chosen: Option<SpecularLobe> = None;
    bsdf.specular_lobes(wo, &mut |lobe| {
        if left >= 0.0 && lobe.weight.mean() > 0.0 {
            chosen = Some(lobe);
        }
        left -= lobe.weight.mean();
    });
    chosen.map(|lobe| {
        let weight = lobe.weight * (sum / lobe.weight.mean());
        PathContinuation { wi: lobe.wi, weight, pdf: f32::INFINITY, eta: lobe.eta }
    })
}
