//! Wavefront OBJ, through the crate `tobj`.
//!
//! Groups, objects, smoothing groups and materials mean nothing here (as in Mitsuba), but would make the library split
//! the mesh, so it gets the vertices and faces alone. It also says neither where an error is nor that something was skipped;
//! a look over the lines finds that out.

use crate::error::{Error, Place, Result, counted};
use crate::math::{Vec2, Vec3};
use crate::shape::Mesh;
use std::path::Path;

const LOAD: tobj::LoadOptions =
    tobj::LoadOptions { single_index: true, triangulate: true, ignore_points: true, ignore_lines: true };

/// Keywords of things that a mesh can do without; what else is unknown is told.
const HARMLESS: [&[u8]; 5] = [b"g", b"o", b"s", b"mtllib", b"usemtl"];

/// Reads a mesh. Texture coordinates and normals are taken where every corner of every face has them.
///
/// # Errors
/// See [`load`](super::load).
pub fn parse(path: &Path, bytes: &[u8], warnings: &mut Vec<Error>) -> Result<Mesh> {
    let survey = Survey::of(bytes);
    survey.report(path, warnings);
    let kept = survey.kept(bytes);
    let loaded = tobj::load_obj_buf(&mut kept.as_slice(), &LOAD, |_| Ok(Default::default()));
    let (models, _) = loaded.map_err(|e| locate(path, bytes, &e))?;
    let Some(model) = models.into_iter().next() else { return Ok(Mesh::default()) };
    let mesh = model.mesh;
    if mesh.indices.len() % 3 != 0 || u32::try_from(mesh.positions.len() / 3).is_err() {
        return Err(Error::scene("the mesh has too many vertices").in_file(path));
    }
    let triples = |v: &[f32]| v.chunks_exact(3).map(Vec3::from_slice).collect();
    Ok(Mesh {
        positions: triples(&mesh.positions),
        normals: triples(&mesh.normals),
        uvs: mesh.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(),
        indices: mesh.indices.chunks_exact(3).map(|i| [i[0], i[1], i[2]]).collect(),
        attributes: Vec::new(),
    })
}

/// What the lines of a file are about.
#[derive(Debug, Default)]
struct Survey {
    corners: usize,
    with_uv: usize,
    with_normal: usize,
    skipped: usize,
    unknown: Option<(u32, String)>,
}

impl Survey {
    fn of(bytes: &[u8]) -> Self {
        let mut survey = Survey::default();
        for (i, line) in bytes.split(|b| *b == b'\n').enumerate() {
            let mut words = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
            match words.next() {
                None | Some(b"v" | b"vt" | b"vn") => {}
                Some(b"f") => survey.face(words),
                Some(b"l" | b"p") => survey.skipped += 1,
                Some(word) if word.starts_with(b"#") || HARMLESS.contains(&word) => {}
                Some(word) => {
                    let word = || (i as u32 + 1, String::from_utf8_lossy(word).into_owned());
                    survey.unknown.get_or_insert_with(word);
                }
            }
        }
        survey
    }

    fn face<'a>(&mut self, corners: impl Iterator<Item = &'a [u8]>) {
        let before = self.corners;
        for corner in corners {
            let mut parts = corner.split(|b| *b == b'/').skip(1);
            self.corners += 1;
            self.with_uv += usize::from(parts.next().is_some_and(|p| !p.is_empty()));
            self.with_normal += usize::from(parts.next().is_some_and(|p| !p.is_empty()));
        }
        self.skipped += usize::from(self.corners - before < 3);
    }

    /// Whether all corners have what `some` of them have.
    fn complete(&self, some: usize) -> bool {
        some == self.corners
    }

    fn report(&self, path: &Path, warnings: &mut Vec<Error>) {
        let mut warn = |message: String, line: u32| {
            let place = Place { line, column: 1, ..Place::file(path) };
            warnings.push(Error::scene(message).at(place));
        };
        if self.skipped > 0 {
            warn(
                format!(
                    "{} of fewer than three vertices ignored",
                    counted(self.skipped as u64, "point, line or face", "points, lines or faces")
                ),
                0,
            );
        }
        if self.with_uv > 0 && !self.complete(self.with_uv) {
            warn("some corners of faces have no texture coordinates, so none are used".to_owned(), 0);
        }
        if self.with_normal > 0 && !self.complete(self.with_normal) {
            warn("some corners of faces have no normals, so all are computed".to_owned(), 0);
        }
        if let Some((line, word)) = &self.unknown {
            warn(format!("lines that start with {} are ignored", crate::loader::values::quoted(word)), *line);
        }
    }

    /// The lines that make up the mesh.
    fn kept(&self, bytes: &[u8]) -> Vec<u8> {
        let mut kept = Vec::with_capacity(bytes.len() + 1);
        for line in bytes.split(|b| *b == b'\n') {
            let keep = match line.trim_ascii_start() {
                [b'v', b't', ..] => self.complete(self.with_uv),
                [b'v', b'n', ..] => self.complete(self.with_normal),
                [b'v' | b'f', next, ..] => next.is_ascii_whitespace(),
                _ => false,
            };
            if keep {
                kept.extend_from_slice(line);
                kept.push(b'\n');
            }
        }
        kept
    }
}

/// The error for what the library refuses, with the first line at fault.
fn locate(path: &Path, bytes: &[u8], error: &tobj::LoadError) -> Error {
    let count = |word: &[u8]| {
        let starts = |line: &&[u8]| line.split(u8::is_ascii_whitespace).find(|w| !w.is_empty()) == Some(word);
        bytes.split(|b| *b == b'\n').filter(starts).count() as i64
    };
    let limits = [count(b"v"), count(b"vt"), count(b"vn")];
    let mut seen = [0; 3];
    for (i, line) in bytes.split(|b| *b == b'\n').enumerate() {
        let text = String::from_utf8_lossy(line);
        let mut words = text.split_whitespace();
        let fault = match words.next() {
            Some("v") => {
                seen[0] += 1;
                coordinates(words, 3, &[3, 4, 6])
            }
            Some("vt") => {
                seen[1] += 1;
                coordinates(words, 2, &[])
            }
            Some("vn") => {
                seen[2] += 1;
                coordinates(words, 3, &[])
            }
            Some("f") => words.find_map(|corner| corner_fault(corner, limits, seen)),
            _ => None,
        };
        if let Some(message) = fault {
            let place = Place {
                line: i as u32 + 1,
                column: 1,
                text: text.trim_end().to_owned(),
                ..Place::file(path)
            };
            return Error::scene(message).at(place);
        }
    }
    Error::scene(format!("malformed OBJ file: {error}")).in_file(path)
}

/// What is wrong with the numbers of a vertex: the first `n` must be numbers, and their count one of `counts` if any.
fn coordinates<'a>(words: impl Iterator<Item = &'a str>, n: usize, counts: &[usize]) -> Option<String> {
    let words: Vec<_> = words.collect();
    if words.len() < n || !(counts.is_empty() || counts.contains(&words.len())) {
        return Some(format!("expected {n} numbers, found {}", words.len()));
    }
    if words.len() == 4 && n == 3 && words[3].parse() == Ok(0f32) {
        return Some("the weight of the vertex is 0".to_owned());
    }
    let bad = words.iter().find(|w| w.parse::<f32>().is_err())?;
    Some(format!("expected a number, found {}", crate::loader::values::quoted(bad)))
}

/// What is wrong with a face's corner, given how many entries the file has and how many came before it.
fn corner_fault(corner: &str, limits: [i64; 3], seen: [i64; 3]) -> Option<String> {
    const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];
    let parts: Vec<_> = corner.split('/').collect();
    if parts.len() > 3 || parts[0].is_empty() {
        return Some(format!(
            "expected a corner such as 1, 1/1, 1//1 or 1/1/1, found {}",
            crate::loader::values::quoted(corner)
        ));
    }
    for (i, part) in parts.iter().enumerate().filter(|(_, p)| !p.is_empty()) {
        let Ok(index) = part.parse::<i64>() else {
            return Some(format!("expected a whole number, found {}", crate::loader::values::quoted(part)));
        };
        let found = if index < 0 { seen[i].saturating_add(index) } else { index - 1 };
        if !(0..limits[i]).contains(&found) {
            return Some(format!("there is no {} {index}; the file has {}", KINDS[i], limits[i]));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> (Result<Mesh>, Vec<String>) {
        let mut warnings = Vec::new();
        let mesh = parse(Path::new("m.obj"), text.as_bytes(), &mut warnings);
        (mesh, warnings.iter().map(Error::to_string).collect())
    }

    const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    #[test]
    fn groups_do_not_split_a_mesh_and_polygons_become_fans() {
        let (mesh, warnings) = read(&format!(
            "mtllib x.mtl\no a\n{SQUARE}g b\nf 1 2 3\nusemtl c\ng d\nf 1 3 4\nf -4 -3 -2 -1\n"
        ));
        let mesh = mesh.unwrap();
        assert_eq!(mesh.positions.len(), 4);
        assert_eq!(mesh.indices, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [0, 2, 3]]);
        assert!(warnings.is_empty(), "{warnings:?}");
    }

    #[test]
    fn vertices_are_shared_where_all_their_indices_are() {
        let (mesh, _) = read(&format!(
            "{SQUARE}vt 0 0.25\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1/2/1 3/1/1 4/1/1\r\n"
        ));
        let mesh = mesh.unwrap();
        assert_eq!(mesh.indices, [[0, 1, 2], [3, 2, 4]]);
        assert_eq!(mesh.uvs[3], Vec2::ONE);
        assert_eq!(mesh.normals, [Vec3::Z; 5]);
    }

    #[test]
    fn incomplete_corners_and_skipped_lines_are_told() {
        let (mesh, warnings) =
            read(&format!("{SQUARE}vt 0 0\nvn 0 0 1\nf 1/1 2//1 3\nf 1 2\nl 1 2\ncurv 1 2\n"));
        let mesh = mesh.unwrap();
        assert_eq!((mesh.uvs.len(), mesh.normals.len(), mesh.indices.len()), (0, 0, 1));
        assert_eq!(
            warnings,
            [
                "m.obj: 2 points, lines or faces of fewer than three vertices ignored",
                "m.obj: some corners of faces have no texture coordinates, so none are used",
                "m.obj: some corners of faces have no normals, so all are computed",
                "m.obj:10:1: lines that start with \"curv\" are ignored",
            ]
        );
    }

    #[test]
    fn errors_have_their_line() {
        let message = |text: &str| read(text).0.unwrap_err().to_string().lines().next().unwrap().to_owned();
        assert_eq!(message("v 0 0 0\nv 1 0 x\n"), "m.obj:2:1: expected a number, found \"x\"");
        assert_eq!(message("v 0 0\n"), "m.obj:1:1: expected 3 numbers, found 2");
        assert_eq!(message(&format!("{SQUARE}f 1 2 9\n")), "m.obj:5:1: there is no vertex 9; the file has 4");
        assert_eq!(message(&format!("{SQUARE}f 1 2 0\n")), "m.obj:5:1: there is no vertex 0; the file has 4");
        assert_eq!(
            message(&format!("{SQUARE}f 1 2 -5\n")),
            "m.obj:5:1: there is no vertex -5; the file has 4"
        );
        assert_eq!(
            message(&format!("{SQUARE}vt 0 0\nf 1/1 2/1 3/2\n")),
            "m.obj:6:1: there is no texture coordinate 2; the file has 1"
        );
        assert_eq!(message(&format!("{SQUARE}f 1 2 c\n")), "m.obj:5:1: expected a whole number, found \"c\"");
        assert_eq!(
            message(&format!("{SQUARE}f 1/1/1/1 2 3\n")),
            "m.obj:5:1: expected a corner such as 1, 1/1, 1//1 or 1/1/1, found \"1/1/1/1\""
        );
    }
}
