//! The fast path for large OBJ files. It reads a file in blocks, parses the lines of a block in parallel, and appends
//! the results in their order. The mesh equals that of `tobj` bit for bit. If a line is wrong or unusual, `tobj` reads
//! the file instead.

use super::assembly::Assembly;
use super::weld::NONE;
use super::{Stop, Survey};
use crate::math::{Vec2, Vec3};
use crate::memory::Reservation;
use crate::shape::Mesh;
use rayon::prelude::*;
use std::io::Read;

/// The offset that marks an index as relative to the first entry of its piece.
const RELATIVE: i64 = 1 << 60;
/// The value of an index that a corner lacks.
const LACKING: i64 = -1;

/// The numbers of bytes that are read at once and that a thread parses at once. A longer line is not split.
pub type Sizes = [usize; 2];
/// The sizes for all meshes outside tests: 8 MiB and 256 KiB.
pub const USUAL: Sizes = [8 << 20, 256 << 10];

/// The indices of a corner's position, texture coordinate and normal. Each is the index in the file from 0, or
/// [`RELATIVE`] plus the index in the piece, or [`LACKING`].
type Corner = [i64; 3];

/// The contents of some lines.
#[derive(Default)]
struct Piece {
    survey: Survey,
    positions: Vec<Vec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    /// The corners of triangles. Polygons are split into fans.
    corners: Vec<[Corner; 3]>,
}

/// Reads a mesh. While one block is parsed, the next one is read and the previous one is appended to the mesh.
///
/// # Errors
/// [`Stop::Unusual`] if `tobj` must read the file. [`Stop::Io`] if it cannot be read. [`Stop::Memory`] if the mesh does
/// not fit into memory.
pub fn read(
    mut from: impl Read + Send,
    [block, cut]: Sizes,
    planned: &mut Reservation,
) -> Result<(Mesh, Survey), Stop> {
    let mut assembly = Assembly::default();
    let (mut text, mut next, mut pieces) = (Vec::new(), Vec::new(), Vec::new());
    let mut more = fill(&mut from, &mut text, block, planned)?;
    loop {
        // Only whole lines are parsed. The rest is put before the next block.
        let end = if more { text.iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1) } else { text.len() };
        next.clear();
        next.extend_from_slice(&text[end..]);
        let last: Vec<Piece> = std::mem::take(&mut pieces);
        let parse = || split(&text[..end], cut).into_par_iter().map(parse).collect::<Option<_>>();
        let (parsed, others) = rayon::join(parse, || {
            let more = if more { fill(&mut from, &mut next, block, planned) } else { Ok(false) };
            (last.into_iter().try_for_each(|piece| append(&mut assembly, piece, planned)), more)
        });
        others.0?;
        pieces = parsed.ok_or(Stop::Unusual)?;
        if !more {
            break;
        }
        more = others.1?;
        std::mem::swap(&mut text, &mut next);
    }
    pieces.into_iter().try_for_each(|piece| append(&mut assembly, piece, planned))?;
    assembly.finish(planned)
}

/// Appends the contents of the next lines to the mesh.
fn append(to: &mut Assembly, piece: Piece, planned: &mut Reservation) -> Result<(), Stop> {
    let before = [to.positions.len(), to.uvs.len(), to.normals.len()].map(|n| n as i64);
    to.survey.append(piece.survey);
    to.positions.extend_from_slice(&piece.positions);
    to.uvs.extend_from_slice(&piece.uvs);
    to.normals.extend_from_slice(&piece.normals);
    to.weld.set_positions(to.positions.len());
    to.indices.reserve(piece.corners.len());
    for corners in &piece.corners {
        let mut triangle = [0; 3];
        for (vertex, corner) in triangle.iter_mut().zip(corners) {
            let mut key = [NONE; 3];
            for ((key, index), before) in key.iter_mut().zip(*corner).zip(before) {
                if index != LACKING {
                    let index = if index >= RELATIVE / 2 { index - RELATIVE + before } else { index };
                    *key = u32::try_from(index).ok().filter(|i| *i != NONE).ok_or(Stop::Unusual)?;
                }
            }
            *vertex = to.weld.vertex(key);
        }
        to.indices.push(triangle);
    }
    to.plan(planned)
}

/// Appends the next `block` bytes of a file, and further blocks until there is a line end. Returns whether the file may
/// have more bytes.
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
        if read < block || text[before..].contains(&b'\n') {
            return Ok(read == block);
        }
        // The line is longer than a block.
        planned.grow(2 * block as u64)?;
    }
}

/// Splits a text into pieces of whole lines. Each but the last has at least `piece` bytes.
fn split(mut rest: &[u8], piece: usize) -> Vec<&[u8]> {
    let mut pieces = Vec::new();
    while !rest.is_empty() {
        let start = piece.min(rest.len());
        let end = rest[start..].iter().position(|b| *b == b'\n').map_or(rest.len(), |i| start + i + 1);
        let (piece, after) = rest.split_at(end);
        pieces.push(piece);
        rest = after;
    }
    pieces
}

/// Parses whole lines. Returns `None` if one is wrong or unusual.
fn parse(text: &[u8]) -> Option<Piece> {
    let mut piece = Piece::default();
    let mut rest = Rest(text);
    while !rest.0.is_empty() {
        piece.survey.lines += 1;
        rest.skip_blanks();
        let keyword = rest.word();
        rest.0 = &rest.0[keyword.len()..];
        match keyword {
            b"v" => piece.positions.push(rest.position()?),
            b"vt" => piece.uvs.push(Vec2::new(rest.float()?, rest.float()?)),
            b"vn" => piece.normals.push(Vec3::new(rest.float()?, rest.float()?, rest.float()?)),
            b"f" => face(&mut piece, &mut rest)?,
            b"l" | b"p" => piece.survey.skipped += 1,
            b"" | b"g" | b"o" | b"s" | [b'#', ..] => {}
            _ => piece.survey.add_name(keyword, rest.0.split(|b| *b == b'\n').next()?).then_some(())?,
        }
        rest.0 = rest.0.iter().position(|b| *b == b'\n').map_or(&[], |end| &rest.0[end + 1..]);
    }
    piece.survey.entries = [piece.positions.len(), piece.uvs.len(), piece.normals.len()];
    Some(piece)
}

/// Parses a face into triangles. Returns `None` if a corner is wrong or unusual.
fn face(piece: &mut Piece, rest: &mut Rest<'_>) -> Option<()> {
    let counts = [piece.positions.len(), piece.uvs.len(), piece.normals.len()];
    let mut ends = [[LACKING; 3]; 2];
    let mut n = 0;
    while !rest.is_at_end_of_line() {
        let corner = rest.corner(counts)?;
        piece.survey.with[0] += usize::from(corner[1] != LACKING);
        piece.survey.with[1] += usize::from(corner[2] != LACKING);
        if n >= 2 {
            piece.corners.push([ends[0], ends[1], corner]);
            piece.survey.triangles += 1;
        }
        ends[n.min(1)] = corner;
        n += 1;
    }
    piece.survey.corners += n;
    piece.survey.skipped += usize::from(n < 3);
    Some(())
}

/// The text that has not been parsed yet.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn skip_blanks(&mut self) {
        while let [b' ' | b'\t' | b'\r' | b'\x0c', rest @ ..] = self.0 {
            self.0 = rest;
        }
    }

    /// Skips blanks. Returns whether the rest of the line is empty or a comment.
    fn is_at_end_of_line(&mut self) -> bool {
        self.skip_blanks();
        matches!(self.0, [] | [b'\n' | b'#', ..])
    }

    /// Returns the text up to the next whitespace, which may be empty.
    fn word(&self) -> &'a [u8] {
        &self.0[..self.0.iter().position(u8::is_ascii_whitespace).unwrap_or(self.0.len())]
    }

    fn float(&mut self) -> Option<f32> {
        self.skip_blanks();
        let (value, length) = fast_float2::parse_partial(self.0).ok()?;
        self.0 = &self.0[length..];
        self.0.first().is_none_or(u8::is_ascii_whitespace).then_some(value)
    }

    /// Parses three coordinates. One more number is a weight that divides them; three more are an ignored colour.
    fn position(&mut self) -> Option<Vec3> {
        let position = Vec3::new(self.float()?, self.float()?, self.float()?);
        let mut words = Vec::new();
        while !self.is_at_end_of_line() {
            words.push(self.word());
            self.0 = &self.0[self.word().len()..];
        }
        match words[..] {
            [] => Some(position),
            [_, _, _] => words.iter().all(|w| fast_float2::parse::<f32, _>(w).is_ok()).then_some(position),
            [weight] => fast_float2::parse(weight).ok().filter(|w| *w != 0.0).map(|w: f32| position / w),
            _ => None,
        }
    }

    /// Parses a corner of a face. `counts` is the number of entries of each kind before it in the piece.
    #[inline]
    fn corner(&mut self, counts: [usize; 3]) -> Option<Corner> {
        let mut corner = [self.index(counts[0])?, LACKING, LACKING];
        for i in 1..3 {
            if let [b'/', rest @ ..] = self.0 {
                self.0 = rest;
                corner[i] = self.index(counts[i])?;
            }
        }
        (corner[0] != LACKING && self.0.first().is_none_or(u8::is_ascii_whitespace)).then_some(corner)
    }

    /// Parses an index; without digits, it is [`LACKING`]. `count` is the number of entries before it in the piece.
    #[inline]
    fn index(&mut self, count: usize) -> Option<i64> {
        let sign = self.0.first().copied().filter(|b| matches!(b, b'-' | b'+'));
        self.0 = &self.0[usize::from(sign.is_some())..];
        let (mut value, mut digits) = (0i64, 0);
        while let [digit @ b'0'..=b'9', rest @ ..] = self.0 {
            value = value * 10 + i64::from(digit - b'0');
            digits += 1;
            self.0 = rest;
            // No file has more than `u32::MAX` entries.
            (value <= i64::from(u32::MAX)).then_some(())?;
        }
        match (sign, digits, value) {
            (None, 0, _) => Some(LACKING),
            (_, 0, _) | (_, _, 0) => None,
            (Some(b'-'), ..) => Some(RELATIVE + count as i64 - value),
            _ => Some(value - 1),
        }
    }
}
