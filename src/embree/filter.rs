//! Filters: Rust code decides which hits of a triangle mesh count, called back by Embree.

use super::user::{Lane, UserRay, for_lanes};
use buffon_embree_sys as sys;
use std::sync::Arc;

/// A hit of a triangle that a filter decides about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Ray parameter.
    pub t: f32,
    /// First surface coordinate.
    pub u: f32,
    /// Second surface coordinate.
    pub v: f32,
    /// The triangle's number.
    pub primitive: u32,
}

/// Decides which hits of a mesh count.
///
/// The answer must depend on the ray and the hit alone: Embree asks in any order, and may ask twice. The function
/// may panic: the panic reaches the caller of the query, never Embree.
pub trait TriangleFilter: Send + Sync {
    /// Whether the hit counts.
    fn accepts(&self, ray: &UserRay, hit: &Candidate) -> bool;
}

/// What the callback reads; boxed, for Embree holds its address.
pub(super) struct FilterState(pub Arc<dyn TriangleFilter>);

/// Fields of `RTCHitN`: each is an array of N 4-byte values.
mod field {
    pub const U: usize = 3;
    pub const V: usize = 4;
    pub const PRIMITIVE: usize = 5;
}

/// `RTCFilterFunctionN`, for intersection and occlusion alike.
pub(super) unsafe extern "C" fn on_filter(args: *const sys::RTCFilterFunctionNArguments) {
    // SAFETY: Embree passes valid arguments; the user pointer is the mesh's `FilterState`.
    let (args, state) = unsafe { (&*args, &*(*args).geometryUserPtr.cast::<FilterState>()) };
    let one = |lane: Lane, instance: u32| {
        let of_hit = Lane { base: args.hit.cast(), ..lane };
        // SAFETY: `ray` is an `RTCRayN` of N rays, and the lane is one of them.
        let ray = unsafe { lane.ray(instance) };
        // SAFETY: `hit` is an `RTCHitN` of N hits; their fields are arrays of N values as a ray's are.
        let hit = unsafe {
            Candidate {
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
