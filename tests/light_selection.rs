//! The choice of an emitter for a surface point.

use crate::support::expect::Means;
use crate::support::scenes;
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::{ChoiceX16, Emitter, Gloss, GlossX16, Receiver, ReceiverX16};
use buffon::integrator::Settings;
use buffon::integrator::settings::DirectSettings;
use buffon::math::{DAffine3, DVec3, LANES, Vec2, Vec3, Vec3x16, f32x16};
use buffon::sampling::SamplerKind;
use buffon::scene::{Description, Scene};
use buffon::shape::Shape;
use glam::{DQuat, EulerRot};

/// A number in [0, 1) from an index, the same in every run.
fn number(i: usize, k: usize) -> f64 {
    ((i as f64 + 1.0) * [0.754_877_666, 0.569_840_291, 0.430_159_709, 0.618_033_989][k % 4] + 0.37 * k as f64)
        .fract()
}

fn position(i: usize) -> DVec3 {
    DVec3::new(number(i, 0), number(i, 1), number(i, 2)) * 8.0 - 4.0
}

/// A scene with `count` emitters of all kinds that have a place, and with light from infinity if wanted.
fn scene(count: usize, infinite: bool) -> Scene {
    let mut description = Description::default();
    scenes::add(
        &mut description,
        Shape::Rectangle,
        DAffine3::from_translation(DVec3::Z * -9.0),
        scenes::diffuse(0.5),
    );
    for i in 0..count {
        let turn = DQuat::from_euler(EulerRot::XYZ, 6.0 * number(i, 3), 6.0 * number(i, 1), 0.0);
        let to_world = DAffine3::from_rotation_translation(turn, position(i));
        let intensity = Rgb::splat(10f32.powf(3.0 * number(i, 2) as f32));
        let shape = match i % 7 {
            0 => Shape::Rectangle,
            1 => scenes::sphere(0.3),
            2 => Shape::Disk,
            3 => Shape::Cylinder { p0: Vec3::ZERO, p1: Vec3::X, radius: 0.2 },
            4 => Shape::Cube,
            5 => {
                description.emitters.push(Emitter::Point { position: position(i).as_vec3(), intensity });
                continue;
            }
            _ => {
                let (cutoff_angle, beam_width) = (0.2 + number(i, 0) as f32, 0.2);
                description.emitters.push(Emitter::Spot {
                    to_world,
                    intensity,
                    texture: None,
                    cutoff_angle,
                    beam_width,
                });
                continue;
            }
        };
        let id = scenes::add(&mut description, shape, to_world, scenes::diffuse(0.5));
        description.shapes[id].emission = Some(intensity.into());
    }
    if infinite {
        description.emitters.push(scenes::constant(0.4));
        let irradiance = Rgb::splat(2.0);
        description.emitters.push(Emitter::Directional { direction: Vec3::NEG_Z, irradiance });
    }
    scenes::compiled(description, AccelKind::default())
}

/// The probabilities of all emitters sum to 1, and each is the fraction of the random numbers that select the
/// emitter, for one point at a time and for sixteen.
#[test]
fn emitters_are_chosen_with_their_probabilities() {
    const NUMBERS: usize = 1 << 14;
    for (count, infinite) in
        [(1, false), (2, false), (14, true), (16, false), (17, false), (300, true), (0, true)]
    {
        let scene = scene(count, infinite);
        let emitters = scene.lights.len();
        for (selection, point) in std::iter::once(&scene.light_selection)
            .chain(&scene.compensated_selection)
            .flat_map(|s| (0..10).map(move |p| (s, p)))
        {
            // Every other point has a glossy lobe.
            let gloss = Gloss {
                axis: position(2000 + point).as_vec3().normalize(),
                width_squared: 10f32.powi(-(point as i32)),
                share: (point % 2) as f32 * 0.9,
            };
            let p = Receiver { p: position(1000 + point).as_vec3(), gloss };
            let pmf: Vec<f64> = (0..emitters).map(|i| f64::from(selection.pmf(i, p))).collect();
            let sum: f64 = pmf.iter().sum();
            assert!((sum - 1.0).abs() < 1e-6, "{count} emitters: the probabilities sum to {sum}");
            let (mut alone, mut in_lanes, mut rests) =
                (vec![0; emitters], vec![0; emitters], vec![0.0; emitters]);
            for first in (0..NUMBERS).step_by(LANES) {
                let u: [f32; LANES] =
                    std::array::from_fn(|lane| ((first + lane) as f32 + 0.5) / NUMBERS as f32);
                let ChoiceX16 { emitters: chosen, pmf: probability, u: rest } =
                    selection.sample_x16(&ReceiverX16::splat(p), f32x16::new(u), 0xffff).expect("emitters");
                for (lane, u) in u.into_iter().enumerate() {
                    let choice = selection.sample(p, u).expect("there are emitters");
                    assert!((f64::from(choice.pmf) / pmf[choice.emitter] - 1.0).abs() < 1e-5);
                    let rest = rest.as_array()[lane];
                    assert!(
                        (0.0..1.0).contains(&choice.u) && (0.0..1.0).contains(&rest),
                        "{rest} {}",
                        choice.u
                    );
                    rests[choice.emitter] += f64::from(choice.u);
                    assert!((f64::from(probability.as_array()[lane]) / pmf[chosen[lane]] - 1.0).abs() < 1e-4);
                    alone[choice.emitter] += 1;
                    in_lanes[chosen[lane]] += 1;
                }
            }
            for (i, n) in alone.iter().enumerate().filter(|(_, n)| **n > 100) {
                let mean = rests[i] / f64::from(*n);
                assert!(
                    (mean - 0.5).abs() < 0.02,
                    "{count} emitters: the rest for emitter {i} has the mean {mean}"
                );
            }
            for (drawn, what) in [(alone, "alone"), (in_lanes, "in lanes")] {
                for (i, (n, p)) in drawn.iter().zip(&pmf).enumerate() {
                    // An emitter has two intervals of the random numbers, each with two ends.
                    let expected = p * NUMBERS as f64;
                    assert!(
                        (f64::from(*n) - expected).abs() < 4.0,
                        "{count} emitters, {what}: emitter {i} was drawn {n} times instead of {expected}"
                    );
                }
            }
        }
    }
}

/// Points with a lobe beside points without one have the probabilities of each point alone.
#[test]
fn lobes_of_other_lanes_do_not_matter() {
    for (count, infinite) in [(2, false), (14, true), (40, true)] {
        let scene = scene(count, infinite);
        let mut p = Vec3x16::default();
        (0..LANES).for_each(|i| p.set_lane(i, position(3000 + i).as_vec3()));
        let gloss = GlossX16::of_lanes(0xffff, |i| match i % 3 {
            0 => Gloss::NONE,
            _ => Gloss { axis: Vec3::Y, width_squared: 0.01 * i as f32, share: 0.7 },
        });
        let from = ReceiverX16 { p, gloss };
        for emitter in 0..scene.lights.len() {
            let all = scene.light_selection.pmf_x16(emitter, &from, LANES);
            for (i, pmf) in all.to_array().into_iter().enumerate() {
                let alone = scene.light_selection.pmf(emitter, from.lane(i));
                assert!(
                    (pmf / alone - 1.0).abs() < 1e-5,
                    "emitter {emitter}, lane {i}: {pmf}, alone {alone}"
                );
            }
        }
    }
}

/// A uniform environment is not sampled beside BSDF samples. If there is nothing else, there are no emitter samples.
#[test]
fn uniform_environments_are_left_to_bsdf_samples() {
    let scene = scene(3, true);
    let environment = scene.environment.expect("an environment").index();
    let p = position(1).as_vec3();
    assert!(scene.light_selection.pmf(environment, p) > 0.0);
    let compensated = scene.compensated_selection.expect("another selection");
    assert_eq!(compensated.pmf(environment, p), 0.0);
    let mut description = Description::default();
    scenes::add(&mut description, Shape::Rectangle, DAffine3::IDENTITY, scenes::diffuse(0.5));
    description.emitters.push(scenes::constant(0.4));
    let alone = scenes::compiled(description, AccelKind::default());
    let compensated = alone.compensated_selection.expect("another selection");
    assert!(!alone.light_selection.is_empty() && compensated.is_empty());
    assert_eq!(compensated.sample(p, 0.5), None);
}

/// An emitter that illuminates a point has more than its equal share of the few samples that are distributed equally:
/// the bounds of its light contain the point.
#[test]
fn no_emitter_is_thought_dark_where_it_shines() {
    for count in [14, 15, 400] {
        let scene = scene(count, true);
        let equal = 1.0 / 16.0 / scene.lights.len() as f32;
        let mut lit = 0;
        for point in 0..300 {
            let p = position(5000 + point).as_vec3();
            for (i, light) in scene.lights.iter().enumerate() {
                let shines = (0..16).any(|k| {
                    let u = Vec2::new(number(k, 0) as f32, number(k, 1) as f32);
                    light.sample(p, u, 0.0).is_some_and(|s| !s.radiance.is_black() && s.pdf > 0.0)
                });
                lit += usize::from(shines);
                let pmf = scene.light_selection.pmf(i, p);
                assert!(
                    !shines || pmf > equal,
                    "emitter {i} ({}) at {p} has probability {pmf}",
                    light.kind()
                );
            }
        }
        assert!(
            lit > 300 * scene.lights.len() / 4,
            "{lit} pairs of a point and an emitter that illuminates it"
        );
    }
}

/// Returns the relative standard deviation of a pixel's mean between seeds.
fn deviation(scene: &Scene, samples: u64) -> f64 {
    let settings = Settings::Direct(DirectSettings { bsdf_samples: 0, ..DirectSettings::default() });
    let images: Vec<Vec<f64>> = (0..4)
        .map(|seed| scenes::render(scene, &settings, SamplerKind::Independent, samples, seed))
        .map(|rendered| scenes::pixels(&rendered).into_iter().map(|p| p[1]).collect())
        .collect();
    let pixels = images[0].len();
    let relative = (0..pixels).map(|i| {
        let mean = images.iter().map(|image| image[i]).sum::<f64>() / 4.0;
        images.iter().map(|image| (image[i] / mean - 1.0).powi(2)).sum::<f64>() / 3.0
    });
    (relative.sum::<f64>() / pixels as f64).sqrt()
}

/// A wall that a spot lights by a hundred times the light of a weak sky, although the sky has far more power.
#[test]
fn a_spot_is_not_lost_under_a_sky() {
    let mut description = Description::default();
    let wall = DAffine3::from_scale(DVec3::splat(50.0));
    scenes::add(&mut description, Shape::Rectangle, wall, scenes::diffuse(0.5));
    let to_world =
        DAffine3::from_rotation_translation(DQuat::from_rotation_x(std::f64::consts::PI), DVec3::Z * 1.0);
    description.emitters = vec![
        Emitter::Spot {
            to_world,
            intensity: Rgb::splat(5.0),
            texture: None,
            cutoff_angle: 1.0,
            beam_width: 0.9,
        },
        scenes::constant(0.1),
    ];
    description.sensors.push(scenes::camera(DVec3::Z * 2.0, DVec3::ZERO, 20.0, 16));
    let deviation = deviation(&scenes::compiled(description, AccelKind::default()), 64);
    println!("relative standard deviation with 64 samples: {deviation:.4}");
    // By power alone it is 4.
    assert!(deviation < 0.1, "{deviation}");
}

/// A floor under a field of small lamps: with a hundred times as many lamps of a hundredth of the intensity, the error
/// is at most half again as large.
#[test]
fn ten_thousand_lamps_are_as_good_as_a_hundred() {
    let floor = |side: usize| {
        let mut description = Description::default();
        scenes::add(
            &mut description,
            Shape::Rectangle,
            DAffine3::from_scale(DVec3::splat(20.0)),
            scenes::diffuse(0.5),
        );
        let each = Rgb::splat(100.0 / (side * side) as f32);
        for i in 0..side * side {
            let at = |k: usize| 20.0 * ((k as f32 + 0.5) / side as f32) - 10.0;
            let position = Vec3::new(at(i % side), at(i / side), 0.5);
            description.emitters.push(Emitter::Point { position, intensity: each });
        }
        description.sensors.push(scenes::camera(DVec3::Z * 10.0, DVec3::ZERO, 60.0, 12));
        deviation(&scenes::compiled(description, AccelKind::default()), 64)
    };
    let (few, many) = (floor(10), floor(100));
    println!("relative standard deviation with 64 samples: {few:.4} for 100 lamps, {many:.4} for 10,000");
    assert!(many < 1.5 * few, "{many} beside {few}");
}

/// A room whose wall is exactly the sphere around an emitter. Its points are inside or outside of the sphere by a
/// rounding error, and so is the origin of a ray that leaves the wall: emitter samples and BSDF samples must agree.
#[test]
fn a_wall_on_the_sphere_around_an_emitter_gets_its_light_once() {
    let mut description = Description::default();
    let wall = scenes::add(&mut description, scenes::sphere(1.0), DAffine3::IDENTITY, scenes::diffuse(0.5));
    description.shapes[wall].flip_normals = true;
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let small = DAffine3::from_translation(DVec3::Z * 0.5) * DAffine3::from_scale(DVec3::splat(0.1));
    for (to_world, radiance) in [(DAffine3::from_scale(DVec3::splat(half)), 1.0), (small, 5.0)] {
        let id = scenes::add(&mut description, Shape::Rectangle, to_world, scenes::diffuse(0.0));
        description.shapes[id].emission = Some(Rgb::splat(radiance).into());
    }
    description.sensors.push(scenes::camera(DVec3::Z * 0.6, DVec3::new(0.6, 0.3, 0.8), 60.0, 8));
    let scene = scenes::compiled(description, AccelKind::default());
    let render = |emitter_samples, bsdf_samples| {
        let direct = DirectSettings { emitter_samples, bsdf_samples, hide_emitters: true };
        scenes::render(&scene, &Settings::Direct(direct), SamplerKind::Independent, 2048, 3)
    };
    let group = Means::of_images(2, 0.02);
    let emitter = render(1, 0);
    group.expect_same("BSDF samples", &emitter, &render(0, 1));
    group.expect_same("both", &emitter, &render(1, 1));
}

/// Few and many emitters whose irradiance is near the least number: none of the light is lost.
#[test]
fn irradiance_near_the_least_number_is_kept() {
    for count in [2, 17] {
        let mut description = Description::default();
        scenes::add(&mut description, Shape::Rectangle, DAffine3::IDENTITY, scenes::diffuse(0.5));
        let (position, intensity) = (Vec3::Z * 1e5, Rgb::splat(1e-30));
        description.emitters = vec![Emitter::Point { position, intensity }; count];
        let scene = scenes::compiled(description, AccelKind::default());
        let choices =
            scene.light_selection.sample_x16(&Vec3x16::default().into(), f32x16::splat(0.5), 0xffff);
        let pmf = choices.expect("emitters").pmf.as_array()[0];
        assert!((pmf * count as f32 - 1.0).abs() < 1e-3, "{pmf}");
    }
}
