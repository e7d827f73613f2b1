//! A microfacet that reflects or refracts one direction into another.

use crate::math::Vec3;

/// A microfacet for two directions. The given direction `wo` and the facet's normal are above the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facet {
    /// The facet's normal.
    pub m: Vec3,
    /// `wo·m`, positive.
    pub cos_o: f32,
    /// `wi·m`: positive for a reflection, negative for a refraction.
    pub cos_i: f32,
    /// The Jacobian dωₘ/dωᵢ: the solid angle of m per solid angle of `wi`.
    pub dm_dwi: f32,
}

impl Facet {
    /// Returns the facet that reflects `wo` to `wi`, both above the surface. [Walter 2007, Eq. 13 and 14]
    #[inline]
    pub fn mirroring(wo: Vec3, wi: Vec3) -> Option<Facet> {
        let m = (wo + wi).normalize();
        let (cos_o, cos_i) = (wo.dot(m), wi.dot(m));
        (cos_o > 0.0 && cos_i > 0.0).then(|| Facet { m, cos_o, cos_i, dm_dwi: 1.0 / (4.0 * cos_o) })
    }

    /// Returns the facet that refracts `wo` to `wi` below the surface; `eta ≠ 1` is the index below relative to that
    /// above. `None` if there is no such visible facet. [Walter 2007, Eq. 16 and 17]
    #[inline]
    pub fn refracting(wo: Vec3, wi: Vec3, eta: f32) -> Option<Facet> {
        let h = wo + wi * eta;
        let m = h.normalize();
        let m = if m.z < 0.0 { -m } else { m };
        let (cos_o, cos_i) = (wo.dot(m), wi.dot(m));
        (cos_o > 0.0 && cos_i < 0.0).then(|| {
            let dm_dwi = refraction_jacobian(cos_o, -cos_i, eta);
            Facet { m, cos_o, cos_i, dm_dwi }
        })
    }

    /// Reflects `wo` by the facet m. `None` if the facet is not visible from `wo`, or `wi` is not above the surface.
    #[inline]
    pub fn mirror(wo: Vec3, m: Vec3) -> Option<(Vec3, Facet)> {
        let cos_o = wo.dot(m);
        let wi = (m * (2.0 * cos_o) - wo).normalize();
        (cos_o > 0.0 && wi.z > 0.0)
            .then(|| (wi, Facet { m, cos_o, cos_i: cos_o, dm_dwi: 1.0 / (4.0 * cos_o) }))
    }

    /// Refracts `wo` by the facet m; `cos_t > 0` is the cosine of the refracted direction. `None` if the facet is not
    /// visible from `wo`, or `wi` is not below the surface. [Walter 2007, Eq. 40]
    #[inline]
    pub fn refract(wo: Vec3, m: Vec3, cos_t: f32, eta: f32) -> Option<(Vec3, Facet)> {
        let cos_o = wo.dot(m);
        let wi = (m * (cos_o / eta - cos_t) - wo / eta).normalize();
        (cos_o > 0.0 && wi.z < 0.0).then(|| {
            let dm_dwi = refraction_jacobian(cos_o, cos_t, eta);
            (wi, Facet { m, cos_o, cos_i: -cos_t, dm_dwi })
        })
    }
}

/// Returns `η²·cosθt / (cosθo − η·cosθt)²`. By Snell's law the difference is `(1 − η²) / (cosθo + η·cosθt)`, which
/// has no cancellation. [Walter 2007, Eq. 17]
fn refraction_jacobian(cos_o: f32, cos_t: f32, eta: f32) -> f32 {
    let difference = (1.0 - eta) * (1.0 + eta) / (cos_o + eta * cos_t);
    eta * eta * cos_t / (difference * difference)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::fresnel;

    #[test]
    fn the_facet_between_two_directions_is_the_one_that_joined_them() {
        let wo = Vec3::new(0.3, -0.5, 1.4).normalize();
        let m = Vec3::new(-0.2, 0.1, 1.0).normalize();
        let (wi, there) = Facet::mirror(wo, m).unwrap();
        let back = Facet::mirroring(wo, wi).unwrap();
        assert!((back.m - m).length() < 1e-6 && (back.dm_dwi / there.dm_dwi - 1.0).abs() < 1e-5);
        for eta in [1.5, 1.0 / 1.5, 1.05, 0.9, 2.5] {
            let cos_t = fresnel::dielectric(wo.dot(m), eta).cos_t;
            let (wi, there) = Facet::refract(wo, m, cos_t, eta).unwrap();
            let back = Facet::refracting(wo, wi, eta).unwrap();
            assert!((back.m - m).length() < 1e-5, "{eta}");
            assert!((back.dm_dwi / there.dm_dwi - 1.0).abs() < 1e-4, "{eta}");
            let h = wo + wi * eta;
            let walter = eta * eta * -there.cos_i / h.length_squared();
            assert!((there.dm_dwi / walter - 1.0).abs() < 1e-4, "{eta}");
        }
    }

    #[test]
    fn directions_that_no_facet_joins() {
        let wo = Vec3::new(0.6, 0.0, 0.8);
        // Refraction cannot change the direction by this angle.
        assert_eq!(Facet::refracting(wo, Vec3::new(0.8, 0.0, -0.6), 1.5), None);
        // A facet seen from its back.
        assert_eq!(Facet::mirror(wo, Vec3::new(-0.9, 0.0, 0.1).normalize()), None);
    }
}
