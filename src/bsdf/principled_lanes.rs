//! The principled model without transmission, for sixteen points at a time.

use super::burley::{self, MEAN_SCHLICK_WEIGHT};
use super::fresnel::dielectric_x16;
use super::lanes::{BsdfEvalX16, BsdfSampleX16, Kernel, LaneBsdfs};
use super::microfacet::MicrofacetsX16;
use super::principled::CLEARCOAT_MASKING;
use super::{Bsdf, Principled};
use crate::math::functions::exp_x16;
use crate::math::{Vec3x16, f32x16};
use crate::sampling::hash::probability_below_x16;
use crate::sampling::warp::{self, sin_cos_turn_x16};
use std::f32::consts::{FRAC_1_PI, PI, TAU};

/// A [`Principled`] that transmits nothing, in each of sixteen lanes.
pub struct PrincipledX16 {
    microfacets: MicrofacetsX16,
    base_color: [f32x16; 3],
    roughness: f32x16,
    flatness: f32x16,
    eta: f32x16,
    /// The weights of the diffuse base, the metal, and the dielectric reflection without and with the base's hue.
    opaque: f32x16,
    metallic: f32x16,
    untinted: f32x16,
    tinted: f32x16,
    /// The reflectance of the tinted dielectric at normal incidence.
    tinted_r0: [f32x16; 3],
    sheen: Option<[f32x16; 3]>,
    clearcoat: Option<ClearcoatX16>,
}

/// The clear coats of sixteen lanes, some of which may have the weight 0.
struct ClearcoatX16 {
    weight: f32x16,
    alpha2: f32x16,
    ln_alpha2: f32x16,
    masking: MicrofacetsX16,
}

/// The numbers below which a random number chooses a lobe: the diffuse one, or one of the first two.
struct LobeLimitsX16 {
    diffuse: f32x16,
    clearcoat: f32x16,
}

/// Computes [`burley::schlick_weight`] in each lane.
#[inline(always)]
fn schlick_weight(cos: f32x16) -> f32x16 {
    let m = (f32x16::ONE - cos).fast_max(f32x16::ZERO).fast_min(f32x16::ONE);
    m * m * m * m * m
}

/// Returns Schlick's approximation for the reflectance `r0` at normal incidence and the given weight.
#[inline(always)]
fn schlick(r0: f32x16, weight: f32x16) -> f32x16 {
    r0 + (f32x16::ONE - r0) * weight
}

#[inline(always)]
fn strongest([r, g, b]: [f32x16; 3]) -> f32x16 {
    r.fast_max(g).fast_max(b)
}

impl ClearcoatX16 {
    /// Computes [`burley::Gtr1::d`] in each lane.
    #[inline(always)]
    fn d(&self, m: &Vec3x16) -> f32x16 {
        let sin2 = m.x * m.x + m.y * m.y;
        let norm = f32x16::splat(PI) * self.ln_alpha2 * (sin2 + self.alpha2 * m.z * m.z);
        (self.alpha2 - f32x16::ONE) / norm
    }

    /// Computes [`burley::Gtr1::sample`] in each lane.
    #[inline(always)]
    fn sample(&self, u: [f32x16; 2]) -> Vec3x16 {
        let one = f32x16::ONE;
        let sin2 = (exp_x16((one - u[1]) * self.ln_alpha2) - self.alpha2) / (one - self.alpha2);
        let (sin_phi, cos_phi) = sin_cos_turn_x16(f32x16::splat(TAU) * u[0]);
        let sin = sin2.fast_max(f32x16::ZERO).sqrt();
        Vec3x16::new(sin * cos_phi, sin * sin_phi, (one - sin2).fast_max(f32x16::ZERO).sqrt())
    }
}

impl PrincipledX16 {
    /// Returns the reflectance of a facet by channel, given that of the dielectric and Schlick's weight.
    #[inline(always)]
    fn facet_reflectance(&self, r: f32x16, weight: f32x16) -> [f32x16; 3] {
        std::array::from_fn(|c| {
            let metal = schlick(self.base_color[c], weight);
            self.untinted * r + self.metallic * metal + self.tinted * schlick(self.tinted_r0[c], weight)
        })
    }

    /// Computes the probabilities of the lobes in each lane.
    #[inline(always)]
    fn limits(&self, cos_o: f32x16) -> LobeLimitsX16 {
        let (one, mean) = (f32x16::ONE, f32x16::splat(MEAN_SCHLICK_WEIGHT));
        let raised = |f: f32x16| f + (one - f).fast_max(f32x16::ZERO) * mean;
        let weight = schlick_weight(cos_o);
        let (r, _) = dielectric_x16(cos_o, self.eta);
        let specular = raised(strongest(self.facet_reflectance(r, weight)));
        let mut diffuse = self.opaque * strongest(self.base_color);
        if let Some(sheen) = self.sheen {
            diffuse += strongest(sheen) * f32x16::splat(PI * MEAN_SCHLICK_WEIGHT);
        }
        let clearcoat = self
            .clearcoat
            .as_ref()
            .map_or(f32x16::ZERO, |coat| coat.weight * cos_o * raised(schlick(f32x16::splat(0.04), weight)));
        let total = diffuse + clearcoat + specular;
        let diffuse_limit = probability_below_x16(diffuse / total);
        let limit = probability_below_x16((diffuse + clearcoat) / total).fast_max(diffuse_limit);
        LobeLimitsX16 { diffuse: diffuse_limit, clearcoat: limit }
    }

    /// Computes [`Principled::eval`] in each lane, for the probabilities of the lobes.
    #[inline(always)]
    fn eval_with(&self, wo: &Vec3x16, wi: &Vec3x16, limits: &LobeLimitsX16) -> BsdfEvalX16 {
        let (zero, one, four) = (f32x16::ZERO, f32x16::ONE, f32x16::splat(4.0));
        let m = (*wo + *wi).normalize_or_zero();
        let cos = wo.dot(m);
        let joined = wo.z.simd_gt(zero) & wi.z.simd_gt(zero) & cos.simd_gt(zero);
        let weight = schlick_weight(cos);
        let (r, _) = dielectric_x16(cos, self.eta);
        let (d, g1_o) = (self.microfacets.d(&m), self.microfacets.g1(wo, &m));
        let facets = d * g1_o / (four * wo.z);
        let diffuse = self.opaque * f32x16::splat(FRAC_1_PI) * self.diffuse(wo.z, wi.z, cos);
        let reflected = facets * self.microfacets.g1(wi, &m) / wi.z;
        let reflectance = self.facet_reflectance(r, weight);
        let mut f: [f32x16; 3] =
            std::array::from_fn(|c| reflectance[c] * reflected + self.base_color[c] * diffuse);
        let mut pdf = (one - limits.clearcoat) * facets + limits.diffuse * (wi.z * f32x16::splat(FRAC_1_PI));
        if let Some(coat) = &self.clearcoat {
            let d = coat.d(&m);
            let g = coat.masking.g1(wo, &m) * coat.masking.g1(wi, &m);
            let value = schlick(f32x16::splat(0.04), weight) * coat.weight * (f32x16::splat(0.25) * d * g);
            f = f.map(|f| f + value);
            pdf += (limits.clearcoat - limits.diffuse) * d * m.z.fast_max(zero) / (four * cos);
        }
        if let Some(sheen) = &self.sheen {
            f = std::array::from_fn(|c| f[c] + sheen[c] * weight);
        }
        BsdfEvalX16 { f: f.map(|f| f & joined), pdf: pdf & joined }
    }

    /// Computes [`burley::diffuse`] in each lane.
    #[inline(always)]
    fn diffuse(&self, cos_o: f32x16, cos_i: f32x16, cos_d: f32x16) -> f32x16 {
        let (one, half) = (f32x16::ONE, f32x16::HALF);
        let (w_o, w_i) = (schlick_weight(cos_o), schlick_weight(cos_i));
        let retro = (self.roughness + self.roughness) * cos_d * cos_d;
        let rough = (one - half * w_o) * (one - half * w_i) + retro * (w_o + w_i + w_o * w_i * (retro - one));
        let f90 = half * retro - one;
        let fss = (one + f90 * w_o) * (one + f90 * w_i);
        let flat = f32x16::splat(1.25) * (fss * (one / (cos_o + cos_i) - half) + half);
        rough + (flat - rough) * self.flatness
    }
}

impl<'a> Kernel<'a> for PrincipledX16 {
    type Scalar = Principled;

    fn of(bsdf: &'a Bsdf<'a>) -> Option<&'a Principled> {
        match bsdf {
            Bsdf::Principled(b) if !b.transmits() && b.eta > 1.0 => Some(b),
            _ => None,
        }
    }

    #[inline(always)]
    fn gather(lanes: &LaneBsdfs<'a, Principled>) -> Self {
        let any = |value: fn(&Principled) -> f32| lanes.bsdfs.iter().any(|b| value(b) > 0.0);
        let gtr1 = |b: &Principled| burley::Gtr1::from_gloss(b.clearcoat_gloss);
        PrincipledX16 {
            microfacets: MicrofacetsX16::gather(lanes, Principled::microfacets),
            base_color: lanes.colors(|b| b.base_color),
            roughness: lanes.numbers(|b| b.roughness),
            flatness: lanes.numbers(|b| b.flatness),
            eta: lanes.numbers(|b| b.eta),
            opaque: lanes.numbers(Principled::opaque),
            metallic: lanes.numbers(|b| b.metallic),
            untinted: lanes.numbers(|b| (1.0 - b.metallic) * (1.0 - b.spec_tint)),
            tinted: lanes.numbers(|b| (1.0 - b.metallic) * b.spec_tint),
            tinted_r0: match any(|b| b.spec_tint) {
                true => lanes.colors(|b| burley::tint(b.base_color) * burley::r0_from_eta(b.eta)),
                false => [f32x16::ZERO; 3],
            },
            sheen: any(|b| b.sheen)
                .then(|| lanes.colors(|b| b.sheen_color() * ((1.0 - b.metallic) * b.sheen))),
            clearcoat: any(|b| b.clearcoat).then(|| ClearcoatX16 {
                weight: lanes.numbers(|b| b.clearcoat),
                alpha2: lanes.numbers(|b| gtr1(b).alpha2()),
                ln_alpha2: lanes.numbers(|b| gtr1(b).alpha2().ln()),
                masking: MicrofacetsX16::gather(lanes, |_| CLEARCOAT_MASKING),
            }),
        }
    }

    #[inline(always)]
    fn eval(&self, wo: &Vec3x16, wi: &Vec3x16) -> BsdfEvalX16 {
        self.eval_with(wo, wi, &self.limits(wo.z))
    }

    #[inline(always)]
    fn sample(&self, wo: &Vec3x16, u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16 {
        let zero = f32x16::ZERO;
        let limits = self.limits(wo.z);
        let mut m = self.microfacets.sample(wo, u);
        if let Some(coat) = &self.clearcoat {
            m = Vec3x16::select(u_lobe.simd_lt(limits.clearcoat), coat.sample(u), m);
        }
        let cos = wo.dot(m);
        let mirrored = (m * (cos + cos) - *wo).normalize_or_zero();
        let diffuse = u_lobe.simd_lt(limits.diffuse);
        let wi = Vec3x16::select(diffuse, warp::square_to_cosine_hemisphere_x16(u), mirrored);
        let BsdfEvalX16 { f, pdf } = self.eval_with(wo, &wi, &limits);
        let factor = wi.z / pdf;
        let visible = (cos.simd_gt(zero) & wi.z.simd_gt(zero)) | diffuse;
        BsdfSampleX16 {
            wi,
            weight: f.map(|f| f * factor),
            pdf,
            eta: f32x16::ONE,
            valid: wo.z.simd_gt(zero) & visible & pdf.simd_gt(zero),
        }
    }
}
