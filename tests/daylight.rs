//! The sun and the sky: densities, closed forms, and agreement of integrators.

use crate::support::chi2::{check_directions, check_square};
use crate::support::cli::Folder;
use crate::support::expect::Means;
use crate::support::quadrature::over_square;
use crate::support::scenes::{add, camera, compiled, diffuse, render};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::compare::z_test;
use buffon::emitter::daylight::{SkySettings, one_minus_cos};
use buffon::emitter::{BoundingSphere, Emitter, Sky, SunEmitter};
use buffon::image::read;
use buffon::integrator::Settings;
use buffon::integrator::settings::{DirectSettings, PathLimits};
use buffon::math::{DAffine3, DVec3, Frame, Vec2, Vec3};
use buffon::sampling::{SamplerKind, warp};
use buffon::scene::Description;
use buffon::shape::Shape;
use std::f64::consts::{PI, TAU};

/// The number of chi-square tests.
const TESTS: usize = 5;
const SCENE: BoundingSphere = BoundingSphere { center: Vec3::ZERO, radius: 2.0 };

fn direction(elevation_degrees: f64, azimuth_degrees: f64) -> Vec3 {
    let (sin, cos) = elevation_degrees.to_radians().sin_cos();
    let (sin_phi, cos_phi) = azimuth_degrees.to_radians().sin_cos();
    DVec3::new(cos * cos_phi, cos * sin_phi, sin).as_vec3()
}

fn sky(turbidity: f64, sun: Vec3, up: Vec3) -> SkySettings {
    SkySettings { turbidity, albedo: Rgb::splat(0.3), up, sun, scale: 1.0, extends: false }
}

/// A wide sun that the horizon cuts, and one of natural size in the chart of its cone.
#[test]
fn samples_of_the_sun_follow_their_density() {
    let (axis, radiance) = (direction(20.0, 30.0), Rgb::new(3.0, 2.0, 1.0));
    let sun = SunEmitter::new(axis, 40f64.to_radians(), Vec3::Z, radiance, SCENE);
    let density = |d: Vec3| if d.z >= 0.0 { sun.pdf(d) } else { 0.0 };
    let total = check_directions(
        "wide sun",
        TESTS,
        |_, u| {
            let sample = sun.sample(u)?;
            assert!(sample.wi.z >= 0.0 && sample.radiance == radiance && !sample.delta);
            Some(sample.wi)
        },
        density,
    );
    assert!(total > 0.5 && total < 0.95, "{total}");
    let half_angle = 0.2679f64.to_radians();
    let sun = SunEmitter::new(axis, half_angle, Vec3::Z, radiance, SCENE);
    let size = one_minus_cos(half_angle) as f32;
    let frame = Frame::from_normal(axis);
    let mut lost = 0;
    check_square(
        "sun",
        TESTS,
        |_, u| {
            let sample = sun.sample(u)?;
            // Rounding moves samples by 1e-5 of the radius, so a few on the rim are outside.
            lost += usize::from(sun.pdf(sample.wi) == 0.0 || sun.eval(sample.wi).is_black());
            let square = warp::cone_to_square(frame.to_local(sample.wi), size);
            Some([f64::from(square.x.min(1.0)), f64::from(square.y.min(1.0))])
        },
        |_| f64::from(sun.pdf(axis) * size) * TAU,
    );
    assert!(lost < 20, "{lost} samples are outside the disc");
}

/// Both densities of the sky, high and low, with the zenith along no axis. Nothing is sampled below the horizon.
#[test]
fn samples_of_the_sky_follow_their_density() {
    let up = Vec3::new(1.0, 2.0, -0.5).normalize();
    let frame = Frame::from_normal(up);
    for (turbidity, elevation) in [(3.0, 50.0), (7.0, 10.0)] {
        let sky = Sky::new(&sky(turbidity, frame.to_world(direction(elevation, 70.0)), up)).expect("a sky");
        for compensated in [false, true] {
            let name = format!("turbidity {turbidity}, compensated: {compensated}");
            let pdf = |d| if compensated { sky.map().pdf_compensated(d) } else { sky.map().pdf(d) };
            let total = check_directions(
                &name,
                TESTS,
                |_, u| {
                    let s = if compensated { sky.sample_compensated(u)? } else { sky.sample(u)? };
                    assert!(s.wi.dot(up) >= 0.0 && s.radiance == sky.eval(s.wi));
                    assert!((pdf(s.wi) / s.pdf - 1.0).abs() < 2e-2, "{name}: {} {}", s.pdf, pdf(s.wi));
                    Some(frame.to_local(s.wi))
                },
                |d| if d.z >= 0.0 { pdf(frame.to_world(d)) } else { 0.0 },
            );
            // The row of texels below the horizon is sampled in vain.
            assert!(total > 0.97, "{name}: {total}");
        }
    }
}

/// The irradiance of a level surface is the same by quadrature and by samples, and the horizon is sharp.
#[test]
fn the_sky_is_as_bright_as_its_samples() {
    for (turbidity, elevation) in [(2.0, 5.0), (5.0, 45.0), (9.5, 89.0)] {
        let sky = Sky::new(&sky(turbidity, direction(elevation, 20.0), Vec3::Z)).expect("a sky");
        let exact = over_square(|[x, y]| {
            let (z, (sin, cos)) = (x.sqrt(), (TAU * y).sin_cos());
            let r = (1.0 - z * z).sqrt();
            PI * f64::from(sky.eval(DVec3::new(r * cos, r * sin, z).as_vec3()).luminance())
        });
        let n = 400;
        let mut sum = 0.0;
        for i in 0..n * n {
            let u = Vec2::new(((i % n) as f32 + 0.5) / n as f32, ((i / n) as f32 + 0.5) / n as f32);
            let Some(s) = sky.sample(u) else { continue };
            sum += f64::from(s.radiance.luminance() * s.wi.z / s.pdf);
        }
        let sampled = sum / f64::from(n * n);
        assert!((sampled / exact - 1.0).abs() < 2e-3, "{turbidity}, {elevation}°: {sampled}, not {exact}");
        for azimuth in [0.0, 100.0, 250.0] {
            assert!(!sky.eval(direction(1e-5, azimuth)).is_black());
            assert!(sky.eval(direction(-1e-5, azimuth)).is_black());
        }
    }
}

/// A sky that extends below the horizon has there the radiance of the horizon.
#[test]
fn an_extended_sky_continues_below_the_horizon() {
    let settings = SkySettings { extends: true, ..sky(3.0, direction(30.0, 0.0), Vec3::Z) };
    let sky = Sky::new(&settings).expect("a sky");
    let [level, below] = [0.0, -40.0].map(|elevation| sky.eval(direction(elevation, 75.0)));
    assert!((level - below).map(f32::abs).max_component() < 1e-4 * level.max_component());
}

fn path() -> Settings {
    Settings::Path(PathLimits { max_depth: Some(3), rr_depth: 5, hide_emitters: false }.into())
}

fn direct(emitter_samples: u32, bsdf_samples: u32) -> Settings {
    Settings::Direct(DirectSettings { emitter_samples, bsdf_samples, hide_emitters: false })
}

/// A level floor below a sun, seen from above.
fn floor(direction: Vec3, half_angle: f64, radiance: Rgb) -> Description {
    let mut scene = Description::default();
    add(&mut scene, Shape::Rectangle, DAffine3::from_scale(DVec3::splat(3.0)), diffuse(0.5));
    scene.sensors.push(camera(DVec3::new(0.3, 0.2, 2.0), DVec3::new(0.3, 0.2, 0.0), 20.0, 8));
    scene.emitters.push(Emitter::Sun { direction, half_angle, up: Vec3::Z, radiance });
    scene
}

/// A disc of radiance L and half angle a at the angle t to the normal causes the irradiance π L sin² a cos t. If its
/// centre is at the horizon, half of it causes L (a − sin a cos a).
#[test]
fn the_sun_causes_the_irradiance_of_its_disc() {
    let both = [path(), direct(1, 1), direct(4, 1), direct(1, 4), direct(1, 0)];
    let wide = [direct(0, 1), Settings::by_name("ptracer", Default::default()).expect("an integrator")];
    let group = Means::of_images(3 * 7, 0.02);
    for (elevation, degrees) in [(60.0, 15.0f64), (60.0, 0.2679), (0.0, 15.0)] {
        let a = degrees.to_radians();
        let projected = match elevation > 0.0 {
            true => PI * a.sin().powi(2) * f64::to_radians(elevation).sin(),
            false => a - a.sin() * a.cos(),
        };
        let radiance = Rgb::new(3.0, 2.0, 1.0) * (0.1 / projected) as f32;
        let scene = compiled(floor(direction(elevation, 40.0), a, radiance), AccelKind::default());
        let exact = radiance.to_array().map(|l| 0.5 / PI * projected * f64::from(l));
        // BSDF samples rarely hit a small disc, and light rays along the floor rarely hit the floor.
        let by_chance = match (elevation > 0.0, degrees > 1.0) {
            (true, true) => &wide[..],
            (true, false) => &wide[1..],
            (false, _) => &wide[..1],
        };
        for settings in both.iter().chain(by_chance) {
            let rendered = render(&scene, settings, SamplerKind::Sobol, 4096, 3);
            group.expect(&format!("{elevation}°, {degrees}°, {settings:?}"), &rendered, exact);
        }
    }
}

/// The sun is seen as a disc of its radiance, in addition to the environment.
#[test]
fn rays_that_leave_the_scene_see_sky_and_sun() {
    let up = Vec3::Y;
    let sun = Vec3::new(0.6, 0.8, 0.0);
    let mut description = Description::default();
    let sky = std::sync::Arc::new(Sky::new(&sky(3.0, sun, up)).expect("a sky"));
    description.emitters.push(Emitter::Sky(sky.clone()));
    let radiance = Rgb::new(30.0, 20.0, 10.0);
    description.emitters.push(Emitter::Sun { direction: sun, half_angle: 0.2, up, radiance });
    description.sensors.push(camera(DVec3::ZERO, sun.as_dvec3(), 5.0, 2));
    let scene = compiled(description, AccelKind::default());
    let rendered = render(&scene, &path(), SamplerKind::Sobol, 256, 1);
    let near = radiance + sky.eval(sun);
    let (mean, _) = crate::support::scenes::mean(&rendered);
    for (found, near) in mean.into_iter().zip(near.to_array()) {
        assert!((found / f64::from(near) - 1.0).abs() < 0.05, "{found} {near}");
    }
}

/// A ball and a wall on a floor in daylight.
fn outdoors(aperture: f64, integrator: &str) -> Folder {
    Folder::with(&format!(
        r#"<scene version="3.0.0">
  <integrator {integrator}</integrator>
  <sensor type="perspective">
    <float name="fov" value="45"/>
    <transform name="to_world"><lookat origin="0,2.5,6" target="0,0.7,0" up="0,1,0"/></transform>
    <film type="hdrfilm">
      <integer name="width" value="16"/><integer name="height" value="16"/>
      <string name="pixel_format" value="rgb"/><string name="component_format" value="float32"/>
      <rfilter type="box"/>
    </film>
  </sensor>
  <emitter type="sunsky">
    <vector name="sun_direction" value="0.5,1,0.7"/><float name="sun_aperture" value="{aperture}"/>
    <transform name="to_world"><rotate x="1" angle="-90"/></transform>
  </emitter>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="-90"/><scale value="6"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.6,0.4"/></bsdf>
  </shape>
  <shape type="cube">
    <transform name="to_world"><scale x="0.1"/><translate x="-1.5" y="1"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.8,0.3,0.2"/></bsdf>
  </shape>
  <shape type="sphere">
    <point name="center" x="0.5" y="0.8" z="0"/><float name="radius" value="0.8"/>
    <bsdf type="roughconductor"><float name="alpha" value="0.3"/></bsdf>
  </shape>
</scene>"#
    ))
}

/// Checks that two renders of an image differ only by noise.
#[track_caller]
fn agree(one: (&Folder, &str), other: (&Folder, &str)) {
    let mut seed = 0;
    let [a, b] = [one, other].map(|(folder, options)| {
        seed += 1;
        folder.render(&format!("s.xml -q -o p.exr --sampler sobol --aov variance --seed {seed} {options}"));
        read(&folder.path("p.exr")).expect("an image")
    });
    let test = z_test(&a, &b, None, 1e-5).expect("comparable");
    assert!(
        test.rejected == 0 && test.is_unbiased() && test.gain < 0.05,
        "{}; {}: {} blocks rejected (p {:.1e}), bias p {:.1e}, a bias of {} would be found",
        one.1,
        other.1,
        test.rejected,
        test.block_probability,
        test.bias_probability,
        test.gain
    );
}

/// Light paths from the sky and from the sun's disc bring the light that camera paths find.
#[test]
fn light_paths_and_camera_paths_agree_in_daylight() {
    let folder = outdoors(0.5358, r#"type="path"><integer name="max_depth" value="4"/>"#);
    agree((&folder, "--integrator path --spp 512"), (&folder, "--integrator ptracer --spp 4096"));
}

/// Each technique alone, and both together.
#[test]
fn emitter_samples_and_bsdf_samples_agree_in_daylight() {
    let direct = |emitter: u32, bsdf: u32| {
        let counts = format!(
            r#"type="direct"><integer name="emitter_samples" value="{emitter}"/><integer name="bsdf_samples" value="{bsdf}"/>"#
        );
        outdoors(30.0, &counts)
    };
    let both = direct(1, 1);
    agree((&direct(1, 0), "--spp 2048"), (&both, "--spp 512"));
    agree((&direct(0, 1), "--spp 4096"), (&both, "--spp 512"));
}
