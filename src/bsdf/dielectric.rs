//! A smooth boundary between two dielectrics.

use super::fresnel::{self, dielectric_x16};
use super::lanes::{BsdfEvalX16, BsdfSampleX16, Kernel, LaneBsdfs};
use super::{Bsdf, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::lanes::with_sign;
use crate::math::{Vec3, Vec3x16, f32x16};
use crate::sampling::hash::{probability_below, probability_below_x16};

/// Reflection and refraction of radiance at a smooth boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    /// Index of refraction below the surface (−z) relative to that above it.
    pub eta: f32,
    /// A factor on the reflection.
    pub specular_reflectance: Rgb,
    /// A factor on the transmission.
    pub specular_transmittance: Rgb,
}

impl Dielectric {
    /// Returns the index of the far side relative to that of wo's side.
    fn eta_from(&self, wo: Vec3) -> f32 {
        if wo.z > 0.0 { self.eta } else { 1.0 / self.eta }
    }

    /// Returns the probability with which [`sample`](Self::sample) reflects.
    pub(super) fn reflection_probability(&self, wo: Vec3) -> f32 {
        probability_below(fresnel::dielectric(wo.z.abs(), self.eta_from(wo)).reflectance)
    }

    /// Reflects with the probability of the Fresnel reflectance, otherwise refracts.
    ///
    /// Refracted radiance is scaled by the squared ratio of the indices, because the solid angle changes. [Veach
    /// 1997, Eq. 5.2]
    #[inline]
    pub fn sample(&self, wo: Vec3, u_lobe: f32) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let eta = self.eta_from(wo);
        let r = fresnel::dielectric(wo.z.abs(), eta);
        let probability = probability_below(r.reflectance);
        if u_lobe < probability {
            return Some(BsdfSample {
                wi: Vec3::new(-wo.x, -wo.y, wo.z),
                weight: self.specular_reflectance * (r.reflectance / probability),
                pdf: f32::INFINITY,
                lobe: Lobe::Specular,
                eta: 1.0,
            });
        }
        let scale = 1.0 / eta;
        let share = (1.0 - r.reflectance) / (1.0 - probability);
        Some(BsdfSample {
            wi: Vec3::new(-scale * wo.x, -scale * wo.y, (-r.cos_t).copysign(-wo.z)).normalize(),
            weight: self.specular_transmittance * (scale * scale * share),
            pdf: f32::INFINITY,
            lobe: Lobe::Specular,
            eta,
        })
    }

    /// Returns reflectance plus transmittance at normal incidence.
    pub fn albedo(&self) -> Rgb {
        let r = fresnel::dielectric(1.0, self.eta).reflectance;
        self.specular_reflectance * r + self.specular_transmittance * (1.0 - r)
    }
}

/// A [`Dielectric`] in each of sixteen lanes.
pub struct DielectricX16 {
    eta: f32x16,
    reflectance: [f32x16; 3],
    transmittance: [f32x16; 3],
}

impl<'a> Kernel<'a> for DielectricX16 {
    type Scalar = Dielectric;

    fn of(bsdf: &'a Bsdf<'a>) -> Option<&'a Dielectric> {
        match bsdf {
            Bsdf::Dielectric(b) if b.eta != 1.0 => Some(b),
            _ => None,
        }
    }

    #[inline(always)]
    fn gather(lanes: &LaneBsdfs<'a, Dielectric>) -> Self {
        DielectricX16 {
            eta: lanes.numbers(|b| b.eta),
            reflectance: lanes.colors(|b| b.specular_reflectance),
            transmittance: lanes.colors(|b| b.specular_transmittance),
        }
    }

    #[inline(always)]
    fn eval(&self, _: &Vec3x16, _: &Vec3x16) -> BsdfEvalX16 {
        BsdfEvalX16::ZERO
    }

    #[inline(always)]
    fn sample(&self, wo: &Vec3x16, u_lobe: f32x16, _: [f32x16; 2]) -> BsdfSampleX16 {
        let (zero, one) = (f32x16::ZERO, f32x16::ONE);
        let eta = wo.z.simd_gt(zero).select(self.eta, one / self.eta);
        let (r, cos_t) = dielectric_x16(wo.z.abs(), eta);
        let probability = probability_below_x16(r);
        let reflects = u_lobe.simd_lt(probability);
        let scale = one / eta;
        let refracted =
            Vec3x16::new(-scale * wo.x, -scale * wo.y, with_sign(cos_t, -wo.z)).normalize_or_zero();
        let reflection = r / probability;
        let transmission = scale * scale * ((one - r) / (one - probability));
        BsdfSampleX16 {
            wi: Vec3x16::select(reflects, Vec3x16::new(-wo.x, -wo.y, wo.z), refracted),
            weight: std::array::from_fn(|c| {
                reflects.select(self.reflectance[c] * reflection, self.transmittance[c] * transmission)
            }),
            pdf: f32x16::splat(f32::INFINITY),
            eta: reflects.select(one, eta),
            valid: wo.z.simd_ne(zero),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refraction_obeys_snell_and_conserves_flux() {
        let glass =
            Dielectric { eta: 1.5, specular_reflectance: Rgb::WHITE, specular_transmittance: Rgb::WHITE };
        let wo = Vec3::new(0.6, 0.0, 0.8);
        let s = glass.sample(wo, 1f32.next_down()).unwrap();
        assert!((s.wi.x + 0.4).abs() < 1e-6 && s.wi.z < 0.0);
        assert!((s.weight.r - 1.0 / 2.25).abs() < 1e-6);
        // The reverse direction has the same path and the inverse scale.
        let back = glass.sample(s.wi, 1f32.next_down()).unwrap();
        assert!((back.wi - wo).length() < 1e-6);
        assert!((back.weight.r * s.weight.r - 1.0).abs() < 1e-6);
    }

    #[test]
    fn equal_indices_let_light_pass_unchanged() {
        let air =
            Dielectric { eta: 1.0, specular_reflectance: Rgb::WHITE, specular_transmittance: Rgb::WHITE };
        let wo = Vec3::new(0.6, 0.0, 0.8);
        let s = air.sample(wo, 0.0).unwrap();
        assert!((s.wi + wo).length() < 1e-6);
        assert_eq!(s.weight, Rgb::WHITE);
    }
}
