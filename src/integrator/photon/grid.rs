//! A hashed grid of photons for queries with a fixed radius.
//!
//! If all queries have the same radius, a grid is built several times faster than a tree and has the same query
//! speed.

use crate::color::Rgb;
use crate::math::Vec3;
use crate::math::octahedral::{decode_octahedral, encode_octahedral};
use crate::sampling::hash::combine;
use crate::scene::{Scene, SurfaceInteraction};
use rayon::prelude::*;

use super::tracing::Deposit;

/// The least cosine between the normals of photon and point. Below it, the photon is assumed to be around a corner.
const MIN_COSINE: f32 = 0.7;

/// The surface at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonSurface {
    /// The geometric normal of the front side, of unit length.
    pub ng: Vec3,
    /// Whether light may pass through it, at some of its points at least.
    pub transmits: bool,
}

impl PhotonSurface {
    /// Returns the surface at a point.
    #[inline]
    pub fn at(scene: &Scene, point: &SurfaceInteraction) -> Self {
        PhotonSurface { ng: point.ng, transmits: scene.materials.get(point.material).transmits }
    }

    /// Returns whether two near points may be on the same surface.
    ///
    /// Light that passes through a surface arrives again at the next one behind it, and must count once for each. So a
    /// surface that transmits is never the same as one that does not, and the two faces of a pane differ, because their
    /// fronts face opposite ways. Opaque surfaces may be meshes in which the fronts of triangles differ, so the sign of
    /// their normals does not matter.
    #[inline]
    pub fn matches(self, other: PhotonSurface) -> bool {
        let cosine = self.ng.dot(other.ng);
        self.transmits == other.transmits && MIN_COSINE < if self.transmits { cosine } else { cosine.abs() }
    }
}

/// A photon in a grid: 40 bytes, with everything except the normal in full precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridPhoton {
    /// The position.
    pub p: Vec3,
    /// The unit direction towards the incident light.
    pub wi: Vec3,
    /// The power relative to the shading frame, W, of a path traced alone.
    pub power: Rgb,
    normal: u16,
    /// The number of edges from the emitter, and the flags [`CAUSTIC`] and [`TRANSMITS`].
    edges: u16,
}

/// The flag of caustic light.
const CAUSTIC: u16 = 1 << 15;
/// The flag of a surface that transmits.
const TRANSMITS: u16 = 1 << 14;

impl GridPhoton {
    /// The greatest number of edges that is represented.
    pub const MOST_EDGES: u32 = TRANSMITS as u32 - 1;

    /// Converts a deposit.
    pub fn new(deposit: &Deposit) -> Self {
        let edges = deposit.edges.min(Self::MOST_EDGES) as u16;
        GridPhoton {
            p: deposit.p,
            wi: deposit.wi,
            power: deposit.shading_power(),
            normal: encode_octahedral(deposit.surface.ng),
            edges: edges
                | if deposit.caustic { CAUSTIC } else { 0 }
                | if deposit.surface.transmits { TRANSMITS } else { 0 },
        }
    }

    /// Returns the surface, with an error of the normal of about half a degree.
    #[inline]
    pub fn surface(&self) -> PhotonSurface {
        PhotonSurface { ng: decode_octahedral(self.normal), transmits: self.edges & TRANSMITS != 0 }
    }

    /// Returns the number of edges from the emitter.
    #[inline]
    pub fn edges(&self) -> u32 {
        u32::from(self.edges & (TRANSMITS - 1))
    }

    /// Returns whether only Dirac deltas scattered the light.
    #[inline]
    pub fn is_caustic(&self) -> bool {
        self.edges & CAUSTIC != 0
    }
}

/// A photon of a grid.
pub trait Positioned: Copy + Send + Sync {
    /// Returns the position in world space.
    fn position(&self) -> Vec3;
}

impl Positioned for GridPhoton {
    #[inline]
    fn position(&self) -> Vec3 {
        self.p
    }
}

/// Photons sorted by their cell in a regular grid. A hash maps cells to buckets.
#[derive(Debug)]
pub struct PhotonGrid<P = GridPhoton> {
    photons: Vec<P>,
    /// The index of the first photon of each bucket, and the number of photons.
    starts: Vec<u32>,
    radius: f32,
    per_cell: f32,
}

/// The ratio between the width of a cell and the diameter of a query. It makes a query overlap more than two cells
/// along an axis only rarely.
const SLACK: f32 = 1.0 + 1e-3;

impl<P> Default for PhotonGrid<P> {
    fn default() -> Self {
        PhotonGrid { photons: Vec::new(), starts: Vec::new(), radius: 0.0, per_cell: 0.0 }
    }
}

impl<P: Positioned> PhotonGrid<P> {
    /// Builds the grid for queries with the given radius, which is positive and finite. Photons keep their order
    /// within a bucket.
    ///
    /// # Panics
    /// If there are 2^32 photons or more.
    pub fn new(photons: &[P], radius: f32) -> Self {
        assert!(u32::try_from(photons.len()).is_ok(), "{} photons in one grid", photons.len());
        let per_cell = 1.0 / (2.0 * SLACK * radius);
        let buckets = photons.len().next_power_of_two().max(1);
        let mask = (buckets - 1) as u32;
        // The bucket is in the upper bits and the index in the lower, so every sorting algorithm gives the same
        // order.
        let mut order: Vec<u64> = photons
            .par_iter()
            .enumerate()
            .map(|(i, photon)| u64::from(bucket(cell(photon.position(), per_cell), mask)) << 32 | i as u64)
            .collect();
        order.par_sort_unstable();
        let mut starts = Vec::with_capacity(buckets + 1);
        for (i, entry) in order.iter().enumerate() {
            let bucket = (entry >> 32) as usize;
            while starts.len() <= bucket {
                starts.push(i as u32);
            }
        }
        starts.resize(buckets + 1, order.len() as u32);
        let photons = order.par_iter().map(|entry| photons[*entry as u32 as usize]).collect();
        PhotonGrid { photons, starts, radius, per_cell }
    }

    /// Returns the radius of queries.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Returns the number of photons.
    pub fn len(&self) -> usize {
        self.photons.len()
    }

    /// Returns whether there are no photons.
    pub fn is_empty(&self) -> bool {
        self.photons.is_empty()
    }

    /// Returns the bytes of memory.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&*self.photons) + size_of_val(&*self.starts)
    }

    /// Calls `visit` for every photon nearer to `p` than the radius, with its squared distance.
    #[inline]
    pub fn within(&self, p: Vec3, mut visit: impl FnMut(&P, f32)) {
        if self.photons.is_empty() {
            return;
        }
        let reach = Vec3::splat(self.radius);
        let (low, high) = (cell(p - reach, self.per_cell), cell(p + reach, self.per_cell));
        let mask = (self.starts.len() - 2) as u32;
        // Rounding may add a third cell along an axis, but not a fourth.
        let mut seen = [u32::MAX; 27];
        let mut count = 0;
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let bucket = bucket([x, y, z], mask);
                    if seen[..count].contains(&bucket) {
                        continue;
                    }
                    (seen[count], count) = (bucket, count + 1);
                    let [start, end] = [0, 1].map(|k| self.starts[bucket as usize + k] as usize);
                    for photon in &self.photons[start..end] {
                        let squared = (photon.position() - p).length_squared();
                        if squared < self.radius * self.radius {
                            visit(photon, squared);
                        }
                    }
                }
            }
        }
    }
}

/// Returns the cell of a point. Rounding is monotonic, so every photon within the radius is in one of the query's
/// cells.
#[inline]
fn cell(p: Vec3, per_cell: f32) -> [i32; 3] {
    // The conversion saturates for distant points.
    (p * per_cell).floor().to_array().map(|x| x as i32)
}

#[inline]
fn bucket([x, y, z]: [i32; 3], mask: u32) -> u32 {
    combine(combine(x as u32, y as u32), z as u32) & mask
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::{mix, to_unit};

    fn photon(p: Vec3) -> GridPhoton {
        let deposit = Deposit {
            p,
            wi: Vec3::Z,
            surface: PhotonSurface { ng: Vec3::Z, transmits: p.y > 0.0 },
            power: Rgb::WHITE,
            cosine_ratio: 0.5,
            edges: 70_000,
            caustic: p.x > 0.0,
            path: 0,
        };
        GridPhoton::new(&deposit)
    }

    /// Points of a shape in a cube of the given size and centre.
    fn points(n: u32, shape: u32, centre: f32, size: f32) -> Vec<GridPhoton> {
        let u = |i: u32| to_unit(mix(i)) * size + centre - 0.5 * size;
        let point = |i: u32| match shape {
            0 => Vec3::new(u(3 * i), u(3 * i + 1), u(3 * i + 2)),
            1 => Vec3::new(u(3 * i), u(3 * i + 1), centre),
            2 => Vec3::splat(u(i % 7)),
            _ => Vec3::splat(centre),
        };
        (0..n).map(|i| photon(point(i))).collect()
    }

    #[test]
    fn the_grid_finds_what_a_search_of_all_finds() {
        for shape in 0..4 {
            for (centre, size, radius) in
                [(0.0, 2.0, 0.11), (-3.0, 1.0, 3.0), (1e6, 64.0, 8.0), (0.0, 1.0, 1e-3), (1e30, 1e29, 1e20)]
            {
                let photons = points(700, shape, centre, size);
                let grid = PhotonGrid::new(&photons, radius);
                assert_eq!(grid.len(), 700);
                let mut total = 0;
                for query in points(100, shape, centre, 1.1 * size) {
                    let near = |p: &&GridPhoton| (p.p - query.p).length_squared() < radius * radius;
                    let mut expected: Vec<[u32; 3]> =
                        photons.iter().filter(near).map(|p| p.p.to_array().map(f32::to_bits)).collect();
                    let mut found = Vec::new();
                    grid.within(query.p, |p, _| found.push(p.p.to_array().map(f32::to_bits)));
                    expected.sort_unstable();
                    found.sort_unstable();
                    assert_eq!(found, expected, "{shape} {centre} {size} {radius}");
                    total += found.len();
                }
                // Queries are farther apart than points. They coincide with points only if all points are equal.
                assert!(total > 0 || shape < 3, "{shape} {centre} {size} {radius}");
            }
        }
    }

    #[test]
    fn surfaces_that_transmit_are_told_apart() {
        let surface = |x: f32, z: f32, transmits| PhotonSurface { ng: Vec3::new(x, 0.0, z), transmits };
        for transmits in [false, true] {
            let up = surface(0.0, 1.0, transmits);
            assert!(up.matches(up) && up.matches(surface(0.6, 0.8, transmits)));
            assert!(!up.matches(surface(0.8, 0.6, transmits)) && !up.matches(surface(0.0, 1.0, !transmits)));
            assert_eq!(up.matches(surface(0.0, -1.0, transmits)), !transmits);
        }
    }

    #[test]
    fn none_and_one_photon() {
        let count = |grid: &PhotonGrid| {
            let mut n = 0;
            grid.within(Vec3::ZERO, |_, _| n += 1);
            n
        };
        assert_eq!(count(&PhotonGrid::<GridPhoton>::new(&[], 1.0)), 0);
        assert_eq!(count(&PhotonGrid::default()), 0);
        let one = photon(Vec3::new(0.5, 0.0, 0.0));
        assert_eq!(count(&PhotonGrid::new(&[one], 1.0)), 1);
        assert_eq!(count(&PhotonGrid::new(&[one], 0.5)), 0);
        assert!(one.is_caustic() && !photon(Vec3::ZERO).is_caustic());
        assert_eq!((one.edges(), one.power), (GridPhoton::MOST_EDGES, Rgb::splat(0.5)));
        let [opaque, transmitting] = [Vec3::ZERO, Vec3::Y].map(|p| photon(p).surface());
        assert_eq!((opaque.transmits, transmitting.transmits), (false, true));
        assert!(opaque.ng.distance(Vec3::Z) < 0.02);
        assert_eq!(size_of::<GridPhoton>(), 40);
    }
}
