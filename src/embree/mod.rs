//! A safe wrapper of Embree 3 with plain arrays as input and hits as output.
//!
//! A [`Device`] creates a [`SceneBuilder`]. [`SceneBuilder::commit`] consumes the builder and returns a
//! [`CommittedScene`], which is immutable, `Send + Sync`, and answers queries through `&self`. A scene therefore
//! cannot change while it is queried, and a geometry cannot be queried before it is committed.
//!
//! Ownership: every handle has one owner and a `Drop`; none is `Clone`. The scene holds an `Arc` of everything that
//! Embree reads after a call returns (vertices, indices, user primitives, the scenes of instances, the state of the
//! callbacks). Values may therefore be dropped in any order.
//!
//! Errors: Embree keeps the first error of each thread until it is read. It is read after every call that can fail
//! (device, geometry, commit) and never after a query, because a query sets none.
//!
//! Panics: a panic in a [`UserPrimitives`] or [`TriangleFilter`] callback does not unwind through Embree. It is
//! caught and resumed when the query returns.
//!
//! This module does not depend on math types. Together with the `-sys` crates it is the only `unsafe` code of ray
//! traversal.

mod device;
mod filter;
mod packet;
mod scene;
mod user;

pub use device::{Device, DeviceOptions, Isa, version};
pub use filter::{CandidateHit, TriangleFilter};
pub use packet::{COMPONENT_LIMIT, Mask16, RayHit1, RayHits16, Rays16, WIDTH};
pub use scene::{Coherence, CommittedScene, SceneBuilder, SceneOptions};
pub use user::{UserHit, UserPrimitives, UserRay};

/// The id of "no geometry", "no primitive" and "no instance".
pub const INVALID_ID: u32 = buffon_embree_sys::INVALID_GEOMETRY_ID;
