//! One event of a path: scattering in a medium or at a surface, and the light found there.

use super::Path;
use super::emitter_samples::{Competitors, PendingSample, Scatterer};
use super::equiangular::{Leg, LegPoint};
use crate::bsdf::Lobe;
use crate::color::Rgb;
use crate::emitter::{LightSelection, LitRegion};
use crate::ids::MediumId;
use crate::integrator::flight::{Collision, Entry, Journey, before_end, follow, medium_after, surfaces};
use crate::integrator::roulette::Roulette;
use crate::integrator::{PathLimits, Radiance, RadianceQuery, Worker};
use crate::math::{Ray, Vec2, Vec3};
use crate::medium::{FreeFlight, Medium, Stream};
use crate::sampling::mis::{power_heuristic, power_heuristic_of_three};
use crate::scene::{Scene, SceneMedia, SurfaceInteraction};
use bumpalo::Bump;

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
    /// The points of the last events at which points near emitters were sampled.
    pub leg_points: &'a [LegPoint],
}

/// The random numbers of an event.
#[derive(Clone, Copy, Debug)]
pub struct EventNumbers {
    /// Channel and optical depth of the flight.
    pub free_flight: Vec2,
    /// Choice of the emitter and position on it.
    pub emitter_point: Vec2,
    /// Choice of the lobe.
    pub lobe: f32,
    /// Direction.
    pub direction: Vec2,
    /// Russian roulette.
    pub roulette: f32,
    /// Choice of an emitter and position on it, and the distance of a point near it.
    pub near_emitter: Option<(Vec2, f32)>,
    /// The flight through heterogeneous media.
    pub flight_stream: Stream,
    /// The transmittance of heterogeneous media up to the emitter, and up to the one near which there is a point.
    pub shadow_streams: [Stream; 2],
}

/// Where the first part of a ray is that is in a medium that scatters.
#[derive(Clone, Copy)]
enum First {
    /// Not reached yet.
    Ahead,
    /// Here, and points near emitters are sampled on it. The index is that of its point.
    Here(u32),
    /// Reached, and no such points are sampled from here on.
    Behind,
}

impl<'a> Tracer<'a> {
    /// Returns the journeys of paths from their last events, and the rays along which to find their nearest surfaces.
    pub fn depart(
        &self,
        paths: &[Path],
        numbers: impl Fn(usize) -> EventNumbers,
    ) -> (Vec<Journey>, Vec<Ray>) {
        let journey = |(i, path): (usize, &Path)| {
            let EventNumbers { free_flight, flight_stream, .. } = numbers(i);
            // Where paths end, scattering in media is loss.
            let flight = match self.scatters(path) {
                true => FreeFlight::sampled(path.beta, free_flight, path.ray.o, flight_stream),
                false => FreeFlight::unscattered(flight_stream),
            };
            Journey::new(path.ray, path.medium, flight)
        };
        let journeys: Vec<Journey> = paths.iter().enumerate().map(journey).collect();
        let rays =
            paths.iter().zip(&journeys).map(|(path, journey)| self.ray(path, &journey.flight)).collect();
        (journeys, rays)
    }

    /// Returns the ray of a path, shortened if surfaces behind the end of its flight do not matter. Twice the distance
    /// leaves room for rounding.
    fn ray(&self, path: &Path, flight: &FreeFlight) -> Ray {
        let leaves_only_at_surfaces = |id| !self.media.has_passed() && !self.lights_near_emitters(id);
        let medium = path.medium.filter(|id| leaves_only_at_surfaces(*id));
        let end = medium.and_then(|id| flight.reach(self.media.get(Some(id))?));
        let t_max = end.map(|end| (2.0 * end / f64::from(path.ray.d.length())) as f32);
        match t_max.filter(|t_max| (f32::MIN_POSITIVE..path.ray.t_max).contains(t_max)) {
            Some(t_max) => Ray { t_max, ..path.ray },
            None => path.ray,
        }
    }

    /// Returns whether points near emitters may be sampled in a medium.
    fn lights_near_emitters(&self, medium: MediumId) -> bool {
        self.has_near && !self.media.is_sealed(medium)
    }

    /// Follows paths to their next events, at the surfaces that the worker's hits tell if a ray is not scattered
    /// before. The journeys and rays are those of [`depart`](Self::depart). Adds the light that they find to `out`,
    /// shadow rays to the worker, and points near emitters to `leg_points`. Returns the paths after the events that go
    /// on.
    pub fn events(
        &self,
        paths: &[Path],
        (mut journeys, rays): (Vec<Journey>, &[Ray]),
        numbers: impl Fn(usize) -> EventNumbers,
        worker: &mut Worker,
        leg_points: &mut Vec<LegPoint>,
        out: &mut [Radiance],
    ) -> Vec<Path> {
        let Worker { hits, arena, shadows, .. } = worker;
        arena.reset();
        leg_points.clear();
        let surfaces = surfaces(self.scene, rays, hits);
        for ((journey, hit), ray) in journeys.iter_mut().zip(&*hits).zip(rays) {
            journey.end_at(hit.as_ref().map_or(ray.t_max, |hit| hit.t));
        }
        let mut firsts = vec![First::Ahead; paths.len()];
        let mut samples = Vec::new();
        let enter = |i: usize, entry: &Entry<'a, '_>, flight: &FreeFlight| {
            if flight.is_sampled() && entry.medium.scatters() {
                firsts[i] = match firsts[i] {
                    First::Ahead => {
                        let leg =
                            self.light_near_emitter(&paths[i], entry, flight, &numbers(i), &mut samples);
                        leg.map_or(First::Behind, |leg| {
                            leg_points.push(LegPoint { leg, distance: 0.0 });
                            First::Here(leg_points.len() as u32 - 1)
                        })
                    }
                    First::Here(_) | First::Behind => First::Behind,
                };
            }
        };
        let collisions = follow(self.scene, self.media, &mut journeys, |i| surfaces[i].as_ref(), enter);
        let arrive = |(i, collision): (usize, Option<Collision<'a>>)| {
            let (mut path, Journey { medium, flight, .. }) = (paths[i], journeys[i]);
            let (numbers, radiance) = (numbers(i), &mut out[path.slot]);
            path.medium = medium;
            if path.depth == 0 {
                let to_surface = hits[i].as_ref().map_or(f32::INFINITY, |hit| hit.t);
                let length = collision.as_ref().map_or(to_surface, |collision| collision.t);
                radiance.distance = path.passed + length;
            }
            path.beta *= match &collision {
                Some(collision) => flight.scattered(collision.medium),
                None => flight.passed(),
            };
            if path.beta.is_black() {
                return None;
            }
            match collision {
                Some(collision) => {
                    path.on_leg = None;
                    if let First::Here(index) = firsts[i] {
                        leg_points[index as usize].distance = collision.distance;
                        path.on_leg = Some(index);
                    }
                    let leg_point = path.on_leg.map(|index| &leg_points[index as usize]);
                    self.scatter_in_medium(path, &collision, leg_point, &numbers, &mut samples)
                }
                None => {
                    let next = self.meet_surface(
                        path,
                        surfaces[i].as_ref(),
                        &numbers,
                        arena,
                        &mut samples,
                        radiance,
                    );
                    // A path that passes the surface keeps its last event.
                    next.map(|mut path| {
                        path.on_leg = path.on_leg.map(|index| {
                            leg_points.push(self.leg_points[index as usize]);
                            leg_points.len() as u32 - 1
                        });
                        path
                    })
                }
            }
        };
        let paths = collisions.into_iter().enumerate().filter_map(arrive).collect();
        self.sample_emitters(&samples, shadows);
        paths
    }

    /// Adds the light at the end of a path's ray that no medium has scattered, and scatters the path at the surface, if
    /// there is one.
    fn meet_surface<'e>(
        &'e self,
        path: Path,
        surface: Option<&'e SurfaceInteraction>,
        numbers: &EventNumbers,
        arena: &'e Bump,
        samples: &mut Vec<PendingSample<'e>>,
        radiance: &mut Radiance,
    ) -> Option<Path> {
        match surface {
            Some(at) => {
                if self.adds_emission(&path) {
                    radiance.value += path.beta * self.emitted(&path, at);
                }
                if path.depth == 0 && self.limits.hide_emitters && self.emits(at) {
                    return Some(self.pass(path, at));
                }
                self.scatter_at_surface(path, at, numbers, arena, samples)
            }
            None => {
                if self.adds_emission(&path) {
                    radiance.value += path.beta * self.environment(&path);
                }
                None
            }
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
        scatterer: Scatterer<'e>,
        numbers: &EventNumbers,
    ) -> Option<PendingSample<'e>> {
        if !self.query.wants(path.depth + 2) {
            return None;
        }
        let u = numbers.emitter_point;
        let choice = self.selection().sample(p, u.x)?;
        Some(PendingSample {
            p,
            scatterer,
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

    fn emits(&self, at: &SurfaceInteraction) -> bool {
        self.scene.shapes[at.shape().index()].emitter.is_some()
    }

    /// Returns the weighted radiance of the emitter at a surface; black if nothing is emitted towards the path.
    fn emitted(&self, path: &Path, at: &SurfaceInteraction) -> Rgb {
        let Some(emitter) = self.scene.emitter_at(at) else { return Rgb::BLACK };
        let radiance = self.scene.emitted(emitter, at);
        if path.pdf.is_infinite() {
            return radiance;
        }
        let other = self.scene.emitter_pdf(self.selection(), emitter, path.from, path.ray.o, at);
        let other = other * path.emitter_share;
        let factor = path.on_leg.map_or(0.0, |point| {
            let pmf = self.selection().pmf(emitter.index(), path.from);
            self.relative_density(&self.leg_points[point as usize], emitter.index(), pmf)
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
            let p = before_end(leg.at(distance), entry.ahead, path.ray.d);
            let scattered = flight.passed() * leg.transmittance(distance) * medium.sigma_s;
            let competitors = Competitors::OfPointNearEmitter {
                density: density as f32,
                flights: leg.flight_density(distance) as f32,
                pmf: self.selection().pmf(choice.emitter, p),
            };
            samples.push(PendingSample {
                p,
                scatterer: Scatterer::Medium(&medium.phase),
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

    /// Continues a path straight through a surface.
    fn pass(&self, path: Path, at: &SurfaceInteraction) -> Path {
        let Ray { d, time, t_max, .. } = path.ray;
        let t = at.hit.t;
        Path {
            ray: Ray { t_max: t_max - t, ..self.scene.spawn_ray(at, d, time) },
            medium: self.media.beside(at, d, path.medium),
            passed: path.passed + t,
            ..path
        }
    }

    fn scatter_at_surface<'e>(
        &'e self,
        path: Path,
        at: &'e SurfaceInteraction,
        numbers: &EventNumbers,
        arena: &'e Bump,
        samples: &mut Vec<PendingSample<'e>>,
    ) -> Option<Path> {
        if !self.scatters(&path) {
            return None;
        }
        let Ray { d, time, .. } = path.ray;
        let wo = at.frame.to_local(-d);
        let bsdf = self.scene.bsdf(at, Some(wo), arena);
        if !bsdf.is_specular() {
            let scatterer = Scatterer::Surface(at, bsdf, wo);
            samples.extend(self.sample_emitter(&path, at.p, scatterer, numbers));
        }
        let sample = bsdf.sample(wo, numbers.lobe, numbers.direction)?;
        let wi = at.frame.to_world(sample.wi);
        let emits = self.scene.shapes[at.shape().index()].emitter.is_some();
        // Rays hit an emitter with holes everywhere. To pass a hole is not an event.
        if emits
            && self.scene.materials.get(at.material).holes
            && sample.lobe == Lobe::Specular
            && sample.wi == -wo
        {
            return Some(Path { beta: path.beta * sample.weight, pdf: sample.pdf, ..self.pass(path, at) });
        }
        let next = Path {
            ray: self.scene.spawn_ray(at, wi, time),
            medium: medium_after(self.scene, self.media, at, (d, wi), path.medium),
            from: at.p,
            pdf: sample.pdf,
            emitter_share: 1.0,
            beta: path.beta * sample.weight,
            eta: path.eta * sample.eta,
            depth: path.depth + 1,
            on_leg: None,
            ..path
        };
        self.survivor(next, numbers)
    }

    /// Adds a sample of an emitter at the path's next event, which is in a medium, and scatters the path there.
    fn scatter_in_medium<'e>(
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
            let sample = self.sample_emitter(&path, p, Scatterer::Medium(phase), numbers);
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
