//! Integrators with branching rays: hard shadows, specular trees of known radiance, and agreement with path tracing.

use crate::support::cli::Folder;
use crate::support::expect::{Means, combinations};
use crate::support::scenes::{add, camera, compiled, constant, diffuse, pixels, render, sphere};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::film::PixelRect;
use buffon::integrator::Settings;
use buffon::integrator::settings::{DistributionSettings, PathLimits, WhittedSettings};
use buffon::loader::{LoadOptions, load};
use buffon::material::{
    Conductor, Dielectric, Distribution, Interface, Material, Metal, RoughConductor, Roughness,
};
use buffon::math::{DAffine3, DVec3, Vec3};
use buffon::sampling::SamplerKind;
use buffon::scene::Description;
use buffon::shape::Shape;
use std::f64::consts::PI;

fn path(max_depth: u32) -> Settings {
    Settings::Path(PathLimits { max_depth: Some(max_depth), ..PathLimits::default() }.into())
}

fn whitted(max_depth: u32) -> Settings {
    Settings::Whitted(WhittedSettings { max_depth, hide_emitters: false })
}

fn distribution(max_depth: u32, emitter_samples: u32, bsdf_samples: u32) -> Settings {
    let hide_emitters = false;
    Settings::Distribution(DistributionSettings { max_depth, emitter_samples, bsdf_samples, hide_emitters })
}

fn glass() -> Material {
    let interface = Interface { int_ior: 1.5, ext_ior: 1.0, specular_reflectance: Rgb::WHITE.into() };
    Material::Dielectric(Dielectric { interface, specular_transmittance: Rgb::WHITE.into() })
}

fn metal() -> Metal {
    let [eta, k] = [Rgb::splat(0.2), Rgb::splat(3.0)];
    Metal { eta: eta.into(), k: k.into(), specular_reflectance: Rgb::new(0.9, 0.6, 0.3).into() }
}

/// Returns a plane z = 0 of reflectance 1/2, seen near the origin from below all emitters.
fn plane() -> Description {
    let mut scene = Description::default();
    add(&mut scene, Shape::Rectangle, DAffine3::from_scale(DVec3::splat(10.0)), diffuse(0.5));
    scene.sensors.push(camera(DVec3::new(0.0, 4.0, 0.4), DVec3::ZERO, 0.002, 8));
    scene
}

/// Adds an emitter of radiance 3 with its centre at `at`, facing down.
fn lamp(scene: &mut Description, shape: Shape, size: f64, at: DVec3) {
    let down = DAffine3::from_rotation_y(PI) * DAffine3::from_scale(DVec3::splat(size));
    let id = add(scene, shape, DAffine3::from_translation(at) * down, diffuse(0.0));
    scene.shapes[id].emission = Some(Rgb::splat(3.0).into());
}

/// The irradiance of every emitter is L·A·cosθ·cosθ′/d². For a sphere, A is the area of its disk and cosθ′ is 1.
#[test]
fn lamps_shine_from_their_centres() {
    let group = Means::of_images(6 * AccelKind::ALL.len(), 1e-4);
    for &accel in AccelKind::ALL {
        for at in [DVec3::new(0.0, 0.0, 2.0), DVec3::new(1.0, -0.5, 1.5)] {
            let d2 = at.length_squared();
            let cos = at.z / d2.sqrt();
            for (name, shape, area, cos_lamp) in [
                ("rectangle", Shape::Rectangle, 4.0 * 0.25, cos),
                ("disk", Shape::Disk, PI * 0.25, cos),
                ("sphere", sphere(1.0), PI * 0.25, 1.0),
            ] {
                let mut scene = plane();
                lamp(&mut scene, shape, 0.5, at);
                let rendered = render(&compiled(scene, accel), &whitted(2), SamplerKind::Sobol, 4, 1);
                let exact = 0.5 / PI * 3.0 * area * cos * cos_lamp / d2;
                group.expect(&format!("{name}, {at}, {accel}"), &rendered, [exact; 3]);
            }
        }
    }
}

/// A shape before the centre of an emitter blocks all of its light, and a shape beside the centre none. Path tracing
/// shows the penumbra.
#[test]
fn shadows_are_hard() {
    for &accel in AccelKind::ALL {
        for (x, whitted_share) in [(0.15, 1.0), (0.05, 0.0)] {
            let brightness = |settings: &Settings, with: bool| {
                let mut scene = plane();
                lamp(&mut scene, Shape::Rectangle, 0.5, DVec3::Z * 2.0);
                if with {
                    let place = DAffine3::from_translation(DVec3::new(x, 0.0, 1.0));
                    add(
                        &mut scene,
                        Shape::Disk,
                        place * DAffine3::from_scale(DVec3::splat(0.1)),
                        diffuse(0.0),
                    );
                }
                pixels(&render(&compiled(scene, accel), settings, SamplerKind::Sobol, 16, 1))[0][0]
            };
            let share = |settings: &Settings| brightness(settings, true) / brightness(settings, false);
            assert!((share(&whitted(2)) - whitted_share).abs() < 1e-6, "{accel}, disk at {x}");
            let penumbra = share(&path(2));
            assert!((0.75..0.97).contains(&penumbra), "{accel}, disk at {x}: {penumbra}");
        }
    }
}

/// The environment has no centre: it is visible, but does not light diffuse surfaces. Point emitters are exact.
#[test]
fn whitted_knows_points_and_no_environment() {
    let group = Means::of_images(3 * AccelKind::ALL.len(), 1e-4);
    for &accel in AccelKind::ALL {
        let mut scene = plane();
        scene.emitters.push(constant(1.0));
        let black = render(&compiled(scene, accel), &whitted(8), SamplerKind::Sobol, 4, 1);
        assert!(pixels(&black).iter().all(|p| *p == [0.0; 3]));
        let mut scene = plane();
        scene
            .emitters
            .push(Emitter::Point { position: Vec3::new(0.0, 0.0, 2.0), intensity: Rgb::splat(3.0) });
        let scene = compiled(scene, accel);
        for settings in [whitted(2), whitted(8), distribution(2, 2, 3)] {
            let rendered = render(&scene, &settings, SamplerKind::Sobol, 4, 1);
            group.expect(&format!("{settings:?}, {accel}"), &rendered, [0.5 / PI * 3.0 / 4.0; 3]);
        }
    }
}

/// Reflection and refraction of glass: a sphere in a constant environment is invisible, up to light with more bounces
/// inside it than the depth of the tree, and without noise.
#[test]
fn reflection_and_refraction_make_up_all_light() {
    for &accel in AccelKind::ALL {
        let mut description = Description::default();
        add(&mut description, sphere(1.0), DAffine3::IDENTITY, glass());
        description.emitters.push(constant(0.7));
        description.sensors.push(camera(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, 26.0, 12));
        let scene = compiled(description, accel);
        for settings in [whitted(14), distribution(14, 1, 1)] {
            let rendered = render(&scene, &settings, SamplerKind::Independent, 2, 1);
            for pixel in pixels(&rendered) {
                assert!((pixel[0] - 0.7).abs() < 5e-3, "{settings:?}, {accel}: {pixel:?}");
            }
        }
        // A tree that ends at the first surface has no refracted light.
        let short = pixels(&render(&scene, &whitted(2), SamplerKind::Independent, 2, 1));
        let centre = short[6 * 12 + 6][0];
        assert!((centre - 0.7 * 0.04).abs() < 2e-3, "{accel}: {centre}");
    }
}

/// A mirror reflects the lit floor with its reflectance, from depth 3 on.
#[test]
fn mirrors_show_what_stands_before_them() {
    for &accel in AccelKind::ALL {
        let picture = |max_depth: u32, mirror: bool| {
            let mut scene = plane();
            scene.emitters.push(Emitter::Point { position: Vec3::new(0.0, 2.0, 3.0), intensity: Rgb::WHITE });
            let eye = if mirror { DVec3::new(0.0, 4.0, 2.0) } else { DVec3::new(0.0, -4.0, 2.0) };
            if mirror {
                // A wall at y = 0 that faces the camera.
                let wall = DAffine3::from_rotation_x(-PI / 2.0) * DAffine3::from_scale(DVec3::splat(5.0));
                add(&mut scene, Shape::Rectangle, wall, Material::Conductor(Conductor { metal: metal() }));
            }
            // The point (0, 1, 0) or its mirror image (0, −1, 0).
            let target = DVec3::new(0.0, if mirror { -1.0 } else { 1.0 }, 0.0);
            scene.sensors[0] = camera(eye, target, 0.002, 4);
            pixels(&render(&compiled(scene, accel), &whitted(max_depth), SamplerKind::Sobol, 2, 1))[0]
        };
        let (direct, mirrored) = (picture(2, false), picture(3, true));
        assert_eq!(picture(2, true), [0.0; 3], "{accel}: the lamp behind a mirror is one edge too far");
        for (c, tint) in [0.9f64, 0.6, 0.3].into_iter().enumerate() {
            let share = mirrored[c] / (direct[c] * tint);
            assert!((0.9..1.0).contains(&share), "{accel}: {mirrored:?} of {direct:?}");
        }
    }
}

/// With Le = 1/2 and Kd = 1/2, paths of k edges contribute 2^−k.
#[test]
fn trees_sum_the_light_of_a_furnace() {
    let combinations = combinations();
    let group = Means::of_images(4 * combinations.len(), 5e-3);
    for &(accel, sampler) in &combinations {
        let mut scene = Description::default();
        let id = add(&mut scene, sphere(1.0), DAffine3::IDENTITY, diffuse(0.5));
        scene.shapes[id].emission = Some(Rgb::splat(0.5).into());
        scene.shapes[id].flip_normals = true;
        scene.sensors.push(camera(DVec3::new(0.2, 0.1, -0.3), DVec3::new(-0.3, 0.4, 0.5), 90.0, 8));
        let scene = compiled(scene, accel);
        for (settings, exact) in [
            (distribution(1, 1, 1), 0.5),
            (distribution(4, 2, 3), 0.9375),
            (distribution(3, 0, 4), 0.875),
            (distribution(6, 1, 1), 1.0 - 1.0 / 64.0),
        ] {
            let rendered = render(&scene, &settings, sampler, 32, 1);
            group.expect(&format!("{settings:?}, {sampler}, {accel}"), &rendered, [exact; 3]);
        }
    }
}

/// Returns a floor under an emitter and an environment, with a sphere above it.
fn ball_over_floor(material: Material) -> Description {
    let mut scene = Description::default();
    add(&mut scene, Shape::Rectangle, DAffine3::from_scale(DVec3::splat(5.0)), diffuse(0.6));
    lamp(&mut scene, Shape::Rectangle, 1.0, DVec3::new(0.5, 0.0, 3.0));
    add(&mut scene, sphere(0.8), DAffine3::from_translation(DVec3::Z), material);
    scene.emitters.push(constant(0.3));
    scene.sensors.push(camera(DVec3::new(0.0, 5.0, 2.0), DVec3::new(0.0, 0.0, 0.5), 30.0, 12));
    scene
}

/// Any branching has the expected value of paths with the same maximum depth.
#[test]
fn distribution_ray_tracing_is_path_tracing_in_expectation() {
    check_distribution(&[AccelKind::default()]);
}

#[test]
#[ignore = "takes long: make test-all"]
fn distribution_ray_tracing_is_path_tracing_with_every_traversal() {
    check_distribution(AccelKind::ALL);
}

fn check_distribution(accels: &[AccelKind]) {
    let rough = Material::RoughConductor(RoughConductor {
        metal: metal(),
        roughness: Roughness {
            distribution: Distribution::Ggx,
            alpha: [0.3.into(), 0.3.into()],
            sample_visible: true,
        },
    });
    let group = Means::of_images(3 * 3 * accels.len(), 0.01);
    for &accel in accels {
        for (name, material) in [("diffuse", diffuse(0.7)), ("glass", glass()), ("rough", rough.clone())] {
            let scene = compiled(ball_over_floor(material), accel);
            for (max_depth, lights, rays, spp) in [(2, 4, 3, 256), (4, 2, 2, 256), (6, 0, 2, 128)] {
                let trees =
                    render(&scene, &distribution(max_depth, lights, rays), SamplerKind::Sobol, spp, 2);
                let paths = render(&scene, &path(max_depth), SamplerKind::Sobol, 4096, 3);
                group.expect_same(&format!("{name}, depth {max_depth}, {accel}"), &trees, &paths);
            }
        }
    }
}

/// A crop has exactly the pixels of the whole image: the order of sums does not depend on the rest of the wave.
#[test]
fn crops_of_trees_are_parts_of_the_full_image() {
    let folder = Folder::new();
    let loaded = load(&folder.path("s.xml"), &LoadOptions::default()).expect("the scene loads");
    for settings in [whitted(6), distribution(4, 2, 2)] {
        let picture = |crop: Option<PixelRect>| {
            let mut description = loaded.description.clone();
            description.sensors[0].film.crop = crop;
            pixels(&render(&compiled(description, AccelKind::default()), &settings, SamplerKind::Sobol, 4, 1))
        };
        let crop = PixelRect { x: 13, y: 9, width: 11, height: 5 };
        let (full, part) = (picture(None), picture(Some(crop)));
        for (i, pixel) in part.iter().enumerate() {
            let (x, y) = (i as u32 % crop.width + crop.x, i as u32 / crop.width + crop.y);
            assert_eq!(*pixel, full[(y * 40 + x) as usize], "{settings:?}, pixel {x} {y}");
        }
    }
}

/// The command line keeps the depth of a scene if a tree supports it, and reports invalid parameters.
#[test]
fn trees_on_the_command_line() {
    let folder = Folder::new();
    for name in ["whitted", "distribution"] {
        folder.render(&format!("s.xml -o {name}.pfm -q --spp 1 --integrator {name}"));
        assert!(!folder.read(&format!("{name}.pfm")).is_empty());
    }
    let scene = |integrator: &str| {
        format!("<scene version='3.0.0'>\n{integrator}\n<sensor type='perspective'/></scene>")
    };
    for (integrator, sentence) in [
        (
            "<integrator type='whitted'><integer name='max_depth' value='-1'/></integrator>",
            "s.xml:2:28: <integer name=\"max_depth\">: expected a whole number from 1 to 20, found -1",
        ),
        (
            "<integrator type='distribution'><integer name='bsdf_samples' value='0'/></integrator>",
            "s.xml:2:33: <integer name=\"bsdf_samples\">: expected a whole number from 1 to 65536, found 0",
        ),
        (
            "<integrator type='distribution'><integer name='bsdf_samples' value='16'/><integer name='max_depth' \
             value='9'/></integrator>",
            "s.xml:2:1: <integrator type=\"distribution\">: bsdf_samples 16 at max_depth 9 are more than 1048576 rays \
             for each camera ray: expected fewer of either",
        ),
        (
            "<integrator type='distribution'><integer name='light_samples' value='2'/></integrator>",
            "s.xml:2:33: <integer name=\"light_samples\">: <integrator type=\"distribution\"> has no such property",
        ),
    ] {
        let folder = Folder::with(&scene(integrator));
        let run = folder.run("render s.xml -o out.exr --spp 1 -q --strict");
        let line = run.stderr.lines().find(|line| line.starts_with("buffon: ")).unwrap_or_default();
        assert_eq!(line, format!("buffon: {sentence}"), "{run:?}");
    }
}
