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

/// How far records may be apart, by the size of a pixel where they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    /// The radius where the irradiance's relative second derivative is 1 per square of a pixel, in pixels.
    pub tolerance: f32,
    /// Size of a pixel.
    pub pixel: f32,
    /// Least radius.
    pub min: f32,
    /// Greatest radius.
    pub max: f32,
}

impl Spacing {
    /// The radius of a record with the irradiance `e` that bends by `hessian`, before it is bounded.
    ///
    /// Within the radius R a pixel's relative error is about |λ|R²/E. Its square over all pixels, for a given number of
    /// records, is least where R = c (p E/|λ|)^⅓ with pixels of size p; minimising the error itself instead makes it the fourth root
    /// of [Jarosz 2012, 4.1].
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
        let radius = spacing.radius(irradiance.luminance(), &Hessian::of(hemisphere));
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
