//! The models of Phong, Ward, and Oren and Nayar, and diffuse transmission.

use crate::support::bsdfs::{check_bsdf, check_reciprocity, directions, scattered_energy};
use buffon::bsdf::empirical::WardVariant;
use buffon::bsdf::microfacet::{Distribution, Microfacets};
use buffon::bsdf::{Bsdf, DiffuseAnd, DiffuseTransmitter, Phong, RoughDiffuse, Ward};
use buffon::color::Rgb;
use buffon::math::{Vec2, Vec3};

const VARIANTS: [WardVariant; 3] = [WardVariant::Original, WardVariant::Duer, WardVariant::Balanced];

fn phong(exponent: f32, diffuse: Rgb, specular: Rgb) -> Bsdf<'static> {
    let lobe = Phong { exponent };
    Bsdf::Phong(DiffuseAnd { diffuse_reflectance: diffuse, specular_reflectance: specular, lobe })
}

fn ward(variant: WardVariant, alpha: [f32; 2], diffuse: Rgb, specular: Rgb) -> Bsdf<'static> {
    let distribution = Distribution::Beckmann;
    let microfacets =
        Microfacets { distribution, alpha_x: alpha[0], alpha_y: alpha[1], sample_visible: false };
    let lobe = Ward { microfacets, variant };
    Bsdf::Ward(DiffuseAnd { diffuse_reflectance: diffuse, specular_reflectance: specular, lobe })
}

fn rough_diffuse(reflectance: Rgb, alpha: f32, qualitative: bool) -> Bsdf<'static> {
    Bsdf::RoughDiffuse(RoughDiffuse { reflectance, sigma: alpha / 2f32.sqrt(), qualitative })
}

const DIFFUSE: Rgb = Rgb::new(0.2, 0.5, 0.1);
const SPECULAR: Rgb = Rgb::new(0.3, 0.2, 0.6);

#[test]
fn samples_follow_their_density() {
    let mut models = vec![
        rough_diffuse(DIFFUSE, 0.6, false),
        rough_diffuse(DIFFUSE, 0.6, true),
        Bsdf::DiffuseTransmitter(DiffuseTransmitter { transmittance: DIFFUSE }),
    ];
    models.extend([0.0, 1.0, 30.0, 300.0].map(|exponent| phong(exponent, DIFFUSE, SPECULAR)));
    for alpha in [[0.2, 0.2], [0.15, 0.6]] {
        models.extend(VARIANTS.map(|variant| ward(variant, alpha, DIFFUSE, SPECULAR)));
    }
    let directions = directions();
    for bsdf in &models {
        for &wo in &directions {
            check_bsdf(&format!("{bsdf:?}"), models.len() * directions.len(), bsdf, wo);
            for &wi in &directions {
                check_reciprocity(bsdf, wo, wi, 1.0);
            }
        }
        let below = bsdf.sample(Vec3::new(0.6, 0.0, -0.8), 0.5, Vec2::splat(0.5));
        assert_eq!(below.is_some(), bsdf.transmits());
    }
}

#[test]
fn no_light_is_created() {
    let white = Rgb::WHITE;
    for &wo in &directions() {
        for exponent in [0.0, 5.0, 1e3, 1e6] {
            let energy = scattered_energy(&phong(exponent, Rgb::BLACK, white), wo).r;
            assert!(energy < 1.002, "exponent {exponent}: {energy} from {wo}");
            // A sharp lobe at the normal reflects everything.
            assert!(exponent < 1e3 || wo.z < 1.0 || energy > 0.997, "exponent {exponent}: {energy}");
        }
        for alpha in [[0.01, 0.01], [0.2, 0.2], [0.1, 0.5]] {
            let energy = scattered_energy(&ward(WardVariant::Balanced, alpha, Rgb::BLACK, white), wo).r;
            assert!(energy < 1.01, "Ward {alpha:?}: {energy} from {wo}");
        }
        let energy = scattered_energy(&rough_diffuse(white, 0.0, false), wo).r;
        assert!((energy - 1.0).abs() < 1e-3, "{energy}");
        let paper = Bsdf::DiffuseTransmitter(DiffuseTransmitter { transmittance: white });
        assert!((scattered_energy(&paper, wo).r - 1.0).abs() < 1e-3);
    }
}

/// Values of the published formulas in `f64`, with Ward's half vector and its length as in the papers.
#[test]
fn values_are_those_of_the_papers() {
    let pairs = [
        ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7]),
        ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3]),
        ([0.1, 0.2, 0.9], [0.5, -0.3, 0.4]),
    ];
    let models = [
        (
            phong(12.0, DIFFUSE, SPECULAR),
            [[0.62191, 0.53132, 1.14833], [0.358035, 0.355403, 0.620576], [0.0643581, 0.159619, 0.0332232]],
        ),
        (
            ward(WardVariant::Original, [0.3, 0.15], DIFFUSE, SPECULAR),
            [
                [0.543863, 0.479289, 0.992233],
                [0.0636622, 0.159155, 0.0318313],
                [0.077497, 0.168378, 0.059501],
            ],
        ),
        (
            ward(WardVariant::Duer, [0.3, 0.15], DIFFUSE, SPECULAR),
            [
                [0.683792, 0.572575, 1.27209],
                [0.0636626, 0.159155, 0.0318323],
                [0.0823341, 0.171603, 0.0691753],
            ],
        ),
        (
            ward(WardVariant::Balanced, [0.3, 0.15], DIFFUSE, SPECULAR),
            [
                [0.689215, 0.57619, 1.28294],
                [0.0636628, 0.159155, 0.0318326],
                [0.0862479, 0.174212, 0.0770028],
            ],
        ),
        (
            rough_diffuse(Rgb::new(0.2, 0.5, 0.9), 0.6, false),
            [
                [0.0456512, 0.119581, 0.228332],
                [0.0300188, 0.0824334, 0.166107],
                [0.053419, 0.138269, 0.260217],
            ],
        ),
        (rough_diffuse(Rgb::new(0.2, 0.5, 0.9), 0.6, true), [[0.0524275, 0.131069, 0.235924]; 3]),
    ];
    for (bsdf, expected) in &models {
        for ((wo, wi), expected) in pairs.iter().zip(expected) {
            check_value(bsdf, *wo, *wi, *expected);
        }
    }
    // Light and viewer on the same side of the normal.
    let (wo, wi, rho) = ([0.3, 0.5, 0.8], [0.2, 0.6, 0.4], Rgb::new(0.2, 0.5, 0.9));
    check_value(&rough_diffuse(rho, 0.6, false), wo, wi, [0.0649807, 0.166425, 0.309101]);
    check_value(&rough_diffuse(rho, 0.6, true), wo, wi, [0.0639122, 0.159781, 0.287605]);
}

fn check_value(bsdf: &Bsdf<'_>, wo: [f32; 3], wi: [f32; 3], expected: [f32; 3]) {
    let f = bsdf.eval(Vec3::from(wo).normalize(), Vec3::from(wi).normalize()).f;
    for c in 0..3 {
        let close = (f[c] - expected[c]).abs() <= 1e-4 * expected[c];
        assert!(close, "{bsdf:?} {wo:?} {wi:?}: {f:?}, expected {expected:?}");
    }
}
