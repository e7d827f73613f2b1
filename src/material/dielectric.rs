//! `dielectric`: a smooth boundary between two dielectrics.

use super::parts::read_transmittance;
use super::{Input, Inputs, Interface, Plugin, Prepared, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::TextureId;

/// A smooth boundary between two dielectrics.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Dielectric {
    /// The boundary.
    pub interface: Interface,
    /// A factor on the transmission; 1 is physical.
    pub specular_transmittance: Input<Rgb>,
}

impl Plugin for Dielectric {
    const NAME: &'static str = "dielectric";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let interface = Interface::read(source, "bk7")?;
        Ok(Dielectric { interface, specular_transmittance: read_transmittance(source)? })
    }

    fn textures(&self) -> Vec<TextureId> {
        let inputs = [self.interface.specular_reflectance, self.specular_transmittance];
        inputs.iter().filter_map(Input::texture).collect()
    }

    fn transmits(&self) -> bool {
        true
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::Dielectric(bsdf::Dielectric {
            eta: self.interface.eta(),
            specular_reflectance: inputs.color(&self.interface.specular_reflectance),
            specular_transmittance: inputs.color(&self.specular_transmittance),
        })
    }
}
