//! The pinhole camera.

use super::{FovAxis, SensorSettings};
use crate::error::{Error, Result};
use crate::film::FilmSettings;
use crate::math::{DAffine3, DMat3, DVec3, Ray, Vec2, Vec3};

/// A pinhole camera ready to make rays.
#[derive(Clone, Debug)]
pub struct Perspective {
    /// The film behind it.
    pub film: FilmSettings,
    /// Sensor to world.
    pub to_world: DAffine3,
    origin: Vec3,
    /// World direction (with z = 1 in the sensor's coordinates) of the film's top left corner.
    corner: DVec3,
    /// Change of that direction per pixel to the right and downwards.
    dx: DVec3,
    dy: DVec3,
    near: f32,
    far: f32,
}

impl Perspective {
    /// A camera with the settings' field of view.
    ///
    /// # Errors
    /// If the transform is singular or not finite.
    pub fn new(settings: &SensorSettings) -> Result<Self> {
        let m = settings.to_world.matrix3;
        if !settings.to_world.is_finite() || m.determinant() == 0.0 {
            return Err(Error::scene("expected an invertible, finite to_world transform of the sensor"));
        }
        // A scale would change nothing but the clipping distances, which are world lengths.
        let m = DMat3::from_cols(m.x_axis.normalize(), m.y_axis.normalize(), m.z_axis.normalize());
        let film = settings.film;
        let (width, height) = (f64::from(film.width), f64::from(film.height));
        let half = half_extents(settings, width, height);
        let [ox, oy] = settings.principal_point_offset;
        // x points to the left, y upwards.
        let corner = DVec3::new(half[0] * (1.0 - 2.0 * ox), half[1] * (1.0 - 2.0 * oy), 1.0);
        Ok(Perspective {
            film,
            to_world: settings.to_world,
            origin: settings.to_world.translation.as_vec3(),
            corner: m * corner,
            dx: m * DVec3::new(-2.0 * half[0] / width, 0.0, 0.0),
            dy: m * DVec3::new(0.0, -2.0 * half[1] / height, 0.0),
            near: settings.near_clip as f32,
            far: settings.far_clip as f32,
        })
    }

    /// The ray through the film position `p` in pixels from the top left corner of the full image. It starts
    /// on the near clipping plane and ends on the far one.
    #[inline]
    pub fn ray(&self, p: Vec2) -> Ray {
        let direction = self.corner + self.dx * f64::from(p.x) + self.dy * f64::from(p.y);
        let length = direction.length() as f32;
        let d = (direction / f64::from(length)).as_vec3();
        // `length` is the reciprocal of the cosine to the viewing axis.
        Ray {
            o: self.origin + d * (self.near * length),
            t_max: (self.far - self.near) * length,
            d,
            time: 0.0,
        }
    }

    /// In the sensor's coordinates, the vectors across the image plane (its full width and height) and the one
    /// to its top left corner, at distance 1 along the viewing axis.
    pub fn image_plane(&self) -> [DVec3; 3] {
        let inverse = self.to_world.matrix3.inverse();
        let (width, height) = (f64::from(self.film.width), f64::from(self.film.height));
        [inverse * self.dx * width, inverse * self.dy * height, inverse * self.corner]
    }

    /// World to sensor, for the image's metadata.
    pub fn world_to_camera(&self) -> DAffine3 {
        self.to_world.inverse()
    }
}

/// Half the width and height of the image plane at distance 1.
fn half_extents(settings: &SensorSettings, width: f64, height: f64) -> [f64; 2] {
    let tan = (0.5 * settings.fov).tan();
    let along_x = match settings.fov_axis {
        FovAxis::X => true,
        FovAxis::Y => false,
        FovAxis::Smaller => width <= height,
        FovAxis::Larger => width > height,
        FovAxis::Diagonal => {
            let diagonal = width.hypot(height);
            return [tan * width / diagonal, tan * height / diagonal];
        }
    };
    if along_x { [tan, tan * height / width] } else { [tan * width / height, tan] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Origins, directions and lengths that Mitsuba 3.9.1 computes for the same camera.
    #[test]
    fn rays_agree_with_the_scene_languages_camera() {
        let (eye, target) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.0, 0.5, 0.0));
        let z = (target - eye).normalize();
        let x = DVec3::Y.cross(z).normalize();
        let to_world = DAffine3::from_mat3_translation(DMat3::from_cols(x, z.cross(x), z), eye);
        for (fov_axis, o, d, t_max) in [
            (FovAxis::X, [0.804938, 1.78845, 2.58746], [-0.387812, -0.420583, -0.82019], 9.556638),
            (FovAxis::Y, [0.778835, 1.78982, 2.59548], [-0.436495, -0.414806, -0.798378], 9.626969),
            (FovAxis::Diagonal, [0.813706, 1.78799, 2.58477], [-0.371056, -0.422267, -0.827048], 9.539247),
            (FovAxis::Smaller, [0.778835, 1.78982, 2.59548], [-0.436495, -0.414806, -0.798378], 9.626969),
            (FovAxis::Larger, [0.804938, 1.78845, 2.58746], [-0.387812, -0.420583, -0.82019], 9.556638),
        ] {
            let camera = Perspective::new(&SensorSettings {
                name: String::new(),
                to_world,
                fov: 40f64.to_radians(),
                fov_axis,
                near_clip: 0.5,
                far_clip: 10.0,
                principal_point_offset: [0.1, -0.2],
                film: FilmSettings { width: 60, height: 40, ..FilmSettings::default() },
            })
            .unwrap();
            let ray = camera.ray(Vec2::new(15.0, 27.5));
            assert!((ray.o - Vec3::from(o)).length() < 2e-5, "{fov_axis:?} {ray:?}");
            assert!((ray.d - Vec3::from(d)).length() < 2e-6, "{fov_axis:?} {ray:?}");
            assert!((ray.t_max - t_max).abs() < 2e-5, "{fov_axis:?} {ray:?}");
        }
    }

    #[test]
    fn a_flat_transform_is_refused() {
        let settings = SensorSettings {
            name: String::new(),
            to_world: DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)),
            fov: 1.0,
            fov_axis: FovAxis::X,
            near_clip: 0.1,
            far_clip: 10.0,
            principal_point_offset: [0.0; 2],
            film: FilmSettings::default(),
        };
        let error = Perspective::new(&settings).unwrap_err();
        assert_eq!(error.to_string(), "expected an invertible, finite to_world transform of the sensor");
    }
}
