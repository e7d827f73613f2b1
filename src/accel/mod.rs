//! Ray traversal behind one interface: built from an [`Assembly`], it returns preliminary [`Hit`]s.
//!
//! A back end does not depend on shapes, materials or the scene. It is built from neutral geometry and answers
//! queries for single rays and for waves of rays. All back ends use the same definition of a hit: `0 < t < t_max`,
//! from both sides of every surface, without backface culling.

pub mod assembly;
pub mod brute_force;
pub mod bvh;
mod cylinder;
#[cfg(feature = "embree")]
pub mod embree;
mod fronted;
mod geometry;
pub mod instance;
pub mod list;
pub mod primitive;
mod round_cone;
mod sdf_cell;
mod triangle;

pub use assembly::{Assembly, GeometryFilter, HitFilter, ray_id};
pub use cylinder::cylinder_frame;
pub use geometry::{COORDINATE_LIMIT, CurveSegments, Geometry, Surfaces, VertexBuffer, valid_triangle};
pub use instance::{Instance, MAX_STEPS};
pub use primitive::{Primitive, PrimitiveHit};
pub use round_cone::RoundCone;
pub use sdf_cell::SdfCell;

use crate::error::{Error, Result};
use crate::math::{Bounds, Ray, Vec3};
use crate::memory::Budget;
use std::fmt;
use std::str::FromStr;

/// The value of [`Hit::instance`] for geometry that is not instanced.
pub const NO_INSTANCE: u32 = u32::MAX;

/// The nearest intersection of a ray, as a back end reports it.
///
/// For a triangle (p0, p1, p2), `u` and `v` are the barycentric weights of p1 and p2. For an analytic
/// primitive they are the coordinates that [`primitive::Primitive::intersect`] documents.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Ray parameter of the hit, in units of the ray's direction in the world.
    pub t: f32,
    /// First surface coordinate.
    pub u: f32,
    /// Second surface coordinate.
    pub v: f32,
    /// Index into [`Assembly::geometry`].
    pub geometry: u32,
    /// Triangle index within the geometry; 0 for an analytic primitive.
    pub primitive: u32,
    /// Index into [`Assembly::instances`], or [`NO_INSTANCE`].
    pub instance: u32,
}

/// The coherence of consecutive rays in a wave, as known by the caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coherence {
    /// Neighbouring rays have nearly the same origin and direction (camera rays, shadow rays to a point).
    Coherent,
    /// Neighbouring rays are unrelated (diffuse bounces).
    Incoherent,
}

/// A built acceleration structure. It is immutable and can be queried from any number of threads.
///
/// A ray hits nothing if a component of its origin or direction is NaN or exceeds [`COORDINATE_LIMIT`], its direction
/// is zero, `t_max` is not above 0, or its time is outside [0, 1]. The limit in world space is lower where an
/// instance's transform could take a ray beyond [`COORDINATE_LIMIT`] in group space. Directions need not be of unit
/// length.
pub trait Accel: Send + Sync {
    /// Returns the name of the back end, for statistics.
    fn name(&self) -> &'static str;

    /// Returns the bounding box of all valid primitives in world space, over all times; empty if there are none.
    fn bounds(&self) -> Bounds;

    /// Returns the bytes of the acceleration structure itself, without the shared vertex and index arrays.
    fn memory_bytes(&self) -> usize;

    /// Returns the nearest hit with `0 < t < t_max`.
    fn intersect(&self, ray: &Ray) -> Option<Hit>;

    /// Returns whether there is any hit with `0 < t < t_max`.
    fn occluded(&self, ray: &Ray) -> bool;

    /// Computes [`intersect`](Self::intersect) for a wave of rays: `hits[i]` is the answer for `rays[i]`.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn intersect_wave(&self, rays: &[Ray], hits: &mut [Option<Hit>], _coherence: Coherence) {
        assert_eq!(rays.len(), hits.len(), "one hit for each ray");
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.intersect(ray);
        }
    }

    /// Computes [`occluded`](Self::occluded) for a wave of rays: `occluded[i]` is the answer for `rays[i]`.
    ///
    /// # Panics
    /// If the slices differ in length.
    fn occluded_wave(&self, rays: &[Ray], occluded: &mut [bool], _coherence: Coherence) {
        assert_eq!(rays.len(), occluded.len(), "one answer for each ray");
        for (ray, occluded) in rays.iter().zip(occluded) {
            *occluded = self.occluded(ray);
        }
    }
}

/// Returns whether a ray can hit anything; `limit` is the greatest valid component: see [`Accel`].
#[inline]
fn is_valid_ray(ray: &Ray, limit: f32) -> bool {
    let within = |v: Vec3| v.abs().cmple(Vec3::splat(limit)).all();
    within(ray.o)
        && within(ray.d)
        && ray.d != Vec3::ZERO
        && ray.t_max > 0.0
        && (0.0..=1.0).contains(&ray.time)
}

/// The back ends that a scene can be rendered with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AccelKind {
    /// The [`list`] for a scene of a few dozen surfaces; otherwise Embree, if it is compiled in, or the pure-Rust BVH,
    /// behind a list of the largest simple surfaces.
    #[default]
    Auto,
    /// Embree 3.
    #[cfg(feature = "embree")]
    Embree,
    /// The pure-Rust BVH, built by obvhs.
    Obvhs,
}

impl AccelKind {
    /// The values that can be chosen in this build.
    pub const CHOICES: &[AccelKind] = &[
        AccelKind::Auto,
        #[cfg(feature = "embree")]
        AccelKind::Embree,
        AccelKind::Obvhs,
    ];

    /// The back ends of this build that accept any scene, the fastest first.
    pub const ALL: &[AccelKind] = &[
        #[cfg(feature = "embree")]
        AccelKind::Embree,
        AccelKind::Obvhs,
    ];
}

impl fmt::Display for AccelKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            AccelKind::Auto => "auto",
            #[cfg(feature = "embree")]
            AccelKind::Embree => "embree",
            AccelKind::Obvhs => "obvhs",
        })
    }
}

impl FromStr for AccelKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let found = AccelKind::CHOICES.iter().find(|kind| kind.to_string() == name);
        found.copied().ok_or_else(|| {
            if name == "embree" {
                return Error::usage("this Buffon was built without Embree (feature `embree`); use `obvhs`");
            }
            let names: Vec<String> = AccelKind::CHOICES.iter().map(|kind| format!("`{kind}`")).collect();
            Error::usage(format!("expected {}, found `{name}`", names.join(" or ")))
        })
    }
}

/// The result of [`build`].
pub struct BuiltAccel {
    /// The acceleration structure.
    pub accel: Box<dyn Accel>,
    /// The number of primitives that can never be hit and are left out: an index out of range, a coordinate that is
    /// not finite or exceeds [`COORDINATE_LIMIT`], or an analytic surface without extent. It is the same for every
    /// back end.
    pub dropped: usize,
}

/// Builds an acceleration structure without a memory limit: see [`build_within`].
///
/// # Errors
/// As [`build_within`].
pub fn build(
    kind: AccelKind,
    assembly: impl Into<Assembly>,
    threads: usize,
    robust: bool,
) -> Result<BuiltAccel> {
    build_within(kind, assembly, threads, robust, &Budget::unlimited())
}

/// Builds an acceleration structure and charges its memory to the budget.
///
/// `threads` is the number of build threads; 0 uses all cores. `robust` makes Embree watertight along edges. It is
/// false only for measuring the cost of that. The pure-Rust BVH is always watertight.
///
/// # Errors
/// If the back end cannot be started, needs more memory than the budget has left, or is given 2^32 primitives or
/// more. If an index of the assembly is out of range. If an instance's transform, at any time, is not finite, is not
/// invertible in `f32`, scales by more than a factor of 10^9, or leads beyond [`COORDINATE_LIMIT`].
pub fn build_within(
    kind: AccelKind,
    assembly: impl Into<Assembly>,
    threads: usize,
    robust: bool,
    memory: &Budget,
) -> Result<BuiltAccel> {
    let mut assembly = assembly.into();
    let checked = assembly.check()?;
    let dropped = checked.dropped;
    let list = if kind == AccelKind::Auto { list::List::new(&assembly, &checked) } else { None };
    let accel: Box<dyn Accel> = match (list, kind) {
        (Some(list), _) => Box::new(list),
        (None, AccelKind::Auto) => {
            let kind = AccelKind::ALL[0];
            match fronted::part(assembly, checked) {
                Ok(fronted::Parts { list, rest, checked }) => {
                    let tree = tree(kind, rest, &checked, threads, robust, memory)?;
                    Box::new(fronted::Fronted::new(list, tree))
                }
                Err((assembly, checked)) => tree(kind, assembly, &checked, threads, robust, memory)?,
            }
        }
        (None, kind) => tree(kind, assembly, &checked, threads, robust, memory)?,
    };
    Ok(BuiltAccel { accel, dropped })
}

/// Builds with Embree, or the pure-Rust BVH for any other kind.
fn tree(
    kind: AccelKind,
    assembly: Assembly,
    checked: &assembly::CheckedAssembly,
    threads: usize,
    robust: bool,
    memory: &Budget,
) -> Result<Box<dyn Accel>> {
    Ok(match kind {
        #[cfg(feature = "embree")]
        AccelKind::Embree => Box::new(embree::EmbreeAccel::new(assembly, checked, threads, robust, memory)?),
        _ => {
            let _ = robust;
            Box::new(bvh::Bvh::new(assembly, checked, threads, memory)?)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_back_end_is_named_and_an_unknown_name_is_answered_with_the_known_ones() {
        for kind in AccelKind::CHOICES {
            assert_eq!(kind.to_string().parse(), Ok(*kind));
        }
        let error = "bvh".parse::<AccelKind>().unwrap_err().to_string();
        assert!(
            error.starts_with("expected `auto` or `") && error.ends_with("`obvhs`, found `bvh`"),
            "{error}"
        );
        #[cfg(not(feature = "embree"))]
        assert_eq!(
            "embree".parse::<AccelKind>().unwrap_err().to_string(),
            "this Buffon was built without Embree (feature `embree`); use `obvhs`"
        );
    }

    #[test]
    fn an_empty_scene_has_no_bounds_and_no_hits() {
        for &kind in AccelKind::CHOICES {
            let built = build(kind, Assembly::default(), 1, true).expect("built");
            assert!(built.accel.bounds().is_empty());
            assert_eq!(built.accel.intersect(&Ray::new(Vec3::ZERO, Vec3::X)), None);
        }
    }
}
