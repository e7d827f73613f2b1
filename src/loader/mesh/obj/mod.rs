//! Wavefront OBJ files.
//!
//! `tobj` parses the lines that [`screen`] passes on. [`fast`] reads files of at least [`FAST_BYTES`] instead, if they
//! have no unusual line, and makes the same mesh. Objects, groups and smoothing groups are ignored, as in Mitsuba: a
//! file is one mesh. [`Survey`] lists the names of materials, for a mesh that is loaded without a scene.

mod assembly;
mod fast;
mod screen;
#[cfg(test)]
mod tests;
mod weld;

use crate::error::{Error, Place, Result, counted};
use crate::math::{Vec2, Vec3};
use crate::memory::{Refusal, Reservation};
use crate::shape::Mesh;
use crate::util::wording::quoted;
use assembly::Assembly;
use screen::Screen;
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

/// The size in bytes of the smallest file that the fast path reads.
const FAST_BYTES: u64 = 8 << 20;
/// The number of entries or corners at which reading stops: half the range of the `u32` that numbers them.
const MOST: usize = 1 << 31;
/// The options with which `tobj` returns all faces as one model, and separate indices of positions, texture coordinates
/// and normals. [`Assembly`] turns these indices into vertices.
const OPTIONS: tobj::LoadOptions =
    tobj::LoadOptions { single_index: false, triangulate: true, ignore_points: true, ignore_lines: true };

/// A name and its line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Named {
    /// The number of the line, from 1.
    pub line: u32,
    /// The name.
    pub name: String,
}

/// The counts of a file's entries, and the names of its MTL files and materials.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Survey {
    lines: u32,
    /// The numbers of positions, texture coordinates and normals.
    entries: [usize; 3],
    corners: usize,
    /// The number of corners with a texture coordinate, and the number of corners with a normal.
    with: [usize; 2],
    triangles: usize,
    /// The number of points, lines and faces of fewer than three vertices, which are ignored.
    skipped: usize,
    /// The first line with an unknown keyword.
    unknown: Option<Named>,
    /// The names of MTL files (`mtllib`).
    pub libraries: Vec<Named>,
    /// The materials (`usemtl`), each with the index of the first triangle after its line.
    pub materials: Vec<(usize, Named)>,
}

impl Survey {
    /// Appends the survey of the lines that follow.
    fn append(&mut self, next: Survey) {
        let moved = |named: Named| Named { line: self.lines + named.line, ..named };
        self.libraries.extend(next.libraries.into_iter().map(moved));
        let materials = next.materials.into_iter();
        self.materials.extend(materials.map(|(first, named)| (self.triangles + first, moved(named))));
        if self.unknown.is_none() {
            self.unknown = next.unknown.map(moved);
        }
        self.lines += next.lines;
        self.corners += next.corners;
        self.triangles += next.triangles;
        self.skipped += next.skipped;
        (0..3).for_each(|i| self.entries[i] += next.entries[i]);
        (0..2).for_each(|i| self.with[i] += next.with[i]);
    }

    /// Adds the name after the keyword `mtllib` or `usemtl`. Returns `false` for any other keyword.
    fn add_name(&mut self, keyword: &[u8], rest: &[u8]) -> bool {
        let named = || Named { line: self.lines, name: String::from_utf8_lossy(rest).trim().to_owned() };
        match keyword {
            b"mtllib" => self.libraries.push(named()),
            b"usemtl" => self.materials.push((self.triangles, named())),
            _ => return false,
        }
        true
    }

    /// Returns whether texture coordinates and whether normals are used. They are used if the file has some and every
    /// corner refers to one.
    fn used(&self) -> [bool; 2] {
        [0, 1].map(|i| self.corners > 0 && self.with[i] == self.corners && self.entries[i + 1] > 0)
    }

    /// Returns the bytes of the names.
    fn memory_bytes(&self) -> u64 {
        let names = self.libraries.iter().chain(self.materials.iter().map(|(_, named)| named));
        let lists = self.libraries.capacity() * size_of::<Named>()
            + self.materials.capacity() * size_of::<(usize, Named)>();
        lists as u64 + names.map(|named| named.name.capacity() as u64).sum::<u64>()
    }
}

/// The reason why reading a file stops early.
#[derive(Debug)]
pub enum Stop {
    /// The file cannot be read.
    Io(io::Error),
    /// The mesh does not fit into memory.
    Memory(Refusal),
    /// A line is wrong: its number (0 if unknown), its text, and the error message.
    Line(u32, String, String),
    /// The fast path does not support the file, or its vertices exceed the range of `u32`.
    Unusual,
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

impl Stop {
    fn error(self, path: &Path) -> Error {
        match self {
            Stop::Io(error) => crate::loader::unreadable(path, &error),
            Stop::Memory(refusal) => super::too_large(path, &refusal),
            Stop::Line(0, _, message) => Error::scene(message).in_file(path),
            Stop::Line(line, text, message) => {
                Error::scene(message).at(Place { line, column: 1, text, ..Place::file(path) })
            }
            Stop::Unusual => Error::scene("the mesh has too many vertices").in_file(path),
        }
    }
}

/// Reads a mesh. Texture coordinates are used if every corner of every face has one, and so are normals.
///
/// # Errors
/// See [`load`](super::load).
pub fn read(path: &Path, planned: &mut Reservation, warnings: &mut Vec<Error>) -> Result<(Mesh, Survey)> {
    let open = || File::open(path).map_err(|e| crate::loader::unreadable(path, &e));
    let file = open()?;
    let mut made = None;
    if file.metadata().is_ok_and(|about| about.len() >= FAST_BYTES) {
        let mut own = planned.budget().nothing();
        match fast::read(&file, fast::USUAL, &mut own) {
            Ok(read) => {
                *planned = own;
                made = Some(read);
            }
            Err(Stop::Unusual) => {}
            Err(stop) => return Err(stop.error(path)),
        }
    }
    let (mesh, survey) = match made {
        Some(made) => made,
        None => through_tobj(BufReader::new(open()?), planned).map_err(|stop| stop.error(path))?,
    };
    report(&survey, path, warnings);
    Ok((mesh, survey))
}

/// Reads a mesh with `tobj`.
fn through_tobj(from: impl BufRead, planned: &mut Reservation) -> Result<(Mesh, Survey), Stop> {
    let mut screen = Screen::new(from, planned);
    let read = tobj::load_obj_buf(&mut screen, &OPTIONS, |_| Err(tobj::LoadError::GenericFailure));
    let survey = screen.finish(read.as_ref().err())?;
    let models = read.map(|(models, _)| models).unwrap_or_default();
    let Some(mesh) = models.into_iter().next().map(|model| model.mesh) else {
        return Ok((Mesh::default(), survey));
    };
    let used = survey.used();
    let vectors = |numbers: &[f32]| numbers.as_chunks::<3>().0.iter().map(|v| Vec3::from(*v)).collect();
    let mut assembly = Assembly {
        positions: vectors(&mesh.positions),
        uvs: mesh.texcoords.as_chunks::<2>().0.iter().map(|v| Vec2::from(*v)).collect(),
        normals: vectors(&mesh.normals),
        ..Assembly::default()
    };
    assembly.weld.set_positions(assembly.positions.len());
    let column = |used: bool, indices: &[u32], i: usize| match used {
        true => indices.get(i).copied().unwrap_or(weld::NONE),
        false => weld::NONE,
    };
    let key = |i: usize| {
        let [uv, normal] = [(used[0], &mesh.texcoord_indices), (used[1], &mesh.normal_indices)]
            .map(|(used, indices)| column(used, indices, i));
        [mesh.indices[i], uv, normal]
    };
    assembly.indices = (0..mesh.indices.len() / 3)
        .map(|t| [0, 1, 2].map(|k| assembly.weld.vertex(key(3 * t + k))))
        .collect();
    assembly.survey = survey;
    assembly.finish(planned)
}

/// Adds a warning for each kind of line or entry that is ignored.
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
    if some(survey.with[0]) {
        warn("some corners of faces have no texture coordinates, so none are used".to_owned(), 0);
    }
    if some(survey.with[1]) {
        warn("some corners of faces have no normals, so all are computed".to_owned(), 0);
    }
    if let Some(Named { line, name }) = &survey.unknown {
        warn(format!("lines that start with {} are ignored", quoted(name)), *line);
    }
}
