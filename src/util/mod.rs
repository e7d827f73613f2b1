//! Utilities that are independent of rendering: atomic replacement of files.

pub mod container;
mod digest;
mod relative;
mod replace;
pub mod wording;

pub use digest::digest;
pub use relative::relative;
pub use replace::{check_replaceable, replace, replace_with};
