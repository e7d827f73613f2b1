//! The shapes of the scene language.

pub mod curves;
pub mod mesh;
pub mod parametrization;
pub mod placement;
pub mod sdf_grid;
pub mod world;

pub use curves::{CurvePoint, Curves, WorldCurves};
pub use mesh::Mesh;
pub use placement::Placement;
pub use sdf_grid::{SdfGrid, SdfNormals, WorldSdfGrid};
pub use world::{TriangleMesh, WorldShape};

use crate::math::Vec3;

/// A shape in object space, as described by a scene.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub enum Shape {
    /// A triangle mesh.
    Mesh(Mesh),
    /// The square [−1, 1]² in the plane z = 0 with normal +z; uv = (x + 1, y + 1) / 2.
    Rectangle,
    /// The cube [−1, 1]³ with faceted normals outwards; uv covers [0, 1]² on every face.
    Cube,
    /// A sphere.
    Sphere {
        /// Centre.
        center: Vec3,
        /// Radius, positive.
        radius: f32,
    },
    /// An open cylinder, without caps; uv = (angle / 2π, relative height).
    Cylinder {
        /// Centre of the lower end.
        p0: Vec3,
        /// Centre of the upper end.
        p1: Vec3,
        /// Radius, positive.
        radius: f32,
    },
    /// The unit disk in the plane z = 0 with normal +z; uv = (radius, angle / 2π).
    Disk,
    /// Curves; rays hit them from the outside only. uv = (angle / 2π, position along all segments).
    Curves(Curves),
    /// The isosurface of signed distances in the cube [0, 1]³; uv = (0, 0).
    SdfGrid(SdfGrid),
}
