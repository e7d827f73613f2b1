//! Octahedral encoding of unit vectors in two bytes: points of an unfolded octahedron on a grid of 255 x 255.
//! [Cigolle 2014]

use super::lanes::{LANES, f32x16};
use super::{Vec3, Vec3x16};

/// The greatest coordinate. The centre of the square is the pole (0, 0, 1), and the six axes are exact.
const MAX_COORDINATE: f32 = 127.0;

/// Encodes a unit vector as the nearest one of the four codes around its position on the square. The error is below
/// [`MAX_ERROR`].
pub fn encode_octahedral(v: Vec3) -> u16 {
    let v = v / (v.x.abs() + v.y.abs() + v.z.abs());
    let fold = |a: f32, b: f32| (1.0 - b.abs()) * if a < 0.0 { -1.0 } else { 1.0 };
    let (x, y) = if v.z < 0.0 { (fold(v.x, v.y), fold(v.y, v.x)) } else { (v.x, v.y) };
    let (x, y) = ((x * MAX_COORDINATE).floor(), (y * MAX_COORDINATE).floor());
    let code = |x: f32, y: f32| {
        ((x.min(MAX_COORDINATE) + MAX_COORDINATE) as u16) << 8
            | (y.min(MAX_COORDINATE) + MAX_COORDINATE) as u16
    };
    let (mut best, mut nearest) = (code(x, y), f32::NEG_INFINITY);
    for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let candidate = code(x + dx, y + dy);
        let cos = decode_octahedral(candidate).dot(v);
        if cos > nearest {
            (best, nearest) = (candidate, cos);
        }
    }
    best
}

/// Decodes a unit vector.
#[inline]
pub fn decode_octahedral(code: u16) -> Vec3 {
    point(code).normalize()
}

/// Returns the squared cosine between a decoded vector and the unit vector `v`, with the sign of the cosine. It
/// exceeds c² if and only if the cosine exceeds c > 0, and needs no square root.
#[inline]
pub fn signed_squared_cosine(code: u16, v: Vec3) -> f32 {
    let p = point(code);
    let dot = p.dot(v);
    dot * dot.abs() / p.length_squared()
}

/// Computes [`signed_squared_cosine`] for sixteen codes.
#[inline(always)]
pub fn signed_squared_cosines(codes: &[u16; LANES], v: Vec3) -> f32x16 {
    let mut coordinates = [[0.0; LANES]; 2];
    for (i, &code) in codes.iter().enumerate() {
        coordinates[0][i] = f32::from(code >> 8);
        coordinates[1][i] = f32::from(code & 255);
    }
    let [x, y] = coordinates
        .map(|c| (f32x16::new(c) - f32x16::splat(MAX_COORDINATE)) * f32x16::splat(1.0 / MAX_COORDINATE));
    let z = f32x16::ONE - x.abs() - y.abs();
    let fold = (-z).fast_max(f32x16::ZERO);
    let toward_zero = |a: f32x16| a.simd_lt(f32x16::ZERO).select(a + fold, a - fold);
    let p = Vec3x16::new(toward_zero(x), toward_zero(y), z);
    let dot = p.dot(Vec3x16::splat(v));
    dot * dot.abs() / p.length_squared()
}

/// Returns the point of the octahedron for a code.
#[inline]
fn point(code: u16) -> Vec3 {
    let coordinate = |bits: u16| (f32::from(bits & 255) - MAX_COORDINATE) * (1.0 / MAX_COORDINATE);
    let (x, y) = (coordinate(code >> 8), coordinate(code));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    let toward_zero = |a: f32| if a < 0.0 { a + fold } else { a - fold };
    Vec3::new(toward_zero(x), toward_zero(y), z)
}

/// The greatest angle, in radians, between a unit vector and its decoded code.
pub const MAX_ERROR: f32 = 0.0115;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec2;

    #[test]
    fn axes_are_exact_and_code_words_are_their_own() {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for v in [axis, -axis] {
                assert_eq!(decode_octahedral(encode_octahedral(v)), v);
            }
        }
        for (a, b) in (0..255u16).flat_map(|a| (0..255u16).map(move |b| (a, b))) {
            let v = decode_octahedral(a << 8 | b);
            assert!((decode_octahedral(encode_octahedral(v)) - v).length() < 1e-6, "{v}");
            let cosine = v.dot(Vec3::new(2.0, -1.0, 2.0) / 3.0);
            let squared = signed_squared_cosine(a << 8 | b, Vec3::new(2.0, -1.0, 2.0) / 3.0);
            assert!((squared - cosine * cosine.abs()).abs() < 1e-6, "{v}");
            let mut codes = [0; LANES];
            codes[usize::from(b) % LANES] = a << 8 | b;
            let all = signed_squared_cosines(&codes, Vec3::new(2.0, -1.0, 2.0) / 3.0);
            assert!((all.as_array()[usize::from(b) % LANES] - squared).abs() < 1e-6, "{v}");
        }
    }

    #[test]
    fn the_error_is_bounded_and_points_nowhere() {
        let n = 500;
        let (mut sum, mut largest) = (Vec3::ZERO, 0.0f32);
        for i in 0..n * n {
            let u = Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32;
            let z = 1.0 - 2.0 * u.x;
            let (sin, cos) = (std::f32::consts::TAU * u.y).sin_cos();
            let v = Vec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + Vec3::Z * z;
            let decoded = decode_octahedral(encode_octahedral(v));
            assert!((decoded.length() - 1.0).abs() < 1e-6);
            largest = largest.max(decoded.cross(v).length());
            sum += decoded - v;
        }
        assert!(largest < MAX_ERROR && largest > 0.9 * MAX_ERROR, "{largest}");
        assert!(sum.length() / (n * n) as f32 <= 2e-5, "{sum}");
    }
}
