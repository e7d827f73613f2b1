//! Shapes in world space, after transforms have been applied.

use super::{Mesh, Shape, WorldCurves, WorldSdfGrid};
use crate::accel::{Geometry, Hit, Primitive, VertexBuffer};
use crate::error::{Error, Result};
use crate::math::{DAffine3, DMat3, DVec3, Frame, Mat3, Vec2, Vec3};
use crate::texture::Attribute;
use std::sync::Arc;

/// A triangle mesh in world space. The accelerator shares its arrays.
pub struct TriangleMesh {
    /// Vertex positions.
    pub positions: Arc<VertexBuffer>,
    /// Triangles as indices into the vertex arrays.
    pub indices: Arc<Vec<[u32; 3]>>,
    /// Vertex normals of unit length; empty for a faceted mesh.
    pub normals: Vec<Vec3>,
    /// Texture coordinates; may be empty.
    pub uvs: Vec<Vec2>,
    /// Additional values of vertices and faces.
    pub attributes: Vec<Attribute>,
}

impl TriangleMesh {
    /// Returns the corners of triangle `i`.
    #[inline]
    pub fn triangle(&self, i: usize) -> [Vec3; 3] {
        self.indices[i].map(|v| self.positions[v as usize])
    }

    /// Returns the shading normal at a hit, not of unit length: interpolated, or that of the triangle.
    pub fn shading_normal(&self, hit: &Hit) -> Vec3 {
        let i = hit.primitive as usize;
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let of_vertex = |v: u32| self.normals.get(v as usize).copied().unwrap_or(Vec3::ZERO);
        let n: Vec3 = self.indices[i].into_iter().zip(weights).map(|(v, weight)| of_vertex(v) * weight).sum();
        if n != Vec3::ZERO {
            return n;
        }
        let [a, b, c] = self.triangle(i);
        (b - a).cross(c - a)
    }

    /// Returns the bytes of the arrays.
    pub fn memory_bytes(&self) -> usize {
        size_of_val::<[Vec3]>(&self.positions)
            + size_of_val(self.indices.as_slice())
            + size_of_val(self.normals.as_slice())
            + size_of_val(self.uvs.as_slice())
            + self.attributes.iter().map(|a| size_of_val(a.values.as_slice())).sum::<usize>()
    }
}

/// A shape in world space.
#[derive(Clone)]
pub enum WorldShape {
    /// A triangle mesh.
    Mesh(Arc<TriangleMesh>),
    /// A parallelogram of two triangles. Corner and edges are used for sampling.
    Rectangle {
        /// The two triangles.
        mesh: Arc<TriangleMesh>,
        /// The corner at (−1, −1).
        corner: Vec3,
        /// The edge along x, of full length.
        edge_x: Vec3,
        /// The edge along y, of full length.
        edge_y: Vec3,
        /// Unit normal of the front side.
        normal: Vec3,
    },
    /// A sphere.
    Sphere {
        /// Centre.
        center: Vec3,
        /// Radius.
        radius: f32,
        /// Whether the front side is the inside.
        inward: bool,
        /// Unit vectors of the object-space axes in world space.
        axes: Mat3,
    },
    /// A disk, possibly transformed to an ellipse.
    Disk {
        /// Centre.
        center: Vec3,
        /// Image of the unit disk's x axis.
        du: Vec3,
        /// Image of the unit disk's y axis.
        dv: Vec3,
        /// Unit normal of the front side.
        normal: Vec3,
    },
    /// An open cylinder, without caps.
    Cylinder {
        /// Centre of the lower end.
        p0: Vec3,
        /// Centre of the upper end.
        p1: Vec3,
        /// The vectors from the axis to the surface at u = 0 and at u = 1/4.
        side: [Vec3; 2],
        /// Whether the front side is the inside.
        inward: bool,
    },
    /// Curves.
    Curves(Arc<WorldCurves>),
    /// The isosurface of a grid of signed distances.
    SdfGrid(Arc<WorldSdfGrid>),
}

impl WorldShape {
    /// Applies a transform. Shapes with their own normals (rectangle, cube, disk, smooth meshes) keep their front
    /// side under a reflection. The front side of a faceted mesh depends on the order of its vertices.
    pub fn new(shape: Shape, to_world: &DAffine3, flip: bool) -> Result<Self> {
        Ok(match shape {
            Shape::Mesh(mesh) => WorldShape::Mesh(Arc::new(transform_mesh(mesh, to_world, flip))),
            Shape::Cube => {
                let mirrored = to_world.matrix3.determinant() < 0.0;
                WorldShape::Mesh(Arc::new(transform_mesh(cube(), to_world, flip != mirrored)))
            }
            Shape::Rectangle => rectangle(to_world, flip),
            Shape::Sphere { center, radius } => sphere(center, radius, to_world, flip)?,
            Shape::Cylinder { p0, p1, radius } => cylinder([p0, p1], radius, to_world, flip)?,
            Shape::Curves(_) if flip => {
                return Err(Error::scene(
                    "the normals of curves always point outwards, so they cannot be flipped",
                ));
            }
            Shape::Curves(curves) => WorldShape::Curves(Arc::new(WorldCurves::new(curves, to_world))),
            Shape::SdfGrid(_) if flip => {
                return Err(Error::scene(
                    "the normals of an sdfgrid point to greater distances, so they cannot be flipped",
                ));
            }
            Shape::SdfGrid(grid) => WorldShape::SdfGrid(Arc::new(WorldSdfGrid::new(grid, to_world)?)),
            Shape::Disk => {
                let normal = transform_normal(&to_world.matrix3, Vec3::Z);
                WorldShape::Disk {
                    center: to_world.translation.as_vec3(),
                    du: to_world.matrix3.x_axis.as_vec3(),
                    dv: to_world.matrix3.y_axis.as_vec3(),
                    normal: if flip { -normal } else { normal },
                }
            }
        })
    }

    /// Returns the geometry for the accelerator.
    pub fn geometry(&self) -> Geometry {
        match self {
            WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => {
                Geometry::Triangles { positions: mesh.positions.clone(), indices: mesh.indices.clone() }
            }
            WorldShape::Sphere { center, radius, .. } => {
                Geometry::Analytic(Primitive::Sphere { center: *center, radius: *radius })
            }
            WorldShape::Disk { center, du, dv, .. } => {
                Geometry::Analytic(Primitive::Disk { center: *center, du: *du, dv: *dv })
            }
            WorldShape::Cylinder { p0, p1, side, .. } => {
                Geometry::Analytic(Primitive::Cylinder { p0: *p0, p1: *p1, radius: side[0].length() })
            }
            WorldShape::Curves(curves) => Geometry::Surfaces(Arc::clone(&curves.segments) as _),
            WorldShape::SdfGrid(grid) => Geometry::Surfaces(Arc::clone(&grid.cells) as _),
        }
    }

    /// Returns the number of triangles; 0 for an analytic shape.
    pub fn triangle_count(&self) -> usize {
        match self {
            WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => mesh.indices.len(),
            _ => 0,
        }
    }

    /// Returns the bytes of the arrays.
    pub fn memory_bytes(&self) -> usize {
        match self {
            WorldShape::Mesh(mesh) | WorldShape::Rectangle { mesh, .. } => mesh.memory_bytes(),
            WorldShape::Curves(curves) => curves.memory_bytes(),
            WorldShape::SdfGrid(grid) => grid.memory_bytes(),
            _ => 0,
        }
    }
}

/// Transforms a normal by the inverse transpose, computed as the cofactor matrix, which exists for every map that
/// does not collapse the surface. The result is on the side of the transformed normal vector.
fn transform_normal(m: &DMat3, n: Vec3) -> Vec3 {
    let (x, y, z) = (m.x_axis, m.y_axis, m.z_axis);
    let cofactor = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    let side = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    (cofactor * n.as_dvec3() * side).normalize_or_zero().as_vec3()
}

fn transform_mesh(mesh: Mesh, to_world: &DAffine3, flip: bool) -> TriangleMesh {
    let Mesh { mut positions, mut normals, uvs, mut indices, attributes } = mesh;
    if *to_world != DAffine3::IDENTITY {
        for p in &mut positions {
            *p = to_world.transform_point3(p.as_dvec3()).as_vec3();
        }
        for n in &mut normals {
            *n = transform_normal(&to_world.matrix3, *n);
        }
    }
    if flip {
        normals.iter_mut().for_each(|n| *n = -*n);
        indices.iter_mut().for_each(|t| t.swap(1, 2));
    }
    TriangleMesh {
        positions: Arc::new(positions.into()),
        indices: Arc::new(indices),
        normals,
        uvs,
        attributes,
    }
}

fn rectangle(to_world: &DAffine3, flip: bool) -> WorldShape {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let mesh = Mesh {
        positions: corners.iter().map(|&(x, y)| Vec3::new(x, y, 0.0)).collect(),
        normals: Vec::new(),
        uvs: corners.iter().map(|&(x, y)| Vec2::new(0.5 * (x + 1.0), 0.5 * (y + 1.0))).collect(),
        indices: vec![[0, 1, 2], [2, 3, 0]],
        attributes: Vec::new(),
    };
    let mirrored = to_world.matrix3.determinant() < 0.0;
    let mesh = transform_mesh(mesh, to_world, flip != mirrored);
    let normal = transform_normal(&to_world.matrix3, Vec3::Z);
    WorldShape::Rectangle {
        corner: mesh.positions[0],
        edge_x: mesh.positions[1] - mesh.positions[0],
        edge_y: mesh.positions[3] - mesh.positions[0],
        normal: if flip { -normal } else { normal },
        mesh: Arc::new(mesh),
    }
}

/// Creates the six faces of the cube, each with its own four vertices. On a face, u runs along `s` and v along `t`.
fn cube() -> Mesh {
    let faces = [
        (Vec3::NEG_Y, Vec3::Z, Vec3::X),
        (Vec3::Y, Vec3::NEG_X, Vec3::NEG_Z),
        (Vec3::X, Vec3::Y, Vec3::NEG_Z),
        (Vec3::Z, Vec3::Y, Vec3::X),
        (Vec3::NEG_X, Vec3::Y, Vec3::Z),
        (Vec3::NEG_Z, Vec3::NEG_Y, Vec3::X),
    ];
    let mut mesh = Mesh::default();
    for (n, s, t) in faces {
        let base = mesh.positions.len() as u32;
        for (u, v) in [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)] {
            mesh.positions.push(n + s * (2.0 * u - 1.0) + t * (2.0 * v - 1.0));
            mesh.uvs.push(Vec2::new(u, v));
        }
        mesh.indices.push([base, base + 1, base + 2]);
        mesh.indices.push([base + 3, base, base + 2]);
    }
    mesh
}

fn sphere(center: Vec3, radius: f32, to_world: &DAffine3, flip: bool) -> Result<WorldShape> {
    let m = &to_world.matrix3;
    let lengths = [m.x_axis.length(), m.y_axis.length(), m.z_axis.length()];
    let skew = m.x_axis.dot(m.y_axis).abs() + m.y_axis.dot(m.z_axis).abs() + m.z_axis.dot(m.x_axis).abs();
    let uneven = lengths.iter().any(|l| (l - lengths[0]).abs() > 1e-4 * lengths[0]);
    if uneven || skew > 1e-4 * lengths[0] * lengths[0] {
        return Err(Error::scene(format!(
            "expected a uniform scale of a sphere, found scales {:.6}, {:.6} and {:.6} along its axes{}",
            lengths[0],
            lengths[1],
            lengths[2],
            if uneven { "" } else { " and a shear" }
        )));
    }
    Ok(WorldShape::Sphere {
        center: to_world.transform_point3(center.as_dvec3()).as_vec3(),
        radius: (f64::from(radius) * lengths[0]) as f32,
        inward: flip != (m.determinant() < 0.0),
        axes: DMat3::from_cols(m.x_axis / lengths[0], m.y_axis / lengths[0], m.z_axis / lengths[0]).as_mat3(),
    })
}

fn cylinder(ends: [Vec3; 2], radius: f32, to_world: &DAffine3, flip: bool) -> Result<WorldShape> {
    let [p0, p1] = ends.map(|p| to_world.transform_point3(p.as_dvec3()));
    let local = Frame::from_normal((ends[1] - ends[0]).normalize());
    let side = [local.s, local.t].map(|v| to_world.matrix3 * v.as_dvec3() * f64::from(radius));
    let axis = (p1 - p0).normalize();
    let lengths = side.map(DVec3::length);
    let lean = [side[0].dot(side[1]) / lengths[0], side[0].dot(axis), side[1].dot(axis)];
    let uneven = (lengths[1] - lengths[0]).abs();
    if lean.iter().chain([&uneven]).any(|off| off.abs() > 1e-4 * lengths[0]) {
        return Err(Error::scene("expected a transform that keeps the cylinder's cross section circular"));
    }
    Ok(WorldShape::Cylinder {
        p0: p0.as_vec3(),
        p1: p1.as_vec3(),
        side: side.map(|v| v.as_vec3()),
        inward: flip,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normal_of(mesh: &TriangleMesh, i: usize) -> Vec3 {
        let [a, b, c] = mesh.triangle(i);
        (b - a).cross(c - a).normalize()
    }

    #[test]
    fn fronts_of_rectangles_and_cubes_survive_mirroring() {
        for scale in [DVec3::ONE, DVec3::new(-1.0, 1.0, 1.0), DVec3::new(2.0, 3.0, -0.5)] {
            for flip in [false, true] {
                let m = DAffine3::from_scale(scale);
                let side = if flip { -1.0 } else { 1.0 };
                let WorldShape::Rectangle { mesh, normal, .. } =
                    WorldShape::new(Shape::Rectangle, &m, flip).unwrap()
                else {
                    panic!("a rectangle stays one")
                };
                let front = Vec3::Z * side * scale.z.signum() as f32;
                assert_eq!(normal_of(&mesh, 0), front);
                assert_eq!(normal, front);
                let WorldShape::Mesh(mesh) = WorldShape::new(Shape::Cube, &m, flip).unwrap() else {
                    panic!("a cube becomes a mesh")
                };
                for i in 0..12 {
                    let [a, b, c] = mesh.triangle(i);
                    let outwards = (a + b + c).dot(normal_of(&mesh, i)) * side;
                    assert!(outwards > 0.0, "face {i} of {scale} {flip}");
                }
            }
        }
    }

    #[test]
    fn a_squeezed_sphere_is_refused_with_its_scales() {
        let m = DAffine3::from_scale(DVec3::new(1.0, 2.0, 1.0));
        let Err(e) = WorldShape::new(Shape::Sphere { center: Vec3::ZERO, radius: 1.0 }, &m, false) else {
            panic!("a squeezed sphere must be refused")
        };
        assert_eq!(
            e.to_string(),
            "expected a uniform scale of a sphere, found scales 1.000000, 2.000000 and 1.000000 along its axes"
        );
    }
}
