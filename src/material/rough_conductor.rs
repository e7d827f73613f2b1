//! `roughconductor`: a conductor with microfacets.

use super::{Inputs, Metal, Plugin, Prepared, Roughness, Source};
use crate::bsdf::{self, Bsdf};
use crate::error::Result;
use crate::ids::TextureId;

/// A conductor with microfacets.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RoughConductor {
    /// Optical constants.
    pub metal: Metal,
    /// Microfacets.
    pub roughness: Roughness,
}

impl Plugin for RoughConductor {
    const NAME: &'static str = "roughconductor";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let roughness = Roughness::read(source)?;
        Ok(RoughConductor { metal: Metal::read(source)?, roughness })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.metal.textures().chain(self.roughness.textures()).collect()
    }

    fn has_tangents(&self) -> bool {
        self.roughness.is_anisotropic()
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::RoughConductor(bsdf::RoughConductor {
            microfacets: self.roughness.at(inputs),
            fresnel: self.metal.fresnel(inputs),
            specular_reflectance: inputs.color(&self.metal.specular_reflectance),
        })
    }
}
