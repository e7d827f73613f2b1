//! Daylight of a clear sky: the position of the sun, the radiance of its disc, and the radiance of the sky.

pub mod position;
pub mod sky;
pub mod sun_radiance;

pub use position::{DateAndPlace, SunPosition};
pub use sky::{Sky, SkySettings};
pub use sun_radiance::sun_radiance;

/// Half the aperture of the sun, in degrees, for which [`sun_radiance()`] is given.
pub const SUN_HALF_APERTURE: f64 = 0.5 * 0.5358;

/// The least and the greatest turbidity of the models.
pub const TURBIDITY: [f64; 2] = [1.0, 10.0];

/// Returns `1 − cos` of an angle in radians, without cancellation.
pub fn one_minus_cos(angle: f64) -> f64 {
    2.0 * (0.5 * angle).sin().powi(2)
}
