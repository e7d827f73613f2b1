//! A mesh without a scene: framed by a camera, in an even white light, of a grey material.

use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::ids::MaterialId;
use crate::loader::mesh::{self, Format};
use crate::loader::{Loaded, framing};
use crate::material::{Diffuse, TwoSided};
use crate::math::DAffine3;
use crate::memory::Budget;
use crate::scene::description::{Description, PlacedShape};
use crate::shape::Shape;
use std::path::Path;

/// Loads a mesh file as a scene.
///
/// # Errors
/// As for [`mesh::load`]; a mesh without finite extent.
pub fn load(path: &Path, memory: &Budget) -> Result<Loaded> {
    let is_obj = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj"));
    let format = if is_obj { Format::Obj } else { Format::Ply };
    let options = mesh::Options { face_normals: false, flip_tex_coords: is_obj };
    let mut loaded = Loaded::default();
    let mesh = mesh::load(path, format, options, &DAffine3::IDENTITY, memory, &mut loaded.warnings)?;
    let used = mesh.indices.iter().flatten().map(|i| mesh.positions[*i as usize].as_dvec3());
    let sensor = framing::camera(used).ok_or_else(|| Error::scene("the mesh has no extent").in_file(path))?;
    let name = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let shape = PlacedShape {
        name,
        place: None,
        shape: Shape::Mesh(mesh),
        to_world: DAffine3::IDENTITY.into(),
        flip_normals: false,
        material: MaterialId(1),
        emission: None,
    };
    loaded.description = Description {
        groups: Vec::new(),
        instances: Vec::new(),
        shapes: vec![shape],
        materials: vec![
            Diffuse { reflectance: Rgb::splat(0.5).into() }.into(),
            TwoSided::same(MaterialId(0)).into(),
        ],
        textures: Vec::new(),
        emitters: vec![framing::white_environment()],
        sensors: vec![sensor],
    };
    loaded.notes.push(
        "a mesh alone: it is grey, in an even white light, and seen from the front and above (y is up, z to the viewer)"
            .to_owned(),
    );
    Ok(loaded)
}
