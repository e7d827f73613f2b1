//! Triangle meshes as plain arrays.

use crate::math::{Vec2, Vec3};
use crate::texture::Attribute;

/// A triangle mesh in object space.
///
/// `normals` and `uvs` are empty or have one entry for each position. The geometric normal of a triangle is `(p1 −
/// p0) × (p2 − p0)`, which points to its front side.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Vertex normals for smooth shading; empty for a faceted mesh.
    pub normals: Vec<Vec3>,
    /// Texture coordinates.
    pub uvs: Vec<Vec2>,
    /// Triangles as indices into the vertex arrays.
    pub indices: Vec<[u32; 3]>,
    /// Additional values of vertices and faces.
    pub attributes: Vec<Attribute>,
}

impl Mesh {
    /// Returns the bytes of the arrays.
    pub fn memory_bytes(&self) -> u64 {
        let vectors = size_of_val(&self.positions[..]) + size_of_val(&self.normals[..]);
        let others = size_of_val(&self.uvs[..]) + size_of_val(&self.indices[..]);
        let attributes: usize = self.attributes.iter().map(|a| size_of_val(&a.values[..])).sum();
        (vectors + others + attributes) as u64
    }
}
