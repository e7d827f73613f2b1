//! A safe wrapper of Embree 3: plain arrays in, hits out.
//!
//! [`Device`] → [`SceneBuilder`] → [`SceneBuilder::commit`] consumes the builder → [`CommittedScene`], which is
//! immutable, `Send + Sync`, and answers queries through `&self`. So a scene cannot be changed while it is
//! queried, and a geometry cannot be queried before it is committed.
//!
//! Ownership: every handle has one owner and a `Drop`; none is `Clone`. What Embree reads after a call returns
//! (vertices, indices, user primitives, the scenes of instances, the state of the callbacks) is held by an `Arc` in the scene, so the
//! values may be dropped in any order.
//!
//! Errors: Embree keeps the first error per thread until it is read; it is read after every call that can fail
//! (device, geometry, commit) and never after a query, because a query sets none.
//!
//! Panics: a panic in a [`UserPrimitives`] or [`TriangleFilter`] callback does not unwind through Embree. It is
//! caught, and goes on when the query returns.
//!
//! This module knows no maths types. Together with the `-sys` crates it is the only `unsafe` code of ray traversal.

mod device;
mod filter;
mod packet;
mod scene;
mod user;

pub use device::{Device, DeviceOptions, Isa, version};
pub use filter::{Candidate, TriangleFilter};
pub use packet::{COMPONENT_LIMIT, Mask16, RayHit1, RayHits16, Rays16, WIDTH};
pub use scene::{Coherence, CommittedScene, SceneBuilder, SceneOptions};
pub use user::{UserHit, UserPrimitives, UserRay};

/// The id of "no geometry", "no primitive" and "no instance".
pub const INVALID_ID: u32 = buffon_embree_sys::INVALID_GEOMETRY_ID;
