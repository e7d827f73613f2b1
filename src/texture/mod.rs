//! Textures: functions of a surface point that colours and numbers of materials and emitters are read from.
//!
//! They mean what Mitsuba 3.9.1 makes of its plugins `bitmap`, `checkerboard` and `mesh_attribute`; those of
//! [`adjusted`] make of them what other scene formats ask for.

pub mod adjusted;
pub mod attribute;
pub mod bitmap;
pub mod checkerboard;
mod uv_distribution;

pub use adjusted::{Adjusted, Product};
pub use attribute::{Attribute, MeshAttribute};
pub use bitmap::{Bitmap, FilterType, WrapMode};
pub use checkerboard::Checkerboard;

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
#[derive(Clone, Debug, serde::Serialize)]
pub enum Texture {
    /// The same everywhere.
    Constant(Rgb),
    /// An image.
    Bitmap(Bitmap),
    /// Squares of two textures in turn.
    Checkerboard(Checkerboard),
    /// Values that a mesh file gives to vertices or faces.
    MeshAttribute(MeshAttribute),
    /// Another texture times a factor plus an offset.
    Adjusted(Adjusted),
    /// The product of two textures.
    Product(Product),
}

impl Texture {
    /// The colour at a point.
    #[inline]
    pub fn eval(&self, point: &TexturePoint<'_>) -> Rgb {
        match self {
            Texture::Constant(value) => *value,
            Texture::Bitmap(bitmap) => bitmap.eval(point),
            Texture::Checkerboard(board) => board.eval(point),
            Texture::MeshAttribute(attribute) => attribute.eval(point),
            Texture::Adjusted(adjusted) => adjusted.eval(point),
            Texture::Product(product) => product.eval(point),
        }
    }

    /// The number at a point: the luminance of an image's or a mesh's colour, but the mean of the channels of a
    /// constant one.
    #[inline]
    pub fn eval_scalar(&self, point: &TexturePoint<'_>) -> f32 {
        match self {
            Texture::Constant(Rgb { r, g, b }) if r == g && g == b => *r,
            Texture::Constant(value) => value.mean(),
            Texture::Bitmap(bitmap) => bitmap.eval_scalar(point),
            Texture::Checkerboard(board) => board.eval_scalar(point),
            Texture::MeshAttribute(attribute) => attribute.eval_scalar(point),
            Texture::Adjusted(adjusted) => adjusted.eval_scalar(point),
            Texture::Product(product) => product.eval_scalar(point),
        }
    }

    /// The derivatives of [`eval_scalar`](Self::eval_scalar) by the texture coordinates; zero for values of a mesh,
    /// which do not depend on them.
    pub fn gradient(&self, point: &TexturePoint<'_>) -> Vec2 {
        match self {
            Texture::Constant(_) | Texture::MeshAttribute(_) => Vec2::ZERO,
            Texture::Bitmap(bitmap) => bitmap.gradient(point),
            Texture::Checkerboard(board) => board.gradient(point),
            Texture::Adjusted(adjusted) => adjusted.gradient(point),
            Texture::Product(product) => product.gradient(point),
        }
    }

    /// The mean over the texture: of an image's texels, of both textures of a board. Half of the scale for values of a
    /// mesh, which are not known here.
    pub fn mean(&self) -> Rgb {
        match self {
            Texture::Constant(value) => *value,
            Texture::Bitmap(bitmap) => bitmap.mean(),
            Texture::Checkerboard(board) => board.mean(),
            Texture::MeshAttribute(attribute) => Rgb::splat(0.5 * attribute.scale),
            Texture::Adjusted(adjusted) => adjusted.mean(),
            Texture::Product(product) => product.mean(),
        }
    }

    /// Whether it is the same everywhere.
    pub fn is_constant(&self) -> bool {
        matches!(self, Texture::Constant(_))
    }

    /// The memory that its texels take. Textures that share an image count it each.
    pub fn memory_bytes(&self) -> usize {
        match self {
            Texture::Constant(_) | Texture::MeshAttribute(_) => 0,
            Texture::Bitmap(bitmap) => bitmap.memory_bytes(),
            Texture::Checkerboard(board) => board.memory_bytes(),
            Texture::Adjusted(adjusted) => adjusted.texture.memory_bytes(),
            Texture::Product(product) => product.0.iter().map(|t| t.memory_bytes()).sum(),
        }
    }

    /// Whether it, or a texture on it, is read from a mesh.
    fn needs_mesh(&self) -> bool {
        match self {
            Texture::Constant(_) | Texture::Bitmap(_) => false,
            Texture::Checkerboard(board) => board.needs_mesh(),
            Texture::MeshAttribute(_) => true,
            Texture::Adjusted(adjusted) => adjusted.texture.needs_mesh(),
            Texture::Product(product) => product.0.iter().any(|t| t.needs_mesh()),
        }
    }

    /// Its width and height in texels; 1 and 1 for what has none.
    pub fn resolution(&self) -> [f64; 2] {
        match self {
            Texture::Bitmap(bitmap) => bitmap.size().map(|n| n as f64),
            Texture::Adjusted(adjusted) => adjusted.texture.resolution(),
            _ => [1.0; 2],
        }
    }

    /// How many different pieces lie along the unit square's sides, at most.
    fn detail(&self) -> Vec2 {
        match self {
            Texture::Constant(_) | Texture::MeshAttribute(_) => Vec2::ONE,
            Texture::Bitmap(bitmap) => bitmap.detail(),
            Texture::Checkerboard(board) => board.detail(),
            Texture::Adjusted(adjusted) => adjusted.texture.detail(),
            Texture::Product(product) => product.0[0].detail().max(product.0[1].detail()),
        }
    }
}
