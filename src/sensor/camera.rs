//! Cameras: rays through film positions, and film positions of points.

mod lanes;

use super::{FovAxis, Projection, SensorSettings, ThinLens};
use crate::error::{Error, Result};
use crate::film::{FilmSettings, PixelRect};
use crate::math::{Bounds, DAffine3, DMat3, DVec2, DVec3, Motion, Ray, Vec2, Vec3};
use crate::sampling::warp;
use std::borrow::Cow;
use std::f64::consts::{PI, TAU};
use std::fmt;
use std::sync::Arc;

/// A surface whose irradiance a sensor measures.
pub trait SensorSurface: Send + Sync + fmt::Debug {
    /// Returns a ray that leaves the surface at a point that `u_point` selects, in a direction that `u_direction`
    /// selects, and its weight: the mean of weight × radiance is the irradiance of the surface, W·m⁻².
    fn ray(&self, u_point: Vec2, u_direction: Vec2) -> (Ray, f32);
}

/// A camera prepared for generating rays.
#[derive(Clone, Debug)]
pub struct Camera {
    /// The film.
    pub film: FilmSettings,
    /// The transform from camera space to world space.
    to_world: Motion,
    /// The times at which the shutter opens and closes.
    shutter: [f64; 2],
    /// The camera's axes, if they are constant over the shutter interval.
    fixed: Option<CameraPose>,
    /// The film's top left corner at distance 1 along the viewing axis, in camera space.
    corner: DVec2,
    /// The change of that position per pixel to the right and downwards.
    pixel: DVec2,
    lines: Lines,
    /// The surface of a sensor that measures irradiance.
    surface: Option<Arc<dyn SensorSurface>>,
    lens: Option<ThinLens>,
    near: f64,
    far: f64,
}

/// The lines along which a camera sees.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Lines {
    /// Through the origin and a point of the image plane.
    Central,
    /// Along the viewing axis, through a point of the image plane.
    Parallel,
    /// From the origin in all directions.
    Spherical,
    /// Along the viewing axis, through a disk of this radius around the origin.
    Axial { radius: f64 },
    /// From the points of a surface in all directions of the hemisphere.
    Surface,
}

/// The position and axes of a camera at one time.
#[derive(Clone, Copy, Debug)]
struct CameraPose {
    to_world: DAffine3,
    /// Unit vectors of the axes in world space. The scale of a perspective camera's transform only affects the
    /// clipping distances, which are in world space.
    axes: DMat3,
    /// The vector in world space to the film's top left corner, of length 1 along the viewing axis, and its change
    /// per pixel to the right and downwards.
    corner: DVec3,
    dx: DVec3,
    dy: DVec3,
}

impl CameraPose {
    fn new(to_world: DAffine3, corner: DVec2, pixel: DVec2) -> Self {
        let m = to_world.matrix3;
        let axes = DMat3::from_cols(m.x_axis.normalize(), m.y_axis.normalize(), m.z_axis.normalize());
        CameraPose {
            to_world,
            axes,
            corner: axes * corner.extend(1.0),
            dx: axes.x_axis * pixel.x,
            dy: axes.y_axis * pixel.y,
        }
    }
}

/// The importance of a point, sampled at a position on the aperture. [Veach 1997, 4.3]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Importance {
    /// Position on the film in pixels from the top left corner of the full image.
    pub film: DVec2,
    /// Unit direction from the point towards the aperture.
    pub wi: Vec3,
    /// The end of the connecting ray, on the near clipping plane.
    pub target: Vec3,
    /// The contribution of a path with the radiance L to the pixels at `film`, divided by L and by the cosine at the
    /// point. Pixel values are mean radiances, and there is one path for each pixel of the full image.
    pub weight: f32,
}

impl Camera {
    /// Creates a camera.
    ///
    /// # Errors
    /// If a transform is singular or not finite.
    pub fn new(settings: &SensorSettings) -> Result<Self> {
        let [open, close] = settings.shutter;
        for time in [open, close] {
            let to_world = settings.to_world.at(time);
            if !to_world.is_finite() || to_world.matrix3.determinant() == 0.0 {
                return Err(Error::scene("expected an invertible, finite to_world transform of the sensor"));
            }
        }
        let film = settings.film;
        let (width, height) = (f64::from(film.width), f64::from(film.height));
        let mut offset = [0.0; 2];
        let (half, lines) = match settings.projection {
            Projection::Perspective { fov, fov_axis, principal_point_offset } => {
                offset = principal_point_offset;
                (half_extents(fov, fov_axis, width, height), Lines::Central)
            }
            Projection::Orthographic => ([1.0, height / width], Lines::Parallel),
            Projection::Spherical => ([0.0; 2], Lines::Spherical),
            Projection::Axis | Projection::Distant { .. } => ([0.0; 2], Lines::Axial { radius: 0.0 }),
            Projection::Surface { .. } => ([0.0; 2], Lines::Surface),
        };
        // x points to the left, y upwards.
        let corner = DVec2::new(half[0] * (1.0 - 2.0 * offset[0]), half[1] * (1.0 - 2.0 * offset[1]));
        let pixel = DVec2::new(-2.0 * half[0] / width, -2.0 * half[1] / height);
        let at_rest = if open < close { settings.to_world.fixed() } else { Some(settings.to_world.at(open)) };
        Ok(Camera {
            film,
            to_world: settings.to_world.clone(),
            shutter: settings.shutter,
            fixed: at_rest.map(|to_world| CameraPose::new(to_world, corner, pixel)),
            corner,
            pixel,
            lines,
            surface: None,
            lens: settings.lens,
            near: settings.near_clip,
            far: settings.far_clip,
        })
    }

    /// Creates a camera for a scene of the given bounds, outside of which a distant sensor is.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn for_scene(settings: &SensorSettings, bounds: Bounds) -> Result<Self> {
        let Projection::Distant { target } = settings.projection else { return Camera::new(settings) };
        let (radius, center) = match bounds.is_empty() {
            true => (1.0, DVec3::ZERO),
            // The sphere around the bounds, a little larger than rounding errors.
            false => (f64::from(bounds.radius()) * 1.0001, bounds.center().as_dvec3()),
        };
        let mut frame = settings.to_world.at(settings.shutter[0]);
        let axis = frame.matrix3.z_axis.normalize();
        frame.translation = match target {
            Some(target) => {
                let target = DVec3::from(target);
                target - axis * (radius + target.distance(center))
            }
            None => center - axis * radius,
        };
        let mut camera = Camera::new(&SensorSettings { to_world: frame.into(), ..settings.clone() })?;
        camera.lines = Lines::Axial { radius: if target.is_some() { 0.0 } else { radius } };
        Ok(camera)
    }

    /// Creates a sensor that measures the irradiance of a surface.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn on_surface(settings: &SensorSettings, surface: Arc<dyn SensorSurface>) -> Result<Self> {
        Ok(Camera { surface: Some(surface), ..Camera::new(settings)? })
    }

    /// Returns the camera with another number of pixels for the same view and crop.
    ///
    /// # Panics
    /// If a number is 0.
    #[must_use]
    pub fn with_size(&self, width: u32, height: u32) -> Self {
        assert!(width > 0 && height > 0, "{width}x{height}");
        let along = |start: u32, length: u32, old: u32, new: u32| {
            let scaled = |x: u32| (u64::from(x) * u64::from(new) / u64::from(old)) as u32;
            let start = scaled(start).min(new - 1);
            (start, scaled(length).clamp(1, new - start))
        };
        let film = &self.film;
        let crop = film.crop.map(|crop| {
            let (x, across) = along(crop.x, crop.width, film.width, width);
            let (y, down) = along(crop.y, crop.height, film.height, height);
            PixelRect { x, y, width: across, height: down }
        });
        let size = |width: u32, height: u32| DVec2::new(width.into(), height.into());
        let pixel = self.pixel * size(film.width, film.height) / size(width, height);
        Camera {
            film: FilmSettings { width, height, crop, ..*film },
            fixed: self.fixed.map(|pose| CameraPose::new(pose.to_world, self.corner, pixel)),
            pixel,
            ..self.clone()
        }
    }

    /// Returns the transform from camera space to world space at a time in [0, 1] over the shutter interval.
    #[inline]
    pub fn to_world(&self, time: f32) -> DAffine3 {
        match &self.fixed {
            Some(pose) => pose.to_world,
            None => {
                let [open, close] = self.shutter;
                self.to_world.at(open + (close - open) * f64::from(time))
            }
        }
    }

    /// Returns the position and axes at a time.
    #[inline]
    fn pose(&self, time: f32) -> Cow<'_, CameraPose> {
        match &self.fixed {
            Some(pose) => Cow::Borrowed(pose),
            None => Cow::Owned(CameraPose::new(self.to_world(time), self.corner, self.pixel)),
        }
    }

    /// Returns whether rays depend on a position on the aperture.
    pub fn has_lens(&self) -> bool {
        match self.lines {
            Lines::Axial { radius } => radius > 0.0,
            Lines::Surface => true,
            Lines::Central | Lines::Parallel | Lines::Spherical => self.lens.is_some(),
        }
    }

    /// Returns whether a pixel is not the image of some directions from a point. No light path can be connected to
    /// such a camera, and its pixels have no extent on surfaces.
    pub fn is_meter(&self) -> bool {
        matches!(self.lines, Lines::Axial { .. } | Lines::Surface)
    }

    /// Returns whether rays have weights.
    pub fn has_weights(&self) -> bool {
        self.surface.is_some()
    }

    /// Returns the ray of [`ray`](Self::ray) and its weight, by which its radiance is multiplied.
    pub fn weighted_ray(&self, p: DVec2, u: Vec2, time: f32) -> (Ray, f32) {
        let Some(surface) = &self.surface else { return (self.ray(p, u, time), 1.0) };
        let size = DVec2::new(self.film.width.into(), self.film.height.into());
        // Rounding must not reach 1.
        let (ray, weight) = surface.ray((p / size).as_vec2().min(Vec2::splat(1.0 - f32::EPSILON / 2.0)), u);
        (Ray { time, ..ray }, weight)
    }

    /// Returns whether the image shows all directions, so that opposite borders of it meet.
    pub fn is_spherical(&self) -> bool {
        self.lines == Lines::Spherical
    }

    /// Returns whether the camera moves during the shutter interval.
    pub fn is_moving(&self) -> bool {
        self.fixed.is_none() && self.shutter[0] < self.shutter[1]
    }

    /// Returns whether all samples have the same ray, if the camera does not move.
    pub fn has_one_ray(&self) -> bool {
        self.lines == Lines::Axial { radius: 0.0 }
    }

    /// Returns the ray through the film position `p`, in pixels from the top left corner of the full image, at a time
    /// in [0, 1] over the shutter interval. `u` selects the position on the aperture. The ray of a perspective or
    /// orthographic camera starts on the near clipping plane and ends on the far one.
    #[inline]
    pub fn ray(&self, p: DVec2, u: Vec2, time: f32) -> Ray {
        if self.surface.is_some() {
            return self.weighted_ray(p, u, time).0;
        }
        let pose = self.pose(time);
        if self.lines == Lines::Parallel {
            let to_world = pose.to_world;
            let q = self.corner + self.pixel * p;
            let o = to_world.transform_point3(q.extend(self.near));
            let d = to_world.matrix3.z_axis.normalize();
            return Ray { o: o.as_vec3(), t_max: (self.far - self.near) as f32, d: d.as_vec3(), time };
        }
        if let Lines::Spherical | Lines::Axial { .. } = self.lines {
            let (mut o, mut d) = (pose.to_world.translation, pose.axes.z_axis);
            if let Lines::Axial { radius } = self.lines {
                let start = warp::square_to_disk(u).as_dvec2() * radius;
                o += pose.axes.x_axis * start.x + pose.axes.y_axis * start.y;
            } else {
                let (sin_phi, cos_phi) = (p.x / f64::from(self.film.width) * TAU).sin_cos();
                let (sin, cos) = (p.y / f64::from(self.film.height) * PI).sin_cos();
                d = pose.axes * DVec3::new(sin_phi * sin, cos, -cos_phi * sin);
            }
            return Ray { o: o.as_vec3(), t_max: f32::INFINITY, d: d.as_vec3(), time };
        }
        let mut direction = pose.corner + pose.dx * p.x + pose.dy * p.y;
        let mut origin = pose.to_world.translation;
        if let Some(lens) = self.lens {
            let start = warp::square_to_disk(u).as_dvec2() * lens.aperture_radius;
            let start = pose.axes.x_axis * start.x + pose.axes.y_axis * start.y;
            origin += start;
            direction -= start / lens.focus_distance;
        }
        // The reciprocal of the cosine with the viewing axis.
        let length = direction.length() as f32;
        let d = (direction / f64::from(length)).as_vec3();
        let (near, far) = (self.near as f32, self.far as f32);
        Ray { o: origin.as_vec3() + d * (near * length), t_max: (far - near) * length, d, time }
    }

    /// Returns the importance of the world-space point `p` at a time; `None` if the point is outside the clipping
    /// planes, or more than `margin` pixels outside the full image, or if the camera is a meter. `u` selects the
    /// position on the aperture.
    ///
    /// A pixel's value is the mean radiance over its area, so the film's importance is constant over the area of the
    /// image plane: `We = 1 / (A·cos⁴θ)` per unit of aperture area. [pbrt 16.1.1]
    pub fn importance(&self, p: Vec3, u: Vec2, time: f32, margin: f64) -> Option<Importance> {
        let CameraPose { to_world, axes: m, .. } = *self.pose(time);
        match self.lines {
            Lines::Spherical => return self.spherical_importance(to_world.translation, m, p),
            Lines::Axial { .. } | Lines::Surface => return None,
            Lines::Central | Lines::Parallel => {}
        }
        let pixels = f64::from(self.film.width) * f64::from(self.film.height);
        // The area of the full image at distance 1, in camera space.
        let area = (self.pixel.x * self.pixel.y).abs() * pixels;
        let p = p.as_dvec3();
        let (film, aperture, to_near, weight) = if self.lines == Lines::Parallel {
            let local = to_world.inverse().transform_point3(p);
            let axis = to_world.matrix3.z_axis.normalize();
            let depth = (p - to_world.transform_point3(local.truncate().extend(0.0))).dot(axis);
            // As in `ray`, the near plane is in camera space and the ray's length in world space.
            let start = self.near * to_world.matrix3.z_axis.length();
            if !(depth > start && depth - start < self.far - self.near) {
                return None;
            }
            let m = to_world.matrix3;
            let world_area = area * m.x_axis.cross(m.y_axis).dot(axis).abs();
            ((local.truncate() - self.corner) / self.pixel, p - axis * depth, depth - start, 1.0 / world_area)
        } else {
            let local = m.inverse() * (p - to_world.translation);
            if !(local.z > self.near && local.z < self.far) {
                return None;
            }
            let start = match self.lens {
                None => DVec2::ZERO,
                Some(lens) => warp::square_to_disk(u).as_dvec2() * lens.aperture_radius,
            };
            // The image position is that of the ray's intersection with the plane of focus.
            let slope = (local.truncate() - start) / local.z;
            let q = match self.lens {
                None => slope,
                Some(lens) => slope + start / lens.focus_distance,
            };
            let aperture = to_world.translation + m * start.extend(0.0);
            let to = local - start.extend(0.0);
            let (distance2, cos) = (to.length_squared(), local.z / to.length());
            // We divided by the density per unit solid angle of the position on the aperture: (1/Aₗ)·d²/cosθ.
            let weight = 1.0 / (area * cos.powi(3) * distance2);
            ((q - self.corner) / self.pixel, aperture, to.length() * (1.0 - self.near / local.z), weight)
        };
        let size = DVec2::new(self.film.width.into(), self.film.height.into());
        if !(film.cmpge(DVec2::splat(-margin)).all() && film.cmple(size + margin).all()) {
            return None;
        }
        let wi = (aperture - p).normalize();
        Some(Importance {
            film,
            wi: wi.as_vec3(),
            target: (p + wi * to_near).as_vec3(),
            weight: weight as f32,
        })
    }

    /// Returns the importance of the point `p` for a spherical camera at `origin`. The full image is 2π wide and π
    /// high, and dφ dθ = dω / sin θ.
    fn spherical_importance(&self, origin: DVec3, axes: DMat3, p: Vec3) -> Option<Importance> {
        let to = origin - p.as_dvec3();
        let distance = to.length();
        let d = axes.transpose() * (-to / distance);
        let phi = d.x.atan2(-d.z).rem_euclid(TAU);
        let film = DVec2::new(phi / TAU, d.y.clamp(-1.0, 1.0).acos() / PI);
        let weight = 1.0 / (TAU * PI * d.x.hypot(d.z) * distance * distance);
        weight.is_finite().then(|| Importance {
            film: film * DVec2::new(self.film.width.into(), self.film.height.into()),
            wi: (to / distance).as_vec3(),
            target: origin.as_vec3(),
            weight: weight as f32,
        })
    }

    /// Returns the density per unit area, perpendicular to the unit direction `d`, with which camera rays in that
    /// direction reach the world-space point `p`, if there is one ray for each pixel of the full image. It is
    /// [`Importance::weight`] for the point of the aperture from which the ray starts.
    pub fn density(&self, p: Vec3, d: Vec3, time: f32) -> f64 {
        let CameraPose { to_world, axes, .. } = *self.pose(time);
        let pixels = f64::from(self.film.width) * f64::from(self.film.height);
        let area = (self.pixel.x * self.pixel.y).abs() * pixels;
        let m = to_world.matrix3;
        if self.lines == Lines::Spherical {
            let cos = d.as_dvec3().dot(axes.y_axis);
            let distance2 = p.as_dvec3().distance_squared(to_world.translation);
            return 1.0 / (TAU * PI * (1.0 - cos * cos).max(0.0).sqrt() * distance2);
        }
        if self.lines == Lines::Parallel {
            return 1.0 / (area * m.x_axis.cross(m.y_axis).dot(m.z_axis.normalize()).abs());
        }
        let depth = (p.as_dvec3() - to_world.translation).dot(axes.z_axis);
        1.0 / (area * d.as_dvec3().dot(axes.z_axis) * depth * depth)
    }

    /// Returns three vectors in camera space at distance 1 along the viewing axis: the full width and height of the
    /// image plane, and its top left corner. `None` if there is no image plane.
    pub fn image_plane(&self) -> Option<[DVec3; 3]> {
        let (width, height) = (f64::from(self.film.width), f64::from(self.film.height));
        matches!(self.lines, Lines::Central | Lines::Parallel).then(|| {
            [
                DVec3::new(self.pixel.x * width, 0.0, 0.0),
                DVec3::new(0.0, self.pixel.y * height, 0.0),
                self.corner.extend(1.0),
            ]
        })
    }

    /// Returns the transform from world space to camera space in the middle of the shutter interval, for the image's
    /// metadata.
    pub fn world_to_camera(&self) -> DAffine3 {
        self.to_world(0.5).inverse()
    }
}

/// Returns half the width and height of the image plane at distance 1, for an image with the given numbers of pixels.
pub fn half_extents(fov: f64, fov_axis: FovAxis, width: f64, height: f64) -> [f64; 2] {
    let tan = (0.5 * fov).tan();
    let along_x = match fov_axis {
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

    /// Origins, directions and lengths computed by Mitsuba 3.9.1 for the same camera.
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
            let camera = Camera::new(&SensorSettings {
                name: String::new(),
                to_world: to_world.into(),
                projection: Projection::Perspective {
                    fov: 40f64.to_radians(),
                    fov_axis,
                    principal_point_offset: [0.1, -0.2],
                },
                lens: None,
                shutter: [0.0; 2],
                near_clip: 0.5,
                far_clip: 10.0,
                film: FilmSettings { width: 60, height: 40, ..FilmSettings::default() },
                medium: None,
            })
            .unwrap();
            let ray = camera.ray(DVec2::new(15.0, 27.5), Vec2::ZERO, 0.0);
            assert!((ray.o - Vec3::from(o)).length() < 2e-5, "{fov_axis:?} {ray:?}");
            assert!((ray.d - Vec3::from(d)).length() < 2e-6, "{fov_axis:?} {ray:?}");
            assert!((ray.t_max - t_max).abs() < 2e-5, "{fov_axis:?} {ray:?}");
            // The same point of an image of 12x16 pixels.
            let small = camera.with_size(12, 16).ray(DVec2::new(3.0, 11.0), Vec2::ZERO, 0.0);
            assert!(
                (small.o - ray.o).length() < 1e-6 && (small.d - ray.d).length() < 1e-6,
                "{small:?} {ray:?}"
            );
        }
    }

    #[test]
    fn a_flat_transform_is_refused() {
        let settings = SensorSettings {
            name: String::new(),
            to_world: DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)).into(),
            projection: Projection::Orthographic,
            lens: None,
            shutter: [0.0; 2],
            near_clip: 0.1,
            far_clip: 10.0,
            film: FilmSettings::default(),
            medium: None,
        };
        let error = Camera::new(&settings).unwrap_err();
        assert_eq!(error.to_string(), "expected an invertible, finite to_world transform of the sensor");
    }
}
