//! The light that paths find between their events, and points near emitters.

use super::Path;
use super::emitter_samples::{Origins, weighted};
use super::equiangular::{LegPoint, LegsX16, RegionsX16};
use crate::color::Rgb;
use crate::emitter::{LightSelection, LitRegion, ReceiverX16};
use crate::ids::MediumId;
use crate::integrator::flight::{Departure, Entries, before_end, rounding_x16, stream};
use crate::integrator::shadows::ShadowQueue;
use crate::integrator::{PathLimits, RadianceQuery};
use crate::math::lanes::{bits, each_lane, f32x16};
use crate::medium::Phase;
use crate::medium::lanes::PhaseX16;
use crate::sampling::SampleKey;
use crate::sampling::mis::{power_heuristic, power_heuristic_of_three, power_heuristic_of_three_x16};
use crate::scene::{Scene, SceneMedia, SurfaceInteraction};

/// What all paths share.
pub struct Tracer<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its media.
    pub media: &'a SceneMedia,
    /// The limits of paths.
    pub limits: PathLimits,
    /// The light to find.
    pub query: RadianceQuery,
    /// The points that each emitter may light; `None` at infinity.
    pub regions: &'a [Option<LitRegion>],
    /// Whether there are emitters that are not at infinity.
    pub has_near: bool,
}

/// The random numbers of points near emitters, for a whole wave.
#[derive(Default)]
pub struct NearNumbers {
    /// Choice of the emitter and position on it.
    pub emitter_point: [Vec<f32>; 2],
    /// Distance on the ray.
    pub distance: Vec<f32>,
}

/// Where the first part of a ray is that is in a medium that scatters.
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
    /// Notes that the flight ends at a distance in the last medium entered. Returns the index of that point, if points
    /// near emitters are sampled on the ray there.
    pub fn end(self, distance: f32, leg_points: &mut [LegPoint]) -> Option<u32> {
        let First::Here(index) = self else { return None };
        leg_points[index as usize].distance = distance;
        Some(index)
    }
}

impl Tracer<'_> {
    /// Returns whether points near emitters may be sampled in a medium.
    fn lights_near_emitters(&self, medium: MediumId) -> bool {
        self.has_near && !self.media.is_sealed(medium)
    }

    /// Returns the weighted light at the surface that a path's ray meets, or from infinity.
    pub fn found(&self, path: &Path, at: Option<&SurfaceInteraction>, leg_points: &[LegPoint]) -> Rgb {
        match at {
            _ if !self.adds_emission(path) => Rgb::BLACK,
            Some(at) => self.emitted(path, at, leg_points),
            None => self.environment(path),
        }
    }

    /// Returns whether paths may be scattered once more after `depth` events.
    pub fn scatters(&self, depth: u32) -> bool {
        self.limits.allows(depth + 2) && (self.query.direct || self.query.indirect)
    }

    /// Returns whether emission found by the path's ray is added.
    fn adds_emission(&self, path: &Path) -> bool {
        self.query.wants(path.depth + 1) && !(path.depth == 0 && self.limits.hide_emitters)
    }

    /// Returns the choice among the emitters. A direction is sampled at every event, too, so emitter samples may omit
    /// light that those find well.
    pub fn selection(&self) -> &LightSelection {
        self.scene.compensated_selection.as_ref().unwrap_or(&self.scene.light_selection)
    }

    /// Returns the weighted radiance of the emitter at a surface; black if nothing is emitted towards the path.
    fn emitted(&self, path: &Path, at: &SurfaceInteraction, leg_points: &[LegPoint]) -> Rgb {
        let Some(emitter) = self.scene.emitter_at(at) else { return Rgb::BLACK };
        let radiance = self.scene.emitted(emitter, at);
        if path.pdf.is_infinite() {
            return radiance;
        }
        let other = self.scene.emitter_pdf(self.selection(), emitter, path.from, path.ray.o, at);
        let other = other * path.emitter_share;
        let factor = path.on_leg.map_or(0.0, |point| {
            let pmf = self.selection().pmf(emitter.index(), path.from);
            self.relative_density(&leg_points[point as usize], emitter.index(), pmf)
        });
        let near = if factor > 0.0 { other * factor } else { 0.0 };
        radiance * power_heuristic_of_three(path.pdf, [other, near])
    }

    /// Returns [`LegPoint::relative_density`] for an emitter; 0 if it is at infinity.
    pub fn relative_density(&self, point: &LegPoint, emitter: usize, pmf: f32) -> f32 {
        let region = self.regions.get(emitter).and_then(Option::as_ref);
        region.map_or(0.0, |region| point.relative_density(self.selection(), emitter, region, pmf))
    }

    /// Samples emitters at points near them, on the parts of rays in the first media that may scatter them. Queues
    /// shadow rays with the weighted contributions to the entries `slots`.
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
            let useful =
                matches!(first, First::Ahead) && media[k].is_some_and(|id| self.lights_near_emitters(id));
            lanes |= u32::from(useful) << k;
            *first = First::Behind;
        }
        bits(entries.grids).for_each(|k| firsts[index[k]] = First::Behind);
        let legs = LegsX16::new(entries);
        let of = |numbers: &[f32]| f32x16::new(each_lane(|k| numbers[index[k]]));
        let [u_choice, u_point] = numbers.emitter_point.each_ref().map(|numbers| of(numbers));
        let reference = ReceiverX16::from(legs.reference());
        if lanes == 0 || !self.query.wants(depth + 2) {
            return;
        }
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
        let transmittance = legs.transmittance(distance);
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

    /// Returns the weighted radiance of the environment and the sun.
    fn environment(&self, path: &Path) -> Rgb {
        let d = path.ray.d;
        let mut sum = Rgb::BLACK;
        // Each emitter is weighted against its own samples, as if it were alone.
        for emitter in self.scene.distant_emitters() {
            let mut radiance = self.scene.distant_radiance(emitter, d);
            if path.pdf.is_finite() {
                let pmf = self.selection().pmf(emitter.index(), path.from);
                let other = pmf * self.scene.distant_density(self.selection(), emitter, d);
                let other = other * path.emitter_share;
                radiance *= power_heuristic(path.pdf, other);
            }
            sum += radiance;
        }
        sum
    }
}
