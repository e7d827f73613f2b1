//! Meshes: each primitive of triangles becomes a mesh. [glTF 2.0, 3.7.2]

use super::Builder;
use super::accessors::Integers;
use crate::error::{Result, counted};
use crate::loader::mesh::complete_normals;
use crate::math::{DAffine3, Vec2, Vec3};
use crate::shape::Mesh;
use crate::texture::Attribute;
use gltf::Primitive;
use gltf::mesh::{Mode, Semantic};

/// The mesh attribute of vertex colours.
pub const COLOR: &str = "vertex_color";
/// The mesh attribute of the alpha of vertex colours.
pub const ALPHA: &str = "vertex_alpha";

impl Builder<'_> {
    /// Returns the triangles of a primitive with the texture coordinates of a set; `None` if there are no triangles.
    ///
    /// # Errors
    /// If an accessor has another form, is out of range or has another length, or an index has no vertex.
    pub fn mesh(&mut self, primitive: &Primitive<'_>, thing: &str, uv_set: u32) -> Result<Option<Mesh>> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            self.warn(thing, "points and lines are left out");
            return Ok(None);
        }
        let Some(positions) = primitive.get(&Semantic::Positions) else {
            self.warn(thing, "it has no positions and is left out");
            return Ok(None);
        };
        if !self.file.missing.is_empty() {
            return Ok(None);
        }
        let positions: Vec<Vec3> = self.read(&positions, Integers::AsTold)?;
        let n = positions.len();
        let corners = match primitive.indices() {
            Some(accessor) => self.file.indices(&accessor)?,
            None => (0..u32::try_from(n).unwrap_or(u32::MAX)).collect(),
        };
        if let Some(index) = corners.iter().find(|index| **index as usize >= n) {
            let vertices = counted(n as u64, "vertex", "vertices");
            return Err(self.file.error(thing, format!("a triangle refers to vertex {index} of {vertices}")));
        }
        let indices = triangles(primitive.mode(), &corners);
        if indices.is_empty() {
            self.warn(thing, "it has no triangles and is left out");
            return Ok(None);
        }
        let mut mesh = Mesh { positions, indices, ..Mesh::default() };
        if let Some(accessor) = primitive.get(&Semantic::Normals) {
            mesh.normals = self.read(&accessor, Integers::AsTold)?;
        }
        if let Some(accessor) = primitive.get(&Semantic::TexCoords(uv_set)) {
            let uvs = self.file.numbers::<2>(&accessor, Integers::AsTold)?;
            mesh.uvs = uvs.into_iter().map(Vec2::from).collect();
        }
        if let Some(accessor) = primitive.get(&Semantic::Colors(0)) {
            mesh.attributes = self.colors(&accessor)?;
        }
        self.check_lengths(&mesh, thing)?;
        let mut mesh = without_unused(mesh);
        self.file.keep(mesh.memory_bytes(), thing, "its mesh")?;
        self.check_values(&mut mesh, thing);
        Ok(Some(mesh))
    }

    fn read(&self, accessor: &gltf::Accessor<'_>, integers: Integers) -> Result<Vec<Vec3>> {
        Ok(self.file.numbers::<3>(accessor, integers)?.into_iter().map(Vec3::from).collect())
    }

    /// Returns the vertex colours, and their alpha if they have one.
    fn colors(&self, accessor: &gltf::Accessor<'_>) -> Result<Vec<Attribute>> {
        let attribute = |name: &str, channels, values| Attribute { name: name.to_owned(), channels, values };
        if accessor.dimensions().multiplicity() != 4 {
            let colors = self.file.numbers::<3>(accessor, Integers::Fractions)?;
            return Ok(vec![attribute(COLOR, 3, colors.into_flattened())]);
        }
        let colors = self.file.numbers::<4>(accessor, Integers::Fractions)?;
        let rgb = colors.iter().flat_map(|c| [c[0], c[1], c[2]]).collect();
        let alpha = colors.iter().map(|c| c[3]).collect();
        Ok(vec![attribute(COLOR, 3, rgb), attribute(ALPHA, 1, alpha)])
    }

    /// Returns an error if an attribute does not have one value for each vertex.
    fn check_lengths(&self, mesh: &Mesh, thing: &str) -> Result<()> {
        let n = mesh.positions.len();
        let attributes = mesh.attributes.iter().map(|a| ("COLOR_0", a.values.len() / a.channels));
        let lengths = [("NORMAL", mesh.normals.len()), ("TEXCOORD", mesh.uvs.len())];
        let given = lengths.into_iter().filter(|(_, found)| *found > 0).chain(attributes);
        for (name, found) in given {
            if found != n {
                let vertices = counted(n as u64, "vertex", "vertices");
                let message = format!("expected {name} for each of {vertices}, found {found}");
                return Err(self.file.error(thing, message));
            }
        }
        Ok(())
    }

    /// Repairs normals, and adds a warning if vertices are not finite.
    fn check_values(&mut self, mesh: &mut Mesh, thing: &str) {
        let broken = mesh.positions.iter().filter(|p| !p.is_finite()).count();
        if broken > 0 {
            let vertices = counted(mesh.positions.len() as u64, "vertex", "vertices");
            self.warn(thing, &format!("{broken} of {vertices}: not finite; their faces are dropped"));
        }
        if !mesh.normals.is_empty() {
            let place = self.file.place();
            let before = self.loaded.warnings.len();
            complete_normals(mesh, &DAffine3::IDENTITY, &place.file, &mut self.loaded.warnings);
            for warning in &mut self.loaded.warnings[before..] {
                warning.thing = thing.to_owned();
            }
        }
    }
}

/// Returns the triangles of a list, strip or fan of vertices. [glTF 2.0, 3.7.2.1]
fn triangles(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    let windows = corners.windows(3);
    match mode {
        Mode::TriangleStrip => {
            let turned =
                |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
            // Triangles without area connect the parts of a strip.
            windows.enumerate().map(turned).filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]).collect()
        }
        Mode::TriangleFan => windows.map(|w| [w[1], w[2], corners[0]]).collect(),
        _ => corners.as_chunks::<3>().0.to_vec(),
    }
}

/// Removes the vertices that no triangle uses: primitives may share accessors and use a part of each.
fn without_unused(mesh: Mesh) -> Mesh {
    let mut place = vec![u32::MAX; mesh.positions.len()];
    mesh.indices.iter().flatten().for_each(|i| place[*i as usize] = 0);
    let mut used = Vec::new();
    for (i, place) in place.iter_mut().enumerate().filter(|(_, place)| **place == 0) {
        *place = used.len() as u32;
        used.push(i);
    }
    if used.len() == mesh.positions.len() {
        return mesh;
    }
    let pick = |values: &[Vec3]| match values.is_empty() {
        true => Vec::new(),
        false => used.iter().map(|i| values[*i]).collect(),
    };
    let attribute = |a: Attribute| Attribute {
        values: used.iter().flat_map(|i| &a.values[i * a.channels..][..a.channels]).copied().collect(),
        ..a
    };
    Mesh {
        positions: pick(&mesh.positions),
        normals: pick(&mesh.normals),
        uvs: if mesh.uvs.is_empty() { Vec::new() } else { used.iter().map(|i| mesh.uvs[*i]).collect() },
        indices: mesh.indices.iter().map(|t| t.map(|i| place[i as usize])).collect(),
        attributes: mesh.attributes.into_iter().map(attribute).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_front() {
        let corners = [0, 1, 2, 3, 4];
        assert_eq!(triangles(Mode::Triangles, &corners), [[0, 1, 2]]);
        assert_eq!(triangles(Mode::TriangleStrip, &corners), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(triangles(Mode::TriangleFan, &corners), [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
        assert_eq!(triangles(Mode::TriangleStrip, &[0, 1, 1, 2]), [[0u32; 3]; 0]);
        assert_eq!(triangles(Mode::TriangleFan, &[7]), [[0u32; 3]; 0]);
    }

    #[test]
    fn vertices_of_no_triangle_are_left_out() {
        let positions: Vec<Vec3> = (0..5).map(|i| Vec3::splat(i as f32)).collect();
        let values = (0..10).map(|i| i as f32).collect();
        let attributes = vec![Attribute { name: COLOR.into(), channels: 2, values }];
        let mesh = Mesh { positions, indices: vec![[4, 1, 3]], attributes, ..Mesh::default() };
        let mesh = without_unused(mesh);
        assert_eq!(mesh.positions, [1.0, 3.0, 4.0].map(Vec3::splat));
        assert_eq!(mesh.indices, [[2, 0, 1]]);
        assert_eq!(mesh.attributes[0].values, [2.0, 3.0, 6.0, 7.0, 8.0, 9.0]);
        assert!(mesh.normals.is_empty() && mesh.uvs.is_empty());
    }
}
