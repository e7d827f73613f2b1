//! Irradiance that is computed beforehand at some of the photons, so that final gathering looks up one of them
//! instead of estimating a density at every ray's end. [Christensen 1999]

use super::PhotonMap;
use super::boundary::Boundary;
use super::density::{COMPATIBLE, DensityEstimator, FLATNESS, Irradiance, Place};
use super::kdtree::{Built, Disc, KdTree, Nearest};
use super::photon::PackedRgb;
use crate::color::Rgb;
use crate::math::octahedral::{encode_octahedral, signed_squared_cosine};
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
    /// The radius of the disc that it was estimated over, scene units.
    pub radius: f32,
}

/// Irradiance on the side of a normal.
#[derive(Clone, Copy)]
struct Value {
    irradiance: PackedRgb,
    normal: u16,
    /// The radius of the disc, over the lookup radius.
    share: half::f16,
}

/// Points that one task computes irradiance at.
const TASK: usize = 256;

impl IrradianceMap {
    /// Irradiance at every `every`-th photon of the map, in the map's order, so that these are spread as the photons
    /// are. What the surface lacks of a disc is taken into account by `boundary`.
    pub fn new(
        map: &PhotonMap,
        estimator: &DensityEstimator,
        every: usize,
        boundary: Option<&Boundary<'_>>,
    ) -> Self {
        let places: Vec<Place> = (0..map.len())
            .step_by(every.max(1))
            .map(|slot| map.photon(slot))
            .map(|photon| Place { p: photon.position(), n: photon.normal() })
            .collect();
        let estimate = |places: &[Place]| {
            let mut buffer = Nearest::default();
            let mut estimates: Vec<Irradiance> =
                places.iter().map(|&at| estimator.irradiance(map, at, &mut buffer)).collect();
            if let Some(boundary) = boundary {
                boundary.correct(places, estimator.kernel, &mut estimates);
            }
            estimates
        };
        let values: Vec<Irradiance> = places.par_chunks(TASK).flat_map_iter(estimate).collect();
        let Built { tree, order } = KdTree::build(places.len(), |i| places[i].p);
        let value = |&i: &u32| {
            let i = i as usize;
            Value {
                irradiance: PackedRgb::new(values[i].value),
                normal: encode_octahedral(places[i].n),
                share: half::f16::from_f32(values[i].radius / estimator.lookup_radius),
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
        Some(Known { value: value.irradiance.get(), radius: value.share.to_f32() * self.lookup_radius })
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
