//! Density estimation: light at a surface point from the photons around it. [Jensen 1996; Jensen 2001, 7.2]
//!
//! The nearest k photons are searched among those that belong to the surface: their normal is within 60 degrees of
//! the point's normal, on the requested side, and distances along the normal count three times. Light therefore does
//! not leak around corners or to the other side of a thin wall, and leaks from a parallel surface only if that is
//! nearer than a third of the radius. It does leak along a surface that continues behind a wall on it, except where
//! [`boundary`](super::boundary) corrects it. The farthest photon only determines the radius of the disc and is not
//! part of the sum. On a plane under uniform light the estimate is then unbiased for every kernel, also if fewer than
//! k photons are within the lookup radius. (The reciprocal of the squared radius around k photons of a Poisson
//! process has an expected value with k − 1 in place of k.)
//!
//! The sources of bias are:
//! - Light is blurred over the disc. The error is proportional to the curvature where the irradiance is smooth, and
//!   half of the step at the border of a shadow.
//! - Where the surface ends within the disc, the missing part counts as dark: an edge loses half of the irradiance, a
//!   corner three quarters. [`boundary`](super::boundary) corrects this too, for irradiance computed in advance.
//! - On a sphere of radius R, the estimate is low by 2 (r / R)², because the ellipsoid's intersection with the sphere
//!   differs in area from a disc of radius r. This is half a percent for r = R / 20.
//! - Photons at a single point have no density; if all k are at one point, the estimate is zero.

use super::PhotonMap;
use super::kdtree::{EllipsoidMetric, NeighbourBuffer};
use super::kernel::Kernel;
use crate::color::Rgb;
use crate::math::Vec3;
use crate::math::lanes::{LANES, f32x16};

/// The factor on distances along the normal.
pub const FLATNESS: f32 = 3.0;
/// The squared cosine between the normals of photon and point above which the photon belongs to the surface.
pub const COMPATIBLE: f32 = 0.25;

/// The parameters of density estimation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensityEstimator {
    /// The kernel that weights photons by their distance.
    pub kernel: Kernel,
    /// The number of photons in a lookup, at least 2.
    pub lookup_size: usize,
    /// The maximum lookup radius in scene units; positive.
    pub lookup_radius: f32,
}

/// A surface point and one side of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LookupPoint {
    /// Position.
    pub p: Vec3,
    /// Geometric normal on that side, of unit length.
    pub n: Vec3,
}

/// The selection of photons by the side on which they arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sides {
    /// Photons that arrived on the side of the point's normal.
    Front,
    /// All photons, for a surface that transmits light.
    Both,
}

/// An irradiance estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Irradiance {
    /// W·m⁻².
    pub value: Rgb,
    /// The number of photons in the disc.
    pub photons: usize,
    /// The radius of the disc in scene units.
    pub radius: f32,
}

impl DensityEstimator {
    /// Estimates the irradiance at a point, for light that arrives on its side.
    pub fn irradiance(&self, map: &PhotonMap, at: LookupPoint, buffer: &mut NeighbourBuffer) -> Irradiance {
        self.irradiance_by(map, at, None, buffer)
    }

    /// Estimates the irradiance without one photon. At the position of a photon, that photon must be excluded: its
    /// position is not random relative to the point.
    pub fn irradiance_by(
        &self,
        map: &PhotonMap,
        at: LookupPoint,
        except: Option<usize>,
        buffer: &mut NeighbourBuffer,
    ) -> Irradiance {
        let mut value = Rgb::BLACK;
        let (photons, radius) = self.gather(map, at, Sides::Front, except, buffer, |slot, weight| {
            value += map.power_of(slot) * weight;
        });
        Irradiance { value, photons, radius }
    }

    /// Estimates the radiance scattered by the surface, W·m⁻²·sr⁻¹. `f` is the bare BSDF for the direction towards
    /// the incident light.
    ///
    /// Powers are relative to the shading frame: see [`Deposit`](super::Deposit).
    pub fn reflected(
        &self,
        map: &PhotonMap,
        at: LookupPoint,
        sides: Sides,
        buffer: &mut NeighbourBuffer,
        mut f: impl FnMut(Vec3) -> Rgb,
    ) -> Rgb {
        let mut value = Rgb::BLACK;
        self.gather(map, at, sides, None, buffer, |slot, weight| {
            value += f(map.wi_of(slot)) * map.power_of(slot) * weight;
        });
        value
    }

    /// Calls `add` for the slots of the photons around a point, except `except`, with their weights; power times
    /// weight is a contribution to the density, m⁻². Returns the number of photons and the radius of the disc.
    #[inline]
    pub(super) fn gather(
        &self,
        map: &PhotonMap,
        at: LookupPoint,
        sides: Sides,
        except: Option<usize>,
        buffer: &mut NeighbourBuffer,
        mut add: impl FnMut(usize, f32),
    ) -> (usize, f32) {
        let metric = EllipsoidMetric { normal: at.n, flatness: FLATNESS };
        let bound = self.lookup_radius * self.lookup_radius;
        let excluded = |first: usize| match except {
            Some(slot) if slot / LANES == first / LANES => 1 << (slot % LANES),
            _ => 0,
        };
        let belongs = |first: usize, slots: u32| {
            let cosines = map.signed_squared_cosines(first, at.n);
            let facing = match sides {
                Sides::Front => cosines,
                Sides::Both => cosines.abs(),
            };
            slots & facing.simd_gt(f32x16::splat(COMPATIBLE)).to_bitmask() & !excluded(first)
        };
        let found = map.tree().nearest(at.p, self.lookup_size, bound, metric, belongs, buffer);
        let farthest = found.iter().max().copied();
        // If fewer than k photons were found, the disc is the whole search region, provided that it is bounded.
        let rim = farthest.filter(|_| found.len() == self.lookup_size || bound.is_infinite());
        let squared = rim.map_or(bound, |rim| rim.distance_squared());
        if farthest.is_none() || squared == 0.0 {
            return (0, squared.sqrt());
        }
        let scale = 1.0 / (std::f32::consts::PI * squared * map.emitted() as f32);
        for neighbour in found.iter().filter(|&&n| Some(n) != rim) {
            let weight = self.kernel.weight(neighbour.distance_squared() / squared);
            add(neighbour.slot(), weight * scale);
        }
        (found.len() - usize::from(rim.is_some()), squared.sqrt())
    }
}
