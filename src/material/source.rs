//! The interface through which a plugin reads its parameters from an object of a scene file.

use super::{Input, Material};
use crate::bsdf::Measured;
use crate::color::Rgb;
use crate::color::spectrum::Quantity;
use crate::error::Result;
use crate::ids::{MaterialId, TextureId};
pub use crate::util::parameters::{Parameters, Read};
use std::ops::RangeInclusive;
use std::sync::Arc;

/// An object of a scene file that describes a material.
pub trait Source: Parameters {
    /// Reads a number or a name.
    ///
    /// # Errors
    /// If the parameter cannot be read.
    fn number_or_name(&mut self, name: &'static str) -> Result<Option<NumberOrName>>;

    /// Reads a colour or a texture. The default is grey.
    ///
    /// # Errors
    /// If the parameter cannot be read.
    fn color(&mut self, name: &'static str, quantity: Quantity, default: f32) -> Result<Input<Rgb>>;

    /// Reads a number in a range, or a texture.
    ///
    /// # Errors
    /// If the parameter cannot be read.
    fn number(&mut self, name: &'static str, default: f32, range: RangeInclusive<f32>) -> Result<Input<f32>>;

    /// Reads the file of a measured material.
    ///
    /// # Errors
    /// If the parameter is missing, or the file cannot be read.
    fn measurement(&mut self, name: &'static str) -> Result<Arc<Measured>>;

    /// Returns the only texture inside the object, with any name.
    ///
    /// # Errors
    /// If there is none, or more than one.
    fn texture(&mut self) -> Result<TextureId>;

    /// Returns the materials inside the object, at least `least` and at most `most`.
    ///
    /// # Errors
    /// If there are more or fewer.
    fn inner(&mut self, least: usize, most: usize) -> Result<Vec<MaterialId>>;

    /// Returns the mean of a texture that has been read before, as a number.
    fn texture_mean(&self, texture: TextureId) -> f32;

    /// Adds a texture with the same value everywhere.
    fn constant_texture(&mut self, value: Rgb) -> TextureId;

    /// Tells the user what is not rendered as the file asks for.
    fn approximate(&mut self, text: &str);

    /// Returns the materials that have been read before.
    fn materials(&self) -> &[Material];
}

/// The value of a parameter that may be a number or a name.
#[derive(Clone, Debug, PartialEq)]
pub enum NumberOrName {
    /// A number.
    Number,
    /// A name.
    Name(String),
}

impl dyn Source + '_ {
    /// Reads a reflectance or transmittance in [0, 1].
    ///
    /// # Errors
    /// The errors of [`color`](Source::color).
    pub fn reflectance(&mut self, name: &'static str, default: f32) -> Result<Input<Rgb>> {
        self.color(name, Quantity::Reflectance, default)
    }

    /// Reads a number in [0, 1].
    ///
    /// # Errors
    /// The errors of [`number`](Source::number).
    pub fn share(&mut self, name: &'static str, default: f32) -> Result<Input<f32>> {
        self.number(name, default, 0.0..=1.0)
    }

    /// Returns the only material inside the object.
    ///
    /// # Errors
    /// The errors of [`inner`](Source::inner).
    pub fn only_inner(&mut self) -> Result<MaterialId> {
        Ok(self.inner(1, 1)?[0])
    }
}
