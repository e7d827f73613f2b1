//! Wavefront OBJ.
//!
//! Groups, objects, smoothing groups and materials mean nothing here, as in Mitsuba. The file is read in blocks whose lines are
//! parsed in parallel and put together in their order, so that neither the text nor the corners of all faces are in
//! memory at once.

mod fault;
mod lines;
mod weld;

use crate::error::{Error, Place, Result, counted};
use crate::math::{Vec2, Vec3};
use crate::shape::Mesh;
use lines::{Malformed, Piece, Survey};
use rayon::prelude::*;
use std::io::{self, Read};
use std::path::Path;
use weld::{Key, NONE, Weld};

/// Bytes that are read at once, if lines are not longer.
const BLOCK: usize = 8 << 20;
/// Bytes that a thread parses at once.
const PIECE: usize = 256 << 10;

/// Why a file could not be read.
#[derive(Debug)]
pub enum Failure {
    Io(io::Error),
    Mesh(Error),
}

/// Reads a mesh. Texture coordinates and normals are taken where every corner of every face has them.
///
/// `whole` gives the whole text again where something is wrong with it, to say in which line.
///
/// # Errors
/// See [`load`](super::load).
pub fn parse(
    path: &Path,
    from: impl Read + Send,
    whole: impl FnOnce() -> io::Result<Vec<u8>>,
    warnings: &mut Vec<Error>,
) -> Result<Mesh, Failure> {
    let mut build = Build::default();
    let read = build.read(from).map_err(Failure::Io)?;
    let used = build.used();
    match read.and_then(|()| build.finish(used)) {
        Ok((mesh, survey)) => {
            report(&survey, path, warnings);
            Ok(mesh)
        }
        Err(Malformed) => Err(Failure::Mesh(fault::locate(path, &whole().map_err(Failure::Io)?, used))),
    }
}

/// The mesh as far as it is read.
#[derive(Default)]
struct Build {
    survey: Survey,
    positions: Vec<Vec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    weld: Weld,
    indices: Vec<[u32; 3]>,
}

impl Build {
    /// Reads all lines. The next block is read and the last one is put together while one is parsed.
    fn read(&mut self, mut from: impl Read + Send) -> io::Result<Result<(), Malformed>> {
        let mut text = Vec::new();
        let mut next = Vec::new();
        let mut pieces = Vec::new();
        let mut more = fill(&mut from, &mut text)?;
        loop {
            // Only whole lines; the rest goes before the next block.
            let end =
                if more { text.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1) } else { text.len() };
            next.clear();
            next.extend_from_slice(&text[end..]);
            let last = std::mem::take(&mut pieces);
            let (parsed, others) = rayon::join(
                || split(&text[..end]).into_par_iter().map(lines::read).collect::<Vec<_>>(),
                || {
                    let more = if more { fill(&mut from, &mut next) } else { Ok(false) };
                    (last.into_iter().try_for_each(|piece: Piece| self.append(piece)), more)
                },
            );
            let (appended, filled) = others;
            let read = appended.and_then(|()| parsed.into_iter().collect::<Result<_, _>>());
            pieces = match read {
                Ok(pieces) => pieces,
                Err(malformed) => return Ok(Err(malformed)),
            };
            if !more {
                return Ok(pieces.into_iter().try_for_each(|piece| self.append(piece)));
            }
            more = filled?;
            std::mem::swap(&mut text, &mut next);
        }
    }

    /// Adds what the next lines say.
    fn append(&mut self, piece: Piece) -> Result<(), Malformed> {
        let before = [self.positions.len(), self.uvs.len(), self.normals.len()];
        self.survey.append(piece.survey);
        self.positions.extend_from_slice(&piece.positions);
        self.uvs.extend_from_slice(&piece.uvs);
        self.normals.extend_from_slice(&piece.normals);
        self.weld.set_positions(self.positions.len());
        self.indices.reserve(piece.corners.len());
        for corners in &piece.corners {
            let mut triangle = [0; 3];
            for (vertex, corner) in triangle.iter_mut().zip(corners) {
                let mut key = [NONE; 3];
                for ((key, index), before) in key.iter_mut().zip(corner).zip(before) {
                    if let Some(index) = lines::resolve(*index, before) {
                        *key = u32::try_from(index).ok().filter(|i| *i != NONE).ok_or(Malformed)?;
                    }
                }
                *vertex = self.weld.vertex(key);
            }
            self.indices.push(triangle);
        }
        match self.weld.len() < NONE as usize - 3 * PIECE {
            true => Ok(()),
            false => Err(Malformed),
        }
    }

    /// Whether texture coordinates and normals are of use.
    fn used(&self) -> [bool; 2] {
        let all = |some: usize| some > 0 && some == self.survey.corners;
        [
            all(self.survey.with_uv) && !self.uvs.is_empty(),
            all(self.survey.with_normal) && !self.normals.is_empty(),
        ]
    }

    /// Checks the indices and gathers what they refer to.
    fn finish(self, used: [bool; 2]) -> Result<(Mesh, Survey), Malformed> {
        let keys = self.weld.into_keys();
        let positions = gather(&keys, 0, self.positions)?;
        let uvs = if used[0] { gather(&keys, 1, self.uvs)? } else { Vec::new() };
        let normals = if used[1] { gather(&keys, 2, self.normals)? } else { Vec::new() };
        Ok((Mesh { positions, normals, uvs, indices: self.indices, attributes: Vec::new() }, self.survey))
    }
}

/// The entries that the vertices refer to.
fn gather<T: Copy + Send + Sync>(keys: &[Key], kind: usize, entries: Vec<T>) -> Result<Vec<T>, Malformed> {
    if !keys.par_iter().all(|key| (key[kind] as usize) < entries.len()) {
        return Err(Malformed);
    }
    if keys.len() == entries.len() && keys.par_iter().enumerate().all(|(i, key)| key[kind] as usize == i) {
        return Ok(entries);
    }
    Ok(keys.par_iter().map(|key| entries[key[kind] as usize]).collect())
}

/// Appends the next bytes of a file, at least up to a line end; whether there may be more.
fn fill(from: &mut impl Read, text: &mut Vec<u8>) -> io::Result<bool> {
    loop {
        let before = text.len();
        text.reserve(BLOCK);
        let read = from.by_ref().take(BLOCK as u64).read_to_end(text)?;
        if read < BLOCK {
            return Ok(false);
        }
        if text[before..].contains(&b'\n') {
            return Ok(true);
        }
    }
}

/// Cuts a text at line ends.
fn split(text: &[u8]) -> Vec<&[u8]> {
    let mut pieces = Vec::new();
    let mut rest = text;
    while !rest.is_empty() {
        let start = PIECE.min(rest.len());
        let end = rest[start..].iter().position(|b| *b == b'\n').map_or(rest.len(), |i| start + i + 1);
        let (piece, after) = rest.split_at(end);
        pieces.push(piece);
        rest = after;
    }
    pieces
}

/// Tells what had to be ignored.
fn report(survey: &Survey, path: &Path, warnings: &mut Vec<Error>) {
    let mut warn = |message: String, line: u32| {
        let place = Place { line, column: 1, ..Place::file(path) };
        warnings.push(Error::scene(message).at(place));
    };
    if survey.skipped > 0 {
        let skipped = counted(survey.skipped as u64, "point, line or face", "points, lines or faces");
        warn(format!("{skipped} of fewer than three vertices ignored"), 0);
    }
    let some = |n: usize| n > 0 && n < survey.corners;
    if some(survey.with_uv) {
        warn("some corners of faces have no texture coordinates, so none are used".to_owned(), 0);
    }
    if some(survey.with_normal) {
        warn("some corners of faces have no normals, so all are computed".to_owned(), 0);
    }
    if let Some((line, word)) = &survey.unknown {
        warn(format!("lines that start with {} are ignored", crate::loader::values::quoted(word)), *line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> (Result<Mesh>, Vec<String>) {
        let mut warnings = Vec::new();
        let whole = || Ok(text.as_bytes().to_vec());
        let mesh = parse(Path::new("m.obj"), text.as_bytes(), whole, &mut warnings).map_err(|e| match e {
            Failure::Mesh(error) => error,
            Failure::Io(error) => panic!("{error}"),
        });
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
