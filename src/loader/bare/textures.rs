//! Textures of MTL files: which picture, with which options, and which of its channels.

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

/// What of an image is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Plane {
    /// Its colours.
    Color,
    /// Numbers, not encoded.
    Vector,
    /// Its alpha, or where it has none its values, not encoded.
    Opacity,
}

/// A file, a plane of it, whether it is clamped, and the bits of the transformation of texture coordinates.
pub type BitmapKey = (PathBuf, Plane, bool, [u32; 6]);

/// What a texture says of itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct About {
    /// Whether it is a grey image.
    pub is_grey: bool,
    /// The factor on heights (`-bm`).
    pub bump: Option<f32>,
}

/// A texture as a line of a material names it.
#[derive(Debug, PartialEq)]
struct Use<'t> {
    file: &'t str,
    scale: [f32; 2],
    offset: [f32; 2],
    is_clamped: bool,
    bump: Option<f32>,
}

impl<'t> Use<'t> {
    /// Reads options and the name of the file after them, which may have blanks.
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
                // The second and third number may be left out. A name always follows.
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

    /// The transformation of texture coordinates. In the file v points up, and here down.
    fn to_uv(&self) -> Affine2 {
        let ([x, y], [u, v]) = (self.scale, self.offset);
        Affine2::from_cols_array(&[x, 0.0, 0.0, y, u, 1.0 - y - v])
    }
}

/// The first word, and what follows it.
fn word(text: &str) -> (&str, &str) {
    let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, rest.trim_start())
}

impl Builder<'_> {
    /// A texture, and what it says of itself; `None` with a warning if the file does not exist.
    ///
    /// # Errors
    /// If it exists but cannot be read.
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

    /// A plane of an image, read once.
    fn image(&mut self, path: &Path, plane: Plane) -> Result<Arc<TextureImage>> {
        let key = (path.to_path_buf(), plane);
        if let Some(image) = self.images.get(&key) {
            return Ok(image.clone());
        }
        // What an image library finds wrong is the scene's fault here.
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

    /// A colour, times a texture if there is one.
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
        // The middle of the texture's left edge at v = 0.25 is scaled to 0.75 + 0.1 upwards.
        let used = Use { scale: [2.0, 3.0], offset: [0.0, 0.1], ..plain };
        let found = used.to_uv().transform_point2(Vec2::new(0.5, 0.75));
        assert!((found - Vec2::new(1.0, 0.15)).length() < 1e-6, "{found}");
    }
}
