//! The surfaces whose irradiance sensors measure.

use super::SceneShape;
use crate::color::Rgb;
use crate::emitter::{AreaEmitter, Emission};
use crate::error::{Error, Result};
use crate::math::{Ray, Vec2, Vec3};
use crate::sampling::Distribution1D;
use crate::sensor::SensorSurface;
use std::fmt;
use std::sync::Arc;

/// The front side of a shape. Camera rays are distributed like the light of an emitter of this shape.
struct Meter {
    emitter: AreaEmitter,
    inverse_area: f32,
}

impl fmt::Debug for Meter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Meter").field("inverse_area", &self.inverse_area).finish_non_exhaustive()
    }
}

impl SensorSurface for Meter {
    fn ray(&self, u_point: Vec2, u_direction: Vec2) -> (Ray, f32) {
        match self.emitter.sample_ray(u_point, u_direction, 0.0) {
            Some(light) => (light.ray, light.power.r * self.inverse_area),
            // A triangle without area.
            None => (Ray { o: Vec3::ZERO, t_max: 0.0, d: Vec3::Z, time: 0.0 }, 0.0),
        }
    }
}

/// Returns the surface of a shape at rest as that of a sensor.
///
/// # Errors
/// If the shape has no area, or its points cannot be sampled.
pub fn surface_of(shape: &SceneShape) -> Result<Arc<dyn SensorSurface>> {
    let (triangles, most) = (shape.world.triangle_count(), Distribution1D::MAX_ENTRIES);
    if triangles > most {
        let message =
            format!("expected at most {most} triangles of the shape of a sensor, found {triangles}");
        return Err(Error::scene(message));
    }
    let emitter = AreaEmitter::new(&shape.world, Emission::Constant(Rgb::WHITE), None);
    let Some(emitter) = emitter.filter(|emitter| emitter.area() > 0.0) else {
        return Err(Error::scene(
            "an irradiancemeter needs a rectangle, disk, sphere, cylinder or mesh that has an area",
        ));
    };
    let inverse_area = (1.0 / emitter.area()) as f32;
    Ok(Arc::new(Meter { emitter, inverse_area }))
}
