//! `diffuse`: ideal Lambertian reflection.

use super::{Input, Inputs, Plugin, Prepared, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::TextureId;

/// Ideal Lambertian reflection.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Diffuse {
    /// Reflected fraction of the light, in [0, 1].
    pub reflectance: Input<Rgb>,
}

impl Plugin for Diffuse {
    const NAME: &'static str = "diffuse";

    fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(Diffuse { reflectance: source.reflectance("reflectance", 0.5)? })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.reflectance.texture().into_iter().collect()
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::Diffuse(bsdf::Diffuse { reflectance: inputs.color(&self.reflectance) })
    }
}
