//! `ward`: diffuse reflection plus the anisotropic lobe of Ward.

use super::parts::LEAST_ALPHA;
use super::source::Read;
use super::{DiffuseAndSpecular, Distribution, Input, Inputs, Plugin, Prepared, Source};
use crate::bsdf::Bsdf;
use crate::bsdf::empirical::{Ward as WardLobe, WardVariant};
use crate::bsdf::microfacet::Microfacets;
use crate::error::Result;
use crate::ids::TextureId;

/// Diffuse reflection plus the anisotropic lobe of Ward.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Ward {
    /// Reflectances.
    pub reflectances: DiffuseAndSpecular,
    /// Roughness along the surface's u and v directions, positive.
    pub alpha: [Input<f32>; 2],
    /// The variant of the model.
    pub variant: WardVariant,
}

impl Plugin for Ward {
    const NAME: &'static str = "ward";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let variants = [
            ("ward", WardVariant::Original),
            ("ward-duer", WardVariant::Duer),
            ("balanced", WardVariant::Balanced),
        ];
        let mut alpha = |name| source.number(name, 0.1, f32::MIN_POSITIVE..=f32::MAX);
        let alpha = [alpha("alpha_u")?, alpha("alpha_v")?];
        let variant = source.choice("variant", &variants, WardVariant::Balanced)?;
        Ok(Ward { reflectances: DiffuseAndSpecular::read(source)?, alpha, variant })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.reflectances.textures().chain(self.alpha.iter().filter_map(Input::texture)).collect()
    }

    fn has_tangents(&self) -> bool {
        self.alpha[0] != self.alpha[1]
    }

    fn bsdf<'a>(&'a self, _: &'a Prepared, inputs: &Inputs<'_>) -> Bsdf<'a> {
        let [alpha_x, alpha_y] = self.alpha.map(|alpha| inputs.number(&alpha).max(LEAST_ALPHA));
        let distribution = Distribution::Beckmann;
        let microfacets = Microfacets { distribution, alpha_x, alpha_y, sample_visible: false };
        Bsdf::Ward(self.reflectances.with(WardLobe { microfacets, variant: self.variant }, inputs))
    }
}
