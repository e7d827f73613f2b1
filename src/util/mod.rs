//! Utilities that are independent of rendering: atomic replacement of files.

pub mod container;
mod digest;
mod replace;
pub mod wording;

pub use digest::digest;
pub use replace::{check_replaceable, replace, replace_with};
