//! Sensors: where camera rays come from.

pub mod camera;

pub use camera::{Camera, Importance};

use crate::film::FilmSettings;
use crate::math::Motion;

/// Which extent of the image a field of view spans.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
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

/// How points in front of a sensor are mapped to its image.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Projection {
    /// Lines through the sensor's origin.
    Perspective {
        /// Field of view in radians, in (0, π).
        fov: f64,
        /// What the field of view spans.
        fov_axis: FovAxis,
        /// Shift of the principal point as shares of the image's width and height.
        principal_point_offset: [f64; 2],
    },
    /// Parallel lines; the image is two units of the sensor's coordinates wide.
    Orthographic,
}

/// A lens without thickness, at the sensor's origin.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ThinLens {
    /// Radius of the aperture, positive, in units of the world.
    pub aperture_radius: f64,
    /// Distance along the viewing axis of the plane that is in focus, positive.
    pub focus_distance: f64,
}

/// A sensor as a scene describes it: it looks along +z of its own coordinates, y up, x to the left.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct SensorSettings {
    /// The scene file's name for it; may be empty.
    pub name: String,
    /// Sensor to world.
    pub to_world: Motion,
    /// How it sees.
    pub projection: Projection,
    /// Its lens, where it is no pinhole. Perspective sensors only.
    pub lens: Option<ThinLens>,
    /// Distance of the near clipping plane along the viewing axis, positive.
    pub near_clip: f64,
    /// Distance of the far clipping plane along the viewing axis, greater than `near_clip`.
    pub far_clip: f64,
    /// When the shutter opens and closes, on the clock of the scene's motions; equal for a moment.
    pub shutter: [f64; 2],
    /// The film behind it.
    pub film: FilmSettings,
}

impl SensorSettings {
    /// The name of its kind in the scene language.
    pub fn kind(&self) -> &'static str {
        match (&self.projection, &self.lens) {
            (Projection::Orthographic, _) => "orthographic",
            (Projection::Perspective { .. }, None) => "perspective",
            (Projection::Perspective { .. }, Some(_)) => "thinlens",
        }
    }
}
