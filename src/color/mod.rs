//! Colour: linear Rec.709 RGB, and the conversion of spectra and measured materials.

mod cie;
pub mod conductors;
pub mod ior;
pub mod rgb;
pub mod spectrum;
pub mod srgb;

pub use rgb::Rgb;
