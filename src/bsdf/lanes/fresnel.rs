//! The Fresnel equations in sixteen lanes.

use crate::math::f32x16;

/// Computes [`dielectric`](crate::bsdf::fresnel::dielectric) in each lane: reflectances, and cosines of the refracted
/// directions. No index may be 1.
#[inline(always)]
pub fn dielectric_x16(cos_i: f32x16, eta: f32x16) -> (f32x16, f32x16) {
    let one = f32x16::ONE;
    let scale = one / (eta * eta);
    let cos2_t = (eta - one) * (eta + one) * scale + cos_i * cos_i * scale;
    let refracts = cos2_t.simd_gt(f32x16::ZERO);
    let cos_t = cos2_t.sqrt() & refracts;
    let r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let r_p = (cos_t - eta * cos_i) / (cos_t + eta * cos_i);
    (refracts.select(f32x16::HALF * (r_s * r_s + r_p * r_p), one), cos_t)
}

/// Computes [`conductor`](crate::bsdf::fresnel::conductor) in each lane.
#[inline(always)]
pub fn conductor_x16(cos_i: f32x16, eta: f32x16, k: f32x16) -> f32x16 {
    let (zero, one, four) = (f32x16::ZERO, f32x16::ONE, f32x16::splat(4.0));
    let cos2 = cos_i * cos_i;
    let sin2 = one - cos2;
    let t0 = eta * eta - k * k - sin2;
    let a2_plus_b2 = (t0 * t0 + four * eta * eta * k * k).sqrt();
    let a = (f32x16::HALF * (a2_plus_b2 + t0)).fast_max(zero).sqrt();
    let t1 = a2_plus_b2 + cos2;
    let t2 = (cos_i + cos_i) * a;
    let r_s = (t1 - t2) / (t1 + t2);
    let t3 = cos2 * a2_plus_b2 + sin2 * sin2;
    let t4 = t2 * sin2;
    let r_p = r_s * (t3 - t4) / (t3 + t4);
    let r = f32x16::HALF * (r_s + r_p);
    r.is_finite().select(r.fast_max(zero).fast_min(one), one)
}
