//! Homogeneous media.

use super::Phase;
use crate::color::Rgb;

/// A medium with the same coefficients everywhere.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Homogeneous {
    /// The extinction coefficient by channel, at least 0 and finite, in inverse world-space units.
    pub sigma_t: Rgb,
    /// The scattering coefficient by channel, from 0 to `sigma_t`.
    pub sigma_s: Rgb,
    /// The phase function.
    pub phase: Phase,
}

impl Homogeneous {
    /// Returns whether the medium scatters light in any channel.
    #[inline]
    pub fn scatters(&self) -> bool {
        !self.sigma_s.is_black()
    }

    /// Returns the mean cosine of the angle of deflection if the phase function is that of Henyey and Greenstein, of
    /// which isotropic scattering is a case.
    pub fn asymmetry(&self) -> Option<f32> {
        match self.phase {
            Phase::Isotropic => Some(0.0),
            Phase::HenyeyGreenstein { g } => Some(g),
            Phase::Rayleigh | Phase::Tabulated(_) | Phase::Blend { .. } => None,
        }
    }
}
