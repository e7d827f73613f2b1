//! What the cache holds: irradiance at a point, how it changes around it, and how far that is to be believed.

use super::hemisphere::{Gradient, Hemisphere};
use super::hessian::Hessian;
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

/// What decides about the radius of a record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    /// The radius in pixels where the relative second derivatives of the irradiance add up to 1 per square of a pixel.
    pub tolerance: f32,
    /// The most that it may be of the harmonic mean distance of what is seen: rays may have missed what is as near.
    pub distance: f32,
    /// Size of a pixel.
    pub pixel: f32,
    /// Least radius.
    pub min: f32,
    /// Greatest radius.
    pub max: f32,
}

impl Spacing {
    /// The radius of a record with the irradiance `e` that bends by `hessian`, before other bounds than the Hessian's.
    ///
    /// Within the radius R, the relative error is about |λ|R²/E. The sum of its square over all pixels is, for a given number of
    /// records, least where R = c (p E/|λ|)^⅓ with pixels of size p. (The sum of the error itself over the surfaces would be where it is
    /// the fourth root of E/|λ|. [Jarosz et al. 2012])
    fn radius(&self, e: f32, hessian: &Hessian) -> f32 {
        let curvature = hessian.curvature();
        if curvature > 0.0 {
            let cube = f64::from(self.pixel) * f64::from(e) / curvature;
            (f64::from(self.tolerance) * cube.cbrt()) as f32
        } else {
            f32::INFINITY
        }
    }
}

impl Record {
    /// The record of a hemisphere that was seen from the point `p`.
    pub fn new(p: Vec3, hemisphere: &Hemisphere<'_>, gradients: bool, spacing: Spacing) -> Self {
        let irradiance = hemisphere.irradiance();
        let translation = hemisphere.translation_gradient();
        let bent = spacing.radius(irradiance.luminance(), &Hessian::of(hemisphere));
        let radius = bent.min(spacing.distance * hemisphere.harmonic_mean_distance());
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
}
