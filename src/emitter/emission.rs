//! The radiance emitted by a surface.

use crate::color::Rgb;
use crate::texture::{Texture, TexturePoint};
use std::sync::Arc;

/// Radiance of an emitting surface, W·m⁻²·sr⁻¹, the same in every direction.
#[derive(Clone, Debug)]
pub enum Emission {
    /// The same radiance everywhere.
    Constant(Rgb),
    /// The radiance of a texture.
    Texture(Arc<Texture>),
}

impl Emission {
    /// Returns the radiance if it is constant.
    #[inline]
    pub fn constant(&self) -> Option<Rgb> {
        match self {
            Emission::Constant(radiance) => Some(*radiance),
            Emission::Texture(_) => None,
        }
    }

    /// Returns the radiance at a point.
    pub fn eval(&self, point: &TexturePoint<'_>) -> Rgb {
        match self {
            Emission::Constant(radiance) => *radiance,
            Emission::Texture(texture) => texture.eval(point),
        }
    }

    /// Returns an estimate of the mean radiance, which is not black if any point may emit.
    pub fn mean(&self) -> Rgb {
        match self {
            Emission::Constant(radiance) => *radiance,
            Emission::Texture(texture) => super::never_black(texture.mean()),
        }
    }
}
