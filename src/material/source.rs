//! Where a plugin reads its parameters from: an object of a scene file.

use super::{Input, Material};
use crate::color::Rgb;
use crate::color::spectrum::Quantity;
use crate::error::{Error, Result};
use crate::ids::{MaterialId, TextureId};
use std::ops::RangeInclusive;

/// An object of a scene file that describes a material. Loaders implement it, so that a plugin declares its
/// parameters and their defaults in its own file.
///
/// Every method that reads returns an error where the parameter has another type or is out of range, with its
/// position in the file.
pub trait Source {
    /// Returns whether a parameter is given.
    fn has(&self, name: &'static str) -> bool;

    /// Reads a truth value.
    ///
    /// # Errors
    /// As for all that read.
    fn boolean(&mut self, name: &'static str, default: bool) -> Result<bool>;

    /// Reads a number that is the same everywhere.
    ///
    /// # Errors
    /// As for all that read.
    fn float(&mut self, name: &'static str) -> Result<Option<f64>>;

    /// Reads a text.
    ///
    /// # Errors
    /// As for all that read.
    fn text(&mut self, name: &'static str) -> Result<Option<String>>;

    /// Reads a number or a name.
    ///
    /// # Errors
    /// As for all that read.
    fn number_or_name(&mut self, name: &'static str) -> Result<Option<NumberOrName>>;

    /// Reads a colour, or the texture that it comes from; the default is grey.
    ///
    /// # Errors
    /// As for all that read.
    fn color(&mut self, name: &'static str, quantity: Quantity, default: f32) -> Result<Input<Rgb>>;

    /// Reads a number in a range, or the texture that it comes from.
    ///
    /// # Errors
    /// As for all that read.
    fn number(&mut self, name: &'static str, default: f32, range: RangeInclusive<f32>) -> Result<Input<f32>>;

    /// Returns the one texture inside the object, whatever its name.
    ///
    /// # Errors
    /// If there is none, or several.
    fn texture(&mut self) -> Result<TextureId>;

    /// Returns the materials inside the object, of which there are at least `least` and at most `most`.
    ///
    /// # Errors
    /// If there are more or fewer.
    fn inner(&mut self, least: usize, most: usize) -> Result<Vec<MaterialId>>;

    /// Returns the materials that were read before.
    fn materials(&self) -> &[Material];

    /// Accepts parameters that make no difference, with a note that says why.
    fn ignore(&mut self, names: &[&'static str], why: &str);

    /// Makes the error for a parameter with a value that was not expected.
    fn refusal(&self, name: &'static str, expected: &str) -> Error;

    /// Makes an error about a parameter.
    fn error(&self, name: &'static str, message: &str) -> Error;

    /// Makes an error about the whole object.
    fn object_error(&self, message: &str) -> Error;
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
    /// Reads a number greater than 0 that is the same everywhere.
    ///
    /// # Errors
    /// If it is not.
    pub fn positive(&mut self, name: &'static str, default: f32) -> Result<f32> {
        let value = self.float(name)?.unwrap_or(f64::from(default)) as f32;
        match value > 0.0 && value.is_finite() {
            true => Ok(value),
            false => Err(self.refusal(name, "expected a number greater than 0")),
        }
    }

    /// Reads one of several words, in any case.
    ///
    /// # Errors
    /// If it is none of them.
    pub fn choice<T: Copy>(&mut self, name: &'static str, words: &[(&str, T)], default: T) -> Result<T> {
        let Some(text) = self.text(name)? else { return Ok(default) };
        let found = words.iter().find(|(word, _)| word.eq_ignore_ascii_case(&text));
        found.map(|(_, value)| *value).ok_or_else(|| {
            let list: Vec<_> = words.iter().map(|(word, _)| *word).collect();
            self.refusal(name, &format!("expected one of {}", list.join(", ")))
        })
    }

    /// Reads a reflectance or transmittance in [0, 1].
    ///
    /// # Errors
    /// As for [`color`](Source::color).
    pub fn reflectance(&mut self, name: &'static str, default: f32) -> Result<Input<Rgb>> {
        self.color(name, Quantity::Reflectance, default)
    }

    /// Reads a number in [0, 1].
    ///
    /// # Errors
    /// As for [`number`](Source::number).
    pub fn share(&mut self, name: &'static str, default: f32) -> Result<Input<f32>> {
        self.number(name, default, 0.0..=1.0)
    }

    /// Returns the one material inside the object.
    ///
    /// # Errors
    /// As for [`inner`](Source::inner).
    pub fn only_inner(&mut self) -> Result<MaterialId> {
        Ok(self.inner(1, 1)?[0])
    }
}
