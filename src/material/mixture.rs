//! `mixturebsdf`: a weighted sum of materials.

use super::blend::weighted_sum;
use super::{Context, Materials, Plugin, Prepared, Sampling, Scattering, Source};
use crate::error::Result;
use crate::ids::MaterialId;
use crate::texture::TexturePoint;

/// A weighted sum of materials. If the weights sum to less than 1, the rest of the light is absorbed.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Mixture {
    /// The weights of the materials, not negative, with a sum of at most 1.
    pub weights: Vec<f32>,
    /// The materials.
    pub inner: Vec<MaterialId>,
}

impl Plugin for Mixture {
    const NAME: &'static str = "mixturebsdf";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let Some(text) = source.text("weights")? else {
            return Err(source.object_error("the property weights is missing"));
        };
        let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
        let weight =
            |word: &str| word.parse().ok().filter(|weight: &f32| weight.is_finite() && *weight >= 0.0);
        let Some(weights) = words.map(weight).collect::<Option<Vec<f32>>>() else {
            return Err(source.refusal("weights", "expected numbers that are not negative"));
        };
        let inner = source.inner(weights.len(), weights.len())?;
        // As in Mitsuba 0.6, the sum is reduced to 1.
        let sum = weights.iter().sum::<f32>().max(1.0);
        Ok(Mixture { weights: weights.into_iter().map(|weight| weight / sum).collect(), inner })
    }

    fn inner(&self) -> &[MaterialId] {
        &self.inner
    }

    fn opacity(&self, all: &Materials, point: &TexturePoint<'_>, cosine: f32) -> f32 {
        let holes =
            self.weights.iter().zip(&self.inner).map(|(w, id)| w * (1.0 - all.opacity(*id, point, cosine)));
        1.0 - holes.sum::<f32>()
    }

    fn sampling(&self, _: &Prepared, all: &Materials) -> Sampling {
        let lobes = self.inner.iter().map(|id| all.sampling(*id).lobes);
        Sampling { lobes: lobes.reduce(|a, b| a.and(b)).unwrap_or_default(), chooses_lobe: true }
    }

    fn scattering<'a>(&'a self, _: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
        let parts = self.weights.iter().zip(&self.inner).map(|(w, id)| (*w, context.inner(*id)));
        weighted_sum(parts, context.arena)
    }
}
