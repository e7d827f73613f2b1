//! Point, spot and directional emitters. [KHR_lights_punctual]

use super::{Builder, viewer};
use crate::color::Rgb;
use crate::emitter::Emitter;
use crate::math::DAffine3;
use gltf::khr_lights_punctual::{Kind, Light};
use std::f32::consts::FRAC_PI_2;

impl Builder<'_> {
    /// Adds the emitter of a node.
    pub fn light(&mut self, light: &Light<'_>, to_world: &DAffine3) {
        let thing = format!("lights[{}]", light.index());
        let strength = Rgb::from(light.color()) * light.intensity();
        let (position, frame) = (to_world.translation.as_vec3(), viewer(to_world));
        if !(strength.is_valid() && position.is_finite()) {
            self.warn(&thing, "expected a light that is finite and not negative: it is left out");
            return;
        }
        let Some(frame) = frame else {
            self.warn(&thing, "its node has no direction: it is left out");
            return;
        };
        if light.range().is_some() {
            self.approximate(
                "the range of lights is ignored: light falls off with the square of the distance",
            );
        }
        let emitter = match light.kind() {
            Kind::Directional => {
                self.note("directional light, in lux, is taken as irradiance in W/m², number for number");
                Emitter::Directional { direction: frame.matrix3.z_axis.as_vec3(), irradiance: strength }
            }
            Kind::Point => {
                self.note("point light, in candela, is taken as intensity in W/sr, number for number");
                Emitter::Point { position, intensity: strength }
            }
            Kind::Spot { inner_cone_angle, outer_cone_angle } => {
                if !(outer_cone_angle > 0.0 && outer_cone_angle <= FRAC_PI_2) {
                    self.warn(&thing, "expected an outerConeAngle from 0 to π/2: it is left out");
                    return;
                }
                self.note(
                    "spot light, in candela, is taken as intensity in W/sr, number for number; between the cones it \
                     falls off linearly in the angle",
                );
                let beam_width = inner_cone_angle.clamp(0.0, outer_cone_angle);
                let (to_world, texture) = (frame, None);
                Emitter::Spot {
                    to_world,
                    intensity: strength,
                    texture,
                    cutoff_angle: outer_cone_angle,
                    beam_width,
                }
            }
        };
        self.loaded.description.emitters.push(emitter);
    }
}
