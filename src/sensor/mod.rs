//! Sensors: descriptions of cameras.

pub mod camera;

pub use camera::{Camera, Importance, SensorSurface};

use crate::film::FilmSettings;
use crate::ids::MediumId;
use crate::math::Motion;

/// The extent of the image to which the field of view refers.
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

/// The projection of points onto the image.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Projection {
    /// Lines through the sensor's origin.
    Perspective {
        /// Field of view in radians, in (0, π).
        fov: f64,
        /// The extent of the field of view.
        fov_axis: FovAxis,
        /// Offset of the principal point, relative to the image's width and height.
        principal_point_offset: [f64; 2],
    },
    /// Parallel lines; the image is two units wide in camera space.
    Orthographic,
    /// All directions from the sensor's origin. A column has one longitude and a row one angle to +y; +z is in the
    /// middle of the image.
    Spherical,
    /// The viewing axis alone: each pixel has the radiance at the sensor's origin.
    Axis,
    /// Lines along the viewing axis that start outside of the scene: each pixel has the mean radiance.
    Distant {
        /// The point through which all lines go. Without it, they are distributed over the cross section of the
        /// scene's bounding sphere.
        target: Option<[f64; 3]>,
    },
    /// The points of a shape's surface: each pixel has the mean irradiance, W·m⁻², of its part of the
    /// parametrization of the surface.
    Surface {
        /// The shape, as an index into the shapes of the scene's description.
        shape: usize,
    },
}

/// A thin lens at the sensor's origin.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ThinLens {
    /// Radius of the aperture in world-space units, positive.
    pub aperture_radius: f64,
    /// Distance of the plane of focus along the viewing axis, positive.
    pub focus_distance: f64,
}

/// A sensor of a scene description. In its own space it looks along +z, with y up and x to the left.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct SensorSettings {
    /// The sensor's name in the scene file; may be empty.
    pub name: String,
    /// The transform from camera space to world space.
    pub to_world: Motion,
    /// The projection.
    pub projection: Projection,
    /// The lens; `None` for a pinhole. Only perspective sensors may have one. Near and far clipping are for perspective
    /// and orthographic sensors.
    pub lens: Option<ThinLens>,
    /// Distance of the near clipping plane along the viewing axis, positive.
    pub near_clip: f64,
    /// Distance of the far clipping plane along the viewing axis, greater than `near_clip`.
    pub far_clip: f64,
    /// The times at which the shutter opens and closes, on the time axis of the scene's motions; equal for an
    /// instant.
    pub shutter: [f64; 2],
    /// The film.
    pub film: FilmSettings,
    /// The medium around the sensor; `None` is vacuum. It counts in the hash of a view only if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub medium: Option<MediumId>,
}

impl Default for SensorSettings {
    /// A pinhole at the origin.
    fn default() -> Self {
        SensorSettings {
            name: String::new(),
            to_world: Motion::default(),
            projection: Projection::Perspective {
                fov: std::f64::consts::FRAC_PI_4,
                fov_axis: FovAxis::X,
                principal_point_offset: [0.0; 2],
            },
            lens: None,
            near_clip: 1e-2,
            far_clip: 1e4,
            shutter: [0.0; 2],
            film: FilmSettings::default(),
            medium: None,
        }
    }
}

impl SensorSettings {
    /// Returns the name of the sensor's type in the scene language.
    pub fn kind(&self) -> &'static str {
        match (&self.projection, &self.lens) {
            (Projection::Orthographic, _) => "orthographic",
            (Projection::Spherical, _) => "spherical",
            (Projection::Axis, _) => "radiancemeter",
            (Projection::Distant { .. }, _) => "distant",
            (Projection::Surface { .. }, _) => "irradiancemeter",
            (Projection::Perspective { .. }, None) => "perspective",
            (Projection::Perspective { .. }, Some(_)) => "thinlens",
        }
    }
}
