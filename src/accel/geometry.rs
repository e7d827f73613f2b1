//! The neutral description of geometry that accelerators are built from, and its validation.

use super::primitive::Primitive;
use super::round_cone::RoundCone;
use crate::math::{Bounds, Vec3};
use std::ops::Deref;
use std::sync::Arc;

/// The greatest valid magnitude of a component of a vertex or ray, as in Embree. A primitive or ray beyond it is
/// invalid.
pub const COORDINATE_LIMIT: f32 = 1.844e18;

/// Vertex positions followed by padding, because Embree reads 16 bytes at the last position. Dereferences to the
/// positions without padding.
#[derive(Clone, Debug)]
pub struct VertexBuffer {
    /// The positions and one element of padding. Embree shares this array and does not depend on `Vec3`.
    data: Arc<Vec<[f32; 3]>>,
}

impl VertexBuffer {
    /// Returns the positions and the padding as plain arrays.
    pub fn padded(&self) -> &Arc<Vec<[f32; 3]>> {
        &self.data
    }
}

impl From<Vec<Vec3>> for VertexBuffer {
    /// Takes over the memory; the vector grows by one element.
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

/// One element of the list from which an accelerator is built. Its index in the list is
/// [`Hit::geometry`](super::Hit).
#[derive(Clone, Debug)]
pub enum Geometry {
    /// A triangle mesh. Accelerators share its arrays if they can.
    Triangles {
        /// Vertex positions.
        positions: Arc<VertexBuffer>,
        /// Three indices into the positions for each triangle.
        indices: Arc<Vec<[u32; 3]>>,
    },
    /// One analytic surface.
    Analytic(Primitive),
    /// Many analytic surfaces, such as the segments of curves. Each is a primitive.
    Surfaces(Arc<dyn Surfaces>),
}

/// Analytic surfaces of one geometry.
pub trait Surfaces: std::fmt::Debug + Send + Sync {
    /// Returns the number of surfaces, valid or invalid.
    fn count(&self) -> usize;

    /// Returns surface `i`.
    ///
    /// # Panics
    /// If there is no such surface.
    fn surface(&self, i: usize) -> Primitive;
}

impl dyn Surfaces {
    /// Returns the valid surfaces, each with its index.
    pub fn valid(&self) -> impl Iterator<Item = (u32, Primitive)> + '_ {
        let all = (0..self.count()).map(|i| (i as u32, self.surface(i)));
        all.filter(|(_, surface)| surface.is_valid())
    }
}

/// The segments of curves; each is a round cone.
#[derive(Clone, Debug, Default)]
pub struct CurveSegments {
    /// Positions, and the radius of the sphere around each.
    pub points: Vec<(Vec3, f32)>,
    /// For each segment, the index of its first point. The next point is its second one. The segments of a curve follow
    /// each other.
    pub first_points: Vec<u32>,
    /// The unit tangent at each point of smooth curves, whose segments end at the planes across the tangents and whose
    /// ends are disks; empty for curves with corners, whose segments end with spheres.
    pub tangents: Vec<Vec3>,
}

impl CurveSegments {
    /// Returns both ends of a segment.
    ///
    /// # Panics
    /// If there is no such segment, or no such point.
    #[inline]
    pub fn ends(&self, segment: usize) -> [(Vec3, f32); 2] {
        let first = self.first_points[segment] as usize;
        [self.points[first], self.points[first + 1]]
    }

    /// Returns the tangents at both ends of a segment; zero without tangents.
    ///
    /// # Panics
    /// As for [`ends`](Self::ends).
    #[inline]
    pub fn tangents(&self, segment: usize) -> [Vec3; 2] {
        let first = self.first_points[segment] as usize;
        if self.tangents.is_empty() {
            [Vec3::ZERO; 2]
        } else {
            [self.tangents[first], self.tangents[first + 1]]
        }
    }
}

impl Surfaces for CurveSegments {
    fn count(&self) -> usize {
        self.first_points.len()
    }

    #[inline]
    fn surface(&self, segment: usize) -> Primitive {
        let [(p0, r0), (p1, r1)] = self.ends(segment);
        let first = self.first_points[segment];
        let follows = segment > 0 && self.first_points[segment - 1] + 1 == first;
        let goes_on = self.first_points.get(segment + 1) == Some(&(first + 1));
        Primitive::RoundCone(RoundCone {
            centers: [p0, p1],
            radii: [r0, r1],
            planes: self.tangents(segment),
            closed: [!follows, !goes_on],
        })
    }
}

impl Geometry {
    /// Returns a geometry without primitives.
    pub fn nothing() -> Self {
        Geometry::Triangles { positions: Arc::new(Vec::new().into()), indices: Arc::new(Vec::new()) }
    }

    /// Returns the number of primitives, valid or invalid.
    pub fn len(&self) -> usize {
        match self {
            Geometry::Triangles { indices, .. } => indices.len(),
            Geometry::Analytic(_) => 1,
            Geometry::Surfaces(surfaces) => surfaces.count(),
        }
    }

    /// Returns the bounding box of the valid primitives.
    pub fn bounds(&self) -> Bounds {
        check(&mut self.clone()).bounds
    }

    /// Returns whether there is no primitive.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Returns the corners of a triangle, or `None` if it is invalid: an index out of range, or a vertex that is not
/// finite or exceeds [`COORDINATE_LIMIT`].
#[inline]
pub fn valid_triangle(positions: &[Vec3], triangle: [u32; 3]) -> Option<[Vec3; 3]> {
    let mut corners = [Vec3::ZERO; 3];
    for (corner, index) in corners.iter_mut().zip(triangle) {
        *corner = *positions.get(index as usize)?;
    }
    corners.iter().all(|&p| is_valid(p)).then_some(corners)
}

/// Returns whether all components are finite and within [`COORDINATE_LIMIT`]. False for NaN.
#[inline]
pub fn is_valid(p: Vec3) -> bool {
    p.abs().cmplt(Vec3::splat(COORDINATE_LIMIT)).all()
}

/// The result of [`check`] for one geometry.
pub(super) struct CheckedGeometry {
    /// The number of primitives that no back end can hit.
    pub dropped: usize,
    /// The bounding box of the valid primitives.
    pub bounds: Bounds,
}

/// Counts the invalid primitives and makes the geometry safe for every back end. A mesh with indices out of range
/// gets its own index array, in which each such triangle is a single point. Triangle indices do not change.
pub(super) fn check(geometry: &mut Geometry) -> CheckedGeometry {
    let mut result = CheckedGeometry { dropped: 0, bounds: Bounds::EMPTY };
    match geometry {
        Geometry::Triangles { positions, indices } => check_mesh(positions, indices, &mut result),
        Geometry::Analytic(primitive) if primitive.is_valid() => result.bounds = primitive.bounds(),
        Geometry::Analytic(_) => result.dropped = 1,
        Geometry::Surfaces(surfaces) => {
            let mut valid = 0;
            for (_, surface) in surfaces.valid() {
                result.bounds = result.bounds.union(surface.bounds());
                valid += 1;
            }
            result.dropped = surfaces.count() - valid;
        }
    }
    result
}

fn check_mesh(positions: &VertexBuffer, indices: &mut Arc<Vec<[u32; 3]>>, result: &mut CheckedGeometry) {
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
