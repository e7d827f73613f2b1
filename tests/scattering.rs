//! Sampling against densities: every BSDF, emitter and warp of directions.

use crate::support::chi2::check_directions;
use crate::support::scenes;
use buffon::bsdf::fresnel::ConductorFresnel;
use buffon::bsdf::microfacet::{Distribution, Microfacets};
use buffon::bsdf::{Bsdf, Diffuse, Lobe, RoughConductor};
use buffon::color::Rgb;
use buffon::emitter::{AreaEmitter, Light};
use buffon::math::{DAffine3, DVec3, Vec2, Vec3};
use buffon::sampling::warp;
use buffon::shape::{Mesh, Shape, WorldShape};

/// Directions above and below the surface, from the normal to grazing.
fn directions() -> Vec<Vec3> {
    let mut list = Vec::new();
    for z in [1.0f32, 0.8, 0.3, 0.05] {
        let r = (1.0 - z * z).sqrt();
        list.push(Vec3::new(r * 0.6, r * 0.8, z));
    }
    list
}

fn check_bsdf(name: &str, tests: usize, bsdf: &Bsdf, wo: Vec3) {
    let name = format!("{name}, wo.z = {}", wo.z);
    check_directions(
        &name,
        tests,
        |u_lobe, u| {
            let s = bsdf.sample(wo, u_lobe, Vec2::from(u))?;
            assert_ne!(s.lobe, Lobe::Specular);
            let e = bsdf.eval(wo, s.wi);
            // The weight and density of a sample are what evaluation says they are.
            let close = |a: f32, b: f32| (a - b).abs() <= 2e-3 * a.abs().max(b.abs()) + 1e-5;
            assert!(close(e.pdf, s.pdf), "{name}: pdf {} and {} at {}", s.pdf, e.pdf, s.wi);
            let weight = e.f * (s.wi.z.abs() / e.pdf);
            for c in 0..3 {
                assert!(close(weight[c], s.weight[c]), "{name}: weight {:?} and {weight:?}", s.weight);
            }
            Some(s.wi)
        },
        |wi| bsdf.eval(wo, wi).pdf,
    );
}

#[test]
fn diffuse_samples_follow_their_density() {
    let bsdf = Bsdf::Diffuse(Diffuse { reflectance: Rgb::new(0.2, 0.5, 0.9) });
    let directions = directions();
    for &wo in &directions {
        check_bsdf("diffuse", directions.len(), &bsdf, wo);
    }
    assert!(bsdf.sample(Vec3::new(0.6, 0.0, -0.8), 0.5, Vec2::splat(0.5)).is_none());
}

fn rough(distribution: Distribution, alpha: [f32; 2], sample_visible: bool) -> Bsdf {
    Bsdf::RoughConductor(RoughConductor {
        microfacets: Microfacets { distribution, alpha_x: alpha[0], alpha_y: alpha[1], sample_visible },
        fresnel: ConductorFresnel { eta: Rgb::new(0.2, 0.9, 1.5), k: Rgb::new(3.9, 2.4, 1.9) },
        specular_reflectance: Rgb::WHITE,
    })
}

#[test]
fn rough_conductor_samples_follow_their_density() {
    let alphas = [[0.1, 0.1], [0.25, 0.25], [0.05, 0.4], [1.0, 1.0]];
    let directions = directions();
    let tests = alphas.len() * directions.len() * 4;
    for distribution in [Distribution::Beckmann, Distribution::Ggx] {
        for alpha in alphas {
            for visible in [true, false] {
                let bsdf = rough(distribution, alpha, visible);
                for &wo in &directions {
                    let name = format!("{distribution:?} {alpha:?} visible {visible}");
                    check_bsdf(&name, tests, &bsdf, wo);
                }
            }
        }
    }
}

/// Where every facet reflects all light, energy is never gained, and the BSDF is reciprocal.
#[test]
fn rough_conductors_conserve_energy_and_are_reciprocal() {
    for distribution in [Distribution::Beckmann, Distribution::Ggx] {
        for alpha in [1e-3, 0.01, 0.1, 0.5, 1.0] {
            let mirror = Bsdf::RoughConductor(RoughConductor {
                microfacets: Microfacets {
                    distribution,
                    alpha_x: alpha,
                    alpha_y: alpha,
                    sample_visible: true,
                },
                fresnel: ConductorFresnel { eta: Rgb::splat(0.0), k: Rgb::splat(1e9) },
                specular_reflectance: Rgb::WHITE,
            });
            for wo in directions() {
                let n = 128;
                let mut sum = 0.0;
                for i in 0..n * n {
                    let u = Vec2::new(((i % n) as f32 + 0.5) / n as f32, ((i / n) as f32 + 0.5) / n as f32);
                    sum += mirror.sample(wo, 0.5, u).map_or(0.0, |s| s.weight.r);
                }
                let albedo = sum / (n * n) as f32;
                assert!(albedo < 1.0 + 1e-3, "{distribution:?} {alpha} {wo}: {albedo}");
                let wi = Vec3::new(-0.2, 0.5, 0.7).normalize();
                let (a, b) = (mirror.eval(wo, wi).f.r, mirror.eval(wi, wo).f.r);
                assert!((a - b).abs() <= 1e-4 * a.max(b), "{a} {b}");
            }
        }
    }
}

#[test]
fn warps_of_directions_follow_their_density() {
    let tests = 5;
    check_directions(
        "cosine hemisphere",
        tests,
        |_, u| Some(warp::square_to_cosine_hemisphere(Vec2::from(u))),
        warp::square_to_cosine_hemisphere_pdf,
    );
    check_directions(
        "sphere",
        tests,
        |_, u| Some(warp::square_to_sphere(Vec2::from(u))),
        |_| warp::SQUARE_TO_SPHERE_PDF,
    );
    for cap in [0.15, 0.5, 1.0] {
        check_directions(
            &format!("cone {cap}"),
            tests,
            |_, u| Some(warp::square_to_cone(Vec2::from(u), cap)),
            |w| if 1.0 - w.z <= cap { warp::square_to_cone_pdf(cap) } else { 0.0 },
        );
    }
}

/// Samples of a shape's surface against the density at the point that a ray in that direction meets.
fn check_emitter(name: &str, tests: usize, shape: Shape, to_world: DAffine3, from: Vec3, least: f64) {
    let mut description = buffon::scene::Description::default();
    let id = scenes::add(&mut description, shape.clone(), to_world, scenes::diffuse(0.5));
    description.shapes[id].emission = Some(Rgb::WHITE);
    let scene = scenes::compiled(description, buffon::accel::AccelKind::default());
    let Light::Area(area) = &scene.lights[0] else { panic!("{name} is an area emitter") };
    let total = check_directions(
        name,
        tests,
        |_, u| {
            let s = area.sample(from, Vec2::from(u))?;
            assert!(s.pdf > 0.0 && s.radiance == Rgb::WHITE);
            Some(s.wi)
        },
        |w| {
            let ray = buffon::math::Ray::new(from, w);
            let Some(hit) = scene.accel.intersect(&ray) else { return 0.0 };
            let at = scene.interaction(&ray, &hit);
            if at.front { scene.emitter_pdf(buffon::ids::EmitterId(0), from, &at) } else { 0.0 }
        },
    );
    assert!(total > least, "{name}: the density integrates to {total}");
}

#[test]
fn emitter_samples_follow_their_density() {
    let tests = 10;
    let place = |x: f64, y: f64, z: f64, scale: f64| {
        DAffine3::from_scale_rotation_translation(
            DVec3::splat(scale),
            glam::DQuat::from_rotation_y(std::f64::consts::PI),
            DVec3::new(x, y, z),
        )
    };
    let o = Vec3::ZERO;
    check_emitter("rectangle", tests, Shape::Rectangle, place(0.0, 0.0, 1.0, 1.0), o, 0.98);
    check_emitter("rectangle from the side", tests, Shape::Rectangle, place(2.0, 0.5, 0.7, 1.0), o, 0.98);
    check_emitter("rectangle from nearby", tests, Shape::Rectangle, place(0.2, 0.1, 0.2, 1.0), o, 0.98);
    let sheared = DAffine3::from_cols_array(&[-1.0, 0.0, 0.0, -0.5, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0]);
    check_emitter("parallelogram", tests, Shape::Rectangle, sheared, o, 0.98);
    check_emitter("disk", tests, Shape::Disk, place(0.4, 0.0, 1.0, 1.0), o, 0.98);
    check_emitter("sphere", tests, scenes::sphere(1.0), place(0.5, 0.3, 1.5, 1.0), o, 0.98);
    check_emitter("sphere from nearby", tests, scenes::sphere(1.0), place(0.0, 0.0, 1.05, 1.0), o, 0.98);
    let mesh = Mesh {
        positions: vec![
            Vec3::new(-1.0, -1.0, 1.0),
            Vec3::new(-1.0, 1.5, 1.0),
            Vec3::new(1.0, -1.0, 1.2),
            Vec3::new(1.0, 1.0, 0.6),
        ],
        indices: vec![[0, 1, 2], [2, 1, 3]],
        ..Mesh::default()
    };
    check_emitter("mesh", tests, Shape::Mesh(mesh), DAffine3::IDENTITY, o, 0.98);
    let mut inside = buffon::scene::Description::default();
    let id = scenes::add(&mut inside, scenes::sphere(1.0), DAffine3::IDENTITY, scenes::diffuse(0.5));
    inside.shapes[id].emission = Some(Rgb::WHITE);
    inside.shapes[id].flip_normals = true;
    let scene = scenes::compiled(inside, buffon::accel::AccelKind::default());
    let Light::Area(area) = &scene.lights[0] else { panic!("a sphere is an area emitter") };
    let from = Vec3::new(0.3, -0.2, 0.6);
    check_directions(
        "sphere from inside",
        tests,
        |_, u| area.sample(from, Vec2::from(u)).map(|s| s.wi),
        |w| {
            let ray = buffon::math::Ray::new(from, w);
            let hit = scene.accel.intersect(&ray).expect("the sphere is closed");
            scene.emitter_pdf(buffon::ids::EmitterId(0), from, &scene.interaction(&ray, &hit))
        },
    );
}

/// Solid-angle sampling reaches every limit: the smallest and the largest cones, and a rectangle nearly edge-on.
#[test]
fn emitters_are_sampled_at_every_scale() {
    for distance in [1.000_01f64, 1.5, 10.0, 1e3, 1e6] {
        let world =
            WorldShape::new(scenes::sphere(1.0), &DAffine3::from_translation(DVec3::Z * distance), false)
                .unwrap();
        let area = AreaEmitter::new(&world, Rgb::WHITE).unwrap();
        let exact = {
            let sin2 = 1.0 / (distance * distance);
            2.0 * std::f64::consts::PI * sin2 / (1.0 + (1.0 - sin2).sqrt())
        };
        let s = area.sample(Vec3::ZERO, Vec2::new(0.3, 0.7)).unwrap();
        assert!((f64::from(s.pdf) * exact - 1.0).abs() < 2e-3, "{distance}: {} {exact}", s.pdf);
        assert!((s.wi.length() - 1.0).abs() < 1e-5);
    }
}
