//! Light subpaths, whose vertices are kept.

use super::emitter_media::EmitterMedia;
use super::targets::Targets;
use super::technique::Techniques;
use super::vertex::{MediumPoint, Vertex};
use super::weights::{Merged, Partial, Start};
use crate::accel::{Coherence, Hit};
use crate::bsdf::lanes::{eval_x16, sample_adjoint_x16};
use crate::color::Rgb;
use crate::ids::MediumId;
use crate::integrator::block::ShadingBlock;
use crate::integrator::flight::{Collision, Departure, Journeys, medium_after, stream, surfaces};
use crate::integrator::light_path::{EmissionNumbers, LightVertex};
use crate::integrator::photon::EmissionGuide;
use crate::integrator::roulette::Roulette;
use crate::integrator::settings::PathLimits;
use crate::integrator::worker::{RandomNumbers, Worker, draw_1d, draw_2d, intersect};
use crate::math::lanes::{LANES, bits, f32x16, load};
use crate::math::{Ray, Vec2, Vec3};
use crate::medium::Medium;
use crate::sampling::{Dimension, SampleKey};
use crate::scene::{Scene, SceneMedia};
use bumpalo::Bump;

/// A vertex of a light path with a finite lobe.
pub struct StoredVertex<'a> {
    pub vertex: Vertex<'a>,
    /// The medium in which the path arrives.
    pub medium: Option<MediumId>,
    /// The power that arrives, W.
    pub power: Rgb,
    /// The partial weight at the vertex.
    pub partial: Partial,
    /// An estimate of the ratios of the other techniques, for the choice of a connection.
    pub ratio: f32,
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
    /// The medium in which the ray starts.
    medium: Option<MediumId>,
    power: Rgb,
    /// The product of the weights at the vertices, for Russian roulette.
    beta: Rgb,
    state: State,
    /// The number of vertices at which a finite lobe scattered the path.
    finite: u32,
}

impl Subpath {
    /// Returns the partial weight at the point `p`, at the distance `distance`, where `cos` is the cosine of the ray
    /// with the geometric normal, or 1 in a medium.
    fn arrive(&self, scene: &Scene, merged: Merged, p: Vec3, distance: f64, cos: f64) -> Partial {
        match self.state {
            State::Started(emitter, start) => {
                let chosen = scene.light_selection.pmf(emitter, p);
                let start = Start { sampled: start.sampled * f64::from(chosen), ..start };
                Partial::of_light(start, distance * distance, cos, merged)
            }
            State::Scattered(partial) => partial.at_next(distance * distance, cos),
        }
    }
}

/// The weights of a light path between two vertices.
#[derive(Clone, Copy)]
enum State {
    /// Before the first vertex.
    Started(usize, Start),
    /// After a vertex.
    Scattered(Partial),
}

/// The media that are rendered.
#[derive(Clone, Copy)]
pub struct RenderedMedia<'a> {
    pub list: &'a SceneMedia,
    /// The media in which light paths start.
    pub of_emitters: &'a EmitterMedia,
}

impl RenderedMedia<'_> {
    /// Returns the share of the light from infinity that arrives through a medium without end. Grids have an end.
    fn transmittance_from_infinity(&self, medium: Option<MediumId>) -> Rgb {
        match self.list.get(medium) {
            Some(Medium::Homogeneous(medium)) => {
                medium.sigma_t.map(|sigma| if sigma > 0.0 { 0.0 } else { 1.0 })
            }
            _ => Rgb::WHITE,
        }
    }
}

/// Returns the key of a light path for streams of random numbers, which its camera path may have, too.
pub fn of_light_path(key: SampleKey) -> SampleKey {
    SampleKey { scramble: !key.scramble, ..key }
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
    /// The media, if they are rendered.
    pub media: Option<RenderedMedia<'a>>,
    /// If only caustics are traced, that a camera path can find too: which.
    pub caustics: Option<Caustics<'a>>,
}

/// The caustics that light paths find. Emitters are no Dirac deltas, and the first vertex scatters by a Dirac delta.
/// The first vertex that is kept ends the deltas.
#[derive(Clone, Copy)]
pub struct Caustics<'a> {
    /// At what light paths are aimed.
    pub targets: &'a Targets,
    /// The most vertices of a path that are kept.
    pub vertices: u32,
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
        settings: LightPathSettings<'a>,
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
            let ends = |hit: &Hit| settings.caustics.is_some() && edges == 1 && !scene.has_deltas(hit);
            worker.hits.iter_mut().for_each(|hit| *hit = hit.filter(|hit| !ends(hit)));
            if let Some(media) = settings.media {
                paths.fly(scene, media.list, settings, edges, &mut subpaths, worker, &mut next);
            }
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

    /// Lets subpaths fly through media up to the surfaces that they hit. Those that a medium scatters have no hit
    /// afterwards: keeps their vertices, and adds their continuations to `next`.
    #[expect(clippy::too_many_arguments, reason = "the state of a wave")]
    fn fly(
        &mut self,
        scene: &Scene,
        media: &'a SceneMedia,
        settings: LightPathSettings<'_>,
        edges: u32,
        subpaths: &mut [Subpath],
        worker: &mut Worker,
        next: &mut Vec<Subpath>,
    ) {
        let rays: Vec<Ray> = subpaths.iter().map(|path| path.ray).collect();
        let keys: Vec<SampleKey> = subpaths.iter().map(|path| path.key).collect();
        let (mut flights, mut directions, mut roulettes) =
            (Default::default(), Default::default(), Vec::new());
        draw_2d(worker.sampler, Dimension::free_flight(edges - 1).repeat(1), &keys, &mut flights);
        draw_2d(worker.sampler, Dimension::bsdf_direction(edges - 1).repeat(1), &keys, &mut directions);
        draw_1d(worker.sampler, Dimension::roulette(edges - 1).repeat(1), &keys, &mut roulettes);
        let pair = |numbers: &[Vec<f32>; 2], i: usize| Vec2::new(numbers[0][i], numbers[1][i]);
        let surfaces = surfaces(scene, &rays, &worker.hits);
        let mut journeys = Journeys::default();
        for (path, at) in subpaths.iter().zip(&surfaces) {
            let t_max = at.as_ref().map_or(path.ray.t_max, |at| at.hit.t);
            let random = stream(of_light_path(path.key), edges, 0);
            let departure = Departure { medium: path.medium, random };
            journeys.push(Ray { t_max, ..path.ray }, departure, path.power * path.beta);
        }
        journeys.sample(&flights);
        journeys.follow(scene, media, (0..rays.len()).collect(), None, |i| surfaces[i], None);
        let roulette = Roulette::at(edges, 1);
        for (i, path) in subpaths.iter_mut().enumerate() {
            // A channel without power stays black.
            let weight = |to: f32, from: f32| if from > 0.0 { to / from } else { 0.0 };
            let (to, from) = (journeys.beta(i).to_array(), (path.power * path.beta).to_array());
            let weights = [0, 1, 2].map(|c| weight(to[c], from[c]));
            (path.medium, path.beta) = (journeys.medium(i), path.beta * Rgb::from(weights));
            if journeys.collision(i).is_some() || path.beta.is_black() {
                worker.hits[i] = None;
            }
            let Some(&Collision { p, t, medium, .. }) =
                journeys.collision(i).filter(|_| !path.beta.is_black())
            else {
                continue;
            };
            let point = MediumPoint { p, d: path.ray.d, time: path.ray.time, phase: media.phase(medium) };
            let partial = path.arrive(scene, settings.merged, p, f64::from(t), 1.0);
            self.keep(path, Vertex::Medium(point), partial, edges);
            if !settings.allows(edges + 1) {
                continue;
            }
            let mut beta = path.beta;
            if let Some(roulette) = roulette {
                let Some(on) = roulette.play(beta, 1.0, roulettes[i]) else { continue };
                beta = on;
            }
            let wi = point.phase.sample(point.d, pair(&directions, i));
            let density = point.density(wi).into();
            let state = State::Scattered(partial.scattered(density, density, 1.0));
            next.push(Subpath { beta, ray: Ray { time: point.time, ..Ray::new(p, wi) }, state, ..*path });
        }
    }

    /// Keeps a vertex.
    fn keep(&mut self, path: &Subpath, vertex: Vertex<'a>, partial: Partial, edges: u32) {
        let previous = self.last[path.index as usize].replace(self.vertices.len() as u32);
        let (power, medium) = (path.power * path.beta, path.medium);
        let ratio = partial.ratios(vertex.usual_density()) as f32;
        self.vertices.push(StoredVertex {
            vertex,
            ratio,
            medium,
            power,
            partial,
            edges,
            path: path.index,
            previous,
        });
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
                scatter(scene, &block, paths, &partials, roulette, numbers, settings, next);
            }
            let kept = if settings.caustics.is_some() && edges == 1 { 0 } else { block.finite };
            for i in bits(kept) {
                self.keep(&paths[i], Vertex::Surface(LightVertex::new(&block, i)), partials[i], edges);
            }
        }
    }
}

/// Returns the partial weights at the vertices that the rays hit.
fn arrive(scene: &Scene, merged: Merged, block: &ShadingBlock<'_>, paths: &[Subpath]) -> Vec<Partial> {
    let cosines = block.rays.d.dot(block.at.ng).abs().to_array();
    let partial = |(i, path): (usize, &Subpath)| {
        let (distance, cos) = (f64::from(block.at.hit[i].t), f64::from(cosines[i]));
        path.arrive(scene, merged, block.at.p.lane(i), distance, cos)
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
    settings: LightPathSettings<'_>,
    next: &mut Vec<Subpath>,
) {
    let (at, first) = (&block.at, block.first);
    let u = [0, 1].map(|k| load(&numbers.bsdf_direction[k], first));
    let u_lobe = load(&numbers.bsdf_lobe, first);
    let sample = sample_adjoint_x16(&block.bsdfs, &block.wo, u_lobe, u, block.active);
    let mut valid = sample.valid.to_bitmask() & block.active;
    let finite_lobes = valid & !sample.pdf.simd_eq(f32x16::splat(f32::INFINITY)).to_bitmask();
    let mut finite = finite_lobes;
    let LightPathSettings { caustics, media, .. } = settings;
    if let Some(Caustics { vertices: most, .. }) = caustics {
        let begun = |path: &Subpath| path.finite > 0;
        let goes_on = |path: &Subpath| matches!(path.state, State::Scattered(_)) && path.finite + 1 < most;
        finite &= mask(paths, goes_on);
        valid = finite | valid & !finite_lobes & !mask(paths, begun);
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
            _ => {
                let partial = partials[i].scattered(pdf[i].into(), reverse[i].into(), cos);
                if caustics.is_some() { partial.unconnected() } else { partial }
            }
        });
        let (d, on) = (block.rays.d.lane(i), rays[i].d);
        let medium = match media {
            Some(media) => medium_after(scene, media.list, at.facet(i), (d, on), paths[i].medium),
            None => None,
        };
        let scattered = paths[i].finite + (finite >> i & 1);
        next.push(Subpath { beta, ray: rays[i], medium, state, finite: scattered, ..paths[i] });
    }
}

/// Returns the mask of the paths for which a condition is true.
fn mask(paths: &[Subpath], condition: impl Fn(&Subpath) -> bool) -> u32 {
    paths.iter().enumerate().map(|(i, path)| u32::from(condition(path)) << i).sum()
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
    let LightPathSettings { guide, caustics, media, .. } = settings;
    let mut numbers = EmissionNumbers::default();
    numbers.draw(scene, keys, worker);
    let mut subpaths = Vec::with_capacity(keys.len());
    for (i, key) in keys.iter().enumerate() {
        let start = match caustics {
            Some(Caustics { targets, .. }) => targets.sample(scene, &numbers, i),
            None => numbers.start(scene, guide, i).map(|(emitter, light)| {
                (emitter, light, typical_start_density(scene, guide, emitter.index()))
            }),
        };
        let Some((emitter, light, started)) = start else { continue };
        let source = &scene.lights[emitter.index()];
        let start = Start::new(source, light.ray.d, light.cosine, 1.0, started);
        let state = State::Started(emitter.index(), start);
        let medium = media.and_then(|media| media.of_emitters.of(emitter));
        let (ray, mut power) = (light.ray, light.power);
        if let (true, Some(media)) = (start.distant, media) {
            power *= media.transmittance_from_infinity(medium);
        }
        if power.is_black() {
            continue;
        }
        let (index, beta, finite) = (i as u32, Rgb::WHITE, 0);
        subpaths.push(Subpath { key: *key, index, ray, medium, power, beta, state, finite });
    }
    subpaths
}
