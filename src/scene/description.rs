//! A scene as plain data, created by a scene file or a program. [`compile`](super::compile()) validates it.

use crate::color::Rgb;
use crate::emitter::Emitter;
use crate::error::Place;
use crate::ids::{MaterialId, TextureId};
use crate::material::{Input, Material};
use crate::math::Motion;
use crate::medium::{Medium, MediumBoundary};
use crate::sensor::SensorSettings;
use crate::shape::Shape;
use crate::texture::Texture;
use std::sync::Arc;

/// A shape with its transform to world space.
#[derive(Clone, Debug, serde::Serialize)]
pub struct PlacedShape {
    /// The shape's name in the scene file; may be empty.
    pub name: String,
    /// The shape's location in the scene file, for messages.
    #[serde(skip)]
    pub place: Option<Place>,
    /// The shape in its object space.
    pub shape: Shape,
    /// The transform from object space to world space.
    pub to_world: Motion,
    /// Whether front and back sides are exchanged.
    pub flip_normals: bool,
    /// The material.
    pub material: MaterialId,
    /// Radiance emitted by the front side, W·m⁻²·sr⁻¹; `None` if it does not emit.
    pub emission: Option<Input<Rgb>>,
    /// The media on its two sides. It counts in the hash of a scene only if there are any.
    #[serde(skip_serializing_if = "MediumBoundary::is_none")]
    pub boundary: MediumBoundary,
}

/// An instance of a group of shapes.
#[derive(Clone, Debug, serde::Serialize)]
pub struct PlacedGroup {
    /// The instance's name in the scene file; may be empty.
    pub name: String,
    /// The instance's location in the scene file, for messages.
    #[serde(skip)]
    pub place: Option<Place>,
    /// The group, as an index into [`Description::groups`].
    pub group: usize,
    /// The transform from group space to world space.
    pub to_world: Motion,
}

/// A complete scene before compilation.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Description {
    /// The shapes in file order.
    pub shapes: Vec<PlacedShape>,
    /// Groups of shapes that only instances place in world space. Shapes in groups do not emit.
    pub groups: Vec<Vec<PlacedShape>>,
    /// The instances of groups.
    pub instances: Vec<PlacedGroup>,
    /// The materials; shapes refer to them by index.
    pub materials: Vec<Material>,
    /// The names of materials that have one.
    #[serde(skip)]
    pub material_names: Vec<(MaterialId, String)>,
    /// The textures; materials and emitters refer to them by index.
    pub textures: Vec<Arc<Texture>>,
    /// The participating media; shapes and sensors refer to them by index.
    pub media: Vec<Medium>,
    /// The emitters that are not shapes.
    pub emitters: Vec<Emitter>,
    /// The sensors in file order. Rendering needs at least one.
    pub sensors: Vec<SensorSettings>,
}

impl Description {
    /// Adds a material and returns its id.
    pub fn add_material(&mut self, material: impl Into<Material>) -> MaterialId {
        self.materials.push(material.into());
        MaterialId::from(self.materials.len() - 1)
    }

    /// Names a material, unless the name is empty.
    pub fn name_material(&mut self, id: MaterialId, name: &str) {
        if !name.is_empty() {
            self.material_names.push((id, name.to_owned()));
        }
    }

    /// Adds a texture unless it exists already, and returns its id.
    pub fn add_texture(&mut self, texture: Arc<Texture>) -> TextureId {
        let known = self.textures.iter().position(|known| Arc::ptr_eq(known, &texture));
        TextureId::from(known.unwrap_or_else(|| {
            self.textures.push(texture);
            self.textures.len() - 1
        }))
    }
}
