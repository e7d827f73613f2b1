//! The one integration-test binary.

#[cfg(feature = "embree")]
mod embree_ffi;
mod meshes;
mod parity;
mod watertight;
