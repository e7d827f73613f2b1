//! Mesh attributes: values for each vertex or face of a mesh.

use super::TexturePoint;
use crate::color::Rgb;

/// An attribute with one or more channels for each vertex or each face of a mesh.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Attribute {
    /// The name, with the prefix `vertex_` or `face_`.
    pub name: String,
    /// The number of channels.
    pub channels: usize,
    /// The values, grouped by vertex or face.
    pub values: Vec<f32>,
}

impl Attribute {
    /// Returns whether the values belong to faces, not to vertices.
    pub fn is_per_face(&self) -> bool {
        self.name.starts_with("face_")
    }

    /// Returns channel `c` at a point, interpolated between vertices.
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

/// A texture that reads an attribute of the mesh to which it is applied.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MeshAttribute {
    /// The attribute's name.
    pub name: String,
    /// The factor on the values.
    pub scale: f32,
}

impl MeshAttribute {
    /// Finds the attribute among those of a mesh.
    pub fn find<'a>(&self, attributes: &'a [Attribute]) -> Option<&'a Attribute> {
        attributes.iter().find(|a| a.name == self.name)
    }

    /// Returns the colour at a point, from three channels, or from one for all channels. Black if there is no such
    /// attribute.
    pub fn eval(&self, point: &TexturePoint<'_>) -> Rgb {
        let Some(attribute) = self.find(point.attributes) else { return Rgb::BLACK };
        let color = match attribute.channels {
            3 => Rgb::from([0, 1, 2].map(|c| attribute.eval(point, c))),
            _ => Rgb::splat(attribute.eval(point, 0)),
        };
        color * self.scale
    }

    /// Returns the scalar at a point; for three channels, the luminance. Zero if there is no such attribute.
    pub fn eval_scalar(&self, point: &TexturePoint<'_>) -> f32 {
        match self.find(point.attributes) {
            Some(a) if a.channels == 3 => self.eval(point).luminance(),
            Some(a) => a.eval(point, 0) * self.scale,
            None => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec2;

    /// Two triangles of a square, as evaluated by Mitsuba 3.9.1 at (0.2, 0.3) and (0.8, 0.7).
    #[test]
    fn values_agree_with_the_scene_languages_mesh_attributes() {
        let attribute = |name: &str, channels: usize, values: &[f32]| Attribute {
            name: name.into(),
            channels,
            values: values.to_vec(),
        };
        let attributes = [
            attribute("vertex_w", 1, &[1.0, 2.0, 3.0, 4.0]),
            attribute("vertex_color", 3, &[1., 0., 0., 0., 1., 0., 0., 0., 1., 0.5, 0.5, 0.5]),
            attribute("face_color", 3, &[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]),
        ];
        let points = [(0, [0, 1, 2], [0.2, 0.3]), (1, [1, 3, 2], [0.5, 0.2])].map(|(face, vertices, b)| {
            let uv = Vec2::ZERO;
            TexturePoint { uv, attributes: &attributes, face, vertices, barycentric: Vec2::from(b) }
        });
        for (name, expected) in [
            ("vertex_w", [[3.6; 3], [6.4; 3]]),
            ("vertex_color", [[1.0, 0.4, 0.6], [0.5, 1.1, 0.9]]),
            ("face_color", [[0.2, 0.4, 0.6], [0.8, 1.0, 1.2]]),
            ("vertex_none", [[0.0; 3]; 2]),
        ] {
            let texture = MeshAttribute { name: name.into(), scale: 2.0 };
            for (point, expected) in points.iter().zip(expected) {
                let found = texture.eval(point).to_array();
                assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{name}: {found:?}");
                let number = Rgb::from(expected).luminance();
                assert!((texture.eval_scalar(point) - number).abs() < 2e-6, "{name}");
            }
        }
    }
}
