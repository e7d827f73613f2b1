//! Light in bodies of scattering media: single scattering in a ball, diffusion through a thick slab, and light in
//! bodies that seem to be sealed.
//!
//! Each group of comparisons has a significance of 1 % with fixed seeds.

use crate::media::{SIGMA, density, filled, glass, integrators, medium, volpath};
use crate::support::expect::Means;
use crate::support::quadrature::over_square;
use crate::support::scenes::{add, camera, compiled, constant, diffuse, render, sphere};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::ids::MediumId;
use buffon::integrator::Settings;
use buffon::integrator::settings::PathLimits;
use buffon::integrator::volpath::closed::are_closed;
use buffon::material::{Distribution, Interface, Material, Null, RoughDielectric, Roughness};
use buffon::math::{DAffine3, DQuat, DVec3, Vec3};
use buffon::medium::{MediumBoundary, Phase};
use buffon::sampling::SamplerKind;
use buffon::scene::Description;
use buffon::shape::Shape;
use std::f64::consts::FRAC_PI_2;

const ALBEDO: [f32; 3] = [0.9, 0.6, 0.3];

/// Light of a point emitter that a ball scatters once, by quadrature over the camera ray through its centre. The
/// emitter is outside, inside, and just inside behind the boundary.
#[test]
fn single_scattering_in_a_ball_is_its_integral() {
    let lights = [DVec3::new(1.4, 0.6, 0.8), DVec3::new(0.3, -0.2, 0.4), DVec3::new(0.0, 0.999, 0.0)];
    let phase = Phase::HenyeyGreenstein { g: 0.6 };
    let group = Means::of_images(2 * lights.len() * AccelKind::CHOICES.len(), 1e-2);
    for light in lights {
        let mut scene = Description::default();
        scene.sensors.push(camera(DVec3::Z * 3.0, DVec3::ZERO, 1e-3, 8));
        let fog = medium(&mut scene, SIGMA, ALBEDO, phase.clone());
        filled(&mut scene, sphere(1.0), DAffine3::IDENTITY, Material::Null(Null), fog);
        scene.emitters.push(Emitter::Point { position: light.as_vec3(), intensity: Rgb::splat(2.0) });
        let exact = [0, 1, 2].map(|c| {
            let (sigma, albedo) = (f64::from(SIGMA[c]), f64::from(ALBEDO[c]));
            over_square(|[x, _]| {
                let p = DVec3::Z * (1.0 - 2.0 * x);
                let to_light = light - p;
                let distance = to_light.length();
                let w = to_light / distance;
                let to_boundary = -p.dot(w) + (p.dot(w).powi(2) + 1.0 - p.length_squared()).sqrt();
                let depth = sigma * (2.0 * x + to_boundary.min(distance));
                2.0 * sigma * albedo * density(&phase, -w.z) * 2.0 * (-depth).exp() / distance.powi(2)
            })
        });
        for &accel in AccelKind::CHOICES {
            let compiled = compiled(scene.clone(), accel);
            for (integrator, settings) in integrators(Some(2)) {
                let rendered = render(&compiled, &settings, SamplerKind::Sobol, 2048, 5);
                group.expect(&format!("{light}, {accel}, {integrator}"), &rendered, exact);
            }
        }
    }
}

/// The radiance that a thick slab without absorption transmits along its normal, if its other side is lit by the
/// radiance 1 from all directions. The hemispherical transmittance is 4/3 / (τ + 2·0.710446), the directions are those
/// of Milne's problem, (√3/4)·H(1) with H(1) = 2.9078 [Chandrasekhar 1960, 3.25 and table XI]. Both are exact but for
/// terms like e^−τ.
#[test]
fn light_diffuses_through_a_thick_slab() {
    // Roulette would only make the few paths that get through heavier.
    let settings = Settings::Volpath(PathLimits { max_depth: None, rr_depth: 1000, ..PathLimits::default() });
    let depths = [5.0, 10.0];
    let group = Means::of_images(depths.len() * AccelKind::CHOICES.len(), 2e-2);
    for depth in depths {
        let mut scene = Description::default();
        scene.sensors.push(camera(DVec3::Z * 3.0, DVec3::ZERO, 1e-3, 8));
        let fog = medium(&mut scene, [depth; 3], [1.0; 3], Phase::Isotropic);
        let placed = |scale: DVec3, z: f64| {
            DAffine3::from_scale_rotation_translation(scale, DQuat::IDENTITY, DVec3::Z * z)
        };
        let slab = placed(DVec3::new(1e3, 1e3, 0.5), 0.5);
        filled(&mut scene, Shape::Cube, slab, Material::Null(Null), fog);
        let below = placed(DVec3::splat(1e3), -1e-3);
        let lamp = add(&mut scene, Shape::Rectangle, below, diffuse(0.0));
        scene.shapes[lamp].emission = Some(Rgb::WHITE.into());
        let transmittance = 4.0 / 3.0 / (f64::from(depth) + 2.0 * 0.710446);
        let exact = 3f64.sqrt() / 4.0 * 2.9078 * transmittance;
        for &accel in AccelKind::CHOICES {
            let rendered = render(&compiled(scene.clone(), accel), &settings, SamplerKind::Sobol, 1024, 7);
            group.expect(&format!("{depth}, {accel}"), &rendered, [exact; 3]);
        }
    }
}

/// Renders a scene as it is, and with a surface far away that shows that the fog is not sealed, and expects the same
/// light.
fn expect_the_same_unsealed(
    group: Means,
    name: &str,
    scene: &Description,
    (fog, depth): (MediumId, Option<u32>),
) {
    let mut open = scene.clone();
    let far = add(&mut open, sphere(1e-3), DAffine3::from_translation(DVec3::X * -50.0), diffuse(0.0));
    open.shapes[far].boundary = MediumBoundary { interior: None, exterior: Some(fog) };
    for &accel in AccelKind::CHOICES {
        let [sealed, open] = [(scene, 1), (&open, 2)].map(|(scene, seed)| {
            render(&compiled(scene.clone(), accel), &volpath(depth), SamplerKind::Sobol, 1024, seed)
        });
        group.expect_same(&format!("{name}, {accel}"), &sealed, &open);
    }
}

/// Light reaches fog behind glass on straight lines from a lamp inside, and through a hole from the sky.
#[test]
fn light_in_fog_that_seems_sealed_is_not_lost() {
    let far_emitters = [
        ("directional", Emitter::Directional { direction: -Vec3::Y, irradiance: Rgb::splat(3.0) }),
        (
            "wide sun",
            Emitter::Sun { direction: Vec3::Y, half_angle: 0.7, up: Vec3::Y, radiance: Rgb::splat(2.0) },
        ),
    ];
    let group = Means::of_images((1 + far_emitters.len()) * AccelKind::CHOICES.len(), 2e-2);
    let start = |shape: Shape| {
        let mut scene = Description::default();
        scene.sensors.push(camera(DVec3::new(0.5, 0.6, 4.0), DVec3::ZERO, 30.0, 12));
        let fog = medium(&mut scene, SIGMA, ALBEDO, Phase::Isotropic);
        filled(&mut scene, shape, DAffine3::IDENTITY, glass(1.3), fog);
        (scene, fog)
    };
    let (mut scene, fog) = start(sphere(1.0));
    let inside = DAffine3::from_translation(DVec3::new(0.2, 0.3, 0.0));
    let lamp = add(&mut scene, sphere(0.25), inside, diffuse(0.0));
    scene.shapes[lamp].emission = Some(Rgb::splat(5.0).into());
    expect_the_same_unsealed(group, "lamp inside", &scene, (fog, Some(8)));
    for (name, emitter) in far_emitters {
        let (mut scene, fog) = start(Shape::Cylinder { p0: -Vec3::Y, p1: Vec3::Y, radius: 1.0 });
        // The disk does not name the fog below it. Above it is vacuum.
        let clear = medium(&mut scene, [1e-3; 3], [0.0; 3], Phase::Isotropic);
        let up = DAffine3::from_translation(DVec3::Y) * DAffine3::from_rotation_x(-FRAC_PI_2);
        filled(&mut scene, Shape::Disk, up, Material::Null(Null), clear);
        scene.emitters.push(emitter);
        expect_the_same_unsealed(group, name, &scene, (fog, Some(8)));
    }
}

/// Media that fill closed bodies are rendered by code of their own: the light is the same as in other media. The bodies
/// are balls of glass, smooth or rough, also with a body and a diffuse ball inside, and a cylinder with lids. An open
/// cylinder is no closed body. A lamp and the sky light them.
#[test]
fn media_in_bodies_scatter_as_others() {
    let phases = [Phase::Isotropic, Phase::HenyeyGreenstein { g: 0.8 }, Phase::HenyeyGreenstein { g: -0.6 }];
    let roughness =
        Roughness { distribution: Distribution::Ggx, alpha: [0.3.into(); 2], sample_visible: true };
    let rough = Material::RoughDielectric(RoughDielectric {
        interface: Interface { int_ior: 1.4, ext_ior: 1.0, specular_reflectance: Rgb::WHITE.into() },
        specular_transmittance: Rgb::WHITE.into(),
        roughness,
    });
    let ball = || sphere(1.0);
    let tube = || Shape::Cylinder { p0: -Vec3::Y, p1: Vec3::Y, radius: 1.0 };
    let cases = [
        ("clear", ball(), glass(1.3), ALBEDO.map(|_| 0.0), 0, None),
        ("isotropic", ball(), glass(1.3), ALBEDO, 0, Some(8)),
        ("forward", ball(), rough.clone(), ALBEDO, 1, Some(8)),
        ("backward", ball(), glass(1.5), [1.0, 0.99, 0.9], 2, None),
        ("short", ball(), rough, ALBEDO, 1, Some(3)),
        ("open", tube(), glass(1.1), ALBEDO, 0, Some(5)),
        ("lids", tube(), glass(1.1), ALBEDO, 0, Some(5)),
    ];
    let group = Means::of_images(2 * cases.len() * AccelKind::CHOICES.len(), 3e-2);
    for (name, shape, material, albedo, phase, depth) in cases {
        for inside in [false, true] {
            let mut scene = Description { emitters: vec![constant(0.5)], ..Description::default() };
            scene.sensors.push(camera(DVec3::new(0.5, 1.6, 4.0), DVec3::ZERO, 30.0, 12));
            let fog = medium(&mut scene, SIGMA, albedo, phases[phase].clone());
            filled(&mut scene, shape.clone(), DAffine3::IDENTITY, material.clone(), fog);
            for side in [1.0, -1.0].into_iter().filter(|_| name == "lids") {
                let outwards = DAffine3::from_rotation_x(-side * FRAC_PI_2);
                let at = DAffine3::from_translation(DVec3::Y * side) * outwards;
                filled(&mut scene, Shape::Disk, at, material.clone(), fog);
            }
            let above = DAffine3::from_translation(DVec3::Y * 3.0);
            let lamp = add(&mut scene, sphere(0.7), above, diffuse(0.0));
            scene.shapes[lamp].emission = Some(Rgb::splat(4.0).into());
            if inside {
                add(&mut scene, sphere(0.3), DAffine3::from_translation(DVec3::X * 0.4), diffuse(0.7));
                let other = medium(&mut scene, [3.0; 3], [0.9; 3], Phase::Isotropic);
                let at = DAffine3::from_translation(DVec3::X * -0.4);
                filled(&mut scene, sphere(0.3), at, glass(1.2), other);
            }
            let compiled = compiled(scene.clone(), AccelKind::Auto);
            assert!(compiled.media.as_ref().is_some_and(|media| media.fill_bodies()), "{name}");
            assert_eq!(are_closed(&compiled), name != "open", "{name}, {inside}");
            expect_the_same_unsealed(group, &format!("{name}, {inside}"), &scene, (fog, depth));
        }
    }
}
