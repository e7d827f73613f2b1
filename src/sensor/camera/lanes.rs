//! Rays of perspective cameras, sixteen at a time.

use super::{Camera, CameraPose, Lines};
use crate::math::lanes::{LANES, each_lane, f32x16};
use crate::math::{DVec3, RayX16, Vec3x16};
use crate::sampling::warp::square_to_disk_x16;

impl Camera {
    /// Computes [`ray`](Self::ray) for sixteen film positions, given by their x and y coordinates. Directions are
    /// rounded to `f32` before they are normalized. `None` if the camera moves or is not a perspective one.
    #[inline]
    pub fn rays_x16(&self, [x, y]: [&[f64; LANES]; 2], u: [f32x16; 2], time: f32x16) -> Option<RayX16> {
        let pose = self.fixed.as_ref().filter(|_| self.lines == Lines::Central)?;
        let CameraPose { to_world, axes, corner, dx, dy } = pose;
        let along = |axis: usize| {
            let (corner, dx, dy) = (corner[axis], dx[axis], dy[axis]);
            f32x16::new(each_lane(|i| (corner + dx * x[i] + dy * y[i]) as f32))
        };
        let mut direction = Vec3x16::new(along(0), along(1), along(2));
        let splat = |v: DVec3| Vec3x16::splat(v.as_vec3());
        let mut origin = splat(to_world.translation);
        if let Some(lens) = self.lens {
            let start = square_to_disk_x16(u).map(|c| c * f32x16::splat(lens.aperture_radius as f32));
            let start = splat(axes.x_axis) * start[0] + splat(axes.y_axis) * start[1];
            origin = origin + start;
            direction = direction - start * f32x16::splat((1.0 / lens.focus_distance) as f32);
        }
        // The reciprocals of the cosines with the viewing axis.
        let length = direction.length_squared().sqrt();
        let d = direction / length;
        let (near, far) = (self.near as f32, self.far as f32);
        let o = origin + d * (f32x16::splat(near) * length);
        Some(RayX16 { o, t_max: f32x16::splat(far - near) * length, d, time })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::FilmSettings;
    use crate::math::{DAffine3, DVec2, Vec2};
    use crate::sampling::hash::{combine, to_unit};
    use crate::sensor::{FovAxis, Projection, SensorSettings, ThinLens};

    /// Lanes give the rays that are computed one by one, with and without a lens, for wide and narrow views.
    #[test]
    fn lanes_are_rays() {
        let mut seed = 0;
        let mut random = || {
            seed += 1;
            to_unit(combine(7, seed))
        };
        for (fov, lens) in [(40.0, false), (40.0, true), (170.0, false), (0.5, true)] {
            let settings = SensorSettings {
                name: String::new(),
                to_world: (DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0))
                    * DAffine3::from_rotation_y(0.7)
                    * DAffine3::from_rotation_x(-0.4))
                .into(),
                projection: Projection::Perspective {
                    fov: f64::to_radians(fov),
                    fov_axis: FovAxis::X,
                    principal_point_offset: [0.1, -0.2],
                },
                lens: lens.then_some(ThinLens { aperture_radius: 0.2, focus_distance: 3.0 }),
                shutter: [0.0; 2],
                near_clip: 0.5,
                far_clip: 10.0,
                film: FilmSettings { width: 60, height: 40, ..FilmSettings::default() },
                medium: None,
            };
            let camera = Camera::new(&settings).expect("a camera");
            let [x, y] = [60.0, 40.0].map(|size| [(); LANES].map(|()| size * f64::from(random())));
            let u = [(); 2].map(|()| [(); LANES].map(|()| random()));
            let lanes =
                camera.rays_x16([&x, &y], u.map(f32x16::new), f32x16::HALF).expect("a perspective camera");
            for (i, ray) in lanes.to_rays().into_iter().enumerate() {
                let one = camera.ray(DVec2::new(x[i], y[i]), Vec2::new(u[0][i], u[1][i]), 0.5);
                assert!(
                    (ray.o - one.o).length() < 2e-6 && (ray.d - one.d).length() < 4e-7,
                    "{ray:?} {one:?}"
                );
                assert!(
                    (ray.t_max / one.t_max - 1.0).abs() < 1e-6 && ray.time == one.time,
                    "{ray:?} {one:?}"
                );
            }
        }
    }
}
