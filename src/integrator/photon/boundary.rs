//! The boundary correction of density estimation: the fraction of a disc that the surface fills and that is visible.
//!
//! Density estimation assumes that the disc is filled by the surface and that all its photons belong to the same
//! room. At an edge of a surface, half of the disc is empty and the estimate is half of the correct value; behind a
//! wall on the surface there is light of another room. Rays from a point above the centre of the disc to points all
//! over it determine the fraction that exists and is visible. This does not depend on the illumination, so the border
//! of a shadow is not mistaken for the border of a surface. If some rays do not hit the surface, only photons visible
//! from the same point are used. An obstacle on the surface therefore separates light if it is higher than a third of
//! the disc's radius.

use super::PhotonMap;
use super::density::{COMPATIBLE, DensityEstimator, FLATNESS, Irradiance, LookupPoint, Sides};
use super::irradiance::IrradiancePoint;
use super::kdtree::NeighbourBuffer;
use super::kernel::Kernel;
use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::integrator::worker::{Counters, intersect};
use crate::math::{Frame, LANES, Ray, RayX16, Vec3};
use crate::sampling::hash::{mix, to_unit};
use crate::scene::Scene;
use std::sync::{Mutex, PoisonError};

/// The number of rays that test whether a disc is filled and unobstructed.
const RAYS: usize = 32;
/// The number of rays for the other discs.
const MORE_RAYS: usize = 64;
/// The least ray parameter of a hit on the disc's surface for a ray towards the centre, which is at 1.
const MIN_CENTRE_T: f32 = 0.9;
/// The least visible fraction of a disc for which an estimate is made.
const MIN_FRACTION: f32 = 1.0 / 16.0;

/// Corrects irradiance estimates at the boundaries of surfaces.
pub struct Boundary<'a> {
    scene: &'a Scene,
    counters: Mutex<Counters>,
}

/// The visibility of a disc from above its centre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DiscVisibility {
    /// The whole disc is visible.
    Visible,
    /// An object obstructs the disc, or the surface does not fill it.
    Obstructed,
    /// Too small a fraction is visible for an estimate.
    Unknown,
}

/// The result of the rays to a disc.
#[derive(Clone, Copy)]
struct DiscTally {
    /// The number of rays that hit the surface.
    filled: usize,
    /// The fraction of the disc that they represent.
    fraction: f32,
    /// Whether the ray towards the centre missed the surface.
    hidden: bool,
}

impl<'a> Boundary<'a> {
    /// Creates the correction for a scene.
    pub fn new(scene: &'a Scene) -> Self {
        Boundary { scene, counters: Mutex::default() }
    }

    /// Divides each estimate by the visible fraction of its disc, weighted by the kernel, and excludes photons that
    /// are not visible. Returns the visibility of the discs.
    pub fn correct(
        &self,
        map: &PhotonMap,
        estimator: &DensityEstimator,
        places: &[IrradiancePoint],
        buffer: &mut NeighbourBuffer,
        estimates: &mut [Irradiance],
    ) -> Vec<DiscVisibility> {
        let mut tracer = BoundaryTracer::new(self.scene);
        // If all photons are at one point, the disc has radius zero.
        let radius = |estimate: &Irradiance| match estimate.radius {
            0.0 => estimator.lookup_radius,
            radius => radius,
        };
        for (point, estimate) in places.iter().zip(&*estimates) {
            tracer.add_rays(
                point.at,
                radius(estimate),
                Viewpoint::High,
                estimator.kernel,
                point.number,
                RAYS,
            );
        }
        tracer.trace();
        let tallies: Vec<DiscTally> =
            places.iter().enumerate().map(|(i, point)| tracer.tally(&point.at, i * RAYS, RAYS)).collect();
        let discs = places.iter().zip(estimates).zip(tallies).map(|((point, estimate), tally)| {
            let at = point.at;
            if estimate.radius == 0.0 {
                return DiscVisibility::Unknown;
            }
            if tally.filled == RAYS && !tally.hidden {
                return DiscVisibility::Visible;
            }
            let apex = if tally.hidden { Viewpoint::Low } else { Viewpoint::High };
            tracer.rays.clear();
            tracer.add_rays(at, estimate.radius, apex, estimator.kernel, point.number, MORE_RAYS);
            tracer.trace();
            let tally = tracer.tally(&at, 0, MORE_RAYS);
            let fraction = tally.fraction.min(1.0);
            if tally.hidden || fraction < MIN_FRACTION {
                return DiscVisibility::Unknown;
            }
            let apex = apex.above(at, estimate.radius);
            estimate.value = tracer.visible_irradiance(map, estimator, point, apex, buffer) / fraction;
            DiscVisibility::Obstructed
        });
        let discs = discs.collect();
        self.counters.lock().unwrap_or_else(PoisonError::into_inner).merge(&tracer.counters);
        discs
    }

    /// Returns the counters of the traced rays.
    pub fn counters(self) -> Counters {
        self.counters.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The point above the centre of a disc from which visibility is tested.
#[derive(Clone, Copy)]
enum Viewpoint {
    /// At the height of the disc's flat ellipsoid.
    High,
    /// Lower, for discs with an obstacle between that height and the disc.
    Low,
}

impl Viewpoint {
    fn above(self, at: LookupPoint, radius: f32) -> Vec3 {
        let fraction = match self {
            Viewpoint::High => 1.0,
            Viewpoint::Low => 0.125,
        };
        at.p + at.n * (fraction * radius / FLATNESS)
    }
}

/// Rays and their hits.
struct BoundaryTracer<'a> {
    scene: &'a Scene,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    /// The geometric normals at the hits.
    normals: Vec<Vec3>,
    /// The weight of each hit: one over the opacity of the surface.
    weights: Vec<f32>,
    counters: Counters,
}

impl<'a> BoundaryTracer<'a> {
    fn new(scene: &'a Scene) -> Self {
        let counters = Counters::default();
        BoundaryTracer {
            scene,
            rays: Vec::new(),
            hits: Vec::new(),
            normals: Vec::new(),
            weights: Vec::new(),
            counters,
        }
    }

    /// Adds rays to points on the disc, the first to its centre.
    fn add_rays(
        &mut self,
        at: LookupPoint,
        radius: f32,
        apex: Viewpoint,
        kernel: Kernel,
        disc: u32,
        count: usize,
    ) {
        let o = apex.above(at, radius);
        let frame = Frame::from_normal(at.n);
        let turn = to_unit(mix(disc));
        self.rays.extend((0..count).map(|k| {
            // A sunflower spiral, rotated for each disc. The density of its points follows the kernel.
            let (sin, cos) = (std::f32::consts::TAU * (k as f32 * 0.618_034 + turn).fract()).sin_cos();
            let d = if k == 0 { 0.0 } else { kernel.quantile((k as f32 + 0.5) / count as f32) };
            let depth = radius / FLATNESS * (1.0 - d * d).max(0.0).sqrt();
            let to = at.p + frame.to_world(Vec3::new(cos, sin, 0.0)) * (d * radius);
            // Extends the ray approximately to the lower side of the ellipsoid.
            let height = (o - at.p).dot(at.n);
            Ray { o, d: to - o, t_max: 1.0 + depth / height, time: 0.0 }
        }));
    }

    fn trace(&mut self) {
        let BoundaryTracer { scene, rays, hits, normals, weights, counters } = self;
        intersect(scene, rays, Coherence::Incoherent, hits, counters);
        normals.clear();
        weights.clear();
        for first in (0..rays.len()).step_by(LANES) {
            let hits = &hits[first..rays.len().min(first + LANES)];
            let Some(any) = hits.iter().flatten().next() else {
                normals.extend(hits.iter().map(|_| Vec3::ZERO));
                weights.extend(hits.iter().map(|_| 0.0));
                continue;
            };
            let hit = |i: usize| hits.get(i).copied().flatten().unwrap_or(*any);
            let at = scene.interactions(&RayX16::load(rays, first), &std::array::from_fn(hit));
            normals.extend((0..hits.len()).map(|i| at.ng.lane(i)));
            weights.extend((0..hits.len()).map(|i| scene.hit_probability(&at.lane(i)).recip()));
        }
    }

    fn tally(&self, at: &LookupPoint, first: usize, count: usize) -> DiscTally {
        let meets = |i: usize| self.meets(at, i) == Some(true);
        // A nearer hit belongs to another surface, even if that is parallel.
        let hidden = !meets(first) || self.hits[first].is_none_or(|hit| hit.t < MIN_CENTRE_T);
        let met = || (first..first + count).filter(|&i| meets(i));
        DiscTally {
            filled: met().count(),
            fraction: met().map(|i| self.weights[i]).sum::<f32>() / count as f32,
            hidden,
        }
    }

    /// Returns whether a ray hit the surface of the point; `None` if it hit nothing.
    fn meets(&self, at: &LookupPoint, i: usize) -> Option<bool> {
        self.hits[i]?;
        let ng = self.normals[i];
        let cosine = ng.dot(at.n);
        Some(cosine * cosine > COMPATIBLE && cosine * ng.dot(self.rays[i].d) < 0.0)
    }

    /// Returns the irradiance of the photons that are visible from the point `o` above.
    fn visible_irradiance(
        &mut self,
        map: &PhotonMap,
        estimator: &DensityEstimator,
        &IrradiancePoint { at, own, .. }: &IrradiancePoint,
        o: Vec3,
        buffer: &mut NeighbourBuffer,
    ) -> Rgb {
        self.rays.clear();
        let mut powers = Vec::with_capacity(estimator.lookup_size);
        estimator.gather(map, at, Sides::Front, own, buffer, |slot, weight| {
            let photon = map.photon(slot);
            let d = photon.position() - o;
            if d.dot(photon.normal()) < 0.0 {
                self.rays.push(Ray { o, d, t_max: 1.0, time: 0.0 });
                powers.push(photon.power() * weight);
            }
        });
        self.trace();
        let visible_irradiance = (0..powers.len()).filter(|&i| self.meets(&at, i) != Some(false));
        visible_irradiance.fold(Rgb::BLACK, |sum, i| sum + powers[i])
    }
}
