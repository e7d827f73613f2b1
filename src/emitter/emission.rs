//! What a surface emits.

use crate::color::Rgb;
use crate::texture::{Texture, TexturePoint};
use std::sync::Arc;

/// Radiance of an emitting surface, W·m⁻²·sr⁻¹, the same in every direction.
#[derive(Clone, Debug)]
pub enum Emission {
    /// The same everywhere.
    Constant(Rgb),
    /// As a texture says.
    Texture(Arc<Texture>),
}

impl Emission {
    /// The radiance, if it is the same everywhere.
    #[inline]
    pub fn constant(&self) -> Option<Rgb> {
        match self {
            Emission::Constant(radiance) => Some(*radiance),
            Emission::Texture(_) => None,
        }
    }

    /// The radiance at a point.
    pub fn eval(&self, point: &TexturePoint<'_>) -> Rgb {
        match self {
            Emission::Constant(radiance) => *radiance,
            Emission::Texture(texture) => texture.eval(point),
        }
    }

    /// About the mean radiance. Not black for whatever may shine.
    pub fn mean(&self) -> Rgb {
        match self {
            Emission::Constant(radiance) => *radiance,
            Emission::Texture(texture) => super::at_least_a_little(texture.mean()),
        }
    }
}
