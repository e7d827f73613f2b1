//! Textures: functions on surfaces that provide colours and scalars to materials and emitters.
//!
//! They match the plugins `bitmap`, `checkerboard` and `mesh_attribute` of Mitsuba 3.9.1, and `gridtexture` of Mitsuba
//! 0.6. The textures of
//! [`adjusted`] modify them as other scene formats require.

pub mod adjusted;
pub mod attribute;
pub mod bitmap;
pub mod pattern;
mod uv_distribution;

pub use adjusted::{Adjusted, Product};
pub use attribute::{Attribute, MeshAttribute};
pub use bitmap::{Bitmap, FilterType, WrapMode};
pub use pattern::{Pattern, Shapes};

use crate::color::Rgb;
use crate::math::Vec2;

/// A surface point as input of textures.
#[derive(Clone, Copy, Debug)]
pub struct TexturePoint<'a> {
    /// Texture coordinates.
    pub uv: Vec2,
    /// The mesh's attributes; empty if it has none.
    pub attributes: &'a [Attribute],
    /// The triangle.
    pub face: u32,
    /// The triangle's vertices.
    pub vertices: [u32; 3],
    /// Barycentric weights of the second and third vertices.
    pub barycentric: Vec2,
}

impl TexturePoint<'_> {
    /// Creates a point with texture coordinates only.
    pub fn at(uv: Vec2) -> Self {
        TexturePoint { uv, attributes: &[], face: 0, vertices: [0; 3], barycentric: Vec2::ZERO }
    }
}

/// A texture.
#[derive(Clone, Debug, serde::Serialize)]
pub enum Texture {
    /// The same colour everywhere.
    Constant(Rgb),
    /// An image.
    Bitmap(Bitmap),
    /// Squares or lines of two textures.
    Pattern(Pattern),
    /// An attribute of the mesh.
    MeshAttribute(MeshAttribute),
    /// Another texture times a factor plus an offset.
    Adjusted(Adjusted),
    /// The product of two textures.
    Product(Product),
}

impl Texture {
    /// Returns the colour at a point.
    #[inline]
    pub fn eval(&self, point: &TexturePoint<'_>) -> Rgb {
        match self {
            Texture::Constant(value) => *value,
            Texture::Bitmap(bitmap) => bitmap.eval(point),
            Texture::Pattern(pattern) => pattern.eval(point),
            Texture::MeshAttribute(attribute) => attribute.eval(point),
            Texture::Adjusted(adjusted) => adjusted.eval(point),
            Texture::Product(product) => product.eval(point),
        }
    }

    /// Returns the scalar at a point: the luminance of an image's or mesh attribute's colour, but the mean of the
    /// channels of a constant.
    #[inline]
    pub fn eval_scalar(&self, point: &TexturePoint<'_>) -> f32 {
        match self {
            Texture::Constant(Rgb { r, g, b }) if r == g && g == b => *r,
            Texture::Constant(value) => value.mean(),
            Texture::Bitmap(bitmap) => bitmap.eval_scalar(point),
            Texture::Pattern(pattern) => pattern.eval_scalar(point),
            Texture::MeshAttribute(attribute) => attribute.eval_scalar(point),
            Texture::Adjusted(adjusted) => adjusted.eval_scalar(point),
            Texture::Product(product) => product.eval_scalar(point),
        }
    }

    /// Returns the derivatives of [`eval_scalar`](Self::eval_scalar) with respect to the texture coordinates; zero
    /// for mesh attributes, which do not depend on them.
    pub fn gradient(&self, point: &TexturePoint<'_>) -> Vec2 {
        match self {
            Texture::Constant(_) | Texture::MeshAttribute(_) => Vec2::ZERO,
            Texture::Bitmap(bitmap) => bitmap.gradient(point),
            Texture::Pattern(pattern) => pattern.gradient(point),
            Texture::Adjusted(adjusted) => adjusted.gradient(point),
            Texture::Product(product) => product.gradient(point),
        }
    }

    /// Returns the mean over the texture: that of an image's texels, or of both textures of a pattern. For mesh
    /// attributes, whose values are unknown here, it is half of the scale.
    pub fn mean(&self) -> Rgb {
        match self {
            Texture::Constant(value) => *value,
            Texture::Bitmap(bitmap) => bitmap.mean(),
            Texture::Pattern(pattern) => pattern.mean(),
            Texture::MeshAttribute(attribute) => Rgb::splat(0.5 * attribute.scale),
            Texture::Adjusted(adjusted) => adjusted.mean(),
            Texture::Product(product) => product.mean(),
        }
    }

    /// Returns whether the texture is constant.
    pub fn is_constant(&self) -> bool {
        matches!(self, Texture::Constant(_))
    }

    /// Returns the bytes of the texels. An image shared by several textures counts for each of them.
    pub fn memory_bytes(&self) -> usize {
        match self {
            Texture::Constant(_) | Texture::MeshAttribute(_) => 0,
            Texture::Bitmap(bitmap) => bitmap.memory_bytes(),
            Texture::Pattern(pattern) => pattern.memory_bytes(),
            Texture::Adjusted(adjusted) => adjusted.texture.memory_bytes(),
            Texture::Product(product) => product.0.iter().map(|t| t.memory_bytes()).sum(),
        }
    }

    /// Calls `found` for each mesh attribute that the texture, or one that it contains, reads.
    pub fn attributes<'a>(&'a self, found: &mut dyn FnMut(&'a MeshAttribute)) {
        match self {
            Texture::Constant(_) | Texture::Bitmap(_) => {}
            Texture::Pattern(pattern) => pattern.textures().iter().for_each(|t| t.attributes(found)),
            Texture::MeshAttribute(attribute) => found(attribute),
            Texture::Adjusted(adjusted) => adjusted.texture.attributes(found),
            Texture::Product(product) => product.0.iter().for_each(|t| t.attributes(found)),
        }
    }

    /// Returns whether the texture, or one that it contains, reads a mesh attribute.
    fn needs_mesh(&self) -> bool {
        let mut needs = false;
        self.attributes(&mut |_| needs = true);
        needs
    }

    /// Returns the width and height in texels; 1 and 1 if there are no texels.
    pub fn resolution(&self) -> [f64; 2] {
        match self {
            Texture::Bitmap(bitmap) => bitmap.size().map(|n| n as f64),
            Texture::Adjusted(adjusted) => adjusted.texture.resolution(),
            _ => [1.0; 2],
        }
    }

    /// Returns the greatest number of different cells along the sides of the unit square.
    fn detail(&self) -> Vec2 {
        match self {
            Texture::Constant(_) | Texture::MeshAttribute(_) => Vec2::ONE,
            Texture::Bitmap(bitmap) => bitmap.detail(),
            Texture::Pattern(pattern) => pattern.detail(),
            Texture::Adjusted(adjusted) => adjusted.texture.detail(),
            Texture::Product(product) => product.0[0].detail().max(product.0[1].detail()),
        }
    }
}
