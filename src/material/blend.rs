//! `blendbsdf`: a weighted sum of two materials.

use super::{Context, Input, Materials, Plugin, Prepared, Sampling, Scattering, Source};
use crate::bsdf::{self, Bsdf};
use crate::color::Rgb;
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};
use crate::texture::TexturePoint;
use bumpalo::Bump;

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

    fn opacity(&self, all: &Materials, point: &TexturePoint<'_>, cosine: f32) -> f32 {
        let w = all.inputs(point).share(&self.weight);
        let [a, b] = self.inner.map(|id| all.opacity(id, point, cosine));
        (1.0 - w) * a + w * b
    }

    fn sampling(&self, _: &Prepared, all: &Materials) -> Sampling {
        let [a, b] = self.inner.map(|id| all.sampling(id).lobes);
        Sampling { lobes: a.and(b), chooses_lobe: true }
    }

    fn scattering<'a>(&'a self, _: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
        let w = context.inputs().share(&self.weight);
        let [a, b] = self.inner.map(|id| context.inner(id));
        weighted_sum([(1.0 - w, a), (w, b)], context.arena)
    }
}

/// A BSDF that scatters nothing.
static BLACK: Bsdf<'static> = Bsdf::Diffuse(bsdf::Diffuse { reflectance: Rgb::BLACK });

/// Returns the sum of weighted materials. What the weights lack to 1 is black and opaque.
pub(super) fn weighted_sum<'a>(
    parts: impl IntoIterator<Item = (f32, Scattering<'a>)>,
    arena: &'a Bump,
) -> Scattering<'a> {
    let (mut sum, mut opacity, mut weights) = (None, 0.0, 0.0);
    let mut add = |opaque: f32, bsdf: Bsdf<'a>| {
        if opaque > 0.0 {
            opacity += opaque;
            sum = Some(match sum {
                None => bsdf,
                Some(before) => {
                    let bsdfs = [before, bsdf].map(|bsdf| &*arena.alloc(bsdf));
                    Bsdf::Blend(bsdf::Blend { weight: opaque / opacity, bsdfs })
                }
            });
        }
    };
    for (weight, part) in parts {
        weights += weight;
        add(weight * part.opacity, part.bsdf);
    }
    if weights < 1.0 - 1e-6 {
        add(1.0 - weights, BLACK);
    }
    Scattering { bsdf: sum.unwrap_or(BLACK), opacity }
}
