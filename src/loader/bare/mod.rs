//! Scenes made of one mesh file. A camera frames the mesh. The materials come from its MTL files; without them, the
//! mesh is grey. A constant white environment lights the mesh, unless one of its materials emits light.

mod materials;
mod mtl;
mod parts;
mod textures;

use super::mesh::{self, Format, Named};
use super::{Loaded, files::Folders, framing};
use crate::color::Rgb;
use crate::error::{Error, Place, Result};
use crate::image::TextureImage;
use crate::material::{Diffuse, TwoSided};
use crate::math::DAffine3;
use crate::medium::MediumBoundary;
use crate::memory::Budget;
use crate::scene::description::PlacedShape;
use crate::shape::Shape;
use crate::texture::Texture;
use materials::Surface;
use mtl::Library;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use textures::{BitmapKey, Plane};

/// Loads a mesh file as a scene.
///
/// # Errors
/// As for [`mesh::load`], and if the mesh has no finite extent, or an MTL file or image exists but cannot be read.
pub fn load(path: &Path, search_paths: &[PathBuf], memory: &Budget) -> Result<Loaded> {
    let is_obj = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj"));
    let format = if is_obj { Format::Obj } else { Format::Ply };
    let options = mesh::Options { face_normals: false, flip_tex_coords: is_obj };
    let mut warnings = Vec::new();
    let (mesh, survey) = mesh::load(path, format, options, &DAffine3::IDENTITY, memory, &mut warnings)?;
    let used = mesh.indices.iter().flatten().map(|i| mesh.positions[*i as usize].as_dvec3());
    let sensor = framing::camera(used).ok_or_else(|| Error::scene("the mesh has no extent").in_file(path))?;
    let mut builder = Builder {
        path,
        folders: Folders::new(path, search_paths),
        memory,
        loaded: Loaded { warnings, ..Loaded::default() },
        library: Library::new(),
        surfaces: BTreeMap::new(),
        images: HashMap::new(),
        bitmaps: HashMap::new(),
    };
    builder.read_libraries(&survey.libraries)?;
    let has_materials = !builder.library.is_empty();
    let uses = if has_materials { &survey.materials[..] } else { &[] };
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    for part in parts::split(mesh, uses, path, memory)? {
        let surface = match &part.material {
            Some(material) => builder.surface(material)?,
            None => builder.grey(),
        };
        builder.loaded.description.shapes.push(PlacedShape {
            name: part.material.map_or_else(|| stem.clone(), |material| material.name),
            place: None,
            shape: Shape::Mesh(part.mesh),
            to_world: DAffine3::IDENTITY.into(),
            flip_normals: false,
            material: surface.material,
            emission: surface.emission,
            boundary: MediumBoundary::default(),
        });
    }
    let mut loaded = Loaded { files: builder.folders.found(), ..builder.loaded };
    let is_dark = loaded.description.shapes.iter().all(|shape| shape.emission.is_none());
    if is_dark {
        loaded.description.emitters.push(framing::white_environment());
    }
    loaded.description.sensors.push(sensor);
    loaded.notes.push(format!(
        "a mesh alone: it is {}, in {}, and seen from the front and above (y is up, z to the viewer)",
        if has_materials { "of the materials of its MTL files" } else { "grey" },
        if is_dark { "an even white light" } else { "the light of the front sides of its emitters (Ke)" },
    ));
    Ok(loaded)
}

/// The scene that is being made, and the parts of it that are made already.
struct Builder<'a> {
    path: &'a Path,
    folders: Folders,
    memory: &'a Budget,
    loaded: Loaded,
    library: Library,
    /// The surfaces by the name of their material; the empty name stands for the grey one.
    surfaces: BTreeMap<String, Surface>,
    images: HashMap<(PathBuf, Plane), Arc<TextureImage>>,
    bitmaps: HashMap<BitmapKey, Arc<Texture>>,
}

impl Builder<'_> {
    /// Adds a warning about a line of the mesh file.
    fn warn_at(&mut self, line: u32, message: String) {
        let place = Place { line, column: 1, ..Place::file(self.path) };
        self.loaded.warnings.push(Error::scene(message).at(place));
    }

    /// Returns the grey surface of triangles without a material.
    fn grey(&mut self) -> Surface {
        if let Some(surface) = self.surfaces.get("") {
            return *surface;
        }
        let grey = self.loaded.description.add_material(Diffuse { reflectance: Rgb::splat(0.5).into() });
        let surface =
            Surface { material: self.loaded.description.add_material(TwoSided::same(grey)), emission: None };
        self.surfaces.insert(String::new(), surface);
        surface
    }

    /// Returns the surface of a material that the mesh file names. A material that does not exist is grey.
    ///
    /// # Errors
    /// If an image exists but cannot be read.
    fn surface(&mut self, named: &Named) -> Result<Surface> {
        if let Some(surface) = self.surfaces.get(&named.name) {
            return Ok(*surface);
        }
        let surface = match self.library.get(&named.name).cloned() {
            Some(entry) => {
                let surface = self.make(&entry)?;
                self.loaded.description.name_material(surface.material, &named.name);
                surface
            }
            None => {
                let name = crate::util::wording::quoted(&named.name);
                self.warn_at(named.line, format!("its MTL files have no material {name}: it is grey"));
                self.grey()
            }
        };
        self.surfaces.insert(named.name.clone(), surface);
        Ok(surface)
    }
}
