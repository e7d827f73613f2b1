//! Photon tracing: light paths from every emitter and their deposits on surfaces. [Jensen 2001]

use super::{EmissionGuide, PhotonSurface};
use crate::accel::Coherence;
use crate::bsdf::Lobe;
use crate::color::Rgb;
use crate::integrator::Worker;
use crate::integrator::block::ShadingBlock;
use crate::integrator::light_path::{self, LightVertex, Survivors};
use crate::integrator::roulette::Roulette;
use crate::integrator::settings::PathLimits;
use crate::integrator::worker::{draw_1d, draw_2d, intersect};
use crate::math::lanes::{LANES, bits};
use crate::math::{Vec2, Vec3};
use crate::sampling::{Dimension, SampleKey};
use crate::scene::Scene;

/// Light deposited on a surface with a finite lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deposit {
    /// The position in world space.
    pub p: Vec3,
    /// The unit direction towards the incident light.
    pub wi: Vec3,
    /// The surface.
    pub surface: PhotonSurface,
    /// The power of the path, W, if traced alone. It is to be divided by the number of emitted paths.
    pub power: Rgb,
    /// The cosine of `wi` with the shading normal divided by that with the geometric normal. A density of power is
    /// irradiance on the geometric surface; times this ratio, it is the quantity by which the BSDF in the shading
    /// frame is multiplied.
    pub cosine_ratio: f32,
    /// The number of edges from the emitter, at least 1.
    pub edges: u32,
    /// Whether the path was scattered by Dirac deltas only, at least once: caustic light.
    pub caustic: bool,
    /// The index of the path's key among those traced together.
    pub path: u32,
}

impl Deposit {
    /// Returns the power relative to the shading frame, W.
    pub fn shading_power(&self) -> Rgb {
        self.power * self.cosine_ratio
    }
}

/// The parameters of light paths and of the selection of deposits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonPaths {
    /// The greatest number of edges of a path with a deposit; `None` is unbounded.
    pub max_edges: Option<u32>,
    /// The number of edges from which Russian roulette may terminate a path. The survival probability is the
    /// remaining fraction of its emitted power, so survivors from one emitter have equal power.
    pub rr_depth: u32,
    /// Whether unscattered light is deposited.
    pub direct: bool,
    /// Whether light scattered by a finite lobe is deposited.
    pub indirect: bool,
}

impl PhotonPaths {
    /// Returns whether a path may have the given number of edges.
    fn allows(&self, edges: u32) -> bool {
        self.max_edges.is_none_or(|max| edges <= max)
    }

    /// Returns paths with scattered light, to which a camera path can be added.
    pub fn scattered(limits: PathLimits) -> Self {
        let max_edges = limits.max_depth.map(|max| max.saturating_sub(1));
        PhotonPaths { max_edges, rr_depth: limits.rr_depth, direct: false, indirect: true }
    }

    /// Traces a path for each key, started with the guide's density if there is one. Appends the deposits in an order
    /// that depends only on the keys.
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
                if edges == 1 && !self.direct && !self.indirect {
                    // Only caustics are needed, and no path without a Dirac delta becomes one.
                    hits.iter_mut().for_each(|hit| *hit = hit.filter(|hit| scene.has_deltas(hit)));
                }
                paths.keep_hits(hits);
            }
            let go_on = self.allows(edges + 1);
            let roulette = Roulette::for_photons(edges, self.rr_depth);
            if go_on {
                draw(scene, edges - 1, roulette.is_some(), worker);
            }
            let bounce = PhotonBounce { scene, paths: self, edges, go_on, roulette };
            bounce.shade(&powers, worker, out);
            edges += 1;
        }
    }
}

/// Draws the random numbers of a bounce.
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

/// The state shared by all paths with the same number of edges.
struct PhotonBounce<'a> {
    scene: &'a Scene,
    paths: &'a PhotonPaths,
    edges: u32,
    go_on: bool,
    /// Russian roulette, if it applies.
    roulette: Option<Roulette>,
}

impl PhotonBounce<'_> {
    /// Adds the deposits of the paths and moves the continuing paths to the front.
    fn shade(&self, powers: &[Rgb], worker: &mut Worker, out: &mut Vec<Deposit>) {
        let Worker { hits, paths, numbers, arena, specular_only, .. } = worker;
        let mut alive = 0;
        for first in (0..hits.len()).step_by(LANES) {
            arena.reset();
            let block = ShadingBlock::of_light(self.scene, arena, &paths.rays, hits, first);
            let mut survivors = Survivors::none();
            for i in bits(block.active) {
                let j = first + i;
                let slot = paths.slots[j] as usize;
                let vertex = LightVertex::new(&block, i);
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
                if !self.go_on {
                    continue;
                }
                let u = Vec2::new(numbers.bsdf_direction[0][j], numbers.bsdf_direction[1][j]);
                let Some(on) = vertex.scatter(numbers.bsdf_lobe[j], u) else { continue };
                let mut beta = beta * on.weight;
                // If only caustics are needed, paths end at a finite lobe.
                if beta.is_black() || (on.lobe != Lobe::Specular && !self.paths.indirect) {
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

    /// Returns whether a path makes a deposit, given whether only Dirac deltas scattered it.
    fn leaves(&self, specular_only: bool) -> bool {
        match (self.edges, specular_only) {
            (1, _) => self.paths.direct,
            (_, true) => true,
            (_, false) => self.paths.indirect,
        }
    }

    fn deposit(
        &self,
        block: &ShadingBlock<'_>,
        i: usize,
        vertex: &LightVertex<'_>,
        power: Rgb,
        path: usize,
        specular_only: bool,
    ) -> Option<Deposit> {
        (!power.is_black()).then(|| Deposit {
            p: vertex.at.p,
            wi: -block.rays.d.lane(i),
            surface: PhotonSurface::at(self.scene, &vertex.at),
            // Only this fraction of the photons hits a surface with holes. Rays that look up the density hit the
            // surface with the same probability, so the density must represent the whole irradiance.
            power: power * self.scene.hit_probability(&vertex.at).recip(),
            cosine_ratio: (vertex.wo.z / vertex.wo_ng).abs(),
            edges: self.edges,
            caustic: specular_only && self.edges > 1,
            path: path as u32,
        })
    }
}
