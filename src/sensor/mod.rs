//! Sensors: where camera rays come from.

pub mod perspective;

pub use perspective::Perspective;

use crate::film::FilmSettings;
use crate::math::DAffine3;

/// Which extent of the image a field of view spans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FovAxis {
    /// The width.
    X,
    /// The height.
    Y,
    /// The diagonal.
    Diagonal,
    /// The smaller of width and height.
    Smaller,
    /// The larger of width and height.
    Larger,
}

/// A sensor as a scene describes it: it looks along +z of its own coordinates, y up, x to the left.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSettings {
    /// The scene file's name for it; may be empty.
    pub name: String,
    /// Sensor to world.
    pub to_world: DAffine3,
    /// Field of view in radians, in (0, π).
    pub fov: f64,
    /// What the field of view spans.
    pub fov_axis: FovAxis,
    /// Distance of the near clipping plane along the viewing axis, positive.
    pub near_clip: f64,
    /// Distance of the far clipping plane along the viewing axis, greater than `near_clip`.
    pub far_clip: f64,
    /// Shift of the principal point as shares of the image's width and height.
    pub principal_point_offset: [f64; 2],
    /// The film behind it.
    pub film: FilmSettings,
}
