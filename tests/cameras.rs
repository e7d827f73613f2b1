//! Lenses and shutters, compared with averages of many sharp frames.

use crate::support::scenes::{add, camera, compiled, diffuse, pixels, render, sphere};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::integrator::Settings;
use buffon::integrator::settings::PathLimits;
use buffon::math::{DAffine3, DVec2, DVec3, Motion};
use buffon::sampling::SamplerKind;
use buffon::scene::Description;
use buffon::sensor::{Projection, SensorSettings, ThinLens};
use buffon::shape::Shape;

const SIZE: u32 = 24;

/// Returns the settings for emitted light alone. Its only noise is that of positions, lens and time.
fn emitted() -> Settings {
    Settings::Path(PathLimits { max_depth: Some(1), ..PathLimits::default() }.into())
}

fn lamp(description: &mut Description, shape: Shape, to_world: impl Into<Motion>, radiance: f32) {
    let id = add(description, shape, DAffine3::IDENTITY, diffuse(0.5));
    description.shapes[id].to_world = to_world.into();
    description.shapes[id].emission = Some(Rgb::splat(radiance).into());
}

fn image(
    description: &Description,
    sensor: SensorSettings,
    (spp, seed): (u64, u64),
    accel: AccelKind,
) -> Vec<[f64; 3]> {
    let mut description = description.clone();
    description.sensors = vec![sensor];
    let scene = compiled(description, accel);
    pixels(&render(&scene, &emitted(), SamplerKind::Sobol, spp, seed))
}

/// Returns the mean of many frames.
fn average(frames: impl Iterator<Item = Vec<[f64; 3]>>) -> Vec<[f64; 3]> {
    let mut sum = vec![[0.0; 3]; (SIZE * SIZE) as usize];
    let mut n = 0.0;
    for frame in frames {
        for (sum, pixel) in sum.iter_mut().zip(frame) {
            *sum = [0, 1, 2].map(|c| sum[c] + pixel[c]);
        }
        n += 1.0;
    }
    sum.into_iter().map(|p| p.map(|v| v / n)).collect()
}

/// Returns the maximum and the root mean square difference of two images.
fn difference(a: &[[f64; 3]], b: &[[f64; 3]]) -> (f64, f64) {
    let off = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs());
    let (max, sum) = off.fold((0.0, 0.0), |(max, sum): (f64, f64), d| (max.max(d), sum + d * d));
    (max, (sum / (3 * a.len()) as f64).sqrt())
}

/// A thin lens gives the mean of pinhole images over its aperture. The pinholes have the same plane of focus.
#[test]
fn a_thin_lens_is_the_mean_of_pinholes() {
    let mut description = Description::default();
    for (x, z, radiance) in [(-0.8, 1.5, 1.0), (0.0, 0.0, 2.0), (0.9, -2.5, 3.0)] {
        let place = DAffine3::from_translation(DVec3::new(x, 0.1 * z, z));
        lamp(&mut description, sphere(0.35), place, radiance);
    }
    let pinhole = camera(DVec3::new(0.0, 0.3, 5.0), DVec3::ZERO, 40.0, SIZE);
    let lens = ThinLens { aperture_radius: 0.25, focus_distance: 5.0 };
    let Projection::Perspective { fov, fov_axis, .. } = pinhole.projection else { unreachable!() };
    let half = (0.5 * fov).tan();
    // Equally weighted points on a spiral over the aperture. [Vogel 1979]
    let n = 512;
    let frames = (0..n).map(|i| {
        let r = lens.aperture_radius * ((f64::from(i) + 0.5) / f64::from(n)).sqrt();
        let angle = f64::from(i) * 2.399_963_229_728_653;
        let start = DVec2::new(r * angle.cos(), r * angle.sin());
        let to_world = pinhole.to_world.at(0.0) * DAffine3::from_translation(start.extend(0.0));
        let shift = start / (2.0 * half * lens.focus_distance);
        let projection =
            Projection::Perspective { fov, fov_axis, principal_point_offset: [shift.x, shift.y] };
        let sensor = SensorSettings { to_world: to_world.into(), projection, ..pinhole.clone() };
        image(&description, sensor, (16, i as u64), AccelKind::default())
    });
    let expected = average(frames);
    for accel in AccelKind::ALL {
        let sensor = SensorSettings { lens: Some(lens), ..pinhole.clone() };
        let blurred = image(&description, sensor, (8192, 9999), *accel);
        let (max, rms) = difference(&blurred, &expected);
        assert!(max < 0.05 && rms < 0.008, "{accel}: {max} {rms}");
        let sharp = image(&description, pinhole.clone(), (256, 0), *accel);
        let (_, rms) = difference(&sharp, &expected);
        assert!(rms > 0.02, "the lens blurs: {rms}");
    }
}

/// The motion blur of moving shapes and a moving camera is the mean of sharp frames over the shutter interval.
#[test]
fn motion_blur_is_the_mean_of_sharp_frames() {
    let turn = |degrees: f64| DAffine3::from_rotation_z(degrees.to_radians());
    let motion = |keys: Vec<(f64, DAffine3)>| Motion::new(keys).expect("times increase");
    let shift = |x: f64, y: f64| DAffine3::from_translation(DVec3::new(x, y, 0.0));
    let mut description = Description::default();
    let path = vec![(0.0, shift(-1.0, 0.8)), (1.0, shift(0.0, 0.5)), (2.0, shift(1.0, 0.9))];
    lamp(&mut description, sphere(0.3), motion(path), 1.0);
    let bar = DAffine3::from_scale(DVec3::new(0.9, 0.1, 0.1));
    lamp(&mut description, Shape::Cube, motion(vec![(0.0, turn(0.0) * bar), (2.0, turn(120.0) * bar)]), 2.0);
    let grown = |s: f64| shift(0.6, -0.9) * DAffine3::from_scale(DVec3::splat(s));
    lamp(&mut description, Shape::Disk, motion(vec![(0.5, grown(0.2)), (1.5, grown(0.5))]), 3.0);
    lamp(
        &mut description,
        Shape::Rectangle,
        shift(-0.9, -0.9) * DAffine3::from_scale(DVec3::splat(0.2)),
        1.5,
    );
    let still = camera(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, 40.0, SIZE);
    let there = still.to_world.at(0.0);
    let to_world = motion(vec![(0.0, there), (2.0, shift(0.2, -0.1) * there)]);
    let moving = SensorSettings { to_world, shutter: [0.25, 1.75], ..still };
    let [open, close] = moving.shutter;
    let n = 256;
    let at = |i: i32| open + (close - open) * (f64::from(i) + 0.5) / f64::from(n);
    let frames = (0..n).map(|i| {
        let sensor = SensorSettings { shutter: [at(i); 2], ..moving.clone() };
        image(&description, sensor, (16, i as u64), AccelKind::default())
    });
    let expected = average(frames);
    for accel in AccelKind::ALL {
        let blurred = image(&description, moving.clone(), (8192, 9999), *accel);
        let (max, rms) = difference(&blurred, &expected);
        assert!(max < 0.05 && rms < 0.008, "{accel}: {max} {rms}");
    }
    let sharp =
        image(&description, SensorSettings { shutter: [1.0; 2], ..moving }, (64, 0), AccelKind::default());
    assert!(difference(&sharp, &expected).1 > 0.1, "motion blurs");
}

/// A moving emitter lights a floor as the mean of emitters at rest does, for every shape.
#[test]
fn moving_lamps_light_as_the_mean_of_lamps_at_rest() {
    check_moving_lamps(&[Shape::Rectangle, sphere(1.0)]);
}

#[test]
#[ignore = "takes long: make test-all"]
fn moving_disks_and_meshes_light_as_the_mean_of_them_at_rest() {
    check_moving_lamps(&[Shape::Disk, Shape::Cube]);
}

fn check_moving_lamps(shapes: &[Shape]) {
    let motion = |a: DAffine3, b: DAffine3| Motion::new(vec![(0.0, a), (1.0, b)]).expect("times increase");
    let place = |x: f64, y: f64, s: f64| {
        DAffine3::from_scale_rotation_translation(
            DVec3::splat(s),
            buffon::math::DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2),
            DVec3::new(x, y, 0.0),
        )
    };
    for shape in shapes {
        let mut description = Description::default();
        let floor =
            DAffine3::from_rotation_x(-std::f64::consts::FRAC_PI_2) * DAffine3::from_scale(DVec3::splat(4.0));
        add(&mut description, Shape::Rectangle, floor, diffuse(0.5));
        lamp(&mut description, shape.clone(), motion(place(-1.0, 1.5, 0.3), place(1.0, 2.0, 0.5)), 4.0);
        let sensor = camera(DVec3::new(0.0, 3.0, 4.0), DVec3::ZERO, 40.0, SIZE);
        let lit = |shutter: [f64; 2], spp, seed| {
            let mut description = description.clone();
            description.sensors = vec![SensorSettings { shutter, ..sensor.clone() }];
            let scene = compiled(description, AccelKind::default());
            let path = Settings::Path(
                PathLimits { max_depth: Some(2), hide_emitters: true, ..PathLimits::default() }.into(),
            );
            pixels(&render(&scene, &path, SamplerKind::Sobol, spp, seed))
        };
        let n = 64;
        let expected = average((0..n).map(|i| lit([(f64::from(i) + 0.5) / f64::from(n); 2], 64, i as u64)));
        let blurred = lit([0.0, 1.0], 4096, 99);
        let mean = |image: &[[f64; 3]]| image.iter().flatten().sum::<f64>() / (3 * image.len()) as f64;
        let ratio = mean(&blurred) / mean(&expected);
        let (max, rms) = difference(&blurred, &expected);
        assert!((ratio - 1.0).abs() < 5e-3 && rms < 0.03 * mean(&expected), "{shape:?}: {ratio} {max} {rms}");
    }
}
