//! Irradiance computed in advance at a subset of the photons. A gather ray then looks up one value instead of
//! estimating a density. [Christensen 1999]

use super::PhotonMap;
use super::boundary::{self, Boundary};
use super::density::{COMPATIBLE, DensityEstimator, FLATNESS, Irradiance, LookupPoint};
use super::kdtree::{BuiltTree, EllipsoidMetric, KdTree, NeighbourBuffer};
use super::photon::PackedRgb;
use crate::color::Rgb;
use crate::math::octahedral::{decode_octahedral, encode_octahedral, signed_squared_cosine};
use rayon::prelude::*;

/// Irradiance at surface points: 24.5 bytes for each point.
pub struct IrradianceMap {
    tree: KdTree,
    /// The values in the order of the tree's slots.
    values: Vec<PackedIrradiance>,
    lookup_radius: f32,
}

/// An irradiance value found in the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StoredIrradiance {
    /// W·m⁻².
    pub value: Rgb,
    /// The radius of the disc of the estimate in scene units. It is infinite if too little of the disc is visible;
    /// the value must then not be used.
    pub radius: f32,
    /// The point of the estimate.
    pub at: LookupPoint,
    /// Whether the whole disc is visible from its centre and the query point is not below the disc.
    pub free: bool,
}

/// A point at which irradiance is estimated.
#[derive(Clone, Copy, Debug)]
pub struct IrradiancePoint {
    /// The position and side of the surface.
    pub at: LookupPoint,
    /// The slot of the photon at this point, if it belongs to the same map.
    pub own: Option<usize>,
    /// A number that identifies the point.
    pub number: u32,
}

/// The irradiance on the side of a normal.
#[derive(Clone, Copy)]
struct PackedIrradiance {
    irradiance: PackedRgb,
    normal: u16,
    /// The radius of the disc relative to the lookup radius; negative if the disc is obstructed.
    share: half::f16,
}

/// The greatest depth of a query point below a disc relative to the distance from its centre, which allows for curved
/// surfaces.
const BELOW: f32 = 0.03;
/// The number of points in one task.
const TASK: usize = 256;

impl IrradianceMap {
    /// Estimates the irradiance from the photons of `map` at every `every`-th photon of `places`, in their order, so
    /// that the points have the photons' distribution. `boundary` corrects discs that the surface does not fill.
    ///
    /// Photons of another map are better positions than those of `map` itself: the photon nearest to a query point is
    /// likely to have few neighbours, so the density there is underestimated (by 1 % for discs of 30 photons).
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
            let at = LookupPoint { p: photon.position(), n: photon.normal() };
            IrradiancePoint { at, own: same.then_some(slot), number: slot as u32 }
        };
        let places: Vec<IrradiancePoint> = (0..places.len()).step_by(every.max(1)).map(point).collect();
        let estimate = |places: &[IrradiancePoint]| {
            let mut buffer = NeighbourBuffer::default();
            let mut estimates: Vec<Irradiance> = places
                .iter()
                .map(|point| estimator.irradiance_by(map, point.at, point.own, &mut buffer))
                .collect();
            let discs = match boundary {
                Some(boundary) => boundary.correct(map, estimator, places, &mut buffer, &mut estimates),
                None => vec![boundary::DiscVisibility::Visible; places.len()],
            };
            estimates.into_iter().zip(discs)
        };
        let values: Vec<(Irradiance, boundary::DiscVisibility)> =
            places.par_chunks(TASK).flat_map_iter(estimate).collect();
        let BuiltTree { tree, order } = KdTree::build(places.len(), |i| places[i].at.p);
        let value = |&i: &u32| {
            let (estimate, disc) = values[i as usize];
            let share = estimate.radius / estimator.lookup_radius;
            PackedIrradiance {
                irradiance: PackedRgb::new(estimate.value),
                normal: encode_octahedral(places[i as usize].at.n),
                share: half::f16::from_f32(match disc {
                    boundary::DiscVisibility::Visible => share,
                    boundary::DiscVisibility::Obstructed => -share,
                    boundary::DiscVisibility::Unknown => f32::INFINITY,
                }),
            }
        };
        let lookup_radius = estimator.lookup_radius;
        IrradianceMap { values: order.iter().map(value).collect(), tree, lookup_radius }
    }

    /// Returns the irradiance at the nearest point on the query's surface, with its disc; `None` if there is no point
    /// within the lookup radius.
    #[inline]
    pub fn nearest(&self, at: LookupPoint) -> Option<StoredIrradiance> {
        let metric = EllipsoidMetric { normal: at.n, flatness: FLATNESS };
        let belongs = |slot: usize| signed_squared_cosine(self.values[slot].normal, at.n) > COMPATIBLE;
        let bound = self.lookup_radius * self.lookup_radius;
        let nearest = self.tree.nearest_one(at.p, bound, metric, belongs)?;
        let value = &self.values[nearest.slot()];
        let (share, distance) = (value.share.to_f32(), nearest.distance_squared().sqrt());
        let radius = share.abs() * self.lookup_radius;
        let found = LookupPoint { p: self.tree.point(nearest.slot()), n: decode_octahedral(value.normal) };
        let free = share.is_sign_positive()
            && distance < radius
            && (at.p - found.p).dot(found.n) > -BELOW * distance;
        Some(StoredIrradiance { value: value.irradiance.get(), radius, at: found, free })
    }

    /// Returns the number of points.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Returns whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Returns the bytes on the heap.
    pub fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes() + size_of_val(&self.values[..])
    }
}
