//! Textures.

use super::{Builder, unknown_plugin};
use crate::error::Result;
use crate::ids::TextureId;
use crate::loader::graph::ObjectId;
use crate::loader::props::Props;

const SUPPORTED: [&str; 0] = [];
const MITSUBA: [&str; 4] = ["bitmap", "checkerboard", "mesh_attribute", "volume"];

impl Builder<'_> {
    /// The texture of an object, instantiated once.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn texture(&mut self, object: ObjectId) -> Result<TextureId> {
        if let Some(id) = self.textures.get(&object) {
            return Ok(*id);
        }
        let props = Props::new(self.graph, object);
        Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA))
    }
}
