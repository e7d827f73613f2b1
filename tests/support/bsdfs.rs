//! Checks for every BSDF.

use super::chi2::{check_directions, check_square};
use buffon::bsdf::empirical::WardVariant;
use buffon::bsdf::fresnel::ConductorFresnel;
use buffon::bsdf::microfacet::{Distribution, Microfacets};
use buffon::bsdf::{
    Blend, Bsdf, BsdfSample, Coating, Conductor, Dielectric, Diffuse, DiffuseAnd, DiffuseTransmitter, Lobe,
    Mask, Phong, Plastic, PolarizedPlastic, Principled, PrincipledThin, RoughBoundary, RoughConductor,
    RoughDielectric, RoughDiffuse, RoughPlastic, RoughTransmittance, ThinDielectric, Tilted, TwoSided, Ward,
};
use buffon::color::Rgb;
use buffon::math::{DVec3, Frame, Vec2, Vec3};
use buffon::sampling::{Dimension, SampleKey, Sampler, SamplerKind};
use std::f64::consts::TAU;
use std::sync::LazyLock;

/// Returns directions above the surface, from the normal to grazing.
pub fn directions() -> Vec<Vec3> {
    let mut list = Vec::new();
    for z in [1.0f32, 0.8, 0.3, 0.05] {
        let r = (1.0 - z * z).sqrt();
        list.push(Vec3::new(r * 0.6, r * 0.8, z));
    }
    list
}

/// Returns [`directions`] and some below the surface.
pub fn directions_of_both_sides() -> Vec<Vec3> {
    let mut list = directions();
    list.extend([Vec3::new(0.3, -0.5, -0.8).normalize(), Vec3::new(-0.99, 0.02, -0.1).normalize()]);
    list
}

/// Asserts that the weight and density of a sample of a finite lobe agree with evaluation.
pub fn check_sample(name: &str, bsdf: &Bsdf, wo: Vec3, s: &BsdfSample, tolerance: f32) {
    let e = bsdf.eval(wo, s.wi);
    let close = |a: f32, b: f32| (a - b).abs() <= tolerance * a.abs().max(b.abs()) + 1e-5;
    assert!(close(e.pdf, s.pdf), "{name}: pdf {} and {} at {}", s.pdf, e.pdf, s.wi);
    let weight = e.f * (s.wi.z.abs() / e.pdf);
    for c in 0..3 {
        assert!(close(weight[c], s.weight[c]), "{name}: weight {:?} and {weight:?} at {}", s.weight, s.wi);
    }
}

/// Compares the sampled directions of finite lobes with their density.
pub fn check_bsdf(name: &str, tests: usize, bsdf: &Bsdf, wo: Vec3) {
    let name = format!("{name}, wo.z = {}", wo.z);
    check_directions(
        &name,
        tests,
        |u_lobe, u| {
            let s = bsdf.sample(wo, u_lobe, u).filter(|s| s.lobe != Lobe::Specular)?;
            check_sample(&name, bsdf, wo, &s, 2e-3);
            Some(s.wi)
        },
        |wi| bsdf.eval(wo, wi).pdf,
    );
}

/// The facet that represents a sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Chart {
    /// The facet that reflects, for directions on the side of `wo`.
    Mirrored,
    /// The facet that refracts, for directions on the other side; the index of refraction of that side over that of the
    /// side of `wo`.
    Refracted(f64),
    /// The facet that reflects to the mirror image of the direction in the surface, for directions on the other side.
    Through,
}

/// The scale of the first axis of the charts.
const MIDDLE: f64 = 2.0;

impl Chart {
    /// Returns a weighted sum of both directions along the facet's normal, for directions that are in the chart. `wo`
    /// is above the surface.
    fn normal(self, wo: DVec3, wi: DVec3) -> Option<DVec3> {
        match self {
            Chart::Mirrored => (wi.z > 0.0).then(|| wo + wi),
            Chart::Refracted(eta) => (wi.z < 0.0).then(|| wo + wi * eta),
            Chart::Through => (wi.z < 0.0).then(|| wo + DVec3::new(wi.x, wi.y, -wi.z)),
        }
    }

    /// Returns the direction into which the facet m scatters `wo`, and its solid angle per solid angle of m.
    fn direction(self, wo: DVec3, m: DVec3) -> Option<(DVec3, f64)> {
        let cos = wo.dot(m);
        if cos <= 0.0 {
            return None;
        }
        let mirrored = m * (2.0 * cos) - wo;
        let mirrored = (mirrored.z > 0.0).then_some(mirrored);
        match self {
            Chart::Mirrored => mirrored.map(|wi| (wi, 4.0 * cos)),
            Chart::Through => mirrored.map(|wi| (DVec3::new(wi.x, wi.y, -wi.z), 4.0 * cos)),
            Chart::Refracted(eta) => {
                let cos2_t = 1.0 - (1.0 - cos * cos) / (eta * eta);
                let cos_t = cos2_t.max(0.0).sqrt();
                let wi = m * (cos / eta - cos_t) - wo / eta;
                let jacobian = (cos - eta * cos_t).powi(2) / (eta * eta * cos_t);
                (cos2_t > 0.0 && wi.z < 0.0).then_some((wi, jacobian))
            }
        }
    }
}

/// Compares sampled directions with their density, over the slopes of the facet between the directions. This resolves
/// both sharp and broad lobes.
///
/// The square's first axis is `t/(2 + t)` with `t = ln(1 + r²)` for a facet's slope r in units of the roughness; the
/// second is its azimuth. Specular lobes are left out.
pub fn check_facets(name: &str, tests: usize, bsdf: &Bsdf, alpha: [f64; 2], wo: Vec3, chart: Chart) {
    let name = format!("{name}, wo.z = {}, {chart:?}", wo.z);
    if let Chart::Refracted(eta) = chart
        && f64::from(wo.z).powi(2) < 1.0 - eta * eta
    {
        // The mean facet is beyond the critical angle, and the facets that are not transmit hardly any light.
        return;
    }
    let side = 1f32.copysign(wo.z);
    let up = (wo * side).as_dvec3();
    let sample = |u_lobe, u| {
        let s = bsdf.sample(wo, u_lobe, u).filter(|s| s.lobe != Lobe::Specular)?;
        check_sample(&name, bsdf, wo, &s, 1e-2);
        let h = chart.normal(up, (s.wi * side).as_dvec3())?;
        let (x, y) = (h.x / (h.z * alpha[0]), h.y / (h.z * alpha[1]));
        let t = (x * x + y * y).ln_1p();
        Some([t / (MIDDLE + t), y.atan2(x).rem_euclid(TAU) / TAU])
    };
    let density = |[s, phi]: [f64; 2]| {
        let t = MIDDLE * s / (1.0 - s);
        let r2 = t.exp_m1();
        if r2 > 1e18 {
            return 0.0;
        }
        let (sin, cos) = (TAU * phi).sin_cos();
        let r = r2.sqrt();
        let m = DVec3::new(alpha[0] * r * cos, alpha[1] * r * sin, 1.0).normalize();
        let Some((wi, directions)) = chart.direction(up, m) else { return 0.0 };
        // Slopes per unit square, facets per slope, directions per facet.
        let slopes = alpha[0] * alpha[1] * 0.5 * (1.0 + r2) * MIDDLE / (1.0 - s).powi(2) * TAU;
        let wi = wi.as_vec3().normalize() * side;
        f64::from(bsdf.eval(wo, wi).pdf) * directions * m.z.powi(3) * slopes
    };
    check_square(&name, tests, sample, density);
}

/// Quasi-random numbers within a lobe, each with several that choose the lobe.
static NUMBERS: LazyLock<Vec<(f32, Vec2)>> = LazyLock::new(|| {
    const SAMPLES: usize = 1 << 12;
    const CHOICES: usize = 4;
    let keys: Vec<_> = (0..SAMPLES as u64).map(|i| SampleKey::new(5, 0, 0, 2 * i)).collect();
    let draw = |d: u64| {
        let (mut x, mut y) = (vec![0.0; SAMPLES], vec![0.0; SAMPLES]);
        Sampler::new(SamplerKind::Sobol, None).fill_2d(Dimension(d), &keys, &mut x, &mut y);
        (x, y)
    };
    let ((u_lobe, _), (x, y)) = (draw(0), draw(1));
    let choices = |i: usize| {
        let u = Vec2::new(x[i], y[i]);
        let u_lobe = u_lobe[i];
        (0..CHOICES).map(move |k| ((k as f32 + u_lobe) / CHOICES as f32, u))
    };
    (0..SAMPLES).flat_map(choices).collect()
});

/// Returns the fraction of the energy that is scattered from `wo`, to about 10⁻³. The square of the ratio of the
/// indices of refraction converts refracted radiance to energy.
pub fn scattered_energy(bsdf: &Bsdf, wo: Vec3) -> Rgb {
    let mut sum = Rgb::BLACK;
    for &(u_lobe, u) in NUMBERS.iter() {
        if let Some(s) = bsdf.sample(wo, u_lobe, u) {
            assert!(s.weight.is_valid() && s.pdf > 0.0, "{bsdf:?} {wo}: {s:?}");
            assert!((s.wi.length() - 1.0).abs() < 1e-5, "{bsdf:?} {wo}: {s:?}");
            assert_eq!(s.lobe == Lobe::Specular, s.pdf == f32::INFINITY);
            let transmitted = s.wi.z * wo.z < 0.0;
            assert!(!transmitted || bsdf.transmits(), "{bsdf:?} {wo}: {s:?}");
            sum += s.weight * if transmitted { s.eta * s.eta } else { 1.0 };
        }
    }
    sum / NUMBERS.len() as f32
}

/// Asserts that scattering is reciprocal, for directions that scatter both ways. `eta` is the index of refraction below
/// the surface over that above it.
pub fn check_reciprocity(bsdf: &Bsdf, wo: Vec3, wi: Vec3, eta: f32) {
    // Radiance over the squared index of refraction is reciprocal. [Veach 1997, Eq. 5.14]
    let index = |w: Vec3| if w.z > 0.0 { 1.0 } else { eta };
    let (there, back) = (bsdf.eval(wo, wi).f, bsdf.eval(wi, wo).f);
    for c in 0..3 {
        let (a, b) = (there[c] / index(wo).powi(2), back[c] / index(wi).powi(2));
        let differ = (a - b).abs() > 1e-3 * a.max(b) + 1e-7;
        assert!(!differ || a == 0.0 || b == 0.0, "{bsdf:?} {wo} {wi}: {a} and {b}");
    }
}

fn conductor() -> ConductorFresnel {
    ConductorFresnel { eta: Rgb::new(0.2, 0.9, 1.1), k: Rgb::new(3.9, 2.4, 2.2) }
}

fn facets(distribution: Distribution, alpha: [f32; 2], sample_visible: bool) -> Microfacets {
    Microfacets { distribution, alpha_x: alpha[0], alpha_y: alpha[1], sample_visible }
}

pub const DIFFUSE: Bsdf<'static> = Bsdf::Diffuse(Diffuse { reflectance: Rgb::WHITE });

/// Returns the models with a single surface.
pub fn simple_models() -> Vec<Bsdf<'static>> {
    let white = Rgb::WHITE;
    vec![
        DIFFUSE,
        Bsdf::DiffuseTransmitter(DiffuseTransmitter { transmittance: white }),
        Bsdf::RoughDiffuse(RoughDiffuse { reflectance: white, sigma: 0.5, qualitative: false }),
        Bsdf::Phong(DiffuseAnd {
            diffuse_reflectance: white * 0.5,
            specular_reflectance: white * 0.5,
            lobe: Phong { exponent: 20.0 },
        }),
        Bsdf::Ward(DiffuseAnd {
            diffuse_reflectance: white * 0.5,
            specular_reflectance: white * 0.5,
            lobe: Ward {
                microfacets: facets(Distribution::Beckmann, [0.1, 0.4], false),
                variant: WardVariant::Balanced,
            },
        }),
        Bsdf::Null,
        Bsdf::Conductor(Conductor { fresnel: conductor(), specular_reflectance: white }),
        Bsdf::Dielectric(Dielectric { eta: 1.5, specular_reflectance: white, specular_transmittance: white }),
        Bsdf::ThinDielectric(ThinDielectric {
            eta: 1.5,
            specular_reflectance: white,
            specular_transmittance: white,
            passing: 0.0,
        }),
        Bsdf::Plastic(Plastic::new(white, white, 1.5, true)),
        Bsdf::Principled(Principled {
            base_color: white,
            roughness: 0.5,
            anisotropy: 0.3,
            metallic: 0.3,
            spec_trans: 0.4,
            eta: 1.5,
            spec_tint: 0.2,
            sheen: 0.5,
            sheen_tint: 0.5,
            flatness: 0.2,
            clearcoat: 0.7,
            clearcoat_gloss: 0.3,
        }),
        Bsdf::PrincipledThin(PrincipledThin {
            base_color: white,
            roughness: 0.5,
            anisotropy: 0.3,
            spec_trans: 0.4,
            eta: 1.5,
            spec_tint: 0.2,
            sheen: 0.5,
            sheen_tint: 0.5,
            flatness: 0.2,
            diff_trans: 0.8,
        }),
        Bsdf::PolarizedPlastic(PolarizedPlastic {
            microfacets: facets(Distribution::Ggx, [0.2, 0.4], true),
            diffuse_reflectance: white,
            specular_reflectance: white,
            eta: 1.5,
        }),
    ]
}

/// Returns the models of microfacets.
pub fn rough_models(transmittance: &[RoughTransmittance; 2]) -> Vec<Bsdf<'_>> {
    let white = Rgb::WHITE;
    let mut all = Vec::new();
    for distribution in [Distribution::Beckmann, Distribution::Ggx] {
        for alpha in [[0.1, 0.1], [0.6, 0.6], [0.2, 0.8]] {
            for visible in [true, false] {
                let microfacets = facets(distribution, alpha, visible);
                all.push(Bsdf::RoughConductor(RoughConductor {
                    microfacets,
                    fresnel: conductor(),
                    specular_reflectance: white,
                }));
                all.push(Bsdf::RoughDielectric(RoughDielectric {
                    microfacets,
                    eta: 1.5,
                    specular_reflectance: white,
                    specular_transmittance: white,
                }));
            }
        }
    }
    for (transmittance, alpha) in transmittance.iter().zip([0.1, 0.6]) {
        all.push(Bsdf::RoughPlastic(RoughPlastic {
            microfacets: facets(Distribution::Ggx, [alpha; 2], true),
            diffuse_reflectance: white,
            specular_reflectance: white,
            eta: 1.5,
            nonlinear: false,
            transmittance,
        }));
    }
    all
}

/// Returns the tables of the rough plastics of [`rough_models`].
pub fn transmittances() -> [RoughTransmittance; 2] {
    [0.1, 0.6].map(|alpha| RoughTransmittance::new(Distribution::Ggx, alpha, 1.5))
}

/// Returns the models with a single surface and the models of microfacets.
pub fn plain_models(transmittance: &[RoughTransmittance; 2]) -> Vec<Bsdf<'_>> {
    [simple_models(), rough_models(transmittance)].concat()
}

/// Returns the boundary of a rough coating.
pub fn rough_boundary() -> RoughBoundary<'static> {
    const ALPHA: f32 = 0.2;
    static TRANSMITTANCE: LazyLock<RoughTransmittance> =
        LazyLock::new(|| RoughTransmittance::new(Distribution::Beckmann, ALPHA, 1.5));
    let microfacets = facets(Distribution::Beckmann, [ALPHA; 2], true);
    RoughBoundary { microfacets, transmittance: &TRANSMITTANCE }
}

/// Returns these models, and each of them in every wrapper.
pub fn wrapped<'a>(plain: &'a [Bsdf<'a>]) -> Vec<Bsdf<'a>> {
    let frame = Frame::from_normal(Vec3::new(0.3, -0.2, 1.0).normalize());
    let mut all = plain.to_vec();
    for inner in plain {
        all.push(Bsdf::Tilted(Tilted { frame, soften: false, inner, turned: None }));
        all.push(Bsdf::TwoSided(TwoSided { sides: [inner, &DIFFUSE] }));
        all.push(Bsdf::Mask(Mask { opacity: 0.5, inner }));
        if !inner.transmits() {
            let depth = Rgb::new(0.0, 0.1, 0.5);
            let specular_reflectance = Rgb::new(0.9, 1.0, 0.8);
            for rough in [None, Some(rough_boundary())] {
                all.push(Bsdf::Coating(Coating { eta: 1.5, depth, specular_reflectance, rough, inner }));
            }
        }
        all.push(Bsdf::Blend(Blend { weight: 0.25, bsdfs: [inner, &DIFFUSE] }));
    }
    all
}
