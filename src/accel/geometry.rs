//! The neutral description that accelerators are built from, and its check.

use super::primitive::Primitive;
use crate::math::{Bounds, Vec3};
use std::ops::Deref;
use std::sync::Arc;

/// A vertex or a ray beyond this in any component makes a primitive or a ray invalid, as in Embree.
pub const COORDINATE_LIMIT: f32 = 1.844e18;

/// Vertex positions, followed by padding: Embree reads 16 bytes at the last one. Derefs to the positions alone.
#[derive(Clone, Debug)]
pub struct VertexBuffer {
    /// The positions and one element of padding; its own `Arc`, for Embree shares it and knows no `Vec3`.
    data: Arc<Vec<[f32; 3]>>,
}

impl VertexBuffer {
    /// The positions and the padding after them as plain arrays.
    pub fn padded(&self) -> &Arc<Vec<[f32; 3]>> {
        &self.data
    }
}

impl From<Vec<Vec3>> for VertexBuffer {
    /// Takes the memory over; it grows by one element.
    fn from(mut positions: Vec<Vec3>) -> Self {
        positions.reserve_exact(1);
        positions.push(Vec3::ZERO);
        VertexBuffer { data: Arc::new(bytemuck::cast_vec(positions)) }
    }
}

impl FromIterator<Vec3> for VertexBuffer {
    fn from_iter<I: IntoIterator<Item = Vec3>>(positions: I) -> Self {
        positions.into_iter().collect::<Vec<_>>().into()
    }
}

impl Deref for VertexBuffer {
    type Target = [Vec3];

    #[inline]
    fn deref(&self) -> &[Vec3] {
        bytemuck::cast_slice(&self.data[..self.data.len() - 1])
    }
}

/// One entry of the list that an accelerator is built from. Its index in the list is [`Hit::geometry`](super::Hit).
#[derive(Clone, Debug)]
pub enum Geometry {
    /// A triangle mesh; the arrays are shared with the accelerator where it can.
    Triangles {
        /// Vertex positions.
        positions: Arc<VertexBuffer>,
        /// Three indices into the positions for each triangle.
        indices: Arc<Vec<[u32; 3]>>,
    },
    /// One analytic surface.
    Analytic(Primitive),
}

impl Geometry {
    /// A geometry that no ray hits.
    pub fn nothing() -> Self {
        Geometry::Triangles { positions: Arc::new(Vec::new().into()), indices: Arc::new(Vec::new()) }
    }

    /// The number of primitives, valid or not.
    pub fn len(&self) -> usize {
        match self {
            Geometry::Triangles { indices, .. } => indices.len(),
            Geometry::Analytic(_) => 1,
        }
    }

    /// Whether there is no primitive.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The corners of a triangle, or `None` if it is invalid: an index out of range, or a vertex that is not finite
/// or beyond [`COORDINATE_LIMIT`].
#[inline]
pub fn valid_triangle(positions: &[Vec3], triangle: [u32; 3]) -> Option<[Vec3; 3]> {
    let mut corners = [Vec3::ZERO; 3];
    for (corner, index) in corners.iter_mut().zip(triangle) {
        *corner = *positions.get(index as usize)?;
    }
    corners.iter().all(|&p| is_valid(p)).then_some(corners)
}

/// Whether all components are finite and within [`COORDINATE_LIMIT`]. False for NaN.
#[inline]
pub fn is_valid(p: Vec3) -> bool {
    p.abs().cmplt(Vec3::splat(COORDINATE_LIMIT)).all()
}

/// What [`check`] finds in one geometry.
pub(super) struct Checked {
    /// Primitives that no back end will hit.
    pub dropped: usize,
    /// The box around all others.
    pub bounds: Bounds,
}

/// Counts the invalid primitives and makes the geometry safe for every back end: a mesh with indices out of range
/// gets its own index array, in which each such triangle is a single point. Triangle numbers do not change.
pub(super) fn check(geometry: &mut Geometry) -> Checked {
    let mut result = Checked { dropped: 0, bounds: Bounds::EMPTY };
    match geometry {
        Geometry::Triangles { positions, indices } => check_mesh(positions, indices, &mut result),
        Geometry::Analytic(primitive) if primitive.is_valid() => result.bounds = primitive.bounds(),
        Geometry::Analytic(_) => result.dropped = 1,
    }
    result
}

fn check_mesh(positions: &VertexBuffer, indices: &mut Arc<Vec<[u32; 3]>>, result: &mut Checked) {
    let count = positions.len();
    let mut out_of_range = false;
    for &triangle in indices.iter() {
        match valid_triangle(positions, triangle) {
            Some(corners) => result.bounds = result.bounds.union(Bounds::of(corners)),
            None => {
                result.dropped += 1;
                out_of_range |= triangle.iter().any(|&i| i as usize >= count);
            }
        }
    }
    if out_of_range {
        let repaired =
            indices.iter().map(|t| if t.iter().all(|&i| (i as usize) < count) { *t } else { [0; 3] });
        *indices = Arc::new(if count == 0 { Vec::new() } else { repaired.collect() });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vertex_buffer_derefs_without_its_padding() {
        let buffer: VertexBuffer = [Vec3::X, Vec3::Y].into_iter().collect();
        assert_eq!(&*buffer, &[Vec3::X, Vec3::Y]);
        assert_eq!(buffer.padded().len(), 3);
        assert!(VertexBuffer::from(Vec::new()).is_empty());
    }

    #[test]
    fn invalid_primitives_are_counted_and_indices_repaired() {
        let positions: VertexBuffer =
            [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::NAN, Vec3::splat(1e19)].into_iter().collect();
        let indices = vec![[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 5], [0, 0, 0]];
        let mut mesh = Geometry::Triangles { positions: Arc::new(positions), indices: Arc::new(indices) };
        let checked = check(&mut mesh);
        assert_eq!(checked.dropped, 3);
        assert_eq!(checked.bounds, Bounds::of([Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0)]));
        let mut sphere = Geometry::Analytic(Primitive::Sphere { center: Vec3::ZERO, radius: -1.0 });
        assert_eq!(check(&mut sphere).dropped, 1);
        let Geometry::Triangles { indices, .. } = &mesh else { unreachable!() };
        assert_eq!(indices[3], [0; 3]);
        assert_eq!(indices[1], [0, 1, 3]);
    }
}
