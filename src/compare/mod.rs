//! Comparison of images: differences, statistical tests of equality, and false colours.

mod block;
mod flip;
mod heat;
mod images;
mod noise;
mod rounding;
mod ztest;

pub use flip::{DynamicRange, flip, mean_flip};
pub use heat::{HeatScale, heat};
pub use images::{
    Comparison, ErrorKind, Invalid, LayerComparison, Location, NotComparable, compare, error_map, invalid,
    is_of_noise,
};
pub use noise::{GROUP_NOISE, MEAN_VARIANCE, NOISE, REPLICATES, SHARED_NOISE};
pub use ztest::{ZTest, ZTestOptions, z_test, z_test_with};
