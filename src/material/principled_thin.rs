//! `principledthin`: the principled model for thin surfaces. [Burley 2015]

use super::principled::SAMPLING_RATES;
use super::{Input, Inputs, Plugin, Prepared, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::TextureId;

/// Parameters of the principled model for thin surfaces, in [0, 1] unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PrincipledThin {
    /// Base colour of the surface.
    pub base_color: Input<Rgb>,
    /// Square root of the microfacet roughness.
    pub roughness: Input<f32>,
    /// Anisotropy of the highlights.
    pub anisotropic: Input<f32>,
    /// Weight of the specular transmission.
    pub spec_trans: Input<f32>,
    /// Index of refraction, greater than 0.
    pub eta: Input<f32>,
    /// Weight of the base colour in the dielectric reflection.
    pub spec_tint: Input<f32>,
    /// Strength of an additional reflection at grazing angles.
    pub sheen: Input<f32>,
    /// Weight of the base colour in the sheen.
    pub sheen_tint: Input<f32>,
    /// Weight of an approximation of thin subsurface scattering in the diffuse lobe.
    pub flatness: Input<f32>,
    /// Transmitted part of the diffuse light: 0 none, 1 half, 2 all.
    pub diff_trans: Input<f32>,
}

impl Plugin for Box<PrincipledThin> {
    const NAME: &'static str = "principledthin";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let parameters = PrincipledThin {
            base_color: source.reflectance("base_color", 0.5)?,
            roughness: source.share("roughness", 0.5)?,
            anisotropic: source.share("anisotropic", 0.0)?,
            spec_trans: source.share("spec_trans", 0.0)?,
            eta: source.number("eta", 1.5, f32::MIN_POSITIVE..=f32::MAX)?,
            spec_tint: source.share("spec_tint", 0.0)?,
            sheen: source.share("sheen", 0.0)?,
            sheen_tint: source.share("sheen_tint", 0.0)?,
            flatness: source.share("flatness", 0.0)?,
            diff_trans: source.number("diff_trans", 0.0, 0.0..=2.0)?,
        };
        source.ignore(&SAMPLING_RATES, "lobes are sampled by what they reflect");
        source.ignore(&["spec_reflect_sampling_rate", "spec_trans_sampling_rate"], "see there");
        Ok(Box::new(parameters))
    }

    fn textures(&self) -> Vec<TextureId> {
        let numbers = [
            self.roughness,
            self.anisotropic,
            self.spec_trans,
            self.eta,
            self.spec_tint,
            self.sheen,
            self.sheen_tint,
            self.flatness,
            self.diff_trans,
        ];
        self.base_color.texture().into_iter().chain(numbers.iter().filter_map(Input::texture)).collect()
    }

    fn transmits(&self) -> bool {
        true
    }

    fn has_tangents(&self) -> bool {
        self.anisotropic != Input::Constant(0.0)
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::PrincipledThin(bsdf::PrincipledThin {
            base_color: inputs.color(&self.base_color),
            roughness: inputs.share(&self.roughness),
            anisotropy: inputs.share(&self.anisotropic),
            spec_trans: inputs.share(&self.spec_trans),
            eta: inputs.number(&self.eta),
            spec_tint: inputs.share(&self.spec_tint),
            sheen: inputs.share(&self.sheen),
            sheen_tint: inputs.share(&self.sheen_tint),
            flatness: inputs.share(&self.flatness),
            diff_trans: inputs.number(&self.diff_trans).clamp(0.0, 2.0),
        })
    }
}
