//! `roughcoating`: a material under a rough dielectric coating.

use super::parts::{read_alpha, read_distribution};
use super::{Coating, Context, Distribution, Materials, Plugin, Prepared, Sampling, Scattering, Source};
use crate::bsdf::microfacet::Microfacets;
use crate::bsdf::{Lobes, RoughBoundary, RoughTransmittance};
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};

/// A material under a rough dielectric coating.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RoughCoating {
    /// The coating.
    pub coating: Coating,
    /// Distribution of the microfacet normals of the boundary.
    pub distribution: Distribution,
    /// Roughness of the boundary, positive.
    pub alpha: f32,
    /// See [`Roughness`](super::Roughness).
    pub sample_visible: bool,
}

impl Plugin for RoughCoating {
    const NAME: &'static str = "roughcoating";

    fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(RoughCoating {
            coating: Coating::read(source)?,
            distribution: read_distribution(source)?,
            alpha: read_alpha(source)?,
            sample_visible: source.boolean("sample_visible", true)?,
        })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.coating.textures()
    }

    fn inner(&self) -> &[MaterialId] {
        self.coating.inner()
    }

    fn prepare(&self) -> Prepared {
        let (alpha, eta) = (self.alpha, self.coating.interface.eta());
        let rough = RoughTransmittance::shared(self.distribution, alpha, eta);
        Prepared { rough: Some(rough), ..Prepared::default() }
    }

    fn sampling(&self, _: &Prepared, all: &Materials) -> Sampling {
        let lobes = all.sampling(self.coating.inner).lobes.and(Lobes::GLOSSY);
        Sampling { lobes, chooses_lobe: true }
    }

    fn scattering<'a>(&'a self, prepared: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
        let microfacets = Microfacets {
            distribution: self.distribution,
            alpha_x: self.alpha,
            alpha_y: self.alpha,
            sample_visible: self.sample_visible,
        };
        let rough = prepared.rough.as_deref();
        self.coating.coated(rough.map(|transmittance| RoughBoundary { microfacets, transmittance }), context)
    }
}
