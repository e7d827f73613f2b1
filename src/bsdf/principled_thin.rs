//! The principled model of a thin sheet. [Burley 2015]

use super::burley::{self, MEAN_SCHLICK_WEIGHT};
use super::facet::Facet;
use super::microfacet::Microfacets;
use super::{BsdfEval, BsdfSample, Lobe, fresnel};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::hash::probability_below;
use crate::sampling::warp;
use std::f32::consts::{FRAC_1_PI, PI};

/// A thin sheet that is the same from both sides: diffuse reflection and transmission, sheen, rough reflection, and
/// rough transmission without refraction. Weights are in [0, 1].
///
/// The model does not conserve energy: it scatters up to 1.67 times the incident light, among 6000 sheets with an
/// index in [0.5, 2.5]. The table shows the scattering of white sheets at cosines of 1, 0.5 and 0.1. Parameters not
/// listed are those of [`default`](Self::default).
///
/// | sheet | scattered |
/// | --- | --- |
/// | default | 1.01, 1.01, 1.02 |
/// | roughness 1 | 1.04, 1.06, 1.38 |
/// | spec_trans 1 | 0.97, 0.93, 0.69 |
/// | flatness 1 | 0.75, 1.08, 1.28 |
/// | sheen 1 | 1.01, 1.02, 1.09 |
/// | diff_trans 2 | 1.00, 1.00, 1.00 |
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PrincipledThin {
    /// The colour of base and transmission.
    pub base_color: Rgb,
    /// Roughness, the square root of the microfacets' roughness.
    pub roughness: f32,
    /// The ratio between the roughness along x and along y increases with it.
    pub anisotropy: f32,
    /// Weight of the part that is not diffuse.
    pub spec_trans: f32,
    /// Index of refraction of the sheet relative to that of its surroundings.
    pub eta: f32,
    /// Weight of the base's hue in the reflection.
    pub spec_tint: f32,
    /// A factor on the sheen.
    pub sheen: f32,
    /// Weight of the base's hue in the sheen.
    pub sheen_tint: f32,
    /// Weight of the approximation of subsurface scattering in the diffuse reflection.
    pub flatness: f32,
    /// Twice the fraction of diffuse light that is transmitted, in [0, 2].
    pub diff_trans: f32,
}

impl Default for PrincipledThin {
    fn default() -> Self {
        PrincipledThin {
            base_color: Rgb::splat(0.5),
            roughness: 0.5,
            anisotropy: 0.0,
            spec_trans: 0.0,
            eta: 1.5,
            spec_tint: 0.0,
            sheen: 0.0,
            sheen_tint: 0.0,
            flatness: 0.0,
            diff_trans: 0.0,
        }
    }
}

/// The probabilities of the lobes.
struct ThinLobeProbabilities {
    reflection: f32,
    transmission: f32,
    diffuse_reflection: f32,
    diffuse_transmission: f32,
    /// Cumulative probabilities: of both diffuse lobes, and of these and transmission.
    to: [f32; 2],
}

fn mirrored(w: Vec3) -> Vec3 {
    Vec3::new(w.x, w.y, -w.z)
}

impl PrincipledThin {
    /// Returns whether light is transmitted.
    pub fn transmits(&self) -> bool {
        self.spec_trans > 0.0 || self.diff_trans > 0.0
    }

    fn reflecting(&self) -> Microfacets {
        burley::microfacets(self.roughness, self.anisotropy)
    }

    /// Returns the distribution for transmission. Two rough boundaries blur less as the indices become similar.
    /// [Burley 2015, Fig. 15]
    fn transmitting(&self) -> Microfacets {
        burley::microfacets((0.65 * self.eta - 0.35) * self.roughness, self.anisotropy)
    }

    /// Returns the reflectance of a facet at the cosine `cos`.
    fn facet_reflectance(&self, cos: f32) -> Rgb {
        let r = Rgb::splat(fresnel::dielectric(cos, self.eta).reflectance);
        if self.spec_tint == 0.0 {
            return r;
        }
        let r0 = burley::tint(self.base_color) * burley::r0_from_eta(self.eta);
        r * (1.0 - self.spec_tint) + burley::schlick(r0, cos, self.eta) * self.spec_tint
    }

    /// Returns the transmittance of a facet at the cosine `cos`.
    fn facet_transmittance(&self, cos: f32) -> Rgb {
        self.base_color * (1.0 - fresnel::dielectric(cos, self.eta).reflectance)
    }

    /// Returns the weight of diffuse reflection.
    fn diffuse_reflection(&self) -> f32 {
        (1.0 - self.spec_trans) * (1.0 - 0.5 * self.diff_trans)
    }

    /// Returns the weight of diffuse transmission.
    fn diffuse_transmission(&self) -> f32 {
        (1.0 - self.spec_trans) * 0.5 * self.diff_trans
    }

    fn sheen_color(&self) -> Rgb {
        burley::tinted(self.base_color, self.sheen_tint)
    }

    /// Returns probabilities in proportion to estimates of the lobes' albedos. For facets it is that of the mean
    /// facet plus the mean of Schlick's weight, so that every lobe that scatters has a positive probability. `None`
    /// if nothing is scattered.
    fn probabilities(&self, cos_o: f32) -> Option<ThinLobeProbabilities> {
        let raised = |f: f32| f + (1.0 - f).max(0.0) * MEAN_SCHLICK_WEIGHT;
        let base = self.base_color.max_component();
        let sheen = self.sheen * self.sheen_color().max_component() * (PI * MEAN_SCHLICK_WEIGHT);
        let diffuse_reflection = self.diffuse_reflection() * (base + sheen);
        let diffuse = diffuse_reflection + self.diffuse_transmission() * base;
        let (mut reflection, mut transmission) = (0.0, 0.0);
        if self.spec_trans > 0.0 {
            reflection = self.spec_trans * raised(self.facet_reflectance(cos_o).max_component());
            let transmitted = self.facet_transmittance(cos_o).max_component();
            transmission = self.spec_trans * (transmitted + base * MEAN_SCHLICK_WEIGHT);
        }
        let total = diffuse + transmission + reflection;
        if total <= 0.0 {
            return None;
        }
        let to =
            [diffuse_reflection, diffuse, diffuse + transmission].map(|sum| probability_below(sum / total));
        Some(ThinLobeProbabilities {
            diffuse_reflection: to[0],
            diffuse_transmission: to[1] - to[0],
            transmission: to[2] - to[1],
            reflection: 1.0 - to[2],
            to: [to[1], to[2]],
        })
    }

    /// Evaluates the sum of all lobes.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z * wi.z == 0.0 {
            return BsdfEval::ZERO;
        }
        let side = 1f32.copysign(wo.z);
        let (wo, wi) = (wo * side, wi * side);
        let Some(probabilities) = self.probabilities(wo.z) else { return BsdfEval::ZERO };
        match wi.z > 0.0 {
            true => self.eval_reflection(wo, wi, &probabilities),
            false => self.eval_transmission(wo, wi, &probabilities),
        }
    }

    fn eval_reflection(&self, wo: Vec3, wi: Vec3, probabilities: &ThinLobeProbabilities) -> BsdfEval {
        let Some(facet) = Facet::mirroring(wo, wi) else { return BsdfEval::ZERO };
        let share = self.diffuse_reflection();
        let diffuse = burley::diffuse(wo.z, wi.z, facet.cos_o, self.roughness, self.flatness);
        let mut sum = BsdfEval {
            f: self.base_color * (share * FRAC_1_PI * diffuse),
            pdf: probabilities.diffuse_reflection * warp::square_to_cosine_hemisphere_pdf(wi),
        };
        if self.sheen > 0.0 {
            let weight = burley::schlick_weight(facet.cos_o);
            sum.f += self.sheen_color() * (share * self.sheen * weight);
        }
        if self.spec_trans > 0.0 {
            let microfacets = self.reflecting();
            let g = microfacets.g1(wo, facet.m) * microfacets.g1(wi, facet.m);
            let value = microfacets.d(facet.m) * g / (4.0 * wo.z * wi.z);
            sum.f += self.facet_reflectance(facet.cos_o) * (self.spec_trans * value);
            sum.pdf += probabilities.reflection * microfacets.pdf(wo, facet.m) * facet.dm_dwi;
        }
        sum
    }

    /// Evaluates rough transmission, which is a reflection mirrored at the surface. The facet must also face away
    /// from the direction below. At grazing angles some light is lost, and the lobe is not reciprocal.
    fn eval_transmission(&self, wo: Vec3, wi: Vec3, probabilities: &ThinLobeProbabilities) -> BsdfEval {
        let mut sum = BsdfEval {
            f: self.base_color * (self.diffuse_transmission() * FRAC_1_PI),
            pdf: probabilities.diffuse_transmission * warp::square_to_cosine_hemisphere_pdf(-wi),
        };
        if self.spec_trans > 0.0
            && let Some(facet) = Facet::mirroring(wo, mirrored(wi))
        {
            let microfacets = self.transmitting();
            // Masking is zero unless the facet faces away.
            let g = microfacets.g1(wo, facet.m) * microfacets.g1(wi, facet.m);
            let value = microfacets.d(facet.m) * g / (4.0 * wo.z * wi.z.abs());
            sum.f += self.facet_transmittance(facet.cos_o) * (self.spec_trans * value);
            sum.pdf += probabilities.transmission * microfacets.pdf(wo, facet.m) * facet.dm_dwi;
        }
        sum
    }

    /// Samples one lobe, weighted by the sum of all densities.
    pub fn sample(&self, wo: Vec3, u_lobe: f32, u: Vec2) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let side = 1f32.copysign(wo.z);
        let up = wo * side;
        let probabilities = self.probabilities(up.z)?;
        let (wi, lobe) = if u_lobe < probabilities.diffuse_reflection {
            (warp::square_to_cosine_hemisphere(u), Lobe::Diffuse)
        } else if u_lobe < probabilities.to[0] {
            (-warp::square_to_cosine_hemisphere(u), Lobe::Diffuse)
        } else if u_lobe < probabilities.to[1] {
            (mirrored(Facet::mirror(up, self.transmitting().sample(up, u))?.0), Lobe::Glossy)
        } else if probabilities.reflection > 0.0 {
            (Facet::mirror(up, self.reflecting().sample(up, u))?.0, Lobe::Glossy)
        } else {
            return None;
        };
        let wi = wi * side;
        let BsdfEval { f, pdf } = self.eval(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: f * (wi.z.abs() / pdf), pdf, lobe, eta: 1.0 })
    }

    /// Returns the albedo of the base plus mean facet and transmission at normal incidence.
    pub fn albedo(&self) -> Rgb {
        let specular = self.facet_reflectance(1.0) + self.facet_transmittance(1.0);
        self.base_color * (1.0 - self.spec_trans) + specular * self.spec_trans
    }
}
