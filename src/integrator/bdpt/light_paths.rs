//! Light subpaths, whose vertices are kept.

use super::technique::Techniques;
use super::weights::{Merged, Partial, Start};
use crate::accel::{Coherence, Hit};
use crate::bsdf::lanes::{eval_x16, sample_adjoint_x16};
use crate::color::Rgb;
use crate::integrator::block::ShadingBlock;
use crate::integrator::light_path::{EmissionNumbers, LightVertex};
use crate::integrator::photon::EmissionGuide;
use crate::integrator::roulette::Roulette;
use crate::integrator::settings::PathLimits;
use crate::integrator::worker::{RandomNumbers, Worker, draw_1d, draw_2d, intersect};
use crate::math::Ray;
use crate::math::lanes::{LANES, bits, f32x16, load};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;
use bumpalo::Bump;

/// A vertex of a light path with a finite lobe.
pub struct StoredVertex<'a> {
    /// The surface point.
    pub vertex: LightVertex<'a>,
    /// The power that arrives, W.
    pub power: Rgb,
    /// The partial weight at the vertex.
    pub partial: Partial,
    /// The number of edges from the emitter.
    pub edges: u32,
    /// The index of the light path.
    pub path: u32,
    /// The index of the previous vertex of the light path that is kept.
    previous: Option<u32>,
}

/// The kept vertices of many light paths.
pub struct LightPaths<'a> {
    /// The vertices: all first ones, then all second ones, and so on.
    pub vertices: Vec<StoredVertex<'a>>,
    /// The last kept vertex of each light path.
    last: Vec<Option<u32>>,
}

/// The state of a light path between two vertices.
#[derive(Clone, Copy)]
struct Subpath {
    key: SampleKey,
    index: u32,
    ray: Ray,
    power: Rgb,
    /// The product of the weights at the vertices, for Russian roulette.
    beta: Rgb,
    state: State,
}

/// The weights of a light path between two vertices.
#[derive(Clone, Copy)]
enum State {
    /// Before the first vertex.
    Started(usize, Start),
    /// After a vertex.
    Scattered(Partial),
}

/// The light paths to trace.
#[derive(Clone, Copy)]
pub struct LightPathSettings<'a> {
    pub limits: PathLimits,
    /// The density of their starts.
    pub guide: Option<&'a EmissionGuide>,
    /// The techniques that contribute.
    pub techniques: Techniques,
    /// The least number of edges with which a path reaches the camera from a vertex.
    pub beyond: u32,
    pub merged: Merged,
    /// Whether only caustics are traced, that a camera path can find too: emitters are no Dirac deltas, and a path ends
    /// at its first vertex with a finite lobe, which is kept unless it is the first of all.
    pub caustics: bool,
}

impl LightPathSettings<'_> {
    /// Returns whether a light path may have so many edges.
    fn allows(&self, edges: u32) -> bool {
        self.limits.allows(edges + self.beyond)
    }
}

impl<'a> LightPaths<'a> {
    /// Traces a light path for each key.
    pub fn trace(
        scene: &'a Scene,
        arena: &'a Bump,
        settings: LightPathSettings<'_>,
        keys: &[SampleKey],
        worker: &mut Worker,
    ) -> Self {
        let mut paths = LightPaths { vertices: Vec::new(), last: vec![None; keys.len()] };
        let mut subpaths = if settings.allows(1) { start(scene, settings, keys, worker) } else { Vec::new() };
        let mut next = Vec::new();
        let mut edges = 1;
        while !subpaths.is_empty() && !worker.interrupt.is_raised() {
            let rays: Vec<Ray> = subpaths.iter().map(|path| path.ray).collect();
            intersect(scene, &rays, Coherence::Incoherent, &mut worker.hits, &mut worker.counters);
            let ends = |hit: &Hit| settings.caustics && edges == 1 && !scene.has_deltas(hit);
            worker.hits.iter_mut().for_each(|hit| *hit = hit.filter(|hit| !ends(hit)));
            let mut hits = worker.hits.iter();
            subpaths.retain(|_| hits.next().is_some_and(Option::is_some));
            worker.hits.retain(Option::is_some);
            paths.add_vertices(scene, arena, settings, edges, &subpaths, worker, &mut next);
            std::mem::swap(&mut subpaths, &mut next);
            next.clear();
            edges += 1;
        }
        paths
    }

    /// Returns the kept vertices of a light path, the last first.
    pub fn of(&self, path: usize) -> impl Iterator<Item = &StoredVertex<'a>> {
        let at = |i: u32| &self.vertices[i as usize];
        std::iter::successors(self.last[path].map(at), move |vertex| vertex.previous.map(at))
    }

    /// Keeps the vertices of all subpaths, and adds their continuations to `next`.
    #[expect(clippy::too_many_arguments, reason = "the state of a wave")]
    fn add_vertices(
        &mut self,
        scene: &'a Scene,
        arena: &'a Bump,
        settings: LightPathSettings<'_>,
        edges: u32,
        subpaths: &[Subpath],
        worker: &mut Worker,
        next: &mut Vec<Subpath>,
    ) {
        let rays: Vec<Ray> = subpaths.iter().map(|path| path.ray).collect();
        let keys: Vec<SampleKey> = subpaths.iter().map(|path| path.key).collect();
        let Worker { numbers, hits, sampler, .. } = worker;
        let go_on = settings.allows(edges + 1);
        // Light paths play at every vertex: long ones contribute little, but cost as much as camera paths.
        let roulette = Roulette::at(edges, 1);
        if go_on {
            draw_1d(*sampler, Dimension::bsdf_lobe(edges - 1).repeat(1), &keys, &mut numbers.bsdf_lobe);
            let dimension = Dimension::bsdf_direction(edges - 1).repeat(1);
            draw_2d(*sampler, dimension, &keys, &mut numbers.bsdf_direction);
            draw_1d(*sampler, Dimension::roulette(edges - 1).repeat(1), &keys, &mut numbers.roulette);
        }
        for first in (0..hits.len()).step_by(LANES) {
            let block = ShadingBlock::of_light(scene, arena, &rays, hits, first);
            let paths = &subpaths[first..hits.len().min(first + LANES)];
            let partials = arrive(scene, settings.merged, &block, paths);
            if go_on {
                scatter(scene, &block, paths, &partials, roulette, numbers, settings.caustics, next);
            }
            let kept = if settings.caustics && edges == 1 { 0 } else { block.finite };
            for i in bits(kept) {
                let (path, vertex) = (&paths[i], LightVertex::new(&block, i));
                let last = &mut self.last[path.index as usize];
                let previous = last.replace(self.vertices.len() as u32);
                self.vertices.push(StoredVertex {
                    vertex,
                    power: path.power * path.beta,
                    partial: partials[i],
                    edges,
                    path: path.index,
                    previous,
                });
            }
        }
    }
}

/// Returns the partial weights at the vertices that the rays hit.
fn arrive(scene: &Scene, merged: Merged, block: &ShadingBlock<'_>, paths: &[Subpath]) -> Vec<Partial> {
    let cosines = block.rays.d.dot(block.at.ng).abs().to_array();
    let partial = |(i, path): (usize, &Subpath)| {
        let (distance, cos) = (f64::from(block.at.hit[i].t), f64::from(cosines[i]));
        match path.state {
            State::Started(emitter, start) => {
                let chosen = scene.light_selection.pmf(emitter, block.at.p.lane(i));
                let start = Start { sampled: start.sampled * f64::from(chosen), ..start };
                Partial::of_light(start, distance * distance, cos, merged)
            }
            State::Scattered(partial) => partial.at_next(distance * distance, cos),
        }
    };
    paths.iter().enumerate().map(partial).collect()
}

/// Samples the continuations of the paths of a block, and adds them to `next`.
#[expect(clippy::too_many_arguments, reason = "the state of a wave")]
fn scatter(
    scene: &Scene,
    block: &ShadingBlock<'_>,
    paths: &[Subpath],
    partials: &[Partial],
    roulette: Option<Roulette>,
    numbers: &RandomNumbers,
    deltas_only: bool,
    next: &mut Vec<Subpath>,
) {
    let (at, first) = (&block.at, block.first);
    let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], first));
    let u_lobe = load(&numbers.bsdf_lobe, first);
    let sample = sample_adjoint_x16(&block.bsdfs, &block.wo, u_lobe, u, block.active);
    let mut valid = sample.valid.to_bitmask() & block.active;
    let mut finite = valid & !sample.pdf.simd_eq(f32x16::splat(f32::INFINITY)).to_bitmask();
    if deltas_only {
        (valid, finite) = (valid & !finite, 0);
        if valid == 0 {
            return;
        }
    }
    let reverse = match finite {
        0 => f32x16::ZERO,
        _ => eval_x16(&block.bsdfs, &sample.wi, &block.wo, finite).pdf,
    };
    let wi = at.frame.to_world(sample.wi);
    let wi = wi * (f32x16::ONE / wi.length_squared().sqrt());
    let cosines = wi.dot(at.ng).abs();
    // The corrected cosine towards the viewer, as in `LightVertex`.
    let wo_ng = -block.rays.d.dot(at.ng);
    let corrected = (cosines * block.wo.z / wo_ng).abs() / sample.wi.z.abs();
    let [r, g, b] = sample.weight.map(|channel| (channel * corrected).to_array());
    let rays = scene.spawn_rays(at, wi, block.rays.time).to_rays();
    let (cosines, pdf, reverse) = (cosines.to_array(), sample.pdf.to_array(), reverse.to_array());
    for i in bits(valid) {
        let mut beta = paths[i].beta * Rgb::new(r[i], g[i], b[i]);
        if let Some(roulette) = roulette {
            let Some(on) = roulette.play(beta, 1.0, numbers.roulette[first + i]) else { continue };
            beta = on;
        }
        if beta.is_black() {
            continue;
        }
        let cos = f64::from(cosines[i]);
        let state = State::Scattered(match finite >> i & 1 {
            0 => partials[i].reflected(cos),
            _ => partials[i].scattered(pdf[i].into(), reverse[i].into(), cos),
        });
        next.push(Subpath { beta, ray: rays[i], state, ..paths[i] });
    }
}

/// Returns the probability with which a light path starts at an emitter, times the typical density of its starts that
/// bring light, relative to uniform random numbers.
pub fn typical_start_density(scene: &Scene, guide: Option<&EmissionGuide>, emitter: usize) -> f32 {
    guide.map_or_else(|| scene.light_choice.pmf(emitter), |guide| guide.typical_density(emitter))
}

/// Starts the light paths of all keys. A key whose emitter emits nothing starts none.
fn start(
    scene: &Scene,
    settings: LightPathSettings<'_>,
    keys: &[SampleKey],
    worker: &Worker,
) -> Vec<Subpath> {
    let LightPathSettings { guide, caustics, .. } = settings;
    let mut numbers = EmissionNumbers::default();
    numbers.draw(scene, keys, worker);
    let mut subpaths = Vec::with_capacity(keys.len());
    for (i, key) in keys.iter().enumerate() {
        let Some((emitter, light)) = numbers.start(scene, guide, i) else { continue };
        let (source, started) =
            (&scene.lights[emitter.index()], typical_start_density(scene, guide, emitter.index()));
        let start = Start::new(source, light.ray.d, light.cosine, 1.0, started);
        if caustics && start.delta {
            continue;
        }
        let state = State::Started(emitter.index(), start);
        let (ray, power) = (light.ray, light.power);
        subpaths.push(Subpath { key: *key, index: i as u32, ray, power, beta: Rgb::WHITE, state });
    }
    subpaths
}
