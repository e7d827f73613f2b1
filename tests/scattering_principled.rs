//! Sampling and densities, energy and reciprocity of the principled models.

use crate::support::bsdfs::{
    Chart, check_bsdf, check_facets, check_reciprocity, directions_of_both_sides, scattered_energy,
};
use buffon::bsdf::{Bsdf, Principled, PrincipledThin};
use buffon::color::Rgb;
use buffon::math::Vec3;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::f32::consts::TAU;

const BASE: Rgb = Rgb::new(0.2, 0.5, 0.9);

/// Returns materials of one and of many lobes, sharp and broad.
fn materials() -> Vec<(&'static str, Principled)> {
    let base = Principled { base_color: BASE, ..Principled::default() };
    let coat = Principled { clearcoat: 1.0, clearcoat_gloss: 1.0, sheen: 0.5, sheen_tint: 0.5, ..base };
    vec![
        ("default", base),
        ("metal", Principled { metallic: 1.0, roughness: 0.03, ..base }),
        ("brushed", Principled { metallic: 0.8, roughness: 0.5, anisotropy: 0.9, spec_tint: 0.5, ..base }),
        ("glass", Principled { spec_trans: 1.0, roughness: 0.1, ..base }),
        (
            "milk",
            Principled { spec_trans: 0.5, roughness: 1.0, eta: 1.7, flatness: 0.7, metallic: 0.1, ..base },
        ),
        ("coat", Principled { roughness: 0.6, ..coat }),
        ("dull coat", Principled { roughness: 0.1, clearcoat_gloss: 0.0, spec_trans: 0.3, eta: 0.6, ..coat }),
    ]
}

fn sheets() -> Vec<(&'static str, PrincipledThin)> {
    let base = PrincipledThin { base_color: BASE, ..PrincipledThin::default() };
    vec![
        ("default", base),
        ("paper", PrincipledThin { diff_trans: 0.7, sheen: 1.0, sheen_tint: 0.5, flatness: 0.5, ..base }),
        ("window", PrincipledThin { spec_trans: 1.0, roughness: 0.04, ..base }),
        (
            "frosted",
            PrincipledThin { spec_trans: 0.6, spec_tint: 0.5, roughness: 0.5, diff_trans: 1.0, ..base },
        ),
        ("brushed", PrincipledThin { spec_trans: 0.9, anisotropy: 0.8, roughness: 0.6, eta: 1.2, ..base }),
    ]
}

#[test]
fn principled_samples_follow_their_density() {
    let (materials, directions) = (materials(), directions_of_both_sides());
    let tests = materials.len() * directions.len() * 2;
    for (name, material) in materials {
        let bsdf = Bsdf::Principled(material);
        for &wo in &directions {
            if wo.z < 0.0 && !bsdf.transmits() {
                assert!(bsdf.sample(wo, 0.5, [0.5, 0.5].into()).is_none());
                continue;
            }
            // The sharpest lobe of the material determines the chart.
            let coat = if material.clearcoat > 0.0 { 0.1 - 0.099 * material.clearcoat_gloss } else { 1.0 };
            let alpha = f64::from(material.roughness.powi(2).max(1e-3).min(coat));
            check_facets(name, tests, &bsdf, [alpha; 2], wo, Chart::Mirrored);
            if bsdf.transmits() {
                let eta = f64::from(if wo.z > 0.0 { material.eta } else { 1.0 / material.eta });
                check_facets(name, tests, &bsdf, [alpha; 2], wo, Chart::Refracted(eta));
            }
        }
    }
}

#[test]
fn thin_principled_samples_follow_their_density() {
    let (sheets, directions) = (sheets(), directions_of_both_sides());
    let tests = sheets.len() * directions.len() * 3;
    for (name, sheet) in sheets {
        let bsdf = Bsdf::PrincipledThin(sheet);
        for &wo in &directions {
            let alpha = f64::from(sheet.roughness.powi(2).max(1e-3));
            check_facets(name, tests, &bsdf, [alpha; 2], wo, Chart::Mirrored);
            if bsdf.transmits() {
                let scale = f64::from(0.65 * sheet.eta - 0.35).powi(2);
                check_facets(name, tests, &bsdf, [(alpha * scale).max(1e-3); 2], wo, Chart::Through);
            }
            if alpha > 0.1 {
                check_bsdf(name, tests, &bsdf, wo);
            }
        }
    }
}

fn at_cosine(z: f32) -> Vec3 {
    Vec3::new((1.0 - z * z).sqrt(), 0.0, z)
}

/// The fraction of energy that white materials scatter. Some gain energy, because the models are defined so. The test
/// checks that the fractions do not change.
#[test]
fn principled_models_gain_what_their_documentation_says() {
    let cosines = [1.0, 0.5, 0.1];
    let check = |name: &str, bsdf: Bsdf, expected: [f32; 3]| {
        for (z, expected) in cosines.into_iter().zip(expected) {
            let energy = scattered_energy(&bsdf, at_cosine(z)).max_component();
            assert!((energy - expected).abs() < 0.01, "{name} at {z}: {energy}, expected {expected}");
        }
    };
    let white = Principled { base_color: Rgb::WHITE, ..Principled::default() };
    for (name, material, expected) in [
        ("default", white, [1.04, 1.08, 1.18]),
        ("rough", Principled { roughness: 1.0, ..white }, [1.05, 1.08, 1.42]),
        ("smooth", Principled { roughness: 0.0, ..white }, [1.02, 1.05, 1.26]),
        ("metal", Principled { metallic: 1.0, ..white }, [0.92, 0.86, 0.85]),
        ("glass", Principled { spec_trans: 1.0, ..white }, [0.99, 0.96, 0.88]),
        ("flat", Principled { flatness: 1.0, ..white }, [0.79, 1.15, 1.44]),
        ("sheen", Principled { sheen: 1.0, ..white }, [1.04, 1.09, 1.25]),
        ("coat", Principled { clearcoat: 1.0, ..white }, [1.07, 1.09, 1.19]),
    ] {
        check(name, Bsdf::Principled(material), expected);
    }
    let white = PrincipledThin { base_color: Rgb::WHITE, ..PrincipledThin::default() };
    for (name, sheet, expected) in [
        ("thin default", white, [1.01, 1.01, 1.02]),
        ("thin rough", PrincipledThin { roughness: 1.0, ..white }, [1.04, 1.06, 1.38]),
        ("thin specular", PrincipledThin { spec_trans: 1.0, ..white }, [0.97, 0.93, 0.69]),
        ("thin flat", PrincipledThin { flatness: 1.0, ..white }, [0.75, 1.08, 1.28]),
        ("thin sheen", PrincipledThin { sheen: 1.0, ..white }, [1.01, 1.02, 1.09]),
        ("thin transmission", PrincipledThin { diff_trans: 2.0, ..white }, [1.0, 1.0, 1.0]),
    ] {
        check(name, Bsdf::PrincipledThin(sheet), expected);
    }
}

fn direction([z, phi]: [f32; 2]) -> Vec3 {
    let r = (1.0 - z * z).sqrt();
    Vec3::new(r * phi.cos(), r * phi.sin(), z).normalize()
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300,
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(23),
        ..ProptestConfig::default()
    })]

    /// For any parameters, samples are valid, the BSDF is reciprocal, and the gain is bounded.
    #[test]
    fn principled_is_valid_and_reciprocal(
        color in prop::array::uniform3(0f32..=1.0),
        [roughness, anisotropy, metallic, spec_trans] in prop::array::uniform4(0f32..=1.0),
        [spec_tint, sheen, sheen_tint, flatness, clearcoat, clearcoat_gloss] in prop::array::uniform6(0f32..=1.0),
        eta in 0.5f32..=2.5,
        (z_o, z_i) in (-1f32..=1.0, -1f32..=1.0),
        (phi_o, phi_i) in (0f32..TAU, 0f32..TAU),
        zeros in any::<u16>(),
    ) {
        let on = |bit: u32, value: f32| if zeros >> bit & 1 == 0 { value } else { 0.0 };
        let material = Principled {
            base_color: Rgb::from(color),
            roughness: on(0, roughness),
            anisotropy: on(1, anisotropy),
            metallic: on(2, metallic),
            spec_trans: on(3, spec_trans),
            eta,
            spec_tint: on(4, spec_tint),
            sheen: on(5, sheen),
            sheen_tint: on(6, sheen_tint),
            flatness: on(7, flatness),
            clearcoat: on(8, clearcoat),
            clearcoat_gloss,
        };
        let (wo, wi) = (direction([z_o, phi_o]), direction([z_i, phi_i]));
        let bsdf = Bsdf::Principled(material);
        let energy = scattered_energy(&bsdf, wo).luminance();
        prop_assert!(energy <= PRINCIPLED_BOUND, "{bsdf:?} {wo}: {energy}");
        check_reciprocity(&bsdf, wo, wi, eta);
        check_reciprocity(&bsdf, wo, Vec3::new(wi.x, wi.y, -wi.z), eta);
    }

    #[test]
    fn thin_principled_is_valid_and_reciprocal(
        color in prop::array::uniform3(0f32..=1.0),
        [roughness, anisotropy, spec_trans, spec_tint] in prop::array::uniform4(0f32..=1.0),
        [sheen, sheen_tint, flatness, diff_trans] in prop::array::uniform4(0f32..=1.0),
        eta in 0.5f32..=2.5,
        (z_o, z_i) in (-1f32..=1.0, -1f32..=1.0),
        (phi_o, phi_i) in (0f32..TAU, 0f32..TAU),
        zeros in any::<u16>(),
    ) {
        let on = |bit: u32, value: f32| if zeros >> bit & 1 == 0 { value } else { 0.0 };
        let sheet = PrincipledThin {
            base_color: Rgb::from(color),
            roughness: on(0, roughness),
            anisotropy: on(1, anisotropy),
            spec_trans: on(2, spec_trans),
            eta,
            spec_tint: on(3, spec_tint),
            sheen: on(4, sheen),
            sheen_tint: on(5, sheen_tint),
            flatness: on(6, flatness),
            diff_trans: on(7, 2.0 * diff_trans),
        };
        let (wo, wi) = (direction([z_o, phi_o]), direction([z_i, phi_i]));
        let bsdf = Bsdf::PrincipledThin(sheet);
        let energy = scattered_energy(&bsdf, wo).luminance();
        prop_assert!(energy <= THIN_BOUND, "{bsdf:?} {wo}: {energy}");
        let up = |w: Vec3| w * 1f32.copysign(w.z);
        check_reciprocity(&bsdf, up(wo), up(wi), 1.0);
        // Grazing microfacets transmit in one direction only. This is noticeable without diffuse transmission.
        if sheet.diff_trans == 0.0 {
            check_reciprocity(&bsdf, up(wo), -up(wi), 1.0);
        }
    }
}

/// Upper bounds on the gain. The largest gains of 6000 random materials are 2.35 and 1.67; those of single lobes are in
/// the documentation.
const PRINCIPLED_BOUND: f32 = 2.4;
const THIN_BOUND: f32 = 1.7;
