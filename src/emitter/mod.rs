//! Emitters: where light comes from.

use crate::color::Rgb;
use crate::math::Vec3;

/// An emitter that is not a shape, as a scene names it. (An area emitter belongs to its shape.)
#[derive(Clone, Debug, PartialEq)]
pub enum Emitter {
    /// An isotropic point.
    Point {
        /// Position in the world.
        position: Vec3,
        /// Radiant intensity, W·sr⁻¹.
        intensity: Rgb,
    },
    /// The same radiance from every direction.
    Constant {
        /// Radiance, W·m⁻²·sr⁻¹.
        radiance: Rgb,
    },
}
