//! `conductor`: a smooth conductor.

use super::{Inputs, Metal, Plugin, Prepared, Source};
use crate::bsdf::{self, Bsdf};
use crate::error::Result;
use crate::ids::TextureId;

/// A smooth conductor.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Conductor {
    /// Optical constants.
    pub metal: Metal,
}

impl Plugin for Conductor {
    const NAME: &'static str = "conductor";

    fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(Conductor { metal: Metal::read(source)? })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.metal.textures().collect()
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::Conductor(bsdf::Conductor {
            fresnel: self.metal.fresnel(inputs),
            specular_reflectance: inputs.color(&self.metal.specular_reflectance),
        })
    }
}
