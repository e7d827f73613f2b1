//! Utilities that are independent of rendering.

pub mod container;
mod digest;
pub mod parameters;
mod replace;
pub mod wording;

pub use digest::digest;
pub use replace::{check_replaceable, replace, replace_with};
