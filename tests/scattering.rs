//! Sampling and densities of diffuse reflection, conductors and all warps.

use crate::support::bsdfs::{
    Chart, check_bsdf, check_facets, check_reciprocity, directions, scattered_energy,
};
use crate::support::chi2::{check_directions, check_square};
use buffon::bsdf::fresnel::ConductorFresnel;
use buffon::bsdf::microfacet::{Distribution, Microfacets};
use buffon::bsdf::{Bsdf, Diffuse, RoughConductor};
use buffon::color::Rgb;
use buffon::math::{Vec2, Vec3};
use buffon::sampling::warp;
use std::f64::consts::TAU;

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

/// Lobes of small roughness, over the slopes of the microfacet between both directions, in units of the roughness.
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
                    let name = format!("{distribution:?} {alpha:?} visible {visible}");
                    check_facets(&name, tests, &bsdf, alpha.map(f64::from), wo, Chart::Mirrored);
                }
            }
        }
    }
}

/// If every microfacet reflects all light, no energy is gained, and the BSDF is reciprocal.
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
                let albedo = scattered_energy(&mirror, wo).r;
                assert!(albedo < 1.0 + 1e-3, "{distribution:?} {alpha} {wo}: {albedo}");
                let wi = Vec3::new(-0.2, 0.5, 0.7).normalize();
                check_reciprocity(&mirror, wo, wi, 1.0);
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
        // The first axis of the square is 1 − cosθ, from 0 to the edge of the cone.
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

/// Maps barycentric weights to (s, t): distance from the first corner, position between the others; area s·ds·dt.
fn triangle_to_fan(b: Vec2) -> [f64; 2] {
    let s = f64::from(b.x) + f64::from(b.y);
    [s, if s > 0.0 { f64::from(b.y) / s } else { 0.0 }]
}

fn fan_to_triangle([s, t]: [f64; 2]) -> Vec2 {
    Vec2::new((s * (1.0 - t)) as f32, (s * t) as f32)
}
