//! The principled model. [Burley 2012; 2015]

use super::burley::{self, Gtr1, MEAN_SCHLICK_WEIGHT};
use super::facet::Facet;
use super::microfacet::{Distribution, Microfacets};
use super::{BsdfEval, BsdfSample, Lobe, fresnel};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::hash::probability_below;
use crate::sampling::warp;
use std::f32::consts::{FRAC_1_PI, PI};

/// Diffuse reflection, sheen, rough reflection by a metal or a dielectric, rough transmission and a clear coat.
/// Weights are in [0, 1]. The back side shows only the transmitting part.
///
/// The lobes are summed without normalisation, and the model does not conserve energy: it scatters up to 2.35 times
/// the incident light, among 6000 materials with an index in [0.5, 2.5]. The table shows the scattering of white
/// materials at cosines of 1, 0.5 and 0.1. Parameters not listed are those of [`default`](Self::default).
///
/// | material | scattered |
/// | --- | --- |
/// | default | 1.04, 1.08, 1.18 |
/// | roughness 0 | 1.02, 1.05, 1.26 |
/// | roughness 1 | 1.05, 1.08, 1.42 |
/// | metallic 1 | 0.92, 0.86, 0.85 |
/// | spec_trans 1 | 0.99, 0.96, 0.88; from below 0.93, 0.82, 0.77 |
/// | flatness 1 | 0.79, 1.15, 1.44 |
/// | sheen 1 | 1.04, 1.09, 1.25 |
/// | clearcoat 1 | 1.07, 1.09, 1.19 |
///
/// Without a diffuse part but with sheen, Mitsuba's variants disagree. Here the sheen remains, which is the limit.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Principled {
    /// The colour of base and metal; its square root is the colour of transmission.
    pub base_color: Rgb,
    /// Roughness, the square root of the microfacets' roughness.
    pub roughness: f32,
    /// The ratio between the roughness along x and along y increases with it.
    pub anisotropy: f32,
    /// Weight of the metal.
    pub metallic: f32,
    /// Weight of transmission in the non-metallic part.
    pub spec_trans: f32,
    /// Index of refraction below the surface (−z) relative to that above it.
    pub eta: f32,
    /// Weight of the base's hue in the dielectric reflection.
    pub spec_tint: f32,
    /// A factor on the sheen.
    pub sheen: f32,
    /// Weight of the base's hue in the sheen.
    pub sheen_tint: f32,
    /// Weight of the approximation of subsurface scattering in the diffuse reflection.
    pub flatness: f32,
    /// A factor on the clear coat.
    pub clearcoat: f32,
    /// Smoothness of the clear coat.
    pub clearcoat_gloss: f32,
}

impl Default for Principled {
    fn default() -> Self {
        Principled {
            base_color: Rgb::splat(0.5),
            roughness: 0.5,
            anisotropy: 0.0,
            metallic: 0.0,
            spec_trans: 0.0,
            eta: Principled::eta_from_specular(0.5),
            spec_tint: 0.0,
            sheen: 0.0,
            sheen_tint: 0.0,
            flatness: 0.0,
            clearcoat: 0.0,
            clearcoat_gloss: 0.0,
        }
    }
}

/// The probabilities of the lobes for a view direction above the surface.
struct LobeProbabilities {
    diffuse: f32,
    clearcoat: f32,
    /// The sum of both. A random number below it chooses one of them.
    to_clearcoat: f32,
    specular: f32,
}

/// The microfacet distribution for the masking of the clear coat. [Burley 2012, 5]
pub(super) const CLEARCOAT_MASKING: Microfacets =
    Microfacets { distribution: Distribution::Ggx, alpha_x: 0.25, alpha_y: 0.25, sample_visible: true };

impl Principled {
    /// Returns the index of refraction with the reflectance `0.08·specular` at normal incidence. [Burley 2012, 5]
    pub fn eta_from_specular(specular: f32) -> f32 {
        2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0
    }

    /// Returns whether light is transmitted.
    pub fn transmits(&self) -> bool {
        self.transmitting() > 0.0
    }

    pub(super) fn microfacets(&self) -> Microfacets {
        burley::microfacets(self.roughness, self.anisotropy)
    }

    /// Returns the weight of the transmitting part.
    fn transmitting(&self) -> f32 {
        (1.0 - self.metallic) * self.spec_trans
    }

    /// Returns the weight of the part with a diffuse base.
    pub(super) fn opaque(&self) -> f32 {
        (1.0 - self.metallic) * (1.0 - self.spec_trans)
    }

    /// Returns the index of the far side relative to that of wo's side. With transmission it is never exactly 1,
    /// which would make the lobe a Dirac delta.
    fn eta_from(&self, wo: Vec3) -> f32 {
        let eta = if self.eta == 1.0 && self.transmits() { 1.001 } else { self.eta };
        if wo.z > 0.0 { eta } else { 1.0 / eta }
    }

    /// Returns the reflectance of a facet: from above that of metal and dielectric, from below that of the dielectric
    /// only. `r` is the exact reflectance of the dielectric; if it is 0, the result is 0.
    fn facet_reflectance(&self, above: bool, cos: f32, r: f32, eta: f32) -> Rgb {
        if r == 0.0 {
            return Rgb::BLACK;
        }
        if !above {
            return Rgb::splat(self.transmitting() * r);
        }
        let dielectric = 1.0 - self.metallic;
        let mut sum = Rgb::splat(dielectric * (1.0 - self.spec_tint) * r);
        if self.metallic > 0.0 {
            sum += burley::schlick(self.base_color, cos, eta) * self.metallic;
        }
        if self.spec_tint > 0.0 {
            let r0 = burley::tint(self.base_color) * burley::r0_from_eta(eta);
            sum += burley::schlick(r0, cos, eta) * (dielectric * self.spec_tint);
        }
        sum
    }

    /// Returns the transmittance of a facet with the reflectance `r`. Each of two surfaces contributes half of the
    /// absorption.
    fn facet_transmittance(&self, r: f32) -> Rgb {
        self.base_color.map(f32::sqrt) * (self.transmitting() * (1.0 - r))
    }

    /// Returns the probability with which a facet transmits a sample.
    fn transmission_probability(&self, reflectance: Rgb, transmittance: Rgb) -> f32 {
        let [reflected, transmitted] = [reflectance, transmittance].map(Rgb::max_component);
        if transmitted > 0.0 { probability_below(transmitted / (reflected + transmitted)) } else { 0.0 }
    }

    /// Returns the approximate share of reflection by facets in the scattering of light from `wo`, which is above.
    pub(super) fn reflected_share(&self, wo: Vec3) -> f32 {
        let opaque = 1.0 - self.spec_trans * (1.0 - self.metallic);
        self.probabilities(wo.z, true, self.eta).specular * opaque
    }

    /// Returns probabilities in proportion to estimates of the lobes' albedos. For facets it is that of the mean
    /// facet plus the mean of Schlick's weight, so that every lobe that scatters has a positive probability.
    fn probabilities(&self, cos_o: f32, above: bool, eta: f32) -> LobeProbabilities {
        if !above {
            return LobeProbabilities { diffuse: 0.0, clearcoat: 0.0, to_clearcoat: 0.0, specular: 1.0 };
        }
        let raised = |f: f32| f + (1.0 - f).max(0.0) * MEAN_SCHLICK_WEIGHT;
        let r = fresnel::dielectric(cos_o, eta).reflectance;
        let reflected = raised(self.facet_reflectance(above, cos_o, r, eta).max_component());
        let specular = reflected + self.facet_transmittance(r).max_component();
        let sheen = (1.0 - self.metallic) * self.sheen * self.sheen_color().max_component();
        let diffuse = self.opaque() * self.base_color.max_component() + sheen * (PI * MEAN_SCHLICK_WEIGHT);
        let clearcoat = match self.clearcoat > 0.0 {
            true => self.clearcoat * cos_o * raised(burley::schlick(Rgb::splat(0.04), cos_o, eta).r),
            false => 0.0,
        };
        let total = diffuse + clearcoat + specular;
        let to_diffuse = probability_below(diffuse / total);
        let to_clearcoat = probability_below((diffuse + clearcoat) / total).max(to_diffuse);
        LobeProbabilities {
            diffuse: to_diffuse,
            clearcoat: to_clearcoat - to_diffuse,
            to_clearcoat,
            specular: 1.0 - to_clearcoat,
        }
    }

    pub(super) fn sheen_color(&self) -> Rgb {
        burley::tinted(self.base_color, self.sheen_tint)
    }

    /// Evaluates the sum of all lobes.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        let above = wo.z > 0.0;
        if wo.z * wi.z == 0.0 || !(above || self.transmits()) {
            return BsdfEval::ZERO;
        }
        let eta = self.eta_from(wo);
        let side = 1f32.copysign(wo.z);
        let (wo, wi) = (wo * side, wi * side);
        match wi.z > 0.0 {
            true => self.eval_reflection(wo, wi, above, eta),
            false if self.transmits() => self.eval_transmission(wo, wi, above, eta),
            false => BsdfEval::ZERO,
        }
    }

    fn eval_reflection(&self, wo: Vec3, wi: Vec3, above: bool, eta: f32) -> BsdfEval {
        let Some(facet) = Facet::mirroring(wo, wi) else { return BsdfEval::ZERO };
        let Facet { m, cos_o: cos_d, dm_dwi, .. } = facet;
        let probabilities = self.probabilities(wo.z, above, eta);
        let microfacets = self.microfacets();
        let r = fresnel::dielectric(cos_d, eta).reflectance;
        let reflectance = self.facet_reflectance(above, cos_d, r, eta);
        let g = microfacets.g1(wo, m) * microfacets.g1(wi, m);
        let transmission = self.transmission_probability(reflectance, self.facet_transmittance(r));
        let mut sum = BsdfEval {
            f: reflectance * (microfacets.d(m) * g / (4.0 * wo.z * wi.z)),
            pdf: probabilities.specular * (1.0 - transmission) * microfacets.pdf(wo, m) * dm_dwi,
        };
        if !above {
            return sum;
        }
        if self.clearcoat > 0.0 {
            let gtr1 = Gtr1::from_gloss(self.clearcoat_gloss);
            let g = CLEARCOAT_MASKING.g1(wo, m) * CLEARCOAT_MASKING.g1(wi, m);
            let r = burley::schlick(Rgb::splat(0.04), cos_d, eta);
            // A coat of index 1.5 with a free weight. The model has 1/4 in place of 1/(4·cosθo·cosθi).
            sum.f += r * (0.25 * self.clearcoat * gtr1.d(m) * g);
            sum.pdf += probabilities.clearcoat * gtr1.pdf(m) * dm_dwi;
        }
        if self.opaque() > 0.0 {
            let diffuse = burley::diffuse(wo.z, wi.z, cos_d, self.roughness, self.flatness);
            sum.f += self.base_color * (self.opaque() * FRAC_1_PI * diffuse);
        }
        if self.sheen > 0.0 {
            let share = (1.0 - self.metallic) * self.sheen * burley::schlick_weight(cos_d);
            sum.f += self.sheen_color() * share;
        }
        sum.pdf += probabilities.diffuse * warp::square_to_cosine_hemisphere_pdf(wi);
        sum
    }

    /// Evaluates transmission as for a rough dielectric.
    fn eval_transmission(&self, wo: Vec3, wi: Vec3, above: bool, eta: f32) -> BsdfEval {
        let Some(facet) = Facet::refracting(wo, wi, eta) else { return BsdfEval::ZERO };
        let Facet { m, cos_o, dm_dwi, .. } = facet;
        let microfacets = self.microfacets();
        let r = fresnel::dielectric(cos_o, eta).reflectance;
        let g = microfacets.g1(wo, m) * microfacets.g1(wi, m);
        let reflectance = self.facet_reflectance(above, cos_o, r, eta);
        let transmittance = self.facet_transmittance(r);
        let value = microfacets.d(m) * g * cos_o * dm_dwi / (wo.z * wi.z.abs() * eta * eta);
        let probability = self.transmission_probability(reflectance, transmittance);
        BsdfEval {
            f: transmittance * value,
            pdf: self.probabilities(wo.z, above, eta).specular
                * probability
                * microfacets.pdf(wo, m)
                * dm_dwi,
        }
    }

    /// Samples one lobe, weighted by the sum of all densities.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        let above = wo.z > 0.0;
        if wo.z == 0.0 || !(above || self.transmits()) {
            return None;
        }
        let eta = self.eta_from(wo);
        let side = 1f32.copysign(wo.z);
        let up = wo * side;
        let probabilities = self.probabilities(up.z, above, eta);
        let (wi, lobe, eta) = if u_lobe < probabilities.diffuse {
            (warp::square_to_cosine_hemisphere(u), Lobe::Diffuse, 1.0)
        } else if u_lobe < probabilities.to_clearcoat {
            let m = Gtr1::from_gloss(self.clearcoat_gloss).sample(u);
            (Facet::mirror(up, m)?.0, Lobe::Glossy, 1.0)
        } else {
            let u_facet = (u_lobe - probabilities.to_clearcoat) / probabilities.specular;
            let (wi, eta) = self.sample_facet(up, above, eta, u_facet, u)?;
            (wi, Lobe::Glossy, eta)
        };
        let wi = wi * side;
        let BsdfEval { f, pdf } = self.eval(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: f * (wi.z.abs() / pdf), pdf, lobe, eta })
    }

    /// Samples a facet of the main distribution, and reflects or refracts `wo` by it.
    fn sample_facet(&self, wo: Vec3, above: bool, eta: f32, u_facet: f32, u: Vec2) -> Option<(Vec3, f32)> {
        let m = self.microfacets().sample(wo, u);
        let cos_o = wo.dot(m).max(0.0);
        let r = fresnel::dielectric(cos_o, eta);
        let reflectance = self.facet_reflectance(above, cos_o, r.reflectance, eta);
        let transmission =
            self.transmission_probability(reflectance, self.facet_transmittance(r.reflectance));
        if u_facet < transmission {
            Some((Facet::refract(wo, m, r.cos_t, eta)?.0, eta))
        } else {
            Some((Facet::mirror(wo, m)?.0, 1.0))
        }
    }

    /// Returns the albedo of the base plus mean facet and transmission at normal incidence.
    pub fn albedo(&self) -> Rgb {
        let eta = self.eta_from(Vec3::Z);
        let r = fresnel::dielectric(1.0, eta).reflectance;
        self.base_color * self.opaque()
            + self.facet_reflectance(true, 1.0, r, eta)
            + self.facet_transmittance(r)
    }
}
