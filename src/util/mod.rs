//! Utilities that are independent of rendering.

pub mod container;
mod digest;
pub mod parameters;
mod relative;
mod replace;
pub mod wording;

pub use digest::digest;
pub use relative::relative;
pub use replace::{check_replaceable, replace, replace_with};
