//! Surfaces of instances, transformed from group space to world space.

use crate::accel::Instance;
use crate::math::robust::gamma;
use crate::math::{DAffine3, DMat3, Vec3};

/// The transform of an instance at one time.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    to_world: DAffine3,
    /// The matrix for normals, up to a positive factor: det·M⁻ᵀ, with the sign of the determinant.
    normals: DMat3,
}

/// A surface point in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedSurface {
    /// Position.
    pub p: Vec3,
    /// Bound on the distance of `p` from the surface.
    pub error: f32,
    /// Unit normal.
    pub n: Vec3,
}

impl Placement {
    /// Creates the transform at a time in [0, 1] over the shutter interval.
    pub fn new(instance: &Instance, time: f32) -> Self {
        let to_world = instance.to_world(time);
        let m = to_world.matrix3;
        let (x, y, z) = (m.x_axis, m.y_axis, m.z_axis);
        let cofactor = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
        Placement { to_world, normals: cofactor * m.determinant().signum() }
    }

    /// Transforms a vector from group space to world space.
    pub fn vector(&self, v: Vec3) -> Vec3 {
        (self.to_world.matrix3 * v.as_dvec3()).as_vec3()
    }

    /// Transforms a point from world space to group space.
    pub fn local_point(&self, p: Vec3) -> Vec3 {
        self.to_world.inverse().transform_point3(p.as_dvec3()).as_vec3()
    }

    /// Transforms a normal from group space to world space, with unit length.
    pub fn normal(&self, n: Vec3) -> Vec3 {
        (self.normals * n.as_dvec3()).normalize_or_zero().as_vec3()
    }

    /// Transforms a normal from world space to group space, with unit length.
    pub fn local_normal(&self, n: Vec3) -> Vec3 {
        (self.to_world.matrix3.transpose() * n.as_dvec3()).normalize_or_zero().as_vec3()
    }

    /// Returns the ratio of areas in world space and group space for a surface with the unit normal `n` in group
    /// space.
    pub fn stretch(&self, n: Vec3) -> f32 {
        (self.normals * n.as_dvec3()).length() as f32
    }

    /// Transforms a surface point, with a bound on its distance from the surface, from group space to world space.
    pub fn surface(&self, instance: &Instance, time: f32, p: Vec3, error: f32, n: Vec3) -> PlacedSurface {
        let world = self.to_world.transform_point3(p.as_dvec3());
        let bent = self.normals * n.as_dvec3();
        let normal = bent.normalize_or_zero();
        // Distances along the normal scale by det / |det·M⁻ᵀ·n|.
        let along = self.to_world.matrix3.determinant().abs() / bent.length();
        let p = world.as_vec3();
        let rounding = instance.transform_error(time, p).as_dvec3() + world.abs() * f64::from(gamma(2));
        let off = f64::from(error) * along + normal.abs().dot(rounding);
        PlacedSurface { p, error: (off * (1.0 + 1e-6)) as f32, n: normal.as_vec3() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::DVec3;

    #[test]
    fn areas_and_normals_follow_the_cofactors() {
        let squeeze = DAffine3::from_scale(DVec3::new(2.0, 3.0, -5.0));
        let instance = Instance::new(0, &[squeeze]);
        let placed = Placement::new(&instance, 0.0);
        assert!(
            (placed.stretch(Vec3::Z) - 6.0).abs() < 1e-6 && (placed.stretch(Vec3::X) - 15.0).abs() < 1e-6
        );
        assert_eq!(placed.normal(Vec3::Z), -Vec3::Z);
        let n = Vec3::new(1.0, 2.0, 3.0).normalize();
        assert!((placed.local_normal(placed.normal(n)) - n).length() < 1e-6);
        let at = placed.surface(&instance, 0.0, Vec3::new(1.0, 1.0, 1.0), 1e-3, Vec3::Z);
        assert_eq!(at.p, Vec3::new(2.0, 3.0, -5.0));
        assert!(at.error >= 5e-3 && at.error < 5.1e-3, "{}", at.error);
        assert!((placed.local_point(at.p) - Vec3::ONE).length() < 1e-6);
    }
}
