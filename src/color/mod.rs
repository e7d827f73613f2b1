//! Colour: linear Rec.709 RGB, and what reduces spectra and measured materials to it.

mod cie;
pub mod conductors;
pub mod ior;
pub mod rgb;
pub mod spectrum;
pub mod srgb;

pub use rgb::Rgb;
