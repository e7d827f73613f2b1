//! Utilities that are independent of rendering.

pub mod container;
mod digest;
pub mod parameters;
mod relative;
mod replace;
pub mod wording;

pub use digest::digest;
pub use relative::relative;
pub use replace::{check_replaceable, is_same_file, replace, replace_with};

/// Returns the value with the given name.
pub fn named<T: Copy>(names: &[(&str, T)], name: &str) -> Option<T> {
    names.iter().find(|(known, _)| *known == name).map(|(_, value)| *value)
}
