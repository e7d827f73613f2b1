//! Sampling and densities, energy and reciprocity of dielectric boundaries and plastic.

use crate::support::bsdfs::{
    Chart, DIFFUSE, check_bsdf, check_facets, check_reciprocity, directions, directions_of_both_sides,
    scattered_energy,
};
use buffon::bsdf::fresnel::ConductorFresnel;
use buffon::bsdf::microfacet::{Distribution, Microfacets};
use buffon::bsdf::{
    Bsdf, Coating, Lobe, Plastic, RoughBoundary, RoughConductor, RoughDielectric, RoughPlastic,
    RoughTransmittance, ThinDielectric, TwoSided,
};
use buffon::color::Rgb;
use buffon::math::{Vec2, Vec3};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::f32::consts::TAU;

const DISTRIBUTIONS: [Distribution; 2] = [Distribution::Beckmann, Distribution::Ggx];

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(17),
        ..ProptestConfig::default()
    }
}

fn glass(
    distribution: Distribution,
    [alpha_x, alpha_y]: [f32; 2],
    sample_visible: bool,
    eta: f32,
) -> Bsdf<'static> {
    Bsdf::RoughDielectric(RoughDielectric {
        microfacets: Microfacets { distribution, alpha_x, alpha_y, sample_visible },
        eta,
        specular_reflectance: Rgb::new(1.0, 0.9, 0.5),
        specular_transmittance: Rgb::new(0.8, 1.0, 0.6),
    })
}

fn check_glass(alpha: [f32; 2], visible: bool, eta: f32) {
    let directions = directions_of_both_sides();
    let tests = directions.len() * 4 * 7;
    for distribution in DISTRIBUTIONS {
        let bsdf = glass(distribution, alpha, visible, eta);
        for &wo in &directions {
            let name = format!("{distribution:?} {alpha:?} visible {visible} eta {eta}");
            let eta = f64::from(if wo.z > 0.0 { eta } else { 1.0 / eta });
            for chart in [Chart::Mirrored, Chart::Refracted(eta)] {
                check_facets(&name, tests, &bsdf, alpha.map(f64::from), wo, chart);
            }
        }
    }
}

#[test]
fn rough_dielectric_samples_follow_their_density() {
    check_glass([0.05, 0.4], true, 1.7);
    check_glass([0.3, 0.3], false, 0.6);
}

#[test]
#[ignore = "takes long: make test-all"]
fn isotropic_rough_dielectric_samples_follow_their_density() {
    check_glass([0.1, 0.1], true, 1.5);
    check_glass([1.0, 1.0], true, 1.5);
}

#[test]
#[ignore = "takes long: make test-all"]
fn sharp_rough_dielectric_samples_follow_their_density() {
    check_glass([1e-3, 1e-3], true, 1.5);
    check_glass([1e-3, 0.02], true, 0.6);
    check_glass([0.01, 0.01], false, 2.4);
}

/// Broad lobes, over the whole sphere of directions.
#[test]
fn rough_dielectric_samples_follow_their_density_over_the_sphere() {
    let directions = directions_of_both_sides();
    for (distribution, alpha, eta) in
        [(Distribution::Ggx, 0.5, 1.5), (Distribution::Beckmann, 0.7, 0.6), (Distribution::Ggx, 1.0, 2.4)]
    {
        let bsdf = glass(distribution, [alpha; 2], true, eta);
        for &wo in &directions {
            check_bsdf(&format!("{distribution:?} {alpha} eta {eta}"), 3 * directions.len(), &bsdf, wo);
        }
    }
}

#[test]
fn rough_boundaries_between_equals_let_light_pass() {
    let bsdf = glass(Distribution::Ggx, [0.5, 0.5], true, 1.0);
    assert!(bsdf.is_specular() && bsdf.transmits());
    for wo in directions_of_both_sides() {
        let s = bsdf.sample(wo, 0.5, Vec2::splat(0.5)).unwrap();
        assert_eq!((s.wi, s.lobe, s.eta, s.weight), (-wo, Lobe::Specular, 1.0, Rgb::new(0.8, 1.0, 0.6)));
        assert_eq!(bsdf.eval(wo, -wo).f, Rgb::BLACK);
    }
}

/// The samples of a boundary with almost flat microfacets are close to those of a smooth boundary.
#[test]
fn nearly_smooth_boundaries_are_smooth() {
    let smooth = buffon::bsdf::Dielectric {
        eta: 1.5,
        specular_reflectance: Rgb::new(1.0, 0.9, 0.5),
        specular_transmittance: Rgb::new(0.8, 1.0, 0.6),
    };
    for distribution in DISTRIBUTIONS {
        let rough = glass(distribution, [1e-4, 1e-4], true, 1.5);
        for wo in directions_of_both_sides() {
            for u_lobe in [0.0, 0.999_999] {
                let (Some(a), Some(b)) =
                    (smooth.sample(wo, u_lobe), rough.sample(wo, u_lobe, Vec2::splat(0.4)))
                else {
                    continue;
                };
                assert!((a.wi - b.wi).length() < 2e-3 && (a.eta - b.eta).abs() < 1e-6, "{wo} {a:?} {b:?}");
            }
            let (a, b) = (scattered_energy(&Bsdf::Dielectric(smooth), wo), scattered_energy(&rough, wo));
            for c in 0..3 {
                assert!((a[c] - b[c]).abs() < 5e-3, "{wo} {a:?} {b:?}");
            }
        }
    }
}

proptest! {
    #![proptest_config(config(200))]

    /// No energy is gained, samples are valid and agree with evaluation, and the BSDF is reciprocal.
    #[test]
    fn rough_dielectrics_conserve_energy_and_are_reciprocal(
        ggx in any::<bool>(),
        log_alpha in prop::array::uniform2(-4f32..=0.0),
        log_eta in -1f32..=1.0,
        (z_o, z_i) in (-1f32..=1.0, -1f32..=1.0),
        (phi_o, phi_i) in (0f32..TAU, 0f32..TAU),
    ) {
        let distribution = DISTRIBUTIONS[usize::from(ggx)];
        let eta = log_eta.exp();
        let bsdf = glass(distribution, log_alpha.map(|a| 10f32.powf(a)), true, eta);
        let direction = |z: f32, phi: f32| {
            let r = (1.0 - z * z).sqrt();
            Vec3::new(r * phi.cos(), r * phi.sin(), z).normalize()
        };
        let (wo, wi) = (direction(z_o, phi_o), direction(z_i, phi_i));
        let energy = scattered_energy(&bsdf, wo).max_component();
        prop_assert!(energy <= 1.0 + 1e-3, "{bsdf:?} {wo}: {energy}");
        check_reciprocity(&bsdf, wo, wi, eta);
    }

    #[test]
    fn thin_dielectrics_conserve_energy(log_eta in -1f32..=1.0, z in -1f32..=1.0) {
        let bsdf = Bsdf::ThinDielectric(ThinDielectric {
            eta: log_eta.exp(),
            specular_reflectance: Rgb::WHITE,
            specular_transmittance: Rgb::WHITE,
            passing: 0.0,
        });
        let energy = scattered_energy(&bsdf, Vec3::new((1.0 - z * z).sqrt(), 0.0, z)).r;
        prop_assert!((energy - 1.0).abs() < 1e-5, "{bsdf:?} {z}: {energy}");
    }

    /// The energy gain of plastic is at most the error of the fit of internal reflection: 1.3·10⁻³ up to an index of 2.
    #[test]
    fn plastic_conserves_energy_but_for_its_fit(
        eta in 1f32..=2.0,
        reflectance in prop::array::uniform3(0f32..=1.0),
        nonlinear in any::<bool>(),
        z in 0f32..=1.0,
    ) {
        let wo = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
        for reflectance in [Rgb::from(reflectance), Rgb::WHITE] {
            let bsdf = Bsdf::Plastic(Plastic::new(reflectance, Rgb::WHITE, eta, nonlinear));
            let energy = scattered_energy(&bsdf, wo).max_component();
            prop_assert!(energy <= 1.0 + 1.3e-3 + 1e-3, "{bsdf:?} {wo}: {energy}");
        }
    }
}

proptest! {
    // Each case computes a table of transmittance.
    #![proptest_config(config(12))]

    #[test]
    fn rough_plastic_conserves_energy_and_is_reciprocal(
        ggx in any::<bool>(),
        log_alpha in -4f32..=0.0,
        eta in 1.05f32..=2.0,
        nonlinear in any::<bool>(),
    ) {
        let (distribution, alpha) = (DISTRIBUTIONS[usize::from(ggx)], 10f32.powf(log_alpha));
        let transmittance = RoughTransmittance::new(distribution, alpha, eta);
        let bsdf = rough_plastic(&transmittance, distribution, alpha, true, eta, nonlinear, Rgb::WHITE);
        for wo in directions() {
            let energy = scattered_energy(&bsdf, wo).max_component();
            prop_assert!(energy <= 1.0 + 1e-3, "{bsdf:?} {wo}: {energy}");
            for wi in directions() {
                check_reciprocity(&bsdf, wo, wi, 1.0);
            }
        }
    }
}

fn rough_plastic(
    transmittance: &RoughTransmittance,
    distribution: Distribution,
    alpha: f32,
    sample_visible: bool,
    eta: f32,
    nonlinear: bool,
    diffuse_reflectance: Rgb,
) -> Bsdf<'_> {
    Bsdf::RoughPlastic(RoughPlastic {
        microfacets: Microfacets { distribution, alpha_x: alpha, alpha_y: alpha, sample_visible },
        diffuse_reflectance,
        specular_reflectance: Rgb::WHITE,
        eta,
        nonlinear,
        transmittance,
    })
}

#[test]
fn plastic_samples_follow_their_density() {
    let directions = directions();
    for eta in [1.5, 0.8] {
        let bsdf = Bsdf::Plastic(Plastic::new(Rgb::new(0.2, 0.5, 0.9), Rgb::new(0.5, 1.0, 0.8), eta, true));
        assert!(!bsdf.is_specular() && bsdf.chooses_lobe());
        for &wo in &directions {
            // Beyond the critical angle only specular reflection remains.
            if wo.z > 0.6 || eta > 1.0 {
                check_bsdf(&format!("plastic {eta}"), 2 * directions.len(), &bsdf, wo);
            }
            for wi in &directions {
                check_reciprocity(&bsdf, wo, *wi, 1.0);
            }
        }
        assert!(bsdf.sample(Vec3::new(0.6, 0.0, -0.8), 0.5, Vec2::splat(0.5)).is_none());
    }
}

#[test]
fn rough_plastic_samples_follow_their_density() {
    let directions = directions();
    let alphas = [1e-3, 0.1, 1.0];
    let tests = alphas.len() * 4 * directions.len();
    for distribution in DISTRIBUTIONS {
        for alpha in alphas {
            let transmittance = RoughTransmittance::new(distribution, alpha, 1.5);
            for visible in [true, false] {
                let base = Rgb::new(0.2, 0.5, 0.9);
                let bsdf = rough_plastic(&transmittance, distribution, alpha, visible, 1.5, true, base);
                let name = format!("rough plastic {distribution:?} {alpha} visible {visible}");
                for &wo in &directions {
                    check_facets(&name, tests, &bsdf, [f64::from(alpha); 2], wo, Chart::Mirrored);
                }
            }
        }
    }
}

/// A rough coating over a rough metal: samples follow their density, no light is gained, and a coating that is nearly
/// smooth reflects nearly as much as a smooth one.
#[test]
fn rough_coating_samples_follow_their_density() {
    let directions = directions();
    let metal = Bsdf::RoughConductor(RoughConductor {
        microfacets: Microfacets {
            distribution: Distribution::Ggx,
            alpha_x: 0.3,
            alpha_y: 0.3,
            sample_visible: true,
        },
        fresnel: ConductorFresnel { eta: Rgb::new(0.2, 0.9, 1.1), k: Rgb::new(3.9, 2.4, 2.2) },
        specular_reflectance: Rgb::WHITE,
    });
    let depth = Rgb::new(0.0, 0.1, 0.5);
    let smooth = Coating { eta: 1.5, depth, specular_reflectance: Rgb::WHITE, rough: None, inner: &metal };
    let alphas = [1e-3, 0.1, 1.0];
    let tests = alphas.len() * 2 * directions.len();
    for distribution in DISTRIBUTIONS {
        for alpha in alphas {
            let transmittance = RoughTransmittance::new(distribution, alpha, 1.5);
            let microfacets =
                Microfacets { distribution, alpha_x: alpha, alpha_y: alpha, sample_visible: true };
            let rough = Some(RoughBoundary { microfacets, transmittance: &transmittance });
            let bsdf = Bsdf::Coating(Coating { rough, ..smooth });
            assert!(!bsdf.is_specular() && bsdf.chooses_lobe());
            let name = format!("rough coating {distribution:?} {alpha}");
            for &wo in &directions {
                check_facets(&name, tests, &bsdf, [f64::from(alpha); 2], wo, Chart::Mirrored);
                let energy = scattered_energy(&bsdf, wo);
                assert!(energy.max_component() <= 1.0 + 1e-3, "{name} {wo}: {energy:?}");
                for wi in &directions {
                    check_reciprocity(&bsdf, wo, *wi, 1.0);
                }
                if alpha == 1e-3 {
                    let smooth = scattered_energy(&Bsdf::Coating(smooth), wo);
                    for c in 0..3 {
                        let (rough, smooth) = (energy[c], smooth[c]);
                        assert!((rough - smooth).abs() < 0.01, "{name} {wo}: {rough} {smooth}");
                    }
                }
            }
        }
    }
}

/// Both sides are coated. From the denser side, all light that cannot enter the coating is reflected.
#[test]
fn coatings_have_two_sides_and_reflect_beyond_the_critical_angle() {
    let inner = Bsdf::TwoSided(TwoSided { sides: [&DIFFUSE, &DIFFUSE] });
    let transmittance = RoughTransmittance::new(Distribution::Ggx, 0.01, 0.75);
    let microfacets =
        Microfacets { distribution: Distribution::Ggx, alpha_x: 0.01, alpha_y: 0.01, sample_visible: true };
    let boundary = RoughBoundary { microfacets, transmittance: &transmittance };
    for rough in [None, Some(boundary)] {
        let coating =
            Coating { eta: 0.75, depth: Rgb::BLACK, specular_reflectance: Rgb::WHITE, rough, inner: &inner };
        let bsdf = Bsdf::Coating(coating);
        for wo in directions() {
            let below = Vec3::new(wo.x, wo.y, -wo.z);
            let [front, back] = [wo, below].map(|wo| scattered_energy(&bsdf, wo).r);
            assert!((front - back).abs() < 2e-3, "{wo}: {front} {back}");
            // The critical angle is 49°.
            assert!(front < 1.0 + 2e-3 && (wo.z > 0.4 || front > 0.95), "{wo}: {front}");
            for wi in directions() {
                let mirrored = bsdf.eval(below, Vec3::new(wi.x, wi.y, -wi.z));
                assert_eq!(bsdf.eval(wo, wi), mirrored, "{wo} {wi}");
            }
        }
    }
}
