//! Hair and polarised plastic.

use crate::support::bsdfs::{
    check_bsdf, check_reciprocity, directions, directions_of_both_sides, scattered_energy,
};
use buffon::bsdf::hair::Fibre;
use buffon::bsdf::microfacet::{Distribution, Microfacets};
use buffon::bsdf::{Bsdf, Hair, PolarizedPlastic};
use buffon::color::Rgb;
use buffon::math::Vec3;

fn hair(sigma_a: Rgb, roughness: [f32; 2], tilt: f32) -> Bsdf<'static> {
    Bsdf::Hair(Hair { sigma_a, eta: 1.55, fibre: Fibre::new(roughness, tilt) })
}

#[test]
fn samples_follow_their_density() {
    let absorption = Rgb::new(0.4, 0.8, 1.6);
    let mut models = Vec::new();
    for roughness in [[0.3, 0.3], [0.5, 0.2], [0.25, 0.9]] {
        for tilt in [0.0, 0.05, -0.2] {
            models.push(hair(absorption, roughness, tilt));
        }
    }
    let directions = directions_of_both_sides();
    for bsdf in &models {
        for &wo in &directions {
            check_bsdf(&format!("{bsdf:?}"), models.len() * directions.len(), bsdf, wo);
        }
    }
}

/// A fibre that absorbs nothing scatters all light, whatever its roughness.
#[test]
fn a_clear_fibre_keeps_all_light() {
    for roughness in [1e-3, 0.05, 0.3, 1.0] {
        for tilt in [0.0, 0.03, -0.5] {
            for wo in directions_of_both_sides() {
                let energy = scattered_energy(&hair(Rgb::BLACK, [roughness; 2], tilt), wo);
                assert!((energy.r - 1.0).abs() < 1e-3, "{roughness} {tilt} {wo}: {energy:?}");
            }
        }
    }
}

/// Light along the normal of a fibre goes through its axis: one diameter for the second lobe. With a strong absorption,
/// only the Fresnel reflection is left.
#[test]
fn absorption_is_exponential() {
    let reflected = ((1.55f32 - 1.0) / (1.55 + 1.0)).powi(2);
    for sigma_a in [0.1f32, 1.0, 30.0] {
        let passed = (-2.0 * sigma_a).exp();
        let expected = reflected + (1.0 - reflected).powi(2) * passed / (1.0 - reflected * passed);
        let energy = scattered_energy(&hair(Rgb::splat(sigma_a), [0.3; 2], 0.0), Vec3::Z).g;
        assert!((energy / expected - 1.0).abs() < 2e-3, "{sigma_a}: {energy} and {expected}");
    }
}

#[test]
fn polarised_plastic_is_reciprocal_and_loses_light() {
    for distribution in [Distribution::Beckmann, Distribution::Ggx] {
        for [alpha_x, alpha_y] in [[0.1, 0.1], [0.2, 0.6]] {
            let bsdf = Bsdf::PolarizedPlastic(PolarizedPlastic {
                microfacets: Microfacets { distribution, alpha_x, alpha_y, sample_visible: true },
                diffuse_reflectance: Rgb::WHITE,
                specular_reflectance: Rgb::WHITE,
                eta: 1.49,
            });
            for &wo in &directions() {
                assert!(scattered_energy(&bsdf, wo).r < 1.0);
                check_bsdf(&format!("{bsdf:?}"), 16, &bsdf, wo);
                for &wi in &directions() {
                    check_reciprocity(&bsdf, wo, wi, 1.0);
                }
            }
        }
    }
}
