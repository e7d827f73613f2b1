//! A mesh without a scene: framed by a camera, in an even white light, of a grey material.

use crate::color::Rgb;
use crate::emitter::Emitter;
use crate::error::{Error, Result};
use crate::film::FilmSettings;
use crate::ids::MaterialId;
use crate::loader::mesh::{self, Format};
use crate::loader::{Loaded, transform};
use crate::material::Material;
use crate::math::{DAffine3, DVec3};
use crate::scene::description::{Description, PlacedShape};
use crate::sensor::{FovAxis, Projection, SensorSettings};
use crate::shape::{Mesh, Shape};
use std::path::Path;

/// The camera's field of view across the smaller side of the image, degrees.
const FOV_DEG: f64 = 35.0;
/// From the mesh to the camera: y is up, z towards the viewer.
const TO_CAMERA: DVec3 = DVec3::new(0.35, 0.45, 1.0);
/// Room around the mesh, as a factor on the camera's distance.
const MARGIN: f64 = 1.05;

/// Loads a mesh file as a scene.
///
/// # Errors
/// As for [`mesh::load`]; a mesh without finite extent.
pub fn load(path: &Path) -> Result<Loaded> {
    let is_obj = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj"));
    let format = if is_obj { Format::Obj } else { Format::Ply };
    let options = mesh::Options { face_normals: false, flip_tex_coords: is_obj };
    let mut loaded = Loaded::default();
    let mesh = mesh::load(path, format, options, &DAffine3::IDENTITY, &mut loaded.warnings)?;
    let sensor = camera(&mesh).ok_or_else(|| Error::scene("the mesh has no extent").in_file(path))?;
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
            Material::Diffuse { reflectance: Rgb::splat(0.5).into() },
            Material::TwoSided([MaterialId(0); 2]),
        ],
        textures: Vec::new(),
        emitters: vec![Emitter::Constant { radiance: Rgb::WHITE }],
        sensors: vec![sensor],
    };
    loaded.notes.push(
        "a mesh alone: it is grey, in an even white light, and seen from the front and above (y is up, z to the viewer)"
            .to_owned(),
    );
    Ok(loaded)
}

/// A camera that sees the sphere around the mesh's bounding box; `None` where the box is empty or infinite.
fn camera(mesh: &Mesh) -> Option<SensorSettings> {
    let used = mesh.indices.iter().flatten().map(|i| mesh.positions[*i as usize].as_dvec3());
    let finite = used.filter(|p| p.is_finite());
    let (low, high) = finite.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
    let radius = 0.5 * (high - low).length();
    if !(radius > 0.0 && radius.is_finite()) {
        return None;
    }
    let fov = FOV_DEG.to_radians();
    let distance = MARGIN * radius / (0.5 * fov).sin();
    let direction = -TO_CAMERA.normalize();
    let left = DVec3::Y.cross(direction).normalize();
    Some(SensorSettings {
        name: String::new(),
        to_world: transform::frame(0.5 * (low + high) - distance * direction, left, direction).into(),
        projection: Projection::Perspective {
            fov,
            fov_axis: FovAxis::Smaller,
            principal_point_offset: [0.0; 2],
        },
        lens: None,
        shutter: [0.0; 2],
        near_clip: 1e-3 * distance,
        far_clip: 1e3 * distance,
        film: FilmSettings::default(),
    })
}
