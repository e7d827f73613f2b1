//! `blendbsdf`: a weighted sum of two materials.

use super::{Context, Input, Materials, Plugin, Prepared, Sampling, Scattering, Source};
use crate::bsdf::{self, Bsdf};
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};
use crate::texture::TexturePoint;

/// A weighted sum of two materials.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Blend {
    /// The weight of the second material, in [0, 1].
    pub weight: Input<f32>,
    /// The two materials.
    pub inner: [MaterialId; 2],
}

impl Plugin for Blend {
    const NAME: &'static str = "blendbsdf";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let inner = source.inner(2, 2)?;
        if !source.has("weight") {
            return Err(source.object_error("the property weight is missing"));
        }
        Ok(Blend { weight: source.share("weight", 0.5)?, inner: [inner[0], inner[1]] })
    }

    fn textures(&self) -> Vec<TextureId> {
        self.weight.texture().into_iter().collect()
    }

    fn inner(&self) -> &[MaterialId] {
        &self.inner
    }

    fn opacity(&self, all: &Materials, point: &TexturePoint<'_>) -> f32 {
        let w = all.inputs(point).share(&self.weight);
        let [a, b] = self.inner.map(|id| all.opacity(id, point));
        (1.0 - w) * a + w * b
    }

    fn sampling(&self, _: &Prepared, all: &Materials) -> Sampling {
        let [a, b] = self.inner.map(|id| all.sampling(id).lobes);
        Sampling { lobes: a.and(b), chooses_lobe: true }
    }

    fn scattering<'a>(&'a self, _: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
        let w = context.inputs().share(&self.weight);
        let [a, b] = self.inner.map(|id| context.inner(id));
        let (share_a, share_b) = ((1.0 - w) * a.opacity, w * b.opacity);
        let opacity = share_a + share_b;
        let bsdf = if share_b == 0.0 {
            a.bsdf
        } else if share_a == 0.0 {
            b.bsdf
        } else {
            let bsdfs = [a, b].map(|s| &*context.arena.alloc(s.bsdf));
            Bsdf::Blend(bsdf::Blend { weight: share_b / opacity, bsdfs })
        };
        Scattering { bsdf, opacity }
    }
}
