//! Wavefront OBJ.
//!
//! Groups, objects, smoothing groups and materials mean nothing here, as in Mitsuba. The file is read in blocks whose
//! lines are parsed in parallel and put together in their order, so that neither the text nor the corners of all
//! faces are in memory at once.

mod fault;
mod lines;
mod weld;

use crate::error::{Error, Place, Result, counted};
use crate::math::{Vec2, Vec3};
use crate::memory::{Refusal, Reservation};
use crate::shape::Mesh;
use lines::{Malformed, Piece, Survey};
use rayon::prelude::*;
use std::io::{self, Read};
use std::path::Path;
use weld::{Key, NONE, Weld};

/// Vertices after which no more is read: so far below the range of `u32` that a piece of lines of any length fits.
const MOST_VERTICES: usize = 1 << 31;

/// How a file is cut. Lines may be longer.
#[derive(Clone, Copy, Debug)]
pub struct Sizes {
    /// Bytes that are read at once.
    block: usize,
    /// Bytes that a thread parses at once.
    piece: usize,
}

impl Sizes {
    /// Blocks that are much smaller than meshes that take long, of enough pieces for many threads.
    pub const USUAL: Sizes = Sizes { block: 8 << 20, piece: 256 << 10 };
}

/// Why a file could not be read.
#[derive(Debug)]
pub enum Failure {
    Io(io::Error),
    Mesh(Error),
    Memory(Refusal),
}

/// As [`Failure`], before anybody has looked for what is wrong.
#[derive(Debug)]
enum Stop {
    Io(io::Error),
    Malformed,
    Memory(Refusal),
}

impl From<Malformed> for Stop {
    fn from(_: Malformed) -> Self {
        Stop::Malformed
    }
}

impl From<Refusal> for Stop {
    fn from(refusal: Refusal) -> Self {
        Stop::Memory(refusal)
    }
}

impl From<io::Error> for Stop {
    fn from(error: io::Error) -> Self {
        Stop::Io(error)
    }
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
    sizes: Sizes,
    planned: &mut Reservation,
    warnings: &mut Vec<Error>,
) -> Result<Mesh, Failure> {
    let mut build = Build::default();
    let read = build.read(from, sizes, planned);
    let used = build.used();
    match read.and_then(|()| build.finish(used, planned)) {
        Ok((mesh, survey)) => {
            report(&survey, path, warnings);
            Ok(mesh)
        }
        Err(Stop::Io(error)) => Err(Failure::Io(error)),
        Err(Stop::Memory(refusal)) => Err(Failure::Memory(refusal)),
        Err(Stop::Malformed) => Err(Failure::Mesh(fault::locate(path, &whole().map_err(Failure::Io)?, used))),
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
    fn read(
        &mut self,
        mut from: impl Read + Send,
        sizes: Sizes,
        planned: &mut Reservation,
    ) -> Result<(), Stop> {
        let mut text = Vec::new();
        let mut next = Vec::new();
        let mut pieces = Vec::new();
        let mut more = fill(&mut from, &mut text, sizes.block, planned)?;
        loop {
            // Only whole lines; the rest goes before the next block.
            let end =
                if more { text.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1) } else { text.len() };
            next.clear();
            next.extend_from_slice(&text[end..]);
            let last = std::mem::take(&mut pieces);
            let (parsed, others) = rayon::join(
                || split(&text[..end], sizes.piece).into_par_iter().map(lines::read).collect::<Vec<_>>(),
                || {
                    let more =
                        if more { fill(&mut from, &mut next, sizes.block, planned) } else { Ok(false) };
                    (last.into_iter().try_for_each(|piece: Piece| self.append(piece, planned)), more)
                },
            );
            let (appended, filled) = others;
            appended?;
            pieces = parsed.into_iter().collect::<Result<_, Malformed>>()?;
            if !more {
                return pieces.into_iter().try_for_each(|piece| self.append(piece, planned));
            }
            more = filled?;
            std::mem::swap(&mut text, &mut next);
        }
    }

    /// Adds what the next lines say.
    fn append(&mut self, piece: Piece, planned: &mut Reservation) -> Result<(), Stop> {
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
        // The next piece cannot have more corners than this.
        if self.weld.len() >= MOST_VERTICES {
            return Err(Stop::Malformed);
        }
        Ok(planned.grow_to(self.memory_bytes())?)
    }

    /// Bytes of all arrays so far.
    fn memory_bytes(&self) -> u64 {
        let vectors = size_of::<Vec3>() * (self.positions.capacity() + self.normals.capacity());
        let others =
            size_of::<Vec2>() * self.uvs.capacity() + size_of::<[u32; 3]>() * self.indices.capacity();
        (vectors + others + self.weld.memory_bytes()) as u64
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
    fn finish(self, used: [bool; 2], planned: &mut Reservation) -> Result<(Mesh, Survey), Stop> {
        let vertex =
            [true, used[0], used[1]].into_iter().zip([12, 8, 12]).filter_map(|(is, size)| is.then_some(size));
        planned.grow_to(self.memory_bytes() + self.weld.len() as u64 * vertex.sum::<u64>())?;
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
fn fill(
    from: &mut impl Read,
    text: &mut Vec<u8>,
    block: usize,
    planned: &mut Reservation,
) -> Result<bool, Stop> {
    loop {
        let before = text.len();
        text.reserve(block);
        let read = from.by_ref().take(block as u64).read_to_end(text)?;
        if read < block {
            return Ok(false);
        }
        if text[before..].contains(&b'\n') {
            return Ok(true);
        }
        // A line of any length.
        planned.grow(2 * block as u64)?;
    }
}

/// Cuts a text at line ends.
fn split(text: &[u8], piece: usize) -> Vec<&[u8]> {
    let mut pieces = Vec::new();
    let mut rest = text;
    while !rest.is_empty() {
        let start = piece.min(rest.len());
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
        warn(format!("lines that start with {} are ignored", crate::util::wording::quoted(word)), *line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::Budget;

    fn read(text: &str) -> (Result<Mesh>, Vec<String>) {
        let mut warnings = Vec::new();
        let whole = || Ok(text.as_bytes().to_vec());
        let planned = &mut Budget::unlimited().nothing();
        let mesh = parse(Path::new("m.obj"), text.as_bytes(), whole, Sizes::USUAL, planned, &mut warnings)
            .map_err(|e| match e {
                Failure::Mesh(error) => error,
                Failure::Io(error) => panic!("{error}"),
                Failure::Memory(refusal) => panic!("{refusal:?}"),
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

    #[test]
    fn a_file_means_the_same_however_it_is_cut() {
        let text = format!(
            "# c\n{SQUARE}vt 0 0\nvt 1 1 # c\nvn 0 0 1\ncurv\nf 1/1/1 2/2/1 3/1/1 4/2/-1\nl 1 2\nv 5 5 5 0.5\nvt 0.5 1\n\
             f -1/-1/1\t-2/-2/1 -3/1/1 \r\nf 7/1/1 1/1/1 6/1/1# c\n\n  f 7/1/1 6/1/1 1/1/1\nv 1 2 3\nv 3 2 1 0 0 0\nsurf"
        )
        .replace("# c\n\n  f", " # c\n\n  f");
        let cut = |block, piece| {
            let mut warnings = Vec::new();
            let whole = || Ok(text.as_bytes().to_vec());
            let sizes = Sizes { block, piece };
            let planned = &mut Budget::unlimited().nothing();
            let mesh =
                parse(Path::new("m.obj"), text.as_bytes(), whole, sizes, planned, &mut warnings).unwrap();
            (mesh, warnings)
        };
        let (mesh, warnings) = cut(1000, 1000);
        assert_eq!(mesh.indices, [[0, 1, 2], [0, 2, 3], [4, 3, 2], [5, 0, 6], [5, 6, 0]]);
        assert_eq!(mesh.positions[4], Vec3::splat(10.0));
        assert_eq!(warnings.len(), 2);
        for block in 1..text.len() {
            for piece in [1, 7, 30] {
                assert_eq!(cut(block, piece), (mesh.clone(), warnings.clone()), "{block} {piece}");
            }
        }
    }

    #[test]
    fn indices_without_entries_are_refused() {
        let message = |text: &str| read(text).0.unwrap_err().to_string().lines().next().unwrap().to_owned();
        for (text, expected) in [
            ("vt 0 0\nf 1/1 2/0 3/1\n", "6:1: there is no texture coordinate 0; the file has 1"),
            ("vn 0 0 1\nf 1//1 2//1 3//4\n", "6:1: there is no normal 4; the file has 1"),
            ("f 1 2 99999999999\n", "5:1: there is no vertex 99999999999; the file has 4"),
            ("f 1 2 99999999999999999999\n", "5:1: expected a whole number, found \"99999999999999999999\""),
            ("f 1 2 -9223372036854775808\n", "5:1: there is no vertex -9223372036854775808; the file has 4"),
            ("f 1 2 4294967295\n", "5:1: there is no vertex 4294967295; the file has 4"),
            ("f 1 2 -\n", "5:1: expected a whole number, found \"-\""),
            ("f 1 2 /1\n", "5:1: expected a corner such as 1, 1/1, 1//1 or 1/1/1, found \"/1\""),
            ("v 0 0 0 0\n", "5:1: the weight of the vertex is 0"),
            ("v 0 0 0 1 1\n", "5:1: expected 3 numbers, found 5"),
            ("v\n", "5:1: expected 3 numbers, found 0"),
            ("vt 0 # 1\n", "5:1: expected 2 numbers, found 1"),
        ] {
            assert_eq!(message(&format!("{SQUARE}{text}")), format!("m.obj:{expected}"));
        }
        // Texture coordinates of corners mean nothing where the file has none.
        assert!(read(&format!("{SQUARE}f 1/1 2/1 3/1\n")).0.unwrap().uvs.is_empty());
    }
}
