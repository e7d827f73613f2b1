//! `principled`: the Disney BSDF. [Burley 2012, 2015]

use super::source::Read;
use super::{Input, Inputs, Plugin, Prepared, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::TextureId;

/// Names of the sampling rates of Mitsuba's principled models, which are ignored.
pub(super) const SAMPLING_RATES: [&str; 5] = [
    "diffuse_reflectance_sampling_rate",
    "main_specular_sampling_rate",
    "clearcoat_sampling_rate",
    "diff_refl_sampling_rate",
    "diff_trans_sampling_rate",
];

/// Parameters of the principled model, in [0, 1] unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Principled {
    /// Base colour of the surface.
    pub base_color: Input<Rgb>,
    /// Square root of the microfacet roughness.
    pub roughness: Input<f32>,
    /// Anisotropy of the highlights.
    pub anisotropic: Input<f32>,
    /// Weight of the metallic model.
    pub metallic: Input<f32>,
    /// Fraction of the non-metallic part that transmits light.
    pub spec_trans: Input<f32>,
    /// Index of refraction of the inside over the outside, greater than 0.
    pub eta: f32,
    /// Weight of the base colour in the dielectric reflection.
    pub spec_tint: Input<f32>,
    /// Strength of an additional reflection at grazing angles, as of cloth.
    pub sheen: Input<f32>,
    /// Weight of the base colour in the sheen.
    pub sheen_tint: Input<f32>,
    /// Weight of an approximation of thin subsurface scattering in the diffuse lobe.
    pub flatness: Input<f32>,
    /// Strength of a second, clear coat.
    pub clearcoat: Input<f32>,
    /// Gloss of the clear coat.
    pub clearcoat_gloss: Input<f32>,
}

impl Plugin for Box<Principled> {
    const NAME: &'static str = "principled";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let eta = read_eta(source)?;
        let parameters = Principled {
            base_color: source.reflectance("base_color", 0.5)?,
            roughness: source.share("roughness", 0.5)?,
            anisotropic: source.share("anisotropic", 0.0)?,
            metallic: source.share("metallic", 0.0)?,
            spec_trans: source.share("spec_trans", 0.0)?,
            eta,
            spec_tint: source.share("spec_tint", 0.0)?,
            sheen: source.share("sheen", 0.0)?,
            sheen_tint: source.share("sheen_tint", 0.0)?,
            flatness: source.share("flatness", 0.0)?,
            clearcoat: source.share("clearcoat", 0.0)?,
            clearcoat_gloss: source.share("clearcoat_gloss", 0.0)?,
        };
        source.ignore(&SAMPLING_RATES, "lobes are sampled by what they reflect");
        Ok(Box::new(parameters))
    }

    fn textures(&self) -> Vec<TextureId> {
        let numbers = [
            self.roughness,
            self.anisotropic,
            self.metallic,
            self.spec_trans,
            self.spec_tint,
            self.sheen,
            self.sheen_tint,
            self.flatness,
            self.clearcoat,
            self.clearcoat_gloss,
        ];
        self.base_color.texture().into_iter().chain(numbers.iter().filter_map(Input::texture)).collect()
    }

    fn transmits(&self) -> bool {
        self.spec_trans != Input::Constant(0.0)
    }

    fn has_tangents(&self) -> bool {
        self.anisotropic != Input::Constant(0.0)
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        Bsdf::Principled(bsdf::Principled {
            base_color: inputs.color(&self.base_color),
            roughness: inputs.share(&self.roughness),
            anisotropy: inputs.share(&self.anisotropic),
            metallic: inputs.share(&self.metallic),
            spec_trans: inputs.share(&self.spec_trans),
            eta: self.eta,
            spec_tint: inputs.share(&self.spec_tint),
            sheen: inputs.share(&self.sheen),
            sheen_tint: inputs.share(&self.sheen_tint),
            flatness: inputs.share(&self.flatness),
            clearcoat: inputs.share(&self.clearcoat),
            clearcoat_gloss: inputs.share(&self.clearcoat_gloss),
        })
    }
}

/// Reads `eta`, or the index of refraction that corresponds to `specular`.
fn read_eta(source: &mut dyn Source) -> Result<f32> {
    match (source.float("eta")?, source.float("specular")?) {
        (Some(_), Some(_)) => Err(source.error("specular", "expected either eta or specular, found both")),
        (Some(_), None) => source.positive("eta", 1.5),
        (None, specular) => {
            // Reflectance at normal incidence: 0.08·specular. [Burley 2015]
            let specular = specular.unwrap_or(0.5);
            if !(0.0..=1.0).contains(&specular) {
                return Err(source.refusal("specular", "expected a number from 0 to 1"));
            }
            Ok((2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0) as f32)
        }
    }
}
