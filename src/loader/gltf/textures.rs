//! Images and textures: the image, its channels, and the transformation of texture coordinates. [glTF 2.0, 3.8]

use super::Builder;
use crate::color::Rgb;
use crate::error::{Kind, Result};
use crate::image::{self, TextureImage, TextureLayers};
use crate::material::Input;
use crate::math::Affine2;
use crate::texture::{Adjusted, Bitmap, FilterType, Product, Texture, WrapMode};
use gltf::material::NormalTexture;
use gltf::texture::{Info, MagFilter, WrappingMode};
use std::path::Path;
use std::sync::Arc;

/// The part of an image that a texture uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Plane {
    /// The colours.
    Color,
    /// Three numbers that are not encoded in sRGB.
    Vector,
    /// One channel that is not encoded in sRGB: 0 is red.
    Channel(usize),
    /// The alpha; 1 if the image has none.
    Alpha,
}

/// A material's reference to a texture.
pub struct TextureUse<'a> {
    texture: gltf::Texture<'a>,
    /// The set of texture coordinates.
    pub set: u32,
    to_uv: Affine2,
}

/// The extension that transforms texture coordinates.
const TRANSFORM: &str = "KHR_texture_transform";

impl<'a> TextureUse<'a> {
    /// Creates the use of a texture from a reference.
    pub fn new(info: &Info<'a>) -> Self {
        let mut used =
            TextureUse { texture: info.texture(), set: info.tex_coord(), to_uv: Affine2::IDENTITY };
        if let Some(transform) = info.texture_transform() {
            used.set = transform.tex_coord().unwrap_or(used.set);
            used.to_uv = to_uv(transform.offset(), transform.rotation(), transform.scale());
        }
        used
    }

    /// Creates the use of a texture from a reference to a normal map.
    pub fn of_normals(normals: &NormalTexture<'a>) -> Self {
        let mut used =
            TextureUse { texture: normals.texture(), set: normals.tex_coord(), to_uv: Affine2::IDENTITY };
        if let Some(transform) = normals.extension_value(TRANSFORM) {
            let number =
                |value: &serde_json::Value, default: f32| value.as_f64().map_or(default, |v| v as f32);
            let pair = |name: &str, default: f32| [0, 1].map(|i| number(&transform[name][i], default));
            let set = transform["texCoord"].as_u64().and_then(|set| u32::try_from(set).ok());
            used.set = set.unwrap_or(used.set);
            used.to_uv = to_uv(pair("offset", 0.0), number(&transform["rotation"], 0.0), pair("scale", 1.0));
        }
        used
    }
}

/// Returns a transformation: scale, then rotation counter-clockwise with v downwards, then offset.
/// [KHR_texture_transform]
///
/// The text of the extension and renderers agree on this; its GLSL example, read by columns, rotates the other way.
fn to_uv(offset: [f32; 2], rotation: f32, scale: [f32; 2]) -> Affine2 {
    let ((sin, cos), [x, y]) = (rotation.sin_cos(), scale);
    Affine2::from_cols_array(&[cos * x, -sin * x, sin * y, cos * y, offset[0], offset[1]])
}

impl Builder<'_> {
    /// Returns a texture that reads a plane of an image.
    ///
    /// # Errors
    /// If the image cannot be read.
    pub fn bitmap(&mut self, used: &TextureUse<'_>, plane: Plane) -> Result<Arc<Texture>> {
        let key = (used.texture.index(), plane, used.to_uv.to_cols_array().map(f32::to_bits));
        if let Some(texture) = self.bitmaps.get(&key) {
            return Ok(texture.clone());
        }
        let texture = match self.plane(used.texture.source().index(), plane)? {
            Some(image) => {
                let sampler = used.texture.sampler();
                let filter = match sampler.mag_filter() {
                    Some(MagFilter::Nearest) => FilterType::Nearest,
                    _ => FilterType::Bilinear,
                };
                let wraps = [sampler.wrap_s(), sampler.wrap_t()].map(wrap_mode);
                let finite = used.to_uv.is_finite();
                let to_uv = if finite { used.to_uv } else { Affine2::IDENTITY };
                Texture::Bitmap(Bitmap::new(image, filter, wraps[0], to_uv).wrapped(wraps))
            }
            None => Texture::Constant(Rgb::WHITE),
        };
        let texture = Arc::new(texture);
        self.bitmaps.insert(key, texture.clone());
        Ok(texture)
    }

    /// Returns a plane of an image; `None` if the image has no such plane or is missing.
    fn plane(&mut self, index: usize, plane: Plane) -> Result<Option<Arc<TextureImage>>> {
        if let Some(image) = self.planes.get(&(index, plane)) {
            return Ok(image.clone());
        }
        if !self.images.contains_key(&index) {
            let layers = self.image(index)?;
            self.images.insert(index, layers);
        }
        let thing = format!("images[{index}]");
        let copied = self.images[&index].as_ref().map_or(0, |layers| layers.color.memory_bytes() as u64);
        self.file.keep(copied, &thing, "a plane of it")?;
        let image = self.images[&index].as_ref().and_then(|layers| match plane {
            Plane::Color => Some(layers.color.clone()),
            Plane::Vector => Some(layers.color.clone().as_linear()),
            Plane::Channel(c) => Some(layers.color.channel(c).as_linear()),
            Plane::Alpha => layers.alpha.clone(),
        });
        let image = image.map(Arc::new);
        self.planes.insert((index, plane), image.clone());
        Ok(image)
    }

    /// Reads an image; `None` if a file is missing, which is recorded.
    ///
    /// # Errors
    /// If the image cannot be read.
    fn image(&mut self, index: usize) -> Result<Option<TextureLayers>> {
        let Some(bytes) = self.file.image(index)? else { return Ok(None) };
        let layers = image::read_texture_bytes_within(Path::new(""), &bytes, self.file.memory());
        layers.map(Some).map_err(|mut error| {
            error.kind = Kind::Scene;
            error.about(format!("images[{index}]")).at(self.file.place())
        })
    }

    /// Returns the product of textures and a factor.
    pub fn product(&mut self, textures: Vec<Arc<Texture>>, factor: Rgb) -> Input<Rgb> {
        let product = textures.into_iter().reduce(|a, b| Arc::new(Texture::Product(Product([a, b]))));
        match product {
            None => Input::Constant(factor),
            Some(texture) if factor == Rgb::WHITE => {
                Input::Texture(self.loaded.description.add_texture(texture))
            }
            Some(texture) => {
                let scaled = Texture::Adjusted(Adjusted::scaled(texture, factor));
                Input::Texture(self.loaded.description.add_texture(Arc::new(scaled)))
            }
        }
    }

    /// Returns the product of textures and a number.
    pub fn number(&mut self, textures: Vec<Arc<Texture>>, factor: f32) -> Input<f32> {
        match self.product(textures, Rgb::splat(factor)) {
            Input::Constant(_) => Input::Constant(factor),
            Input::Texture(id) => Input::Texture(id),
        }
    }
}

fn wrap_mode(mode: WrappingMode) -> WrapMode {
    match mode {
        WrappingMode::ClampToEdge => WrapMode::Clamp,
        WrappingMode::MirroredRepeat => WrapMode::Mirror,
        WrappingMode::Repeat => WrapMode::Repeat,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec2;

    #[test]
    fn coordinates_are_scaled_then_turned_then_moved() {
        let found =
            to_uv([0.5, 0.25], std::f32::consts::FRAC_PI_2, [2.0, 3.0]).transform_point2(Vec2::new(1.0, 1.0));
        // (2, 3) rotated counter-clockwise with v downwards: u becomes -v, v becomes u.
        assert!((found - Vec2::new(3.5, -1.75)).length() < 1e-6, "{found}");
    }
}
