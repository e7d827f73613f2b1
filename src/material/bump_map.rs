//! `bumpmap`: a material with normals perturbed by a height field.

use super::{Bending, Context, MaterialPoint, Materials, Plugin, Prepared, Sampling, Scattering, Source};
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};
use crate::math::{Vec2, Vec3};
use crate::texture::TexturePoint;

/// A material with normals perturbed by a height field.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct BumpMap {
    /// The height field.
    pub height: TextureId,
    /// Factor on the height.
    pub scale: f32,
    /// Options for the perturbed normals.
    pub bending: Bending,
    /// The material in the perturbed frame.
    pub inner: MaterialId,
}

impl Plugin for BumpMap {
    const NAME: &'static str = "bumpmap";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let inner = source.only_inner()?;
        let height = source.texture()?;
        let scale = source.float("scale")?.unwrap_or(1.0) as f32;
        if !scale.is_finite() {
            return Err(source.refusal("scale", "expected a finite number"));
        }
        Ok(BumpMap { height, scale, bending: Bending::read(source)?, inner })
    }

    fn textures(&self) -> Vec<TextureId> {
        vec![self.height]
    }

    fn inner(&self) -> &[MaterialId] {
        std::slice::from_ref(&self.inner)
    }

    fn has_tangents(&self) -> bool {
        true
    }

    fn opacity(&self, all: &Materials, point: &TexturePoint<'_>, cosine: f32) -> f32 {
        all.opacity(self.inner, point, cosine)
    }

    fn sampling(&self, _: &Prepared, all: &Materials) -> Sampling {
        self.bending.sampling(all.sampling(self.inner))
    }

    fn scattering<'a>(&'a self, _: &'a Prepared, context: &Context<'a>) -> Scattering<'a> {
        let gradient = context.materials.texture(self.height).gradient(&context.at.texture) * self.scale;
        self.bending.tilted(context, bumped_normal(&context.at, gradient), self.inner)
    }
}

/// Returns the local normal of a surface displaced by a height with the given derivatives with respect to the texture
/// coordinates. [Blinn 1978, without the derivative of the surface's own normal]
fn bumped_normal(at: &MaterialPoint<'_>, gradient: Vec2) -> Vec3 {
    let n = at.frame.n;
    let [du, dv] = [0, 1].map(|i| {
        let d = at.dp_duv[i];
        d + n * (gradient[i] - n.dot(d))
    });
    let bent = du.cross(dv);
    let bent = if bent.dot(at.ng) < 0.0 { -bent } else { bent };
    at.frame.to_local(bent)
}
