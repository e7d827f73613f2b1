//! The surfaces at which caustics begin.

use super::SceneShape;
use crate::accel::Assembly;
use crate::emitter::BoundingSphere;
use crate::material::Materials;
use crate::math::Bounds;
use crate::shape::WorldShape;

/// Returns spheres around the shapes with Dirac deltas, and around each instance of those in a group, over all times.
pub(super) fn find(shapes: &[SceneShape], materials: &Materials, assembly: &Assembly) -> Vec<BoundingSphere> {
    let begins =
        |shape: &SceneShape| materials.get(shape.material).lobes_of(shape.emitter.is_some()).deltas > 0;
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
