//! Which share of a disc around a surface point the surface fills, as far as it is seen from there.
//!
//! Density estimation takes a disc for full and all of its photons for those of one room. At the edge of a surface half of the disc
//! is empty, so that the estimate is half of what it should be; behind a wall that stands on the surface lies light of another room.
//! Rays from a point above the disc's middle to points all over it say how much of it is there and seen, whatever light
//! falls on it, so that the border of a shadow is not taken for the border of a surface. Where some of them do not find
//! it, photons count only if they, too, are seen from there: what stands on the surface and is higher than a third of
//! the disc's radius keeps light apart.

use super::PhotonMap;
use super::density::{COMPATIBLE, DensityEstimator, FLATNESS, Irradiance, Place, Sides};
use super::irradiance::Point;
use super::kdtree::Nearest;
use super::kernel::Kernel;
use crate::accel::{Coherence, Hit};
use crate::color::Rgb;
use crate::integrator::worker::{Counters, intersect};
use crate::math::{Frame, LANES, Ray, RayX16, Vec3};
use crate::sampling::hash::{mix, to_unit};
use crate::scene::Scene;
use std::sync::{Mutex, PoisonError};

/// Rays that find out whether a disc is full and free.
const RAYS: usize = 32;
/// Rays for a disc that is not.
const MORE_RAYS: usize = 64;
/// Where a ray to the middle of a disc must have come, of its way, to have met the disc's surface.
const NEARLY: f32 = 0.9;
/// Where less of a disc is seen, nothing is said about it.
const LEAST_SHARE: f32 = 1.0 / 16.0;

/// Corrects irradiance at the boundaries of surfaces.
pub struct Boundary<'a> {
    scene: &'a Scene,
    counters: Mutex<Counters>,
}

/// What is known of a disc.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Disc {
    /// All of it is seen from its middle.
    Free,
    /// Something stands on it, or it is not full.
    Obstructed,
    /// Too little is seen of it to say anything.
    Unknown,
}

/// What rays to a disc have found.
#[derive(Clone, Copy)]
struct Tally {
    /// How many have met the surface.
    filled: usize,
    /// Which share of the disc that makes.
    share: f32,
    /// Whether the one to the middle has not met it.
    hidden: bool,
}

impl<'a> Boundary<'a> {
    /// For the surfaces of a scene.
    pub fn new(scene: &'a Scene) -> Self {
        Boundary { scene, counters: Mutex::default() }
    }

    /// Divides each estimate by the share of its disc, weighted by the kernel, that the surface fills and that is seen; leaves out
    /// the photons that are not. Returns what is known of the discs.
    pub fn correct(
        &self,
        map: &PhotonMap,
        estimator: &DensityEstimator,
        places: &[Point],
        buffer: &mut Nearest,
        estimates: &mut [Irradiance],
    ) -> Vec<Disc> {
        let mut tracer = Tracer::new(self.scene);
        // Photons at one point have a disc without extent.
        let radius = |estimate: &Irradiance| match estimate.radius {
            0.0 => estimator.lookup_radius,
            radius => radius,
        };
        for (point, estimate) in places.iter().zip(&*estimates) {
            tracer.aim(point.at, radius(estimate), Apex::High, estimator.kernel, point.number, RAYS);
        }
        tracer.trace();
        let tallies: Vec<Tally> =
            places.iter().enumerate().map(|(i, point)| tracer.tally(&point.at, i * RAYS, RAYS)).collect();
        let discs = places.iter().zip(estimates).zip(tallies).map(|((point, estimate), tally)| {
            let at = point.at;
            if estimate.radius == 0.0 {
                return Disc::Unknown;
            }
            if tally.filled == RAYS && !tally.hidden {
                return Disc::Free;
            }
            let apex = if tally.hidden { Apex::Low } else { Apex::High };
            tracer.rays.clear();
            tracer.aim(at, estimate.radius, apex, estimator.kernel, point.number, MORE_RAYS);
            tracer.trace();
            let tally = tracer.tally(&at, 0, MORE_RAYS);
            let share = tally.share.min(1.0);
            if tally.hidden || share < LEAST_SHARE {
                return Disc::Unknown;
            }
            let apex = apex.above(at, estimate.radius);
            estimate.value = tracer.seen(map, estimator, point, apex, buffer) / share;
            Disc::Obstructed
        });
        let discs = discs.collect();
        self.counters.lock().unwrap_or_else(PoisonError::into_inner).merge(&tracer.counters);
        discs
    }

    /// The rays that were traced.
    pub fn counters(self) -> Counters {
        self.counters.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The point above a disc's middle that looks at it.
#[derive(Clone, Copy)]
enum Apex {
    /// As high as the flat ellipsoid of the disc.
    High,
    /// Where something hangs lower than that.
    Low,
}

impl Apex {
    fn above(self, at: Place, radius: f32) -> Vec3 {
        let share = match self {
            Apex::High => 1.0,
            Apex::Low => 0.125,
        };
        at.p + at.n * (share * radius / FLATNESS)
    }
}

/// Rays, and what they have met.
struct Tracer<'a> {
    scene: &'a Scene,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    /// Geometric normals where they have met something.
    normals: Vec<Vec3>,
    /// How many rays each stands for that has met something: of a surface with holes, one over its opacity.
    weights: Vec<f32>,
    counters: Counters,
}

impl<'a> Tracer<'a> {
    fn new(scene: &'a Scene) -> Self {
        let counters = Counters::default();
        Tracer {
            scene,
            rays: Vec::new(),
            hits: Vec::new(),
            normals: Vec::new(),
            weights: Vec::new(),
            counters,
        }
    }

    /// Adds rays to the disc, the first to its middle.
    fn aim(&mut self, at: Place, radius: f32, apex: Apex, kernel: Kernel, disc: u32, count: usize) {
        let o = apex.above(at, radius);
        let frame = Frame::from_normal(at.n);
        let turn = to_unit(mix(disc));
        self.rays.extend((0..count).map(|k| {
            // A sunflower's spiral, turned for each disc; its points are spread as the kernel's weight is.
            let (sin, cos) = (std::f32::consts::TAU * (k as f32 * 0.618_034 + turn).fract()).sin_cos();
            let d = if k == 0 { 0.0 } else { kernel.quantile((k as f32 + 0.5) / count as f32) };
            let depth = radius / FLATNESS * (1.0 - d * d).max(0.0).sqrt();
            let to = at.p + frame.to_world(Vec3::new(cos, sin, 0.0)) * (d * radius);
            // On to where the ray leaves the ellipsoid below, about.
            let height = (o - at.p).dot(at.n);
            Ray { o, d: to - o, t_max: 1.0 + depth / height, time: 0.0 }
        }));
    }

    fn trace(&mut self) {
        let Tracer { scene, rays, hits, normals, weights, counters } = self;
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
            weights.extend((0..hits.len()).map(|i| scene.share_met(&at.lane(i)).recip()));
        }
    }

    fn tally(&self, at: &Place, first: usize, count: usize) -> Tally {
        let meets = |i: usize| self.meets(at, i) == Some(true);
        // What is met on the way down is another surface, though it may be parallel.
        let hidden = !meets(first) || self.hits[first].is_none_or(|hit| hit.t < NEARLY);
        let met = || (first..first + count).filter(|&i| meets(i));
        Tally {
            filled: met().count(),
            share: met().map(|i| self.weights[i]).sum::<f32>() / count as f32,
            hidden,
        }
    }

    /// Whether a ray has met the surface that the place belongs to; `None` where it has met nothing.
    fn meets(&self, at: &Place, i: usize) -> Option<bool> {
        self.hits[i]?;
        let ng = self.normals[i];
        let cosine = ng.dot(at.n);
        Some(cosine * cosine > COMPATIBLE && cosine * ng.dot(self.rays[i].d) < 0.0)
    }

    /// Irradiance by the photons that are seen from a point above.
    fn seen(
        &mut self,
        map: &PhotonMap,
        estimator: &DensityEstimator,
        &Point { at, own, .. }: &Point,
        o: Vec3,
        buffer: &mut Nearest,
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
        let seen = (0..powers.len()).filter(|&i| self.meets(&at, i) != Some(false));
        seen.fold(Rgb::BLACK, |sum, i| sum + powers[i])
    }
}
