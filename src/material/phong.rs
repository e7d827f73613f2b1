//! `phong`: diffuse reflection plus a Phong lobe.

use super::{DiffuseAndSpecular, Input, Inputs, Plugin, Prepared, Source};
use crate::bsdf::Bsdf;
use crate::bsdf::empirical::Phong as PhongLobe;
use crate::error::Result;
use crate::ids::TextureId;

/// Diffuse reflection plus a Phong lobe.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Phong {
    /// Reflectances.
    pub reflectances: DiffuseAndSpecular,
    /// Exponent of the lobe, not negative.
    pub exponent: Input<f32>,
}

impl Plugin for Phong {
    const NAME: &'static str = "phong";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let exponent = source.number("exponent", 30.0, 0.0..=f32::MAX)?;
        Ok(Phong { reflectances: DiffuseAndSpecular::read(source)?, exponent })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.reflectances.textures().chain(self.exponent.texture()).collect()
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        let exponent = inputs.number(&self.exponent).max(0.0);
        Bsdf::Phong(self.reflectances.with(PhongLobe { exponent }, inputs))
    }
}
