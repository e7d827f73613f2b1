//! Rays and hits in Embree's memory layouts, as plain arrays.

use super::INVALID_ID;
use buffon_embree_sys as sys;
use std::mem::{align_of, offset_of, size_of};

/// The number of rays in a packet.
pub const WIDTH: usize = 16;

/// The greatest absolute value of a component of a vertex or a ray; Embree's `FLT_LARGE`.
pub const COMPONENT_LIMIT: f32 = 1.844e18;

/// The smallest normal number. Embree accepts hits at `t_near` itself, but a ray that starts exactly in the plane of
/// a triangle (such as a floor at height 0) must not hit it at distance 0.
pub const T_NEAR: f32 = f32::MIN_POSITIVE;

/// A ray and its hit: `RTCRayHit`.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub struct RayHit1 {
    /// Origin.
    pub origin: [f32; 3],
    /// Lower bound of a hit's parameter.
    pub t_near: f32,
    /// Direction, of any length.
    pub direction: [f32; 3],
    /// Time in [0, 1].
    pub time: f32,
    /// Upper bound of a hit's parameter; after a query the parameter of the hit, or -∞ for an occluded ray.
    pub t_far: f32,
    mask: u32,
    /// An identifier for the callbacks.
    pub id: u32,
    flags: u32,
    normal: [f32; 3],
    /// First surface coordinate of the hit.
    pub u: f32,
    /// Second surface coordinate of the hit.
    pub v: f32,
    /// Primitive of the hit.
    pub primitive: u32,
    /// Geometry of the hit, or [`INVALID_ID`] for a miss.
    pub geometry: u32,
    /// Instance of the hit, or [`INVALID_ID`].
    pub instance: u32,
}

impl RayHit1 {
    /// Creates a ray without a hit from 8 floats (origin, t_far, direction, time); `t_near` is [`T_NEAR`].
    #[inline]
    pub fn new(ray: &[f32; 8]) -> Self {
        RayHit1 {
            origin: [ray[0], ray[1], ray[2]],
            t_near: T_NEAR,
            direction: [ray[4], ray[5], ray[6]],
            time: ray[7],
            t_far: ray[3],
            mask: u32::MAX,
            id: 0,
            flags: 0,
            normal: [0.0; 3],
            u: 0.0,
            v: 0.0,
            primitive: INVALID_ID,
            geometry: INVALID_ID,
            instance: INVALID_ID,
        }
    }
}

/// Sixteen rays, one array for each component: `RTCRay16`.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct Rays16 {
    /// Origins.
    pub origin: [[f32; WIDTH]; 3],
    /// Lower bounds of a hit's parameter.
    pub t_near: [f32; WIDTH],
    /// Directions, of any length.
    pub direction: [[f32; WIDTH]; 3],
    /// Times in [0, 1].
    pub time: [f32; WIDTH],
    /// Upper bounds of a hit's parameter; after an occlusion query -∞ for an occluded ray.
    pub t_far: [f32; WIDTH],
    mask: [u32; WIDTH],
    /// Identifiers for the callbacks.
    pub id: [u32; WIDTH],
    flags: [u32; WIDTH],
}

/// Sixteen rays and their hits: `RTCRayHit16`.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct RayHits16 {
    /// The rays; after a query `t_far` is the hit's parameter.
    pub rays: Rays16,
    normal: [[f32; WIDTH]; 3],
    /// First surface coordinates.
    pub u: [f32; WIDTH],
    /// Second surface coordinates.
    pub v: [f32; WIDTH],
    /// Primitives.
    pub primitive: [u32; WIDTH],
    /// Geometries, or [`INVALID_ID`] for a miss.
    pub geometry: [u32; WIDTH],
    /// Instances, or [`INVALID_ID`].
    pub instance: [u32; WIDTH],
}

/// A mask of the active rays of a packet. It is aligned to 64 bytes, as Embree requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C, align(64))]
pub struct Mask16([i32; WIDTH]);

impl Mask16 {
    /// All rays are active.
    pub const ALL: Mask16 = Mask16([-1; WIDTH]);

    /// Creates a mask of the rays for which `active` returns true.
    #[inline]
    pub fn from_fn(mut chosen: impl FnMut(usize) -> bool) -> Self {
        let mut mask = [0; WIDTH];
        for (i, lane) in mask.iter_mut().enumerate() {
            *lane = -i32::from(chosen(i));
        }
        Mask16(mask)
    }

    /// Returns whether ray `i` is active.
    #[inline]
    pub fn get(&self, i: usize) -> bool {
        self.0[i] != 0
    }

    /// Returns the pointer for the C call: 16 values of 0 or -1, aligned to 64 bytes.
    #[inline]
    pub(super) fn as_ptr(&self) -> *const i32 {
        self.0.as_ptr()
    }
}

impl Default for Rays16 {
    /// Returns rays with direction zero, visible to every mask, with `t_near` = [`T_NEAR`].
    fn default() -> Self {
        let zero = [0.0; WIDTH];
        Rays16 {
            origin: [zero; 3],
            t_near: [T_NEAR; WIDTH],
            direction: [zero; 3],
            time: zero,
            t_far: zero,
            mask: [u32::MAX; WIDTH],
            id: [0; WIDTH],
            flags: [0; WIDTH],
        }
    }
}

impl Default for RayHits16 {
    fn default() -> Self {
        let none = [INVALID_ID; WIDTH];
        RayHits16 {
            rays: Rays16::default(),
            normal: [[0.0; WIDTH]; 3],
            u: [0.0; WIDTH],
            v: [0.0; WIDTH],
            primitive: none,
            geometry: none,
            instance: none,
        }
    }
}

impl RayHits16 {
    /// Resets the hits, so that the packet can be used again.
    #[inline]
    pub fn clear_hits(&mut self) {
        self.geometry = [INVALID_ID; WIDTH];
        self.instance = [INVALID_ID; WIDTH];
    }
}

impl Rays16 {
    /// Transposes sixteen rays of 8 floats (origin, t_far, direction, time) into the packet.
    #[inline]
    pub fn load(&mut self, rays: &[[f32; 8]; WIDTH]) {
        let [x, y, z] = &mut self.origin;
        let [dx, dy, dz] = &mut self.direction;
        transpose(rays, [x, y, z, &mut self.t_far, dx, dy, dz, &mut self.time]);
    }

    /// Fills the first `rays.len()` rays of the packet as [`load`](Self::load) does; the others become invalid rays.
    ///
    /// # Panics
    /// If there are more rays than a packet holds.
    pub fn load_tail(&mut self, rays: &[[f32; 8]]) {
        let mut padded = [[0.0; 8]; WIDTH];
        padded[..rays.len()].copy_from_slice(rays);
        self.load(&padded);
    }

    /// Returns the active rays that are valid: see [`CommittedScene`](super::CommittedScene).
    #[inline]
    pub(super) fn valid(&self, active: &Mask16, limit: f32) -> Mask16 {
        let ([x, y, z], [dx, dy, dz]) = (&self.origin, &self.direction);
        let mut mask = active.0;
        for (i, lane) in mask.iter_mut().enumerate() {
            let ray = [x[i], y[i], z[i], dx[i], dy[i], dz[i]];
            *lane &= -i32::from(is_valid(ray, limit, self.t_near[i], self.t_far[i], self.time[i]));
        }
        Mask16(mask)
    }
}

impl RayHit1 {
    /// Returns whether the ray is valid: see [`CommittedScene`](super::CommittedScene).
    #[inline]
    pub(super) fn is_valid(&self, limit: f32) -> bool {
        let ([x, y, z], [dx, dy, dz]) = (self.origin, self.direction);
        is_valid([x, y, z, dx, dy, dz], limit, self.t_near, self.t_far, self.time)
    }
}

/// Returns whether all components of origin and direction are within `limit`, the direction is not zero, `0 ≤ t_near
/// < t_far`, and the time is in [0, 1]. False for NaN.
#[inline]
fn is_valid([x, y, z, dx, dy, dz]: [f32; 6], limit: f32, t_near: f32, t_far: f32, time: f32) -> bool {
    let mut valid = (t_near >= 0.0) & (t_far > t_near);
    valid &= time >= 0.0;
    valid &= time <= 1.0;
    for component in [x, y, z, dx, dy, dz] {
        valid &= component.abs() <= limit;
    }
    valid & ((dx != 0.0) | (dy != 0.0) | (dz != 0.0))
}

/// Computes `columns[k][i] = rows[i][k]`.
#[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
#[inline]
fn transpose(rows: &[[f32; 8]; WIDTH], columns: [&mut [f32; WIDTH]; 8]) {
    use std::arch::x86_64::*;
    let columns = columns.map(|c| c.as_mut_ptr());
    for half in [0, 8] {
        let row = |i: usize| rows[half + i].as_ptr();
        // Loads four floats of row i, from `k`, into the low half, and those of row i+4 into the high half.
        // SAFETY: the `cfg` ensures AVX2. Each load reads four floats at k = 0 or 4 of a row of eight.
        let pair = |i: usize, k: usize| unsafe {
            _mm256_insertf128_ps::<1>(
                _mm256_castps128_ps256(_mm_loadu_ps(row(i).add(k))),
                _mm_loadu_ps(row(i + 4).add(k)),
            )
        };
        for k in [0, 4] {
            // SAFETY: the `cfg` ensures AVX2. Each store writes eight floats at `half` = 0 or 8 of a column of
            // sixteen.
            unsafe {
                let (a, b, c, d) = (pair(0, k), pair(1, k), pair(2, k), pair(3, k));
                let (ab_lo, ab_hi) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
                let (cd_lo, cd_hi) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
                let out = |j: usize, v: __m256| _mm256_storeu_ps(columns[k + j].add(half), v);
                out(0, _mm256_shuffle_ps::<0b01_00_01_00>(ab_lo, cd_lo));
                out(1, _mm256_shuffle_ps::<0b11_10_11_10>(ab_lo, cd_lo));
                out(2, _mm256_shuffle_ps::<0b01_00_01_00>(ab_hi, cd_hi));
                out(3, _mm256_shuffle_ps::<0b11_10_11_10>(ab_hi, cd_hi));
            }
        }
    }
}

/// Computes `columns[k][i] = rows[i][k]`.
#[cfg(not(all(target_arch = "x86_64", target_feature = "avx2")))]
#[inline]
fn transpose(rows: &[[f32; 8]; WIDTH], columns: [&mut [f32; WIDTH]; 8]) {
    for (k, column) in columns.into_iter().enumerate() {
        for (i, row) in rows.iter().enumerate() {
            column[i] = row[k];
        }
    }
}

// The layouts must be equal to Embree's.
const _: () = {
    assert!(size_of::<RayHit1>() == size_of::<sys::RTCRayHit>());
    assert!(align_of::<RayHit1>() == align_of::<sys::RTCRayHit>());
    assert!(offset_of!(RayHit1, t_far) == offset_of!(sys::RTCRay, tfar));
    assert!(offset_of!(RayHit1, u) == offset_of!(sys::RTCRayHit, hit) + offset_of!(sys::RTCHit, u));
    assert!(
        offset_of!(RayHit1, geometry) == offset_of!(sys::RTCRayHit, hit) + offset_of!(sys::RTCHit, geomID)
    );
    assert!(size_of::<Rays16>() == size_of::<sys::RTCRay16>());
    assert!(align_of::<Rays16>() == align_of::<sys::RTCRay16>());
    assert!(offset_of!(Rays16, direction) == offset_of!(sys::RTCRay16, dir_x));
    assert!(offset_of!(Rays16, t_far) == offset_of!(sys::RTCRay16, tfar));
    assert!(size_of::<RayHits16>() == size_of::<sys::RTCRayHit16>());
    assert!(align_of::<RayHits16>() == align_of::<sys::RTCRayHit16>());
    let hit = offset_of!(sys::RTCRayHit16, hit);
    assert!(offset_of!(RayHits16, u) == hit + offset_of!(sys::RTCHit16, u));
    assert!(offset_of!(RayHits16, primitive) == hit + offset_of!(sys::RTCHit16, primID));
    assert!(offset_of!(RayHits16, geometry) == hit + offset_of!(sys::RTCHit16, geomID));
    assert!(offset_of!(RayHits16, instance) == hit + offset_of!(sys::RTCHit16, instID));
    assert!(align_of::<Mask16>() == 64 && size_of::<Mask16>() == 64);
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_is_the_transpose_of_its_rays() {
        let rows: [[f32; 8]; WIDTH] =
            std::array::from_fn(|i| std::array::from_fn(|k| (i * 8 + k + 1) as f32));
        let mut rays = Rays16::default();
        rays.load(&rows);
        for (i, row) in rows.iter().enumerate() {
            let (o, d) = (rays.origin, rays.direction);
            let column = [o[0][i], o[1][i], o[2][i], rays.t_far[i], d[0][i], d[1][i], d[2][i], rays.time[i]];
            assert_eq!(&column, row);
        }
    }

    #[test]
    fn invalid_rays_are_masked() {
        let good = [1.0, 2.0, 3.0, f32::INFINITY, 0.0, -1.0, 0.0, 0.0];
        let mut rows = [good; 9];
        rows[1][0] = f32::NAN;
        rows[2][4] = f32::INFINITY;
        rows[3][5] = -0.0;
        rows[4][3] = 0.0;
        rows[5][3] = f32::NAN;
        rows[6][2] = -2e18;
        rows[7][7] = 1.5;
        rows[8][7] = f32::NAN;
        let mut rays = Rays16::default();
        rays.load_tail(&rows);
        let mask = rays.valid(&Mask16::ALL, COMPONENT_LIMIT);
        assert_eq!(mask, Mask16::from_fn(|i| i == 0));
        assert_eq!(mask.as_ptr() as usize % 64, 0);
    }
}
