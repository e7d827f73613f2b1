//! Light subpaths, whose vertices are kept.

use super::technique::Techniques;
use super::weights::{Merged, Partial, Start};
use crate::accel::Coherence;
use crate::color::Rgb;
use crate::integrator::block::ShadingBlock;
use crate::integrator::light_path::{EmissionNumbers, LightVertex};
use crate::integrator::photon::EmissionGuide;
use crate::integrator::roulette::Roulette;
use crate::integrator::settings::PathLimits;
use crate::integrator::worker::{Worker, draw_1d, draw_2d, intersect};
use crate::math::lanes::{LANES, bits};
use crate::math::{Ray, Vec2};
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
        let mut subpaths =
            if settings.allows(1) { start(scene, settings.guide, keys, worker) } else { Vec::new() };
        let mut next = Vec::new();
        let mut edges = 1;
        while !subpaths.is_empty() && !worker.interrupt.is_raised() {
            let rays: Vec<Ray> = subpaths.iter().map(|path| path.ray).collect();
            intersect(scene, &rays, Coherence::Incoherent, &mut worker.hits, &mut worker.counters);
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
            for i in bits(block.active) {
                let j = first + i;
                let path = &subpaths[j];
                let vertex = LightVertex::new(&block, i);
                let (distance, cos) = (f64::from(vertex.at.hit.t), f64::from(vertex.wo_ng.abs()));
                let partial = match path.state {
                    State::Started(emitter, start) => {
                        let chosen = scene.light_selection.pmf(emitter, vertex.at.p);
                        let start = Start { sampled: start.sampled * f64::from(chosen), ..start };
                        Partial::of_light(start, distance * distance, cos, settings.merged)
                    }
                    State::Scattered(partial) => partial.at_next(distance * distance, cos),
                };
                let on = go_on.then(|| {
                    let u = Vec2::new(numbers.bsdf_direction[0][j], numbers.bsdf_direction[1][j]);
                    vertex.scatter(numbers.bsdf_lobe[j], u)
                });
                if let Some(on) = on.flatten() {
                    let mut beta = path.beta * on.weight;
                    let survives = match roulette {
                        Some(roulette) => roulette.play(beta, 1.0, numbers.roulette[j]),
                        None => Some(beta),
                    };
                    let alive = survives.is_some() && !beta.is_black();
                    beta = survives.unwrap_or(beta);
                    let cos = f64::from(on.wi.dot(vertex.at.ng).abs());
                    let state = State::Scattered(match on.pdf.is_infinite() {
                        true => partial.reflected(cos),
                        false => {
                            let (_, reverse) = vertex.eval_with_density(on.wi);
                            partial.scattered(on.pdf.into(), reverse.into(), cos)
                        }
                    });
                    if alive {
                        let ray = scene.spawn_ray(&vertex.at, on.wi, vertex.at.time);
                        next.push(Subpath { beta, ray, state, ..*path });
                    }
                }
                if block.finite >> i & 1 == 1 {
                    let last = &mut self.last[path.index as usize];
                    let (index, power) = (path.index, path.power * path.beta);
                    let previous = last.replace(self.vertices.len() as u32);
                    self.vertices.push(StoredVertex { vertex, power, partial, edges, path: index, previous });
                }
            }
        }
    }
}

/// Returns the probability with which a light path starts at an emitter.
pub fn start_pmf(scene: &Scene, guide: Option<&EmissionGuide>, emitter: usize) -> f32 {
    guide.map_or_else(|| scene.light_choice.pmf(emitter), |guide| guide.pmf(emitter))
}

/// Starts the light paths of all keys. A key whose emitter emits nothing starts none.
fn start(scene: &Scene, guide: Option<&EmissionGuide>, keys: &[SampleKey], worker: &Worker) -> Vec<Subpath> {
    let mut numbers = EmissionNumbers::default();
    numbers.draw(scene, keys, worker);
    let mut subpaths = Vec::with_capacity(keys.len());
    for (i, key) in keys.iter().enumerate() {
        let Some((emitter, light)) = numbers.start(scene, guide, i) else { continue };
        let source = &scene.lights[emitter.index()];
        let density = source.start_density(light.ray.d, light.cosine);
        let start = Start {
            cosine: light.cosine.into(),
            delta: source.is_delta(),
            distant: source.is_distant(),
            ..Start::new(density, 1.0, start_pmf(scene, guide, emitter.index()))
        };
        let state = State::Started(emitter.index(), start);
        let (ray, power) = (light.ray, light.power);
        subpaths.push(Subpath { key: *key, index: i as u32, ray, power, beta: Rgb::WHITE, state });
    }
    subpaths
}
