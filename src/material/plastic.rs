//! `plastic`: a diffuse base under a smooth dielectric coat.

use super::{Coated, Input, Inputs, Interface, Plugin, Prepared, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::TextureId;

/// A diffuse base under a smooth dielectric coat.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Plastic {
    /// The coat.
    pub interface: Interface,
    /// The base.
    pub base: Coated,
}

impl Plugin for Plastic {
    const NAME: &'static str = "plastic";

    fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(Plastic { interface: Interface::read(source, "polypropylene")?, base: Coated::read(source)? })
    }

    fn textures(&self) -> Vec<TextureId> {
        let colors = [self.interface.specular_reflectance, self.base.diffuse_reflectance];
        colors.iter().filter_map(Input::texture).collect()
    }

    fn prepare(&self) -> Prepared {
        let fdr_int = bsdf::Plastic::new(Rgb::WHITE, Rgb::WHITE, self.interface.eta(), false).fdr_int;
        Prepared { fdr_int, ..Prepared::default() }
    }

    fn bsdf<'a>(&'a self, prepared: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::Plastic(bsdf::Plastic {
            diffuse_reflectance: inputs.color(&self.base.diffuse_reflectance),
            specular_reflectance: inputs.color(&self.interface.specular_reflectance),
            eta: self.interface.eta(),
            nonlinear: self.base.nonlinear,
            fdr_int: prepared.fdr_int,
        })
    }
}
