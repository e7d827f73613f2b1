//! glTF 2.0: scenes of triangles as modelling programs export them, as text (`.gltf`) or in one binary file (`.glb`).
//!
//! [`file`] reads and checks the file. [`Builder`] traverses the nodes of its scene and converts meshes, materials,
//! lights and cameras to the scene's plain data.

mod accessors;
mod cameras;
mod file;
mod lights;
mod materials;
mod meshes;
mod textures;
mod uri;

use super::{Loaded, framing};
use crate::error::Result;
use crate::image::{TextureImage, TextureLayers};
use crate::integrator::Settings;
use crate::integrator::settings::PathLimits;
use crate::math::{DAffine3, DMat4, DQuat, DVec3};
use crate::memory::Budget;
use crate::scene::description::{Description, PlacedGroup, PlacedShape};
use crate::shape::Shape;
use crate::texture::Texture;
use file::File;
use gltf::mesh::Semantic;
use gltf::scene::Transform;
use gltf::{Document, Node};
use materials::{Surface, VertexColors};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use textures::Plane;

/// Loads the default scene of a file, or its first scene if there is no default.
///
/// # Errors
/// If the file cannot be read, is malformed or out of range, requires what is not supported, or does not fit into
/// memory. All missing files are in one error.
pub fn load(path: &Path, search_paths: &[PathBuf], memory: &Budget) -> Result<Loaded> {
    let mut loaded = Loaded::default();
    let mut file = File::open(path, search_paths, memory, &mut loaded.warnings)?;
    // The document is cloned, because the builder records missing files in `file`.
    let document = Document::clone(&file.document);
    let mut builder = Builder {
        file: &mut file,
        loaded,
        uses: HashMap::new(),
        groups: HashMap::new(),
        meshes: HashMap::new(),
        surfaces: HashMap::new(),
        images: HashMap::new(),
        planes: HashMap::new(),
        bitmaps: HashMap::new(),
    };
    builder.scene(&document)?;
    let mut loaded = builder.loaded;
    if !file.missing.is_empty() {
        let first = file.missing.remove(0);
        return Err(first.with_others(file.missing));
    }
    complete(&mut loaded, &file)?;
    Ok(Loaded { files: file.folders.found(), ..loaded })
}

/// A texture, a plane of its image, and the bits of the transformation of texture coordinates.
type BitmapKey = (usize, Plane, [u32; 6]);

/// A scene under construction.
struct Builder<'f> {
    file: &'f mut File,
    loaded: Loaded,
    /// The number of nodes that use each mesh.
    uses: HashMap<usize, usize>,
    /// For each mesh, the group of its shapes that do not emit, if there are any.
    groups: HashMap<usize, Option<usize>>,
    /// The shapes of each mesh.
    meshes: HashMap<usize, Arc<Vec<PlacedShape>>>,
    surfaces: HashMap<(Option<usize>, VertexColors), Surface>,
    images: HashMap<usize, Option<TextureLayers>>,
    planes: HashMap<(usize, Plane), Option<Arc<TextureImage>>>,
    bitmaps: HashMap<BitmapKey, Arc<Texture>>,
}

/// A node of the scene with its transformation.
struct PlacedNode<'d> {
    node: Node<'d>,
    to_world: DAffine3,
}

impl Builder<'_> {
    /// Adds a warning about a thing in the file.
    fn warn(&mut self, thing: &str, message: &str) {
        let warning = self.file.error(thing, message);
        if !self.loaded.warnings.contains(&warning) {
            self.loaded.warnings.push(warning);
        }
    }

    /// Adds a note unless it exists already.
    fn note(&mut self, text: &str) {
        if !self.loaded.notes.iter().any(|note| note == text) {
            self.loaded.notes.push(text.to_owned());
        }
    }

    /// Adds a note about what is not rendered as the file asks for, unless it exists already.
    fn approximate(&mut self, text: &str) {
        if !self.loaded.approximations.iter().any(|note| note == text) {
            self.loaded.approximations.push(text.to_owned());
        }
    }

    fn scene(&mut self, document: &Document) -> Result<()> {
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let Some(scene) = scene else { return Err(self.file.error("", "the file has no scene")) };
        let nodes = self.nodes(scene.nodes().collect(), document.nodes().len())?;
        if document.animations().len() > 0 {
            self.approximate("animations are not played: everything stands as the nodes say");
        }
        for placed in &nodes {
            if let Some(mesh) = placed.node.mesh() {
                *self.uses.entry(mesh.index()).or_default() += 1;
            }
        }
        for placed in &nodes {
            self.place(placed)?;
        }
        Ok(())
    }

    /// Returns the roots and all nodes below them, each before its children, in the file's order.
    ///
    /// # Errors
    /// If a node is reached twice, or its transformation is not finite.
    fn nodes<'d>(&mut self, roots: Vec<Node<'d>>, count: usize) -> Result<Vec<PlacedNode<'d>>> {
        let (mut reached, mut nodes) = (vec![false; count], Vec::new());
        let mut waiting: Vec<(Node, DAffine3)> = roots.into_iter().map(|n| (n, DAffine3::IDENTITY)).collect();
        waiting.reverse();
        while let Some((node, parent)) = waiting.pop() {
            let thing = format!("nodes[{}]", node.index());
            if std::mem::replace(&mut reached[node.index()], true) {
                let message = "it is inside itself or at two places, but nodes must form trees";
                return Err(self.file.error(thing, message));
            }
            let own = local(&node.transform()).map_err(|message| self.file.error(&*thing, message))?;
            let to_world = parent * own;
            if !to_world.is_finite() {
                return Err(self.file.error(thing, "its transformation is not finite"));
            }
            let first = waiting.len();
            waiting.extend(node.children().map(|child| (child, to_world)));
            waiting[first..].reverse();
            nodes.push(PlacedNode { node, to_world });
        }
        Ok(nodes)
    }

    /// Adds the camera, the emitter and the mesh of a node.
    fn place(&mut self, placed: &PlacedNode<'_>) -> Result<()> {
        let PlacedNode { node, to_world } = placed;
        let thing = format!("nodes[{}]", node.index());
        if let Some(camera) = node.camera() {
            let name = node.name().or(camera.name()).unwrap_or_default();
            self.camera(&camera, name, to_world)?;
        }
        if let Some(light) = node.light() {
            self.light(&light, to_world);
        }
        let Some(mesh) = node.mesh() else { return Ok(()) };
        if let Err(message) = framing::check_invertible(to_world) {
            self.warn(&thing, &format!("{message}; its mesh is left out"));
            return Ok(());
        }
        if node.skin().is_some() {
            self.warn(&thing, "skins are not supported: its mesh stands as it was modelled");
        }
        let shapes = self.shapes(&mesh)?;
        let mirrored = to_world.matrix3.determinant() < 0.0;
        let name = node.name().or(mesh.name()).unwrap_or_default().to_owned();
        let alone = self.uses.get(&mesh.index()) == Some(&1);
        if !alone && let Some(group) = self.group(mesh.index(), &shapes) {
            let (name, place) = (name.clone(), Some(self.file.place()));
            let instance = PlacedGroup { name, place, group, to_world: (*to_world).into() };
            self.loaded.description.instances.push(instance);
        }
        // The order of the vertices determines the front of a faceted mesh, and a mirror reverses that order.
        let placed = |shape: PlacedShape| PlacedShape {
            name: name.clone(),
            flip_normals: mirrored && is_faceted(&shape),
            to_world: (*to_world).into(),
            ..shape
        };
        let all = &mut self.loaded.description.shapes;
        if alone {
            self.meshes.remove(&mesh.index());
            all.extend(Arc::unwrap_or_clone(shapes).into_iter().map(placed));
        } else {
            let lit = || shapes.iter().filter(|shape| shape.emission.is_some());
            self.file.keep(lit().map(mesh_bytes).sum(), &thing, "placing its mesh once more")?;
            all.extend(lit().cloned().map(placed));
        }
        Ok(())
    }

    /// Returns the group of a mesh's shapes that do not emit. An instance that mirrors them keeps their front.
    fn group(&mut self, mesh: usize, shapes: &[PlacedShape]) -> Option<usize> {
        let groups = &mut self.loaded.description.groups;
        *self.groups.entry(mesh).or_insert_with(|| {
            let not_emitting = shapes.iter().filter(|shape| shape.emission.is_none());
            let members: Vec<PlacedShape> = not_emitting.cloned().collect();
            if members.is_empty() {
                return None;
            }
            groups.push(members);
            Some(groups.len() - 1)
        })
    }

    /// Returns the primitives of a mesh in its own coordinates. Each mesh is converted once.
    fn shapes(&mut self, mesh: &gltf::Mesh<'_>) -> Result<Arc<Vec<PlacedShape>>> {
        if let Some(shapes) = self.meshes.get(&mesh.index()) {
            return Ok(shapes.clone());
        }
        let mut shapes = Vec::new();
        for primitive in mesh.primitives() {
            let thing = format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index());
            if primitive.morph_targets().len() > 0 {
                self.warn(&thing, "morph targets are not supported: it stands as it was modelled");
            }
            let colors = primitive.get(&Semantic::Colors(0));
            let alpha = colors.as_ref().is_some_and(|colors| colors.dimensions().multiplicity() == 4);
            let vertex = VertexColors { color: colors.is_some(), alpha };
            let surface = self.surface(&primitive.material(), vertex)?;
            if let Some(mesh) = self.mesh(&primitive, &thing, surface.uv_set)? {
                shapes.push(PlacedShape {
                    name: String::new(),
                    place: Some(self.file.place()),
                    shape: Shape::Mesh(mesh),
                    to_world: DAffine3::IDENTITY.into(),
                    flip_normals: false,
                    material: surface.material,
                    emission: surface.emission,
                    boundary: surface.boundary,
                });
            }
        }
        let shapes = Arc::new(shapes);
        self.meshes.insert(mesh.index(), shapes.clone());
        Ok(shapes)
    }
}

/// Returns the bytes of a shape's mesh.
fn mesh_bytes(placed: &PlacedShape) -> u64 {
    match &placed.shape {
        Shape::Mesh(mesh) => mesh.memory_bytes(),
        _ => 0,
    }
}

fn is_faceted(placed: &PlacedShape) -> bool {
    matches!(&placed.shape, Shape::Mesh(mesh) if mesh.normals.is_empty())
}

/// Returns a node's own transformation.
fn local(transform: &Transform) -> Result<DAffine3, String> {
    match transform {
        Transform::Matrix { matrix } => {
            let m = DMat4::from_cols_array(
                &matrix.as_flattened().try_into().map_or([0.0; 16], |m: [f32; 16]| m.map(f64::from)),
            );
            if m.row(3) != DVec3::ZERO.extend(1.0) {
                return Err("expected a matrix with 0 0 0 1 in the last row".to_owned());
            }
            Ok(DAffine3::from_mat4(m))
        }
        Transform::Decomposed { translation, rotation, scale } => {
            let vector = |v: &[f32; 3]| DVec3::from(v.map(f64::from));
            let rotation = DQuat::from_array(rotation.map(f64::from));
            if !(rotation.length_squared() > 0.0 && rotation.is_finite()) {
                return Err("expected a rotation other than zero".to_owned());
            }
            let turn = rotation.normalize();
            Ok(DAffine3::from_scale_rotation_translation(vector(scale), turn, vector(translation)))
        }
    }
}

/// Returns the frame, without scale, of a camera or emitter that points along -z of a node with y up; in Buffon it
/// points along +z with x to the left. `None` if there is no direction.
fn viewer(to_world: &DAffine3) -> Option<DAffine3> {
    let direction = (-to_world.matrix3.z_axis).try_normalize()?;
    let left = to_world.matrix3.y_axis.cross(direction).try_normalize();
    let left = left.unwrap_or_else(|| direction.any_orthonormal_vector());
    Some(framing::frame(to_world.translation, left, direction))
}

/// Adds an emitter and a camera to a scene without one, and the integrator for media to a scene with any.
fn complete(loaded: &mut Loaded, file: &File) -> Result<()> {
    if !loaded.description.media.is_empty() {
        loaded.integrator = Settings::Volpath(PathLimits::default());
    }
    let Description { shapes, emitters, sensors, .. } = &loaded.description;
    let (lacks_emitter, lacks_sensor) =
        (emitters.is_empty() && shapes.iter().all(|s| s.emission.is_none()), sensors.is_empty());
    if lacks_emitter {
        loaded.description.emitters.push(framing::white_environment());
        loaded.notes.push("the file has no light: everything is in an even white light".to_owned());
    }
    if lacks_sensor {
        let Some(sensor) = framing::camera_for(&loaded.description) else {
            return Err(file.error("", "the scene has neither a camera nor triangles to look at"));
        };
        loaded.description.sensors.push(sensor);
        loaded.notes.push(format!("the file has no camera: everything is {}", framing::VIEW));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::DMat3;

    #[test]
    fn viewers_look_along_minus_z_with_x_to_the_right() {
        let frame = viewer(&DAffine3::from_scale(DVec3::splat(3.0))).unwrap();
        let expected = DMat3::from_cols(DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z);
        assert_eq!(frame.matrix3, expected);
        assert!(viewer(&DAffine3::from_scale(DVec3::ZERO)).is_none());
    }
}
