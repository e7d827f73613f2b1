//! Emitter samples at the events of a wave, sixteen at a time.

use super::event::Tracer;
use crate::color::Rgb;
use crate::emitter::EmitterSample;
use crate::ids::MediumId;
use crate::integrator::flight::{Departure, ray_to_emitter};
use crate::integrator::shadows::ShadowQueue;
use crate::math::lanes::{LANES, each_lane};
use crate::math::{Vec2, Vec3, Vec3x16, f32x16};
use crate::medium::{Phase, Stream};
use crate::sampling::mis::power_heuristic_of_three;

/// An emitter sample to be taken at a point where a path is scattered.
pub struct PendingSample<'e> {
    /// The point.
    pub p: Vec3,
    /// The phase function there.
    pub phase: &'e Phase,
    /// The direction in which the path arrives.
    pub d: Vec3,
    /// The medium in which it arrives.
    pub medium: Option<MediumId>,
    /// The weight of the path.
    pub beta: Rgb,
    /// The entry of the output.
    pub slot: usize,
    pub time: f32,
    /// The chosen emitter, and the probability of the choice.
    pub emitter: usize,
    pub pmf: f32,
    /// The random numbers of the direction, and of the transmittance.
    pub u: Vec2,
    pub random: Stream,
    pub competitors: Competitors,
}

/// The densities of the other techniques that find the same light.
#[derive(Clone, Copy)]
pub enum Competitors {
    /// The point is that of an event, at which an emitter is sampled with the probability `share`. Points near the
    /// emitter find it with `near` times the density of the sample.
    OfEvent { share: f32, near: f32 },
    /// The point was sampled near an emitter, with the density `density` per unit length. Free flights end there with
    /// the density `flights`, and choose the emitter with the probability `pmf`.
    OfPointNearEmitter { density: f32, flights: f32, pmf: f32 },
}

impl Tracer<'_> {
    /// Takes emitter samples, and queues shadow rays with the weighted contributions.
    pub fn sample_emitters(&self, all: &[PendingSample<'_>], shadows: &mut ShadowQueue) {
        for block in all.chunks(LANES) {
            let of = |i: usize| &block[i.min(block.len() - 1)];
            let numbers =
                |number: &dyn Fn(&PendingSample<'_>) -> f32| f32x16::new(each_lane(|i| number(of(i))));
            let mut from = Vec3x16::default();
            (0..LANES).for_each(|i| from.set_lane(i, of(i).p));
            let samples = self.scene.sample_chosen_x16(
                self.selection(),
                &each_lane(|i| of(i).emitter),
                from,
                [numbers(&|pending| pending.u.x), numbers(&|pending| pending.u.y)],
                numbers(&|pending| pending.time),
                (1 << block.len()) - 1,
            );
            for (i, pending) in block.iter().enumerate() {
                if let Some(sample) = samples.lane(i) {
                    self.push_shadow(pending, &sample, shadows);
                }
            }
        }
    }

    /// Queues the shadow ray of a sample, if it may carry light.
    fn push_shadow(&self, pending: &PendingSample<'_>, sample: &EmitterSample, shadows: &mut ShadowQueue) {
        let PendingSample { p, medium, time, random, .. } = *pending;
        let value = pending.contribution(sample);
        if value.is_black() {
            return;
        }
        let ray = ray_to_emitter(p, sample, time);
        shadows.push_through_media(ray, pending.slot as u32, value, Departure { medium, random });
    }
}

impl PendingSample<'_> {
    /// Returns the weighted contribution of a sample, whose density does not include the choice of the emitter.
    fn contribution(&self, sample: &EmitterSample) -> Rgb {
        let density = self.phase.eval(self.d.dot(sample.wi));
        // The density with which the event samples the direction, too.
        let other = if sample.delta { 0.0 } else { density };
        let pdf = sample.pdf * self.pmf;
        let (all, weight) = match self.competitors {
            Competitors::OfEvent { share, near } => {
                let pdf = pdf * share;
                let near = if near > 0.0 { near * pdf } else { 0.0 };
                (pdf, power_heuristic_of_three(pdf, [other, near]))
            }
            Competitors::OfPointNearEmitter { density, flights, pmf } => {
                let others = [flights * pmf / self.pmf, flights * other / pdf];
                (pdf * density, power_heuristic_of_three(density, others))
            }
        };
        // What has no density carries nothing.
        if all > 0.0 { self.beta * sample.radiance * (density * weight / all) } else { Rgb::BLACK }
    }
}
