//! Stanford PLY (text and both binary orders), through the crate `ply-rs-bw`.

use crate::error::{Error, Place, Result};
use crate::math::{Vec2, Vec3};
use crate::shape::Mesh;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Header, Property, PropertyAccess, PropertyAccessResult};
use std::path::Path;

/// Reads a mesh. Vertices may have normals `nx ny nz` and texture coordinates `u v` or `s t`.
///
/// # Errors
/// See [`load`](super::load).
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Mesh> {
    let mut reader = Reader::new(bytes);
    let fail = |e: ply_rs_bw::parser::ParseError| {
        let text = e.to_string();
        let words: Vec<_> = text.split_whitespace().collect();
        let place = Place { line: e.line().unwrap_or(0) as u32, column: 1, ..Place::file(path) };
        Error::scene(format!("malformed PLY file: {}", words.join(" "))).at(place)
    };
    let header = Parser::<Vertex>::new().read_header(&mut reader).map_err(fail)?;
    let layout = Layout::of(&header).map_err(|message| Error::scene(message).in_file(path))?;
    let mut mesh = Mesh::default();
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => {
                let vertices =
                    Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(fail)?;
                layout.take(&vertices, &mut mesh);
            }
            "face" => {
                let faces = Parser::<Face>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(fail)?;
                for (i, face) in faces.iter().enumerate() {
                    fan(&face.corners, layout.vertices, &mut mesh.indices)
                        .map_err(|message| Error::scene(format!("face {i}: {message}")).in_file(path))?;
                }
            }
            _ => {
                Parser::<Nothing>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(fail)?;
            }
        }
    }
    Ok(mesh)
}

/// Splits a polygon into triangles; fewer than three corners make none.
fn fan(corners: &[i64], vertices: usize, indices: &mut Vec<[u32; 3]>) -> Result<(), String> {
    if let Some(bad) = corners.iter().find(|c| !(0..vertices as i64).contains(c)) {
        return Err(format!("there is no vertex {bad}; the file has {vertices}"));
    }
    indices.extend((2..corners.len()).map(|i| [corners[0], corners[i - 1], corners[i]].map(|c| c as u32)));
    Ok(())
}

/// What a file says of its vertices.
struct Layout {
    vertices: usize,
    normals: bool,
    uvs: bool,
}

impl Layout {
    fn of(header: &Header) -> Result<Self, String> {
        let vertex = header.elements.get("vertex").ok_or("the file has no element vertex")?;
        let has = |names: &[&str]| names.iter().all(|name| vertex.properties.contains_key(*name));
        if !has(&["x", "y", "z"]) {
            return Err("the vertices lack x, y or z".to_owned());
        }
        let face = header.elements.get("face").ok_or("the file has no element face")?;
        if !FACE_NAMES.iter().any(|name| face.properties.contains_key(*name)) {
            return Err("the faces lack vertex_indices".to_owned());
        }
        if u32::try_from(vertex.count).is_err() {
            return Err(format!("the mesh has too many vertices: {}", vertex.count));
        }
        let uvs = has(&["u", "v"]) || has(&["s", "t"]) || has(&["texture_u", "texture_v"]);
        Ok(Layout { vertices: vertex.count, normals: has(&["nx", "ny", "nz"]), uvs })
    }

    fn take(&self, vertices: &[Vertex], mesh: &mut Mesh) {
        mesh.positions = vertices.iter().map(|v| v.position).collect();
        if self.normals {
            mesh.normals = vertices.iter().map(|v| v.normal).collect();
        }
        if self.uvs {
            mesh.uvs = vertices.iter().map(|v| v.uv).collect();
        }
    }
}

const FACE_NAMES: [&str; 2] = ["vertex_indices", "vertex_index"];

#[derive(Default)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
    uv: Vec2,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Vertex::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let slot = match name {
            "x" => &mut self.position.x,
            "y" => &mut self.position.y,
            "z" => &mut self.position.z,
            "nx" => &mut self.normal.x,
            "ny" => &mut self.normal.y,
            "nz" => &mut self.normal.z,
            "u" | "s" | "texture_u" => &mut self.uv.x,
            "v" | "t" | "texture_v" => &mut self.uv.y,
            _ => return PropertyAccessResult::Ignored,
        };
        let Some(value) = property.to_f32_lossy() else { return PropertyAccessResult::UnsupportedType };
        *slot = value;
        PropertyAccessResult::Set
    }
}

#[derive(Default)]
struct Face {
    corners: Vec<i64>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Face::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !FACE_NAMES.contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        fn wide<T: Into<i64>>(list: Vec<T>) -> Vec<i64> {
            list.into_iter().map(T::into).collect()
        }
        self.corners = match property {
            Property::ListChar(v) => wide(v),
            Property::ListUChar(v) => wide(v),
            Property::ListShort(v) => wide(v),
            Property::ListUShort(v) => wide(v),
            Property::ListInt(v) => wide(v),
            Property::ListUInt(v) => wide(v),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// An element that is of no use here.
struct Nothing;

impl PropertyAccess for Nothing {
    fn new() -> Self {
        Nothing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(format: &str, index: &str) -> String {
        format!(
            "ply\nformat {format} 1.0\ncomment a square\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\n\
             property float s\nproperty float t\nproperty uchar red\nelement face 1\nproperty list uchar {index} vertex_index\nend_header\n"
        )
    }

    const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.5]];

    fn square() -> Mesh {
        Mesh {
            positions: CORNERS.map(Vec3::from).to_vec(),
            uvs: CORNERS.map(|c| Vec2::new(c[0], c[1])).to_vec(),
            indices: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    #[test]
    fn text_is_read() {
        let lines = CORNERS.map(|[x, y, z]| format!("{x} {y} {z} {x} {y} 255\n")).concat();
        let text = header("ascii", "int") + &lines + "4 0 1 2 3\n";
        assert_eq!(parse(Path::new("m.ply"), text.as_bytes()).unwrap(), square());
    }

    #[test]
    fn both_binary_orders_are_read() {
        let mut little = header("binary_little_endian", "ushort").into_bytes();
        let mut big = header("binary_big_endian", "uint").into_bytes();
        for [x, y, z] in CORNERS {
            little.extend(
                [x.to_le_bytes().to_vec(), f64::from(y).to_le_bytes().to_vec(), z.to_le_bytes().to_vec()]
                    .concat(),
            );
            little.extend([x.to_le_bytes(), y.to_le_bytes()].concat());
            big.extend(
                [x.to_be_bytes().to_vec(), f64::from(y).to_be_bytes().to_vec(), z.to_be_bytes().to_vec()]
                    .concat(),
            );
            big.extend([x.to_be_bytes(), y.to_be_bytes()].concat());
            little.push(7);
            big.push(7);
        }
        little.push(4);
        big.push(4);
        for i in 0..4u16 {
            little.extend(i.to_le_bytes());
            big.extend(u32::from(i).to_be_bytes());
        }
        assert_eq!(parse(Path::new("m.ply"), &little).unwrap(), square());
        assert_eq!(parse(Path::new("m.ply"), &big).unwrap(), square());
    }

    #[test]
    fn broken_files_are_refused() {
        let message = |text: &str| parse(Path::new("m.ply"), text.as_bytes()).unwrap_err().to_string();
        let lines = "0 0 0 0 0 1\n".repeat(4);
        assert_eq!(
            message(&(header("ascii", "int") + &lines + "3 0 1 4\n")),
            "m.ply: face 0: there is no vertex 4; the file has 4"
        );
        assert_eq!(
            message("ply\nformat ascii 1.0\nelement face 0\nend_header\n"),
            "m.ply: the file has no element vertex"
        );
        for text in ["", "plx\n", &header("ascii", "int"), &(header("ascii", "int") + &lines)] {
            assert!(message(text).starts_with("m.ply"), "{text}");
            assert!(message(text).contains("malformed PLY file: "), "{}", message(text));
        }
    }
}
