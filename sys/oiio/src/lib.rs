//! Declarations of the C shim in `shim/`, which exposes the part of OpenImageIO that Buffon uses: reading all
//! channels and metadata of a file, writing, and comparing. The documentation and ownership rules of each function
//! are in `shim/buffon_oiio.h`. The safe wrapper is `buffon::image`.
//!
//! The shim is a shared object inside the program. [`functions`] loads it, and OpenImageIO and the 260 libraries that
//! this depends on with it: that takes 0.25 s, which a program without images to read or write should not pay.
//!
//! `build.rs` gives the library's version to dependants' build scripts as `DEP_OIIO_VERSION`.

#![allow(non_camel_case_types, non_upper_case_globals, missing_docs)]

use std::fs::File;
use std::io::{Error, Write};
use std::os::fd::{AsRawFd, FromRawFd};
use std::sync::OnceLock;

/// What bindgen makes of the header.
#[allow(clippy::all)]
mod bindings {
    include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
}

pub use bindings::*;

/// The shim, as the linker has written it.
static SHIM: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/libbuffon_oiio.so"));

static FUNCTIONS: OnceLock<Result<Functions, String>> = OnceLock::new();

/// Returns the functions of the shim if the library is loaded.
pub fn loaded() -> Option<&'static Functions> {
    FUNCTIONS.get()?.as_ref().ok()
}

/// Returns why the library could not be loaded, if that was tried.
pub fn load_error() -> Option<&'static str> {
    FUNCTIONS.get()?.as_ref().err().map(String::as_str)
}

/// Returns the functions of the shim. The first call loads the library, and calls `prepare` with them.
///
/// # Errors
/// Says why the library cannot be loaded; later calls say the same.
pub fn functions(prepare: impl FnOnce(&Functions)) -> Result<&'static Functions, &'static str> {
    let loaded = FUNCTIONS.get_or_init(|| {
        let functions = load().map_err(|why| format!("OpenImageIO cannot be loaded: {why}"))?;
        prepare(&functions);
        Ok(functions)
    });
    loaded.as_ref().map_err(String::as_str)
}

/// Loads the shim from a file in memory.
fn load() -> Result<Functions, String> {
    // SAFETY: the name ends with a NUL; the call has no other precondition.
    let descriptor = unsafe { libc::memfd_create(c"buffon_oiio".as_ptr(), libc::MFD_CLOEXEC) };
    if descriptor < 0 {
        return Err(Error::last_os_error().to_string());
    }
    // SAFETY: the descriptor is open, and nothing else owns it.
    let mut file = unsafe { File::from_raw_fd(descriptor) };
    file.write_all(SHIM).map_err(|e| e.to_string())?;
    let path = format!("/proc/self/fd/{}", file.as_raw_fd());
    // SAFETY: the object is the shim of this build; what its libraries run when they are loaded they would also run
    // if the program were linked against them. All symbols of the header are in it, with these types.
    unsafe { Functions::new(path) }.map_err(|e| e.to_string())
}

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
        let functions = functions(|_| ()).expect("the library");
        // SAFETY: the function takes nothing and returns a number.
        let version = unsafe { functions.buffon_oiio_version() };
        assert!((20_400..40_000).contains(&version), "{version}");
    }

    #[test]
    fn a_missing_file_leaves_a_message_and_no_reader() {
        let mut message = [0 as std::ffi::c_char; 256];
        // SAFETY: both names end with a NUL and the message's size is that of the array.
        let reader = unsafe {
            functions(|_| ()).expect("the library").buffon_oiio_open(
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
