//! Reuse of paths among the pixels of a group. [Bekaert 2002]
//!
//! Path j samples a direction at its vertex x_j, and finds the surface point y_j. Every pixel i of the group uses the
//! light that y_j scatters towards its own x_i, if nothing is between them. The points y_j are combined by the balance
//! heuristic:
//!
//! ```text
//! L_i = Σ_j F_i(y_j) L(y_j → x_i) / Σ_k p_k(y_j),    F_i(y) = f(x_i) |cos θ| |cos θ_y| / |y − x_i|²
//! ```
//!
//! The sums are over the group. p_k is the density per unit area with which path k samples a point, zero if the point
//! is invisible from x_k. `L(y_j → x_i)` has two parts, in each of which the BSDF of y_j is evaluated for each pixel:
//! the sample of an emitter, and the continuation of path j in a direction ω_j from y_j, which has the density
//! p̄(ω) = Σ_k p_k(y_j) p(ω | y_j, x_k) / Σ_k p_k(y_j). The continuation, called the tail, is traced once.
//!
//! The estimate of each pixel is unbiased. The errors of the pixels of a group are correlated.

use super::links::{DistantLight, Link, Place, Receivers, SurfacePoint, Vertex};
use crate::accel::{Coherence, Hit};
use crate::bsdf::{self, Bsdf, BsdfX16};
use crate::color::Rgb;
use crate::emitter::{EmitterSampleX16, Gloss, GlossX16};
use crate::integrator::block::ShadingBlock;
use crate::integrator::path_wave::PathWave;
use crate::integrator::worker::Counters;
use crate::integrator::{Group, Radiance};
use crate::math::lanes::{LANES, bits, mask_from_bits};
use crate::math::{FrameX16, Ray, Vec3, Vec3x16, f32x16};
use crate::sampling::mis::{weighted_power_heuristic, weighted_power_heuristic_x16};
use crate::scene::{Scene, SurfaceInteraction};
use bumpalo::Bump;
use std::time::Instant;

/// The number of groups whose rays are traced together.
const BATCH: usize = 8;

/// A sample after a [`Vertex`] that the group shares, with the samples of an emitter and of a direction that were drawn
/// there.
#[derive(Clone, Copy)]
struct Shared<'a> {
    place: Place<'a>,
    emitter: Option<SharedEmitter>,
    tail: Option<SharedTail>,
}

/// The sample of an emitter at a shared point.
#[derive(Clone, Copy)]
struct SharedEmitter {
    /// The direction in the point's local frame.
    wi: Vec3,
    /// The shadow ray.
    ray: Ray,
    /// The incident radiance divided by the density.
    value: Rgb,
    /// The density per unit solid angle; `None` if no other technique can sample this light.
    pdf: Option<f32>,
}

/// The direction in which a path continues from a shared point.
#[derive(Clone, Copy)]
struct SharedTail {
    /// The direction in the point's local frame.
    wi: Vec3,
    /// The index of the path in the wave.
    path: u32,
}

/// The weights with which the pixels of a group use a tail.
struct TailWeights {
    group: u32,
    /// The tail's entry of the output.
    slot: u32,
    weights: [f32x16; 3],
}

/// The state of all groups of a wave.
pub(super) struct Reuse<'a> {
    groups: &'a [Group],
    /// For each entry of the output, the last vertex of the path, if it has a finite lobe and shares no point yet.
    vertices: &'a mut [Option<Vertex<'a>>],
    /// The vertices of the current bounce, which replace `vertices` afterwards.
    next: &'a mut [Option<Vertex<'a>>],
    /// For each entry of the output, the point that is shared at the current bounce.
    points: &'a mut [Option<Shared<'a>>],
    /// The points of the current bounce that emit.
    emitting: Vec<SurfaceInteraction>,
    tails: Vec<TailWeights>,
}

/// Groups whose rays are traced together.
#[derive(Default)]
struct Batch<'a> {
    receivers: Vec<Receivers<'a>>,
    /// The emitters at infinity, for each group with rays that hit nothing.
    distant: Vec<DistantLight>,
    links: Vec<Link>,
    /// For each link, the rays to the vertices, and the shadow ray of the emitter sample.
    rays: Vec<Ray>,
}

impl Batch<'_> {
    fn clear(&mut self) {
        self.receivers.clear();
        self.distant.clear();
        self.links.clear();
        self.rays.clear();
    }
}

impl<'a> Reuse<'a> {
    /// Creates the state before the first bounce of a wave with the given number of rays, in the arena.
    pub fn new(groups: &'a [Group], rays: usize, arena: &'a Bump) -> Self {
        Reuse {
            groups,
            vertices: arena.alloc_slice_fill_copy(rays, None),
            next: arena.alloc_slice_fill_copy(rays, None),
            points: arena.alloc_slice_fill_copy(rays, None),
            emitting: Vec::new(),
            tails: Vec::new(),
        }
    }

    /// Returns whether any of the sixteen paths from `first` on shares no point yet.
    pub fn has_single(&self, first: usize, paths: &PathWave) -> bool {
        paths.slots[first..].iter().take(LANES).any(|&slot| (slot as usize) < self.points.len())
    }

    /// Returns a mask of the lanes of a block whose paths share no point yet.
    pub fn single(&self, block: &ShadingBlock<'_>, paths: &PathWave) -> u32 {
        let single = |i: &usize| (paths.slots[block.first + i] as usize) < self.points.len();
        bits(block.active).filter(single).fold(0, |lanes, i| lanes | 1 << i)
    }

    /// Returns a mask of those lanes of `single` whose point can be shared.
    pub fn shareable(&self, block: &ShadingBlock<'_>, paths: &PathWave, single: u32) -> u32 {
        let shareable = |i: &usize| {
            let path = block.first + i;
            let vertex = &self.vertices[paths.slots[path] as usize];
            paths.pdf[path].is_finite() && vertex.is_some() && !block.bsdfs[*i].depends_on_viewer()
        };
        bits(single & block.finite).filter(shareable).fold(0, |lanes, i| lanes | 1 << i)
    }

    /// Stores the vertices of the lanes in the mask `lanes`.
    pub fn add_vertices(&mut self, block: &ShadingBlock<'a>, paths: &PathWave, lanes: u32) {
        for i in bits(lanes & block.finite) {
            let path = block.first + i;
            self.next[paths.slots[path] as usize] = Some(Vertex {
                p: block.at.p.lane(i),
                error: block.at.error.as_array()[i],
                ng: block.at.ng.lane(i),
                frame: block.at.frame.lane(i),
                wo: block.wo.lane(i),
                bsdf: block.bsdfs[i],
                beta: paths.beta(path),
                gloss: block.gloss.as_ref().map_or(Gloss::NONE, |gloss| gloss.lane(i)),
            });
        }
    }

    /// Stores the points of the lanes in the mask `lanes`. `emitters` are the samples of emitters, if there are any,
    /// with their shadow rays.
    pub fn add_points(
        &mut self,
        block: &ShadingBlock<'a>,
        paths: &PathWave,
        emitters: Option<(&EmitterSampleX16, [Ray; LANES])>,
        lanes: u32,
    ) {
        for i in bits(lanes) {
            let frame = block.at.frame.lane(i);
            let emitter = emitters.and_then(|(sample, rays)| {
                let pdf = sample.pdf.as_array()[i];
                let radiance = Rgb::new(
                    sample.radiance[0].as_array()[i],
                    sample.radiance[1].as_array()[i],
                    sample.radiance[2].as_array()[i],
                );
                let some = sample.valid.to_bitmask() >> i & 1 == 1 && pdf > 0.0 && !radiance.is_black();
                some.then(|| SharedEmitter {
                    wi: frame.to_local(sample.wi.lane(i)),
                    ray: rays[i],
                    value: radiance * (1.0 / pdf),
                    pdf: (sample.delta.to_bitmask() >> i & 1 == 0).then_some(pdf),
                })
            });
            let emits = block.at.emitting >> i & 1 == 1;
            let place = Place::Surface(SurfacePoint {
                p: block.at.p.lane(i),
                error: block.at.error.as_array()[i],
                ng: block.at.ng.lane(i),
                frame,
                bsdf: block.bsdfs[i],
                front: block.wo.z.as_array()[i] > 0.0,
                emitting: emits.then_some(self.emitting.len() as u32),
            });
            self.emitting.extend(emits.then(|| block.at.lane(i)));
            self.points[paths.slots[block.first + i] as usize] = Some(Shared { place, emitter, tail: None });
        }
    }

    /// Shares the light from infinity along the rays of a wave that hit nothing. Rays whose light is not shared are
    /// those for which [`is_shared`](Self::is_shared) is false.
    pub fn add_missed(&mut self, paths: &PathWave, hits: &[Option<Hit>]) {
        for (i, _) in hits.iter().enumerate().filter(|(_, hit)| hit.is_none()) {
            let slot = paths.slots[i] as usize;
            if paths.pdf[i].is_finite() && matches!(self.vertices.get(slot), Some(Some(_))) {
                let place = Place::Infinity(paths.rays[i].d);
                self.points[slot] = Some(Shared { place, emitter: None, tail: None });
            }
        }
    }

    /// Returns whether the path with the given entry of the output has a shared sample at the current bounce.
    pub fn is_shared(&self, slot: u32) -> bool {
        matches!(self.points.get(slot as usize), Some(Some(_)))
    }

    /// Sets the direction `wi` in which the path with the given entry of the output continues from its shared point.
    /// `path` is its index in the wave.
    pub fn set_tail(&mut self, slot: u32, wi: Vec3, path: usize) {
        if let Some(point) = &mut self.points[slot as usize] {
            point.tail = Some(SharedTail { wi, path: path as u32 });
        }
    }

    /// Connects the shared points of the current bounce to the vertices before. Adds the light of emitter samples to
    /// `out`, and begins a tail for every path that continues. Tails have entries of the output behind those of the
    /// rays.
    pub fn connect(
        &mut self,
        scene: &Scene,
        paths: &mut PathWave,
        counters: &mut Counters,
        out: &mut [Radiance],
    ) {
        if self.points.iter().any(Option::is_some) {
            let mut batched = Batch::default();
            let mut occluded = Vec::new();
            for (batch, groups) in self.groups.chunks(BATCH).enumerate() {
                batched.clear();
                for (i, group) in groups.iter().enumerate() {
                    self.link(scene, (batch * BATCH + i) as u32, group, &mut batched);
                }
                let Batch { receivers, distant, links, rays } = &batched;
                occluded.clear();
                occluded.resize(rays.len(), false);
                let started = Instant::now();
                scene.accel.occluded_wave(rays, &mut occluded, Coherence::Incoherent);
                counters.occlusion_time += started.elapsed();
                counters.occlusion_rays += rays.len() as u64;
                let mut occluded = occluded.iter().copied();
                for links in links.chunk_by(|a, b| a.group == b.group) {
                    let mut sum = [f32x16::ZERO; 3];
                    for link in links {
                        let receivers = &receivers[link.receivers];
                        let distant = &distant[receivers.distant.clone()];
                        let light = self.collect(scene, link, (receivers, distant), &mut occluded, paths);
                        (0..3).for_each(|c| sum[c] += light[c]);
                    }
                    let group = &self.groups[links[0].group as usize];
                    add_to_pixels(out, group, receivers[links[0].receivers].lanes, sum);
                }
            }
            self.emitting.clear();
            self.points.fill(None);
        }
        std::mem::swap(&mut self.vertices, &mut self.next);
        self.next.fill(None);
    }

    /// Gathers the vertices of a group.
    fn receivers(&self, group: &Group) -> Receivers<'a> {
        let zero = Vec3x16::default();
        let (mut p, mut ng, mut wo, mut frame) = (zero, zero, zero, FrameX16 { s: zero, t: zero, n: zero });
        let (mut error, mut beta) = (f32x16::ZERO, [f32x16::ZERO; 3]);
        let (mut bsdfs, mut lanes) = ([&Bsdf::Null; LANES], 0);
        for (i, &slot) in group.iter().enumerate() {
            if let Some(Some(v)) = self.vertices.get(slot as usize) {
                p.set_lane(i, v.p);
                error.as_mut_array()[i] = v.error;
                ng.set_lane(i, v.ng);
                frame.set_lane(i, v.frame);
                wo.set_lane(i, v.wo);
                bsdfs[i] = v.bsdf;
                for (channel, value) in beta.iter_mut().zip(v.beta.to_array()) {
                    channel.as_mut_array()[i] = value;
                }
                lanes |= 1 << i;
            }
        }
        let vertex = |i: usize| self.vertices.get(group[i] as usize).and_then(Option::as_ref);
        let gloss = GlossX16::of_lanes(lanes, |i| vertex(i).map_or(Gloss::NONE, |v| v.gloss));
        let bsdf = BsdfX16::new(bsdfs, lanes);
        Receivers { p, error, ng, frame, wo, bsdf, beta, gloss, lanes, distant: 0..0 }
    }

    /// Links the shared samples of a group with its vertices.
    fn link(&self, scene: &Scene, index: u32, group: &Group, batch: &mut Batch<'a>) {
        let shared = |slot: u32| self.points.get(slot as usize).and_then(Option::as_ref);
        if !group.iter().any(|&slot| shared(slot).is_some()) {
            return;
        }
        let mut receivers = self.receivers(group);
        let (mut directions, mut missed) = (Vec3x16::default(), false);
        for (own, &slot) in group.iter().enumerate() {
            if let Some(point) = shared(slot) {
                let link = receivers.link(&point.place, own, &mut batch.rays);
                batch.links.push(Link { group: index, receivers: batch.receivers.len(), slot, ..link });
                batch.rays.extend(point.emitter.map(|emitter| emitter.ray));
                if let Place::Infinity(d) = point.place {
                    directions.set_lane(own, d);
                    missed = true;
                }
            }
        }
        if missed {
            let first = batch.distant.len();
            batch.distant.extend(receivers.distant(scene, &directions));
            receivers.distant = first..batch.distant.len();
        }
        batch.receivers.push(receivers);
    }

    /// Returns the light of a linked sample by channel, given the occlusion of its rays.
    fn collect(
        &mut self,
        scene: &Scene,
        link: &Link,
        (receivers, distant): (&Receivers<'_>, &[DistantLight]),
        occluded: &mut impl Iterator<Item = bool>,
        paths: &mut PathWave,
    ) -> [f32x16; 3] {
        let mut light = [f32x16::ZERO; 3];
        let Some(shared) = &self.points[link.slot as usize] else { return light };
        let mut next = || occluded.next().expect("every ray has a result");
        let hidden = bits(link.traced).filter(|_| next()).fold(0, |lanes, i| lanes | 1 << i);
        let lanes = (link.traced | 1 << link.own) & !hidden;
        let visible = mask_from_bits(lanes);
        let density = link.density & visible;
        let total = density.reduce_add();
        let per_density = f32x16::splat(if total > 0.0 { 1.0 / total } else { 0.0 });
        let share = density * per_density;
        let flux = link.flux.map(|flux| (flux & visible) * per_density);
        let mut add = |value: Rgb, factors: [f32x16; 3]| {
            for (c, value) in value.to_array().into_iter().enumerate() {
                light[c] += (flux[c] * factors[c] * f32x16::splat(value)) & visible;
            }
        };
        let point = match &shared.place {
            Place::Infinity(_) => {
                for DistantLight { radiance, density, pmf } in distant {
                    let [r, g, b, density] =
                        [radiance[0], radiance[1], radiance[2], *density].map(|v| v.as_array()[link.own]);
                    let other = *pmf * f32x16::splat(density);
                    add(Rgb::new(r, g, b), [weighted_power_heuristic_x16(1.0, link.pdf, 1.0, other); 3]);
                }
                return light;
            }
            Place::Surface(point) => point,
        };
        if let Some(emitting) = point.emitting {
            let (le, weights) = receivers.emitted(scene, &self.emitting[emitting as usize], link.pdf, lanes);
            add(le, [weights; 3]);
        }
        let evaluate = |wi: Vec3| {
            let eval = bsdf::lanes::eval_x16(&[point.bsdf; LANES], &link.wo, &Vec3x16::splat(wi), lanes);
            ((share * eval.pdf) & visible, eval.f.map(|f| (f * f32x16::splat(wi.z.abs())) & visible))
        };
        if let Some(emitter) = shared.emitter.filter(|_| !next()) {
            let (pdf, f) = evaluate(emitter.wi);
            let weight = match emitter.pdf {
                Some(own) => weighted_power_heuristic(1.0, own, 1.0, pdf.reduce_add()),
                None => 1.0,
            };
            add(emitter.value * weight, f);
        }
        if let Some(SharedTail { wi, path }) = shared.tail {
            let (pdf, f) = evaluate(wi);
            let pdf = pdf.reduce_add();
            let per_pdf = f32x16::splat(if pdf > 0.0 { 1.0 / pdf } else { 0.0 });
            let weights: [f32x16; 3] = std::array::from_fn(|c| flux[c] * f[c] * per_pdf);
            let scale = weights[0].fast_max(weights[1]).fast_max(weights[2]).reduce_add();
            let slot = (self.points.len() + self.tails.len()) as u32;
            let per_scale = f32x16::splat(if scale > 0.0 { 1.0 / scale } else { 0.0 });
            self.tails.push(TailWeights { group: link.group, slot, weights: weights.map(|w| w * per_scale) });
            let path = path as usize;
            paths.slots[path] = slot;
            paths.beta.iter_mut().for_each(|channel| channel[path] = scale);
            paths.pdf[path] = pdf;
        }
        light
    }

    /// Adds the radiance of all tails to that of the pixels.
    pub fn finish(&self, all: &[Radiance], out: &mut [Radiance]) {
        for TailWeights { group, slot, weights } in &self.tails {
            let value = all[*slot as usize].value;
            if value.is_black() {
                continue;
            }
            let value = value.to_array();
            let light = std::array::from_fn(|c| weights[c] * f32x16::splat(value[c]));
            add_to_pixels(out, &self.groups[*group as usize], u32::MAX, light);
        }
    }
}

/// Adds light, by channel, to the pixels of those lanes of the mask `lanes` that have one.
fn add_to_pixels(out: &mut [Radiance], group: &Group, lanes: u32, light: [f32x16; 3]) {
    let [r, g, b] = light.each_ref().map(f32x16::as_array);
    for (i, &slot) in group.iter().enumerate() {
        if let Some(out) = out.get_mut(slot as usize).filter(|_| lanes >> i & 1 == 1) {
            out.value += Rgb::new(r[i], g[i], b[i]);
        }
    }
}
