//! Sampling of emitters, compared with their densities.

use crate::support::chi2::{check_directions, check_square};
use crate::support::scenes;
use buffon::accel::AccelKind;
use buffon::color::Rgb;
use buffon::emitter::{AreaEmitter, Emission, Light, ShadowTarget};
use buffon::ids::{EmitterId, TextureId};
use buffon::image::TextureImage;
use buffon::material::Input;
use buffon::math::{Affine2, DAffine3, DVec3, Ray, Vec2, Vec3};
use buffon::scene::{Description, Scene};
use buffon::shape::{Mesh, Shape, WorldShape};
use buffon::texture::{Bitmap, FilterType, Texture, WrapMode};
use glam::DQuat;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Returns a scene with one shape, which emits.
fn emitting(shape: Shape, to_world: DAffine3, flip_normals: bool) -> Scene {
    let mut description = Description::default();
    let id = scenes::add(&mut description, shape, to_world, scenes::diffuse(0.5));
    description.shapes[id].emission = Some(Rgb::WHITE.into());
    description.shapes[id].flip_normals = flip_normals;
    let scene = scenes::compiled(description, AccelKind::default());
    assert!(matches!(scene.lights[0], Light::Area(_)));
    scene
}

/// A map between the unit square and a surface: the point for (s, t), and the inverse.
struct Chart<'a> {
    point: &'a dyn Fn([f64; 2]) -> DVec3,
    inverse: &'a dyn Fn(DVec3) -> [f64; 2],
}

impl Chart<'_> {
    /// Returns the vector area of the surface per unit area of the square, by central differences.
    fn area(&self, [s, t]: [f64; 2]) -> DVec3 {
        const H: f64 = 1e-5;
        let ds = (self.point)([s + H, t]) - (self.point)([s - H, t]);
        let dt = (self.point)([s, t + H]) - (self.point)([s, t - H]);
        ds.cross(dt) / (4.0 * H * H)
    }
}

/// Compares samples of an emitter from `from` with the density, over a chart of its surface. The density is that of the
/// point hit by a ray to the chart's point. Returns the integral of the density.
fn check_emitter(name: &str, scene: &Scene, from: Vec3, chart: &Chart<'_>) -> f64 {
    let Light::Area(area) = &scene.lights[0] else { panic!("{name} is an area emitter") };
    let mut differ = 0;
    let total = check_square(
        name,
        EMITTER_TESTS,
        |_, u| {
            let s = area.sample(from, u, 0.0)?;
            assert!(s.pdf > 0.0 && !s.delta);
            let ray = Ray::new(from, s.wi);
            let hit = scene.accel.intersect(&ray)?;
            let at = scene.interaction(&ray, &hit);
            let pdf = scene.emitter_pdf(&scene.light_selection, EmitterId(0), from, from, &at);
            let seen = scene.emitted(EmitterId(0), &at);
            // The hit of the ray differs from the sampled point by rounding, so a texture may have another value there.
            let close = (seen.r - s.radiance.r).abs() <= 1e-3 * seen.r.max(s.radiance.r);
            differ += usize::from(!close);
            assert!(
                (pdf / s.pdf - 1.0).abs() < 5e-3,
                "{name}: densities {} and {pdf} towards {}",
                s.pdf,
                s.wi
            );
            Some((chart.inverse)(at.p.as_dvec3()))
        },
        |square| {
            let to = (chart.point)(square) - from.as_dvec3();
            let ray = Ray::new(from, to.as_vec3().normalize());
            let Some(hit) = scene.accel.intersect(&ray) else { return 0.0 };
            let at = scene.interaction(&ray, &hit);
            if !at.emitting || f64::from(hit.t) < 0.99 * to.length() {
                return 0.0;
            }
            let solid_angle = chart.area(square).dot(to).abs() / to.length().powi(3);
            f64::from(scene.emitter_pdf(&scene.light_selection, EmitterId(0), from, from, &at)) * solid_angle
        },
    );
    assert!(differ < 20, "{name}: {differ} samples bring another radiance than a ray finds");
    total
}

/// The number of emitters by which the significance is divided.
const EMITTER_TESTS: usize = 17;

/// Returns a transform that turns a shape to face −z, scales and moves it.
fn place(x: f64, y: f64, z: f64, scale: f64) -> DAffine3 {
    DAffine3::from_scale_rotation_translation(
        DVec3::splat(scale),
        DQuat::from_rotation_y(std::f64::consts::PI),
        DVec3::new(x, y, z),
    )
}

#[test]
fn rectangle_samples_follow_their_density() {
    let sheared = DAffine3::from_cols_array(&[-1.0, 0.0, 0.0, -0.5, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0]);
    for (name, to_world) in [
        ("rectangle", place(0.0, 0.0, 1.0, 1.0)),
        ("rectangle from the side", place(2.0, 0.5, 0.7, 1.0)),
        ("rectangle from nearby", place(0.2, 0.1, 0.2, 1.0)),
        ("rectangle from afar", place(3.0, 0.0, 20.0, 1.0)),
        ("parallelogram", sheared),
    ] {
        let scene = emitting(Shape::Rectangle, to_world, false);
        let back = to_world.inverse();
        let total = check_emitter(
            name,
            &scene,
            Vec3::ZERO,
            &Chart {
                point: &|[s, t]| to_world.transform_point3(DVec3::new(2.0 * s - 1.0, 2.0 * t - 1.0, 0.0)),
                inverse: &|p| {
                    let p = back.transform_point3(p);
                    [0.5 * (p.x + 1.0), 0.5 * (p.y + 1.0)]
                },
            },
        );
        assert!((total - 1.0).abs() < 2e-3, "{name}: the density integrates to {total}");
    }
}

/// Returns a texture of 4×3 different texels, one of them black.
fn picture(filter: FilterType) -> Arc<Texture> {
    let values = (0..12).map(|i| if i == 5 { 0.0 } else { 0.2 + 0.7 * i as f32 });
    let image = TextureImage::from_floats(4, 3, 1, values.collect()).expect("a picture");
    Arc::new(Texture::Bitmap(Bitmap::new(Arc::new(image), filter, WrapMode::Clamp, Affine2::IDENTITY)))
}

/// Samples of a textured rectangle are proportional to the emitted light, and their density integrates to 1.
#[test]
fn textured_rectangle_samples_follow_their_density() {
    for (name, filter, flip) in [
        ("textured rectangle", FilterType::Nearest, false),
        ("textured rectangle, turned over", FilterType::Bilinear, true),
    ] {
        let mut to_world = place(0.3, 0.1, 0.8, 1.0);
        if flip {
            to_world *= DAffine3::from_rotation_x(std::f64::consts::PI);
        }
        let mut description = Description { textures: vec![picture(filter)], ..Description::default() };
        let id = scenes::add(&mut description, Shape::Rectangle, to_world, scenes::diffuse(0.5));
        description.shapes[id].emission = Some(Input::Texture(TextureId(0)));
        description.shapes[id].flip_normals = flip;
        let scene = scenes::compiled(description, AccelKind::default());
        let back = to_world.inverse();
        let total = check_emitter(
            name,
            &scene,
            Vec3::ZERO,
            &Chart {
                point: &|[s, t]| to_world.transform_point3(DVec3::new(2.0 * s - 1.0, 2.0 * t - 1.0, 0.0)),
                inverse: &|p| {
                    let p = back.transform_point3(p);
                    [0.5 * (p.x + 1.0), 0.5 * (p.y + 1.0)]
                },
            },
        );
        assert!((total - 1.0).abs() < 2e-3, "{name}: the density integrates to {total}");
    }
}

/// The whole cylinder is visible from inside.
#[test]
fn cylinder_samples_follow_their_density() {
    let (p0, p1) = (DVec3::new(0.2, -0.5, -1.0), DVec3::new(0.4, 0.1, 1.2));
    let shape = Shape::Cylinder { p0: p0.as_vec3(), p1: p1.as_vec3(), radius: 0.8 };
    let axis = (p1 - p0).normalize();
    let (x, y) = axis.any_orthonormal_pair();
    for (name, to_world) in
        [("cylinder", DAffine3::IDENTITY), ("cylinder, turned", DAffine3::from_rotation_y(0.7))]
    {
        let scene = emitting(shape.clone(), to_world, true);
        let back = to_world.inverse();
        let total = check_emitter(
            name,
            &scene,
            to_world.transform_point3(DVec3::new(0.3, -0.1, 0.2)).as_vec3(),
            &Chart {
                point: &|[s, t]| {
                    let (sin, cos) = (TAU * s).sin_cos();
                    to_world.transform_point3(p0 + (p1 - p0) * t + (x * cos + y * sin) * 0.8)
                },
                inverse: &|p| {
                    let q = back.transform_point3(p) - p0;
                    let turn = q.dot(y).atan2(q.dot(x)).rem_euclid(TAU) / TAU;
                    [turn, q.dot(axis) / (p1 - p0).length()]
                },
            },
        );
        assert!((total - 1.0).abs() < 2e-3, "{name}: the density integrates to {total}");
    }
}

#[test]
fn disk_samples_follow_their_density() {
    let ellipse = DAffine3::from_cols_array(&[-1.0, 0.0, 0.0, -0.5, 0.7, 0.2, 0.0, 0.0, -1.0, 0.3, 0.0, 1.0]);
    for (name, to_world) in [("disk", place(0.4, 0.0, 1.0, 1.0)), ("ellipse", ellipse)] {
        let scene = emitting(Shape::Disk, to_world, false);
        let back = to_world.inverse();
        let total = check_emitter(
            name,
            &scene,
            Vec3::ZERO,
            &Chart {
                point: &|[r, phi]| {
                    let (sin, cos) = (TAU * phi).sin_cos();
                    to_world.transform_point3(DVec3::new(r * cos, r * sin, 0.0))
                },
                inverse: &|p| {
                    let p = back.transform_point3(p);
                    [p.x.hypot(p.y), p.y.atan2(p.x).rem_euclid(TAU) / TAU]
                },
            },
        );
        assert!((total - 1.0).abs() < 2e-3, "{name}: the density integrates to {total}");
    }
}

#[test]
fn sphere_samples_follow_their_density() {
    // Outside a sphere, the chart is the visible cap: the cosine and the azimuth around the axis to the receiver.
    for (name, centre) in [
        ("sphere", DVec3::new(0.5, 0.3, 1.5)),
        ("sphere from nearby", DVec3::new(0.0, 0.0, 1.05)),
        ("sphere from afar", DVec3::new(30.0, 0.0, 10.0)),
    ] {
        let scene = emitting(scenes::sphere(1.0), DAffine3::from_translation(centre), false);
        let distance = centre.length();
        let axis = -centre / distance;
        let x = axis.any_orthonormal_vector();
        let y = axis.cross(x);
        let rim = 1.0 / distance;
        let total = check_emitter(
            name,
            &scene,
            Vec3::ZERO,
            &Chart {
                point: &|[s, phi]| {
                    let cos = 1.0 - s * (1.0 - rim);
                    let (sin_phi, cos_phi) = (TAU * phi).sin_cos();
                    let sin = (1.0 - cos * cos).max(0.0).sqrt();
                    centre + axis * cos + (x * cos_phi + y * sin_phi) * sin
                },
                inverse: &|p| {
                    let n = (p - centre).normalize();
                    let phi = n.dot(y).atan2(n.dot(x)).rem_euclid(TAU);
                    [(1.0 - n.dot(axis)) / (1.0 - rim), phi / TAU]
                },
            },
        );
        assert!((total - 1.0).abs() < 5e-3, "{name}: the density integrates to {total}");
    }
    let scene = emitting(scenes::sphere(1.0), DAffine3::IDENTITY, true);
    let total = check_emitter(
        "sphere from inside",
        &scene,
        Vec3::new(0.3, -0.2, 0.6),
        &Chart {
            point: &|[s, phi]| {
                let z = 2.0 * s - 1.0;
                let r = (1.0 - z * z).max(0.0).sqrt();
                DVec3::new(r * (TAU * phi).cos(), r * (TAU * phi).sin(), z)
            },
            inverse: &|p| [0.5 * (p.z + 1.0), p.y.atan2(p.x).rem_euclid(TAU) / TAU],
        },
    );
    assert!((total - 1.0).abs() < 2e-3, "from inside the density integrates to {total}");
}

#[test]
fn mesh_samples_follow_their_density() {
    let corners = [[-1.0, -1.0, 1.0], [-1.0, 1.5, 1.0], [1.0, -1.0, 1.2], [1.0, 1.0, 0.6]].map(DVec3::from);
    let indices = [[0, 1, 2], [2, 1, 3]];
    let mesh = Mesh {
        positions: corners.map(|p| p.as_vec3()).to_vec(),
        indices: indices.map(|t: [usize; 3]| t.map(|i| i as u32)).to_vec(),
        ..Mesh::default()
    };
    let scene = emitting(Shape::Mesh(mesh), DAffine3::IDENTITY, false);
    // Each triangle corresponds to half of the square.
    let weights = |p: DVec3, [a, b, c]: [DVec3; 3]| {
        let n = (b - a).cross(c - a);
        let area = n.length_squared();
        [(p - a).cross(c - a).dot(n) / area, (b - a).cross(p - a).dot(n) / area, (p - a).dot(n) / n.length()]
    };
    let total = check_emitter(
        "mesh",
        &scene,
        Vec3::ZERO,
        &Chart {
            point: &|[s, t]| {
                let half = usize::from(s >= 0.5);
                let b = fan_to_triangle([2.0 * s - half as f64, t]);
                let [p, q, r] = indices[half].map(|i| corners[i]);
                p * (1.0 - b[0] - b[1]) + q * b[0] + r * b[1]
            },
            inverse: &|p| {
                let found = [0, 1].map(|half| weights(p, indices[half].map(|i| corners[i])));
                let half = usize::from(found[0][2].abs() > found[1][2].abs());
                let [u, v, _] = found[half];
                let s = u + v;
                [0.5 * (s.clamp(0.0, 1.0) + half as f64), (v / s).clamp(0.0, 1.0)]
            },
        },
    );
    assert!((total - 1.0).abs() < 5e-3, "mesh: the density integrates to {total}");
}

fn fan_to_triangle([s, t]: [f64; 2]) -> [f64; 2] {
    [s * (1.0 - t), s * t]
}

#[test]
fn environment_samples_follow_their_density() {
    let mut description = Description::default();
    scenes::add(&mut description, scenes::sphere(1.0), DAffine3::IDENTITY, scenes::diffuse(0.5));
    description.emitters.push(scenes::constant(2.0));
    let scene = scenes::compiled(description, AccelKind::default());
    let environment = scene.environment.expect("an environment");
    const VIEWER: Vec3 = Vec3::new(0.0, 0.0, 2.0);
    let total = check_directions(
        "constant environment",
        EMITTER_TESTS,
        |_, u| {
            let s = scene.sample_emitter(&scene.light_selection, VIEWER, u, 0.0)?;
            assert!(s.target == ShadowTarget::Infinity && s.radiance == Rgb::splat(2.0));
            assert_eq!(s.pdf, scene.distant_density(&scene.light_selection, environment, s.wi));
            Some(s.wi)
        },
        |wi| scene.distant_density(&scene.light_selection, environment, wi),
    );
    assert!((total - 1.0).abs() < 1e-3, "{total}");
}

/// Emitters are chosen in proportion to the irradiance that they cause, and the density agrees. For two spheres at
/// equal distances, this is in proportion to power, except for the one sample in sixteen that each gets in any case.
#[test]
fn emitters_are_chosen_by_irradiance() {
    let mut description = Description::default();
    for (x, radiance) in [(-3.0, 1.0), (3.0, 4.0)] {
        let id = scenes::add(
            &mut description,
            scenes::sphere(0.5),
            DAffine3::from_translation(DVec3::new(x, 0.0, 0.0)),
            scenes::diffuse(0.5),
        );
        description.shapes[id].emission = Some(Rgb::splat(radiance).into());
    }
    let scene = scenes::compiled(description, AccelKind::default());
    let n = 4000i32;
    let mut right = 0;
    for i in 0..n {
        let u = Vec2::new((i as f32 + 0.5) / n as f32, 0.7);
        let s = scene.sample_emitter(&scene.light_selection, Vec3::ZERO, u, 0.0).expect("a sample");
        let ray = Ray::new(Vec3::ZERO, s.wi);
        let at = scene.interaction(&ray, &scene.accel.intersect(&ray).expect("an emitter is hit"));
        let emitter = scene.emitter_at(&at).expect("it emits");
        assert_eq!(scene.emitted(emitter, &at), s.radiance);
        assert!(
            (scene.emitter_pdf(&scene.light_selection, emitter, Vec3::ZERO, Vec3::ZERO, &at) / s.pdf - 1.0)
                .abs()
                < 1e-4
        );
        right += i32::from(s.wi.x > 0.0);
    }
    assert_eq!(right, n * 12 / 16);
}

/// Solid-angle sampling works for the smallest and the largest cones.
#[test]
fn emitters_are_sampled_at_every_scale() {
    for distance in [1.000_01f64, 1.5, 10.0, 1e3, 1e6] {
        let world =
            WorldShape::new(scenes::sphere(1.0), &DAffine3::from_translation(DVec3::Z * distance), false)
                .unwrap();
        let area = AreaEmitter::new(&world, Emission::Constant(Rgb::WHITE), None).unwrap();
        let exact = {
            let sin2 = 1.0 / (distance * distance);
            2.0 * std::f64::consts::PI * sin2 / (1.0 + (1.0 - sin2).sqrt())
        };
        let s = area.sample(Vec3::ZERO, Vec2::new(0.3, 0.7), 0.0).unwrap();
        assert!((f64::from(s.pdf) * exact - 1.0).abs() < 2e-3, "{distance}: {} {exact}", s.pdf);
        assert!((s.wi.length() - 1.0).abs() < 1e-5);
    }
}
