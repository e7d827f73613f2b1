//! Multiple importance sampling.

use crate::math::f32x16;

/// Returns the power heuristic with exponent 2 for one sample of each technique. [Veach 1997, Eq. 9.13]
///
/// It is the weight of the sample drawn with the density `pdf`; both densities have the same measure. For a sample
/// with infinite density (a delta distribution) it is 1.
#[inline]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    weighted_power_heuristic(1.0, pdf, 1.0, other)
}

/// Returns the power heuristic with exponent 2 for one sample of each of three techniques: the weight of the one with
/// the density `pdf`.
#[inline]
pub fn power_heuristic_of_three(pdf: f32, others: [f32; 2]) -> f32 {
    let [a, b] = others.map(|other| other / pdf);
    match pdf {
        f32::INFINITY => 1.0,
        _ if pdf > 0.0 => 1.0 / (1.0 + a * a + b * b),
        _ => 0.0,
    }
}

/// Computes [`power_heuristic_of_three`] for sixteen samples.
#[inline(always)]
pub fn power_heuristic_of_three_x16(pdf: f32x16, others: [f32x16; 2]) -> f32x16 {
    let [a, b] = others.map(|other| other / pdf);
    let weight = f32x16::ONE / (f32x16::ONE + a * a + b * b);
    let infinite = pdf.simd_eq(f32x16::splat(f32::INFINITY));
    infinite.select(f32x16::ONE, pdf.simd_gt(f32x16::ZERO).select(weight, f32x16::ZERO))
}

/// Returns the power heuristic for `n` samples drawn with `pdf` and `other_n` with `other`. [Veach 1997, Eq. 9.13]
#[inline]
pub fn weighted_power_heuristic(n: f32, pdf: f32, other_n: f32, other: f32) -> f32 {
    let (a, b) = (n * pdf, other_n * other);
    if a.is_infinite() {
        return 1.0;
    }
    // The ratio avoids overflow of squared densities for emitters with a tiny solid angle.
    let r = b / a;
    if a > 0.0 { 1.0 / (1.0 + r * r) } else { 0.0 }
}

/// Computes [`weighted_power_heuristic`] for sixteen samples.
#[inline(always)]
pub fn weighted_power_heuristic_x16(n: f32, pdf: f32x16, other_n: f32, other: f32x16) -> f32x16 {
    let (a, b) = (f32x16::splat(n) * pdf, f32x16::splat(other_n) * other);
    let r = b / a;
    let weight = a.simd_gt(f32x16::ZERO) & (f32x16::ONE / (f32x16::ONE + r * r));
    a.simd_eq(f32x16::splat(f32::INFINITY)).select(f32x16::ONE, weight)
}

/// Converts a density per unit area at a point to a density per unit solid angle. The point is at the squared
/// distance `distance_squared`; `cos` is the cosine between its surface normal and the direction (either sign).
#[inline]
pub fn area_to_solid_angle(pdf_area: f32, distance_squared: f32, cos: f32) -> f32 {
    pdf_area * distance_squared / cos.abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_of_the_two_techniques_sum_to_one() {
        for (a, b) in [(1.0, 2.0), (1e-20, 1e20), (3e37, 1e38), (1.0, 0.0)] {
            assert!((power_heuristic(a, b) + power_heuristic(b, a) - 1.0).abs() < 1e-6, "{a} {b}");
        }
        for (a, b) in [(1.0, 2.0), (1e-20, 1e20), (f32::INFINITY, 1.0), (0.0, 1.0), (0.0, 0.0)] {
            let sixteen = weighted_power_heuristic_x16(2.0, f32x16::splat(a), 3.0, f32x16::splat(b));
            assert_eq!(sixteen.to_array()[1], weighted_power_heuristic(2.0, a, 3.0, b), "{a} {b}");
        }
        assert_eq!(power_heuristic(f32::INFINITY, 1.0), 1.0);
        assert_eq!(power_heuristic(0.0, 1.0), 0.0);
        assert!((weighted_power_heuristic(2.0, 1.0, 1.0, 2.0) - 0.5).abs() < 1e-6);
    }
}
