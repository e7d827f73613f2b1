//! Diffuse reflection by a rough surface. [Oren and Nayar 1994]

use super::{BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::{FRAC_1_PI, PI};

/// Reflection by Lambertian facets with Gaussian slopes on the front side; the back side is black.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughDiffuse {
    /// Reflectance of the facets.
    pub reflectance: Rgb,
    /// Standard deviation of the facets' inclination, radians.
    pub sigma: f32,
    /// Whether the qualitative model is used, without light that is reflected twice.
    pub qualitative: bool,
}

impl RoughDiffuse {
    /// Evaluates the model. [Oren and Nayar 1994, Eq. 26, 29, 30]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        let f = if self.qualitative { self.qualitative(wo, wi) } else { self.full(wo, wi) };
        BsdfEval { f: f * FRAC_1_PI, pdf: warp::square_to_cosine_hemisphere_pdf(wi) }
    }

    /// Returns π·f by Eq. 30.
    fn qualitative(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let s2 = self.sigma * self.sigma;
        let (a, b) = (1.0 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09));
        let Angles { cos_phi, sin_alpha, sin_beta, cos_beta, .. } = Angles::new(wo, wi);
        self.reflectance * (a + b * cos_phi.max(0.0) * sin_alpha * sin_beta / cos_beta)
    }

    /// Returns π·f by Eq. 26 and 29.
    fn full(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let s2 = self.sigma * self.sigma;
        let Angles { cos_phi, sin_alpha, cos_alpha, sin_beta, cos_beta } = Angles::new(wo, wi);
        let (alpha, beta) = (sin_alpha.atan2(cos_alpha), sin_beta.atan2(cos_beta));
        let c1 = 1.0 - 0.5 * s2 / (s2 + 0.33);
        let beta_share = 2.0 * beta / PI;
        let c2 =
            0.45 * s2 / (s2 + 0.09) * (sin_alpha - if cos_phi >= 0.0 { 0.0 } else { beta_share.powi(3) });
        let c3 = 0.125 * s2 / (s2 + 0.09) * (4.0 * alpha * beta / (PI * PI)).powi(2);
        let tan_half = (sin_alpha + sin_beta) / (cos_alpha + cos_beta);
        let once = c1 + cos_phi * c2 * sin_beta / cos_beta + (1.0 - cos_phi.abs()) * c3 * tan_half;
        let twice = 0.17 * s2 / (s2 + 0.13) * (1.0 - cos_phi * beta_share * beta_share);
        self.reflectance.map(|rho| rho * once + rho * rho * twice)
    }

    /// Samples `wi` in proportion to its cosine.
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        let wi = warp::square_to_cosine_hemisphere(u);
        let BsdfEval { f, pdf } = self.eval(wo, wi);
        (pdf > 0.0).then(|| BsdfSample { wi, weight: f * PI, pdf, lobe: Lobe::Diffuse, eta: 1.0 })
    }
}

/// The angles of the model: α is the larger and β the smaller angle to the normal, φ the difference of azimuths.
struct Angles {
    cos_phi: f32,
    sin_alpha: f32,
    cos_alpha: f32,
    sin_beta: f32,
    cos_beta: f32,
}

impl Angles {
    fn new(wo: Vec3, wi: Vec3) -> Self {
        let sin = |w: Vec3| (w.x * w.x + w.y * w.y).sqrt();
        let (a, b) = if wo.z < wi.z { (wo, wi) } else { (wi, wo) };
        let (sin_alpha, sin_beta) = (sin(a), sin(b));
        let product = sin_alpha * sin_beta;
        let cos_phi = if product > 0.0 { (a.x * b.x + a.y * b.y) / product } else { 0.0 };
        Angles { cos_phi: cos_phi.clamp(-1.0, 1.0), sin_alpha, cos_alpha: a.z, sin_beta, cos_beta: b.z }
    }
}
