//! Sampling against densities: every BSDF and every warp.

use crate::support::chi2::{check_directions, check_square};
use buffon::bsdf::fresnel::ConductorFresnel;
use buffon::bsdf::microfacet::{Distribution, Microfacets};
use buffon::bsdf::{Bsdf, Diffuse, Lobe, RoughConductor};
use buffon::color::Rgb;
use buffon::math::{DVec3, Vec2, Vec3};
use buffon::sampling::warp;
use std::f64::consts::TAU;

/// Directions above and below the surface, from the normal to grazing.
fn directions() -> Vec<Vec3> {
    let mut list = Vec::new();
    for z in [1.0f32, 0.8, 0.3, 0.05] {
        let r = (1.0 - z * z).sqrt();
        list.push(Vec3::new(r * 0.6, r * 0.8, z));
    }
    list
}

fn check_bsdf(name: &str, tests: usize, bsdf: &Bsdf<'_>, wo: Vec3) {
    let name = format!("{name}, wo.z = {}", wo.z);
    check_directions(
        &name,
        tests,
        |u_lobe, u| {
            let s = bsdf.sample(wo, u_lobe, u)?;
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

fn rough(distribution: Distribution, alpha: [f32; 2], sample_visible: bool) -> Bsdf<'static> {
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

/// Lobes of small roughness: over the slopes of the facet between the directions, in units of the roughness.
#[test]
fn sharp_rough_conductor_samples_follow_their_density() {
    let alphas = [[1e-3, 1e-3], [1e-2, 1e-2], [1e-3, 2e-2]];
    let directions = directions();
    let tests = alphas.len() * directions.len() * 4;
    for distribution in [Distribution::Beckmann, Distribution::Ggx] {
        for alpha in alphas {
            for visible in [true, false] {
                let bsdf = rough(distribution, alpha, visible);
                for &wo in &directions {
                    let name = format!("{distribution:?} {alpha:?} visible {visible}, wo.z = {}", wo.z);
                    check_slopes(&name, tests, &bsdf, alpha.map(f64::from), wo);
                }
            }
        }
    }
}

/// The square's first axis is r²/(1 + r²) for a facet's slope r in units of the roughness, the second its azimuth.
fn check_slopes(name: &str, tests: usize, bsdf: &Bsdf<'_>, alpha: [f64; 2], wo: Vec3) {
    let sample = |u_lobe, u| {
        let wi = bsdf.sample(wo, u_lobe, u)?.wi;
        let m = wo.as_dvec3() + wi.as_dvec3();
        let (x, y) = (m.x / (m.z * alpha[0]), m.y / (m.z * alpha[1]));
        let r2 = x * x + y * y;
        Some([r2 / (1.0 + r2), y.atan2(x).rem_euclid(TAU) / TAU])
    };
    let density = |[s, phi]: [f64; 2]| {
        let r = (s / (1.0 - s)).sqrt();
        let (sin, cos) = (TAU * phi).sin_cos();
        let m = DVec3::new(alpha[0] * r * cos, alpha[1] * r * sin, 1.0).normalize();
        let wo = wo.as_dvec3();
        let wi = m * (2.0 * wo.dot(m)) - wo;
        // Slopes per unit square, facets per slope, directions per facet.
        let slopes = alpha[0] * alpha[1] * 0.5 / (1.0 - s).powi(2) * TAU;
        let solid_angle = slopes * m.z.powi(3) * 4.0 * wo.dot(m).max(0.0);
        f64::from(bsdf.eval(wo.as_vec3(), wi.as_vec3().normalize()).pdf) * solid_angle
    };
    check_square(name, tests, sample, density);
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
        |_, u| Some(warp::square_to_cosine_hemisphere(u)),
        warp::square_to_cosine_hemisphere_pdf,
    );
    check_directions("sphere", tests, |_, u| Some(warp::square_to_sphere(u)), |_| warp::SQUARE_TO_SPHERE_PDF);
    for cap in [1e-8, 0.02, 1.0] {
        // The square's first axis is 1 − cosθ, from 0 to the cone's rim.
        let to_square = |w: Vec3| {
            let sin2 = f64::from(w.x).powi(2) + f64::from(w.y).powi(2);
            let phi = f64::from(w.y).atan2(f64::from(w.x)).rem_euclid(TAU);
            [sin2 / (1.0 + (1.0 - sin2).max(0.0).sqrt()) / f64::from(cap), phi / TAU]
        };
        let total = check_square(
            &format!("cone {cap}"),
            tests,
            |_, u| Some(to_square(warp::square_to_cone(u, cap))),
            |_| f64::from(warp::square_to_cone_pdf(cap)) * TAU * f64::from(cap),
        );
        assert!((total - 1.0).abs() < 1e-6);
    }
}

#[test]
fn warps_of_planes_follow_their_density() {
    let tests = 3;
    let disk = check_square(
        "disk",
        tests,
        |_, u| {
            let p = warp::square_to_disk(u);
            Some([f64::from(p.length()), f64::from(p.y).atan2(f64::from(p.x)).rem_euclid(TAU) / TAU])
        },
        |[r, phi]| {
            let (sin, cos) = (TAU * phi).sin_cos();
            f64::from(warp::square_to_disk_pdf(Vec2::new((r * cos) as f32, (r * sin) as f32))) * TAU * r
        },
    );
    let triangle = check_square(
        "triangle",
        tests,
        |_, u| Some(triangle_to_fan(warp::square_to_triangle(u))),
        |[s, t]| s * f64::from(warp::square_to_triangle_pdf(fan_to_triangle([s, t]))),
    );
    let tent = check_square(
        "tent",
        tests,
        |_, u| Some([u.x, u.y].map(|u| 0.5 * (f64::from(warp::interval_to_tent(u)) + 1.0))),
        |p| p.map(|x| 2.0 * f64::from(warp::interval_to_tent_pdf((2.0 * x - 1.0) as f32))).iter().product(),
    );
    for total in [disk, triangle, tent] {
        assert!((total - 1.0).abs() < 1e-3, "{total}");
    }
}

/// Barycentric weights as distance from the first corner and place between the other two; its area is s·ds·dt.
fn triangle_to_fan(b: Vec2) -> [f64; 2] {
    let s = f64::from(b.x) + f64::from(b.y);
    [s, if s > 0.0 { f64::from(b.y) / s } else { 0.0 }]
}

fn fan_to_triangle([s, t]: [f64; 2]) -> Vec2 {
    Vec2::new((s * (1.0 - t)) as f32, (s * t) as f32)
}
