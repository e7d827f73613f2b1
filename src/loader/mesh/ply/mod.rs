//! Stanford PLY: text and binary files in either byte order.
//!
//! Elements without lists, and faces that are all triangles, are tables of fixed width, which are decoded in parallel.

mod attributes;
mod header;
mod rows;
mod table;

use crate::error::{Error, Place, Result};
use crate::math::{Vec2, Vec3};
use crate::memory::{Refusal, Reservation};
use crate::shape::Mesh;
use crate::texture::Attribute;
use attributes::Group;
use header::{Element, Header, Kind, Number};
use rows::Rest;
use std::path::Path;
use table::Table;

/// The line (from 1; 0 if there are no lines) of a fault and its description.
type Fault = (u32, String);

/// Reads a mesh. Vertices may have normals `nx ny nz`, texture coordinates `u v`, `texture_u texture_v` or `s t`, and
/// [attributes].
///
/// # Errors
/// As for [`load`](super::load).
pub fn parse(
    path: &Path,
    bytes: &[u8],
    planned: &mut Reservation,
    warnings: &mut Vec<Error>,
) -> Result<Mesh> {
    let at = |(line, message): Fault| {
        let place = Place { line, column: 1, ..Place::file(path) };
        Error::scene(message).at(place)
    };
    let header = Header::parse(bytes).map_err(|(line, message)| at(malformed(line, &message)))?;
    let (layout, ignored) = Layout::of(&header).map_err(|message| at((0, message)))?;
    let mut rest = Rest { bytes, at: header.size, encoding: header.encoding };
    let mut mesh = Mesh::default();
    for element in &header.elements {
        let read = match element.name.as_str() {
            "vertex" => layout.vertices(&mut rest, element, planned, &mut mesh),
            "face" => layout.faces(&mut rest, element, planned, &mut mesh),
            _ => skip(&mut rest, element),
        };
        read.map_err(at)?;
    }
    let mut warn = |message: String| warnings.push(Error::scene(message).in_file(path));
    ignored.into_iter().for_each(&mut warn);
    if !rest.left().trim_ascii().is_empty() {
        warn("what follows the last element is ignored".to_owned());
    }
    Ok(mesh)
}

/// Returns the fault of a file whose mesh does not fit into memory.
fn too_large(refusal: Refusal) -> Fault {
    (0, refusal.sentence("its mesh", "use a mesh of fewer triangles"))
}

/// Returns the number of channels of all groups.
fn channels(groups: &[Group]) -> usize {
    groups.iter().map(|group| group.columns.len()).sum()
}

fn malformed(line: u32, message: &str) -> Fault {
    (line, format!("malformed PLY file: {message}"))
}

/// Skips an element that is not used.
fn skip<'a>(rest: &mut Rest<'a>, element: &'a Element) -> Result<(), Fault> {
    match Table::take(rest, element)? {
        Some(_) => Ok(()),
        None => rest.each_row(element, None, |_, _| Ok(())),
    }
}

/// Splits a polygon into triangles; none if it has fewer than three corners.
fn fan(face: u64, corners: &[i64], vertices: usize, indices: &mut Vec<[u32; 3]>) -> Result<(), Fault> {
    if let Some(bad) = corners.iter().find(|c| !(0..vertices as i64).contains(c)) {
        return Err(no_vertex(face, *bad, vertices));
    }
    indices.extend((2..corners.len()).map(|i| [corners[0], corners[i - 1], corners[i]].map(|c| c as u32)));
    Ok(())
}

fn no_vertex(face: u64, vertex: i64, vertices: usize) -> Fault {
    (0, format!("face {face}: there is no vertex {vertex}; the file has {vertices}"))
}

/// The meaning of the properties of vertices and faces.
struct Layout {
    /// The number of vertices.
    count: usize,
    position: [usize; 3],
    normal: Option<[usize; 3]>,
    uv: Option<[usize; 2]>,
    vertex_groups: Vec<Group>,
    /// The property with the list of a face's vertices.
    corners: usize,
    face_groups: Vec<Group>,
}

impl Layout {
    /// Creates the layout of a header, with warnings.
    fn of(header: &Header) -> Result<(Self, Vec<String>), String> {
        let vertex = header.element("vertex").ok_or("the file has no element vertex")?;
        let position = find(vertex, ["x", "y", "z"]).ok_or("the vertices lack x, y or z")?;
        let normal = find(vertex, ["nx", "ny", "nz"]);
        let names = [["u", "v"], ["texture_u", "texture_v"], ["s", "t"]];
        let uv = names.into_iter().find_map(|names| find(vertex, names));
        let face = header.element("face").ok_or("the file has no element face")?;
        let is_list =
            |i: &usize| matches!(face.properties[*i].kind, Kind::List { item, .. } if !item.is_float());
        let mut lists = FACE_NAMES.iter().filter_map(|name| face.find(name)).filter(is_list);
        let corners = lists.next().ok_or("the faces lack vertex_indices")?;
        let count = usize::try_from(vertex.count).ok().filter(|n| u32::try_from(*n).is_ok());
        let count = count.ok_or_else(|| format!("the mesh has too many vertices: {}", vertex.count))?;
        let used =
            [position.as_slice(), normal.as_slice().as_flattened(), uv.as_slice().as_flattened()].concat();
        let (vertex_groups, mut warnings) = attributes::groups(vertex, &used);
        let (face_groups, more) = attributes::groups(face, &[]);
        warnings.extend(more);
        Ok((Layout { count, position, normal, uv, vertex_groups, corners, face_groups }, warnings))
    }

    fn vertices<'a>(
        &self,
        rest: &mut Rest<'a>,
        element: &'a Element,
        planned: &mut Reservation,
        mesh: &mut Mesh,
    ) -> Result<(), Fault> {
        let groups = &self.vertex_groups;
        rest.check(element)?;
        let optional = self.normal.map_or(0, |n| n.len()) + self.uv.map_or(0, |uv| uv.len());
        let numbers = self.position.len() + optional + channels(groups);
        planned.grow(element.count.saturating_mul(4 * numbers as u64)).map_err(too_large)?;
        if let Some(table) = Table::take(rest, element)? {
            mesh.positions = table.vectors(self.position);
            mesh.normals = self.normal.map(|columns| table.vectors(columns)).unwrap_or_default();
            mesh.uvs = self.uv.map(|columns| table.vectors(columns)).unwrap_or_default();
            mesh.attributes.extend(groups.iter().map(|group| table.attribute(group)));
            return Ok(());
        }
        mesh.positions.reserve_exact(self.count);
        mesh.normals.reserve_exact(self.normal.map_or(0, |_| self.count));
        mesh.uvs.reserve_exact(self.uv.map_or(0, |_| self.count));
        let first = mesh.attributes.len();
        mesh.attributes.extend(groups.iter().map(empty));
        rest.each_row(element, None, |_, row| {
            let value = |i: usize| row.scalars[i] as f32;
            mesh.positions.push(Vec3::from(self.position.map(value)));
            mesh.normals.extend(self.normal.map(|n| Vec3::from(n.map(value))));
            mesh.uvs.extend(self.uv.map(|uv| Vec2::from(uv.map(value))));
            push(&mut mesh.attributes[first..], groups, element, &row.scalars, 1);
            Ok(())
        })
    }

    fn faces<'a>(
        &self,
        rest: &mut Rest<'a>,
        element: &'a Element,
        planned: &mut Reservation,
        mesh: &mut Mesh,
    ) -> Result<(), Fault> {
        let groups = &self.face_groups;
        rest.check(element)?;
        let triangle = 4 * (3 + channels(groups)) as u64;
        let mut room = element.count;
        planned.grow(room.saturating_mul(triangle)).map_err(too_large)?;
        if let Some(table) = Table::take_triangles(rest, element, self.corners) {
            mesh.indices = table.triangles(self.corners);
            mesh.attributes.extend(groups.iter().map(|group| table.attribute(group)));
            return match table::first_outside(&mesh.indices, self.count) {
                Some(face) => Err(no_vertex(
                    face as u64,
                    table.corner_outside(face, self.corners, self.count),
                    self.count,
                )),
                None => Ok(()),
            };
        }
        // A triangle takes at least as many bytes as "3 0 1 2" and a line end.
        let least = usize::try_from(element.count).unwrap_or(usize::MAX).min(rest.left().len() / 8);
        mesh.indices.reserve_exact(least);
        let first = mesh.attributes.len();
        mesh.attributes.extend(groups.iter().map(empty));
        rest.each_row(element, Some(self.corners), |i, row| {
            let before = mesh.indices.len();
            // Polygons may give more triangles than there are faces.
            let after = (before + row.list.len()) as u64;
            if after > room {
                let more = after.max(2 * room) - room;
                planned.grow(more.saturating_mul(triangle)).map_err(too_large)?;
                room += more;
            }
            fan(i, &row.list, self.count, &mut mesh.indices)?;
            push(&mut mesh.attributes[first..], groups, element, &row.scalars, mesh.indices.len() - before);
            Ok(())
        })
    }
}

const FACE_NAMES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Returns the scalar properties of these names.
fn find<const N: usize>(element: &Element, names: [&str; N]) -> Option<[usize; N]> {
    let mut found = [0; N];
    for (found, name) in found.iter_mut().zip(names) {
        *found = element.find(name).filter(|i| matches!(element.properties[*i].kind, Kind::Scalar(_)))?;
    }
    Some(found)
}

/// Returns an attribute without values.
fn empty(group: &Group) -> Attribute {
    Attribute { name: group.name.clone(), channels: group.columns.len(), values: Vec::new() }
}

/// Appends the values of a row `times` times.
fn push(into: &mut [Attribute], groups: &[Group], element: &Element, scalars: &[f64], times: usize) {
    for (attribute, group) in into.iter_mut().zip(groups) {
        for _ in 0..times {
            let value = |i: &usize| attributes::decode(number(element, *i), scalars[*i]);
            attribute.values.extend(group.columns.iter().map(value));
        }
    }
}

/// Returns the type of a property, or of the items of a list.
fn number(element: &Element, i: usize) -> Number {
    match element.properties[i].kind {
        Kind::Scalar(number) | Kind::List { item: number, .. } => number,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::Budget;

    fn read(bytes: &[u8]) -> Result<Mesh> {
        parse(Path::new("m.ply"), bytes, &mut Budget::unlimited().nothing(), &mut Vec::new())
    }

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
        assert_eq!(read(text.as_bytes()).unwrap(), square());
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
        assert_eq!(read(&little).unwrap(), square());
        assert_eq!(read(&big).unwrap(), square());
    }

    /// Returns a file with vertex colours as half-precision floats, a number for each face, a triangle and optionally a
    /// square.
    fn coloured(encoding: &str, square: bool) -> Vec<u8> {
        let faces = if square { 2 } else { 1 };
        let header = format!(
            "ply\nformat {encoding} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
             property half red\nproperty half green\nproperty half blue\nelement face {faces}\nproperty float heat_0\n\
             property list int short vertex_indices\nend_header\n"
        );
        let mut bytes = header.into_bytes();
        let little = encoding == "binary_little_endian";
        let text = encoding == "ascii";
        for (i, position) in CORNERS.iter().enumerate() {
            if text {
                bytes.extend(format!("{} {} {} {i} 0.5 1\n", position[0], position[1], position[2]).bytes());
                continue;
            }
            let single = |v: &f32| if little { v.to_le_bytes() } else { v.to_be_bytes() };
            bytes.extend(position.iter().flat_map(single));
            let color = [i as f32, 0.5, 1.0].map(|v| exr::prelude::f16::from_f32(v).to_bits());
            bytes.extend(color.iter().flat_map(|v| if little { v.to_le_bytes() } else { v.to_be_bytes() }));
        }
        for (heat, corners) in [(7f32, &[0i16, 1, 2][..]), (8.0, &[0, 1, 2, 3])].into_iter().take(faces) {
            let n = corners.len() as i32;
            if text {
                let corners: Vec<_> = corners.iter().map(i16::to_string).collect();
                bytes.extend(format!("\n{heat} {n} {}\r\n", corners.join(" ")).bytes());
                continue;
            }
            bytes.extend(if little { heat.to_le_bytes() } else { heat.to_be_bytes() });
            bytes.extend(if little { n.to_le_bytes() } else { n.to_be_bytes() });
            bytes.extend(corners.iter().flat_map(|c| if little { c.to_le_bytes() } else { c.to_be_bytes() }));
        }
        bytes
    }

    #[test]
    fn attributes_are_read_in_every_encoding() {
        for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
            for square in [false, true] {
                let mesh = read(&coloured(encoding, square)).unwrap();
                let [color, heat] = &mesh.attributes[..] else { panic!("{:?}", mesh.attributes) };
                assert_eq!((color.name.as_str(), color.channels), ("vertex_color", 3));
                assert_eq!(color.values, [0.0, 0.5, 1.0, 1.0, 0.5, 1.0, 2.0, 0.5, 1.0, 3.0, 0.5, 1.0]);
                assert_eq!((heat.name.as_str(), heat.channels), ("face_heat", 1));
                assert_eq!(mesh.positions, CORNERS.map(Vec3::from));
                match square {
                    false => assert_eq!((mesh.indices.len(), &heat.values[..]), (1, &[7.0][..])),
                    true => assert_eq!((mesh.indices.len(), &heat.values[..]), (3, &[7.0, 8.0, 8.0][..])),
                }
            }
        }
    }

    #[test]
    fn counts_are_checked_against_the_length_of_the_file() {
        for encoding in ["ascii", "binary_big_endian"] {
            for (element, count) in [("vertex", "4"), ("face", "2")] {
                for huge in [60u64, 4294967294, u64::MAX] {
                    let text = header(encoding, "int").replace("face 1", "face 2");
                    let text = text
                        .replace(&format!("element {element} {count}"), &format!("element {element} {huge}"));
                    let message =
                        read((text + &"0 0 0 0 0 1\n".repeat(14)).as_bytes()).unwrap_err().to_string();
                    let known = [
                        format!(
                            "m.ply: malformed PLY file: the file is too short for {huge} of element {element}"
                        ),
                        format!("m.ply: the mesh has too many vertices: {huge}"),
                    ];
                    assert!(known.contains(&message) || element == "face" && huge == 60, "{message}");
                }
            }
        }
    }

    #[test]
    fn errors_in_text_have_their_line() {
        let message =
            |lines: &str| read((header("ascii", "int") + lines).as_bytes()).unwrap_err().to_string();
        let vertices = "0 0 0 0 0 1\n".repeat(4);
        for (lines, expected) in [
            (
                &format!("0 0 x 0 0 1{}", "\n".repeat(40)),
                "14:1: malformed PLY file: expected a number, found \"x\"",
            ),
            (&format!("{vertices}3 0 1\n"), "18:1: malformed PLY file: the line ends within a row of face"),
            (
                &format!("{vertices}3 0 1 2 2\n"),
                "18:1: malformed PLY file: expected the end of the line, found \"2\"",
            ),
            (
                &format!("{vertices}\n300 0 1 2 2\n"),
                "19:1: malformed PLY file: expected a whole number from 0 to 255, found \"300\"",
            ),
            (
                &format!("{vertices}3 0 1 1.5\n"),
                "18:1: malformed PLY file: expected a whole number from -2147483648 to 2147483647, found \"1.5\"",
            ),
        ] {
            assert_eq!(message(lines), format!("m.ply:{expected}"));
        }
    }

    #[test]
    fn broken_files_are_refused() {
        let message = |text: &str| read(text.as_bytes()).unwrap_err().to_string();
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
