//! Emitters: `point`, `constant`, and `area` inside shapes.

use super::{Builder, unknown_plugin};
use crate::color::Rgb;
use crate::color::spectrum::Quantity;
use crate::emitter::Emitter;
use crate::error::Result;
use crate::loader::graph::ObjectId;
use crate::loader::props::Props;
use crate::material::Input;
use crate::math::DVec3;

const SUPPORTED: [&str; 3] = ["area", "point", "constant"];
const MITSUBA: [&str; 7] =
    ["directional", "directionalarea", "envmap", "projector", "spot", "sunsky", "timed_sunsky"];

impl Builder<'_> {
    /// An emitter of the scene.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate); a second environment.
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
                let is_environment = |e: &Emitter| matches!(e, Emitter::Constant { .. });
                if self.loaded.description.emitters.iter().any(is_environment) {
                    return Err(props.object.error("a scene has room for one environment"));
                }
                let radiance = self.colour(&props, "radiance", Quantity::Emission, 1.0)?;
                self.add_emitter(Emitter::Constant { radiance });
            }
            "area" => return Err(props.object.error("an area emitter belongs inside a shape")),
            _ => return Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA)),
        }
        self.finish(props);
        Ok(())
    }

    /// The radiance of an emitter inside a shape.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn area_emitter(&mut self, object: ObjectId) -> Result<Input<Rgb>> {
        let props = Props::new(self.graph, object);
        match props.object.plugin.as_str() {
            "area" => {}
            "point" | "constant" => {
                return Err(props.object.error("only an area emitter can be inside a shape"));
            }
            _ => return Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA)),
        }
        let radiance = self.color_input(&props, "radiance", Quantity::Emission, 1.0)?;
        self.finish(props);
        Ok(radiance)
    }
}

/// `position`, or where `to_world` takes the origin.
fn position(props: &Props) -> Result<DVec3> {
    match (props.point("position")?, props.find("to_world")) {
        (Some(_), Some(property)) => Err(property.error("expected either position or to_world, found both")),
        (Some(position), None) => Ok(position),
        (None, _) => Ok(props.to_world()?.translation),
    }
}
