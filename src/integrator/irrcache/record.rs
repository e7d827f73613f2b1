//! What the cache holds: irradiance at a point, how it changes around it, and how far that is to be believed.

use super::hemisphere::{Gradient, Hemisphere};
use crate::color::Rgb;
use crate::math::Vec3;

/// Irradiance at a point of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Record {
    /// The point, in the world.
    pub p: Vec3,
    /// The surface's normal on the side that the light comes from, of unit length.
    pub n: Vec3,
    /// Irradiance by all light that is neither emitted towards the point nor a caustic, W·m⁻².
    pub irradiance: Rgb,
    /// Its change with the normal.
    pub rotation: Gradient,
    /// Its change along the surface, per unit of length.
    pub translation: Gradient,
    /// How far from the point it counts.
    pub radius: f32,
}

/// The least and the greatest radius that a record may have, from the size of a pixel where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    /// Least.
    pub min: f32,
    /// Greatest.
    pub max: f32,
}

/// What bounds the radius of a record: the smaller of both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// As a share of the harmonic mean distance of what is seen.
    pub distance: f32,
    /// By the change of the irradiance over the radius, as a share of the irradiance.
    pub change: f32,
}

impl Tolerance {
    /// A multiple of both.
    pub fn scaled(self, factor: f32) -> Self {
        Tolerance { distance: self.distance * factor, change: self.change * factor }
    }
}

impl Record {
    /// The record of a hemisphere that was seen from the point `p`.
    pub fn new(
        p: Vec3,
        hemisphere: &Hemisphere<'_>,
        tolerance: Tolerance,
        gradients: bool,
        spacing: Spacing,
    ) -> Self {
        let irradiance = hemisphere.irradiance();
        let translation = hemisphere.translation_gradient();
        // Where the irradiance changes much, its change changes, too. [Křivánek 2005, 4.3]
        let slope = translation.luminance().length();
        let reach = if slope > 0.0 { irradiance.luminance() / slope } else { f32::INFINITY };
        let radius = (tolerance.distance * hemisphere.harmonic_mean_distance()).min(tolerance.change * reach);
        // A radius that is raised takes the irradiance where the gradient does not hold: the change over it stays what it was.
        // [Křivánek 2006, 4.2]
        let raised = (radius / spacing.min).min(1.0);
        let radius = radius.clamp(spacing.min, spacing.max);
        let kept = |gradient: Gradient| if gradients { gradient } else { Gradient::default() };
        Record {
            p,
            n: hemisphere.frame.n,
            irradiance,
            rotation: kept(hemisphere.rotation_gradient()),
            translation: kept(translation.scaled(raised)),
            radius,
        }
    }

    /// The irradiance that it foretells at the point `p` of a surface with the normal `n`. [Ward and Heckbert 1992, Eq. 5]
    pub fn extrapolate(&self, p: Vec3, n: Vec3) -> Rgb {
        self.irradiance + self.rotation.dot(self.n.cross(n)) + self.translation.dot(p - self.p)
    }
}
