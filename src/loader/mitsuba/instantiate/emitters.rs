//! Emitters.

use super::{Builder, unknown_plugin};
use crate::color::Rgb;
use crate::color::spectrum::Quantity;
use crate::emitter::{Emitter, EnvMap};
use crate::error::Result;
use crate::image::TextureImage;
use crate::loader::mitsuba::graph::ObjectId;
use crate::loader::mitsuba::props::Props;
use crate::material::Input;
use crate::math::DVec3;
use crate::memory::Refusal;
use crate::sensor::camera::half_extents;
use crate::texture::Texture;
use std::sync::Arc;

pub const SUPPORTED: [&str; 10] =
    ["area", "constant", "directional", "envmap", "point", "projector", "sky", "spot", "sun", "sunsky"];
const MITSUBA: [&str; 4] = ["collimated", "directionalarea", "timed_sunsky", "volumelight"];

impl Builder<'_> {
    /// Adds an emitter of the scene.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate), and if there is a second environment.
    pub fn emitter(&mut self, object: ObjectId) -> Result<()> {
        let props = Props::new(self.graph, object);
        match props.object.plugin.as_str() {
            "point" => {
                let position = position(&props)?.as_vec3();
                if !position.is_finite() {
                    return Err(props.object.error("the position is not finite"));
                }
                let intensity = self.colour(&props, "intensity", Quantity::Emission, 1.0)?;
                self.add_emitter(Emitter::Point { position, intensity });
            }
            "constant" => {
                self.check_only_environment(&props)?;
                let radiance = self.colour(&props, "radiance", Quantity::Emission, 1.0)?;
                self.add_emitter(Emitter::Constant { radiance });
            }
            "envmap" => {
                self.check_only_environment(&props)?;
                self.environment_map(&props)?;
            }
            "spot" => self.spot(&props)?,
            "sun" | "sky" | "sunsky" => self.daylight(&props)?,
            "directional" => {
                let direction = match (props.point("direction")?, props.find("to_world")) {
                    (Some(_), Some(property)) => {
                        return Err(property.error("expected either direction or to_world, found both"));
                    }
                    (Some(direction), None) => direction,
                    (None, _) => props.to_world()?.matrix3.z_axis,
                };
                let Some(direction) = direction.try_normalize() else {
                    return Err(props.refusal("direction", "expected a direction"));
                };
                let direction = direction.as_vec3();
                let irradiance = self.colour(&props, "irradiance", Quantity::Emission, 1.0)?;
                self.add_emitter(Emitter::Directional { direction, irradiance });
            }
            "projector" => self.projector(&props)?,
            // It is that of the shapes that refer to it.
            "area" if !props.object.id.is_empty() => return Ok(()),
            "area" => return Err(props.object.error("an area emitter belongs inside a shape")),
            _ => return Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA)),
        }
        // The medium around a point emitter is known where paths reach it.
        props.children("medium");
        self.finish(props);
        Ok(())
    }

    /// Returns an error if the scene has an environment already.
    pub(super) fn check_only_environment(&self, props: &Props) -> Result<()> {
        match self.loaded.description.emitters.iter().any(Emitter::is_environment) {
            true => Err(props.object.error("a scene has room for one environment")),
            false => Ok(()),
        }
    }

    fn environment_map(&mut self, props: &Props) -> Result<()> {
        let scale = props.float("scale")?.unwrap_or(1.0) as f32;
        let to_world = props.to_world()?;
        self.ignore(props, &["mis_compensation"], "the integrator decides");
        let Some(path) = self.find_file(props, "filename")? else { return Ok(()) };
        let image = self.image(&path, false)?;
        let too_large = |refusal: Refusal| {
            let what = format!("sampling an environment map of {}x{} pixels", image.width(), image.height());
            props.object.error(refusal.sentence(&what, "use a smaller image"))
        };
        let texels = image.width() as u64 * image.height() as u64;
        let copied = image.memory_bytes() as u64;
        let reserved = self.memory.reserve(copied + texels * EnvMap::BYTES_PER_TEXEL).map_err(too_large)?;
        let map = EnvMap::new(TextureImage::clone(&image), scale, &to_world);
        let map = map.map_err(|e| props.object.error(e.message))?;
        reserved.keep(map.memory_bytes() as u64);
        self.add_emitter(Emitter::EnvironmentMap(Arc::new(map)));
        Ok(())
    }

    fn spot(&mut self, props: &Props) -> Result<()> {
        let intensity = self.colour(props, "intensity", Quantity::Emission, 1.0)?;
        let cutoff = f64::from(props.positive("cutoff_angle", 20.0)?);
        let beam = props.float("beam_width")?.unwrap_or(0.75 * cutoff);
        if cutoff > 180.0 {
            return Err(props.refusal("cutoff_angle", "expected degrees from 0 to 180"));
        }
        if !(beam >= 0.0 && beam <= cutoff) {
            return Err(props
                .refusal("beam_width", &format!("expected degrees from 0 to the cutoff_angle, {cutoff}")));
        }
        let texture = match props.named_child("texture") {
            Some(object) if cutoff < 90.0 => Some(self.texture(object)?),
            Some(_) => {
                return Err(props.error("cutoff_angle", "expected less than 90 degrees for a texture"));
            }
            None => None,
        };
        self.add_emitter(Emitter::Spot {
            to_world: props.to_world()?,
            intensity,
            texture,
            cutoff_angle: cutoff.to_radians() as f32,
            beam_width: beam.to_radians() as f32,
        });
        Ok(())
    }

    fn projector(&mut self, props: &Props) -> Result<()> {
        let irradiance = match self.color_input(props, "irradiance", Quantity::Emission, 1.0)? {
            Input::Texture(id) => id,
            Input::Constant(value) => self.loaded.description.add_texture(Arc::new(Texture::Constant(value))),
        };
        let scale = props.float("scale")?.unwrap_or(1.0) as f32;
        if !(scale >= 0.0 && scale.is_finite()) {
            return Err(props.refusal("scale", "expected a number of at least 0"));
        }
        let [width, height] = self.loaded.description.textures[irradiance.index()].resolution();
        let (fov, fov_axis) = super::sensors::field_of_view(props)?;
        let half_extents = half_extents(fov, fov_axis, width, height).map(|v| v as f32);
        let to_world = props.to_world()?;
        self.add_emitter(Emitter::Projector { to_world, irradiance, scale, half_extents });
        Ok(())
    }

    /// Returns the radiance of an emitter inside a shape.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn area_emitter(&mut self, object: ObjectId) -> Result<Input<Rgb>> {
        let props = Props::new(self.graph, object);
        match props.object.plugin.as_str() {
            "area" => {}
            plugin if SUPPORTED.contains(&plugin) => {
                return Err(props.object.error("only an area emitter can be inside a shape"));
            }
            _ => return Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA)),
        }
        let radiance = self.color_input(&props, "radiance", Quantity::Emission, 1.0)?;
        props.children("medium");
        self.finish(props);
        Ok(radiance)
    }
}

/// Returns `position`, or the point to which `to_world` maps the origin.
fn position(props: &Props) -> Result<DVec3> {
    match (props.point("position")?, props.find("to_world")) {
        (Some(_), Some(property)) => Err(property.error("expected either position or to_world, found both")),
        (Some(position), None) => Ok(position),
        (None, _) => Ok(props.to_world()?.translation),
    }
}
