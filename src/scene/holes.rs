//! The hit filter of materials with holes.

use super::Materials;
use crate::accel::{Hit, HitFilter};
use crate::ids::MaterialId;
use crate::math::{Ray, Vec3};
use crate::shape::WorldShape;
use std::sync::Arc;

/// Accepts a hit with a probability equal to the material's opacity. A rejected hit leaves the ray unchanged, so
/// emitters behind the surface are found and weighted as if it did not exist.
pub struct OpacityFilter {
    /// For each geometry with holes, its shape and material.
    pub shapes: Vec<Option<(WorldShape, MaterialId)>>,
    /// The materials.
    pub materials: Arc<Materials>,
}

impl HitFilter for OpacityFilter {
    fn accepts(&self, id: u32, ray: &Ray, hit: &Hit) -> bool {
        let Some((shape, material)) = &self.shapes[hit.geometry as usize] else { return true };
        let p = ray.o + ray.d * hit.t;
        let cosine = if self.materials.get(*material).is_pane() { cosine(shape, hit, p, ray.d) } else { 1.0 };
        let opacity = self.materials.opacity(*material, &shape.texture_point(hit, p), cosine);
        if opacity <= 0.0 || opacity >= 1.0 {
            return opacity > 0.0;
        }
        let side = u32::from(enters(shape, hit, p, ray.d));
        // A ray through the diagonal of a rectangle hits both triangles.
        let primitive = if matches!(shape, WorldShape::Rectangle { .. }) { 0 } else { hit.primitive };
        let words = [hit.geometry, primitive, hit.instance, side];
        let hash = words.into_iter().fold(id, |h, word| mix(h ^ mix(word.wrapping_add(0x9e37_79b9))));
        // Very small opacities need more than 32 random bits.
        let u = (f64::from(hash) + f64::from(mix(hash ^ 0x68bc_21eb)) * 2f64.powi(-32)) * 2f64.powi(-32);
        u < f64::from(opacity)
    }
}

/// Returns the cosine, in [0, 1], of the angle between a direction and the shading normal.
fn cosine(shape: &WorldShape, hit: &Hit, p: Vec3, d: Vec3) -> f32 {
    let n = match shape {
        WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => mesh.shading_normal(hit),
        WorldShape::Sphere { center, .. } => p - *center,
        WorldShape::Disk { normal, .. } => *normal,
        WorldShape::Cylinder { p0, p1, .. } => (p - *p0).reject_from(*p1 - *p0),
        WorldShape::Curves(_) | WorldShape::SdfGrid(_) => unreachable!("these are never panes"),
    };
    let cosine = d.dot(n).abs() / (d.length() * n.length());
    // NaN where there is no normal.
    if cosine < 1.0 { cosine } else { 1.0 }
}

/// Distinguishes the two hits of a ray with a curved surface.
fn enters(shape: &WorldShape, hit: &Hit, p: Vec3, d: Vec3) -> bool {
    match shape {
        WorldShape::Sphere { center, .. } => d.dot(p - *center) < 0.0,
        WorldShape::Cylinder { p0, p1, .. } => {
            let axis = (*p1 - *p0).normalize();
            let q = p - *p0;
            d.dot(q - axis * q.dot(axis)) < 0.0
        }
        WorldShape::SdfGrid(grid) => d.dot(grid.normal(hit, p)) < 0.0,
        WorldShape::Mesh(_)
        | WorldShape::Rectangle { .. }
        | WorldShape::Disk { .. }
        | WorldShape::Curves(_) => false,
    }
}

/// A 32-bit hash. [Wellons 2018, "lowbias32"]
fn mix(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
