//! `mask`: a material with an opacity.

use super::{Context, Input, Materials, Plugin, Prepared, Sampling, Scattering, Source};
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};
use crate::texture::TexturePoint;

/// A material with an opacity.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Mask {
    /// Probability that a ray hits the surface, in [0, 1].
    pub opacity: Input<f32>,
    /// The material of the surface outside its holes.
    pub inner: MaterialId,
}

impl Plugin for Mask {
    const NAME: &'static str = "mask";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let inner = source.only_inner()?;
        Ok(Mask { opacity: source.share("opacity", 0.5)?, inner })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.opacity.texture().into_iter().collect()
    }

    fn inner(&self) -> &[MaterialId] {
        std::slice::from_ref(&self.inner)
    }

    fn transmits(&self) -> bool {
        true
    }

    fn has_holes(&self) -> bool {
        self.opacity.constant().is_none_or(|opacity| opacity < 1.0)
    }

    fn opacity(&self, all: &Materials, point: &TexturePoint<'_>, cosine: f32) -> f32 {
        all.inputs(point).share(&self.opacity) * all.opacity(self.inner, point, cosine)
    }

    fn sampling(&self, _: &Prepared, all: &Materials) -> Sampling {
        Sampling { chooses_lobe: true, ..all.sampling(self.inner) }
    }

    fn scattering<'a>(&'a self, _: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
        let inner = context.inner(self.inner);
        Scattering { opacity: inner.opacity * context.inputs().share(&self.opacity), ..inner }
    }
}
