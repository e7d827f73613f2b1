//! Ideal diffuse transmission.

use super::{BsdfEval, BsdfSample, Lobe};
use crate::color::Rgb;
use crate::math::{Vec2, Vec3};
use crate::sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// Lambertian transmission in both directions, as by thin paper; nothing is reflected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffuseTransmitter {
    /// Fraction of the light that is transmitted.
    pub transmittance: Rgb,
}

impl DiffuseTransmitter {
    /// Returns `f = τ/π` and its density.
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wo.z * wi.z >= 0.0 {
            return BsdfEval::ZERO;
        }
        BsdfEval { f: self.transmittance * FRAC_1_PI, pdf: wi.z.abs() * FRAC_1_PI }
    }

    /// Samples `wi` in proportion to its cosine.
    pub fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        if wo.z == 0.0 {
            return None;
        }
        let mut wi = warp::square_to_cosine_hemisphere(u);
        wi.z = -wi.z.copysign(wo.z);
        let pdf = wi.z.abs() * FRAC_1_PI;
        (pdf > 0.0).then_some(BsdfSample {
            wi,
            weight: self.transmittance,
            pdf,
            lobe: Lobe::Diffuse,
            eta: 1.0,
        })
    }
}
