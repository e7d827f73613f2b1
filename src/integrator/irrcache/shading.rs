//! Rendering with a finished cache.
//!
//! A path ends at the first diffuse surface, whose indirect light the cache knows. Direct light there is that of emitter samples alone
//! where they are spread over the solid angle; where they are not, or where there may be caustics, one more ray looks for
//! emitters, directly (weighted against the emitter sample) and by way of specular lobes. Where photons have brought the
//! caustics, these are their density, and no ray looks for them.

use super::interpolation::Interpolation;
use crate::accel::Coherence;
use crate::bsdf::{self, BsdfEval, Lobe, SpecularLobe, Split};
use crate::color::Rgb;
use crate::integrator::block::Block;
use crate::integrator::lighting::{self, TechniqueCounts};
use crate::integrator::path::first_hits;
use crate::integrator::photon::CausticMaps;
use crate::integrator::photon::kdtree::Nearest;
use crate::integrator::roulette::Roulette;
use crate::integrator::settings::PathSettings;
use crate::integrator::worker::{Continuation, Numbers, PathWave, ShadowQueue, draw_1d, draw_2d, intersect};
use crate::integrator::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::math::lanes::{LANES, bits, f32x16, load};
use crate::math::{Ray, RayX16, Vec2, Vec3};
use crate::sampling::mis::power_heuristic;
use crate::sampling::{Dimension, SampleKey, Sampler};
use crate::scene::Scene;
use std::sync::Arc;

/// An integrator that looks indirect light up.
pub struct CachedPath {
    /// The caches of the replicates of the samples: as many as there are, a power of two.
    pub caches: Vec<Interpolation>,
    /// How long paths may be, and which emitters are seen.
    pub path: PathSettings,
    /// Whether only what the caches serve is shown.
    pub only_cached: bool,
    /// Caustics that photons have brought; without them paths look for them.
    pub caustics: Option<Arc<CausticMaps>>,
    /// Whether surfaces nearer to the rays' origins than their records are spread are not served.
    pub far_only: bool,
}

impl CachedPath {
    /// The cache of a sample's replicate.
    #[inline]
    pub fn cache(&self, key: SampleKey) -> &Interpolation {
        &self.caches[key.replicate as usize % self.caches.len()]
    }

    /// The cached irradiance of lane `i`.
    #[inline]
    fn irradiance(&self, block: &Block<'_>, i: usize, key: SampleKey, n: Vec3, facing: Vec3) -> Option<Rgb> {
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

/// What every path of a bounce has in common.
struct Bounce<'a> {
    cached: &'a CachedPath,
    scene: &'a Scene,
    /// Scattering events so far.
    depth: u32,
    /// Whether emitters are sampled at this bounce.
    next_event: bool,
    /// Whether light found by the rays of this bounce is wanted.
    add_emission: bool,
    /// Whether it is wanted of rays that have met specular lobes only, where that is told apart.
    add_caustics: Option<bool>,
    /// Whether the cache's light is wanted at this bounce.
    add_cached: bool,
    /// The caustics to add at this bounce.
    caustics: Option<&'a CausticMaps>,
    /// Whether diffuse surfaces send a ray to look for emitters.
    probes: bool,
    /// Whether paths may go on.
    scatter: bool,
    /// Whether roulette is played at this bounce.
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
        let allows = |edges: u32| path.max_depth.is_none_or(|max| edges <= max);
        let wants = |edges: u32| query.wants(edges) && !only_cached;
        let spread = scene.lights.iter().all(|light| light.is_sampled_by_solid_angle());
        worker.paths.begin(wave.rays, wave.keys);
        worker.probing.clear();
        worker.probing.resize(out.len(), false);
        worker.specular_only.clear();
        let told_apart = query.separates_caustics() || self.caustics.is_some();
        worker.specular_only.resize(if told_apart { out.len() } else { 0 }, true);
        let mut photons = Nearest::default();
        let mut depth = 0;
        while !worker.paths.rays.is_empty() && allows(depth + 1) && !worker.interrupt.is_raised() {
            let coherence = if depth == 0 { wave.coherence } else { Coherence::Incoherent };
            intersect(scene, &worker.paths.rays, coherence, &mut worker.hits, &mut worker.counters);
            if depth == 0 {
                first_hits(scene, path.hide_emitters, worker, out);
            }
            let bounce = Bounce {
                cached: self,
                scene,
                depth,
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
            bounce.drop_missed(worker, out);
            bounce.draw(worker.sampler, &worker.paths.keys, &mut worker.numbers);
            bounce.shade(worker, &mut photons, out);
            worker.trace_shadows(scene, coherence, |slot, value| out[slot].value += value);
            depth += 1;
        }
    }
}

/// How a path goes on from one lane.
struct Onward {
    wi: Vec3,
    weight: Rgb,
    pdf: f32,
    eta: f32,
}

/// A diffuse lane whose indirect light is known, and what other lobes it has.
struct Lane<'a> {
    diffuse: Option<&'a bsdf::Bsdf<'a>>,
    rest: Option<&'a bsdf::Bsdf<'a>>,
    /// The probability that the path goes on as a probe from the diffuse part.
    probe: f32,
}

impl Bounce<'_> {
    /// Whether the light is wanted that a ray of that density finds.
    #[inline(always)]
    fn adds(&self, specular_only: &[bool], slot: u32, pdf: f32) -> bool {
        let only = specular_only.get(slot as usize).copied();
        match self.add_caustics {
            Some(caustics) if only == Some(true) => caustics,
            // Photons have brought it.
            _ if only == Some(false) && pdf.is_infinite() && self.cached.caustics.is_some() => false,
            _ => self.add_emission,
        }
    }

    fn draw(&self, sampler: Sampler, keys: &[SampleKey], numbers: &mut Numbers) {
        let Bounce { depth, scene, .. } = *self;
        if self.next_event {
            if scene.lights.len() > 1 {
                draw_1d(sampler, Dimension::emitter_choice(depth), keys, &mut numbers.emitter_choice);
            } else {
                numbers.emitter_choice.clear();
                numbers.emitter_choice.resize(keys.len(), 0.0);
            }
            draw_2d(sampler, Dimension::emitter_point(depth), keys, &mut numbers.emitter_point);
        }
        if self.scatter {
            draw_1d(sampler, Dimension::bsdf_lobe(depth), keys, &mut numbers.bsdf_lobe);
            draw_2d(sampler, Dimension::bsdf_direction(depth), keys, &mut numbers.bsdf_direction);
        }
        if self.roulette.is_some() {
            draw_1d(sampler, Dimension::roulette(depth), keys, &mut numbers.roulette);
        }
    }

    fn drop_missed(&self, worker: &mut Worker, out: &mut [Radiance]) {
        let Worker { paths, hits, specular_only, .. } = worker;
        paths.keep_hits(hits, |paths, i| {
            if self.scene.needs.environment && self.adds(specular_only, paths.slots[i], paths.pdf[i]) {
                let d = paths.rays[i].d;
                let le = lighting::environment(self.scene, d, paths.pdf[i], TechniqueCounts::ONE_EACH);
                out[paths.slots[i] as usize].value += paths.beta(i) * le;
            }
        });
    }

    /// Shades every path of the wave, and moves those that go on to the front.
    fn shade(&self, worker: &mut Worker, photons: &mut Nearest, out: &mut [Radiance]) {
        let Worker { hits, shadows, paths, numbers, arena, probing, specular_only, .. } = worker;
        let mut alive = 0;
        for first in (0..hits.len()).step_by(LANES) {
            arena.reset();
            let block = Block::new(self.scene, arena, &paths.rays, hits, first);
            if self.add_emission || self.add_caustics == Some(true) {
                for (i, le) in lighting::emitted(self.scene, &block, &paths.pdf, TechniqueCounts::ONE_EACH) {
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
            let served = self.serve(&block, paths, probing, out);
            if self.next_event && served != 0 {
                self.light_served(&block, served, paths, numbers, shadows);
            }
            let others = block.active & !served;
            if others != 0 {
                let (next, survivors) =
                    self.others(&block, others, paths, numbers, probing, shadows, out, arena);
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

    /// Adds the cached light of the lanes that are nothing but diffuse and need no probe; the bits are the lanes that are done but for
    /// their emitter sample.
    #[inline]
    fn serve(&self, block: &Block<'_>, paths: &PathWave, probing: &[bool], out: &mut [Radiance]) -> u32 {
        if self.probes {
            return 0;
        }
        let mut served = 0;
        for i in bits(block.active) {
            let bsdf::Bsdf::Diffuse(diffuse) = block.bsdfs[i] else { continue };
            let slot = paths.slots[block.first + i] as usize;
            if probing[slot] {
                continue;
            }
            let wo = block.wo.lane(i);
            let factor = block.bsdfs[i].radiance_per_irradiance(wo);
            if !self.add_cached || factor.is_black() || diffuse.reflectance.is_black() {
                served |= 1 << i;
                continue;
            }
            let n = block.at.frame.n.lane(i);
            let known = self.cached.irradiance(block, i, paths.keys[block.first + i], n, n);
            if let Some(irradiance) = known {
                out[slot].value += paths.beta(block.first + i) * factor * irradiance;
                served |= 1 << i;
            }
        }
        served
    }

    /// Queues shadow rays from the lanes that are served: no other technique looks for emitters there.
    #[inline]
    fn light_served(
        &self,
        block: &Block<'_>,
        served: u32,
        paths: &PathWave,
        numbers: &Numbers,
        shadows: &mut ShadowQueue,
    ) {
        let at = &block.at;
        let u_choice = load(&numbers.emitter_choice, block.first);
        let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], block.first));
        let sample = self.scene.sample_emitters(at.p, u_choice, u_point, block.rays.time, served);
        let wi = at.frame.to_local(sample.wi);
        let scattered = bsdf::lanes::eval_x16(&block.bsdfs, &block.wo, &wi, served);
        let factor = wi.z.abs() / sample.pdf;
        let value: [f32x16; 3] = std::array::from_fn(|c| {
            load(&paths.beta[c], block.first) * scattered.f[c] * sample.radiance[c] * factor
        });
        let some = value.iter().fold(f32x16::ZERO, |some, v| some | v.simd_gt(f32x16::ZERO));
        let lanes = (sample.valid & some & sample.pdf.simd_gt(f32x16::ZERO)).to_bitmask() & served;
        let rays = self.scene.shadow_rays(at, &sample, block.rays.time);
        shadows.push(&rays, &paths.slots[block.first..], &value, lanes);
    }

    /// Shades all other lanes, one by one.
    #[allow(clippy::too_many_arguments)]
    fn others<'a>(
        &self,
        block: &Block<'a>,
        others: u32,
        paths: &PathWave,
        numbers: &Numbers,
        probing: &mut [bool],
        shadows: &mut ShadowQueue,
        out: &mut [Radiance],
        arena: &'a bumpalo::Bump,
    ) -> (Continuation, u32) {
        let mut next = Continuation {
            rays: RayX16::splat(&Ray::new(Vec3::ZERO, Vec3::Z)),
            beta: [f32x16::ZERO; 3],
            pdf: f32x16::ZERO,
            eta: f32x16::ZERO,
        };
        let mut rays = [Ray::new(Vec3::ZERO, Vec3::Z); LANES];
        let mut survivors = 0;
        for i in bits(others) {
            let j = block.first + i;
            let slot = paths.slots[j] as usize;
            let u_lobe = numbers.bsdf_lobe[j];
            let u = Vec2::new(numbers.bsdf_direction[0][j], numbers.bsdf_direction[1][j]);
            let onward = if probing[slot] && self.cached.caustics.is_some() {
                None
            } else if probing[slot] {
                specular_sample(block.bsdfs[i], block.wo.lane(i), u_lobe)
            } else {
                let lane = self.lane(block, i, paths, out, arena);
                if self.next_event && block.finite >> i & 1 == 1 {
                    self.light_lane(block, i, &lane, paths, numbers, shadows);
                }
                lane.sample(block.wo.lane(i), u_lobe, u, &mut probing[slot])
            };
            let Some(Onward { wi, weight, pdf, eta }) = onward else { continue };
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

    /// The lobes of a lane; what the cache knows of it is added. Where it knows nothing, all lobes are traced.
    fn lane<'a>(
        &self,
        block: &Block<'a>,
        i: usize,
        paths: &PathWave,
        out: &mut [Radiance],
        arena: &'a bumpalo::Bump,
    ) -> Lane<'a> {
        let (bsdf, wo) = (block.bsdfs[i], block.wo.lane(i));
        let traced = Lane { diffuse: None, rest: Some(bsdf), probe: 0.0 };
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
        Lane { diffuse: Some(diffuse), rest, probe }
    }

    /// Queues a shadow ray from one lane, for all of its lobes.
    fn light_lane(
        &self,
        block: &Block<'_>,
        i: usize,
        lane: &Lane<'_>,
        paths: &PathWave,
        numbers: &Numbers,
        shadows: &mut ShadowQueue,
    ) {
        let j = block.first + i;
        let at = block.at.lane(i);
        let u = Vec2::new(numbers.emitter_point[0][j], numbers.emitter_point[1][j]);
        let sample = self.scene.sample_emitter(at.p, numbers.emitter_choice[j], u, at.time);
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

impl Lane<'_> {
    /// Draws how the path goes on: by a probe from the diffuse part, or by the other lobes.
    fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2, probing: &mut bool) -> Option<Onward> {
        let (bsdf, probability, u_lobe) = match u_lobe < self.probe {
            true => (self.diffuse?, self.probe, u_lobe / self.probe),
            false => (self.rest?, 1.0 - self.probe, (u_lobe - self.probe) / (1.0 - self.probe)),
        };
        let sample = bsdf.sample(wo, u_lobe.min(1f32.next_down()), u)?;
        *probing = self.probe > 0.0
            && sample.lobe == Lobe::Diffuse
            && self.diffuse.is_some_and(|d| std::ptr::eq(d, bsdf));
        let weight = sample.weight / probability;
        Some(Onward { wi: sample.wi, weight, pdf: sample.pdf * probability, eta: sample.eta })
    }
}

/// One of the Dirac deltas, drawn in proportion to its share.
fn specular_sample(bsdf: &bsdf::Bsdf<'_>, wo: Vec3, u: f32) -> Option<Onward> {
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
        Onward { wi: lobe.wi, weight, pdf: f32::INFINITY, eta: lobe.eta }
    })
}
