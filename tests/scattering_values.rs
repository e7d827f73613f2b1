//! Values of Mitsuba 3.9.1 (`scalar_rgb`) for the same directions and parameters, divided by the cosine.

use buffon::bsdf::microfacet::{Distribution, Microfacets};
use buffon::bsdf::{
    Bsdf, Plastic, Principled, PrincipledThin, RoughDielectric, RoughPlastic, RoughTransmittance,
    ThinDielectric,
};
use buffon::color::Rgb;
use buffon::math::{Vec2, Vec3};

/// Two directions, which are not normalised, and the value.
type Row = ([f32; 3], [f32; 3], [f32; 3]);

const EXACT: f32 = 1e-4;
/// Mitsuba's rational approximation of Beckmann masking has an error of up to 0.35 % for each of two directions.
const BECKMANN: f32 = 7e-3;

const SPECULAR_REFLECTANCE: Rgb = Rgb::new(0.9, 0.8, 0.7);
const SPECULAR_TRANSMITTANCE: Rgb = Rgb::new(0.5, 0.6, 1.0);
const BASE: Rgb = Rgb::new(0.2, 0.5, 0.9);

fn check(bsdf: &Bsdf, tolerance: f32, rows: &[Row]) {
    for &(wo, wi, expected) in rows {
        let f = bsdf.eval(Vec3::from(wo).normalize(), Vec3::from(wi).normalize()).f;
        for c in 0..3 {
            let close = (f[c] - expected[c]).abs() <= tolerance * expected[c];
            assert!(close, "{bsdf:?} {wo:?} {wi:?}: {f:?}, expected {expected:?}");
        }
    }
}

fn microfacets(distribution: Distribution, alpha_x: f32, alpha_y: f32) -> Microfacets {
    Microfacets { distribution, alpha_x, alpha_y, sample_visible: true }
}

fn glass(distribution: Distribution, alpha_x: f32, alpha_y: f32, eta: f32) -> Bsdf<'static> {
    Bsdf::RoughDielectric(RoughDielectric {
        microfacets: microfacets(distribution, alpha_x, alpha_y),
        eta,
        specular_reflectance: SPECULAR_REFLECTANCE,
        specular_transmittance: SPECULAR_TRANSMITTANCE,
    })
}

#[test]
fn rough_dielectric() {
    check(
        &glass(Distribution::Ggx, 0.3, 0.15, 1.5),
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.0656106, 0.0583206, 0.0510305]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.0164116, 0.0145881, 0.0127646]),
            ([0.3, -0.5, 0.8], [-0.25, 0.3, -0.9], [4.60485, 5.52582, 9.2097]),
            ([-0.1, 0.2, -0.9], [0.3, -0.1, 0.8], [0.302709, 0.363251, 0.605418]),
            ([-0.4, 0.3, -0.6], [0.5, -0.2, -0.7], [0.184347, 0.163864, 0.143381]),
        ],
    );
    check(
        &glass(Distribution::Ggx, 0.6, 0.6, 1.0 / 1.33),
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.0134078, 0.011918, 0.0104283]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.429814, 0.382057, 0.3343]),
            ([0.3, -0.5, 0.8], [-0.25, 0.3, -0.9], [0.482731, 0.579278, 0.965463]),
            ([-0.1, 0.2, -0.9], [0.3, -0.1, 0.8], [0.255698, 0.306838, 0.511396]),
            ([-0.4, 0.3, -0.6], [0.5, -0.2, -0.7], [0.00659314, 0.00586057, 0.005128]),
        ],
    );
    check(
        &glass(Distribution::Beckmann, 0.4, 0.4, 1.5),
        BECKMANN,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.0320875, 0.0285223, 0.024957]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.168668, 0.149927, 0.131186]),
            ([0.3, -0.5, 0.8], [-0.25, 0.3, -0.9], [2.53636, 3.04363, 5.07272]),
            ([-0.1, 0.2, -0.9], [0.3, -0.1, 0.8], [1.27258, 1.5271, 2.54517]),
            ([-0.4, 0.3, -0.6], [0.5, -0.2, -0.7], [0.106283, 0.0944735, 0.0826643]),
        ],
    );
}

#[test]
fn plastic() {
    let plastic = |nonlinear| Plastic::new(BASE, SPECULAR_REFLECTANCE, 1.5, nonlinear);
    check(
        &Bsdf::Plastic(plastic(false)),
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.0639435, 0.159859, 0.287746]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.0399493, 0.0998732, 0.179772]),
            ([0.0, 0.0, 1.0], [0.6, 0.3, 0.5], [0.0629926, 0.157481, 0.283467]),
            ([0.1, -0.2, 0.05], [-0.3, 0.2, 0.1], [0.036702, 0.0917549, 0.165159]),
        ],
    );
    check(
        &Bsdf::Plastic(plastic(true)),
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.0292757, 0.0918669, 0.250645]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.0182903, 0.0573946, 0.156592]),
            ([0.0, 0.0, 1.0], [0.6, 0.3, 0.5], [0.0288404, 0.0905007, 0.246917]),
            ([0.1, -0.2, 0.05], [-0.3, 0.2, 0.1], [0.0168035, 0.0527293, 0.143864]),
        ],
    );
    // Weight and probability of specular reflection; the diffuse density is reduced by this probability.
    for (z, expected) in [
        (1.0f32, [0.036, 0.032, 0.028]),
        (0.6, [0.058_072_5, 0.051_62, 0.045_167_5]),
        (0.1, [0.514_433, 0.457_274, 0.400_115]),
    ] {
        let bsdf = plastic(true);
        let wo = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
        let s = bsdf.sample(wo, 0.0, Vec2::splat(0.5)).unwrap();
        assert_eq!(s.wi, Vec3::new(-wo.x, -wo.y, wo.z));
        let probability = 1.0 - bsdf.eval(wo, Vec3::Z).pdf * std::f32::consts::PI;
        for c in 0..3 {
            let value = s.weight[c] * probability;
            assert!((value - expected[c]).abs() <= EXACT * expected[c], "{z}: {value} {expected:?}");
        }
    }
}

fn check_rough_plastic(
    distribution: Distribution,
    alpha: f32,
    eta: f32,
    nonlinear: bool,
    tolerance: f32,
    rows: &[Row],
) {
    let bsdf = Bsdf::RoughPlastic(RoughPlastic {
        microfacets: microfacets(distribution, alpha, alpha),
        diffuse_reflectance: BASE,
        specular_reflectance: SPECULAR_REFLECTANCE,
        eta,
        nonlinear,
        transmittance: &RoughTransmittance::new(distribution, alpha, eta),
    });
    check(&bsdf, tolerance, rows);
}

#[test]
fn rough_plastic() {
    check_rough_plastic(
        Distribution::Ggx,
        0.3,
        1.5,
        true,
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.0744205, 0.120351, 0.214981]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.111289, 0.139125, 0.203082]),
            ([0.0, 0.0, 1.0], [0.6, 0.3, 0.5], [0.0324327, 0.0824049, 0.180515]),
            ([0.1, -0.2, 0.05], [-0.3, 0.2, 0.1], [0.0553257, 0.0879329, 0.155361]),
        ],
    );
    check_rough_plastic(
        Distribution::Ggx,
        0.1,
        1.8,
        false,
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.303437, 0.353878, 0.430437]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.0611479, 0.110277, 0.176762]),
            ([0.0, 0.0, 1.0], [0.6, 0.3, 0.5], [0.0536644, 0.130526, 0.233092]),
            ([0.1, -0.2, 0.05], [-0.3, 0.2, 0.1], [0.041467, 0.0892557, 0.153305]),
        ],
    );
    check_rough_plastic(
        Distribution::Beckmann,
        0.2,
        1.5,
        false,
        BECKMANN,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.163769, 0.239855, 0.345202]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.0407555, 0.100721, 0.180701]),
            ([0.0, 0.0, 1.0], [0.6, 0.3, 0.5], [0.0579514, 0.144308, 0.259464]),
            ([0.1, -0.2, 0.05], [-0.3, 0.2, 0.1], [0.0377716, 0.094429, 0.169972]),
        ],
    );
}

#[test]
fn principled() {
    check(
        &Bsdf::Principled(Principled {
            base_color: BASE,
            roughness: 0.4,
            anisotropy: 0.5,
            metallic: 0.3,
            spec_tint: 0.4,
            sheen: 0.5,
            sheen_tint: 0.6,
            flatness: 0.7,
            clearcoat: 0.8,
            clearcoat_gloss: 0.2,
            ..Principled::default()
        }),
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.244938, 0.507339, 0.857207]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.117973, 0.237486, 0.396836]),
            ([0.3, -0.5, 0.8], [-0.25, 0.3, -0.9], [0.0, 0.0, 0.0]),
            ([-0.1, 0.2, -0.9], [0.3, -0.1, 0.8], [0.0, 0.0, 0.0]),
            ([-0.4, 0.3, -0.6], [0.5, -0.2, -0.7], [0.0, 0.0, 0.0]),
        ],
    );
    check(
        &Bsdf::Principled(Principled {
            base_color: BASE,
            roughness: 0.5,
            metallic: 0.2,
            spec_trans: 0.6,
            eta: 1.3,
            spec_tint: 0.5,
            clearcoat: 0.5,
            anisotropy: 0.3,
            ..Principled::default()
        }),
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.113395, 0.239742, 0.408204]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.0664772, 0.106668, 0.160257]),
            ([0.3, -0.5, 0.8], [-0.25, 0.3, -0.9], [0.729369, 1.15323, 1.54723]),
            ([-0.1, 0.2, -0.9], [0.3, -0.1, 0.8], [0.115029, 0.181878, 0.244014]),
            ([-0.4, 0.3, -0.6], [0.5, -0.2, -0.7], [0.023063, 0.023063, 0.023063]),
        ],
    );
    check(
        &Bsdf::Principled(Principled {
            base_color: BASE,
            roughness: 0.7,
            metallic: 0.5,
            spec_trans: 0.7,
            eta: 0.8,
            spec_tint: 0.5,
            sheen: 0.5,
            clearcoat: 1.0,
            ..Principled::default()
        }),
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.102717, 0.189412, 0.305005]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.651513, 0.663791, 0.680162]),
            ([0.3, -0.5, 0.8], [-0.25, 0.3, -0.9], [0.0925587, 0.146348, 0.196347]),
            ([-0.1, 0.2, -0.9], [0.3, -0.1, 0.8], [0.0502696, 0.0794832, 0.106638]),
            ([-0.4, 0.3, -0.6], [0.5, -0.2, -0.7], [0.00244001, 0.00244001, 0.00244001]),
        ],
    );
}

#[test]
fn principled_thin() {
    check(
        &Bsdf::PrincipledThin(PrincipledThin {
            base_color: BASE,
            roughness: 0.5,
            anisotropy: 0.5,
            spec_trans: 0.6,
            eta: 1.4,
            spec_tint: 0.4,
            sheen: 0.5,
            sheen_tint: 0.6,
            flatness: 0.7,
            diff_trans: 0.8,
        }),
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.0334584, 0.0592807, 0.0937105]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.046089, 0.0853277, 0.137646]),
            ([0.3, -0.5, 0.8], [-0.25, 0.3, -0.9], [0.0932856, 0.233214, 0.419785]),
            ([-0.1, 0.2, -0.9], [0.3, -0.1, 0.8], [0.174817, 0.437041, 0.786674]),
            ([-0.4, 0.3, -0.6], [0.5, -0.2, -0.7], [0.0306819, 0.05565, 0.0889408]),
        ],
    );
    check(
        &Bsdf::PrincipledThin(PrincipledThin {
            base_color: BASE,
            roughness: 0.7,
            spec_trans: 1.0,
            eta: 1.8,
            ..PrincipledThin::default()
        }),
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.0420058, 0.0420058, 0.0420058]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.128124, 0.128124, 0.128124]),
            ([0.3, -0.5, 0.8], [-0.25, 0.3, -0.9], [0.143205, 0.358013, 0.644424]),
            ([-0.1, 0.2, -0.9], [0.3, -0.1, 0.8], [0.111817, 0.279543, 0.503177]),
            ([-0.4, 0.3, -0.6], [0.5, -0.2, -0.7], [0.0411257, 0.0411257, 0.0411257]),
        ],
    );
    check(
        &Bsdf::PrincipledThin(PrincipledThin {
            base_color: BASE,
            roughness: 0.9,
            sheen: 1.0,
            diff_trans: 0.5,
            ..PrincipledThin::default()
        }),
        EXACT,
        &[
            ([0.3, -0.5, 0.8], [-0.2, 0.6, 0.7], [0.0481802, 0.11986, 0.215432]),
            ([0.9, 0.1, 0.2], [-0.8, 0.2, 0.3], [0.145478, 0.208081, 0.291551]),
            ([0.3, -0.5, 0.8], [-0.25, 0.3, -0.9], [0.0159155, 0.0397887, 0.0716197]),
            ([-0.1, 0.2, -0.9], [0.3, -0.1, 0.8], [0.0159155, 0.0397887, 0.0716197]),
            ([-0.4, 0.3, -0.6], [0.5, -0.2, -0.7], [0.0481229, 0.119789, 0.215343]),
        ],
    );
}

/// The probability of reflection. Otherwise light passes.
#[test]
fn thin_dielectric() {
    for (eta, z, r) in [
        (1.5, 1.0f32, 0.076_923_1f32),
        (1.5, 0.5, 0.163_768),
        (1.5, 0.1, 0.727_406),
        (1.5, -0.7, 0.096_9),
        (0.8, 1.0, 0.024_390_2),
        (0.8, 0.5, 1.0),
        (0.8, -0.7, 0.107_975),
    ] {
        let bsdf = ThinDielectric {
            eta,
            specular_reflectance: SPECULAR_REFLECTANCE,
            specular_transmittance: SPECULAR_TRANSMITTANCE,
            passing: 0.0,
        };
        let wo = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
        let below = bsdf.sample(wo, r - 1e-5).unwrap();
        // Weights compensate for the rounding of probabilities to multiples of the spacing of random numbers.
        let near = |a: Rgb, b: Rgb| (0..3).all(|c| (a[c] - b[c]).abs() < 2e-6);
        assert!(below.wi == Vec3::new(-wo.x, -wo.y, wo.z) && near(below.weight, SPECULAR_REFLECTANCE));
        if r < 1.0 {
            let above = bsdf.sample(wo, r + 1e-5).unwrap();
            assert!(near(above.weight, SPECULAR_TRANSMITTANCE), "{above:?}");
            assert_eq!((above.wi, above.eta), (-wo, 1.0));
        }
    }
}
