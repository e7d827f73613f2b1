//! Emitters as point lights: all light comes from the centre, so shadows are hard.

use super::area::{EmitterSurface, PointDensity, front_of};
use super::{AreaEmitter, EmitterSample, Light, ShadowTarget};
use crate::math::ray::{end_error, offset_origin, plane_error};
use crate::math::robust::gamma;
use crate::math::{DVec3, Vec2, Vec3};
use crate::shape::TriangleMesh;
use std::f32::consts::PI;

/// The threshold for a planar mesh: length of the sum of its normal vectors divided by the sum of their lengths.
const PLANAR: f64 = 1.0 - 1e-6;

/// A flat surface element that represents the whole emitter.
struct SurfaceElement {
    p: Vec3,
    /// Bound on the distance of `p` from the emitter's surface.
    error: f32,
    /// Unit normal.
    n: Vec3,
    area: f32,
}

impl Light {
    /// Samples the emitter as if all of its light came from its centre. The sample has the form of a delta light:
    /// radiance is integrated over the solid angle, and the density is 1.
    ///
    /// - A rectangle, a disk or a planar mesh emits from its centre of mass.
    /// - A sphere or cylinder seen from outside emits from the point of its surface nearest to the receiver, with the
    ///   area that a distant receiver sees.
    /// - Any other surface emits from the point to which the centre of its sampling square is mapped.
    /// - The sun emits from the centre of its disc.
    /// - The environment has no centre: `None`.
    ///
    /// `time` is in [0, 1] over the shutter interval.
    pub fn sample_centre(&self, from: Vec3, time: f32) -> Option<EmitterSample> {
        match self {
            Light::Area(area) => area.sample_centre(from, time),
            Light::Environment(_) => None,
            Light::Sun(sun) => Some(sun.centre()),
            Light::Point(_) | Light::Spot(_) | Light::Directional(_) | Light::Projector(_) => {
                self.sample(from, Vec2::ZERO, time)
            }
        }
    }
}

impl AreaEmitter {
    fn sample_centre(&self, from: Vec3, time: f32) -> Option<EmitterSample> {
        let (element, radiance) = match self.element(from) {
            Some(element) => (element, self.emission.mean()),
            None => {
                let (point, radiance) = self.sample_at(None, Vec2::splat(0.5), time)?;
                let PointDensity::PerArea(pdf) = point.pdf else { return None };
                (SurfaceElement { p: point.p, error: point.error, n: point.n, area: 1.0 / pdf }, radiance)
            }
        };
        let to = element.p - from;
        let distance_squared = to.length_squared();
        let wi = to / distance_squared.sqrt();
        let cos = -wi.dot(element.n);
        // NaN if `from` is the point itself.
        if cos.is_nan() || cos <= 0.0 {
            return None;
        }
        Some(EmitterSample {
            wi,
            target: ShadowTarget::Point(offset_origin(
                element.p,
                element.error + end_error(to),
                element.n,
                -wi,
            )),
            radiance: radiance * (element.area * cos / distance_squared),
            pdf: 1.0,
            delta: true,
            cosine: cos,
        })
    }

    /// Returns the surface element that represents the surface, if the surface is at rest and has a centre.
    fn element(&self, from: Vec3) -> Option<SurfaceElement> {
        if self.motion.is_some() {
            return None;
        }
        match &self.surface {
            EmitterSurface::Sphere { center, radius, inward: false } => {
                let n = (from - *center).normalize_or_zero();
                let distance = (from - *center).length();
                let error = plane_error((center.abs() + Vec3::splat(*radius)) * gamma(8), n);
                // The point is nearer than the centre, to which the inverse square law applies; the area compensates
                // for this.
                let area = PI * (radius * (1.0 - radius / distance)).powi(2);
                (distance > *radius).then(|| SurfaceElement { p: *center + n * *radius, error, n, area })
            }
            EmitterSurface::Cylinder { p0, axis, side, inward: false } => {
                let (middle, radius) = (*p0 + *axis * 0.5, side[0].length());
                let along = axis.normalize_or_zero();
                let across = (from - middle) - along * (from - middle).dot(along);
                let n = across.normalize_or_zero();
                let reach = p0.abs() + axis.abs() + side[0].abs() + side[1].abs();
                let error = plane_error(reach * gamma(10), n);
                let p = middle + n * radius;
                let nearer = (from - p).length_squared() / (from - middle).length_squared();
                let area = 2.0 * radius * axis.length() * nearer;
                (across.length() > radius).then_some(SurfaceElement { p, error, n, area })
            }
            EmitterSurface::Mesh { mesh, triangles, centre: Some(centre) } => {
                let n = front_of(mesh, triangles.sample(0.0)?.index);
                let error = plane_error(centre.abs() * gamma(10), n);
                Some(SurfaceElement { p: *centre, error, n, area: self.area() as f32 })
            }
            EmitterSurface::Sphere { .. } | EmitterSurface::Cylinder { .. } | EmitterSurface::Mesh { .. } => {
                None
            }
            EmitterSurface::Rectangle(_) | EmitterSurface::Disk { .. } => None,
        }
    }
}

/// Returns the centre of mass of a mesh with the given triangle areas, if all its triangles have the same normal.
pub(super) fn of_plane(mesh: &TriangleMesh, areas: &[f64]) -> Option<Vec3> {
    let (mut vector, mut moment, mut total) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for (i, &area) in areas.iter().enumerate().filter(|(_, area)| **area > 0.0) {
        let [a, b, c] = mesh.triangle(i).map(Vec3::as_dvec3);
        vector += front_of(mesh, i).as_dvec3() * area;
        moment += (a + b + c) * (area / 3.0);
        total += area;
    }
    (vector.length() >= PLANAR * total).then(|| (moment / total).as_vec3())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::emitter::Emission;
    use crate::math::Mat3;
    use crate::shape::WorldShape;
    use std::sync::Arc;

    fn light(shape: &WorldShape) -> Light {
        let emission = Emission::Constant(Rgb::splat(2.0));
        Light::Area(Box::new(AreaEmitter::new(shape, emission, None).expect("the shape has an area")))
    }

    fn expect(light: &Light, from: Vec3, wi: Vec3, irradiance: f32) {
        let sample = light.sample_centre(from, 0.0).expect("the light shines here");
        assert!((sample.wi - wi).length() < 1e-5, "{} {wi}", sample.wi);
        assert!(
            (sample.radiance.r - irradiance).abs() < 1e-5 * irradiance,
            "{} {irradiance}",
            sample.radiance.r
        );
        assert!(sample.delta && sample.pdf == 1.0);
    }

    /// A sphere with the radiance L causes the irradiance πL(r/d)² on a surface that faces it, at any distance.
    #[test]
    fn a_sphere_shines_as_its_disk() {
        let center = Vec3::new(1.0, 2.0, 3.0);
        let sphere = WorldShape::Sphere { center, radius: 0.5, inward: false, axes: Mat3::IDENTITY };
        for distance in [0.75f32, 3.0] {
            let from = center - Vec3::Z * distance;
            expect(&light(&sphere), from, Vec3::Z, 2.0 * PI * (0.5 / distance).powi(2));
        }
    }

    /// The triangles of a unit square emit from the square's centre, although their areas differ.
    #[test]
    fn a_mesh_in_a_plane_shines_from_its_centre() {
        let corners = [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.5, 0.0]];
        let positions = corners.map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
        let mesh = TriangleMesh {
            positions: Arc::new(positions.into()),
            indices: Arc::new(vec![[0, 1, 4], [1, 2, 4], [2, 3, 4]]),
            normals: Vec::new(),
            uvs: Vec::new(),
            attributes: Vec::new(),
        };
        let square = light(&WorldShape::Mesh(Arc::new(mesh)));
        expect(&square, Vec3::new(0.5, 0.5, -2.0), Vec3::Z, 2.0 / 4.0);
        assert_eq!(square.sample_centre(Vec3::new(0.5, 0.5, 2.0), 0.0), None, "its back is dark");
    }
}
