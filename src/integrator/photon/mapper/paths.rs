//! The camera's paths, one wave at a time, and the waves of rays that branch off them.

use super::maps::Maps;
use super::{Photonmapper, place};
use crate::accel::Coherence;
use crate::bsdf::{self, Bsdf, Split};
use crate::color::Rgb;
use crate::integrator::block::Block;
use crate::integrator::lighting::{self, TechniqueCounts};
use crate::integrator::path::first_hits;
use crate::integrator::photon::kdtree::Nearest;
use crate::integrator::roulette::Roulette;
use crate::integrator::tree::split;
use crate::integrator::worker::{Continuation, PathWave, draw_1d, draw_2d, intersect};
use crate::integrator::{Radiance, RadianceQuery, Wave, Worker};
use crate::math::Ray;
use crate::math::lanes::{LANES, bits, f32x16, load};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;
use bumpalo::Bump;

/// A direction that is drawn with a density above this, sr⁻¹, shows what it meets: photons are not looked up there.
const SHARP: f32 = 4.0;

/// How far a ray to where irradiance is known goes, of the way: what it ends at is not in its way.
const SHORT: f32 = 0.996;

/// What lies between the camera and a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Light {
    /// Dirac deltas only: all light that it finds counts.
    Camera,
    /// A finite lobe last: what no emitter sample has found counts.
    Finite,
    /// A finite lobe, then Dirac deltas: nothing counts, for caustic photons have brought it.
    Caustic,
}

/// What a path is, besides what every path is.
#[derive(Clone, Copy, Debug)]
struct Leg {
    light: Light,
    /// Whether photons may be looked up where the ray ends.
    gathers: bool,
    /// Whether the path is one of many already.
    branched: bool,
}

/// How many rays leave a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Branching {
    /// One of each kind.
    Single,
    /// Over a hemisphere that other surfaces light.
    Gather,
    /// Into glossy lobes.
    Glossy,
}

const BRANCHINGS: [Branching; 3] = [Branching::Single, Branching::Gather, Branching::Glossy];

/// Sixteen surface points that paths go on from.
struct Shaded<'a> {
    /// Lanes that are done are not active; of those that photons were looked up at only the rest of the BSDF is left.
    block: Block<'a>,
    branching: [Branching; LANES],
    /// Rays that were traced to where irradiance is known.
    sights: u64,
}

impl Shaded<'_> {
    /// Bits: the active lanes of a kind.
    fn lanes(&self, branching: Branching) -> u32 {
        bits(self.block.active).fold(0, |set, i| set | u32::from(self.branching[i] == branching) << i)
    }
}

/// What every path of a wave has in common.
struct Paths<'a> {
    mapper: &'a Photonmapper,
    scene: &'a Scene,
    query: RadianceQuery,
    /// The keys of the wave's rays, by slot.
    keys: &'a [SampleKey],
    coherence: Coherence,
}

/// Rays that may branch off a wave at a time.
const MOST_RAYS: usize = 1 << 19;

/// Estimates the radiance along the rays of a wave.
pub fn li(
    mapper: &Photonmapper,
    scene: &Scene,
    wave: Wave<'_>,
    query: RadianceQuery,
    worker: &mut Worker,
    out: &mut [Radiance],
) {
    out.fill(Radiance::NONE);
    // A query without emitted light is a gather ray.
    let gathers = !query.emitted && query.direct && query.indirect;
    let leg = Leg { light: Light::Camera, gathers, branched: gathers };
    let branches = mapper.settings.gather_samples.max(mapper.settings.glossy_samples);
    let rays = (MOST_RAYS / branches as usize).max(LANES);
    let parts = wave.rays.chunks(rays).zip(wave.keys.chunks(rays)).zip(out.chunks_mut(rays));
    for ((rays, keys), out) in parts {
        worker.paths.begin(rays, keys);
        let paths = Paths { mapper, scene, query, keys, coherence: wave.coherence };
        paths.follow(vec![leg; out.len()], worker, out);
    }
}

/// A wave of rays that are to be followed.
struct Pending {
    /// The number of edges of the paths, with these rays.
    edges: u32,
    legs: Vec<Leg>,
    paths: PathWave,
}

impl<'a> Paths<'a> {
    fn allows(&self, edges: u32) -> bool {
        self.mapper.settings.max_depth.is_none_or(|max| edges <= max)
    }

    fn maps(&self, slot: u32) -> &'a Maps {
        &self.mapper.maps[self.keys[slot as usize].replicate as usize % self.mapper.maps.len()]
    }

    /// Whether light at an emitter is wanted that a path of so many edges finds.
    fn wants(&self, light: Light, edges: u32) -> bool {
        match light {
            Light::Camera if edges == 1 => self.query.emitted && !self.mapper.settings.hide_emitters,
            Light::Camera if self.query.separates_caustics() => self.query.caustic,
            Light::Caustic => false,
            _ => self.query.wants(edges),
        }
    }

    /// Follows the wave in the worker's hand and all that comes of it.
    fn follow(&self, legs: Vec<Leg>, worker: &mut Worker, out: &mut [Radiance]) {
        let mut waves = vec![Pending { edges: 1, legs, paths: std::mem::take(&mut worker.paths) }];
        while let Some(wave) = waves.pop().filter(|_| !worker.interrupt.is_raised()) {
            let first = waves.len();
            self.enter(wave, worker, out, &mut waves);
            // In the order in which they were made.
            waves[first..].reverse();
        }
    }

    /// Traces a wave, adds the light that it finds, and appends the waves that go on from there.
    fn enter(&self, wave: Pending, worker: &mut Worker, out: &mut [Radiance], waves: &mut Vec<Pending>) {
        let Pending { edges, mut legs, paths } = wave;
        worker.paths = paths;
        let coherence = if edges == 1 { self.coherence } else { Coherence::Incoherent };
        intersect(self.scene, &worker.paths.rays, coherence, &mut worker.hits, &mut worker.counters);
        if edges == 1 {
            first_hits(self.scene, self.mapper.settings.hide_emitters, worker, out);
        }
        self.drop_missed(edges, &mut legs, worker, out);
        let arena = Bump::new();
        let blocks: Vec<Block<'_>> =
            Block::all(self.scene, &arena, &worker.paths.rays, &worker.hits).collect();
        self.add_emitted(edges, &blocks, &legs, &worker.paths, out);
        if !self.allows(edges + 1) {
            return;
        }
        let mut buffer = Nearest::default();
        let parents = std::mem::take(&mut worker.paths);
        let shaded: Vec<Shaded<'_>> = blocks
            .into_iter()
            .map(|block| self.look_up(edges, block, &legs, &parents, &arena, out))
            .collect();
        worker.counters.occlusion_rays += shaded.iter().map(|s| s.sights).sum::<u64>();
        if self.query.indirect {
            for shaded in &shaded {
                self.add_caustics(&shaded.block, &parents, &mut buffer, out);
            }
        }
        self.sample_emitters(edges, &shaded, &parents, coherence, worker, out);
        let most = BRANCHINGS
            .into_iter()
            .filter(|&branching| shaded.iter().any(|s| s.lanes(branching) != 0))
            .map(|branching| self.counts(branching).1)
            .max();
        for i in 0..most.unwrap_or(0) {
            let legs = self.scatter(edges, i, &shaded, &legs, &parents, worker);
            if !legs.is_empty() {
                waves.push(Pending { edges: edges + 1, legs, paths: std::mem::take(&mut worker.paths) });
            }
        }
    }

    /// How many emitter samples and how many rays into the BSDF a surface gets.
    fn counts(&self, branching: Branching) -> (u32, u32) {
        let settings = &self.mapper.settings;
        match branching {
            Branching::Single => (1, 1),
            Branching::Gather => (settings.direct_samples, settings.gather_samples),
            Branching::Glossy => (settings.direct_samples, settings.glossy_samples),
        }
    }

    /// Takes the paths that hit nothing out of the wave, with the light that they found there.
    fn drop_missed(&self, edges: u32, legs: &mut Vec<Leg>, worker: &mut Worker, out: &mut [Radiance]) {
        let Worker { paths, hits, .. } = worker;
        let met: Vec<bool> = hits.iter().map(Option::is_some).collect();
        paths.keep_hits(hits, |paths, i| {
            if self.scene.needs.environment && self.wants(legs[i].light, edges) {
                let d = paths.rays[i].d;
                let le = lighting::environment(self.scene, d, paths.pdf[i], TechniqueCounts::ONE_EACH);
                out[paths.slots[i] as usize].value += paths.beta(i) * le;
            }
        });
        let mut met = met.into_iter();
        legs.retain(|_| met.next().unwrap_or(false));
    }

    fn add_emitted(
        &self,
        edges: u32,
        blocks: &[Block<'_>],
        legs: &[Leg],
        paths: &PathWave,
        out: &mut [Radiance],
    ) {
        for block in blocks {
            for (i, le) in lighting::emitted(self.scene, block, &paths.pdf, TechniqueCounts::ONE_EACH) {
                let j = block.first + i;
                if self.wants(legs[j].light, edges) {
                    out[paths.slots[j] as usize].value += paths.beta(j) * le;
                }
            }
        }
    }

    /// Adds what photons bring to the diffuse parts that gathering rays have met, and says how the paths go on.
    fn look_up<'b>(
        &self,
        edges: u32,
        mut block: Block<'b>,
        legs: &[Leg],
        paths: &PathWave,
        arena: &'b Bump,
        out: &mut [Radiance],
    ) -> Shaded<'b> {
        let mut sights = 0;
        let mut branching = [Branching::Single; LANES];
        for i in bits(block.active) {
            let (j, wo) = (block.first + i, block.wo.lane(i));
            let leg = legs[j];
            if leg.branched && !leg.gathers {
                continue;
            }
            let Split { diffuse, rest } = block.bsdfs[i].split(wo, arena);
            match diffuse {
                Some(diffuse) if leg.gathers => {
                    let known = self.known(&block, i, diffuse, paths.slots[j], edges, &mut sights);
                    let Some(light) = known else { continue };
                    out[paths.slots[j] as usize].value += paths.beta(j) * light;
                    match rest {
                        Some(rest) => block.bsdfs[i] = rest,
                        None => block.active &= !(1 << i),
                    }
                }
                Some(_) if !leg.branched && self.query.indirect => branching[i] = Branching::Gather,
                None if !leg.branched && block.finite >> i & 1 == 1 => branching[i] = Branching::Glossy,
                _ => {}
            }
        }
        let finite = bits(block.active).filter(|&i| !block.bsdfs[i].is_specular());
        block.finite = finite.fold(0, |set, i| set | 1 << i);
        Shaded { block, branching, sights }
    }

    /// The light that a diffuse part is known to send along the ray; `None` where the path should go on, because it has met
    /// a surface within the width of a disc of photons, or one whose light is not known, or is known only beyond a wall.
    fn known(
        &self,
        block: &Block<'_>,
        i: usize,
        diffuse: &Bsdf<'_>,
        slot: u32,
        edges: u32,
        sights: &mut u64,
    ) -> Option<Rgb> {
        let factor = diffuse.radiance_per_irradiance(block.wo.lane(i));
        let irradiance = self.maps(slot).irradiance.as_ref();
        if factor.is_black() || irradiance.is_none() || !self.allows(edges + 1) {
            return Some(Rgb::BLACK);
        }
        let at = place(block, i);
        let found = irradiance?.nearest(at)?;
        let d = block.rays.d.lane(i);
        let length = d.length();
        if length * block.at.hit[i].t < found.radius {
            return None;
        }
        let seen = found.free || {
            // From a point of the ray, which is seen from the place.
            let o = at.p - d * (at.p.distance(found.at.p) / length).min(block.at.hit[i].t);
            let (d, time) = (found.at.p - o, block.rays.time.as_array()[i]);
            d.dot(found.at.n) < 0.0 && {
                *sights += 1;
                !self.scene.accel.occluded(&Ray { o, d, t_max: SHORT, time })
            }
        };
        seen.then(|| factor * found.value)
    }

    /// Adds the density of caustic photons at the points of a block.
    fn add_caustics(&self, block: &Block<'_>, paths: &PathWave, buffer: &mut Nearest, out: &mut [Radiance]) {
        for i in bits(block.finite) {
            let j = block.first + i;
            let key = self.keys[paths.slots[j] as usize];
            let value = self.mapper.caustics.reflected(block, i, key, buffer);
            out[paths.slots[j] as usize].value += paths.beta(j) * value;
        }
    }

    /// Sends shadow rays from the finite lobes.
    fn sample_emitters(
        &self,
        edges: u32,
        shaded: &[Shaded<'_>],
        parents: &PathWave,
        coherence: Coherence,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        if !self.scene.needs.emitter_sampling || !self.query.wants(edges + 1) {
            return;
        }
        let mut keys = Vec::new();
        for branching in BRANCHINGS {
            let (samples, rays) = self.counts(branching);
            let lanes: Vec<u32> = shaded.iter().map(|s| s.lanes(branching) & s.block.finite).collect();
            if lanes.iter().all(|&lanes| lanes == 0) {
                continue;
            }
            let counts = TechniqueCounts { emitter: samples as f32, bsdf: rays as f32 };
            for s in 0..samples {
                keys.clear();
                keys.extend(parents.keys.iter().map(|&key| split(key, samples, s)));
                let Worker { sampler, numbers, shadows, .. } = &mut *worker;
                draw_1d(*sampler, Dimension::emitter_choice(edges - 1), &keys, &mut numbers.emitter_choice);
                draw_2d(*sampler, Dimension::emitter_point(edges - 1), &keys, &mut numbers.emitter_point);
                for (Shaded { block, .. }, &lanes) in
                    shaded.iter().zip(&lanes).filter(|(_, lanes)| **lanes != 0)
                {
                    let u_choice = load(&numbers.emitter_choice, block.first);
                    let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], block.first));
                    let sampled = lighting::sample_emitters(self.scene, block, u_choice, u_point, counts);
                    let beta = [0, 1, 2].map(|c| load(&parents.beta[c], block.first));
                    let value = std::array::from_fn(|c| beta[c] * sampled.value[c]);
                    shadows.push(&sampled.rays, &parents.slots[block.first..], &value, sampled.lanes & lanes);
                }
                worker.trace_shadows(self.scene, coherence, |slot, value| out[slot].value += value);
            }
        }
    }

    /// Puts the `s`-th ray into the BSDF of each surface that gets so many into the worker's hand.
    fn scatter(
        &self,
        edges: u32,
        s: u32,
        shaded: &[Shaded<'_>],
        legs: &[Leg],
        parents: &PathWave,
        worker: &mut Worker,
    ) -> Vec<Leg> {
        let keys = self.branch_keys(s, shaded, parents);
        let Worker { sampler, numbers, paths, .. } = worker;
        draw_1d(*sampler, Dimension::bsdf_lobe(edges - 1), &keys, &mut numbers.bsdf_lobe);
        draw_2d(*sampler, Dimension::bsdf_direction(edges - 1), &keys, &mut numbers.bsdf_direction);
        let roulette = Roulette::at(edges, self.mapper.settings.rr_depth);
        if roulette.is_some() {
            draw_1d(*sampler, Dimension::roulette(edges - 1), &keys, &mut numbers.roulette);
        }
        paths.copy_from(parents);
        paths.keys.copy_from_slice(&keys);
        let (mut alive, mut onward) = (0, Vec::new());
        for Shaded { block, branching, .. } in shaded {
            let (samples, rays) = self.lane_counts(branching, block.active, s);
            let lanes = rays.simd_gt(f32x16::ZERO).to_bitmask() & block.active;
            if lanes == 0 {
                continue;
            }
            let u_lobe = load(&numbers.bsdf_lobe, block.first);
            let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], block.first));
            let sample = bsdf::lanes::sample_x16(&block.bsdfs, &block.wo, u_lobe, u, lanes);
            let [r, g, b] = sample.weight;
            let strongest = r.fast_max(g).fast_max(b);
            let mut valid = sample.valid & strongest.simd_ne(f32x16::ZERO);
            let mut weight = sample.weight;
            if let Some(roulette) = roulette {
                // What a path brings does not decide, for where it branches all of its parts bring little.
                let on;
                let u = load(&numbers.roulette, block.first);
                (weight, on) = roulette.play_x16(weight, sample.eta * sample.eta, u);
                valid &= on;
            }
            let beta = std::array::from_fn(|c| load(&parents.beta[c], block.first) * weight[c] / rays);
            let next = Continuation {
                rays: self.scene.spawn_rays(&block.at, block.at.frame.to_world(sample.wi), block.rays.time),
                beta,
                // So the heuristic with one sample of each weights as that with the counts does.
                pdf: sample.pdf * rays / samples,
                eta: load(&parents.eta, block.first) * sample.eta,
            };
            let lanes = valid.to_bitmask() & lanes;
            alive = paths.compact(block.first, alive, &next, lanes);
            let leg = |i: usize| legs[block.first + i].onward(sample.pdf.as_array()[i], branching[i]);
            onward.extend(bits(lanes).map(leg));
        }
        paths.truncate(alive);
        onward
    }

    /// The keys of the `s`-th rays.
    fn branch_keys(&self, s: u32, shaded: &[Shaded<'_>], parents: &PathWave) -> Vec<SampleKey> {
        let mut keys = parents.keys.clone();
        for Shaded { block, branching, .. } in shaded {
            for i in bits(block.active) {
                let (_, rays) = self.counts(branching[i]);
                let key = &mut keys[block.first + i];
                *key = if rays == 1 { *key } else { split(*key, rays, s) };
            }
        }
        keys
    }

    /// The counts of emitter samples and rays in each lane; no rays where there is no `s`-th.
    fn lane_counts(&self, branching: &[Branching; LANES], active: u32, s: u32) -> (f32x16, f32x16) {
        let (mut samples, mut rays) = ([1.0; LANES], [0.0; LANES]);
        for i in bits(active) {
            let (m, n) = self.counts(branching[i]);
            samples[i] = m as f32;
            rays[i] = if s < n { n as f32 } else { 0.0 };
        }
        (f32x16::new(samples), f32x16::new(rays))
    }
}

impl Leg {
    /// What the path is after a surface that it has left in a direction of that density.
    fn onward(self, pdf: f32, branching: Branching) -> Leg {
        let light = match self.light {
            _ if pdf.is_finite() => Light::Finite,
            Light::Camera => Light::Camera,
            Light::Finite | Light::Caustic => Light::Caustic,
        };
        let branched = self.branched || branching != Branching::Single;
        Leg { light, gathers: self.gathers || (branched && pdf < SHARP), branched }
    }
}
