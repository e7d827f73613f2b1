//! Values that a mesh file gives to vertices or faces.

use super::TexturePoint;

/// One, two, three or more numbers for each vertex or each face of a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Attribute {
    /// Its name, with the prefix `vertex_` or `face_`.
    pub name: String,
    /// Numbers for each.
    pub channels: usize,
    /// By vertex or face, then by channel.
    pub values: Vec<f32>,
}

impl Attribute {
    /// Whether it belongs to faces (else to vertices).
    pub fn is_per_face(&self) -> bool {
        self.name.starts_with("face_")
    }

    /// Channel `c` at a point, interpolated between vertices.
    pub fn eval(&self, point: &TexturePoint<'_>, c: usize) -> f32 {
        let at = |i: u32| self.values.get(i as usize * self.channels + c).copied().unwrap_or(0.0);
        if self.is_per_face() {
            return at(point.face);
        }
        let [a, b, c] = point.vertices.map(at);
        let (u, v) = (point.barycentric.x, point.barycentric.y);
        a * (1.0 - u - v) + b * u + c * v
    }
}
