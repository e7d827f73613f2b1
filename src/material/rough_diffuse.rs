//! `roughdiffuse`: diffuse reflection by a rough surface.

use super::{Input, Inputs, Plugin, Prepared, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::TextureId;
use std::f32::consts::FRAC_1_SQRT_2;

/// Diffuse reflection by a rough surface.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RoughDiffuse {
    /// Reflectance of the facets, in [0, 1].
    pub reflectance: Input<Rgb>,
    /// Roughness: the root mean square of the slope of the facets, not negative.
    pub alpha: Input<f32>,
    /// Whether the qualitative model is used.
    pub use_fast_approx: bool,
}

impl Plugin for RoughDiffuse {
    const NAME: &'static str = "roughdiffuse";

    fn read(source: &mut dyn Source) -> Result<Self> {
        Ok(RoughDiffuse {
            reflectance: source.reflectance("reflectance", 0.5)?,
            alpha: source.number("alpha", 0.2, 0.0..=f32::MAX)?,
            use_fast_approx: source.boolean("use_fast_approx", false)?,
        })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.reflectance.texture().into_iter().chain(self.alpha.texture()).collect()
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::RoughDiffuse(bsdf::RoughDiffuse {
            reflectance: inputs.color(&self.reflectance),
            sigma: inputs.number(&self.alpha).max(0.0) * FRAC_1_SQRT_2,
            qualitative: self.use_fast_approx,
        })
    }
}
