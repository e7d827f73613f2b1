//! The names that a scene file gives to what a ray can hit.

use crate::ids::MaterialId;

/// The names of shapes, instances and materials. Names need not be different.
#[derive(Clone, Debug, Default)]
pub struct SceneNames {
    /// For each shape, by id. A shape without a name has its index: `shape.7`.
    pub shapes: Vec<String>,
    /// For each instance; empty if the scene file gives none.
    pub instances: Vec<String>,
    /// For each material, by id. A material without a name has its index: `material.7`.
    pub materials: Vec<String>,
}

impl SceneNames {
    /// Adds the name of the next shape.
    pub(super) fn add_shape(&mut self, name: &str) {
        self.shapes.push(or_index(name, "shape", self.shapes.len()));
    }

    /// Sets the names of materials.
    pub(super) fn set_materials(&mut self, names: &[(MaterialId, String)], count: usize) {
        self.materials = (0..count).map(|i| or_index("", "material", i)).collect();
        for (id, name) in names.iter().filter(|(id, name)| id.index() < count && !name.is_empty()) {
            self.materials[id.index()].clone_from(name);
        }
    }
}

fn or_index(name: &str, kind: &str, index: usize) -> String {
    if name.is_empty() { of_index(kind, index) } else { name.to_owned() }
}

/// Returns the name of something that has none.
pub(super) fn of_index(kind: &str, index: usize) -> String {
    format!("{kind}.{index}")
}
