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

    /// Returns [`Phase::asymmetry`] of the phase function.
    pub fn asymmetry(&self) -> Option<f32> {
        self.phase.asymmetry()
    }
}
