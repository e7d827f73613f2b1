//! Triangle meshes from files: reading, checking, and computing missing vertex normals.

mod normals;
mod obj;
mod ply;
mod serialized;

use crate::error::{Error, Result, counted};
use crate::math::{DAffine3, DVec3, Vec3};
use crate::memory::{Budget, Refusal, Reservation};
use crate::shape::Mesh;
pub use obj::{Named, Survey};
use rayon::prelude::*;
use std::path::Path;

/// Formats of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// Stanford PLY.
    Ply,
    /// Mitsuba's serialized format.
    Serialized {
        /// Index of the mesh in the file.
        shape_index: usize,
    },
}

/// The options of a mesh in the scene file.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Whether the mesh is faceted: normals are neither read nor computed.
    pub face_normals: bool,
    /// Whether v of the texture coordinates is replaced by 1 − v.
    pub flip_tex_coords: bool,
}

/// Reads a mesh. Returns it with the survey of an OBJ file; for other formats, the survey is empty.
///
/// Polygons are split into fans. Missing and invalid vertex normals are computed, unless the mesh is faceted. They are
/// computed in world space, as in Mitsuba, so they depend on `to_world` if it is not a similarity. Vertices that no
/// face uses are accepted. Adds a warning for everything that is ignored or repaired.
///
/// # Errors
/// If the file cannot be read or is malformed (with the line, if it is text), a face refers to a vertex that does not
/// exist, the file has no face, or the mesh does not fit into memory.
pub fn load(
    path: &Path,
    format: Format,
    options: Options,
    to_world: &DAffine3,
    memory: &Budget,
    warnings: &mut Vec<Error>,
) -> Result<(Mesh, Survey)> {
    let mut planned = memory.nothing();
    let (mut mesh, face_normals, survey) = read(path, format, options, &mut planned, warnings)?;
    if mesh.indices.is_empty() {
        return Err(Error::scene("the file has no faces").in_file(path));
    }
    let broken = mesh.positions.par_iter().filter(|p| !p.is_finite()).count();
    if broken > 0 {
        let vertices = counted(mesh.positions.len() as u64, "vertex", "vertices");
        let message = format!("{broken} of {vertices}: not finite; their faces are dropped");
        warnings.push(Error::scene(message).in_file(path));
    }
    if options.flip_tex_coords {
        mesh.uvs.par_iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
    }
    match face_normals {
        true => mesh.normals = Vec::new(),
        false => {
            planned.grow(NORMAL_BYTES * mesh.positions.len() as u64).map_err(|r| too_large(path, &r))?;
            complete_normals(&mut mesh, to_world, path, warnings);
        }
    }
    planned.keep(mesh.memory_bytes());
    Ok((mesh, survey))
}

/// The bytes of each vertex while its normal is computed: those of the normal and of the sum of weighted normals.
const NORMAL_BYTES: u64 = (size_of::<Vec3>() + size_of::<DVec3>()) as u64;

/// Reads the file. Returns the mesh, whether it is faceted, and the names of materials in an OBJ file.
fn read(
    path: &Path,
    format: Format,
    options: Options,
    planned: &mut Reservation,
    warnings: &mut Vec<Error>,
) -> Result<(Mesh, bool, Survey)> {
    let memory = planned.budget().clone();
    Ok(match format {
        Format::Obj => {
            let (mesh, survey) = obj::read(path, planned, warnings)?;
            (mesh, options.face_normals, survey)
        }
        Format::Ply => {
            let (bytes, _reserved) = super::read_bytes(path, &memory)?;
            (ply::parse(path, &bytes, planned, warnings)?, options.face_normals, Survey::default())
        }
        Format::Serialized { shape_index } => {
            let (bytes, _reserved) = super::read_bytes(path, &memory)?;
            let read = serialized::parse(path, &bytes, shape_index, planned)?;
            // Mitsuba 3.9.1 documents this flag and ignores it; Mitsuba 0.6 applies it.
            (read.mesh, options.face_normals || read.face_normals, Survey::default())
        }
    })
}

/// Returns the error for a mesh that does not fit into memory.
fn too_large(path: &Path, refusal: &Refusal) -> Error {
    Error::scene(refusal.sentence("its mesh", "use a mesh of fewer triangles")).in_file(path)
}

/// Normalises the vertex normals, and computes the missing and invalid ones.
pub fn complete_normals(mesh: &mut Mesh, to_world: &DAffine3, path: &Path, warnings: &mut Vec<Error>) {
    if mesh.normals.is_empty() {
        mesh.normals = normals::compute(mesh, to_world);
        return;
    }
    let normalize = |(i, n): (usize, &mut Vec3)| match n.as_dvec3().try_normalize() {
        Some(unit) => {
            *n = unit.as_vec3();
            None
        }
        None => Some(i),
    };
    let invalid: Vec<usize> = mesh.normals.par_iter_mut().enumerate().filter_map(normalize).collect();
    if !invalid.is_empty() {
        let computed = normals::compute(mesh, to_world);
        for i in &invalid {
            mesh.normals[*i] = computed[*i];
        }
        let message = format!(
            "{} of {} vertex normals are zero or not finite; they are computed",
            invalid.len(),
            mesh.normals.len()
        );
        warnings.push(Error::scene(message).in_file(path));
    }
}
