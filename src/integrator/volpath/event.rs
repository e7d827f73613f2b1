//! One event of a path in a medium, and the light that it finds.

use super::Path;
use super::emitter_samples::{Competitors, PendingSample};
use super::equiangular::{Leg, LegPoint};
use crate::color::Rgb;
use crate::emitter::{LightSelection, LitRegion};
use crate::ids::MediumId;
use crate::integrator::flight::{Collision, Entry, before_end, rounding};
use crate::integrator::roulette::Roulette;
use crate::integrator::{PathLimits, RadianceQuery};
use crate::math::{Ray, Vec2, Vec3};
use crate::medium::{FreeFlight, Medium, Phase, Stream};
use crate::sampling::mis::{power_heuristic, power_heuristic_of_three};
use crate::scene::{Scene, SceneMedia, SurfaceInteraction};

/// The probability with which an emitter is sampled in a [sealed](SceneMedia::is_sealed) medium. It is not 0, because
/// the boundaries may have a hole, or an emitter inside.
const SEALED_SHARE: f32 = 1.0 / 8.0;

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

/// The random numbers of an event.
#[derive(Clone, Copy, Debug)]
pub struct EventNumbers {
    /// Choice of the emitter and position on it.
    pub emitter_point: Vec2,
    /// Direction.
    pub direction: Vec2,
    /// Russian roulette.
    pub roulette: f32,
    /// Choice of an emitter and position on it, and the distance of a point near it.
    pub near_emitter: Option<(Vec2, f32)>,
    /// The transmittance of heterogeneous media up to the emitter, and up to the one near which there is a point.
    pub shadow_streams: [Stream; 2],
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
    /// Notes that a ray enters a medium. Samples a point near an emitter in the first one that scatters.
    pub fn enter<'e>(
        &mut self,
        tracer: &Tracer<'_>,
        path: &Path,
        (entry, flight): (&Entry<'e, '_>, &FreeFlight),
        numbers: impl FnOnce() -> EventNumbers,
        (samples, leg_points): (&mut Vec<PendingSample<'e>>, &mut Vec<LegPoint>),
    ) {
        if !(flight.is_sampled() && entry.medium.scatters()) {
            return;
        }
        let leg = match self {
            First::Ahead => tracer.light_near_emitter(path, entry, flight, &numbers(), samples),
            First::Here(_) | First::Behind => None,
        };
        *self = leg.map_or(First::Behind, |leg| {
            leg_points.push(LegPoint { leg, distance: 0.0 });
            First::Here(leg_points.len() as u32 - 1)
        });
    }

    /// Notes that the flight ends at a distance in the last medium entered. Returns the index of that point, if points
    /// near emitters are sampled on the ray there.
    pub fn end(self, distance: f64, leg_points: &mut [LegPoint]) -> Option<u32> {
        let First::Here(index) = self else { return None };
        leg_points[index as usize].distance = distance;
        Some(index)
    }
}

impl Tracer<'_> {
    /// Returns the flight of a path. `u` chooses the channel and the optical depth, `random` has the numbers of
    /// heterogeneous media.
    pub fn flight(&self, path: &Path, u: Vec2, random: Stream) -> FreeFlight {
        // Where paths end, scattering in media is loss.
        match self.scatters(path) {
            true => FreeFlight::sampled(path.beta, u, path.ray.o, random),
            false => FreeFlight::unscattered(random),
        }
    }

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

    /// Returns whether the path may be scattered once more.
    fn scatters(&self, path: &Path) -> bool {
        self.limits.allows(path.depth + 2) && (self.query.direct || self.query.indirect)
    }

    /// Returns whether emission found by the path's ray is added.
    fn adds_emission(&self, path: &Path) -> bool {
        self.query.wants(path.depth + 1) && !(path.depth == 0 && self.limits.hide_emitters)
    }

    /// Chooses an emitter to be sampled at the path's next event, which is at `p`; `None` if its light is not wanted.
    fn sample_emitter<'e>(
        &self,
        path: &Path,
        p: Vec3,
        phase: &'e Phase,
        numbers: &EventNumbers,
    ) -> Option<PendingSample<'e>> {
        if !self.query.wants(path.depth + 2) {
            return None;
        }
        let u = numbers.emitter_point;
        let choice = self.selection().sample(p, u.x)?;
        Some(PendingSample {
            p,
            phase,
            d: path.ray.d,
            medium: path.medium,
            beta: path.beta,
            slot: path.slot,
            time: path.ray.time,
            emitter: choice.emitter,
            pmf: choice.pmf,
            u: Vec2::new(choice.u, u.y),
            random: numbers.shadow_streams[0],
            competitors: Competitors::OfEvent { share: 1.0, near: 0.0 },
        })
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
    fn relative_density(&self, point: &LegPoint, emitter: usize, pmf: f32) -> f32 {
        let region = self.regions.get(emitter).and_then(Option::as_ref);
        region.map_or(0.0, |region| point.relative_density(self.selection(), emitter, region, pmf))
    }

    /// Adds a sample of an emitter from a point near it in the first medium that scatters, and returns the part of the
    /// ray in that medium; `None` if no such points are sampled there.
    fn light_near_emitter<'e>(
        &self,
        path: &Path,
        entry: &Entry<'e, '_>,
        flight: &FreeFlight,
        numbers: &EventNumbers,
        samples: &mut Vec<PendingSample<'e>>,
    ) -> Option<Leg> {
        let useful = self.query.wants(path.depth + 2) && self.lights_near_emitters(entry.id);
        let near = numbers.near_emitter.filter(|_| useful);
        let (Some((u_emitter, u_distance)), Medium::Homogeneous(medium)) = (near, entry.medium) else {
            return None;
        };
        let mut leg = Leg::new(medium, &entry.segment, flight);
        let mut sample = || {
            let choice = self.selection().sample(leg.reference(), u_emitter.x)?;
            let region = self.regions[choice.emitter].as_ref()?;
            let (distance, density) = leg.sample(choice.emitter, region, u_distance)?;
            let p = leg.at(distance);
            let (length, d) = (entry.segment.length as f32, entry.segment.direction);
            let is_close = length - distance as f32 <= rounding(entry.segment.origin, d * length);
            let p = if is_close { before_end(p, (entry.ahead)().as_ref(), d) } else { p };
            let scattered = flight.passed() * leg.transmittance(distance) * medium.sigma_s;
            let competitors = Competitors::OfPointNearEmitter {
                density: density as f32,
                flights: leg.flight_density(distance) as f32,
                pmf: self.selection().pmf(choice.emitter, p),
            };
            samples.push(PendingSample {
                p,
                phase: &medium.phase,
                d: path.ray.d,
                medium: Some(entry.id),
                beta: path.beta * scattered,
                slot: path.slot,
                time: path.ray.time,
                emitter: choice.emitter,
                pmf: choice.pmf,
                u: Vec2::new(choice.u, u_emitter.y),
                random: numbers.shadow_streams[1],
                competitors,
            });
            Some(())
        };
        sample();
        Some(leg)
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

    /// Adds a sample of an emitter at the path's next event, which is in a medium, and scatters the path there.
    pub fn scatter_in_medium<'e>(
        &self,
        path: Path,
        collision: &Collision<'e>,
        leg_point: Option<&LegPoint>,
        numbers: &EventNumbers,
        samples: &mut Vec<PendingSample<'e>>,
    ) -> Option<Path> {
        let Ray { d, time, .. } = path.ray;
        let (p, phase) = (collision.p, collision.medium.phase());
        let mut random = numbers.shadow_streams[0];
        let sealed = path.medium.is_some_and(|id| self.media.is_sealed(id));
        let share = if sealed { SEALED_SHARE } else { 1.0 };
        if !sealed || random.uniform() < f64::from(SEALED_SHARE) {
            let sample = self.sample_emitter(&path, p, phase, numbers);
            samples.extend(sample.map(|sample| {
                let near = |point| self.relative_density(point, sample.emitter, sample.pmf);
                let competitors = Competitors::OfEvent { share, near: leg_point.map_or(0.0, near) };
                PendingSample { competitors, random, ..sample }
            }));
        }
        let wi = phase.sample(d, numbers.direction);
        let next = Path {
            ray: Ray { time, ..Ray::new(p, wi) },
            from: p,
            pdf: phase.eval(d.dot(wi)),
            emitter_share: share,
            depth: path.depth + 1,
            ..path
        };
        self.survivor(next, numbers)
    }

    /// Plays Russian roulette after an event.
    fn survivor(&self, path: Path, numbers: &EventNumbers) -> Option<Path> {
        if path.beta.is_black() {
            return None;
        }
        match Roulette::at(path.depth, self.limits.rr_depth) {
            None => Some(path),
            Some(roulette) => {
                let beta = roulette.play(path.beta, path.eta * path.eta, numbers.roulette)?;
                Some(Path { beta, ..path })
            }
        }
    }
}
