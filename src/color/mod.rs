//! Colour: linear Rec.709 RGB, and what reduces spectra and measured materials to it.

pub mod rgb;

pub use rgb::Rgb;
