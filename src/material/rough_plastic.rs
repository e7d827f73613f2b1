//! `roughplastic`: a diffuse base under a rough dielectric coat.

use super::parts::{read_alpha, read_distribution};
use super::{Coated, Distribution, Input, Inputs, Interface, Plugin, Prepared, Source};
use crate::bsdf::microfacet::Microfacets;
use crate::bsdf::{self, Bsdf, RoughTransmittance};
use crate::error::Result;
use crate::ids::TextureId;

/// A diffuse base under a rough dielectric coat.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RoughPlastic {
    /// The coat.
    pub interface: Interface,
    /// The base.
    pub base: Coated,
    /// Distribution of the microfacet normals of the coat.
    pub distribution: Distribution,
    /// Roughness of the coat, positive.
    pub alpha: f32,
    /// See [`Roughness`](super::Roughness).
    pub sample_visible: bool,
}

impl Plugin for RoughPlastic {
    const NAME: &'static str = "roughplastic";

    fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(RoughPlastic {
            interface: Interface::read(source, "polypropylene")?,
            base: Coated::read(source)?,
            distribution: read_distribution(source)?,
            alpha: read_alpha(source)?,
            sample_visible: source.boolean("sample_visible", true)?,
        })
    }

    fn textures(&self) -> Vec<TextureId> {
        let colors = [self.interface.specular_reflectance, self.base.diffuse_reflectance];
        colors.iter().filter_map(Input::texture).collect()
    }

    fn prepare(&self) -> Prepared {
        let rough = RoughTransmittance::shared(self.distribution, self.alpha, self.interface.eta());
        Prepared { rough: Some(rough), ..Prepared::default() }
    }

    fn bsdf<'a>(&'a self, prepared: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        let Some(transmittance) = &prepared.rough else { return Bsdf::Null };
        Bsdf::RoughPlastic(bsdf::RoughPlastic {
            microfacets: Microfacets {
                distribution: self.distribution,
                alpha_x: self.alpha,
                alpha_y: self.alpha,
                sample_visible: self.sample_visible,
            },
            diffuse_reflectance: inputs.color(&self.base.diffuse_reflectance),
            specular_reflectance: inputs.color(&self.interface.specular_reflectance),
            eta: self.interface.eta(),
            nonlinear: self.base.nonlinear,
            transmittance,
        })
    }
}
