//! Utilities that are independent of rendering: atomic replacement of files.

mod replace;

pub use replace::{check_replaceable, replace, replace_with};
