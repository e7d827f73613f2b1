//! Caustics: density estimates of the photons scattered by Dirac deltas only.

use super::lookup_point;
use crate::bsdf::Bsdf;
use crate::color::Rgb;
use crate::integrator::block::ShadingBlock;
use crate::integrator::photon::kdtree::NeighbourBuffer;
use crate::integrator::photon::{DensityEstimator, PhotonMap, Sides};
use crate::math::Vec3;
use crate::sampling::SampleKey;

/// The caustic maps of the replicates of the samples, and their density estimator.
pub struct CausticMaps {
    estimator: DensityEstimator,
    /// One map for each replicate; the number is a power of two.
    maps: Vec<Option<PhotonMap>>,
}

impl CausticMaps {
    pub(super) fn new(estimator: DensityEstimator, maps: Vec<Option<PhotonMap>>) -> Self {
        CausticMaps { estimator, maps }
    }

    /// Returns whether no photon was deposited. There is then no estimate of caustics.
    pub(super) fn is_empty(&self) -> bool {
        self.maps.iter().flatten().all(PhotonMap::is_empty)
    }

    /// Returns the radiance that the finite lobes of lane `i` scatter towards the ray's origin, W·m⁻²·sr⁻¹.
    pub(in crate::integrator) fn reflected(
        &self,
        block: &ShadingBlock<'_>,
        i: usize,
        key: SampleKey,
        buffer: &mut NeighbourBuffer,
    ) -> Rgb {
        let Some(map) = &self.maps[key.replicate as usize % self.maps.len()] else { return Rgb::BLACK };
        let (bsdf, wo, frame) = (block.bsdfs[i], block.wo.lane(i), block.at.frame.lane(i));
        let at = lookup_point(block, i);
        if let Bsdf::Diffuse(_) = bsdf {
            return self.estimator.irradiance(map, at, buffer).value * bsdf.radiance_per_irradiance(wo);
        }
        let sides = if bsdf.transmits() { Sides::Both } else { Sides::Front };
        self.estimator.reflected(map, at, sides, buffer, |wi: Vec3| bsdf.eval(wo, frame.to_local(wi)).f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::photon::Kernel;

    #[test]
    fn maps_without_photons_know_nothing() {
        let estimator = DensityEstimator { kernel: Kernel::Cone, lookup_size: 9, lookup_radius: 0.5 };
        let nothing = || PhotonMap::new(Vec::new(), 1 << 20);
        assert!(CausticMaps::new(estimator, vec![None, None]).is_empty());
        assert!(CausticMaps::new(estimator, vec![Some(nothing()), Some(nothing())]).is_empty());
    }
}
