//! Cameras. [glTF 2.0, 3.10]

use super::{Builder, viewer};
use crate::error::{Error, Result};
use crate::film::FilmSettings;
use crate::math::{DAffine3, DMat3};
use crate::sensor::{FovAxis, Projection, SensorSettings};
use gltf::json::camera::{Orthographic, Perspective};
use std::f64::consts::PI;

/// The greatest number of columns and rows of an image, and the size if the camera has no aspect ratio.
const SIZE: [f64; 2] = [1280.0, 720.0];
/// The least distance of the far clipping plane if the camera does not specify one.
const FAR: f64 = 1e4;

impl Builder<'_> {
    /// Adds a sensor for the camera of a node.
    ///
    /// # Errors
    /// If angles, sizes or distances are out of range, or the node has no direction.
    pub fn camera(&mut self, camera: &gltf::Camera<'_>, name: &str, to_world: &DAffine3) -> Result<()> {
        let thing = format!("cameras[{}]", camera.index());
        let Some(frame) = viewer(to_world) else {
            return Err(self.file.error(thing, "its node has no direction to look in"));
        };
        let described = &self.file.document.as_json().cameras[camera.index()];
        let sensor = match (&described.perspective, &described.orthographic) {
            (Some(perspective), None) => perspective_sensor(perspective, frame),
            (None, Some(orthographic)) => orthographic_sensor(orthographic, frame),
            _ => Err(Error::scene("expected either a perspective or an orthographic camera")),
        };
        let mut sensor = sensor.map_err(|e| e.about(thing).at(self.file.place()))?;
        sensor.name = name.to_owned();
        self.loaded.description.sensors.push(sensor);
        Ok(())
    }
}

/// Returns the largest film of an aspect ratio that fits [`SIZE`].
fn film(aspect: f64) -> FilmSettings {
    let [width, height] = SIZE;
    let fit = |side: f64, most: f64| side.round().clamp(1.0, most) as u32;
    FilmSettings {
        width: fit(height * aspect, width),
        height: fit(width / aspect, height),
        ..FilmSettings::default()
    }
}

fn perspective_sensor(camera: &Perspective, frame: DAffine3) -> Result<SensorSettings> {
    let fov = f64::from(camera.yfov);
    if !(fov > 0.0 && fov < PI) {
        return Err(Error::scene(format!("expected a yfov between 0 and π, found {}", camera.yfov)));
    }
    let aspect = camera.aspect_ratio.map_or(SIZE[0] / SIZE[1], f64::from);
    if !(aspect > 0.0 && aspect.is_finite()) {
        return Err(Error::scene(format!("expected an aspectRatio greater than 0, found {aspect}")));
    }
    let near = f64::from(camera.znear);
    let far = camera.zfar.map_or(FAR.max(1e6 * near), f64::from);
    let projection = Projection::Perspective { fov, fov_axis: FovAxis::Y, principal_point_offset: [0.0; 2] };
    sensor(frame, projection, [near, far], film(aspect))
}

fn orthographic_sensor(camera: &Orthographic, frame: DAffine3) -> Result<SensorSettings> {
    let [x, y] = [camera.xmag, camera.ymag].map(|side| f64::from(side.abs()));
    if !(x > 0.0 && y > 0.0 && x.is_finite() && y.is_finite()) {
        let message =
            format!("expected xmag and ymag other than 0, found {} and {}", camera.xmag, camera.ymag);
        return Err(Error::scene(message));
    }
    let film = film(x / y);
    // The image of an orthographic sensor is two units wide, and its pixels are square.
    let scale_y = y * f64::from(film.width) / f64::from(film.height);
    let m = frame.matrix3;
    let matrix3 = DMat3::from_cols(m.x_axis * x, m.y_axis * scale_y, m.z_axis);
    let far = f64::from(camera.zfar);
    // A glTF camera may have a znear of 0; the near clipping plane of a sensor must be at a distance greater than 0.
    let near = f64::from(camera.znear).max(1e-6 * far);
    sensor(DAffine3 { matrix3, ..frame }, Projection::Orthographic, [near, far], film)
}

fn sensor(
    to_world: DAffine3,
    projection: Projection,
    [near_clip, far_clip]: [f64; 2],
    film: FilmSettings,
) -> Result<SensorSettings> {
    if !(near_clip > 0.0 && near_clip < far_clip && far_clip.is_finite()) {
        let message = format!("expected 0 < znear < zfar, found {near_clip} and {far_clip}");
        return Err(Error::scene(message));
    }
    Ok(SensorSettings {
        name: String::new(),
        to_world: to_world.into(),
        projection,
        lens: None,
        shutter: [0.0; 2],
        near_clip,
        far_clip,
        film,
        medium: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn films_have_the_cameras_shape() {
        for (aspect, size) in
            [(16.0 / 9.0, [1280, 720]), (1.0, [720, 720]), (4.0, [1280, 320]), (1e9, [1280, 1])]
        {
            let film = film(aspect);
            assert_eq!([film.width, film.height], size, "{aspect}");
        }
    }
}
