//! Bounds on the light of each kind of emitter.

use super::{Cone, LightBounds};
use crate::accel::Instance;
use crate::color::Rgb;
use crate::emitter::area::{EmitterSurface, front_of};
use crate::emitter::{AreaEmitter, BoundingSphere, Light, LitRegion};
use crate::math::{Bounds, Vec3};
use std::f32::consts::{FRAC_PI_2, PI};

/// The origin of an emitter's light.
pub enum Extent {
    /// From a bounded part of space.
    Finite(LightBounds),
    /// From infinity, with this irradiance of a surface that faces it, W·m⁻².
    Infinite(f32),
}

impl Light {
    /// Returns the origin of the light that is sampled beside BSDF samples; `None` if there is none.
    pub fn compensated_extent(&self) -> Option<Extent> {
        match self {
            Light::Environment(environment) => {
                let excess = environment.mean_excess();
                (excess > 0.0).then(|| Extent::Infinite(PI * brightness(Rgb::splat(excess))))
            }
            _ => Some(self.extent()),
        }
    }

    /// Returns the points that the emitter may light; `None` if it is at infinity.
    pub fn lit_region(&self) -> Option<LitRegion> {
        let Extent::Finite(LightBounds { bounds, normals, emission_angle, .. }) = self.extent() else {
            return None;
        };
        let sphere = BoundingSphere { center: bounds.center(), radius: bounds.radius() };
        let angle = normals.angle + emission_angle;
        let (is_point, is_plane) = (sphere.radius == 0.0, normals.angle == 0.0);
        // A plane lights what is in front of it. Other emitters that have a size also light points outside of the cone.
        let cosine = if is_plane && angle == FRAC_PI_2 {
            Some(0.0)
        } else {
            (is_point && angle <= FRAC_PI_2).then(|| f64::from(angle).cos().max(0.0))
        };
        Some(LitRegion { sphere, cone: cosine.map(|cosine| (normals.axis.as_dvec3().normalize(), cosine)) })
    }

    /// Returns the origin of the light.
    pub fn extent(&self) -> Extent {
        let point = |position: Vec3, normals: Cone, emission_angle: f32, intensity: Rgb| {
            let bounds = Bounds::of([position]);
            Extent::Finite(LightBounds::new(bounds, normals, emission_angle, brightness(intensity)))
        };
        match self {
            Light::Area(area) => Extent::Finite(area.light_bounds()),
            Light::Point(light) => point(light.position, Cone::ALL, 0.0, light.intensity),
            Light::Spot(spot) => {
                let (cone, falloff, intensity) = spot.cone();
                point(spot.position(), cone, falloff, intensity)
            }
            Light::Projector(projector) => {
                let (cone, intensity) = projector.cone();
                point(projector.position(), cone, 0.0, intensity)
            }
            Light::Directional(light) => Extent::Infinite(brightness(light.irradiance)),
            Light::Sun(sun) => Extent::Infinite(brightness(sun.irradiance())),
            Light::Environment(environment) => Extent::Infinite(PI * brightness(environment.mean_radiance())),
        }
    }
}

/// Returns the mean of a colour's channels.
fn brightness(color: Rgb) -> f32 {
    let [r, g, b] = color.to_array();
    ((r + g + b) / 3.0).clamp(f32::MIN_POSITIVE, f32::MAX)
}

impl AreaEmitter {
    /// Returns bounds on the light.
    fn light_bounds(&self) -> LightBounds {
        let (bounds, normals) = match &self.surface {
            EmitterSurface::Rectangle(surface) => {
                let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
                let bounds = Bounds::of(corners.map(|uv| surface.rectangle.point(uv.into())));
                (bounds, Cone { axis: surface.normal, angle: 0.0 })
            }
            EmitterSurface::Sphere { center, radius, .. } => {
                let half = Vec3::splat(*radius);
                (Bounds::of([*center - half, *center + half]), Cone::ALL)
            }
            EmitterSurface::Disk { center, du, dv, normal } => {
                let half = (*du * *du + *dv * *dv).map(f32::sqrt);
                (Bounds::of([*center - half, *center + half]), Cone { axis: *normal, angle: 0.0 })
            }
            EmitterSurface::Cylinder { p0, axis, side: [u, v], .. } => {
                let half = (*u * *u + *v * *v).map(f32::sqrt);
                let ends = [*p0, *p0 + *axis];
                (Bounds::of(ends.map(|p| p - half).into_iter().chain(ends.map(|p| p + half))), Cone::ALL)
            }
            EmitterSurface::Mesh { mesh, triangles, .. } => {
                let used = || (0..mesh.indices.len()).filter(|i| triangles.pmf(*i) > 0.0);
                let bounds = Bounds::of(used().flat_map(|i| mesh.triangle(i)));
                (bounds, cone_around(|| used().map(|i| front_of(mesh, i))))
            }
        };
        let intensity = (brightness(self.emission.mean()) * self.area() as f32).min(f32::MAX);
        let bounded = LightBounds::new(bounds, normals, FRAC_PI_2, intensity);
        match &self.motion {
            Some(motion) => moved(bounded, motion),
            None => bounded,
        }
    }
}

/// Returns a cone that contains all given directions.
fn cone_around<I: Iterator<Item = Vec3>>(directions: impl Fn() -> I) -> Cone {
    let Some(axis) = directions().sum::<Vec3>().try_normalize() else { return Cone::ALL };
    let least = directions().map(|n| n.dot(axis)).fold(1.0, f32::min);
    // Rounding must not exclude a direction.
    match least > 0.0 {
        true => Cone { axis, angle: (least - 1e-6).clamp(-1.0, 1.0).acos() },
        false => Cone::ALL,
    }
}

/// Returns bounds over a motion. Between its steps, points move along straight lines.
fn moved(light: LightBounds, motion: &Instance) -> LightBounds {
    let steps = motion.steps().len();
    let Bounds { min, max } = light.bounds;
    let corners: Vec<Vec3> = (0..8)
        .map(|i| Vec3::new([min.x, max.x][i & 1], [min.y, max.y][i >> 1 & 1], [min.z, max.z][i >> 2]))
        .collect();
    let (mut bounds, mut growth) = (Bounds::of([]), 0.0f64);
    for i in 0..steps {
        let to_world = motion.to_world(i as f32 / (steps - 1).max(1) as f32);
        bounds = bounds
            .union(Bounds::of(corners.iter().map(|p| to_world.transform_point3(p.as_dvec3()).as_vec3())));
        growth = growth.max(to_world.matrix3.determinant().abs().powf(2.0 / 3.0));
    }
    LightBounds::new(bounds, Cone::ALL, light.emission_angle, light.intensity * growth as f32)
}
