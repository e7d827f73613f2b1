//! Textures.

use super::colours::RAW;
use super::{Builder, unknown_plugin};
use crate::color::Rgb;
use crate::color::spectrum::Quantity;
use crate::error::{Error, Kind, Result};
use crate::ids::TextureId;
use crate::image::{self, TextureImage};
use crate::loader::mitsuba::graph::ObjectId;
use crate::loader::mitsuba::props::Props;
use crate::material::Input;
use crate::math::{Affine2, Vec2};
use crate::texture::{Bitmap, FilterType, MeshAttribute, Pattern, Product, Shapes, Texture, WrapMode};
use std::path::Path;
use std::sync::Arc;

pub const SUPPORTED: [&str; 8] =
    ["bitmap", "checkerboard", "gridtexture", "mesh_attribute", RAW, "scale", "vertexcolors", "volume"];
/// The attribute that holds the colours of the vertices of a mesh.
const VERTEX_COLORS: &str = "vertex_color";

impl Builder<'_> {
    /// Returns the texture of an object. Each is instantiated once. The stand-in is grey.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn texture(&mut self, object: ObjectId) -> Result<TextureId> {
        if let Some(id) = self.textures.get(&object) {
            return Ok(*id);
        }
        let made = self.make_texture(object);
        let texture = self.or_stand_in(made, "rendered as grey", |_| Texture::Constant(Rgb::splat(0.5)))?;
        let id = self.loaded.description.add_texture(Arc::new(texture));
        self.textures.insert(object, id);
        Ok(id)
    }

    fn make_texture(&mut self, object: ObjectId) -> Result<Texture> {
        let props = Props::new(self.graph, object);
        let texture = match props.object.plugin.as_str() {
            "bitmap" => self.bitmap(&props)?,
            "checkerboard" => self.pattern(&props, Shapes::Squares, [0.4, 0.2])?,
            "gridtexture" => {
                let half_width = props.positive("line_width", 0.01)?;
                self.pattern(&props, Shapes::Lines(half_width), [0.2, 0.4])?
            }
            "mesh_attribute" => mesh_attribute(&props)?,
            "vertexcolors" => {
                Texture::MeshAttribute(MeshAttribute { name: VERTEX_COLORS.into(), scale: 1.0 })
            }
            RAW => Texture::Constant(self.required_colour(&props, Quantity::Unbounded)?),
            "scale" => self.scaled(&props)?,
            "volume" => {
                let Some(volume) = props.child("volume")? else {
                    return Err(props.object.error("expected a volume inside it"));
                };
                let value = self.constant_volume(volume, Quantity::Unbounded)?;
                let object = &self.graph.objects[volume];
                Texture::Constant(value.ok_or_else(|| object.unsupported("expected a constvolume"))?)
            }
            _ => return Err(unknown_plugin(props.object, &SUPPORTED, &[])),
        };
        self.finish(props);
        Ok(texture)
    }

    /// Returns a pattern of two textures with the given defaults.
    fn pattern(&mut self, props: &Props, shapes: Shapes, defaults: [f32; 2]) -> Result<Texture> {
        let textures =
            [self.texture_of(props, "color0", defaults[0])?, self.texture_of(props, "color1", defaults[1])?];
        Ok(Texture::Pattern(Pattern::new(shapes, textures, to_uv(props)?)))
    }

    /// Returns the colour `value`, which must be there.
    pub fn required_colour(&mut self, props: &Props, quantity: Quantity) -> Result<Rgb> {
        match props.has("value") {
            true => self.colour(props, "value", quantity, 0.0),
            false => Err(props.object.error("the property value is missing")),
        }
    }

    /// Returns a texture of version 0.6: the product of another texture and a factor.
    fn scaled(&mut self, props: &Props) -> Result<Texture> {
        let Some(inner) = props.child("texture")? else {
            return Err(props.object.error("expected a texture inside it"));
        };
        let inner = self.texture(inner)?;
        let factor = self.colour(props, "scale", Quantity::Unbounded, 1.0)?;
        let inner = self.loaded.description.textures[inner.index()].clone();
        Ok(Texture::Product(Product([inner, Arc::new(Texture::Constant(factor))])))
    }

    /// Returns a colour or texture inside a texture, as a texture.
    fn texture_of(&mut self, props: &Props, name: &'static str, default: f32) -> Result<Texture> {
        Ok(match self.color_input(props, name, Quantity::Unbounded, default)? {
            Input::Constant(value) => Texture::Constant(value),
            Input::Texture(id) => Texture::clone(&self.loaded.description.textures[id.index()]),
        })
    }

    fn bitmap(&mut self, props: &Props) -> Result<Texture> {
        let filters = [("bilinear", FilterType::Bilinear), ("nearest", FilterType::Nearest)];
        let filter = match props.text("filter_type")? {
            Some(mipmap @ ("trilinear" | "ewa")) => {
                self.approximate(format!(
                    "bitmap: filter_type {mipmap} is rendered as bilinear: there are no mipmaps"
                ));
                FilterType::Bilinear
            }
            _ => props.choice("filter_type", &filters, FilterType::Bilinear)?,
        };
        let wraps = [("repeat", WrapMode::Repeat), ("mirror", WrapMode::Mirror), ("clamp", WrapMode::Clamp)];
        let wrap = match props.has("wrap_mode_u") {
            true => props.choice("wrap_mode_u", &wraps, WrapMode::Repeat)?,
            false => props.choice("wrap_mode", &wraps, WrapMode::Repeat)?,
        };
        if props.choice("wrap_mode_v", &wraps, wrap)? != wrap {
            self.approximate("bitmap: wrap_mode_v is rendered as wrap_mode_u");
        }
        // In Mitsuba 0.6, a gamma of 1 is that of linear values, and -1 that of the file.
        let gamma = props.float("gamma")?.unwrap_or(-1.0);
        if gamma != 1.0 && gamma != -1.0 {
            self.approximate(format!("bitmap: gamma {gamma} is rendered as the transfer curve of sRGB"));
        }
        let raw = props.boolean("raw", gamma == 1.0)?;
        let to_uv = to_uv(props)?;
        self.ignore(props, &["format"], "images keep the precision of their files");
        self.ignore(props, &["accel"], "there is one way to look textures up");
        let Some(path) = self.find_file(props, "filename")? else {
            return Ok(Texture::Constant(Rgb::BLACK));
        };
        let image = self.image(&path, raw).map_err(|e| match e.place {
            Some(_) => e,
            None => props.error("filename", &e.message),
        })?;
        Ok(Texture::Bitmap(Bitmap::new(image, filter, wrap, to_uv)))
    }

    /// Returns an image. Each image is read once.
    pub fn image(&mut self, path: &Path, raw: bool) -> Result<Arc<TextureImage>> {
        let key = (path.to_path_buf(), raw);
        if let Some(image) = self.images.get(&key) {
            return Ok(image.clone());
        }
        // An error of the image library is an error in the scene.
        let image =
            image::read_texture_within(path, self.memory).map_err(|e| Error { kind: Kind::Scene, ..e })?;
        let image = Arc::new(if raw { image.as_linear() } else { image });
        self.images.insert(key, image.clone());
        Ok(image)
    }
}

/// Returns the transformation of texture coordinates: the part of a spatial transformation in the plane, or an offset
/// and then a scale, as in files before version 2.
fn to_uv(props: &Props) -> Result<Affine2> {
    let number = |name, default| Ok(props.float(name)?.unwrap_or(default) as f32);
    let offset = Vec2::new(number("uoffset", 0.0)?, number("voffset", 0.0)?);
    let scale = Vec2::new(number("uscale", 1.0)?, number("vscale", 1.0)?);
    let m = props.transform("to_uv")?;
    let (x, y, t) = (m.matrix3.x_axis, m.matrix3.y_axis, m.translation);
    let plane = Affine2::from_cols_array(&[x.x, x.y, y.x, y.y, t.x, t.y].map(|v| v as f32));
    Ok(plane * Affine2::from_scale(scale) * Affine2::from_translation(offset))
}

fn mesh_attribute(props: &Props) -> Result<Texture> {
    let Some(name) = props.text("name")? else {
        return Err(props.object.error("the property name is missing"));
    };
    if !(name.starts_with("vertex_") || name.starts_with("face_")) {
        return Err(props.refusal("name", "expected a name that begins with vertex_ or face_"));
    }
    let scale = props.float("scale")?.unwrap_or(1.0) as f32;
    if !(scale >= 0.0 && scale.is_finite()) {
        return Err(props.refusal("scale", "expected a number of at least 0"));
    }
    Ok(Texture::MeshAttribute(MeshAttribute { name: name.to_owned(), scale }))
}
