//! Lines of an OBJ file to numbers, as fast as they come; what is wrong is found out elsewhere.

use crate::math::{Vec2, Vec3};

/// Keywords of things that a mesh can do without; what else is unknown is told.
const HARMLESS: [&[u8]; 5] = [b"g", b"o", b"s", b"mtllib", b"usemtl"];
/// Added to an index that counts from the start of the piece of text.
const RELATIVE: i64 = 1 << 60;
/// An index that a corner lacks.
const LACKING: i64 = -1;

/// What the lines of a file are about.
#[derive(Debug, Default)]
pub struct Survey {
    /// Lines.
    pub lines: u32,
    /// Corners of faces.
    pub corners: usize,
    /// Those with a texture coordinate, and those with a normal.
    pub with_uv: usize,
    pub with_normal: usize,
    /// Points, lines and faces of fewer than three vertices.
    pub skipped: usize,
    /// The first line with an unknown keyword.
    pub unknown: Option<(u32, String)>,
}

impl Survey {
    /// Adds what the lines that follow are about.
    pub fn append(&mut self, next: Survey) {
        if self.unknown.is_none() {
            self.unknown = next.unknown.map(|(line, word)| (self.lines + line, word));
        }
        self.lines += next.lines;
        self.corners += next.corners;
        self.with_uv += next.with_uv;
        self.with_normal += next.with_normal;
        self.skipped += next.skipped;
    }
}

/// Indices from 0 of a corner's position, texture coordinate and normal; see [`resolve`].
pub type Corner = [i64; 3];

/// What some lines say.
#[derive(Debug, Default)]
pub struct Piece {
    pub survey: Survey,
    pub positions: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub normals: Vec<Vec3>,
    /// Corners of triangles; polygons are split into fans.
    pub corners: Vec<[Corner; 3]>,
}

/// The index of an entry in the file, given how many entries are before the piece; `None` for none.
///
/// It may be out of any range.
#[inline]
pub fn resolve(index: i64, before: usize) -> Option<i64> {
    match index {
        LACKING => None,
        i if i >= RELATIVE / 2 => Some(i - RELATIVE + before as i64),
        i => Some(i),
    }
}

/// A line or a word that cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Malformed;

type Read<T> = Result<T, Malformed>;

/// Reads whole lines.
///
/// # Errors
/// When one is malformed.
pub fn read(text: &[u8]) -> Read<Piece> {
    let mut piece = Piece::default();
    let mut rest = Rest(text);
    while !rest.0.is_empty() {
        piece.survey.lines += 1;
        rest.skip_blanks();
        match rest.0 {
            [b'v', next, ..] if next.is_ascii_whitespace() => {
                rest.skip(1);
                piece.positions.push(rest.position()?);
            }
            [b'v', b't', next, ..] if next.is_ascii_whitespace() => {
                rest.skip(2);
                piece.uvs.push(Vec2::new(rest.float()?, rest.float()?));
            }
            [b'v', b'n', next, ..] if next.is_ascii_whitespace() => {
                rest.skip(2);
                piece.normals.push(Vec3::new(rest.float()?, rest.float()?, rest.float()?));
            }
            [b'f', next, ..] if next.is_ascii_whitespace() => {
                rest.skip(1);
                piece.face(&mut rest)?;
            }
            _ => piece.other(rest.word())?,
        }
        rest.skip_line();
    }
    Ok(piece)
}

impl Piece {
    fn face(&mut self, rest: &mut Rest<'_>) -> Read<()> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let mut ends = [[LACKING; 3]; 2];
        let mut n = 0;
        while let Some(corner) = rest.corner(counts)? {
            self.survey.with_uv += usize::from(corner[1] != LACKING);
            self.survey.with_normal += usize::from(corner[2] != LACKING);
            if n >= 2 {
                self.corners.push([ends[0], ends[1], corner]);
            }
            ends[n.min(1)] = corner;
            n += 1;
        }
        self.survey.corners += n;
        self.survey.skipped += usize::from(n < 3);
        Ok(())
    }

    /// A line that starts with another word.
    fn other(&mut self, word: &[u8]) -> Read<()> {
        match word {
            b"" => {}
            b"v" | b"vt" | b"vn" => return Err(Malformed),
            b"l" | b"p" | b"f" => self.survey.skipped += 1,
            word if word.starts_with(b"#") || HARMLESS.contains(&word) => {}
            word => {
                let line = self.survey.lines;
                let word = || (line, String::from_utf8_lossy(word).into_owned());
                self.survey.unknown.get_or_insert_with(word);
            }
        }
        Ok(())
    }
}

/// What is left of the text.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn skip(&mut self, n: usize) {
        self.0 = &self.0[n..];
    }

    fn skip_blanks(&mut self) {
        while let [b' ' | b'\t' | b'\r' | b'\x0c', rest @ ..] = self.0 {
            self.0 = rest;
        }
    }

    /// Goes on with the next line.
    fn skip_line(&mut self) {
        let end = self.0.iter().position(|b| *b == b'\n');
        self.0 = end.map_or(&[], |end| &self.0[end + 1..]);
    }

    /// Whether a word ends here.
    fn is_at_end_of_word(&self) -> bool {
        self.0.first().is_none_or(u8::is_ascii_whitespace)
    }

    /// Skips blanks; whether the line, or what of it is no comment, ends here.
    fn is_at_end_of_line(&mut self) -> bool {
        self.skip_blanks();
        matches!(self.0, [] | [b'\n' | b'#', ..])
    }

    /// The word that starts here; it may be empty.
    fn word(&self) -> &'a [u8] {
        let end = self.0.iter().position(u8::is_ascii_whitespace);
        &self.0[..end.unwrap_or(self.0.len())]
    }

    fn float(&mut self) -> Read<f32> {
        self.skip_blanks();
        let (value, length) = fast_float2::parse_partial(self.0).map_err(|_| Malformed)?;
        self.skip(length);
        if self.is_at_end_of_word() { Ok(value) } else { Err(Malformed) }
    }

    /// Three coordinates, which may be followed by a weight to divide them by or by a colour, which is ignored as in
    /// Mitsuba.
    fn position(&mut self) -> Read<Vec3> {
        let position = Vec3::new(self.float()?, self.float()?, self.float()?);
        if self.is_at_end_of_line() {
            return Ok(position);
        }
        let first = self.word();
        let mut more = 0;
        while !self.is_at_end_of_line() {
            self.skip(self.word().len());
            more += 1;
        }
        match more {
            1 => match fast_float2::parse::<f32, _>(first) {
                Ok(weight) if weight != 0.0 => Ok(position / weight),
                _ => Err(Malformed),
            },
            3 => Ok(position),
            _ => Err(Malformed),
        }
    }

    /// The next corner of a face, if there is one. `counts` entries of each kind are before it in the piece.
    #[inline]
    fn corner(&mut self, counts: [usize; 3]) -> Read<Option<Corner>> {
        if self.is_at_end_of_line() {
            return Ok(None);
        }
        let mut corner = [self.index(counts[0])?, LACKING, LACKING];
        if corner[0] == LACKING {
            return Err(Malformed);
        }
        for i in 1..3 {
            if let [b'/', rest @ ..] = self.0 {
                self.0 = rest;
                corner[i] = self.index(counts[i])?;
            }
        }
        if self.is_at_end_of_word() { Ok(Some(corner)) } else { Err(Malformed) }
    }

    /// The index that starts here, or [`LACKING`] where there is none.
    #[inline]
    fn index(&mut self, count: usize) -> Read<i64> {
        let sign = self.0.first().copied().filter(|b| matches!(b, b'-' | b'+'));
        if sign.is_some() {
            self.skip(1);
        }
        let mut value = 0i64;
        let mut digits = 0;
        while let [digit @ b'0'..=b'9', rest @ ..] = self.0 {
            value = value * 10 + i64::from(digit - b'0');
            digits += 1;
            self.0 = rest;
            // No file has so many entries, leading zeros aside.
            if value > i64::from(u32::MAX) {
                return Err(Malformed);
            }
        }
        match (sign, digits, value) {
            (None, 0, _) => Ok(LACKING),
            (_, 0, _) | (_, _, 0) => Err(Malformed),
            (Some(b'-'), ..) => Ok(RELATIVE + count as i64 - value),
            _ => Ok(value - 1),
        }
    }
}
