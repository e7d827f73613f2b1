//! Camera paths, one wave at a time, and the waves of rays that branch off them.

use super::maps::Maps;
use super::{Photonmapper, lookup_point};
use crate::accel::Coherence;
use crate::bsdf::{self, Bsdf, Split};
use crate::color::Rgb;
use crate::integrator::block::ShadingBlock;
use crate::integrator::lighting::{self, TechniqueCounts};
use crate::integrator::path::first_hits;
use crate::integrator::path_wave::{Continuation, PathWave};
use crate::integrator::photon::kdtree::NeighbourBuffer;
use crate::integrator::roulette::Roulette;
use crate::integrator::tree::split;
use crate::integrator::worker::{draw_1d, draw_2d, intersect};
use crate::integrator::{Radiance, RadianceQuery, Wave, Worker};
use crate::math::Ray;
use crate::math::lanes::{LANES, bits, f32x16, load};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;
use bumpalo::Bump;

/// The density of a sampled direction, sr⁻¹, above which photons are not looked up at its hit, because their blur
/// would be visible.
const MAX_LOOKUP_PDF: f32 = 4.0;

/// The upper bound of the parameter of a visibility ray to a precomputed point at 1. It excludes the surface of the
/// point.
const VISIBILITY_T_MAX: f32 = 0.996;

/// The type of scattering between the camera and a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PathHistory {
    /// Dirac deltas only: all emission is added.
    Camera,
    /// A finite lobe last: emission is added with its weight against emitter samples.
    Finite,
    /// A finite lobe, then Dirac deltas: emission is not added, because the caustic map contains it.
    Caustic,
}

/// The state of a path's current segment.
#[derive(Clone, Copy, Debug)]
struct PathSegment {
    history: PathHistory,
    /// Whether photons may be looked up at the end of the segment.
    gathers: bool,
    /// Whether the path is one of several branches.
    branched: bool,
}

/// The number of rays from a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BranchKind {
    /// One emitter sample and one BSDF sample.
    Single,
    /// The samples of a final gather.
    Gather,
    /// The samples of glossy lobes.
    Glossy,
}

const BRANCH_KINDS: [BranchKind; 3] = [BranchKind::Single, BranchKind::Gather, BranchKind::Glossy];

/// Sixteen surface points at which paths continue.
struct ShadedBlock<'a> {
    /// Lanes whose paths end are inactive. Where photons were looked up, the BSDF is reduced to the other lobes.
    block: ShadingBlock<'a>,
    kind: [BranchKind; LANES],
    /// The number of visibility rays traced to precomputed points.
    visibility_rays: u64,
}

impl ShadedBlock<'_> {
    /// Returns a mask of the active lanes of the given kind.
    fn lanes(&self, kind: BranchKind) -> u32 {
        bits(self.block.active).fold(0, |set, i| set | u32::from(self.kind[i] == kind) << i)
    }
}

/// The state shared by all paths of a wave.
struct PhotonmapperWave<'a> {
    mapper: &'a Photonmapper,
    scene: &'a Scene,
    query: RadianceQuery,
    /// The keys of the wave's rays, for each slot.
    keys: &'a [SampleKey],
    coherence: Coherence,
}

/// The greatest number of rays that branch off a wave at a time.
const MAX_RAYS: usize = 1 << 19;

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
    let segment = PathSegment { history: PathHistory::Camera, gathers, branched: gathers };
    let branches = mapper.settings.gather_samples.max(mapper.settings.glossy_samples);
    let rays = (MAX_RAYS / branches as usize).max(LANES);
    let parts = wave.rays.chunks(rays).zip(wave.keys.chunks(rays)).zip(out.chunks_mut(rays));
    for ((rays, keys), out) in parts {
        worker.paths.begin(rays, keys);
        let paths = PhotonmapperWave { mapper, scene, query, keys, coherence: wave.coherence };
        paths.trace(vec![segment; out.len()], worker, out);
    }
}

/// A wave of rays to be traced.
struct PendingWave {
    /// The number of edges of the paths, including these rays.
    edges: u32,
    segments: Vec<PathSegment>,
    paths: PathWave,
}

impl<'a> PhotonmapperWave<'a> {
    fn allows(&self, edges: u32) -> bool {
        self.mapper.settings.limits.allows(edges)
    }

    fn maps(&self, slot: u32) -> &'a Maps {
        &self.mapper.maps[self.keys[slot as usize].replicate as usize % self.mapper.maps.len()]
    }

    /// Returns whether emission found by a path with the given number of edges is added.
    fn wants(&self, history: PathHistory, edges: u32) -> bool {
        match history {
            PathHistory::Camera if edges == 1 => {
                self.query.emitted && !self.mapper.settings.limits.hide_emitters
            }
            PathHistory::Camera if self.query.separates_caustics() => self.query.caustic,
            PathHistory::Caustic => false,
            _ => self.query.wants(edges),
        }
    }

    /// Traces the worker's current wave and all its descendants.
    fn trace(&self, segments: Vec<PathSegment>, worker: &mut Worker, out: &mut [Radiance]) {
        let mut waves = vec![PendingWave { edges: 1, segments, paths: std::mem::take(&mut worker.paths) }];
        while let Some(wave) = waves.pop().filter(|_| !worker.interrupt.is_raised()) {
            let first = waves.len();
            self.trace_wave(wave, worker, out, &mut waves);
            // Waves are traced in the order of their creation.
            waves[first..].reverse();
        }
    }

    /// Traces a wave, adds the light found, and appends the waves that continue from it.
    fn trace_wave(
        &self,
        wave: PendingWave,
        worker: &mut Worker,
        out: &mut [Radiance],
        waves: &mut Vec<PendingWave>,
    ) {
        let PendingWave { edges, mut segments, paths } = wave;
        worker.paths = paths;
        let coherence = if edges == 1 { self.coherence } else { Coherence::Incoherent };
        intersect(self.scene, &worker.paths.rays, coherence, &mut worker.hits, &mut worker.counters);
        if edges == 1 {
            first_hits(self.scene, self.mapper.settings.limits.hide_emitters, worker, out);
        }
        self.drop_missed(edges, &mut segments, worker, out);
        let arena = Bump::new();
        let blocks: Vec<ShadingBlock<'_>> =
            ShadingBlock::all(self.scene, &arena, &worker.paths.rays, &worker.hits).collect();
        self.add_emitted(edges, &blocks, &segments, &worker.paths, out);
        if !self.allows(edges + 1) {
            return;
        }
        let mut buffer = NeighbourBuffer::default();
        let parents = std::mem::take(&mut worker.paths);
        let shaded: Vec<ShadedBlock<'_>> = blocks
            .into_iter()
            .map(|block| self.lookup_photons(edges, block, &segments, &parents, &arena, out))
            .collect();
        worker.counters.occlusion_rays += shaded.iter().map(|s| s.visibility_rays).sum::<u64>();
        if self.query.indirect {
            for shaded in &shaded {
                self.add_caustics(&shaded.block, &parents, &mut buffer, out);
            }
        }
        self.sample_emitters(edges, &shaded, &parents, coherence, worker, out);
        let most = BRANCH_KINDS
            .into_iter()
            .filter(|&kind| shaded.iter().any(|s| s.lanes(kind) != 0))
            .map(|kind| self.counts(kind).1)
            .max();
        for i in 0..most.unwrap_or(0) {
            let segments = self.scatter(edges, i, &shaded, &segments, &parents, worker);
            if !segments.is_empty() {
                waves.push(PendingWave {
                    edges: edges + 1,
                    segments,
                    paths: std::mem::take(&mut worker.paths),
                });
            }
        }
    }

    /// Returns the number of emitter samples and of BSDF samples at a surface.
    fn counts(&self, kind: BranchKind) -> (u32, u32) {
        let settings = &self.mapper.settings;
        match kind {
            BranchKind::Single => (1, 1),
            BranchKind::Gather => (settings.direct_samples, settings.gather_samples),
            BranchKind::Glossy => (settings.direct_samples, settings.glossy_samples),
        }
    }

    /// Removes the paths that hit nothing from the wave and adds the environment's radiance for them.
    fn drop_missed(
        &self,
        edges: u32,
        segments: &mut Vec<PathSegment>,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        let Worker { paths, hits, .. } = worker;
        let met: Vec<bool> = hits.iter().map(Option::is_some).collect();
        let wants = |_: &PathWave, i: usize| self.wants(segments[i].history, edges);
        lighting::drop_missed(self.scene, paths, hits, out, TechniqueCounts::UNCOMPENSATED, wants);
        let mut met = met.into_iter();
        segments.retain(|_| met.next().unwrap_or(false));
    }

    fn add_emitted(
        &self,
        edges: u32,
        blocks: &[ShadingBlock<'_>],
        segments: &[PathSegment],
        paths: &PathWave,
        out: &mut [Radiance],
    ) {
        for block in blocks {
            for (i, le) in lighting::emitted(self.scene, block, paths, TechniqueCounts::UNCOMPENSATED) {
                let j = block.first + i;
                if self.wants(segments[j].history, edges) {
                    out[paths.slots[j] as usize].value += paths.beta(j) * le;
                }
            }
        }
    }

    /// Adds the radiance from photons at the diffuse lobes that gather rays hit, and determines how the paths
    /// continue.
    fn lookup_photons<'b>(
        &self,
        edges: u32,
        mut block: ShadingBlock<'b>,
        segments: &[PathSegment],
        paths: &PathWave,
        arena: &'b Bump,
        out: &mut [Radiance],
    ) -> ShadedBlock<'b> {
        let mut visibility_rays = 0;
        let mut kind = [BranchKind::Single; LANES];
        for i in bits(block.active) {
            let (j, wo) = (block.first + i, block.wo.lane(i));
            let segment = segments[j];
            if segment.branched && !segment.gathers {
                continue;
            }
            let Split { diffuse, rest } = block.bsdfs[i].split(wo, arena);
            match diffuse {
                Some(diffuse) if segment.gathers => {
                    let radiance =
                        self.lookup_radiance(&block, i, diffuse, paths.slots[j], edges, &mut visibility_rays);
                    let Some(radiance) = radiance else { continue };
                    out[paths.slots[j] as usize].value += paths.beta(j) * radiance;
                    match rest {
                        Some(rest) => block.bsdfs[i] = rest,
                        None => block.active &= !(1 << i),
                    }
                }
                Some(_) if !segment.branched && self.query.indirect => kind[i] = BranchKind::Gather,
                None if !segment.branched && block.finite >> i & 1 == 1 => kind[i] = BranchKind::Glossy,
                _ => {}
            }
        }
        let finite = bits(block.active).filter(|&i| !block.bsdfs[i].is_specular());
        block.finite = finite.fold(0, |set, i| set | 1 << i);
        ShadedBlock { block, kind, visibility_rays }
    }

    /// Returns the precomputed radiance of a diffuse lobe along the ray. Returns `None` if the path must continue:
    /// the distance is less than the disc's radius, no irradiance is known, or the point is not visible.
    fn lookup_radiance(
        &self,
        block: &ShadingBlock<'_>,
        i: usize,
        diffuse: &Bsdf<'_>,
        slot: u32,
        edges: u32,
        visibility_rays: &mut u64,
    ) -> Option<Rgb> {
        let factor = diffuse.radiance_per_irradiance(block.wo.lane(i));
        let irradiance = self.maps(slot).irradiance.as_ref();
        if factor.is_black() || irradiance.is_none() || !self.allows(edges + 1) {
            return Some(Rgb::BLACK);
        }
        let at = lookup_point(block, i);
        let found = irradiance?.nearest(at)?;
        let d = block.rays.d.lane(i);
        let length = d.length();
        if length * block.at.hit[i].t < found.radius {
            return None;
        }
        let seen = found.free || {
            // From a point on the ray that is visible from the surface point.
            let o = at.p - d * (at.p.distance(found.at.p) / length).min(block.at.hit[i].t);
            let (d, time) = (found.at.p - o, block.rays.time.as_array()[i]);
            d.dot(found.at.n) < 0.0 && {
                *visibility_rays += 1;
                !self.scene.accel.occluded(&Ray { o, d, t_max: VISIBILITY_T_MAX, time })
            }
        };
        seen.then(|| factor * found.value)
    }

    /// Adds the density estimate of caustic photons at the points of a block.
    fn add_caustics(
        &self,
        block: &ShadingBlock<'_>,
        paths: &PathWave,
        buffer: &mut NeighbourBuffer,
        out: &mut [Radiance],
    ) {
        for i in bits(block.finite) {
            let j = block.first + i;
            let key = self.keys[paths.slots[j] as usize];
            let value = self.mapper.caustics.reflected(block, i, key, buffer);
            out[paths.slots[j] as usize].value += paths.beta(j) * value;
        }
    }

    /// Traces shadow rays for the finite lobes.
    fn sample_emitters(
        &self,
        edges: u32,
        shaded: &[ShadedBlock<'_>],
        parents: &PathWave,
        coherence: Coherence,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        if !self.scene.needs.emitter_sampling || !self.query.wants(edges + 1) {
            return;
        }
        let mut keys = Vec::new();
        for kind in BRANCH_KINDS {
            let (samples, rays) = self.counts(kind);
            let lanes: Vec<u32> = shaded.iter().map(|s| s.lanes(kind) & s.block.finite).collect();
            if lanes.iter().all(|&lanes| lanes == 0) {
                continue;
            }
            let counts = TechniqueCounts::uncompensated(samples, rays);
            for s in 0..samples {
                keys.clear();
                keys.extend(parents.keys.iter().map(|&key| split(key, samples, s)));
                let Worker { sampler, numbers, shadows, .. } = &mut *worker;
                draw_2d(*sampler, Dimension::emitter_point(edges - 1), &keys, &mut numbers.emitter_point);
                for (ShadedBlock { block, .. }, &lanes) in
                    shaded.iter().zip(&lanes).filter(|(_, lanes)| **lanes != 0)
                {
                    let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], block.first));
                    let sampled = lighting::sample_emitters(self.scene, block, u_point, counts);
                    let beta = [0, 1, 2].map(|c| load(&parents.beta[c], block.first));
                    let value = std::array::from_fn(|c| beta[c] * sampled.value[c]);
                    shadows.push(&sampled.rays, &parents.slots[block.first..], &value, sampled.lanes & lanes);
                }
                worker.trace_shadows(self.scene, coherence, |slot, value| out[slot].value += value);
            }
        }
    }

    /// Samples the `s`-th ray of each surface that has so many, into the worker's current wave.
    fn scatter(
        &self,
        edges: u32,
        s: u32,
        shaded: &[ShadedBlock<'_>],
        segments: &[PathSegment],
        parents: &PathWave,
        worker: &mut Worker,
    ) -> Vec<PathSegment> {
        let keys = self.branch_keys(s, shaded, parents);
        let Worker { sampler, numbers, paths, .. } = worker;
        draw_1d(*sampler, Dimension::bsdf_lobe(edges - 1), &keys, &mut numbers.bsdf_lobe);
        draw_2d(*sampler, Dimension::bsdf_direction(edges - 1), &keys, &mut numbers.bsdf_direction);
        let roulette = Roulette::at(edges, self.mapper.settings.limits.rr_depth);
        if roulette.is_some() {
            draw_1d(*sampler, Dimension::roulette(edges - 1), &keys, &mut numbers.roulette);
        }
        paths.copy_from(parents);
        paths.keys.copy_from_slice(&keys);
        let (mut alive, mut continued) = (0, Vec::new());
        for ShadedBlock { block, kind, .. } in shaded {
            let (samples, rays) = self.lane_counts(kind, block.active, s);
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
                // The throughput itself is not used: where a path branches, every branch has a small throughput.
                let on;
                let u = load(&numbers.roulette, block.first);
                (weight, on) = roulette.play_x16(weight, sample.eta * sample.eta, u);
                valid &= on;
            }
            let beta = std::array::from_fn(|c| load(&parents.beta[c], block.first) * weight[c] / rays);
            let next = Continuation {
                from: block.at.p,
                gloss: None,
                rays: self.scene.spawn_rays(&block.at, block.at.frame.to_world(sample.wi), block.rays.time),
                beta,
                // With this density, the power heuristic with one sample of each technique gives the weights for
                // these counts.
                pdf: sample.pdf * rays / samples,
                eta: load(&parents.eta, block.first) * sample.eta,
            };
            let lanes = valid.to_bitmask() & lanes;
            alive = paths.compact(block.first, alive, &next, lanes);
            let segment = |i: usize| segments[block.first + i].continued(sample.pdf.as_array()[i], kind[i]);
            continued.extend(bits(lanes).map(segment));
        }
        paths.truncate(alive);
        continued
    }

    /// Returns the keys of the `s`-th rays.
    fn branch_keys(&self, s: u32, shaded: &[ShadedBlock<'_>], parents: &PathWave) -> Vec<SampleKey> {
        let mut keys = parents.keys.clone();
        for ShadedBlock { block, kind, .. } in shaded {
            for i in bits(block.active) {
                let (_, rays) = self.counts(kind[i]);
                let key = &mut keys[block.first + i];
                *key = if rays == 1 { *key } else { split(*key, rays, s) };
            }
        }
        keys
    }

    /// Returns the numbers of emitter samples and rays in each lane; no rays if there is no `s`-th one.
    fn lane_counts(&self, kind: &[BranchKind; LANES], active: u32, s: u32) -> (f32x16, f32x16) {
        let (mut samples, mut rays) = ([1.0; LANES], [0.0; LANES]);
        for i in bits(active) {
            let (m, n) = self.counts(kind[i]);
            samples[i] = m as f32;
            rays[i] = if s < n { n as f32 } else { 0.0 };
        }
        (f32x16::new(samples), f32x16::new(rays))
    }
}

impl PathSegment {
    /// Returns the state of the next segment, for a direction sampled with the density `pdf`.
    fn continued(self, pdf: f32, kind: BranchKind) -> PathSegment {
        let history = match self.history {
            _ if pdf.is_finite() => PathHistory::Finite,
            PathHistory::Camera => PathHistory::Camera,
            PathHistory::Finite | PathHistory::Caustic => PathHistory::Caustic,
        };
        let branched = self.branched || kind != BranchKind::Single;
        PathSegment { history, gathers: self.gathers || (branched && pdf < MAX_LOOKUP_PDF), branched }
    }
}
