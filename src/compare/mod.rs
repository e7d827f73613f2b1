//! Judgements on images: differences, tests whether two images can be estimates of one picture, and false colour.

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
