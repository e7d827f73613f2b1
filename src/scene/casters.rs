//! The surfaces at which caustics begin.

use super::{Scene, SceneShape};
use crate::accel::Assembly;
use crate::emitter::BoundingSphere;
use crate::material::Materials;
use crate::math::Bounds;
use crate::shape::WorldShape;

/// Returns spheres around the shapes with Dirac deltas, and around each instance of those in a group, over all times.
pub(super) fn find(shapes: &[SceneShape], materials: &Materials, assembly: &Assembly) -> Vec<BoundingSphere> {
    let begins = |shape: &SceneShape| begins(shape, materials);
    let mut grouped = vec![false; shapes.len()];
    assembly.groups.iter().flatten().for_each(|&member| grouped[member as usize] = true);
    let alone = shapes.iter().zip(&grouped).filter(|(shape, grouped)| !**grouped && begins(shape));
    let mut spheres: Vec<_> = alone.filter_map(|(shape, _)| around(&shape.world)).collect();
    let box_of_group = |group: &Vec<u32>| {
        let members = group.iter().map(|&member| &shapes[member as usize]).filter(|shape| begins(shape));
        members.fold(Bounds::EMPTY, |all, shape| all.union(shape.world.geometry().bounds()))
    };
    let boxes: Vec<Bounds> = assembly.groups.iter().map(box_of_group).collect();
    let instances = assembly.instances.iter();
    spheres.extend(instances.filter_map(|instance| of_box(instance.bounds(boxes[instance.group as usize]))));
    spheres
}

/// Returns whether a surface mirrors or refracts light. Rays do not hit `null`, unless it emits.
fn begins(shape: &SceneShape, materials: &Materials) -> bool {
    let (material, emits) = (materials.get(shape.material), shape.emitter.is_some());
    material.lobes_of(emits).deltas > 0 && (emits || !material.is_absent())
}

impl Scene {
    /// Returns whether no ray can hit some emitter, and a surface mirrors or refracts its light. No camera path finds
    /// that.
    pub fn has_hidden_light(&self) -> bool {
        self.needs.delta_emitters && self.shapes.iter().any(|shape| begins(shape, &self.materials))
    }

    /// Returns whether the [hidden light](Self::has_hidden_light) is much: a surface has no other lobes, and is no thin
    /// pane, which most light passes.
    pub fn has_much_hidden_light(&self) -> bool {
        let sends_much = |shape: &SceneShape| {
            let material = self.materials.get(shape.material);
            begins(shape, &self.materials) && !material.lobes_of(false).finite && !material.is_pane()
        };
        self.needs.delta_emitters && self.shapes.iter().any(sends_much)
    }
}

/// Returns a sphere around a shape; `None` if it has no valid primitive.
fn around(shape: &WorldShape) -> Option<BoundingSphere> {
    match shape {
        WorldShape::Sphere { center, radius, .. } => {
            Some(BoundingSphere { center: *center, radius: *radius })
        }
        _ => of_box(shape.geometry().bounds()),
    }
}

/// Returns the sphere around a box; `None` if it is empty.
fn of_box(bounds: Bounds) -> Option<BoundingSphere> {
    (!bounds.is_empty()).then(|| BoundingSphere { center: bounds.center(), radius: bounds.radius() })
}
