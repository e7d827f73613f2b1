//! Ray traversal behind one seam: a [`Geometry`] list goes in, preliminary [`Hit`]s come out.
//!
//! A back end knows no shape, material or scene; it is built from neutral geometry and answers queries for
//! single rays and for waves of rays. All back ends agree on what a hit is:
//! `0 < t < t_max`, both sides of every surface, no backface culling.

use crate::math::{Bounds, Ray, Vec3};
use std::sync::Arc;

/// The value of [`Hit::instance`] for geometry that is not instanced.
pub const NO_INSTANCE: u32 = u32::MAX;

/// The nearest intersection of a ray, as a back end reports it.
///
/// For a triangle (p0, p1, p2), `u` and `v` are the barycentric weights of p1 and p2. For an analytic
/// primitive they are the coordinates that [`primitive::Primitive::intersect`] documents.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Ray parameter of the hit, in units of the ray's direction.
    pub t: f32,
    /// First surface coordinate.
    pub u: f32,
    /// Second surface coordinate.
    pub v: f32,
    /// Index into the list of geometries that the accelerator was built from.
    pub geometry: u32,
    /// Triangle index within the geometry; 0 for an analytic primitive.
    pub primitive: u32,
    /// Index of the instance, or [`NO_INSTANCE`].
    pub instance: u32,
}

/// What the caller knows about the rays of a wave that follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coherence {
    /// Neighbours start at about one point and point in about one direction (camera rays, shadow rays to a point).
    Coherent,
    /// Neighbours have nothing in common (diffuse bounces).
    Incoherent,
}
