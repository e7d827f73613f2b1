//! Declarations of the C shim in `shim/`, which exposes the part of OpenImageIO that Buffon uses: reading all
//! channels and metadata of a file, writing, and comparing. The documentation and ownership rules of each function
//! are in `shim/buffon_oiio.h`. The safe wrapper is `buffon::image`.
//!
//! The build scripts of dependent crates read the library's version from `DEP_OIIO_VERSION`.

#![allow(non_camel_case_types, non_upper_case_globals, missing_docs)]

include!(concat!(env!("OUT_DIR"), "/bindings.rs"));

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::{align_of, size_of};

    #[test]
    fn the_structures_have_the_layout_of_the_c_header() {
        assert_eq!((size_of::<BuffonOiioAttribute>(), align_of::<BuffonOiioAttribute>()), (96, 8));
        assert_eq!((size_of::<BuffonOiioPart>(), align_of::<BuffonOiioPart>()), (40, 8));
        assert_eq!((size_of::<BuffonOiioOutput>(), align_of::<BuffonOiioOutput>()), (80, 8));
        assert_eq!((size_of::<BuffonOiioDifference>(), align_of::<BuffonOiioDifference>()), (48, 8));
    }

    #[test]
    fn the_library_in_use_is_one_the_shim_is_written_for() {
        // SAFETY: the function takes nothing and returns a number.
        let version = unsafe { buffon_oiio_version() };
        assert!((20_400..40_000).contains(&version), "{version}");
    }

    #[test]
    fn a_missing_file_leaves_a_message_and_no_reader() {
        let mut message = [0 as std::ffi::c_char; 256];
        // SAFETY: both names end with a NUL and the message's size is that of the array.
        let reader = unsafe {
            buffon_oiio_open(
                c"/no/such.exr".as_ptr(),
                c"openexr".as_ptr(),
                message.as_mut_ptr(),
                message.len(),
            )
        };
        assert!(reader.is_null());
        assert_ne!(message[0], 0);
    }
}
