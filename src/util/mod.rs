//! What every room may use and what knows nothing of rendering: files that are replaced whole or not at all.

mod replace;

pub use replace::{check_replaceable, replace, replace_with};
