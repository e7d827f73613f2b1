//! Irradiance that is computed beforehand at some of the photons, so that final gathering looks up one of them
//! instead of estimating a density at every ray's end. [Christensen 1999]

use super::PhotonMap;
use super::boundary::{self, Boundary};
use super::density::{COMPATIBLE, DensityEstimator, FLATNESS, Irradiance, Place};
use super::kdtree::{Built, Disc, KdTree, Nearest};
use super::photon::PackedRgb;
use crate::color::Rgb;
use crate::math::octahedral::{decode_octahedral, encode_octahedral, signed_squared_cosine};
use rayon::prelude::*;

/// Irradiance at points of surfaces: 24.5 bytes each.
pub struct IrradianceMap {
    tree: KdTree,
    /// By slot of the tree.
    values: Vec<Value>,
    lookup_radius: f32,
}

/// Irradiance that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// W·m⁻².
    pub value: Rgb,
    /// The radius of the disc that it was estimated over, scene units; infinite where it is not to be used, for
    /// the disc was not seen well enough.
    pub radius: f32,
    /// Where it was estimated.
    pub at: Place,
    /// Whether the whole disc is known to be seen from its middle, and the place that was asked about is not below it.
    pub free: bool,
}

/// A point that irradiance is computed at.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    /// Where, and for which side.
    pub at: Place,
    /// The slot of the photon that it is the place of, if that is one of the map.
    pub own: Option<usize>,
    /// Tells it from other points.
    pub number: u32,
}

/// Irradiance on the side of a normal.
#[derive(Clone, Copy)]
struct Value {
    irradiance: PackedRgb,
    normal: u16,
    /// The radius of the disc, over the lookup radius; negative where something stands on the disc.
    share: half::f16,
}

/// How far below a disc a place may be, over the distance from its middle: as far as surfaces that bend go.
const BELOW: f32 = 0.03;
/// Points that one task computes irradiance at.
const TASK: usize = 256;

impl IrradianceMap {
    /// Irradiance by the photons of `map` at the place of every `every`-th photon of `places`, in their order, so
    /// that points are spread as photons are. What the surface lacks of a disc is taken into account by `boundary`.
    ///
    /// Photons of another map make better places than those of the map itself: the photon that is nearest to some
    /// point is likely to be one with few others around it, where the density is estimated too low (by 1 % for discs
    /// of 30 photons).
    pub fn new(
        map: &PhotonMap,
        places: &PhotonMap,
        estimator: &DensityEstimator,
        every: usize,
        boundary: Option<&Boundary<'_>>,
    ) -> Self {
        let same = std::ptr::eq(map, places);
        let point = |slot: usize| {
            let photon = places.photon(slot);
            let at = Place { p: photon.position(), n: photon.normal() };
            Point { at, own: same.then_some(slot), number: slot as u32 }
        };
        let places: Vec<Point> = (0..places.len()).step_by(every.max(1)).map(point).collect();
        let estimate = |places: &[Point]| {
            let mut buffer = Nearest::default();
            let mut estimates: Vec<Irradiance> = places
                .iter()
                .map(|point| estimator.irradiance_by(map, point.at, point.own, &mut buffer))
                .collect();
            let discs = match boundary {
                Some(boundary) => boundary.correct(map, estimator, places, &mut buffer, &mut estimates),
                None => vec![boundary::Disc::Free; places.len()],
            };
            estimates.into_iter().zip(discs)
        };
        let values: Vec<(Irradiance, boundary::Disc)> =
            places.par_chunks(TASK).flat_map_iter(estimate).collect();
        let Built { tree, order } = KdTree::build(places.len(), |i| places[i].at.p);
        let value = |&i: &u32| {
            let (estimate, disc) = values[i as usize];
            let share = estimate.radius / estimator.lookup_radius;
            Value {
                irradiance: PackedRgb::new(estimate.value),
                normal: encode_octahedral(places[i as usize].at.n),
                share: half::f16::from_f32(match disc {
                    boundary::Disc::Free => share,
                    boundary::Disc::Obstructed => -share,
                    boundary::Disc::Unknown => f32::INFINITY,
                }),
            }
        };
        let lookup_radius = estimator.lookup_radius;
        IrradianceMap { values: order.iter().map(value).collect(), tree, lookup_radius }
    }

    /// Irradiance at the nearest point of the place's surface, and the disc that it was estimated over; `None` where there
    /// is none within the lookup radius.
    #[inline]
    pub fn nearest(&self, at: Place) -> Option<Known> {
        let metric = Disc { normal: at.n, flatness: FLATNESS };
        let belongs = |slot: usize| signed_squared_cosine(self.values[slot].normal, at.n) > COMPATIBLE;
        let bound = self.lookup_radius * self.lookup_radius;
        let nearest = self.tree.nearest_one(at.p, bound, metric, belongs)?;
        let value = &self.values[nearest.slot()];
        let (share, distance) = (value.share.to_f32(), nearest.distance_squared().sqrt());
        let radius = share.abs() * self.lookup_radius;
        let found = Place { p: self.tree.point(nearest.slot()), n: decode_octahedral(value.normal) };
        let free = share.is_sign_positive()
            && distance < radius
            && (at.p - found.p).dot(found.n) > -BELOW * distance;
        Some(Known { value: value.irradiance.get(), radius, at: found, free })
    }

    /// How many points there are.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Bytes on the heap.
    pub fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes() + size_of_val(&self.values[..])
    }
}
