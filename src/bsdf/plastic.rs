//! A diffuse base under a smooth dielectric coating.

use super::fresnel::{self, dielectric_x16};
use super::lanes::{BsdfEvalX16, BsdfSampleX16, Kernel, LaneBsdfs};
use super::{Bsdf, BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3, Vec3x16, f32x16};
use crate::sampling::hash::{probability_below, probability_below_x16};
use crate::sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// Specular reflection by the coating, and diffuse reflection of the light that enters and leaves it. The back side
/// is black.
///
/// Light that the coating reflects back to the base is scattered any number of times: `f = (1 − Fo)(1 − Fi)/η² · ρ/(1
/// − ρ·Fdr) / π`, where ρ in the denominator is 1 unless the model is nonlinear.
///
/// `Fdr`, the fraction of diffuse light from inside that the coating reflects back, is the fit of
/// [`fresnel::diffuse_reflectance`]. The last column is the scattering of a white base at normal incidence; the
/// correct value is 1. For indices of 3.85 and more, the fit exceeds 1 and the base has no valid reflection.
///
/// | η | Fdr | exact | scattered |
/// | --- | --- | --- | --- |
/// | 1.33 | 0.4724 | 0.4719 | 1.001 |
/// | 1.5 | 0.5968 | 0.5963 | 1.001 |
/// | 2 | 0.7903 | 0.7901 | 1.001 |
/// | 2.4 | 0.8665 | 0.8629 | 1.023 |
/// | 3 | 0.9355 | 0.9196 | 1.186 |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plastic {
    /// Fraction of the light that the base reflects.
    pub diffuse_reflectance: Rgb,
    /// A factor on the reflection by the coating.
    pub specular_reflectance: Rgb,
    /// Index of refraction of the coating relative to that outside.
    pub eta: f32,
    /// Whether multiple scattering multiplies the base's colour several times.
    pub nonlinear: bool,
    /// `Fdr`.
    pub fdr_int: f32,
}

impl Plastic {
    /// Creates plastic with `Fdr` computed from `eta`.
    pub fn new(diffuse_reflectance: Rgb, specular_reflectance: Rgb, eta: f32, nonlinear: bool) -> Self {
        let fdr_int = fresnel::diffuse_reflectance(1.0 / eta);
        Plastic { diffuse_reflectance, specular_reflectance, eta, nonlinear, fdr_int }
    }

    /// Returns the base's albedo for a coating with full transmittance from outside.
    pub(super) fn base(&self) -> Rgb {
        base(self.diffuse_reflectance, self.fdr_int, self.eta, self.nonlinear)
    }

    /// Returns the probability of sampling the coating, whose reflectance is `r`.
    pub(super) fn specular_probability(&self, r: f32) -> f32 {
        specular_probability(self.diffuse_reflectance, self.specular_reflectance, r)
    }

    /// Evaluates the diffuse lobe.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        let [r_o, r_i] = [wo, wi].map(|w| fresnel::dielectric(w.z, self.eta).reflectance);
        BsdfEval {
            f: self.base() * (FRAC_1_PI * (1.0 - r_o) * (1.0 - r_i)),
            pdf: warp::square_to_cosine_hemisphere_pdf(wi) * (1.0 - self.specular_probability(r_o)),
        }
    }

    /// Samples the mirror direction, or `wi` in proportion to its cosine.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let r_o = fresnel::dielectric(wo.z, self.eta).reflectance;
        let probability = self.specular_probability(r_o);
        if u_lobe < probability {
            return Some(BsdfSample {
                wi: Vec3::new(-wo.x, -wo.y, wo.z),
                weight: self.specular_reflectance * (r_o / probability),
                pdf: f32::INFINITY,
                lobe: Lobe::Specular,
                eta: 1.0,
            });
        }
        let wi = warp::square_to_cosine_hemisphere(u);
        let r_i = fresnel::dielectric(wi.z, self.eta).reflectance;
        let probability = 1.0 - probability;
        Some(BsdfSample {
            wi,
            weight: self.base() * ((1.0 - r_o) * (1.0 - r_i) / probability),
            pdf: warp::square_to_cosine_hemisphere_pdf(wi) * probability,
            lobe: Lobe::Diffuse,
            eta: 1.0,
        })
    }

    /// Returns the reflection at normal incidence plus that of the base under uniform light.
    pub fn albedo(&self) -> Rgb {
        let r = fresnel::dielectric(1.0, self.eta).reflectance;
        let entering = 1.0 - fresnel::diffuse_reflectance(self.eta);
        self.specular_reflectance * r + self.base() * ((1.0 - r) * entering)
    }
}

/// Returns `ρ/(1 − ρ·Fdr)/η²`, with 1 for the ρ in the denominator unless nonlinear.
pub(super) fn base(reflectance: Rgb, fdr_int: f32, eta: f32, nonlinear: bool) -> Rgb {
    let scale = 1.0 / (eta * eta);
    reflectance.map(|rho| scale * rho / (1.0 - if nonlinear { rho * fdr_int } else { fdr_int }))
}

/// Returns the probability of sampling the coating, with reflectance `r`, instead of the base, in proportion to the
/// means of their reflectances. It is 1 if both are black.
pub(super) fn specular_probability(diffuse: Rgb, specular: Rgb, r: f32) -> f32 {
    let (specular, diffuse) = (r * specular.mean(), (1.0 - r) * diffuse.mean());
    if specular + diffuse > 0.0 { probability_below(specular / (specular + diffuse)) } else { 1.0 }
}

/// A diffuse base under a coating.
pub(super) struct Coated {
    /// The reflectance of the base.
    pub base: Rgb,
    /// A factor on the reflection by the coating.
    pub coating: Rgb,
    /// The fraction of diffuse light from inside that the coating reflects back.
    pub internal: f32,
    /// The index of refraction of the coating relative to that outside.
    pub eta: f32,
    /// Whether multiple scattering multiplies the base's colour several times.
    pub nonlinear: bool,
}

/// The reflectances of a coated base and its coating in each of sixteen lanes.
pub(super) struct CoatedX16 {
    /// The index of refraction of the coatings relative to that outside.
    pub eta: f32x16,
    /// The bases' albedos for coatings with full transmittance, by channel.
    pub base: [f32x16; 3],
    /// Factors on the reflection by the coatings, by channel.
    pub specular: [f32x16; 3],
    /// The means of the reflectances of coating and base.
    means: [f32x16; 2],
}

impl CoatedX16 {
    /// Creates the lanes from the coated base of each BSDF.
    #[inline(always)]
    pub fn gather<T>(lanes: &LaneBsdfs<'_, T>, coated: impl Fn(&T) -> Coated) -> Self {
        let eta = lanes.numbers(|b| coated(b).eta);
        let internal = lanes.numbers(|b| coated(b).internal);
        let nonlinear = lanes.numbers(|b| f32::from(coated(b).nonlinear)).simd_gt(f32x16::ZERO);
        let scale = f32x16::ONE / (eta * eta);
        let base = lanes
            .colors(|b| coated(b).base)
            .map(|rho| scale * rho / (f32x16::ONE - nonlinear.select(rho * internal, internal)));
        CoatedX16 {
            eta,
            base,
            specular: lanes.colors(|b| coated(b).coating),
            means: [lanes.numbers(|b| coated(b).coating.mean()), lanes.numbers(|b| coated(b).base.mean())],
        }
    }

    /// Computes [`specular_probability`] in each lane.
    #[inline(always)]
    pub fn specular_probability(&self, r: f32x16) -> f32x16 {
        let (specular, diffuse) = (r * self.means[0], (f32x16::ONE - r) * self.means[1]);
        let total = specular + diffuse;
        let some = total.simd_gt(f32x16::ZERO);
        some.select(probability_below_x16(specular / total), f32x16::ONE)
    }
}

/// A [`Plastic`] in each of sixteen lanes.
pub struct PlasticX16(CoatedX16);

impl<'a> Kernel<'a> for PlasticX16 {
    type Scalar = Plastic;

    fn of(bsdf: &'a Bsdf<'a>) -> Option<&'a Plastic> {
        match bsdf {
            Bsdf::Plastic(b) if b.eta != 1.0 => Some(b),
            _ => None,
        }
    }

    #[inline(always)]
    fn gather(lanes: &LaneBsdfs<'a, Plastic>) -> Self {
        PlasticX16(CoatedX16::gather(lanes, |b| Coated {
            base: b.diffuse_reflectance,
            coating: b.specular_reflectance,
            internal: b.fdr_int,
            eta: b.eta,
            nonlinear: b.nonlinear,
        }))
    }

    #[inline(always)]
    fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16 {
        let (one, inverse_pi) = (f32x16::ONE, f32x16::splat(FRAC_1_PI));
        let above = wo.z.simd_gt(f32x16::ZERO) & wi.z.simd_gt(f32x16::ZERO);
        let [r_o, r_i] = [wo, wi].map(|w| dielectric_x16(w.z, self.0.eta).0);
        let factor = (inverse_pi * (one - r_o) * (one - r_i)) & above;
        BsdfEvalX16 {
            f: self.0.base.map(|base| base * factor),
            pdf: (wi.z * inverse_pi * (one - self.0.specular_probability(r_o))) & above,
        }
    }

    #[inline(always)]
    fn sample(&self, wo: &Vec3x16, u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16 {
        let one = f32x16::ONE;
        let (r_o, _) = dielectric_x16(wo.z, self.0.eta);
        let probability = self.0.specular_probability(r_o);
        let mirrors = u_lobe.simd_lt(probability);
        let diffuse = warp::square_to_cosine_hemisphere_x16(u);
        let (r_i, _) = dielectric_x16(diffuse.z, self.0.eta);
        let reflection = r_o / probability;
        let entering = (one - r_o) * (one - r_i) / (one - probability);
        BsdfSampleX16 {
            wi: Vec3x16::select(mirrors, Vec3x16::new(-wo.x, -wo.y, wo.z), diffuse),
            weight: std::array::from_fn(|c| {
                mirrors.select(self.0.specular[c] * reflection, self.0.base[c] * entering)
            }),
            pdf: mirrors.select(
                f32x16::splat(f32::INFINITY),
                diffuse.z * f32x16::splat(FRAC_1_PI) * (one - probability),
            ),
            eta: one,
            valid: wo.z.simd_gt(f32x16::ZERO),
        }
    }
}
