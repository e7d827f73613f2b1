//! Textures of MTL files: the image file, its options, and the channels that are used.

use super::Builder;
use super::mtl::Entry;
use crate::color::Rgb;
use crate::error::{Error, Kind, Result};
use crate::image::{self, TextureImage};
use crate::material::Input;
use crate::math::Affine2;
use crate::texture::{Adjusted, Bitmap, FilterType, Texture, WrapMode};
use crate::util::wording::quoted;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The channels of an image that a texture uses, and the way they are decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Plane {
    /// The colours, decoded to linear values.
    Color,
    /// The colour channels, taken as linear values.
    Vector,
    /// The alpha channel; in an image without one, the colour channels, taken as linear values.
    Opacity,
}

/// The file, the plane, whether the texture is clamped, and the bits of the transformation of texture coordinates.
pub type BitmapKey = (PathBuf, Plane, bool, [u32; 6]);

/// Properties of a texture that decide how it perturbs normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct About {
    /// Whether the image is grey.
    pub is_grey: bool,
    /// The factor on heights (`-bm`), in units of the scene.
    pub bump: Option<f32>,
}

/// A texture line of a material: the options and the name of the file.
#[derive(Debug, PartialEq)]
struct Use<'t> {
    file: &'t str,
    scale: [f32; 2],
    offset: [f32; 2],
    is_clamped: bool,
    bump: Option<f32>,
}

impl<'t> Use<'t> {
    /// Parses the options and the name of the file, which follows them and may contain blanks.
    fn parse(text: &'t str) -> Self {
        let mut used = Use { file: "", scale: [1.0; 2], offset: [0.0; 2], is_clamped: false, bump: None };
        let mut rest = text.trim();
        while rest.starts_with('-') {
            let (option, after) = word(rest);
            let most = match option {
                "-s" | "-o" | "-t" => 3,
                "-mm" => 2,
                "-bm" | "-boost" | "-texres" | "-blendu" | "-blendv" | "-cc" | "-clamp" | "-imfchan"
                | "-type" => 1,
                _ => break,
            };
            rest = after;
            let mut numbers = Vec::new();
            for i in 0..most {
                let (value, after) = word(rest);
                let number = value.parse::<f32>().ok().filter(|n| n.is_finite());
                // The second and third number are optional. The last word belongs to the name of the file.
                if after.is_empty() || (i > 0 && number.is_none()) {
                    break;
                }
                used.is_clamped |= option == "-clamp" && value == "on";
                numbers.extend(number);
                rest = after;
            }
            let set = |pair: &mut [f32; 2]| pair.iter_mut().zip(&numbers).for_each(|(to, from)| *to = *from);
            match option {
                "-s" => set(&mut used.scale),
                "-o" => set(&mut used.offset),
                "-bm" => used.bump = numbers.first().copied(),
                _ => {}
            }
        }
        Use { file: rest, ..used }
    }

    /// Returns the transformation of texture coordinates. In MTL files v points up; here it points down.
    fn to_uv(&self) -> Affine2 {
        let ([x, y], [u, v]) = (self.scale, self.offset);
        Affine2::from_cols_array(&[x, 0.0, 0.0, y, u, 1.0 - y - v])
    }
}

/// Returns the first word and the text after it.
fn word(text: &str) -> (&str, &str) {
    let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, rest.trim_start())
}

impl Builder<'_> {
    /// Returns a texture and its properties. If the file does not exist, adds a warning and returns `None`.
    ///
    /// # Errors
    /// If the file exists but cannot be read.
    pub fn bitmap(
        &mut self,
        entry: &Entry,
        text: &str,
        plane: Plane,
    ) -> Result<Option<(Arc<Texture>, About)>> {
        let used = Use::parse(text);
        let Some(path) = self.find(&entry.file, used.file) else {
            self.warn(entry, format!("there is no file {}: the texture is left out", quoted(used.file)));
            return Ok(None);
        };
        let image = self.image(&path, plane)?;
        let about = About { is_grey: image.is_grey(), bump: used.bump };
        let key = (path, plane, used.is_clamped, used.to_uv().to_cols_array().map(f32::to_bits));
        let texture = self.bitmaps.entry(key).or_insert_with(|| {
            let wrap = if used.is_clamped { WrapMode::Clamp } else { WrapMode::Repeat };
            Arc::new(Texture::Bitmap(Bitmap::new(image, FilterType::Bilinear, wrap, used.to_uv())))
        });
        Ok(Some((texture.clone(), about)))
    }

    /// Returns a plane of an image. Each plane is read once.
    fn image(&mut self, path: &Path, plane: Plane) -> Result<Arc<TextureImage>> {
        let key = (path.to_path_buf(), plane);
        if let Some(image) = self.images.get(&key) {
            return Ok(image.clone());
        }
        // An image that the library cannot read is an error of the scene.
        let fault = |error: Error| Error { kind: Kind::Scene, ..error };
        let image = match plane {
            Plane::Color => image::read_texture_within(path, self.memory).map_err(fault)?,
            Plane::Vector => image::read_texture_within(path, self.memory).map_err(fault)?.as_linear(),
            Plane::Opacity => {
                let (bytes, _reserved) = crate::loader::read_bytes(path, self.memory)?;
                let layers = image::read_texture_bytes_within(path, &bytes, self.memory).map_err(fault)?;
                layers.alpha.unwrap_or_else(|| layers.color.as_linear())
            }
        };
        let image = Arc::new(image);
        self.images.insert(key, image.clone());
        Ok(image)
    }

    /// Returns a colour times a texture, or the colour alone if there is no texture.
    ///
    /// # Errors
    /// As for [`bitmap`](Self::bitmap).
    pub fn product(
        &mut self,
        entry: &Entry,
        map: Option<&str>,
        plane: Plane,
        factor: Rgb,
    ) -> Result<Input<Rgb>> {
        let Some(map) = map else { return Ok(Input::Constant(factor)) };
        let Some((texture, _)) = self.bitmap(entry, map, plane)? else { return Ok(Input::Constant(factor)) };
        Ok(Input::Texture(match factor == Rgb::WHITE {
            true => self.loaded.description.add_texture(texture),
            false => self
                .loaded
                .description
                .add_texture(Arc::new(Texture::Adjusted(Adjusted::scaled(texture, factor)))),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec2;

    #[test]
    fn options_are_told_from_the_name() {
        let plain = Use { file: "", scale: [1.0; 2], offset: [0.0; 2], is_clamped: false, bump: None };
        assert_eq!(Use::parse("a b.png"), Use { file: "a b.png", ..plain });
        let used = Use::parse("-s 2 3 4 -o 0.5 -bm 0.2 -clamp on -imfchan r -7 of 9.png");
        assert_eq!(used.file, "-7 of 9.png");
        assert_eq!((used.scale, used.offset), ([2.0, 3.0], [0.5, 0.0]));
        assert_eq!((used.is_clamped, used.bump), (true, Some(0.2)));
        assert_eq!(Use::parse("-s 2 9.png").file, "9.png");
        // With v upwards, (0.5, 0.25) becomes (2 · 0.5, 3 · 0.25 + 0.1) = (1, 0.85).
        let used = Use { scale: [2.0, 3.0], offset: [0.0, 0.1], ..plain };
        let found = used.to_uv().transform_point2(Vec2::new(0.5, 0.75));
        assert!((found - Vec2::new(1.0, 0.15)).length() < 1e-6, "{found}");
    }
}
