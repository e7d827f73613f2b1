//! Scenes with answers in closed form, for every integrator, sampler and accelerator that they apply to.

use crate::support::scenes::{add, camera, compiled, constant, diffuse, mean, render, sphere};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::integrator::Settings;
use buffon::integrator::settings::{DirectSettings, PathSettings};
use buffon::material::Material;
use buffon::math::{DAffine3, DQuat, DVec3, Vec3};
use buffon::sampling::SamplerKind;
use buffon::scene::{Description, Scene};
use buffon::shape::Shape;

/// Bound on |mean − expected| in standard errors: of about 300 comparisons, none of a correct estimator exceeds
/// it with probability 0.9998 (normal tails).
const SIGMAS: f64 = 5.2;

fn path(max_depth: Option<u32>) -> Settings {
    Settings::Path(PathSettings { max_depth, ..PathSettings::default() })
}

fn direct(emitter_samples: u32, bsdf_samples: u32) -> Settings {
    Settings::Direct(DirectSettings { emitter_samples, bsdf_samples, ..DirectSettings::default() })
}

/// Renders with every sampler and compares the image's mean with `expected`; `relative` is the largest deviation
/// that is accepted however noisy the render is.
fn expect(name: &str, scene: &Scene, settings: &[Settings], spp: u64, expected: [f64; 3], relative: f64) {
    for setting in settings {
        for sampler in SamplerKind::ALL {
            let rendered = render(scene, setting, sampler, spp, 1);
            assert_eq!(
                rendered.invalid_count,
                0,
                "{name}: invalid samples, the first {:?}",
                rendered.invalid.first()
            );
            let (mean, error) = mean(&rendered);
            for c in 0..3 {
                let off = (mean[c] - expected[c]).abs();
                // Rounding: a constant image has no standard error at all.
                let bound = SIGMAS * error[c] + 2e-6 * expected[c];
                let what = format!("{name}, {setting:?}, {sampler}, {}: channel {c}", scene.accel.name());
                assert!(off < bound, "{what}: {} ± {}, expected {}", mean[c], error[c], expected[c]);
                assert!(
                    off <= relative * expected[c],
                    "{what}: {} is too noisy for {}",
                    mean[c],
                    expected[c]
                );
            }
        }
    }
}

/// The scene on every accelerator.
fn on_every_accel(build: impl Fn() -> Description, test: impl Fn(&Scene)) {
    for &kind in AccelKind::ALL {
        test(&compiled(build(), kind));
    }
}

/// A closed sphere whose inside emits `emission` and reflects `albedo`.
fn furnace(albedo: Rgb, emission: f32) -> Description {
    let mut scene = Description::default();
    let id = add(&mut scene, sphere(1.0), DAffine3::IDENTITY, Material::Diffuse { reflectance: albedo });
    scene.shapes[id].flip_normals = true;
    scene.shapes[id].emission = Some(Rgb::splat(emission));
    scene.sensors.push(camera(DVec3::new(0.1, 0.2, -0.3), DVec3::new(0.4, 0.1, 1.0), 80.0, 8));
    scene
}

#[test]
fn inside_a_half_reflecting_sphere_that_emits_a_half_everything_is_one() {
    on_every_accel(
        || furnace(Rgb::splat(0.5), 0.5),
        |scene| expect("unit furnace", scene, &[path(None)], 256, [1.0; 3], 0.01),
    );
}

#[test]
fn a_furnace_shows_its_geometric_series() {
    on_every_accel(
        || furnace(Rgb::new(0.2, 0.7, 0.9), 0.25),
        |scene| {
            let series = |a: f64, terms: i32| 0.25 * (1.0 - a.powi(terms)) / (1.0 - a);
            // Reflectances as they are stored.
            let albedo = [0.2f32, 0.7, 0.9].map(f64::from);
            expect("furnace", scene, &[path(None)], 1024, albedo.map(|a| 0.25 / (1.0 - a)), 0.02);
            expect("furnace to depth 4", scene, &[path(Some(4))], 256, albedo.map(|a| series(a, 4)), 0.01);
            let two = [path(Some(2)), direct(1, 1), direct(3, 1), direct(1, 3), direct(1, 0), direct(0, 1)];
            expect("furnace, direct", scene, &two, 256, albedo.map(|a| series(a, 2)), 0.01);
        },
    );
}

#[test]
fn roulette_from_the_first_bounce_is_as_right_as_none() {
    let scene = compiled(furnace(Rgb::new(0.05, 0.5, 0.8), 0.25), AccelKind::default());
    let expected = [0.05f32, 0.5, 0.8].map(|a| 0.25 / (1.0 - f64::from(a)));
    for rr_depth in [1, 2, 1_000_000] {
        // Without roulette the series is cut where its rest is far below the noise.
        let max_depth = (rr_depth > 2).then_some(80);
        let settings = Settings::Path(PathSettings { rr_depth, max_depth, ..PathSettings::default() });
        expect(&format!("roulette from {rr_depth}"), &scene, &[settings], 256, expected, 0.02);
    }
}

/// A square floor in the plane z = 0 that faces +z, seen from straight above as nearly one point.
fn floor_seen_as_a_point(reflectance: f32) -> Description {
    let mut scene = Description::default();
    add(&mut scene, Shape::Rectangle, DAffine3::from_scale(DVec3::splat(50.0)), diffuse(reflectance));
    scene.sensors.push(camera(DVec3::new(0.0, 0.0, 0.5), DVec3::ZERO, 0.2, 4));
    scene
}

#[test]
fn a_point_light_lights_a_plane_by_the_inverse_square() {
    let build = || {
        let mut scene = floor_seen_as_a_point(0.6);
        let position = Vec3::new(1.5, 0.0, 2.0);
        scene.emitters.push(Emitter::Point { position, intensity: Rgb::new(10.0, 5.0, 1.0) });
        scene
    };
    let d2: f64 = 1.5 * 1.5 + 2.0 * 2.0;
    let irradiance = 2.0 / d2.sqrt() / d2;
    let expected = [10.0, 5.0, 1.0].map(|i| i * irradiance * f64::from(0.6f32) / std::f64::consts::PI);
    on_every_accel(build, |scene| {
        // The pixel is not quite a point: the mean over it differs from its centre by less than 1e-5.
        for setting in [path(None), path(Some(2)), direct(1, 1), direct(2, 0)] {
            let rendered = render(scene, &setting, SamplerKind::Sobol, 64, 1);
            let (mean, _) = mean(&rendered);
            for c in 0..3 {
                assert!(
                    (mean[c] / expected[c] - 1.0).abs() < 1e-5,
                    "{setting:?}: {} {}",
                    mean[c],
                    expected[c]
                );
            }
        }
    });
}

/// Turns a shape that faces +z to face −z, scales it and lifts it.
fn overhead(height: f64, scale: DVec3) -> DAffine3 {
    DAffine3::from_scale_rotation_translation(
        scale,
        DQuat::from_rotation_x(std::f64::consts::PI),
        DVec3::new(0.0, 0.0, height),
    )
}

fn all_direct() -> Vec<Settings> {
    vec![path(Some(2)), direct(1, 1), direct(4, 1), direct(1, 4), direct(1, 0), direct(0, 1)]
}

/// A floor under an emitting shape of reflectance 0. The camera is below the shape, so that it sees the floor.
fn under_emitter(shape: &Shape, to_world: DAffine3) -> Description {
    let mut scene = floor_seen_as_a_point(0.8);
    let id = add(&mut scene, shape.clone(), to_world, diffuse(0.0));
    scene.shapes[id].emission = Some(Rgb::splat(3.0));
    scene
}

#[test]
fn a_sphere_light_lights_a_plane_by_its_form_factor() {
    // Straight above: E = π L (r/d)².
    let to_world = DAffine3::from_translation(DVec3::new(0.0, 0.0, 2.5));
    let expected = [3.0 * f64::from(0.8f32) * (1.0f64 / 2.5).powi(2); 3];
    on_every_accel(
        || under_emitter(&sphere(1.0), to_world),
        |scene| expect("sphere light", scene, &all_direct(), 2048, expected, 0.03),
    );
}

#[test]
fn a_disk_light_lights_a_plane_by_its_form_factor() {
    // E = π L r²/(r² + h²).
    let expected = [3.0 * f64::from(0.8f32) * 1.0 / (1.0 + 2.0f64.powi(2)); 3];
    on_every_accel(
        || under_emitter(&Shape::Disk, overhead(2.0, DVec3::ONE)),
        |scene| expect("disk light", scene, &all_direct(), 2048, expected, 0.03),
    );
}

#[test]
fn a_rectangle_light_lights_a_plane_by_its_form_factor() {
    // Four corner rectangles of a × b at height h, parallel to the plane.
    let (a, b) = (1.0f64, 0.5f64);
    for h in [0.8, 2.0, 6.0] {
        let (ra, rb) = ((a * a + h * h).sqrt(), (b * b + h * h).sqrt());
        let corner = (a / ra * (b / ra).atan() + b / rb * (a / rb).atan()) / (2.0 * std::f64::consts::PI);
        let expected = [3.0 * f64::from(0.8f32) * 4.0 * corner; 3];
        // Near, the solid angle is sampled; far, the area.
        let settings = if h < 3.0 { all_direct() } else { vec![path(Some(2)), direct(1, 1), direct(1, 0)] };
        on_every_accel(
            || under_emitter(&Shape::Rectangle, overhead(h, DVec3::new(a, b, 1.0))),
            |scene| expect(&format!("rectangle light at {h}"), scene, &settings, 2048, expected, 0.03),
        );
    }
}

#[test]
fn a_convex_diffuse_object_in_a_constant_environment_shows_its_reflectance() {
    for shape in [sphere(1.0), Shape::Cube] {
        on_every_accel(
            || {
                let mut scene = Description::default();
                add(
                    &mut scene,
                    shape.clone(),
                    DAffine3::IDENTITY,
                    Material::Diffuse { reflectance: Rgb::new(0.2, 0.5, 0.8) },
                );
                scene.emitters.push(constant(2.0));
                scene.sensors.push(camera(DVec3::new(3.0, 4.0, 5.0), DVec3::ZERO, 10.0, 8));
                scene
            },
            |scene| {
                let expected = [0.2f32, 0.5, 0.8].map(|a| 2.0 * f64::from(a));
                let settings = [path(None), path(Some(2)), direct(1, 1), direct(1, 0), direct(0, 1)];
                expect("convex object", scene, &settings, 256, expected, 0.02);
            },
        );
    }
}

#[test]
fn glass_of_index_one_vanishes_and_lossless_glass_shows_the_environment() {
    for int_ior in [1.0f32, 1.5, 2.4] {
        on_every_accel(
            || {
                let mut scene = Description::default();
                let glass = Material::Dielectric {
                    int_ior,
                    ext_ior: 1.0,
                    specular_reflectance: Rgb::WHITE,
                    specular_transmittance: Rgb::WHITE,
                };
                add(&mut scene, sphere(1.0), DAffine3::IDENTITY, glass);
                scene.emitters.push(constant(0.7));
                scene.sensors.push(camera(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, 40.0, 16));
                scene
            },
            |scene| expect("glass", scene, &[path(None)], 64, [f64::from(0.7f32); 3], 0.01),
        );
    }
}

#[test]
fn a_mirror_shows_the_environment_times_its_reflectance() {
    let build = || {
        let mut scene = Description::default();
        let (eta, k) = (Rgb::new(0.2, 0.9, 1.5), Rgb::new(3.9, 2.4, 1.9));
        let mirror = Material::Conductor { eta, k, specular_reflectance: Rgb::splat(0.5) };
        add(&mut scene, Shape::Rectangle, DAffine3::from_scale(DVec3::splat(9.0)), mirror);
        scene.emitters.push(constant(2.0));
        scene.sensors.push(camera(DVec3::new(0.0, 0.0, 2.0), DVec3::ZERO, 0.1, 4));
        scene
    };
    let normal = |eta: f32, k: f32| {
        let (eta, k) = (f64::from(eta), f64::from(k));
        ((eta - 1.0).powi(2) + k * k) / ((eta + 1.0).powi(2) + k * k)
    };
    let expected = [normal(0.2, 3.9), normal(0.9, 2.4), normal(1.5, 1.9)];
    on_every_accel(build, |scene| {
        for setting in [path(None), direct(1, 1)] {
            let (mean, _) = mean(&render(scene, &setting, SamplerKind::Independent, 4, 1));
            for c in 0..3 {
                assert!(
                    (mean[c] / expected[c] - 1.0).abs() < 1e-5,
                    "{setting:?}: {} {}",
                    mean[c],
                    expected[c]
                );
            }
        }
    });
}

#[test]
fn hidden_emitters_are_seen_through() {
    let build = || {
        let mut scene = under_emitter(&Shape::Disk, overhead(2.0, DVec3::ONE));
        scene.sensors = vec![camera(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, 0.2, 4)];
        scene
    };
    let expected = [3.0 * f64::from(0.8f32) / 5.0; 3];
    on_every_accel(build, |scene| {
        let hidden = [
            Settings::Path(PathSettings {
                max_depth: Some(2),
                hide_emitters: true,
                ..PathSettings::default()
            }),
            Settings::Direct(DirectSettings { hide_emitters: true, ..DirectSettings::default() }),
        ];
        // From above the disk is black on its back; hidden, it is not there.
        expect("hidden emitter", scene, &hidden, 1024, expected, 0.03);
    });
}

#[test]
fn the_depth_integrator_shows_the_distance_from_the_near_plane() {
    let scene = compiled(floor_seen_as_a_point(0.5), AccelKind::default());
    let (mean, _) = mean(&render(&scene, &Settings::Depth, SamplerKind::Sobol, 4, 1));
    assert!((mean[0] - (0.5 - 1e-4)).abs() < 1e-5, "{}", mean[0]);
}
