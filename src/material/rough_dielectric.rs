//! `roughdielectric`: a boundary with microfacets between two dielectrics.

use super::parts::read_transmittance;
use super::{Input, Inputs, Interface, Plugin, Prepared, Roughness, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::TextureId;

/// A boundary with microfacets between two dielectrics.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RoughDielectric {
    /// The boundary.
    pub interface: Interface,
    /// A factor on the transmission; 1 is physical.
    pub specular_transmittance: Input<Rgb>,
    /// The microfacets.
    pub roughness: Roughness,
}

impl Plugin for RoughDielectric {
    const NAME: &'static str = "roughdielectric";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let interface = Interface::read(source, "bk7")?;
        let specular_transmittance = read_transmittance(source)?;
        Ok(RoughDielectric { interface, specular_transmittance, roughness: Roughness::read(source)? })
    }

    fn textures(&self) -> Vec<TextureId> {
        let colors = [self.interface.specular_reflectance, self.specular_transmittance];
        colors.iter().filter_map(Input::texture).chain(self.roughness.textures()).collect()
    }

    fn transmits(&self) -> bool {
        true
    }

    fn has_tangents(&self) -> bool {
        self.roughness.is_anisotropic()
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::RoughDielectric(bsdf::RoughDielectric {
            microfacets: self.roughness.at(inputs),
            eta: self.interface.eta(),
            specular_reflectance: inputs.color(&self.interface.specular_reflectance),
            specular_transmittance: inputs.color(&self.specular_transmittance),
        })
    }
}
