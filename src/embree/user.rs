//! User geometry: primitives whose bounds and intersections Rust code computes, called back by Embree.

use buffon_embree_sys as sys;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;

/// A ray as passed to a user primitive. A hit is valid for `t_near < t < t_far`.
#[derive(Clone, Copy, Debug)]
pub struct UserRay {
    /// Origin.
    pub origin: [f32; 3],
    /// Direction, of any length.
    pub direction: [f32; 3],
    /// Lower bound of a hit's parameter.
    pub t_near: f32,
    /// Upper bound of a hit's parameter: that of the nearest hit so far.
    pub t_far: f32,
    /// Time in [0, 1].
    pub time: f32,
    /// The identifier that the caller of the query gave the ray.
    pub id: u32,
    /// The instance in whose space the ray is, or [`INVALID_ID`](super::INVALID_ID).
    pub instance: u32,
}

/// A hit of a user primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UserHit {
    /// Ray parameter.
    pub t: f32,
    /// First surface coordinate.
    pub u: f32,
    /// Second surface coordinate.
    pub v: f32,
    /// The value that the query reports as the hit's primitive.
    pub primitive: u32,
}

/// A set of primitives behind one geometry id.
///
/// The functions may panic; the panic reaches the caller of the query and never unwinds through Embree.
pub trait UserPrimitives: Send + Sync {
    /// Returns the number of primitives.
    fn count(&self) -> u32;
    /// Returns the bounding box (least corner, greatest corner) of primitive `i`.
    fn bounds(&self, i: u32) -> ([f32; 3], [f32; 3]);
    /// Returns the nearest hit of primitive `i` within the ray's bounds.
    fn intersect(&self, i: u32, ray: &UserRay) -> Option<UserHit>;
    /// Returns whether primitive `i` has a hit within the ray's bounds.
    fn occluded(&self, i: u32, ray: &UserRay) -> bool {
        self.intersect(i, ray).is_some()
    }
}

/// The state that the callbacks read. The boxes are computed before the build: Embree's own threads, which call back
/// for them, flush denormals to zero, and Rust code must not run in that mode.
pub(super) struct UserState {
    primitives: Arc<dyn UserPrimitives>,
    bounds: Vec<([f32; 3], [f32; 3])>,
}

impl UserState {
    /// Computes the boxes. A panic of [`UserPrimitives::bounds`] may unwind, because no C frame is on the stack.
    pub(super) fn new(primitives: Arc<dyn UserPrimitives>) -> Self {
        let bounds = (0..primitives.count()).map(|i| primitives.bounds(i)).collect();
        UserState { primitives, bounds }
    }

    /// Returns the number of primitives.
    pub(super) fn count(&self) -> u32 {
        self.bounds.len() as u32
    }
}

/// Embree's query context, followed by the result that callbacks return to the query.
#[repr(C)]
pub(super) struct QueryContext {
    embree: sys::RTCIntersectContext,
    panic: Option<Box<dyn Any + Send>>,
}

impl QueryContext {
    /// Creates a context with the given flags.
    #[inline]
    pub(super) fn new(flags: sys::RTCIntersectContextFlags) -> Self {
        QueryContext { embree: sys::intersect_context(flags), panic: None }
    }

    /// Returns the pointer for the C call. It covers the whole structure, so that the callbacks can access `panic`.
    #[inline]
    pub(super) fn as_mut_ptr(&mut self) -> *mut sys::RTCIntersectContext {
        (&raw mut *self).cast()
    }

    /// Resumes a panic of a callback after the query.
    #[inline]
    pub(super) fn finish(self) {
        if let Some(payload) = self.panic {
            resume_unwind(payload);
        }
    }
}

/// Fields of `RTCRayN` and, after its 12 fields, of `RTCHitN`: each is an array of N 4-byte values.
mod field {
    pub const ORIGIN: usize = 0;
    pub const T_NEAR: usize = 3;
    pub const DIRECTION: usize = 4;
    pub const TIME: usize = 7;
    pub const T_FAR: usize = 8;
    pub const ID: usize = 10;
    pub const NORMAL: usize = 12;
    pub const U: usize = 15;
    pub const V: usize = 16;
    pub const PRIMITIVE: usize = 17;
    pub const GEOMETRY: usize = 18;
    pub const INSTANCE: usize = 19;
}

/// One lane of N rays in structure-of-arrays layout.
#[derive(Clone, Copy)]
pub(super) struct CallbackLane {
    pub base: *mut f32,
    pub n: usize,
    pub i: usize,
}

impl CallbackLane {
    /// # Safety
    /// `base` must point to `RTCRayN` (or `RTCRayHitN` for the fields of a hit) of `n` rays, and `i < n`.
    pub unsafe fn get(self, field: usize) -> f32 {
        // SAFETY: the caller guarantees the layout; field `field` of ray `i` is the value with the index field·n + i.
        unsafe { *self.base.add(field * self.n + self.i) }
    }

    /// # Safety
    /// As [`get`](Self::get), for a field of unsigned integers.
    pub unsafe fn get_u32(self, field: usize) -> u32 {
        // SAFETY: as in `get`; `f32` and `u32` have the same size and alignment.
        unsafe { *self.base.add(field * self.n + self.i).cast::<u32>() }
    }

    /// # Safety
    /// As [`get`](Self::get).
    unsafe fn set(self, field: usize, value: f32) {
        // SAFETY: as in `get`.
        unsafe { *self.base.add(field * self.n + self.i) = value }
    }

    /// # Safety
    /// As [`get`](Self::get), for a field of unsigned integers.
    unsafe fn set_u32(self, field: usize, value: u32) {
        // SAFETY: as in `get`; `f32` and `u32` have the same size and alignment.
        unsafe { *self.base.add(field * self.n + self.i).cast::<u32>() = value }
    }

    /// Returns the ray, which is in the space of `instance`.
    ///
    /// # Safety
    /// As [`get`](Self::get).
    pub unsafe fn ray(self, instance: u32) -> UserRay {
        let three = |f: usize| {
            // SAFETY: the caller's obligation.
            unsafe { [self.get(f), self.get(f + 1), self.get(f + 2)] }
        };
        UserRay {
            origin: three(field::ORIGIN),
            direction: three(field::DIRECTION),
            // SAFETY: the caller's obligation.
            t_near: unsafe { self.get(field::T_NEAR) },
            // SAFETY: the caller's obligation.
            t_far: unsafe { self.get(field::T_FAR) },
            // SAFETY: the caller's obligation.
            time: unsafe { self.get(field::TIME) },
            // SAFETY: the caller's obligation.
            id: unsafe { self.get_u32(field::ID) },
            instance,
        }
    }
}

/// Calls `f` with the valid lanes and the instance in whose space the rays are. A panic is stored in the context, and
/// the remaining lanes are skipped.
///
/// # Safety
/// The pointers must be those of Embree's arguments, in a query started with a [`QueryContext`].
pub(super) unsafe fn for_lanes(
    valid: *const i32,
    context: *mut sys::RTCIntersectContext,
    base: *mut f32,
    n: usize,
    mut f: impl FnMut(CallbackLane, u32),
) {
    // SAFETY: every query of this module passes a `QueryContext`, whose first field this points to; the query's
    // thread is this one, and it does not touch the context until the query returns.
    let context = unsafe { &mut *context.cast::<QueryContext>() };
    let (instance, panic) = (context.embree.instID[0], &mut context.panic);
    if panic.is_some() {
        return;
    }
    let caught = catch_unwind(AssertUnwindSafe(|| {
        for i in 0..n {
            // SAFETY: `valid` has n values.
            if unsafe { *valid.add(i) } != 0 {
                f(CallbackLane { base, n, i }, instance);
            }
        }
    }));
    *panic = caught.err();
}

/// The `RTCBoundsFunction`: returns the box computed beforehand.
pub(super) unsafe extern "C" fn on_bounds(args: *const sys::RTCBoundsFunctionArguments) {
    // SAFETY: Embree passes valid arguments; the user pointer is the geometry's `UserState`.
    let (args, state) = unsafe { (&*args, &*(*args).geometryUserPtr.cast::<UserState>()) };
    let Some((min, max)) = state.bounds.get(args.primID as usize) else { return };
    // SAFETY: `bounds_o` points to the box to write.
    let out = unsafe { &mut *args.bounds_o };
    [out.lower_x, out.lower_y, out.lower_z] = *min;
    [out.upper_x, out.upper_y, out.upper_z] = *max;
}

/// The `RTCIntersectFunctionN` of user geometry.
pub(super) unsafe extern "C" fn on_intersect(args: *const sys::RTCIntersectFunctionNArguments) {
    // SAFETY: Embree passes valid arguments; the user pointer is the geometry's `UserState`.
    let (args, state) = unsafe { (&*args, &*(*args).geometryUserPtr.cast::<UserState>()) };
    let one = |lane: CallbackLane, instance: u32| {
        // SAFETY: `rayhit` is an `RTCRayHitN` of N rays, and the lane is one of them.
        let ray = unsafe { lane.ray(instance) };
        let Some(hit) = state.primitives.intersect(args.primID, &ray) else { return };
        // SAFETY: as above.
        unsafe {
            lane.set(field::T_FAR, hit.t);
            lane.set(field::U, hit.u);
            lane.set(field::V, hit.v);
            for k in 0..3 {
                lane.set(field::NORMAL + k, 0.0);
            }
            lane.set_u32(field::PRIMITIVE, hit.primitive);
            lane.set_u32(field::GEOMETRY, args.geomID);
            lane.set_u32(field::INSTANCE, instance);
        }
    };
    // SAFETY: the pointers are Embree's.
    unsafe { for_lanes(args.valid, args.context, args.rayhit.cast(), args.N as usize, one) };
}

/// The `RTCOccludedFunctionN` of user geometry.
pub(super) unsafe extern "C" fn on_occluded(args: *const sys::RTCOccludedFunctionNArguments) {
    // SAFETY: Embree passes valid arguments; the user pointer is the geometry's `UserState`.
    let (args, state) = unsafe { (&*args, &*(*args).geometryUserPtr.cast::<UserState>()) };
    let one = |lane: CallbackLane, instance: u32| {
        // SAFETY: `ray` is an `RTCRayN` of N rays, and the lane is one of them.
        let ray = unsafe { lane.ray(instance) };
        if state.primitives.occluded(args.primID, &ray) {
            // SAFETY: as above.
            unsafe { lane.set(field::T_FAR, f32::NEG_INFINITY) };
        }
    };
    // SAFETY: the pointers are Embree's.
    unsafe { for_lanes(args.valid, args.context, args.ray.cast(), args.N as usize, one) };
}
