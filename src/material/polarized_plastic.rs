//! `pplastic`: diffuse reflection below a boundary that also reflects.

use super::{Input, Inputs, Interface, Plugin, Prepared, Roughness, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::TextureId;

/// Diffuse reflection below a boundary that also reflects, for unpolarised light.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct PolarizedPlastic {
    /// The boundary.
    pub interface: Interface,
    /// Microfacets of the boundary.
    pub roughness: Roughness,
    /// Fraction of the light inside that is reflected.
    pub diffuse_reflectance: Input<Rgb>,
}

impl Plugin for PolarizedPlastic {
    const NAME: &'static str = "pplastic";

    fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(PolarizedPlastic {
            interface: Interface::read(source, "polypropylene")?,
            roughness: Roughness::read(source)?,
            diffuse_reflectance: source.reflectance("diffuse_reflectance", 0.5)?,
        })
    }

    fn textures(&self) -> Vec<TextureId> {
        let colors = [self.interface.specular_reflectance, self.diffuse_reflectance];
        colors.iter().filter_map(Input::texture).chain(self.roughness.textures()).collect()
    }

    fn has_tangents(&self) -> bool {
        self.roughness.is_anisotropic()
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::PolarizedPlastic(bsdf::PolarizedPlastic {
            microfacets: self.roughness.at(inputs),
            diffuse_reflectance: inputs.color(&self.diffuse_reflectance),
            specular_reflectance: inputs.color(&self.interface.specular_reflectance),
            eta: self.interface.eta(),
        })
    }
}
