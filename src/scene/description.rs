//! A scene as plain data, the way a scene file or a program builds it; [`compile`](super::compile()) checks it.

use crate::color::Rgb;
use crate::emitter::Emitter;
use crate::error::Place;
use crate::ids::MaterialId;
use crate::material::{Input, Material};
use crate::math::Motion;
use crate::sensor::SensorSettings;
use crate::shape::Shape;
use crate::texture::Texture;
use std::sync::Arc;

/// A shape placed in the world.
#[derive(Clone, Debug, serde::Serialize)]
pub struct PlacedShape {
    /// The scene file's name for it; may be empty.
    pub name: String,
    /// Where the scene file says it, for messages; no part of what the scene is.
    #[serde(skip)]
    pub place: Option<Place>,
    /// The shape in its own coordinates.
    pub shape: Shape,
    /// Its own coordinates to the world.
    pub to_world: Motion,
    /// Whether front and back are exchanged.
    pub flip_normals: bool,
    /// What it is made of.
    pub material: MaterialId,
    /// Radiance emitted by its front, W·m⁻²·sr⁻¹; `None` where it does not emit.
    pub emission: Option<Input<Rgb>>,
}

/// A group of shapes placed in the world.
#[derive(Clone, Debug, serde::Serialize)]
pub struct PlacedGroup {
    /// The scene file's name for it; may be empty.
    pub name: String,
    /// Where the scene file says it, for messages; no part of what the scene is.
    #[serde(skip)]
    pub place: Option<Place>,
    /// The group, as an index into [`Description::groups`].
    pub group: usize,
    /// The group's coordinates to the world.
    pub to_world: Motion,
}

/// A whole scene, before it is compiled.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Description {
    /// The shapes in file order.
    pub shapes: Vec<PlacedShape>,
    /// Groups of shapes that stand in the world only where an instance places them; none emits.
    pub groups: Vec<Vec<PlacedShape>>,
    /// The instances of groups.
    pub instances: Vec<PlacedGroup>,
    /// The materials; shapes refer to them by index.
    pub materials: Vec<Material>,
    /// The textures; materials and emitters refer to them by index.
    pub textures: Vec<Arc<Texture>>,
    /// The emitters that are no shapes.
    pub emitters: Vec<Emitter>,
    /// The sensors in file order; a scene to render has at least one.
    pub sensors: Vec<SensorSettings>,
}
