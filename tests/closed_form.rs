//! Scenes of known radiance: integrators × samplers × traversals.

use crate::support::expect::{Means, combinations};
use crate::support::scenes::{add, camera, compiled, constant, diffuse, render, sphere};
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::integrator::Settings;
use buffon::integrator::settings::{AoSettings, DirectSettings, PathLimits};
use buffon::material::{Diffuse, Material};
use buffon::math::{DAffine3, DVec3, Vec3};
use buffon::scene::Description;
use buffon::shape::{Mesh, Shape};
use std::f64::consts::PI;

/// Returns the settings of a path integrator with a maximum depth and a first depth of roulette.
fn path(max_depth: Option<u32>, rr_depth: u32) -> Settings {
    Settings::Path(PathLimits { max_depth, rr_depth, hide_emitters: false }.into())
}

fn direct(emitter_samples: u32, bsdf_samples: u32) -> Settings {
    Settings::Direct(DirectSettings { emitter_samples, bsdf_samples, hide_emitters: false })
}

/// Returns settings of direct light with different numbers of samples, each technique alone and both together.
fn direct_settings() -> [Settings; 5] {
    [direct(1, 1), direct(4, 1), direct(1, 4), direct(1, 0), direct(0, 1)]
}

/// Returns whether an integrator samples no emitters, which gives more noise.
fn by_chance(settings: &Settings) -> bool {
    matches!(settings, Settings::Direct(DirectSettings { emitter_samples: 0, .. }))
}

/// Returns a closed surface that emits and reflects, with the camera inside.
fn furnace(shape: Shape, albedo: Rgb, emission: f32) -> Description {
    let mut scene = Description::default();
    let id =
        add(&mut scene, shape, DAffine3::IDENTITY, Material::Diffuse(Diffuse { reflectance: albedo.into() }));
    scene.shapes[id].emission = Some(Rgb::splat(emission).into());
    scene.shapes[id].flip_normals = true;
    scene.sensors.push(camera(DVec3::new(0.2, 0.1, -0.3), DVec3::new(-0.3, 0.4, 0.5), 90.0, 12));
    scene
}

/// With Le = 1/2 and Kd = 1/2, paths of k edges contribute 2^−k and the radiance is 1.
#[test]
fn a_half_grey_and_half_bright_sphere_is_one_everywhere() {
    let combinations = combinations();
    let group = Means::of_images(4 * combinations.len(), 5e-3);
    for &(accel, sampler) in &combinations {
        let scene = compiled(furnace(sphere(1.0), Rgb::splat(0.5), 0.5), accel);
        for (settings, exact) in
            [(path(None, 5), 1.0), (path(Some(1), 5), 0.5), (path(Some(4), 1), 0.9375), (direct(1, 1), 0.75)]
        {
            let name = format!("{settings:?}, {sampler}, {accel}");
            let rendered = render(&scene, &settings, sampler, 128, 1);
            group.expect(&name, &rendered, [exact; 3]);
            // Every pixel has this value, not only the mean.
            for tile in &rendered.tiles {
                for i in 0..tile.pixel_count() {
                    let pixel = tile.estimate(i, 0).mean;
                    assert!((pixel - exact).abs() < 0.35, "{name}: pixel {:?} is {pixel}", tile.position(i));
                }
            }
        }
    }
}

/// With emission 1 and albedo a, the radiance is 1/(1 − a).
#[test]
fn furnaces_multiply_light_by_bouncing() {
    let albedo = Rgb::new(0.1, 0.5, 0.9);
    let exact = [1.0 / 0.9, 2.0, 10.0];
    let combinations = combinations();
    let group = Means::of_images(2 * combinations.len(), 6e-3);
    for &(accel, sampler) in &combinations {
        for (shape, name) in [(sphere(1.0), "sphere"), (Shape::Cube, "cube")] {
            let scene = compiled(furnace(shape, albedo, 1.0), accel);
            let rendered = render(&scene, &path(None, 5), sampler, 256, 2);
            group.expect(&format!("{name}, {sampler}, {accel}"), &rendered, exact);
        }
    }
}

/// Light of at most two edges in a furnace is 1 + a by every technique.
#[test]
fn direct_light_in_a_furnace_bounces_once() {
    let albedo = Rgb::new(0.1, 0.5, 0.9);
    let combinations = combinations();
    let group = Means::of_images(6 * combinations.len(), 5e-3);
    for &(accel, sampler) in &combinations {
        let scene = compiled(furnace(sphere(1.0), albedo, 1.0), accel);
        for settings in direct_settings().into_iter().chain([path(Some(2), 5)]) {
            let rendered = render(&scene, &settings, sampler, 128, 7);
            group.expect(&format!("{settings:?}, {sampler}, {accel}"), &rendered, [1.1, 1.5, 1.9]);
        }
    }
}

/// Roulette from the first bounce, late or never gives the same finite sum of paths of at most 20 edges.
#[test]
fn roulette_does_not_change_the_mean() {
    let albedo = [0.1, 0.5, 0.9];
    let exact = albedo.map(|a: f64| (1.0 - a.powi(20)) / (1.0 - a));
    let combinations = combinations();
    let group = Means::of_images(3 * combinations.len(), 6e-3);
    for &(accel, sampler) in &combinations {
        let scene = compiled(furnace(sphere(1.0), Rgb::new(0.1, 0.5, 0.9), 1.0), accel);
        for rr_depth in [1, 8, u32::MAX] {
            let rendered = render(&scene, &path(Some(20), rr_depth), sampler, 256, 3);
            group.expect(&format!("rr_depth {rr_depth}, {sampler}, {accel}"), &rendered, exact);
        }
    }
}

/// The reflectance of the plane z = 0.
const RHO: [f32; 3] = [0.2, 0.5, 0.8];

/// Returns the plane z = 0 seen from below all emitters, in a view so narrow that the origin is the only receiver.
fn plane() -> Description {
    let mut scene = Description::default();
    let [r, g, b] = RHO;
    let material = Material::Diffuse(Diffuse { reflectance: Rgb::new(r, g, b).into() });
    add(&mut scene, Shape::Rectangle, DAffine3::from_scale(DVec3::splat(10.0)), material);
    scene.sensors.push(camera(DVec3::new(0.0, 4.0, 0.4), DVec3::ZERO, 0.002, 8));
    scene
}

/// Returns the radiance of the plane for an irradiance.
fn reflected(irradiance: f64) -> [f64; 3] {
    RHO.map(|rho| f64::from(rho) / PI * irradiance)
}

/// The irradiance of a point light is I·cosθ/d², and zero from below.
#[test]
fn point_lights_fall_off_with_distance_and_angle() {
    let combinations = combinations();
    let group = Means::of_images(8 * combinations.len(), 1e-4);
    for &(accel, sampler) in &combinations {
        for position in [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [-3.0, 1.0, 0.2], [0.0, 0.0, -1.0]] {
            let mut description = plane();
            let position = Vec3::from(position);
            description.emitters.push(Emitter::Point { position, intensity: Rgb::splat(7.0) });
            let scene = compiled(description, accel);
            let to = position.as_dvec3();
            let exact = reflected(7.0 * to.z.max(0.0) / to.length().powi(3));
            for settings in [path(None, 5), direct(1, 1)] {
                let rendered = render(&scene, &settings, sampler, 4, 4);
                group.expect(&format!("{position}, {settings:?}, {sampler}, {accel}"), &rendered, exact);
            }
        }
    }
}

/// The name of an area emitter, its shape and transformation, and the irradiance at the origin for a radiance of 1.
type AreaLight = (&'static str, Shape, DAffine3, f64);

/// Returns the form factor between an element and a parallel rectangle at the distance 1, with one corner of the
/// rectangle on the element's normal. [Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-3]
fn rectangle_factor(x: f64, y: f64) -> f64 {
    let (p, q) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    (x / p * (y / p).atan() + y / q * (x / q).atan()) / (2.0 * PI)
}

fn area_lights() -> Vec<AreaLight> {
    let down = DAffine3::from_rotation_y(PI);
    let at = |x: f64, z: f64| DAffine3::from_translation(DVec3::new(x, 0.0, z));
    let scaled = |x: f64, y: f64| DAffine3::from_scale(DVec3::new(x, y, 1.0));
    let centred = 4.0 * rectangle_factor(0.7 / 1.5, 0.4 / 1.5);
    // The rectangle 0.6 < x < 1.4, −0.4 < y < 0.4.
    let aside = 2.0 * (rectangle_factor(1.4 / 1.2, 0.4 / 1.2) - rectangle_factor(0.6 / 1.2, 0.4 / 1.2));
    let far = 4.0 * rectangle_factor(1.0 / 6.0, 0.5 / 6.0);
    let square = |x: f32, y: f32| Vec3::new(x * 0.7, y * 0.4, 1.5);
    let mesh = Mesh {
        positions: vec![square(-1.0, -1.0), square(-1.0, 1.0), square(1.0, 1.0), square(1.0, -1.0)],
        indices: vec![[0, 1, 2], [2, 3, 0]],
        ..Mesh::default()
    };
    let offset = DVec3::new(1.0, 0.0, 2.0);
    vec![
        ("sphere above", sphere(0.5), at(0.0, 1.5), PI * (0.5f64 / 1.5).powi(2)),
        ("sphere nearby", sphere(1.0), at(0.0, 1.01), PI / 1.01f64.powi(2)),
        (
            "sphere aside",
            sphere(0.5),
            at(1.0, 2.0),
            PI * 0.25 / offset.length_squared() * offset.z / offset.length(),
        ),
        ("rectangle above", Shape::Rectangle, at(0.0, 1.5) * down * scaled(0.7, 0.4), PI * centred),
        ("rectangle aside", Shape::Rectangle, at(1.0, 1.2) * down * scaled(0.4, 0.4), PI * aside),
        ("rectangle afar", Shape::Rectangle, at(0.0, 6.0) * down * scaled(1.0, 0.5), PI * far),
        ("two triangles", Shape::Mesh(mesh), DAffine3::IDENTITY, PI * centred),
        ("disk", Shape::Disk, at(0.0, 0.8) * down * scaled(0.6, 0.6), PI * 0.36 / (0.64 + 0.36)),
    ]
}

/// Each kind of area emitter gives its irradiance by every sampling technique.
#[test]
fn area_lights_have_their_form_factors() {
    let (combinations, lights) = (combinations(), area_lights());
    let group = Means::of_images(7 * lights.len() * combinations.len(), 0.02);
    for &(accel, sampler) in &combinations {
        for (name, shape, to_world, irradiance) in &lights {
            let mut description = plane();
            let id = add(&mut description, shape.clone(), *to_world, diffuse(0.0));
            description.shapes[id].emission = Some(Rgb::splat(3.0).into());
            let scene = compiled(description, accel);
            for settings in direct_settings().into_iter().chain([path(Some(2), 5), path(None, 5)]) {
                // BSDF sampling hits a small emitter rarely.
                let spp = if by_chance(&settings) { 512 + (256.0 / irradiance) as u64 } else { 128 };
                let rendered = render(&scene, &settings, sampler, spp, 5);
                let name = format!("{name}, {settings:?}, {sampler}, {accel}");
                group.expect(&name, &rendered, reflected(3.0 * irradiance));
            }
        }
    }
}

/// A convex object reflects ρL in a constant environment L.
#[test]
fn convex_diffuse_objects_show_their_reflectance_of_the_environment() {
    let combinations = combinations();
    let group = Means::of_images(2 * 6 * combinations.len(), 0.02);
    for &(accel, sampler) in &combinations {
        for (shape, name) in [(sphere(1.0), "sphere"), (Shape::Cube, "cube")] {
            let mut description = Description::default();
            let [r, g, b] = RHO;
            let material = Material::Diffuse(Diffuse { reflectance: Rgb::new(r, g, b).into() });
            add(&mut description, shape, DAffine3::IDENTITY, material);
            description.emitters.push(constant(2.0));
            description.sensors.push(camera(DVec3::new(2.0, 3.0, 4.0), DVec3::ZERO, 15.0, 8));
            let scene = compiled(description, accel);
            for settings in direct_settings().into_iter().chain([path(None, 5)]) {
                let rendered = render(&scene, &settings, sampler, 256, 6);
                let name = format!("{name}, {settings:?}, {sampler}, {accel}");
                group.expect(&name, &rendered, RHO.map(|rho| 2.0 * f64::from(rho)));
            }
        }
    }
}

/// A flat wall at the distance 2 from a camera with its near plane at 1e-4.
#[test]
fn the_depth_integrator_shows_the_distance_from_the_near_plane() {
    let combinations = combinations();
    let group = Means::of_images(combinations.len(), 1e-4);
    for &(accel, sampler) in &combinations {
        let mut description = Description::default();
        add(&mut description, Shape::Rectangle, DAffine3::IDENTITY, diffuse(0.5));
        description.sensors.push(camera(DVec3::new(0.3, 0.1, 2.0), DVec3::new(0.3, 0.1, 0.0), 0.02, 4));
        let rendered = render(
            &compiled(description, accel),
            &Settings::by_name("depth", Default::default()).unwrap(),
            sampler,
            4,
            8,
        );
        group.expect(&format!("{sampler}, {accel}"), &rendered, [2.0 - 1e-4; 3]);
    }
}

/// A floor below a parallel ceiling at the distance 1 and, apart from it, below a sphere. Rays with a cosine above 1/r
/// reach the ceiling within a distance r, so the open fraction is 1/r². The sphere of radius 1 at the distance 2 covers
/// the fraction (1/2)². The floor is seen from above and, as the other side of a rectangle, from below.
#[test]
fn ambient_occlusion_is_the_open_fraction_of_the_hemisphere() {
    let combinations = combinations();
    let group = Means::of_images(10 * combinations.len(), 0.02);
    for &(accel, sampler) in &combinations {
        for (occluder, radius, open) in [
            (Some(Shape::Rectangle), 2.0, 0.25),
            (Some(Shape::Rectangle), 0.9, 1.0),
            (Some(sphere(1.0)), f32::INFINITY, 0.75),
            (Some(sphere(1.0)), 0.5, 1.0),
            (None, f32::INFINITY, 1.0),
        ] {
            for side in [1.0, -1.0] {
                let mut description = Description::default();
                let wide = DAffine3::from_scale(DVec3::new(1e4, 1e4, 1.0));
                add(&mut description, Shape::Rectangle, wide, diffuse(0.1));
                let ceiling = matches!(occluder, Some(Shape::Rectangle));
                let z = side * if ceiling { 1.0 } else { 2.0 };
                let over = DAffine3::from_translation(DVec3::Z * z);
                if let Some(occluder) = occluder.clone() {
                    let to_world = if ceiling { over * wide } else { over };
                    add(&mut description, occluder, to_world, diffuse(0.1));
                }
                // Below the ceiling and beside the sphere.
                let eye = if ceiling { DVec3::Z * (0.5 * side) } else { DVec3::new(3.0, 0.0, 0.5 * side) };
                description.sensors.push(camera(eye, DVec3::ZERO, 0.02, 4));
                let settings = Settings::Ao(AoSettings { radius });
                let rendered = render(&compiled(description, accel), &settings, sampler, 1024, 9);
                group.expect(&format!("{radius}, {side}, {sampler}, {accel}"), &rendered, [open; 3]);
            }
        }
    }
}
