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
}

/// Irradiance on the side of a normal.
#[derive(Clone, Copy)]
struct Value {
    irradiance: PackedRgb,
    normal: u16,
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
            estimates.into_iter().map(|estimate| PackedRgb::new(estimate.value)).collect::<Vec<_>>()
        };
        let values: Vec<PackedRgb> = places.par_chunks(TASK).flat_map_iter(estimate).collect();
        let Built { tree, order } = KdTree::build(places.len(), |i| places[i].p);
        let value = |&i: &u32| {
            let i = i as usize;
            Value { irradiance: values[i], normal: encode_octahedral(places[i].n) }
        };
        IrradianceMap { values: order.iter().map(value).collect(), tree }
    }

    /// Irradiance at the nearest point of the place's surface, W·m⁻²; `None` where there is none within `radius`.
    #[inline]
    pub fn irradiance(&self, at: Place, radius: f32) -> Option<Rgb> {
        let metric = Disc { normal: at.n, flatness: FLATNESS };
        let belongs = |slot: usize| signed_squared_cosine(self.values[slot].normal, at.n) > COMPATIBLE;
        let nearest = self.tree.nearest_one(at.p, radius * radius, metric, belongs)?;
        Some(self.values[nearest.slot()].irradiance.get())
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
