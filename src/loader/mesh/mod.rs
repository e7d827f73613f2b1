//! Triangle meshes from files: reading, checking, and the vertex normals that a file lacks.

mod normals;
mod obj;
mod ply;
mod serialized;

use crate::error::{Error, Result, counted};
use crate::math::{DAffine3, Vec3};
use crate::shape::Mesh;
use rayon::prelude::*;
use std::fs::File;
use std::path::Path;

/// Formats of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// Stanford PLY.
    Ply,
    /// Mitsuba's own format.
    Serialized {
        /// Which of the file's meshes.
        shape_index: usize,
    },
}

/// What the scene asks of a mesh.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Whether the mesh is faceted: normals are neither read nor computed.
    pub face_normals: bool,
    /// Whether v of the texture coordinates is turned upside down.
    pub flip_tex_coords: bool,
}

/// Reads a mesh.
///
/// Polygons are split into fans. Where the file has no vertex normals (or invalid ones) and the mesh is not faceted,
/// they are computed in the world, as Mitsuba does, so `to_world` matters where it is no similarity. Vertices that no
/// face uses are of no harm. What had to be ignored or mended is added to `warnings`.
///
/// # Errors
/// When the file cannot be read or is malformed (with the line, where it is text), when a face refers to a vertex that does
/// not exist, or when there is no face.
pub fn load(
    path: &Path,
    format: Format,
    options: Options,
    to_world: &DAffine3,
    warnings: &mut Vec<Error>,
) -> Result<Mesh> {
    let mut face_normals = options.face_normals;
    let mut mesh = match format {
        Format::Obj => File::open(path)
            .map_err(obj::Failure::Io)
            .and_then(|file| obj::parse(path, file, || std::fs::read(path), obj::Sizes::USUAL, warnings))
            .map_err(|failure| match failure {
                obj::Failure::Io(e) => super::unreadable(path, &e),
                obj::Failure::Mesh(error) => error,
            })?,
        Format::Ply => ply::parse(path, &super::read_bytes(path)?, warnings)?,
        Format::Serialized { shape_index } => {
            let read = serialized::parse(path, &super::read_bytes(path)?, shape_index)?;
            // Mitsuba 3.9.1 documents this flag and ignores it; Mitsuba 0.6 obeys it.
            face_normals |= read.face_normals;
            read.mesh
        }
    };
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
        false => complete_normals(&mut mesh, to_world, path, warnings),
    }
    Ok(mesh)
}

/// Normalises the normals, and computes those that are missing or invalid.
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
