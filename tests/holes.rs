//! Surfaces with holes: rays and shadow rays pass with the same probability, without bias.

use crate::support::expect::Means;
use crate::support::scenes::{add, camera, compiled, render, sphere};
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::Emitter;
use buffon::ids::MaterialId;
use buffon::integrator::Settings;
use buffon::integrator::settings::{DirectSettings, PathLimits};
use buffon::material::{Blend, Diffuse, Mask, Material, Null};
use buffon::math::{DAffine3, DVec3, Vec3};
use buffon::sampling::SamplerKind;
use buffon::scene::Description;
use buffon::scene::description::{PlacedGroup, PlacedShape};
use buffon::shape::Shape;
use std::f64::consts::PI;

fn path(max_depth: Option<u32>) -> Settings {
    Settings::Path(PathLimits { max_depth, ..PathLimits::default() }.into())
}

fn direct(emitter_samples: u32, bsdf_samples: u32) -> Settings {
    Settings::Direct(DirectSettings { emitter_samples, bsdf_samples, hide_emitters: false })
}

fn black() -> Material {
    Material::Diffuse(Diffuse { reflectance: Rgb::BLACK.into() })
}

/// Returns a mask, and adds its black inner material to the description.
fn mask(description: &mut Description, opacity: f32) -> Material {
    description.materials.push(black());
    Material::Mask(Mask { opacity: opacity.into(), inner: MaterialId::from(description.materials.len() - 1) })
}

/// Returns a diffuse plane z = 0 of reflectance 1/2, seen near the origin from a low angle.
fn plane() -> Description {
    let mut description = Description::default();
    let half = Material::Diffuse(Diffuse { reflectance: Rgb::splat(0.5).into() });
    add(&mut description, Shape::Rectangle, DAffine3::from_scale(DVec3::splat(10.0)), half);
    description.sensors.push(camera(DVec3::new(0.0, 4.0, 0.4), DVec3::ZERO, 0.002, 8));
    description
}

fn sheet(z: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::Z * z) * DAffine3::from_scale(DVec3::splat(1.5))
}

/// A name, a function that adds shapes between the emitter and the plane, and the fraction of the light that passes.
type Between = (&'static str, fn(&mut Description), f64);

/// Moves the last shape into a group with one instance.
fn as_instance(description: &mut Description) {
    let placed: PlacedShape = description.shapes.pop().expect("a shape");
    let to_world = placed.to_world.clone();
    description.groups.push(vec![PlacedShape { to_world: DAffine3::IDENTITY.into(), ..placed }]);
    let (name, place, group) = (String::new(), None, description.groups.len() - 1);
    description.instances.push(PlacedGroup { name, place, group, to_world });
}

fn between() -> Vec<Between> {
    vec![
        (
            "a sheet",
            |d| {
                let m = mask(d, 0.3);
                add(d, Shape::Rectangle, sheet(1.0), m);
            },
            0.7,
        ),
        (
            "two sheets",
            |d| {
                for (z, opacity) in [(1.0, 0.3), (1.5, 0.6)] {
                    let m = mask(d, opacity);
                    add(d, Shape::Rectangle, sheet(z), m);
                }
            },
            0.7 * 0.4,
        ),
        (
            "a sphere, passed twice",
            |d| {
                let m = mask(d, 0.5);
                add(d, sphere(0.3), DAffine3::from_translation(DVec3::Z), m);
            },
            0.25,
        ),
        (
            "a tube, passed twice",
            |d| {
                let m = mask(d, 0.2);
                let shape = Shape::Cylinder { p0: -Vec3::X, p1: Vec3::X, radius: 0.3 };
                add(d, shape, DAffine3::from_translation(DVec3::Z), m);
            },
            0.64,
        ),
        (
            "a disk as an instance",
            |d| {
                let m = mask(d, 0.4);
                add(d, Shape::Disk, sheet(1.0), m);
                as_instance(d);
            },
            0.6,
        ),
        (
            "a mask in a mask",
            |d| {
                let inner = mask(d, 0.5);
                d.materials.push(inner);
                let inner = MaterialId::from(d.materials.len() - 1);
                add(d, Shape::Rectangle, sheet(1.0), Material::Mask(Mask { opacity: 0.5.into(), inner }));
            },
            0.75,
        ),
        (
            "nothing and black in parts",
            |d| {
                d.materials.extend([Material::Null(Null), black()]);
                let n = d.materials.len();
                let inner = [n - 2, n - 1].map(MaterialId::from);
                add(d, Shape::Rectangle, sheet(1.0), Material::Blend(Blend { weight: 0.25.into(), inner }));
            },
            0.75,
        ),
        (
            "nothing",
            |d| {
                add(d, Shape::Cube, sheet(1.6), Material::Null(Null));
            },
            1.0,
        ),
    ]
}

#[test]
fn shadow_rays_pass_holes_by_their_share() {
    let cases = between();
    let group = Means::of_images(2 * cases.len() * AccelKind::CHOICES.len(), 0.02);
    for accel in AccelKind::CHOICES {
        for (name, put, share) in &cases {
            let mut description = plane();
            put(&mut description);
            let intensity = Rgb::splat(7.0);
            description.emitters.push(Emitter::Point { position: Vec3::new(0.0, 0.0, 2.0), intensity });
            let scene = compiled(description, *accel);
            let exact = [0.5 / PI * 7.0 / 4.0 * share; 3];
            for settings in [path(None), direct(1, 1)] {
                let rendered = render(&scene, &settings, SamplerKind::Independent, 512, 4);
                group.expect(&format!("{name}, {settings:?}, {accel}"), &rendered, exact);
            }
        }
    }
}

/// Camera rays pass a black surface with the probability 1 − opacity. After a hit, they do not pass a second time.
#[test]
fn camera_rays_pass_holes_by_their_share() {
    let cases = between();
    let group = Means::of_images(2 * cases.len() * AccelKind::CHOICES.len(), 0.02);
    for accel in AccelKind::CHOICES {
        for (name, put, share) in &cases {
            let mut description = plane();
            put(&mut description);
            description.sensors = vec![camera(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, 0.002, 8)];
            let irradiance = Rgb::splat(2.0);
            description.emitters.push(Emitter::Directional { direction: Vec3::NEG_Z, irradiance });
            let scene = compiled(description, *accel);
            let exact = [0.5 / PI * 2.0 * share * share; 3];
            for settings in [path(None), direct(1, 1)] {
                let rendered = render(&scene, &settings, SamplerKind::Independent, 1024, 4);
                group.expect(&format!("{name}, {settings:?}, {accel}"), &rendered, exact);
            }
        }
    }
}

/// An emitter behind a surface with holes is found by each technique and by both together.
#[test]
fn lamps_behind_holes_are_found_by_every_technique() {
    let settings = [path(Some(2)), path(None), direct(1, 1), direct(1, 0), direct(0, 1)];
    let group = Means::of_images(settings.len() * AccelKind::CHOICES.len(), 0.02);
    for accel in AccelKind::CHOICES {
        let mut description = plane();
        let m = mask(&mut description, 0.4);
        add(&mut description, Shape::Rectangle, sheet(1.0), m);
        let lamp = add(&mut description, sphere(0.8), DAffine3::from_translation(DVec3::Z * 3.0), black());
        description.shapes[lamp].emission = Some(Rgb::splat(3.0).into());
        let scene = compiled(description, *accel);
        assert!(scene.needs.holes);
        let exact = [0.5 * 3.0 * 0.64 / 9.0 * 0.6; 3];
        for settings in &settings {
            let rendered = render(&scene, settings, SamplerKind::Independent, 2048, 5);
            group.expect(&format!("{settings:?}, {accel}"), &rendered, exact);
        }
    }
}

/// An emitter with holes emits everywhere, and light of an emitter behind it passes with the probability 1 − opacity.
#[test]
fn lamps_with_holes_emit_everywhere() {
    let group = Means::of_images(2 * AccelKind::CHOICES.len(), 0.02);
    for accel in AccelKind::CHOICES {
        let mut description = Description::default();
        let m = mask(&mut description, 0.25);
        for (z, radiance, material) in [(0.0, 1.0, m), (-1.0, 2.0, black())] {
            let id = add(&mut description, Shape::Rectangle, sheet(z), material);
            description.shapes[id].emission = Some(Rgb::splat(radiance).into());
        }
        description.sensors.push(camera(DVec3::new(0.1, 0.2, 4.0), DVec3::ZERO, 2.0, 8));
        let scene = compiled(description, *accel);
        assert!(!scene.needs.holes);
        for settings in [path(None), direct(1, 1)] {
            let rendered = render(&scene, &settings, SamplerKind::Independent, 256, 6);
            group.expect(&format!("{settings:?}, {accel}"), &rendered, [1.0 + 0.75 * 2.0; 3]);
        }
    }
}

/// A scene without holes needs no filter.
#[test]
fn only_holes_need_a_filter() {
    let opaque = {
        let mut description = plane();
        let m = mask(&mut description, 1.0);
        add(&mut description, Shape::Rectangle, sheet(1.0), m);
        compiled(description, AccelKind::default())
    };
    assert!(!opaque.needs.holes && !opaque.needs.instances && !opaque.needs.time);
}
