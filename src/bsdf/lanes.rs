//! BSDF evaluation and sampling for sixteen points at a time.
//!
//! Diffuse reflection, the most frequent material, is computed in parallel lanes; other BSDFs one lane after the
//! other.

use super::{Bsdf, BsdfEval, BsdfSample};
use crate::math::Vec2;
use crate::math::lanes::{LANES, Vec3x16, bits, f32x16, mask_from_bits};
use crate::sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// A [`BsdfEval`] in each of sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub struct BsdfEvalX16 {
    /// The bare BSDF by channel, sr⁻¹.
    pub f: [f32x16; 3],
    /// Densities per unit solid angle.
    pub pdf: f32x16,
}

/// A [`BsdfSample`] in each of sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSampleX16 {
    /// The directions.
    pub wi: Vec3x16,
    /// `f·|cosθ|/pdf` by channel.
    pub weight: [f32x16; 3],
    /// Densities per unit solid angle; infinite for a specular lobe.
    pub pdf: f32x16,
    /// Relative indices of refraction.
    pub eta: f32x16,
    /// Mask of the lanes with a sample.
    pub valid: f32x16,
}

/// Returns the reflectances of the diffuse lanes by channel, and a mask of the other lanes.
#[inline(always)]
fn gather_diffuse(bsdfs: &[&Bsdf<'_>; LANES]) -> ([f32x16; 3], u32) {
    let mut reflectance = [[0.0; LANES]; 3];
    let mut others = 0;
    for (i, bsdf) in bsdfs.iter().enumerate() {
        match bsdf {
            Bsdf::Diffuse(diffuse) => {
                let [r, g, b] = &mut reflectance;
                (r[i], g[i], b[i]) = (diffuse.reflectance.r, diffuse.reflectance.g, diffuse.reflectance.b);
            }
            _ => others |= 1 << i,
        }
    }
    (reflectance.map(f32x16::new), others)
}

/// Computes [`Bsdf::eval`] of `bsdfs[i]` in lane `i`, for the lanes in the mask `active`.
#[inline]
pub fn eval_x16(bsdfs: &[&Bsdf<'_>; LANES], wo: &Vec3x16, wi: &Vec3x16, active: u32) -> BsdfEvalX16 {
    let (reflectance, others) = gather_diffuse(bsdfs);
    let above = wo.z.simd_gt(f32x16::ZERO) & wi.z.simd_gt(f32x16::ZERO);
    let inverse_pi = f32x16::splat(FRAC_1_PI);
    let mut eval =
        BsdfEvalX16 { f: reflectance.map(|r| (r * inverse_pi) & above), pdf: (wi.z * inverse_pi) & above };
    for i in bits(others & active) {
        let BsdfEval { f, pdf } = bsdfs[i].eval(wo.lane(i), wi.lane(i));
        for (channel, value) in eval.f.iter_mut().zip(f.to_array()) {
            channel.as_mut_array()[i] = value;
        }
        eval.pdf.as_mut_array()[i] = pdf;
    }
    eval
}

/// Computes [`Bsdf::sample`] of `bsdfs[i]` in lane `i`, for the lanes in the mask `active`.
#[inline]
pub fn sample_x16(
    bsdfs: &[&Bsdf<'_>; LANES],
    wo: &Vec3x16,
    u_lobe: f32x16,
    u: [f32x16; 2],
    active: u32,
) -> BsdfSampleX16 {
    let (reflectance, others) = gather_diffuse(bsdfs);
    let wi = warp::square_to_cosine_hemisphere_x16(u);
    let mut samples = BsdfSampleX16 {
        wi,
        weight: reflectance,
        pdf: wi.z * f32x16::splat(FRAC_1_PI),
        eta: f32x16::ONE,
        valid: wo.z.simd_gt(f32x16::ZERO),
    };
    let others = others & active;
    if others == 0 {
        return samples;
    }
    let mut missing = 0;
    for i in bits(others) {
        let u = Vec2::new(u[0].as_array()[i], u[1].as_array()[i]);
        match bsdfs[i].sample(wo.lane(i), u_lobe.as_array()[i], u) {
            Some(sample) => samples.set_lane(i, &sample),
            None => missing |= 1 << i,
        }
    }
    let others = mask_from_bits(others);
    samples.valid = others.select(others & !mask_from_bits(missing), samples.valid);
    samples
}

impl BsdfSampleX16 {
    fn set_lane(&mut self, i: usize, sample: &BsdfSample) {
        self.wi.set_lane(i, sample.wi);
        for (channel, value) in self.weight.iter_mut().zip(sample.weight.to_array()) {
            channel.as_mut_array()[i] = value;
        }
        self.pdf.as_mut_array()[i] = sample.pdf;
        self.eta.as_mut_array()[i] = sample.eta;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::{Dielectric, Diffuse};
    use crate::color::Rgb;
    use crate::math::Vec3;

    /// A lane with glass does not change the results of the diffuse lanes.
    #[test]
    fn lanes_are_independent() {
        let diffuse = Bsdf::Diffuse(Diffuse { reflectance: Rgb::new(0.2, 0.4, 0.8) });
        let glass = Bsdf::Dielectric(Dielectric {
            eta: 1.5,
            specular_reflectance: Rgb::WHITE,
            specular_transmittance: Rgb::WHITE,
        });
        let mut bsdfs = [&diffuse; LANES];
        bsdfs[3] = &glass;
        let mut wo = Vec3x16::splat(Vec3::new(0.6, 0.0, 0.8));
        wo.set_lane(5, Vec3::new(0.6, 0.0, -0.8));
        let wi = Vec3x16::splat(Vec3::new(0.0, 0.28, 0.96));
        let (u_lobe, u) = (0.9, Vec2::new(0.3, 0.7));
        let eval = eval_x16(&bsdfs, &wo, &wi, 0xffff);
        let splat = [f32x16::splat(u.x), f32x16::splat(u.y)];
        let sample = sample_x16(&bsdfs, &wo, f32x16::splat(u_lobe), splat, 0xffff);
        for (i, bsdf) in bsdfs.into_iter().enumerate() {
            let alone = bsdf.eval(wo.lane(i), wi.lane(i));
            assert_eq!(
                (eval.f.map(|c| c.as_array()[i]), eval.pdf.as_array()[i]),
                (alone.f.to_array(), alone.pdf)
            );
            let alone = bsdf.sample(wo.lane(i), u_lobe, u);
            assert_eq!(sample.valid.to_bitmask() >> i & 1 == 1, alone.is_some(), "lane {i}");
            if let Some(alone) = alone {
                assert_eq!(sample.wi.lane(i), alone.wi, "lane {i}");
                assert_eq!(sample.weight.map(|c| c.as_array()[i]), alone.weight.to_array());
                assert_eq!((sample.pdf.as_array()[i], sample.eta.as_array()[i]), (alone.pdf, alone.eta));
            }
        }
    }
}
