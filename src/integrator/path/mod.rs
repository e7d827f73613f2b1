//! The path integrator. [Kajiya 1986; Veach 1997]
//!
//! A wave of paths advances one bounce at a time: it finds all nearest hits, then shades in blocks of sixteen, then
//! traces all shadow rays. In shading, each path adds at most one shadow ray with its pending contribution and at
//! most one next ray, or several at the first surface if paths are [split](splitting); terminated paths are removed.

pub mod between;
pub mod caustics;
pub mod groups;
mod links;
mod pilot;
mod reuse;
mod splitting;

use self::between::{Between, Sides};
use self::caustics::{CausticTracer, CausticWave};
use self::groups::CellSide;
use self::reuse::Reuse;
use self::splitting::Splitting;
use super::block::ShadingBlock;
use super::guiding::{GuidedBlock, GuidingField};
use super::lighting::{self, TechniqueCounts};
use super::path_wave::{Continuation, PathWave};
use super::roulette::Roulette;
use super::settings::{HiddenLight, PathLimits, Plugin, Read, Source, WhenPays};
use super::shadows::ShadowQueue;
use super::worker::{BounceNumbers, RandomNumbers, intersect};
use super::{
    Integrator, LightTracer, Preparation, Radiance, RadianceQuery, Statistic, Wave, Worker, emission,
};
use crate::accel::Coherence;
use crate::bsdf;
use crate::error::Result;
use crate::math::lanes::{LANES, bits, f32x16, load, mask_from_bits};
use crate::scene::Scene;
use bumpalo::Bump;

/// The parameters of path tracing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct PathSettings {
    /// The paths.
    pub limits: PathLimits,
    /// Whether the paths of neighbouring pixels are reused for each other. They are not if surfaces or the camera move,
    /// because a point is found at one time only.
    pub reuse: WhenPays,
    /// Whether paths that are not reused are split at the first surface.
    pub splitting: WhenPays,
    /// Whether paths are guided by photons.
    pub guided: bool,
    /// Whether light paths find caustics; not if camera paths are guided.
    pub caustics: WhenPays,
}

impl PathSettings {
    /// Returns the settings for independent unguided paths from the camera alone, with the given limits.
    pub fn independent(limits: PathLimits) -> Self {
        let never = WhenPays::Never;
        PathSettings { limits, reuse: never, splitting: never, guided: false, caustics: never }
    }
}

impl From<PathLimits> for PathSettings {
    fn from(limits: PathLimits) -> Self {
        PathSettings { limits, ..PathSettings::default() }
    }
}

/// Unidirectional path tracing with next-event estimation, combined by the power heuristic.
pub struct PathIntegrator {
    settings: PathLimits,
    reuse: WhenPays,
    when_split: WhenPays,
    guided: bool,
    light_paths: WhenPays,
    /// The cells in which paths are reused, as decided by the settings or the pilot.
    cells: Option<CellSide>,
    /// The samples at the first surface of paths that are not reused.
    splitting: Splitting,
    /// The densities that guide paths.
    field: Option<GuidingField>,
    /// The light paths that find caustics.
    caustics: Option<CausticTracer>,
}

/// The state shared by all paths of a bounce.
struct PathBounce<'a> {
    scene: &'a Scene,
    /// The number of surfaces before.
    depth: u32,
    /// The samples at each surface of this bounce.
    splitting: Splitting,
    /// The densities that guide paths.
    field: Option<&'a GuidingField>,
    /// Whether emitters are sampled at this bounce.
    next_event: bool,
    /// Whether emission found by the rays of this bounce is added.
    add_emission: bool,
    /// Whether emission is added for rays with specular lobes only, if caustics are separated.
    add_caustics: Option<bool>,
    /// Russian roulette, if it applies at this bounce.
    roulette: Option<Roulette>,
    /// The media on the sides of surfaces, if they are rendered.
    sides: Option<Sides<'a>>,
}

impl PathIntegrator {
    /// Creates the integrator.
    pub fn new(PathSettings { limits, reuse, splitting, guided, caustics }: PathSettings) -> Self {
        PathIntegrator {
            settings: limits,
            reuse,
            when_split: splitting,
            guided,
            light_paths: if guided { WhenPays::Never } else { caustics },
            cells: (reuse == WhenPays::Always).then_some(CellSide::Eight),
            splitting: Splitting::NONE,
            field: None,
            caustics: None,
        }
    }

    /// Returns whether a path may have the given number of edges.
    fn allows(&self, edges: u32) -> bool {
        self.settings.allows(edges)
    }
}

impl Plugin for PathIntegrator {
    const NAME: &'static str = "path";
    const HIDDEN_LIGHT: HiddenLight = HiddenLight::Missed;
    type Settings = PathSettings;

    fn read(source: &mut dyn Source) -> Result<PathSettings> {
        let limits = PathLimits::read(source)?;
        let reuse = source.choice("path_reuse", &WhenPays::NAMES, WhenPays::Auto)?;
        let splitting = source.choice("path_splitting", &WhenPays::NAMES, WhenPays::Auto)?;
        let guided = source.boolean("path_guiding", false)?;
        let caustics = source.choice("path_caustics", &WhenPays::NAMES, WhenPays::Auto)?;
        Ok(PathSettings { limits, reuse, splitting, guided, caustics })
    }

    fn with_limits(limits: PathLimits) -> PathSettings {
        limits.into()
    }

    fn limits(settings: &PathSettings) -> PathLimits {
        settings.limits
    }

    fn create(settings: &PathSettings) -> Box<dyn Integrator> {
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

    fn reuse_cells(&self) -> Option<CellSide> {
        self.cells
    }

    fn paths_per_ray(&self) -> u32 {
        self.splitting.directions
    }

    fn shows_emitters(&self) -> bool {
        !self.settings.hide_emitters && self.allows(1)
    }

    fn adapts(&self) -> bool {
        true
    }

    fn prepares(&self) -> bool {
        let choices = [self.reuse, self.when_split, self.light_paths];
        self.guided || choices.into_iter().any(|choice| choice != WhenPays::Never)
    }

    fn prepare(&mut self, preparation: &Preparation<'_>) -> Result<()> {
        self.field = self.guided.then(|| GuidingField::learn(preparation, self.settings)).flatten();
        self.caustics = (self.light_paths != WhenPays::Never)
            .then(|| CausticTracer::learn(preparation, self.settings))
            .flatten();
        let reuse = if preparation.scene.needs.time { WhenPays::Never } else { self.reuse };
        let split = if reuse == WhenPays::Always { WhenPays::Never } else { self.when_split };
        let pilots = [reuse, split].into_iter().any(|choice| choice != WhenPays::Never);
        let pilot =
            (pilots || self.caustics.is_some()).then(|| pilot::run(self, [reuse, split], preparation));
        self.cells = pilot.as_ref().and_then(|pilot| pilot.cells);
        self.splitting = pilot.as_ref().map_or(Splitting::NONE, |pilot| pilot.splitting);
        if let (Some(caustics), Some(pilot)) = (&mut self.caustics, &pilot) {
            let always = self.light_paths == WhenPays::Always;
            // The points of reused paths have densities of the group.
            let surfaces = if self.cells.is_some() { 1 } else { caustics::MOST_SURFACES };
            let (traced, splitting) = caustics.choose_share(preparation, &pilot.known, always, surfaces);
            self.splitting = splitting;
            if !traced {
                self.caustics = None;
            }
        }
        Ok(())
    }

    fn light_tracer(&self) -> Option<&dyn LightTracer> {
        self.caustics.as_ref().map(|caustics| caustics as &dyn LightTracer)
    }

    fn statistics(&self) -> Vec<Statistic> {
        let cells = self.field.as_ref().map_or(0, GuidingField::len);
        vec![
            Statistic { name: "path_reuse", value: self.cells.map_or(0.0, |side| f64::from(side as u8)) },
            Statistic { name: "emitter_samples", value: f64::from(self.splitting.emitters) },
            Statistic { name: "directions", value: f64::from(self.splitting.directions) },
            Statistic { name: "guided_cells", value: cells as f64 },
            Statistic {
                name: "caustic_light_paths",
                value: self.caustics.as_ref().map_or(0.0, CausticTracer::share),
            },
            Statistic {
                name: "caustic_surfaces",
                value: self.caustics.as_ref().map_or(0.0, |caustics| f64::from(caustics.surfaces())),
            },
        ]
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        // A point that moves is found at one time only.
        if wave.groups.is_empty() || query != RadianceQuery::ALL || scene.needs.time {
            return self.trace_split(scene, wave, (query, self.splitting), worker, out);
        }
        // The BSDFs of shared points are used until they are connected.
        let mut arena = std::mem::take(&mut worker.kept_arena);
        let mut all = std::mem::take(&mut worker.radiance);
        all.clear();
        all.resize(2 * out.len(), Radiance::NONE);
        let mut reuse = Reuse::new(wave.groups, out.len(), &arena);
        let with = (Some((&mut reuse, &arena)), None);
        self.trace(scene, wave, (query, Splitting::NONE), worker, &mut all, with);
        out.copy_from_slice(&all[..out.len()]);
        reuse.finish(&all, out);
        drop(reuse);
        arena.reset();
        (worker.kept_arena, worker.radiance) = (arena, all);
    }
}

impl PathIntegrator {
    /// Estimates the radiance along the rays of a wave, with paths that are not reused.
    fn trace_split(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        (query, splitting): (RadianceQuery, Splitting),
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        if splitting.directions == 1 {
            out.fill(Radiance::NONE);
            return self.trace(scene, wave, (query, splitting), worker, out, (None, None));
        }
        let mut all = std::mem::take(&mut worker.radiance);
        all.clear();
        all.resize(splitting.directions as usize * out.len(), Radiance::NONE);
        self.trace(scene, wave, (query, splitting), worker, &mut all, (None, None));
        splitting::gather(&all, out);
        worker.radiance = all;
    }

    /// Estimates the radiance along the rays of a wave, whose paths media scatter between surfaces.
    pub fn trace_through<'a>(
        &'a self,
        between: &mut dyn Between<'a>,
        wave: Wave<'_>,
        query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        out.fill(Radiance::NONE);
        let scene = between.sides().scene;
        self.trace(scene, wave, (query, Splitting::NONE), worker, out, (None, Some(between)));
    }

    /// Traces the paths of a wave. With reuse, the second half of `out` is for tails. If paths are split, `out` has an
    /// entry for each direction of each path.
    fn trace<'a>(
        &'a self,
        scene: &'a Scene,
        wave: Wave<'_>,
        (query, splitting): (RadianceQuery, Splitting),
        worker: &mut Worker,
        out: &mut [Radiance],
        (mut reuse, mut between): (Option<(&mut Reuse<'a>, &'a Bump)>, Option<&mut dyn Between<'a>>),
    ) {
        worker.paths.begin(wave.rays, wave.keys);
        let buffer = std::mem::take(&mut worker.caustic_ratios);
        let mut caustics = self
            .caustics
            .as_ref()
            .map(|tracer| CausticWave::new(tracer, wave.rays, splitting, out.len(), buffer));
        worker.specular_only.clear();
        worker.specular_only.resize(if query.separates_caustics() { out.len() } else { 0 }, true);
        let samples_emitters = TechniqueCounts::ONE_EACH.samples_emitters(scene);
        let mut depth = 0;
        while !worker.paths.rays.is_empty() && self.allows(depth + 1) && !worker.interrupt.is_raised() {
            let coherence = if depth == 0 { wave.coherence } else { Coherence::Incoherent };
            intersect(scene, &worker.paths.rays, coherence, &mut worker.hits, &mut worker.counters);
            if depth == 0 {
                let hides = self.settings.hide_emitters;
                let passes = between.as_ref().is_some_and(|between| between.passes_hidden());
                first_hits(scene, hides && !passes, worker, out);
            }
            if let Some(between) = &mut between {
                between.advance(depth, worker, out);
            }
            let bounce = PathBounce {
                scene,
                depth,
                splitting: if depth == 0 { splitting } else { Splitting::NONE },
                field: self.field.as_ref(),
                next_event: samples_emitters && self.allows(depth + 2) && query.wants(depth + 2),
                add_emission: query.wants(depth + 1) && !(depth == 0 && self.settings.hide_emitters),
                add_caustics: (depth > 0 && query.separates_caustics()).then_some(query.caustic),
                roulette: Roulette::at(depth + 1, self.settings.rr_depth),
                sides: between.as_ref().map(|between| between.sides()),
            };
            let Worker { paths, hits, numbers, split_numbers, specular_only, sampler, sort_buffers, .. } =
                &mut *worker;
            if let Some(caustics) = caustics.as_ref().filter(|_| bounce.add_emission) {
                caustics.add_missed(scene, paths, hits, out);
            }
            if let Some((reuse, _)) = &mut reuse
                && scene.needs.environment
            {
                reuse.add_missed(paths, hits);
            }
            let is_shared = |slot| reuse.as_ref().is_some_and(|(reuse, _)| reuse.is_shared(slot));
            lighting::add_missed(scene, paths, hits, out, TechniqueCounts::ONE_EACH, |paths, i| {
                let slot = paths.slots[i];
                bounce.adds(specular_only, slot)
                    && !is_shared(slot)
                    && !caustics.as_ref().is_some_and(|caustics| caustics.are_in(slot))
            });
            paths.keep_sorted(hits, &scene.shading_buckets, sort_buffers);
            let scatter = self.allows(depth + 2) && (query.direct || query.indirect || query.caustic);
            if scatter {
                let uses = BounceNumbers {
                    next_event: bounce.next_event,
                    lobe: scene.needs.lobe_choice,
                    direction: true,
                    roulette: bounce.roulette.is_some(),
                };
                match bounce.splitting {
                    Splitting::NONE => numbers.draw(uses, depth, *sampler, &paths.keys),
                    splitting => splitting.draw(uses, *sampler, &paths.keys, split_numbers),
                }
            }
            match &mut reuse {
                Some((reuse, arena)) => {
                    bounce.shade(scatter, worker, out, &mut caustics, Some((reuse, arena)));
                    let Worker { paths, counters, .. } = &mut *worker;
                    reuse.connect(scene, paths, counters, out);
                }
                None => bounce.shade(scatter, worker, out, &mut caustics, None),
            }
            if bounce.next_event || between.is_some() {
                worker.trace_shadows(scene, coherence, |slot, value| out[slot].value += value);
            }
            if let Some(between) = &mut between {
                between.rejoin(&mut worker.paths);
            }
            depth += 1;
        }
        worker.caustic_ratios = caustics.map(CausticWave::into_buffer).unwrap_or_default();
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

impl<'a> PathBounce<'a> {
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
    fn shade(
        &self,
        scatter: bool,
        worker: &mut Worker,
        out: &mut [Radiance],
        caustics: &mut Option<CausticWave<'_>>,
        mut reuse: Option<(&mut Reuse<'a>, &'a Bump)>,
    ) {
        let Worker { hits, shadows, paths, numbers, split_numbers, arena, specular_only, sampler, .. } =
            worker;
        let Splitting { emitters, directions } = self.splitting;
        let numbers = match self.splitting {
            Splitting::NONE => std::slice::from_ref(numbers),
            _ => &split_numbers[..],
        };
        // The paths that are split off follow the others.
        let (mut alive, count) = (0, hits.len());
        let mut end = count;
        if scatter {
            paths.make_room(count * directions as usize);
        }
        for first in (0..hits.len()).step_by(LANES) {
            arena.reset();
            let Some((reuse, kept)) =
                reuse.as_mut().filter(|(reuse, _)| scatter && reuse.has_single(first, paths))
            else {
                let mut block = ShadingBlock::new(self.scene, arena, &paths.rays, hits, first);
                block.find_gloss(self.scene);
                self.add_emitted(&block, paths, specular_only, caustics.as_ref(), out, block.active);
                if scatter {
                    let guided = self.field.and_then(|field| GuidedBlock::new(field, self.scene, &block));
                    if self.next_event && block.finite != 0 {
                        for numbers in &numbers[..emitters as usize] {
                            self.light(&block, paths, numbers, shadows, guided.as_ref());
                        }
                    }
                    // The first one takes the place of the path.
                    for number in (0..directions).rev() {
                        let numbers = &numbers[number as usize];
                        let (next, survivors) = self.scatter(&block, paths, numbers, guided.as_ref(), [0; 2]);
                        // The entries of the output for the others follow those of the first.
                        let entries = number * (out.len() as u32 / directions);
                        if !specular_only.is_empty() {
                            for i in bits(survivors) {
                                let only = &mut specular_only[(paths.slots[first + i] + entries) as usize];
                                *only &= next.pdf.as_array()[i].is_infinite();
                            }
                        }
                        if let Some(caustics) = caustics {
                            caustics.scatter(&block, paths, &next, survivors, entries, self.depth);
                        }
                        let to = if number == 0 { &mut alive } else { &mut end };
                        let written = *to;
                        if let Some(sides) = &self.sides {
                            sides.enter(&block, &next, survivors, &mut paths.in_media[first..]);
                        }
                        *to = paths.compact(first, *to, &next, survivors);
                        if directions > 1 {
                            for i in written..*to {
                                paths.keys[i] = sampler.split(paths.keys[i], directions, number);
                                paths.slots[i] += entries;
                            }
                        }
                    }
                }
                continue;
            };
            let mut block = ShadingBlock::new(self.scene, kept, &paths.rays, hits, first);
            block.find_gloss(self.scene);
            let guided = self.field.and_then(|field| GuidedBlock::new(field, self.scene, &block));
            // The directions at shared points and towards them have the density of the BSDF alone.
            let single = reuse.single(&block, paths) & !guided.as_ref().map_or(0, |guided| guided.lanes);
            let shared = reuse.shareable(&block, paths, single);
            let numbers = &numbers[0];
            self.add_emitted(&block, paths, specular_only, caustics.as_ref(), out, !shared);
            if self.next_event && block.finite != 0 {
                self.light_with_reuse(&block, paths, numbers, shadows, guided.as_ref(), (reuse, shared));
            } else {
                reuse.add_points(&block, paths, None, shared);
            }
            let vertices = if self.roulette.is_none() { single & !shared & block.finite } else { 0 };
            reuse.add_vertices(&block, paths, vertices);
            // The directions of these paths have a density for the group, even if their own pixels do not need them.
            let (next, survivors) =
                self.scatter(&block, paths, numbers, guided.as_ref(), [shared, shared | vertices]);
            let finite = next.pdf.simd_lt(f32x16::splat(f32::INFINITY)).to_bitmask();
            for i in bits(survivors & shared & finite) {
                let path = alive + (survivors & ((1 << i) - 1)).count_ones() as usize;
                let wi = block.at.frame.to_local(next.rays.d).lane(i);
                reuse.set_tail(paths.slots[first + i], wi, path);
            }
            if let Some(caustics) = caustics {
                caustics.scatter(&block, paths, &next, survivors, 0, self.depth);
            }
            alive = paths.compact(first, alive, &next, survivors);
        }
        paths.truncate(end);
        paths.remove(alive..count);
    }

    /// Adds the light of the emitters that the paths of a block hit, for the lanes in a mask.
    #[inline(always)]
    fn add_emitted(
        &self,
        block: &ShadingBlock<'_>,
        paths: &PathWave,
        specular_only: &[bool],
        caustics: Option<&CausticWave<'_>>,
        out: &mut [Radiance],
        mut lanes: u32,
    ) {
        if let Some(caustics) = caustics.filter(|_| self.add_emission) {
            lanes &= !caustics.add_emitted(self.scene, block, paths, out, lanes);
        }
        if self.may_add() && block.at.emitting & block.active & lanes != 0 {
            for (i, le) in lighting::emitted(self.scene, block, paths, TechniqueCounts::ONE_EACH) {
                let slot = paths.slots[block.first + i];
                if lanes >> i & 1 == 1 && self.adds(specular_only, slot) {
                    out[slot as usize].value += paths.beta(block.first + i) * le;
                }
            }
        }
    }

    /// Samples an emitter at each point of the block. Gives the samples of the lanes in the mask `shared` to the
    /// groups, and queues shadow rays for the other lanes.
    fn light_with_reuse(
        &self,
        block: &ShadingBlock<'a>,
        paths: &PathWave,
        numbers: &RandomNumbers,
        shadows: &mut ShadowQueue,
        guided: Option<&GuidedBlock<'_>>,
        (reuse, shared): (&mut Reuse<'a>, u32),
    ) {
        let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], block.first));
        let sample = lighting::draw_emitters(self.scene, block, u_point, TechniqueCounts::ONE_EACH);
        let alone = block.finite & !shared;
        if alone != 0 {
            let sampled = lighting::reflect_emitters(
                self.scene,
                block,
                &sample,
                TechniqueCounts::ONE_EACH,
                guided,
                alone,
            );
            let value = std::array::from_fn(|c| load(&paths.beta[c], block.first) * sampled.value[c]);
            shadows.push(&sampled.rays, &paths.slots[block.first..], &value, sampled.lanes);
        }
        let rays = self.scene.shadow_rays(&block.at, &sample, block.rays.time).to_rays();
        reuse.add_points(block, paths, Some((&sample, rays)), shared);
    }

    /// Queues a shadow ray from each point of the block.
    #[inline(always)]
    fn light(
        &self,
        block: &ShadingBlock<'_>,
        paths: &PathWave,
        numbers: &RandomNumbers,
        shadows: &mut ShadowQueue,
        guided: Option<&GuidedBlock<'_>>,
    ) {
        let u_point = [0, 1].map(|k| load(&numbers.emitter_point[k], block.first));
        let counts = self.splitting.counts();
        let sample = lighting::draw_emitters(self.scene, block, u_point, counts);
        let sampled = lighting::reflect_emitters(self.scene, block, &sample, counts, guided, block.finite);
        let value = std::array::from_fn(|c| load(&paths.beta[c], block.first) * sampled.value[c]);
        let clear = self.sides.map_or(sampled.lanes, |sides| {
            let (sample, lanes) = ((&sample.wi, &sampled.rays, &value), sampled.lanes);
            sides.queue_inside(block, paths, self.depth, sample, lanes, shadows)
        });
        shadows.push(&sampled.rays, &paths.slots[block.first..], &value, clear);
    }

    /// Samples the BSDFs and applies Russian roulette, except in the lanes of the mask `spared`; returns the
    /// continuations and a mask of the surviving lanes. The lanes of the mask `kept` survive without throughput.
    #[inline(always)]
    fn scatter(
        &self,
        block: &ShadingBlock<'_>,
        paths: &PathWave,
        numbers: &RandomNumbers,
        guided: Option<&GuidedBlock<'_>>,
        [spared, kept]: [u32; 2],
    ) -> (Continuation, u32) {
        let u_lobe = load(&numbers.bsdf_lobe, block.first);
        let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], block.first));
        let sample = match guided {
            Some(guided) => guided.sample(block, u_lobe, u),
            None => bsdf::lanes::sample_x16(&block.bsdfs, &block.wo, u_lobe, u, block.active),
        };
        let mut beta: [f32x16; 3] =
            std::array::from_fn(|c| load(&paths.beta[c], block.first) * sample.weight[c]);
        let eta = load(&paths.eta, block.first) * sample.eta;
        let strongest = beta[0].fast_max(beta[1]).fast_max(beta[2]);
        let mut alive = sample.valid & (strongest.simd_ne(f32x16::ZERO) | mask_from_bits(kept));
        if let Some(roulette) = self.roulette {
            // `eta²` removes the scaling of radiance inside a dielectric, which does not change a path's importance.
            let (played, on) = roulette.play_x16(beta, eta * eta, load(&numbers.roulette, block.first));
            let spared = mask_from_bits(spared);
            beta = std::array::from_fn(|c| spared.select(beta[c], played[c]));
            alive &= on | spared;
        }
        let mut pdf = sample.pdf;
        if self.splitting != Splitting::NONE {
            pdf *= f32x16::splat(self.splitting.density());
            beta = beta.map(|channel| channel / f32x16::splat(self.splitting.directions as f32));
        }
        let wi = block.at.frame.to_world(sample.wi);
        let rays = self.scene.spawn_rays(&block.at, wi, block.rays.time);
        (
            Continuation { rays, from: block.at.p, gloss: block.gloss, beta, pdf, eta },
            alive.to_bitmask() & block.active,
        )
    }
}
