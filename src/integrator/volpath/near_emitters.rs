//! Emitter samples at points near emitters, on rays through media, sixteen at a time.

use super::emitter_samples::{Origins, weighted};
use super::equiangular::{LegPoint, LegsX16, RegionsX16};
use super::tracer::Tracer;
use crate::emitter::ReceiverX16;
use crate::integrator::flight::{Departure, Entries, before_end, rounding_x16, stream};
use crate::integrator::shadows::ShadowQueue;
use crate::math::lanes::{bits, each_lane, f32x16};
use crate::medium::Phase;
use crate::medium::lanes::PhaseX16;
use crate::sampling::SampleKey;
use crate::sampling::mis::power_heuristic_of_three_x16;

/// The random numbers of points near emitters, for a whole wave.
#[derive(Default)]
pub struct NearNumbers {
    /// Choice of the emitter and position on it.
    pub emitter_point: [Vec<f32>; 2],
    /// Distance on the ray.
    pub distance: Vec<f32>,
}

/// Where the first part of a ray is that is in a homogeneous medium that scatters.
#[derive(Clone, Copy)]
pub enum First {
    /// Not reached yet.
    Ahead,
    /// Here, and points near emitters are sampled on it. The index is that of its point.
    Here(u32),
    /// Reached, and no such points are sampled from here on.
    Behind,
}

impl First {
    /// Notes that the flight ends at a distance in the last homogeneous medium entered. Returns the index of that
    /// point, if points near emitters are sampled on the ray there.
    pub fn end(self, distance: f32, leg_points: &mut [LegPoint]) -> Option<u32> {
        let First::Here(index) = self else { return None };
        leg_points[index as usize].distance = distance;
        Some(index)
    }
}

impl Tracer<'_> {
    /// Samples emitters at points near them where rays enter the first homogeneous medium that scatters.
    /// Queues shadow rays with the weighted contributions to the entries `slots`.
    pub fn light_near_emitters(
        &self,
        depth: u32,
        entries: &Entries<'_>,
        (numbers, slots, keys): (&NearNumbers, &[u32], &[SampleKey]),
        (firsts, leg_points): (&mut [First], &mut Vec<LegPoint>),
        shadows: &mut ShadowQueue,
    ) {
        let Entries { index, media, rays, .. } = entries;
        let mut lanes = 0;
        for k in bits(entries.lanes) {
            let first = &mut firsts[index[k]];
            let open = media[k].is_some_and(|id| !self.media.is_sealed(id));
            lanes |= u32::from(open && matches!(first, First::Ahead)) << k;
            *first = First::Behind;
        }
        if lanes == 0 {
            return;
        }
        let legs = LegsX16::new(entries);
        let of = |numbers: &[f32]| f32x16::new(each_lane(|k| numbers[index[k]]));
        let [u_choice, u_point] = numbers.emitter_point.each_ref().map(|numbers| of(numbers));
        let reference = ReceiverX16::from(legs.reference());
        let Some(choice) = self.selection().sample_x16(&reference, u_choice, lanes) else { return };
        let mut regions = RegionsX16::default();
        for k in bits(lanes) {
            if let Some(region) = &self.regions[choice.emitters[k]] {
                regions.set_lane(k, region);
            }
        }
        let angles = legs.angles(&regions);
        let some = angles.some.to_bitmask() & lanes;
        // A single emitter has no other points.
        for k in bits(if self.regions.len() == 1 { some } else { lanes }) {
            firsts[index[k]] = First::Here(leg_points.len() as u32);
            leg_points.push(LegPoint { leg: legs.lane(k, choice.emitters[k], &angles), distance: 0.0 });
        }
        if some == 0 {
            return;
        }
        let distance = legs.sample(&angles, of(&numbers.distance));
        let mut p = legs.at(distance);
        let close = (entries.lengths - distance).simd_le(rounding_x16(rays.o, entries.lengths));
        for k in bits(close.to_bitmask() & some) {
            p.set_lane(k, before_end(p.lane(k), (entries.ahead)(k).as_ref(), rays.d.lane(k)));
        }
        let u = [choice.u, u_point];
        let sample = self.scene.sample_chosen_x16(self.selection(), &choice.emitters, p, u, rays.time, some);
        let phases = media.map(|id| id.map_or(&Phase::Isotropic, |id| self.media.phase(id)));
        let scattered = PhaseX16::of(&phases).eval(entries.directions, sample.wi);
        let pmf_there = each_lane(|k| match some >> k & 1 {
            1 => self.selection().pmf(choice.emitters[k], p.lane(k)),
            _ => 0.0,
        });
        let transmittance = entries.coefficients.transmittance(distance);
        let (density, flights) = (angles.density(distance), legs.flight_density(&transmittance));
        let pdf = sample.pdf * choice.pmf;
        // The density with which an event there samples the direction, too.
        let other = sample.delta.select(f32x16::ZERO, scattered);
        let others = [flights * f32x16::new(pmf_there) / choice.pmf, flights * other / pdf];
        let weight = power_heuristic_of_three_x16(density, others);
        let value = weighted(&sample, scattered * weight, pdf * density, |c| {
            entries.flight.beta[c] * transmittance[c] * entries.coefficients.sigma_s[c]
        });
        let departures =
            each_lane(|k| Departure { medium: media[k], random: stream(keys[index[k]], depth, 2) });
        let origins = Origins { p, time: rays.time, slots: index.map(|i| slots[i]), departures };
        origins.queue(&sample, &value, some, shadows);
    }
}
