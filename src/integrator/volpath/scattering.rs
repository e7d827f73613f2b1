//! Scattering of paths in media, sixteen at a time.

use super::emitter_samples::{Origins, weighted};
use super::equiangular::LegPoint;
use super::tracer::Tracer;
use crate::color::Rgb;
use crate::ids::MediumId;
use crate::integrator::flight::{Departure, stream};
use crate::integrator::path_wave::InMedia;
use crate::integrator::roulette::Roulette;
use crate::integrator::shadows::ShadowQueue;
use crate::integrator::worker::{draw_1d, draw_2d};
use crate::math::lanes::{LANES, bits, each_lane, f32x16, load};
use crate::math::{Ray, Vec3, Vec3x16};
use crate::medium::lanes::PhaseX16;
use crate::sampling::mis::power_heuristic_of_three_x16;
use crate::sampling::{Dimension, SampleKey, Sampler};

/// The probability with which an emitter is sampled in a [sealed](crate::scene::SceneMedia::is_sealed) medium. It is
/// not 0, because the boundaries may have a hole, or an emitter inside.
const SEALED_SHARE: f32 = 1.0 / 8.0;

/// A path that a medium scatters, or has scattered.
#[derive(Clone, Copy, Debug)]
pub struct Scattered {
    /// The sample's key.
    pub key: SampleKey,
    /// The entry of the output to which the path contributes.
    pub slot: u32,
    /// The point.
    pub p: Vec3,
    /// The direction in which the path arrives; afterwards, that in which it goes on, of unit length.
    pub d: Vec3,
    /// The time of the ray.
    pub time: f32,
    /// The medium.
    pub medium: MediumId,
    /// The product of the weights so far.
    pub beta: Rgb,
    /// The product of the relative indices of refraction.
    pub eta: f32,
    /// The index of the point on the ray, if points near emitters were sampled there.
    pub on_leg: Option<u32>,
    /// The density per unit solid angle of the direction in which the path goes on.
    pub pdf: f32,
    /// The probability with which an emitter is sampled at the point.
    pub emitter_share: f32,
}

impl Scattered {
    /// Returns the ray on which the path goes on.
    pub fn ray(&self) -> Ray {
        Ray { time: self.time, ..Ray::new(self.p, self.d) }
    }

    /// Returns where the path is in media.
    pub fn in_media(&self) -> InMedia {
        let Scattered { medium, on_leg, emitter_share, .. } = *self;
        InMedia { medium: Some(medium), events: 0, on_leg, emitter_share }
    }
}

/// The random numbers of the events of a wave.
#[derive(Default)]
pub struct EventNumbers {
    keys: Vec<SampleKey>,
    emitter_point: [Vec<f32>; 2],
    direction: [Vec<f32>; 2],
    roulette: Vec<f32>,
}

impl Tracer<'_> {
    /// Samples an emitter at each point at which a path is scattered after `depth` events, and queues shadow rays with
    /// the weighted contributions. Then scatters the paths. Those that end are removed.
    pub fn scatter_in_media(
        &self,
        depth: u32,
        paths: &mut Vec<Scattered>,
        leg_points: &[LegPoint],
        (sampler, numbers): (Sampler, &mut EventNumbers),
        shadows: &mut ShadowQueue,
    ) {
        let EventNumbers { keys, emitter_point, direction, roulette } = numbers;
        keys.clear();
        keys.extend(paths.iter().map(|path| path.key));
        let samples_emitters = self.query.wants(depth + 2) && !self.selection().is_empty();
        if samples_emitters {
            draw_2d(sampler, Dimension::emitter_point(depth), keys, emitter_point);
        }
        draw_2d(sampler, Dimension::bsdf_direction(depth), keys, direction);
        let plays = Roulette::at(depth + 1, self.limits.rr_depth);
        if plays.is_some() {
            draw_1d(sampler, Dimension::roulette(depth), keys, roulette);
        }
        let mut alive = 0;
        for first in (0..paths.len()).step_by(LANES) {
            let block = Block::new(self, paths, first);
            if samples_emitters {
                let u = [0, 1].map(|k| load(&emitter_point[k], first));
                self.sample_emitters(depth, &block, u, leg_points, shadows);
            }
            let wi = block.phases.sample(block.d, [0, 1].map(|k| load(&direction[k], first)));
            let pdf = block.phases.eval(block.d, wi);
            let (beta, on) = match plays {
                None => (block.beta, block.lanes),
                Some(plays) => {
                    let eta = f32x16::new(block.paths.map(|path| path.eta));
                    let (beta, on) = plays.play_x16(block.beta, eta * eta, load(roulette, first));
                    (beta, on.to_bitmask() & block.lanes)
                }
            };
            for i in bits(on) {
                paths[alive] = Scattered {
                    d: wi.lane(i),
                    beta: Rgb::from(beta.map(|channel| channel.as_array()[i])),
                    pdf: pdf.as_array()[i],
                    emitter_share: block.shares[i],
                    ..block.paths[i]
                };
                alive += 1;
            }
        }
        paths.truncate(alive);
    }

    /// Samples an emitter at each point of a block. Queues shadow rays with the weighted contributions.
    fn sample_emitters(
        &self,
        depth: u32,
        block: &Block<'_>,
        u: [f32x16; 2],
        leg_points: &[LegPoint],
        shadows: &mut ShadowQueue,
    ) {
        let Block { paths, p, shares, .. } = block;
        let mut departures = paths
            .each_ref()
            .map(|path| Departure { medium: Some(path.medium), random: stream(path.key, depth, 1) });
        let mut lanes = block.lanes;
        for i in bits(block.lanes) {
            if shares[i] < 1.0 && departures[i].random.uniform() >= f64::from(shares[i]) {
                lanes &= !(1 << i);
            }
        }
        let time = f32x16::new(paths.each_ref().map(|path| path.time));
        let choice = self.scene.sample_emitters_choice(self.selection(), &(*p).into(), u, time, lanes);
        let Some((choice, sample)) = choice else { return };
        let scattered = block.phases.eval(block.d, sample.wi);
        let pdf = sample.pdf * f32x16::new(*shares);
        let mut near = f32x16::ZERO;
        for i in bits(lanes) {
            if let Some(point) = paths[i].on_leg {
                let (emitter, pmf) = (choice.emitters[i], choice.pmf.as_array()[i]);
                near.as_mut_array()[i] = self.relative_density(&leg_points[point as usize], emitter, pmf);
            }
        }
        let near = near.simd_gt(f32x16::ZERO).select(near * pdf, f32x16::ZERO);
        // The density with which the event samples the direction, too.
        let other = sample.delta.select(f32x16::ZERO, scattered);
        let weight = power_heuristic_of_three_x16(pdf, [other, near]);
        let value = weighted(&sample, scattered * weight, pdf, |c| block.beta[c]);
        let slots = paths.each_ref().map(|path| path.slot);
        Origins { p: *p, time, slots, departures }.queue(&sample, &value, lanes, shadows);
    }
}

/// At most sixteen paths that media scatter.
struct Block<'a> {
    paths: [Scattered; LANES],
    /// A mask of the lanes with a path. The other lanes repeat the last one.
    lanes: u32,
    /// The points, and the unit directions in which the paths arrive.
    p: Vec3x16,
    d: Vec3x16,
    beta: [f32x16; 3],
    phases: PhaseX16<'a>,
    /// The probabilities with which an emitter is sampled.
    shares: [f32; LANES],
}

impl<'a> Block<'a> {
    fn new(tracer: &Tracer<'a>, all: &[Scattered], first: usize) -> Self {
        let count = (all.len() - first).min(LANES);
        let paths = each_lane(|i| all[first + i.min(count - 1)]);
        let (mut p, mut d) = (Vec3x16::default(), Vec3x16::default());
        for (i, path) in paths.iter().enumerate() {
            p.set_lane(i, path.p);
            d.set_lane(i, path.d);
        }
        Block {
            paths,
            lanes: (1 << count) - 1,
            p,
            d: d / d.length_squared().sqrt(),
            beta: std::array::from_fn(|c| f32x16::new(paths.map(|path| path.beta[c]))),
            phases: PhaseX16::of(&paths.map(|path| tracer.media.phase(path.medium))),
            shares: paths.map(|path| if tracer.media.is_sealed(path.medium) { SEALED_SHARE } else { 1.0 }),
        }
    }
}
