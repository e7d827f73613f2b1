//! Photon tracing: light paths from every emitter, and what they leave on the surfaces that they meet. [Jensen 2001]

use super::EmissionGuide;
use crate::accel::Coherence;
use crate::bsdf::Lobe;
use crate::color::Rgb;
use crate::integrator::Worker;
use crate::integrator::block::Block;
use crate::integrator::light_path::{self, Survivors, Vertex};
use crate::integrator::roulette::Roulette;
use crate::integrator::worker::{draw_1d, draw_2d, intersect};
use crate::math::lanes::{LANES, bits};
use crate::math::{Vec2, Vec3};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;

/// Light that has landed on a surface with a finite lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deposit {
    /// Where, in the world.
    pub p: Vec3,
    /// Unit direction to where the light came from.
    pub wi: Vec3,
    /// Geometric normal of unit length.
    pub ng: Vec3,
    /// The power that the path stands for, W, if it is the only one: to be divided by the number of paths emitted.
    pub power: Rgb,
    /// The cosine of `wi` to the shading normal over that to the geometric normal. A density of power is irradiance on
    /// the geometric surface; power times this gives what the BSDF in the shading frame has to be multiplied by.
    pub cosine_ratio: f32,
    /// Edges of the path between the emitter and here, at least 1.
    pub edges: u32,
    /// Whether the path was scattered, and by Dirac deltas only: light of a caustic.
    pub caustic: bool,
    /// The place of the path's key among those that were traced together.
    pub path: u32,
}

impl Deposit {
    /// Power as the shading frame sees it, W.
    pub fn shading_power(&self) -> Rgb {
        self.power * self.cosine_ratio
    }
}

/// How light paths are traced, and which of them leave something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonPaths {
    /// The longest path that leaves something, in edges; `None` is unbounded.
    pub max_edges: Option<u32>,
    /// Edges from which Russian roulette may end a path. It survives with the share of its emitted power that it still
    /// has, so that survivors of one emitter are of equal power.
    pub rr_depth: u32,
    /// Whether light that has not been scattered yet leaves something.
    pub direct: bool,
    /// Whether light leaves something that some finite lobe has scattered.
    pub indirect: bool,
}

impl PhotonPaths {
    /// Whether a path may have that many edges.
    fn allows(&self, edges: u32) -> bool {
        self.max_edges.is_none_or(|max| edges <= max)
    }

    /// Traces a path for each key, begun as the guide says if there is one, and adds what it leaves, in an order that depends on nothing else.
    pub fn trace(
        &self,
        scene: &Scene,
        keys: &[SampleKey],
        guide: Option<&EmissionGuide>,
        worker: &mut Worker,
        out: &mut Vec<Deposit>,
    ) {
        if !self.allows(1) {
            return;
        }
        let powers = light_path::emit(scene, keys, guide, worker);
        worker.specular_only.clear();
        worker.specular_only.resize(keys.len(), true);
        let mut edges = 1;
        while !worker.paths.rays.is_empty() && !worker.interrupt.is_raised() {
            {
                let Worker { paths, hits, counters, .. } = &mut *worker;
                intersect(scene, &paths.rays, Coherence::Incoherent, hits, counters);
                paths.keep_hits(hits, |_, _| {});
            }
            let go_on = self.allows(edges + 1);
            let roulette = Roulette::at(edges, self.rr_depth);
            if go_on {
                draw(scene, edges - 1, roulette.is_some(), worker);
            }
            let bounce = Bounce { scene, paths: self, edges, go_on, roulette };
            bounce.shade(&powers, worker, out);
            edges += 1;
        }
    }
}

/// Draws the numbers of a bounce.
fn draw(scene: &Scene, bounce: u32, roulette: bool, worker: &mut Worker) {
    let Worker { sampler, paths, numbers, .. } = worker;
    if scene.needs.lobe_choice {
        draw_1d(*sampler, Dimension::bsdf_lobe(bounce), &paths.keys, &mut numbers.bsdf_lobe);
    } else {
        numbers.bsdf_lobe.clear();
        numbers.bsdf_lobe.resize(paths.keys.len(), 0.0);
    }
    draw_2d(*sampler, Dimension::bsdf_direction(bounce), &paths.keys, &mut numbers.bsdf_direction);
    if roulette {
        draw_1d(*sampler, Dimension::roulette(bounce), &paths.keys, &mut numbers.roulette);
    }
}

/// What every path has in common that has so many edges.
struct Bounce<'a> {
    scene: &'a Scene,
    paths: &'a PhotonPaths,
    edges: u32,
    go_on: bool,
    /// Roulette, if it is played.
    roulette: Option<Roulette>,
}

impl Bounce<'_> {
    /// Leaves what the paths leave, and moves those that go on to the front.
    fn shade(&self, powers: &[Rgb], worker: &mut Worker, out: &mut Vec<Deposit>) {
        let Worker { hits, paths, numbers, arena, specular_only, .. } = worker;
        let mut alive = 0;
        for first in (0..hits.len()).step_by(LANES) {
            arena.reset();
            let block = Block::of_light(self.scene, arena, &paths.rays, hits, first);
            let mut survivors = Survivors::none();
            for i in bits(block.active) {
                let j = first + i;
                let slot = paths.slots[j] as usize;
                let vertex = Vertex::new(&block, i);
                let beta = paths.beta(j);
                if block.finite >> i & 1 == 1 && self.leaves(specular_only[slot]) {
                    out.extend(self.deposit(
                        &block,
                        i,
                        &vertex,
                        powers[slot] * beta,
                        slot,
                        specular_only[slot],
                    ));
                }
                // Where only caustics are wanted, light is lost that is none any more.
                if !self.go_on || !(self.paths.indirect || specular_only[slot]) {
                    continue;
                }
                let u = Vec2::new(numbers.bsdf_direction[0][j], numbers.bsdf_direction[1][j]);
                let Some(on) = vertex.scatter(numbers.bsdf_lobe[j], u) else { continue };
                let mut beta = beta * on.weight;
                if beta.is_black() {
                    continue;
                }
                if let Some(roulette) = self.roulette {
                    let left = (powers[slot] * beta).max_component() / powers[slot].max_component();
                    let importance = left / beta.max_component();
                    let Some(on) = roulette.play(beta, importance, numbers.roulette[j]) else { continue };
                    beta = on;
                }
                specular_only[slot] &= on.lobe == Lobe::Specular;
                let ray = self.scene.spawn_ray(&vertex.at, on.wi, vertex.at.time);
                survivors.push(i, ray, beta, paths.eta[j] * on.eta);
            }
            alive = survivors.compact(paths, first, alive);
        }
        paths.truncate(alive);
    }

    /// Whether a path leaves something, given whether Dirac deltas alone have scattered it.
    fn leaves(&self, specular_only: bool) -> bool {
        match (self.edges, specular_only) {
            (1, _) => self.paths.direct,
            (_, true) => true,
            (_, false) => self.paths.indirect,
        }
    }

    fn deposit(
        &self,
        block: &Block<'_>,
        i: usize,
        vertex: &Vertex<'_>,
        power: Rgb,
        path: usize,
        specular_only: bool,
    ) -> Option<Deposit> {
        (!power.is_black()).then(|| Deposit {
            p: vertex.at.p,
            wi: -block.rays.d.lane(i),
            ng: vertex.at.ng,
            // Only this share of the photons hits a surface with holes. Rays that look the density up hit it with the
            // same probability, so the density must be that of the whole irradiance.
            power: power * self.scene.share_met(&vertex.at).recip(),
            cosine_ratio: (vertex.wo.z / vertex.wo_ng).abs(),
            edges: self.edges,
            caustic: specular_only && self.edges > 1,
            path: path as u32,
        })
    }
}
