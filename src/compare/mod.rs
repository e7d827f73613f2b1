//! Comparison of images: differences, statistical tests of equality, and false colours.

mod heat;
mod images;
mod rounding;
pub mod ztest;

pub use heat::{HeatScale, heat};
pub use images::{
    Comparison, ErrorKind, Invalid, LayerComparison, Location, NotComparable, compare, error_map, invalid,
    is_of_noise,
};
pub use ztest::{ZTest, ZTestOptions, z_test, z_test_with};
