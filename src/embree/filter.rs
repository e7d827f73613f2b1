//! Hit filters of triangle meshes: Rust code, called back by Embree, that accepts or rejects hits.

use super::user::{CallbackLane, UserRay, for_lanes};
use buffon_embree_sys as sys;
use std::sync::Arc;

/// A hit of a triangle that a filter accepts or rejects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CandidateHit {
    /// Ray parameter.
    pub t: f32,
    /// First surface coordinate.
    pub u: f32,
    /// Second surface coordinate.
    pub v: f32,
    /// The index of the triangle.
    pub primitive: u32,
}

/// Accepts or rejects the hits of a mesh.
///
/// The answer must depend on the ray and the hit alone: Embree calls the filter in any order, possibly twice for one
/// hit. The function may panic; the panic reaches the caller of the query and never unwinds through Embree.
pub trait TriangleFilter: Send + Sync {
    /// Returns whether the hit is accepted.
    fn accepts(&self, ray: &UserRay, hit: &CandidateHit) -> bool;
}

/// The state that the callback reads. It is boxed because Embree holds its address.
pub(super) struct FilterState(pub Arc<dyn TriangleFilter>);

/// Fields of `RTCHitN`: each is an array of N 4-byte values.
mod field {
    pub const U: usize = 3;
    pub const V: usize = 4;
    pub const PRIMITIVE: usize = 5;
}

/// The `RTCFilterFunctionN` of intersection and occlusion queries.
pub(super) unsafe extern "C" fn on_filter(args: *const sys::RTCFilterFunctionNArguments) {
    // SAFETY: Embree passes valid arguments; the user pointer is the mesh's `FilterState`.
    let (args, state) = unsafe { (&*args, &*(*args).geometryUserPtr.cast::<FilterState>()) };
    let one = |lane: CallbackLane, instance: u32| {
        let of_hit = CallbackLane { base: args.hit.cast(), ..lane };
        // SAFETY: `ray` is an `RTCRayN` of N rays, and the lane is one of them.
        let ray = unsafe { lane.ray(instance) };
        // SAFETY: `hit` is an `RTCHitN` of N hits; their fields are arrays of N values as a ray's are.
        let hit = unsafe {
            CandidateHit {
                t: ray.t_far,
                u: of_hit.get(field::U),
                v: of_hit.get(field::V),
                primitive: of_hit.get_u32(field::PRIMITIVE),
            }
        };
        if !state.0.accepts(&ray, &hit) {
            // SAFETY: `valid` has N values, which the callback may set to 0.
            unsafe { *args.valid.add(lane.i) = 0 };
        }
    };
    // SAFETY: the pointers are Embree's.
    unsafe { for_lanes(args.valid, args.context, args.ray.cast(), args.N as usize, one) };
}
