//! `difftrans`: ideal diffuse transmission.

use super::{Input, Inputs, Plugin, Prepared, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::TextureId;

/// Ideal diffuse transmission.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct DiffuseTransmitter {
    /// Transmitted fraction of the light, in [0, 1].
    pub transmittance: Input<Rgb>,
}

impl Plugin for DiffuseTransmitter {
    const NAME: &'static str = "difftrans";

    fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(DiffuseTransmitter { transmittance: source.reflectance("transmittance", 0.5)? })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.transmittance.texture().into_iter().collect()
    }

    fn transmits(&self) -> bool {
        true
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::DiffuseTransmitter(bsdf::DiffuseTransmitter {
            transmittance: inputs.color(&self.transmittance),
        })
    }
}
