//! The parameters of an object of a scene file, independent of the file's format.

use crate::error::{Error, Result};
use std::ops::RangeInclusive;

/// An object of a scene file. Loaders implement it, so that a plugin declares its parameters and their defaults in
/// its own file.
///
/// Every method that reads returns an error where the parameter has another type or is out of range, with its
/// position in the file.
pub trait Parameters {
    /// Returns whether a parameter is given.
    fn has(&self, name: &'static str) -> bool;

    /// Reads a truth value.
    ///
    /// # Errors
    /// As for all that read.
    fn boolean(&mut self, name: &'static str, default: bool) -> Result<bool>;

    /// Reads a whole number in a range.
    ///
    /// # Errors
    /// As for all that read.
    fn integer(&mut self, name: &'static str, range: RangeInclusive<i64>) -> Result<Option<i64>>;

    /// Reads a number.
    ///
    /// # Errors
    /// As for all that read.
    fn float(&mut self, name: &'static str) -> Result<Option<f64>>;

    /// Reads a text.
    ///
    /// # Errors
    /// As for all that read.
    fn text(&mut self, name: &'static str) -> Result<Option<String>>;

    /// Accepts parameters that make no difference, with a note that says why.
    fn ignore(&mut self, names: &[&'static str], why: &str);

    /// Makes the error for a parameter with a value that was not expected.
    fn refusal(&self, name: &'static str, expected: &str) -> Error;

    /// Makes an error about a parameter.
    fn error(&self, name: &'static str, message: &str) -> Error;

    /// Makes an error about the whole object.
    fn object_error(&self, message: &str) -> Error;
}

/// What can be read from all [`Parameters`].
pub trait Read: Parameters {
    /// Reads a finite number greater than 0. The default is returned as it is: it may be infinite.
    ///
    /// # Errors
    /// As for all that read.
    fn positive(&mut self, name: &'static str, default: f32) -> Result<f32> {
        let Some(value) = self.float(name)? else { return Ok(default) };
        let value = value as f32;
        match value > 0.0 && value.is_finite() {
            true => Ok(value),
            false => Err(self.refusal(name, "expected a number greater than 0")),
        }
    }

    /// Reads a whole number in a range.
    ///
    /// # Errors
    /// As for all that read.
    fn count(&mut self, name: &'static str, range: RangeInclusive<u32>, default: u32) -> Result<u32> {
        let value = self.integer(name, i64::from(*range.start())..=i64::from(*range.end()))?;
        Ok(value.map_or(default, |n| n as u32))
    }

    /// Reads one of several words, in any case.
    ///
    /// # Errors
    /// As for all that read.
    fn choice<T: Copy>(&mut self, name: &'static str, words: &[(&str, T)], default: T) -> Result<T> {
        let Some(text) = self.text(name)? else { return Ok(default) };
        let found = words.iter().find(|(word, _)| word.eq_ignore_ascii_case(&text));
        found.map(|(_, value)| *value).ok_or_else(|| {
            let list: Vec<_> = words.iter().map(|(word, _)| *word).collect();
            self.refusal(name, &format!("expected one of {}", list.join(", ")))
        })
    }
}

impl<P: Parameters + ?Sized> Read for P {}
