//! Declarations of Embree 3's C interface (`embree3/rtcore.h`), and nothing but declarations.
//!
//! * Written by bindgen at build time from the installed header, so a layout cannot drift from the library's.
//! * Enumerations are newtypes over integers (`RTCError(2)`), flags are bit fields: a value that the header
//!   does not list is no undefined behaviour.
//! * The inline functions of the header have no symbol in the library. The one that every query needs,
//!   `rtcInitIntersectContext`, is [`intersect_context`] here.
//! * Needs Embree 3.13 or a later 3.x (Debian 12: `libembree-dev`) and libclang. `EMBREE_DIR` names another
//!   installation. A dependent's build script reads the version in `DEP_EMBREE3_VERSION`.

/// What bindgen wrote.
#[allow(non_camel_case_types, non_snake_case, non_upper_case_globals, missing_docs)]
#[allow(clippy::all, clippy::undocumented_unsafe_blocks)]
mod bindings {
    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}

pub use bindings::*;

/// The id of "no geometry" and "no instance" (a cast in the header, which bindgen cannot evaluate).
pub const INVALID_GEOMETRY_ID: u32 = u32::MAX;

/// An initialised context, as the header's inline `rtcInitIntersectContext` makes it, with the given flags.
pub const fn intersect_context(flags: RTCIntersectContextFlags) -> RTCIntersectContext {
    RTCIntersectContext { flags, filter: None, instID: [INVALID_GEOMETRY_ID; 1] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::{align_of, offset_of, size_of};

    #[test]
    fn the_structures_have_the_sizes_and_alignments_of_the_library() {
        assert_eq!((size_of::<RTCRay>(), align_of::<RTCRay>()), (48, 16));
        assert_eq!((size_of::<RTCHit>(), align_of::<RTCHit>()), (32, 16));
        assert_eq!((size_of::<RTCRayHit>(), align_of::<RTCRayHit>()), (80, 16));
        assert_eq!((size_of::<RTCRayHit8>(), align_of::<RTCRayHit8>()), (640, 32));
        assert_eq!((size_of::<RTCRayHit16>(), align_of::<RTCRayHit16>()), (1280, 64));
        assert_eq!((size_of::<RTCIntersectContext>(), align_of::<RTCIntersectContext>()), (24, 8));
    }

    #[test]
    fn the_fields_lie_where_the_header_says() {
        assert_eq!(offset_of!(RTCRay, tnear), 12);
        assert_eq!(offset_of!(RTCRay, tfar), 32);
        assert_eq!(offset_of!(RTCRayHit, hit), 48);
        assert_eq!(offset_of!(RTCHit, geomID), 24);
        assert_eq!(offset_of!(RTCRayHit16, hit), 768);
        assert_eq!(offset_of!(RTCRay16, tfar), 512);
    }

    #[test]
    fn flags_combine_and_the_version_is_in_range() {
        let both = RTCSceneFlags::RTC_SCENE_FLAG_ROBUST | RTCSceneFlags::RTC_SCENE_FLAG_COMPACT;
        assert_eq!(both.0, 6);
        assert_eq!(RTC_VERSION_MAJOR, 3);
        const { assert!(RTC_VERSION >= 31300) };
    }
}
