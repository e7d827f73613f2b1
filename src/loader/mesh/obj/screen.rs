//! The filter between an OBJ file and `tobj`. It counts entries and checks indices.
//!
//! `tobj` does not report line numbers. It splits meshes at groups and materials, fills in missing indices of corners,
//! reads points as faces, and computes with indices before it checks them. Therefore this filter passes on one line at
//! a time, and only vertices and faces, without comments and with indices in the range of `u32`.

use super::{MOST, Named, Stop, Survey};
use crate::memory::Reservation;
use crate::util::wording::quoted;
use std::io::{self, BufRead, Read};
use tobj::LoadError;

/// The greatest number of bytes of a line that are read at once.
const CHUNK: u64 = 1 << 20;
/// The number of lines between two checks of the memory budget.
const LINES: u32 = 1 << 10;
/// The bytes of an entry: in the lists of `tobj`, in its copies in the order of use and its hash maps, and in the lists
/// of [`Assembly`](super::assembly::Assembly).
const ENTRY_BYTES: u64 = 128;
/// The bytes of a face, in `tobj` and here.
const FACE_BYTES: u64 = 216;
/// The bytes of a corner of a face, in `tobj` and here.
const CORNER_BYTES: u64 = 64;

const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// A reader that returns the lines that `tobj` needs.
pub struct Screen<'p, R> {
    from: R,
    planned: &'p mut Reservation,
    survey: Survey,
    /// For each kind of entry, the greatest index and its line.
    greatest: [(u64, u32); 3],
    faces: u64,
    /// An error that this reader found and `tobj` cannot describe.
    stop: Option<Stop>,
    /// The last line of the file that was read.
    raw: Vec<u8>,
    /// The current line for `tobj`.
    line: Vec<u8>,
    /// The number of bytes of `line` that `tobj` has read.
    at: usize,
}

impl<'p, R: BufRead> Screen<'p, R> {
    pub fn new(from: R, planned: &'p mut Reservation) -> Self {
        Screen {
            from,
            planned,
            survey: Survey::default(),
            greatest: [(0, 0); 3],
            faces: 0,
            stop: None,
            raw: Vec::new(),
            line: Vec::new(),
            at: 0,
        }
    }

    /// Returns the survey of the file. `error` is the error of `tobj`, if it stopped with one.
    ///
    /// # Errors
    /// The error that this reader or `tobj` found, with its line.
    pub fn finish(self, error: Option<&LoadError>) -> Result<Survey, Stop> {
        let Some(error) = error else { return Ok(self.survey) };
        if let Some(stop) = self.stop {
            return Err(stop);
        }
        let missing = |kind: usize| {
            let ((index, line), entries) = (self.greatest[kind], self.survey.entries[kind]);
            let message = format!("there is no {} {index}; the file has {entries}", KINDS[kind]);
            Stop::Line(line, String::new(), message)
        };
        let text = String::from_utf8_lossy(&self.raw).trim_end().to_owned();
        let rest = text.split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim());
        let message = match error {
            LoadError::FaceVertexOutOfBounds => return Err(missing(0)),
            LoadError::FaceTexCoordOutOfBounds => return Err(missing(1)),
            LoadError::FaceNormalOutOfBounds => return Err(missing(2)),
            LoadError::PositionParseError | LoadError::ColorParseError => {
                format!("expected 3 numbers (4 with a weight, 6 with a colour), found {}", quoted(rest))
            }
            LoadError::NormalParseError => format!("expected 3 numbers, found {}", quoted(rest)),
            LoadError::TexcoordParseError => format!("expected 2 numbers, found {}", quoted(rest)),
            LoadError::ScalingByZeroError => "the weight of the vertex is 0".to_owned(),
            LoadError::FaceParseError => {
                format!("expected corners such as 1, 1/1, 1//1 or 1/1/1, found {}", quoted(rest))
            }
            other => other.to_string(),
        };
        Err(Stop::Line(self.survey.lines, text, message))
    }

    /// Advances to the next line for `tobj`, or to the end of the file.
    fn advance(&mut self) -> Result<(), Stop> {
        self.at = 0;
        self.line.clear();
        while self.line.is_empty() && self.read_line()? {
            self.survey.lines = self.survey.lines.saturating_add(1);
            if self.survey.lines.is_multiple_of(LINES) {
                self.plan()?;
            }
            let raw = std::mem::take(&mut self.raw);
            let passed = self.pass(&String::from_utf8_lossy(&raw));
            self.raw = raw;
            passed?;
        }
        if self.line.is_empty() { self.plan() } else { Ok(()) }
    }

    /// Reads a line of any length. Returns `false` at the end of the file.
    fn read_line(&mut self) -> Result<bool, Stop> {
        self.raw.clear();
        loop {
            let read = self.from.by_ref().take(CHUNK).read_until(b'\n', &mut self.raw)? as u64;
            if read < CHUNK || self.raw.ends_with(b"\n") {
                return Ok(!self.raw.is_empty());
            }
            // For the text, its words and their copies.
            self.planned.grow(6 * CHUNK)?;
        }
    }

    /// Reserves the memory that `tobj` and [`Assembly`](super::assembly::Assembly) take for the lines read so far.
    fn plan(&mut self) -> Result<(), Stop> {
        let entries = self.survey.entries.iter().sum::<usize>();
        if entries.max(self.survey.corners) > MOST {
            return Err(Stop::Line(0, String::new(), "the mesh has too many vertices".to_owned()));
        }
        let bytes = ENTRY_BYTES * entries as u64
            + FACE_BYTES * self.faces
            + CORNER_BYTES * self.survey.corners as u64
            + self.survey.memory_bytes();
        Ok(self.planned.grow_to(bytes)?)
    }

    /// Counts the contents of a line, and passes it to `tobj` if it is a vertex or a face of three corners or more.
    fn pass(&mut self, text: &str) -> Result<(), Stop> {
        let mut words = text.split_whitespace().take_while(|word| !word.starts_with('#'));
        let Some(keyword) = words.next() else { return Ok(()) };
        match keyword {
            "v" | "vt" | "vn" => {
                self.survey.entries[["v", "vt", "vn"].iter().position(|k| *k == keyword).unwrap_or(0)] += 1;
                // Colours are ignored, as in Mitsuba. `tobj` expects one at every vertex or at none.
                let colored = keyword == "v" && words.clone().count() == 6;
                self.give(keyword, words.take(if colored { 3 } else { usize::MAX }));
            }
            "f" => {
                let corners = words.clone().count();
                let number = self.survey.lines;
                for corner in words.clone() {
                    let line = |message| Stop::Line(number, text.trim_end().to_owned(), message);
                    self.corner(corner).map_err(line)?;
                }
                self.survey.corners += corners;
                self.survey.triangles += corners.saturating_sub(2);
                self.survey.skipped += usize::from(corners < 3);
                if corners >= 3 {
                    self.faces += 1;
                    self.give(keyword, words);
                }
            }
            "l" | "p" => self.survey.skipped += 1,
            "g" | "o" | "s" => {}
            _ => {
                let rest = text.trim_start().strip_prefix(keyword).unwrap_or_default();
                if !self.survey.add_name(keyword.as_bytes(), rest.as_bytes()) && self.survey.unknown.is_none()
                {
                    self.survey.unknown = Some(Named { line: self.survey.lines, name: keyword.to_owned() });
                }
            }
        }
        Ok(())
    }

    /// Passes a line to `tobj`.
    fn give<'t>(&mut self, keyword: &str, words: impl Iterator<Item = &'t str>) {
        self.line.extend_from_slice(keyword.as_bytes());
        for word in words {
            self.line.push(b' ');
            self.line.extend_from_slice(word.as_bytes());
        }
        self.line.push(b'\n');
    }

    /// Checks that the indices of a corner are in the range in which `tobj` computes. An index that is not a number is
    /// left to `tobj`, which reports it.
    fn corner(&mut self, corner: &str) -> Result<(), String> {
        let mut has_position = false;
        for (i, part) in corner.split('/').enumerate().take(3) {
            if part.is_empty() {
                continue;
            }
            let Ok(index) = part.parse::<i64>() else { return Ok(()) };
            let before = self.survey.entries[i] as u64;
            let size = index.unsigned_abs();
            if index == 0 || size > u64::from(u32::MAX) || (index < 0 && size > before) {
                return Err(format!("there is no {} {index}; {before} come before this line", KINDS[i]));
            }
            if index > 0 && size > self.greatest[i].0 {
                self.greatest[i] = (size, self.survey.lines);
            }
            match i {
                0 => has_position = true,
                _ => self.survey.with[i - 1] += 1,
            }
        }
        match has_position {
            true => Ok(()),
            false => {
                Err(format!("expected a corner such as 1, 1/1, 1//1 or 1/1/1, found {}", quoted(corner)))
            }
        }
    }
}

impl<R: BufRead> Read for Screen<'_, R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(into)?;
        self.consume(read);
        Ok(read)
    }
}

impl<R: BufRead> BufRead for Screen<'_, R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.at == self.line.len()
            && let Err(stop) = self.advance()
        {
            self.stop = Some(stop);
            return Err(io::Error::other("see `stop`"));
        }
        Ok(&self.line[self.at..])
    }

    fn consume(&mut self, bytes: usize) {
        self.at += bytes;
    }
}
