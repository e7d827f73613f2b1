//! Textures: functions of a surface point that colours and numbers of materials and emitters are read from.

pub mod attribute;

pub use attribute::Attribute;

use crate::color::Rgb;
use crate::math::Vec2;

/// A surface point as textures see it.
#[derive(Clone, Copy, Debug)]
pub struct TexturePoint<'a> {
    /// Texture coordinates.
    pub uv: Vec2,
    /// The mesh's attributes; empty where it has none.
    pub attributes: &'a [Attribute],
    /// The triangle.
    pub face: u32,
    /// The triangle's vertices.
    pub vertices: [u32; 3],
    /// Barycentric weights of the second and third vertices.
    pub barycentric: Vec2,
}

impl TexturePoint<'_> {
    /// A point that has texture coordinates only.
    pub fn at(uv: Vec2) -> Self {
        TexturePoint { uv, attributes: &[], face: 0, vertices: [0; 3], barycentric: Vec2::ZERO }
    }
}

/// A texture.
#[derive(Clone, Debug)]
pub enum Texture {
    /// The same everywhere.
    Constant(Rgb),
}

impl Texture {
    /// The colour at a point.
    pub fn eval(&self, _point: &TexturePoint<'_>) -> Rgb {
        match self {
            Texture::Constant(value) => *value,
        }
    }

    /// The number at a point: the luminance of a colour.
    pub fn eval_scalar(&self, _point: &TexturePoint<'_>) -> f32 {
        match self {
            Texture::Constant(value) => value.luminance(),
        }
    }

    /// The derivatives of [`eval_scalar`](Self::eval_scalar) by the texture coordinates.
    pub fn gradient(&self, _point: &TexturePoint<'_>) -> Vec2 {
        Vec2::ZERO
    }

    /// The mean over the unit square of texture coordinates.
    pub fn mean(&self) -> Rgb {
        match self {
            Texture::Constant(value) => *value,
        }
    }
}
