//! Irradiance records: irradiance at a point, its gradients, and the radius within which it is used.

use super::hemisphere::{Gradient, Hemisphere};
use super::hessian::Hessian;
use crate::color::Rgb;
use crate::math::Vec3;

/// The irradiance at a point of a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Record {
    /// The position in world space.
    pub p: Vec3,
    /// The surface normal on the side of the incident light, of unit length.
    pub n: Vec3,
    /// Irradiance of all light except emission towards the point and caustics, W·m⁻².
    pub irradiance: Rgb,
    /// The gradient of the irradiance with respect to the normal.
    pub rotation: Gradient,
    /// The gradient of the irradiance along the surface, per unit of length.
    pub translation: Gradient,
    /// The radius within which the record has positive weight.
    pub radius: f32,
}

/// The parameters that determine the radius of a record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    /// The radius in pixels at which the relative second derivatives of the irradiance add up to 1 per squared pixel.
    pub tolerance: f32,
    /// The upper bound of the radius relative to the harmonic mean distance. It limits the error if rays missed near
    /// surfaces.
    pub distance: f32,
    /// Size of a pixel.
    pub pixel: f32,
    /// Lower bound of the radius.
    pub min: f32,
    /// Upper bound of the radius.
    pub max: f32,
}

impl Spacing {
    /// Returns the radius of a record with the irradiance `e` according to its Hessian, before other bounds.
    ///
    /// At the distance R, the relative error is about |λ|R²/E. For a given number of records, the sum of its square
    /// over all pixels is minimal for R = c (p E/|λ|)^⅓ with pixels of size p. (The sum of the error itself over the
    /// surfaces is minimal for the fourth root of E/|λ|. [Jarosz et al. 2012])
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
    /// Creates the record of a hemisphere at the point `p`.
    pub fn new(p: Vec3, hemisphere: &Hemisphere<'_>, gradients: bool, spacing: Spacing) -> Self {
        let irradiance = hemisphere.irradiance();
        let translation = hemisphere.translation_gradient();
        let bent = spacing.radius(irradiance.luminance(), &Hessian::of(hemisphere));
        let radius = bent.min(spacing.distance * hemisphere.harmonic_mean_distance());
        // If the lower bound increases the radius, the translation gradient is reduced by the same factor: it is not
        // valid over the larger distance, and the change over the radius stays the same. [Křivánek 2006, 4.2]
        let raised = (radius / spacing.min).min(1.0);
        let radius = radius.clamp(spacing.min, spacing.max);
        let contents = |gradient: Gradient| if gradients { gradient } else { Gradient::default() };
        Record {
            p,
            n: hemisphere.frame.n,
            irradiance,
            rotation: contents(hemisphere.rotation_gradient()),
            translation: contents(translation.scaled(raised)),
            radius,
        }
    }
}
