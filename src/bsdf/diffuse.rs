//! Ideal diffuse reflection.

use super::{BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// Lambertian reflection on the front side; the back side is black.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diffuse {
    /// Fraction of the light that is reflected.
    pub reflectance: Rgb,
}

impl Diffuse {
    /// Returns `f = ρ/π` and its density.
    #[inline]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z <= 0.0 || wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        BsdfEval { f: self.reflectance * FRAC_1_PI, pdf: warp::square_to_cosine_hemisphere_pdf(wi) }
    }

    /// Samples `wi` in proportion to its cosine.
    #[inline]
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if wo.z <= 0.0 {
            return None;
        }
        let wi = warp::square_to_cosine_hemisphere(u);
        Some(BsdfSample {
            wi,
            weight: self.reflectance,
            pdf: warp::square_to_cosine_hemisphere_pdf(wi),
            lobe: Lobe::Diffuse,
            eta: 1.0,
        })
    }
}
