//! Density estimation: light at a surface point from the photons around it. [Jensen 1996; Jensen 2001, 7.2]
//!
//! The nearest k photons are searched for among those that belong to the surface: their normal is within 60 degrees
//! of the point's, on the side that is asked for, and distances along the normal count three times. So light does not
//! leak around corners or to the other side of a thin wall, and from a parallel surface only where that is nearer than a third of
//! the radius. It does leak along a surface that goes on behind a wall which stands on it, but for where [`boundary`](super::boundary) looks. The farthest photon only says how large the disc is, and does not count: on a plane under uniform light the
//! estimate is then unbiased for every kernel, and where fewer than k lie within the lookup radius, too. (The squared radius
//! around k photons of a Poisson process has the mean of its reciprocal with k − 1, not with k.)
//!
//! What is biased:
//! - Light is blurred over the disc: by its curvature, where it is smooth, by half of the step at the border of a shadow.
//! - Where the surface ends within the disc, what lies beyond counts as dark: an edge is too dark by half, a corner
//!   by three quarters. [`boundary`](super::boundary) corrects this, too, where irradiance is computed beforehand.
//! - On a sphere of radius R the estimate is low by 2 (r / R)², as the ellipsoid's section with it is larger or smaller
//!   than the disc of the radius r: by half a percent at r = R / 20.
//! - Photons at the same point have no density; k of them count as none.

use super::PhotonMap;
use super::kdtree::{Disc, Nearest};
use super::kernel::Kernel;
use crate::color::Rgb;
use crate::math::Vec3;
use crate::math::lanes::{LANES, f32x16};

/// How many times a distance along the normal counts.
pub const FLATNESS: f32 = 3.0;
/// The squared cosine between normals above which they belong to one surface.
pub const COMPATIBLE: f32 = 0.25;

/// How photons become light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensityEstimator {
    /// The weights of photons by their distance.
    pub kernel: Kernel,
    /// How many photons are searched for, at least 2.
    pub lookup_size: usize,
    /// How far they may be, scene units; positive.
    pub lookup_radius: f32,
}

/// A point of a surface, and the side that is asked about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Position.
    pub p: Vec3,
    /// Geometric normal of that side, unit length.
    pub n: Vec3,
}

/// Which photons of a surface count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sides {
    /// Those that came to the side that is asked about.
    Front,
    /// All: the surface lets light through.
    Both,
}

/// Irradiance, and what it was estimated from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Irradiance {
    /// W·m⁻².
    pub value: Rgb,
    /// The photons in the disc.
    pub photons: usize,
    /// The disc's radius, scene units.
    pub radius: f32,
}

impl DensityEstimator {
    /// Irradiance at a place, for light that arrives at its side.
    pub fn irradiance(&self, map: &PhotonMap, at: Place, buffer: &mut Nearest) -> Irradiance {
        self.irradiance_by(map, at, None, buffer)
    }

    /// Irradiance at a place, by all photons but one: at the place of a photon it does not count itself, for it is
    /// there by choice, not by chance.
    pub fn irradiance_by(
        &self,
        map: &PhotonMap,
        at: Place,
        except: Option<usize>,
        buffer: &mut Nearest,
    ) -> Irradiance {
        let mut value = Rgb::BLACK;
        let (photons, radius) = self.gather(map, at, Sides::Front, except, buffer, |slot, weight| {
            value += map.power_of(slot) * weight;
        });
        Irradiance { value, photons, radius }
    }

    /// Radiance that the surface sends on, given the bare BSDF `f` of the direction to where light comes from: W·m⁻²·sr⁻¹.
    ///
    /// Powers are taken as the shading frame sees them: see [`Deposit`](super::Deposit).
    pub fn reflected(
        &self,
        map: &PhotonMap,
        at: Place,
        sides: Sides,
        buffer: &mut Nearest,
        mut f: impl FnMut(Vec3) -> Rgb,
    ) -> Rgb {
        let mut value = Rgb::BLACK;
        self.gather(map, at, sides, None, buffer, |slot, weight| {
            value += f(map.wi_of(slot)) * map.power_of(slot) * weight;
        });
        value
    }

    /// Hands `add` the slots of the photons around a place, but `except`, with their weights: power times
    /// weight is a part of the density, m⁻². Returns how many photons there are, and the disc's radius.
    #[inline]
    pub(super) fn gather(
        &self,
        map: &PhotonMap,
        at: Place,
        sides: Sides,
        except: Option<usize>,
        buffer: &mut Nearest,
        mut add: impl FnMut(usize, f32),
    ) -> (usize, f32) {
        let metric = Disc { normal: at.n, flatness: FLATNESS };
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
        // Where too few are found, the disc is all that was searched, if that has an end.
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
