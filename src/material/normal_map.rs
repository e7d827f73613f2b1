//! `normalmap`: a material with normals from a texture.

use super::{Bending, Context, Input, Materials, Plugin, Prepared, Sampling, Scattering, Source};
use crate::color::spectrum::Quantity;
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};
use crate::math::Vec3;
use crate::texture::TexturePoint;

/// A material with normals from a texture.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct NormalMap {
    /// The local normals n as colours (n + 1) / 2.
    pub normals: TextureId,
    /// Options for the perturbed normals.
    pub bending: Bending,
    /// The material in the perturbed frame.
    pub inner: MaterialId,
}

impl Plugin for NormalMap {
    const NAME: &'static str = "normalmap";

    fn read(source: &mut dyn Source) -> Result<Self> {
        let inner = source.only_inner()?;
        // In Mitsuba 0.6, the texture has any name.
        let normals = match source.has("normalmap") {
            false => source.texture()?,
            true => match source.color("normalmap", Quantity::Unbounded, 0.5)? {
                Input::Texture(normals) => normals,
                Input::Constant(value) => source.constant_texture(value),
            },
        };
        Ok(NormalMap { normals, bending: Bending::read(source)?, inner })
    }

    fn textures(&self) -> Vec<TextureId> {
        vec![self.normals]
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
        let n = context.materials.texture(self.normals).eval(&context.at.texture);
        let n = Vec3::new(n.r, n.g, n.b) * 2.0 - Vec3::ONE;
        self.bending.tilted(context, n, self.inner)
    }
}
