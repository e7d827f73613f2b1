//! Instances: transforms of a group of geometries to world space, at rest or moving.

use super::geometry::{COORDINATE_LIMIT, is_valid};
use crate::error::{Error, Result};
use crate::math::robust::{UNIT_ROUNDOFF, gamma};
use crate::math::{Bounds, DAffine3, DMat3, DVec3, Ray, Vec3};

/// The greatest number of motion steps of an instance (Embree's limit).
pub const MAX_STEPS: usize = 129;

/// The valid range of the length of a group's axis in world space. Products of such lengths stay normal numbers in
/// `f32`.
const AXIS_LENGTHS: [f64; 2] = [1e-9, 1e9];

/// An affine transform as its columns: three axes and the translation.
type AffineColumns = [f32; 12];

/// A placement of a group of geometries in world space, at rest or moving.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Index of the group.
    pub group: u32,
    /// The transforms from group to world space at equally spaced times over [0, 1]; a single one for an instance at
    /// rest.
    steps: Vec<AffineColumns>,
}

impl Instance {
    /// Creates an instance of a group. `steps` are the transforms from group to world space at equally spaced times
    /// over [0, 1]; with one step the instance does not move. They are rounded to `f32`.
    ///
    /// # Panics
    /// If `steps` is empty or longer than [`MAX_STEPS`].
    pub fn new(group: u32, steps: &[DAffine3]) -> Instance {
        assert!((1..=MAX_STEPS).contains(&steps.len()), "1 to {MAX_STEPS} steps, found {}", steps.len());
        let steps = steps.iter().map(|m| m.to_cols_array().map(|x| x as f32)).collect();
        Instance { group, steps }
    }

    /// Returns whether there is more than one step.
    pub fn is_moving(&self) -> bool {
        self.steps.len() > 1
    }

    /// Returns the steps, each as three axes and the translation.
    pub fn steps(&self) -> &[[f32; 12]] {
        &self.steps
    }

    /// Returns the step at or before a time in [0, 1] (never the last) and the weight of the next one, as Embree
    /// computes them.
    fn segment(&self, time: f32) -> (usize, f32) {
        let last = self.steps.len() - 1;
        if last == 0 {
            return (0, 0.0);
        }
        let scaled = time * last as f32;
        let first = scaled.floor().clamp(0.0, (last - 1) as f32);
        (first as usize, scaled - first)
    }

    /// Returns the transform to world space at a time in [0, 1]: a linear interpolation of the steps' matrices.
    pub fn to_world(&self, time: f32) -> DAffine3 {
        let (first, share) = self.segment(time);
        let a = widen(&self.steps[first]);
        match self.steps.get(first + 1) {
            None => a,
            Some(b) => blend(&a, &widen(b), f64::from(share)),
        }
    }

    /// Returns the transform from world space at a time in [0, 1].
    pub(super) fn world_inverse(&self, time: f32) -> DAffine3 {
        self.to_world(time).inverse()
    }

    /// Returns a bound, in world space and per component, on the error of a ray origin near the world-space point `p`
    /// after a back end's transform to group space. A hit point of the group includes it in its error bound, so that
    /// a ray that leaves the point starts on the correct side of the surface in group space, too.
    ///
    /// Derivation, with A the matrix, t the translation and u the unit roundoff of `f32`. Embree has the largest
    /// error because it computes in `f32`; the BVH and brute force transform in double precision.
    /// - A = (1−s)·A₀ + s·A₁, for a moving instance: the error is γ₄·((1−s)|A₀| + s|A₁|), plus u·(time·steps)·|A₁ −
    ///   A₀| from the rounding of s;
    /// - L = A⁻¹ = adj A / det A: the error of a minor is γ₂ times its permanent, that of the determinant γ₅ times
    ///   its permanent, that of the quotient γ₄ times itself: |δL| ≤ γ₂·per-adj/|det| + |L|·(γ₅·per/|det| + γ₄);
    /// - L·p + (−L·t): the additional error is γ₇·|L|·(|p| + |t|).
    ///
    /// γ₁₆ in place of all these constants covers the terms of second order. Multiplication by |A| transforms the
    /// error back to world space. [Higham 2002, sections 3.1 and 3.5]
    pub fn transform_error(&self, time: f32, p: Vec3) -> Vec3 {
        let (first, share) = self.segment(time);
        let world = self.to_world(time);
        let inverse = InverseTerms::new(&world.matrix3);
        let (p, t) = (p.as_dvec3(), world.translation);
        let g = f64::from(gamma(16));
        let l = inverse.entries();
        let off = inverse.minors * (1.0 / inverse.det) + l * (inverse.condition() + 2.0);
        let mut error = absolute(&world.matrix3) * (off * (p.abs() + t.abs())) * g;
        if let Some(b) = self.steps.get(first + 1) {
            let (a, b) = (widen(&self.steps[first]), widen(b));
            let local = l * (p - t).abs();
            let between =
                |x: DVec3, y: DVec3| x.abs() * (1.0 - f64::from(share)) + y.abs() * f64::from(share);
            let sum = DMat3::from_cols(
                between(a.matrix3.x_axis, b.matrix3.x_axis),
                between(a.matrix3.y_axis, b.matrix3.y_axis),
                between(a.matrix3.z_axis, b.matrix3.z_axis),
            );
            error += (sum * local + between(a.translation, b.translation)) * f64::from(gamma(4));
            let way = absolute(&(b.matrix3 - a.matrix3)) * local + (b.translation - a.translation).abs();
            error += way * f64::from(UNIT_ROUNDOFF * (first + 1) as f32);
        }
        error.as_vec3().map(f32::next_up)
    }

    /// Returns the bounding box in world space, over all times, of the box `bounds` in group space. It is rounded
    /// outwards by [`transform_error`](Self::transform_error). The result is empty for an empty box.
    pub(crate) fn bounds(&self, bounds: Bounds) -> Bounds {
        if bounds.is_empty() {
            return Bounds::EMPTY;
        }
        // Between two steps every point moves along a straight line, so the boxes at the steps contain it.
        let last = (self.steps.len() - 1).max(1) as f32;
        let at = |i: usize| {
            let time = i as f32 / last;
            let world = widen(&self.steps[i]);
            Bounds::of((0..8).flat_map(move |k| {
                let pick =
                    |bit: usize, axis: usize| if k & bit == 0 { bounds.min[axis] } else { bounds.max[axis] };
                let p =
                    world.transform_point3(DVec3::from([pick(1, 0), pick(2, 1), pick(4, 2)].map(f64::from)));
                let p = p.as_vec3();
                let e = self.transform_error(time, p);
                [(p - e).map(f32::next_down), (p + e).map(f32::next_up)]
            }))
        };
        (0..self.steps.len()).map(at).fold(Bounds::EMPTY, Bounds::union)
    }

    /// Checks that the transform is invertible at every time. Returns the greatest component of a world-space ray
    /// that stays within [`COORDINATE_LIMIT`] in group space.
    ///
    /// # Errors
    /// If a step is not finite, the length of an axis is outside [`AXIS_LENGTHS`], or the transform is singular to
    /// within the rounding of `f32` at a step or between two steps.
    pub(super) fn check(&self) -> Result<f32> {
        for (i, step) in self.steps.iter().enumerate() {
            if !step.iter().all(|x| x.abs() < COORDINATE_LIMIT) {
                return Err(Error::scene(format!("expected a finite transform, found {step:?} (step {i})")));
            }
            let m = widen(step).matrix3;
            for length in [m.x_axis, m.y_axis, m.z_axis].map(DVec3::length) {
                if !(AXIS_LENGTHS[0]..=AXIS_LENGTHS[1]).contains(&length) {
                    let [least, greatest] = AXIS_LENGTHS;
                    return Err(Error::scene(format!(
                        "expected a transform that scales by {least:e} to {greatest:e}, found {length:e} (step {i})"
                    )));
                }
            }
        }
        let alone = [self.steps[0], self.steps[0]];
        let pairs = if self.is_moving() { self.steps.windows(2) } else { alone.windows(2) };
        let mut limit = f64::from(COORDINATE_LIMIT);
        for (i, pair) in pairs.enumerate() {
            let (a, b) = (widen(&pair[0]), widen(&pair[1]));
            let widest = |x: DVec3, y: DVec3| x.abs().max(y.abs());
            let greatest = InverseTerms::new(&DMat3::from_cols(
                widest(a.matrix3.x_axis, b.matrix3.x_axis),
                widest(a.matrix3.y_axis, b.matrix3.y_axis),
                widest(a.matrix3.z_axis, b.matrix3.z_axis),
            ));
            let det = least_determinant(&a.matrix3, &b.matrix3);
            if det.is_nan() || det <= f64::from(gamma(32)) * greatest.permanent {
                return Err(Error::scene(match self.is_moving() {
                    false => "expected an invertible transform, found a singular one".to_string(),
                    true => format!(
                        "expected a motion that is invertible at all times, found a singular transform between the steps {i} and {}; use more steps",
                        i + 1
                    ),
                }));
            }
            let inverse = greatest.minors * (1.0 / det);
            let reach = f64::from(COORDINATE_LIMIT) * 0.5;
            let offset = inverse * widest(a.translation, b.translation);
            let share = (DVec3::splat(reach) - offset) / (inverse * DVec3::ONE);
            limit = limit.min(share.min_element());
        }
        if limit <= 0.0 {
            return Err(Error::scene("expected a transform nearer to the origin; its inverse overflows"));
        }
        Ok(limit as f32)
    }
}

/// Transforms a ray by `inverse` in double precision, with one rounding. Ray parameters are unchanged.
#[inline]
pub(super) fn local_ray(inverse: &DAffine3, ray: &Ray) -> Ray {
    let o = inverse.transform_point3(ray.o.as_dvec3()).as_vec3();
    let d = inverse.transform_vector3(ray.d.as_dvec3()).as_vec3();
    Ray { o, d, ..*ray }
}

/// Checks that a box is empty or lies within [`COORDINATE_LIMIT`].
///
/// # Errors
/// If it does not.
pub(super) fn check_reach(b: Bounds) -> Result<()> {
    match b.is_empty() || is_valid(b.min) && is_valid(b.max) {
        true => Ok(()),
        false => Err(Error::scene(format!("expected coordinates up to {COORDINATE_LIMIT:e}, found {b:?}"))),
    }
}

fn widen(columns: &AffineColumns) -> DAffine3 {
    DAffine3::from_cols_array(&columns.map(f64::from))
}

/// Returns (1−s)·a + s·b.
fn blend(a: &DAffine3, b: &DAffine3, s: f64) -> DAffine3 {
    DAffine3 {
        matrix3: a.matrix3 * (1.0 - s) + b.matrix3 * s,
        translation: a.translation * (1.0 - s) + b.translation * s,
    }
}

fn absolute(m: &DMat3) -> DMat3 {
    DMat3::from_cols(m.x_axis.abs(), m.y_axis.abs(), m.z_axis.abs())
}

/// The terms of an inverse on which its error depends.
struct InverseTerms {
    /// The adjugate: the cross products of the axes, one in each row.
    adjugate: DMat3,
    /// The adjugate with the absolute values of all products added.
    minors: DMat3,
    /// The determinant's absolute value.
    det: f64,
    /// The determinant with the absolute values of all products added.
    permanent: f64,
}

impl InverseTerms {
    fn new(m: &DMat3) -> Self {
        let (a, b, c) = (m.x_axis, m.y_axis, m.z_axis);
        let sum = |p: DVec3, q: DVec3| {
            let (p, q) = (p.abs(), q.abs());
            DVec3::new(p.y * q.z + p.z * q.y, p.z * q.x + p.x * q.z, p.x * q.y + p.y * q.x)
        };
        InverseTerms {
            adjugate: DMat3::from_cols(b.cross(c), c.cross(a), a.cross(b)).transpose(),
            minors: DMat3::from_cols(sum(b, c), sum(c, a), sum(a, b)).transpose(),
            det: a.dot(b.cross(c)).abs(),
            permanent: a.abs().dot(sum(b, c)),
        }
    }

    /// Returns the absolute values of the inverse's entries.
    fn entries(&self) -> DMat3 {
        absolute(&self.adjugate) * (1.0 / self.det)
    }

    fn condition(&self) -> f64 {
        self.permanent / self.det
    }
}

/// Returns the minimum over s in [0, 1] of the determinant of (1−s)·a + s·b, times the sign of det a. The determinant
/// is a cubic in s.
fn least_determinant(a: &DMat3, b: &DMat3) -> f64 {
    let d = *b - *a;
    let det = |x: DVec3, y: DVec3, z: DVec3| x.dot(y.cross(z));
    let c0 = det(a.x_axis, a.y_axis, a.z_axis);
    let c1 = det(d.x_axis, a.y_axis, a.z_axis)
        + det(a.x_axis, d.y_axis, a.z_axis)
        + det(a.x_axis, a.y_axis, d.z_axis);
    let c2 = det(d.x_axis, d.y_axis, a.z_axis)
        + det(d.x_axis, a.y_axis, d.z_axis)
        + det(a.x_axis, d.y_axis, d.z_axis);
    let c3 = det(d.x_axis, d.y_axis, d.z_axis);
    let at = |s: f64| (((c3 * s + c2) * s + c1) * s + c0) * c0.signum();
    // Roots of the derivative 3·c3·s² + 2·c2·s + c1, in the form without cancellation.
    let q = -(c2 + (c2 * c2 - 3.0 * c3 * c1).max(0.0).sqrt().copysign(c2));
    let inside = [q / (3.0 * c3), c1 / q].into_iter().filter(|s| *s > 0.0 && *s < 1.0);
    inside.chain([0.0, 1.0]).map(at).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::DQuat;

    fn turned(angle: f64) -> DAffine3 {
        DAffine3::from_rotation_z(angle)
    }

    #[test]
    fn a_motion_is_linear_between_its_steps() {
        let steps = [0.0, 2.0, 8.0].map(|x| DAffine3::from_translation(DVec3::X * x));
        let moving = Instance::new(3, &steps);
        let at = |time| moving.to_world(time).translation.x;
        assert_eq!([0.0, 0.25, 0.5, 0.75, 1.0].map(at), [0.0, 1.0, 2.0, 5.0, 8.0]);
        assert!(moving.is_moving() && !Instance::new(0, &steps[..1]).is_moving());
        let b = moving.bounds(Bounds::of([Vec3::ZERO, Vec3::ONE]));
        assert!(b.min.x <= 0.0 && b.min.x > -1e-5 && b.max.x >= 9.0 && b.max.x < 9.0001);
    }

    #[test]
    fn transforms_without_an_inverse_are_refused_in_a_sentence() {
        let refused = |steps: &[DAffine3]| Instance::new(0, steps).check().unwrap_err().to_string();
        assert!(
            refused(&[DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0))]).contains("scales by 1e-9 to 1e9")
        );
        assert!(refused(&[DAffine3::from_scale(DVec3::splat(f64::NAN))]).starts_with("expected a finite"));
        let flat = DAffine3 {
            matrix3: DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::ONE - DVec3::Z),
            translation: DVec3::ZERO,
        };
        assert_eq!(refused(&[flat]), "expected an invertible transform, found a singular one");
        let half_turn = [turned(0.0), turned(1.0), turned(1.0 + std::f64::consts::PI)];
        assert!(refused(&half_turn).contains("between the steps 1 and 2; use more steps"));
        assert!(refused(&[turned(0.0), DAffine3::from_scale(DVec3::new(1.0, 1.0, -1.0))]).contains("motion"));
        assert!(Instance::new(0, &[turned(0.0), turned(1.5), turned(3.0)]).check().is_ok());
        assert!(Instance::new(0, &[DAffine3::from_scale(DVec3::new(1.0, -1.0, 1e-8))]).check().is_ok());
    }

    /// Emulates Embree's inverse and product in `f32` and compares them with double precision.
    #[test]
    fn the_transforms_error_is_within_its_bound_and_not_far_below() {
        let mut worst = 0f64;
        for i in 0..4000 {
            let k = |step: f64| (f64::from(i) * step).fract() * 2.0 - 1.0;
            let axis = DVec3::new(k(0.618), k(0.755), k(0.569)).normalize();
            let scale = DVec3::new(k(0.31).exp2(), -(k(0.77) * 3.0).exp2(), (k(0.47) * 3.0).exp2());
            let t = DVec3::new(k(0.21), k(0.83), k(0.37)) * (k(0.91) * 10.0).exp2();
            let m = DAffine3::from_scale_rotation_translation(
                scale,
                DQuat::from_axis_angle(axis, 3.0 * k(0.13)),
                t,
            );
            let instance = Instance::new(0, &[m]);
            let s = instance.steps[0];
            let (a, b, c) =
                (Vec3::from_slice(&s[0..3]), Vec3::from_slice(&s[3..6]), Vec3::from_slice(&s[6..9]));
            let det = a.dot(b.cross(c));
            let rows = [b.cross(c) / det, c.cross(a) / det, a.cross(b) / det];
            let l = crate::math::Mat3::from_cols(rows[0], rows[1], rows[2]).transpose();
            let translation = -(l * Vec3::from_slice(&s[9..12]));
            let p = (t + axis * 2.0).as_vec3();
            let found = instance.to_world(0.0).transform_point3((l * p + translation).as_dvec3());
            let error = (found - p.as_dvec3()).abs();
            let bound = instance.transform_error(0.0, p).as_dvec3();
            assert!(error.cmple(bound).all(), "{i}: {error} > {bound}");
            worst = worst.max((error / bound).max_element());
        }
        assert!(worst > 0.01, "{worst}");
    }
}
