//! Warps of the unit square and interval, each with its density and inverse.
//!
//! `square_to_x` maps [0, 1)². `square_to_x_pdf` is the density of the result in the measure of the target space
//! (area or solid angle). `x_to_square` is the inverse map.

use crate::math::{Vec2, Vec3, Vec3x16, f32x16};
use std::f32::consts::{FRAC_1_PI, FRAC_2_PI, FRAC_PI_4, PI, TAU};

/// Maps to the unit disk, preserving adjacency and relative area. [Shirley and Chiu 1997]
#[inline]
pub fn square_to_disk(u: Vec2) -> Vec2 {
    let a = 2.0 * u.x - 1.0;
    let b = 2.0 * u.y - 1.0;
    let along_x = a.abs() > b.abs();
    let (r, other) = if along_x { (a, b) } else { (b, a) };
    let ratio = if r == 0.0 { 0.0 } else { other / r };
    let (sin, cos) = sin_cos_quarter(ratio);
    if along_x { Vec2::new(r * cos, r * sin) } else { Vec2::new(r * sin, r * cos) }
}

/// Returns sine and cosine of `x·π/4` for |x| ≤ 1 by Taylor series, accurate to the rounding of `f32`. It needs no
/// range reduction and can stay in registers.
#[inline]
pub fn sin_cos_quarter(x: f32) -> (f32, f32) {
    let t = x * FRAC_PI_4;
    let t2 = t * t;
    let sin =
        t * (1.0 + t2 * (-1.0 / 6.0 + t2 * (1.0 / 120.0 + t2 * (-1.0 / 5040.0 + t2 * (1.0 / 362_880.0)))));
    let cos = 1.0 + t2 * (-0.5 + t2 * (1.0 / 24.0 + t2 * (-1.0 / 720.0 + t2 * (1.0 / 40_320.0))));
    (sin, cos)
}

/// Computes [`sin_cos_quarter`] for `t = x·π/4`.
#[inline(always)]
fn sin_cos_polynomial_x16(t: f32x16) -> (f32x16, f32x16) {
    let c = f32x16::splat;
    let t2 = t * t;
    let sin = t
        * (c(1.0)
            + t2 * (c(-1.0 / 6.0)
                + t2 * (c(1.0 / 120.0) + t2 * (c(-1.0 / 5040.0) + t2 * c(1.0 / 362_880.0)))));
    let cos =
        c(1.0) + t2 * (c(-0.5) + t2 * (c(1.0 / 24.0) + t2 * (c(-1.0 / 720.0) + t2 * c(1.0 / 40_320.0))));
    (sin, cos)
}

/// Returns sines and cosines of sixteen angles in [0, 2π], accurate to the rounding of `f32`.
#[inline(always)]
pub fn sin_cos_turn_x16(angle: f32x16) -> (f32x16, f32x16) {
    let quadrant = (angle * f32x16::splat(FRAC_2_PI)).round_ties_even();
    // π/2 as the sum of a short number, whose multiples are exact, and a remainder. [Cody and Waite 1980]
    const HIGH: f32 = 1.570_312_5;
    const LOW: f32 = (std::f64::consts::FRAC_PI_2 - HIGH as f64) as f32;
    let t = (angle - quadrant * f32x16::splat(HIGH)) - quadrant * f32x16::splat(LOW);
    let (sin, cos) = sin_cos_polynomial_x16(t);
    let is = |q: f32| quadrant.simd_eq(f32x16::splat(q));
    let (one, two, three) = (is(1.0), is(2.0), is(3.0));
    let minus = f32x16::splat(-0.0);
    let swap = one | three;
    (swap.select(cos, sin) ^ ((two | three) & minus), swap.select(sin, cos) ^ ((one | two) & minus))
}

/// Returns the arguments of sixteen complex numbers of length 1, in [0, 2π], accurate to the rounding of `f32`.
#[inline(always)]
pub fn argument_x16(re: f32x16, im: f32x16) -> f32x16 {
    let c = f32x16::splat;
    // tan(φ/2) = sin φ / (1 + cos φ); in the left half plane its reciprocal, to avoid cancellation in the
    // denominator.
    let t = im / (c(1.0) + re.abs());
    let t2 = t * t;
    // atan t for |t| ≤ 1 by [Abramowitz and Stegun 1964, 4.4.49].
    let series = c(0.002_866_225_7);
    let series = c(-0.016_165_737) + t2 * series;
    let series = c(0.042_909_614) + t2 * series;
    let series = c(-0.075_289_64) + t2 * series;
    let series = c(0.106_562_64) + t2 * series;
    let series = c(-0.142_089) + t2 * series;
    let series = c(0.199_935_5) + t2 * series;
    let series = c(-0.333_331_45) + t2 * series;
    let half = t + t * t2 * series;
    let turned = half + half;
    let angle = re.simd_lt(f32x16::ZERO).select(c(PI) - turned, turned);
    angle + (angle.simd_lt(f32x16::ZERO) & c(TAU))
}

/// Returns the density of [`square_to_disk`] per unit area: 1/π inside.
pub fn square_to_disk_pdf(p: Vec2) -> f32 {
    if p.length_squared() <= 1.0 { FRAC_1_PI } else { 0.0 }
}

/// Inverts [`square_to_disk`].
pub fn disk_to_square(p: Vec2) -> Vec2 {
    let r = p.length();
    if r == 0.0 {
        return Vec2::splat(0.5);
    }
    let quarter = p.x.abs() > p.y.abs();
    let (a, b) = if quarter {
        let a = r.copysign(p.x);
        (a, a * (p.y / p.x).atan() / FRAC_PI_4)
    } else {
        let b = r.copysign(p.y);
        (b * (p.x / p.y).atan() / FRAC_PI_4, b)
    };
    Vec2::new(0.5 * (a + 1.0), 0.5 * (b + 1.0))
}

/// Maps to the hemisphere around +z with the density cosθ/π per unit solid angle. [Malley 1988]
#[inline]
pub fn square_to_cosine_hemisphere(u: Vec2) -> Vec3 {
    let p = square_to_disk(u);
    // 1 − r² is usually at least about 2⁻²⁴; the bound keeps the direction above the horizon at r = 1.
    let z = (1.0 - p.length_squared()).max(1e-10).sqrt();
    Vec3::new(p.x, p.y, z)
}

/// Computes [`square_to_disk`] for sixteen pairs.
#[inline(always)]
pub fn square_to_disk_x16([x, y]: [f32x16; 2]) -> [f32x16; 2] {
    let c = f32x16::splat;
    let (a, b) = (c(2.0) * x - c(1.0), c(2.0) * y - c(1.0));
    let along_x = a.abs().simd_gt(b.abs());
    let (r, other) = (along_x.select(a, b), along_x.select(b, a));
    let ratio = r.simd_eq(f32x16::ZERO).select(f32x16::ZERO, other / r);
    let (sin, cos) = sin_cos_polynomial_x16(ratio * c(FRAC_PI_4));
    let (major, minor) = (r * cos, r * sin);
    [along_x.select(major, minor), along_x.select(minor, major)]
}

/// Computes [`square_to_cosine_hemisphere`] for sixteen pairs.
#[inline(always)]
pub fn square_to_cosine_hemisphere_x16(u: [f32x16; 2]) -> Vec3x16 {
    let [x, y] = square_to_disk_x16(u);
    let z = (f32x16::ONE - (x * x + y * y)).fast_max(f32x16::splat(1e-10)).sqrt();
    Vec3x16::new(x, y, z)
}

/// Returns the density of [`square_to_cosine_hemisphere`] per unit solid angle.
#[inline]
pub fn square_to_cosine_hemisphere_pdf(w: Vec3) -> f32 {
    w.z.max(0.0) * FRAC_1_PI
}

/// Inverts [`square_to_cosine_hemisphere`].
pub fn cosine_hemisphere_to_square(w: Vec3) -> Vec2 {
    disk_to_square(Vec2::new(w.x, w.y))
}

/// Maps uniformly to the unit sphere.
#[inline]
pub fn square_to_sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.y;
    // sin²θ = 1 − z², computed without cancellation as 4 y (1 − y).
    let r = (4.0 * u.y * (1.0 - u.y)).max(0.0).sqrt();
    let (sin, cos) = (TAU * u.x).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

/// Computes [`square_to_sphere`] for sixteen pairs.
#[inline(always)]
pub fn square_to_sphere_x16([x, y]: [f32x16; 2]) -> Vec3x16 {
    let c = f32x16::splat;
    let r = (c(4.0) * y * (f32x16::ONE - y)).fast_max(f32x16::ZERO).sqrt();
    let (sin, cos) = sin_cos_turn_x16(c(TAU) * x);
    Vec3x16::new(r * cos, r * sin, f32x16::ONE - c(2.0) * y)
}

/// The density of [`square_to_sphere`] per unit solid angle: 1/4π.
pub const SQUARE_TO_SPHERE_PDF: f32 = 0.25 * FRAC_1_PI;

/// Inverts [`square_to_sphere`].
pub fn sphere_to_square(w: Vec3) -> Vec2 {
    let x = w.y.atan2(w.x) / TAU;
    Vec2::new(if x < 0.0 { x + 1.0 } else { x }, 0.5 * (1.0 - w.z))
}

/// Maps uniformly to the cone of directions around +z whose half angle has `1 − cos` = `one_minus_cos`.
#[inline]
pub fn square_to_cone(u: Vec2, one_minus_cos: f32) -> Vec3 {
    let h = u.y * one_minus_cos;
    // sin²θ = 1 − (1 − h)² = h (2 − h), without cancellation for narrow cones.
    let r = (h * (2.0 - h)).max(0.0).sqrt();
    let (sin, cos) = (TAU * u.x).sin_cos();
    Vec3::new(r * cos, r * sin, 1.0 - h)
}

/// Computes [`square_to_cone`] for sixteen pairs.
#[inline(always)]
pub fn square_to_cone_x16([x, y]: [f32x16; 2], one_minus_cos: f32x16) -> Vec3x16 {
    let h = y * one_minus_cos;
    let r = (h * (f32x16::splat(2.0) - h)).fast_max(f32x16::ZERO).sqrt();
    let (sin, cos) = sin_cos_turn_x16(f32x16::splat(TAU) * x);
    Vec3x16::new(r * cos, r * sin, f32x16::ONE - h)
}

/// Returns the density of [`square_to_cone`] per unit solid angle inside the cone.
#[inline]
pub fn square_to_cone_pdf(one_minus_cos: f32) -> f32 {
    1.0 / (TAU * one_minus_cos)
}

/// Inverts [`square_to_cone`].
pub fn cone_to_square(w: Vec3, one_minus_cos: f32) -> Vec2 {
    let x = w.y.atan2(w.x) / TAU;
    let sin2 = w.x * w.x + w.y * w.y;
    let h = sin2 / (1.0 + w.z);
    Vec2::new(if x < 0.0 { x + 1.0 } else { x }, h / one_minus_cos)
}

/// Maps to the barycentric weights of a triangle's second and third vertex, uniformly in area. [Heitz 2019]
#[inline]
pub fn square_to_triangle(u: Vec2) -> Vec2 {
    if u.y > u.x {
        let x = u.x * 0.5;
        Vec2::new(x, u.y - x)
    } else {
        let y = u.y * 0.5;
        Vec2::new(u.x - y, y)
    }
}

/// Returns the density of [`square_to_triangle`] in barycentric coordinates: 2 inside.
pub fn square_to_triangle_pdf(b: Vec2) -> f32 {
    if b.x >= 0.0 && b.y >= 0.0 && b.x + b.y <= 1.0 { 2.0 } else { 0.0 }
}

/// Inverts [`square_to_triangle`].
pub fn triangle_to_square(b: Vec2) -> Vec2 {
    if b.y > b.x { Vec2::new(2.0 * b.x, b.y + b.x) } else { Vec2::new(b.x + b.y, 2.0 * b.y) }
}

/// Maps to [−1, 1] with the density 1 − |x|.
#[inline]
pub fn interval_to_tent(u: f32) -> f32 {
    if u < 0.5 { (2.0 * u).sqrt() - 1.0 } else { 1.0 - (2.0 * (1.0 - u)).max(0.0).sqrt() }
}

/// Returns the density of [`interval_to_tent`].
pub fn interval_to_tent_pdf(x: f32) -> f32 {
    (1.0 - x.abs()).max(0.0)
}

/// Inverts [`interval_to_tent`].
pub fn tent_to_interval(x: f32) -> f32 {
    if x < 0.0 { 0.5 * (1.0 + x) * (1.0 + x) } else { 1.0 - 0.5 * (1.0 - x) * (1.0 - x) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENDS: [f32; 5] = [0.0, 1e-7, 0.5, 0.75, 1.0 - f32::EPSILON / 2.0];

    fn grid() -> impl Iterator<Item = Vec2> {
        ENDS.into_iter().flat_map(|x| ENDS.into_iter().map(move |y| Vec2::new(x, y)))
    }

    #[test]
    fn directions_are_of_unit_length_at_every_end_of_the_square() {
        for u in grid() {
            for w in [
                square_to_cosine_hemisphere(u),
                square_to_sphere(u),
                square_to_cone(u, 1e-12),
                square_to_cone(u, 0.3),
                square_to_cone(u, 1.0),
            ] {
                assert!((w.length() - 1.0).abs() < 1e-6, "{u} {w}");
            }
            assert!(square_to_cosine_hemisphere(u).z > 0.0);
            assert!(square_to_disk(u).length() <= 1.0 + 1e-6);
            assert!(interval_to_tent(u.x).abs() <= 1.0);
        }
    }

    #[test]
    fn the_quarter_sine_and_cosine_are_those_of_the_library() {
        for i in -1000..=1000 {
            let x = i as f32 / 1000.0;
            let (sin, cos) = sin_cos_quarter(x);
            let exact = (f64::from(x) * std::f64::consts::FRAC_PI_4).sin_cos();
            assert!(
                (f64::from(sin) - exact.0).abs() < 1.2e-7 && (f64::from(cos) - exact.1).abs() < 1.2e-7,
                "{x}"
            );
        }
    }

    #[test]
    fn sixteen_lanes_have_the_library_s_sines_and_arguments() {
        for i in 0..=8000 {
            let exact = f64::from(i) / 8000.0 * std::f64::consts::TAU;
            let (re, im) = (exact.cos() as f32, exact.sin() as f32);
            let argument = argument_x16(f32x16::splat(re), f32x16::splat(im)).as_array()[0];
            // 0 and 2π are the same angle.
            let off = (f64::from(argument) - exact).abs();
            assert!(off.min((off - std::f64::consts::TAU).abs()) < 7e-7, "{exact} {argument}");
            if i < 100 {
                assert!(off <= exact * 4e-7, "{exact} {argument}");
            }
            let angle = exact as f32;
            let (sin, cos) = sin_cos_turn_x16(f32x16::splat(angle));
            let exact = f64::from(angle).sin_cos();
            let off = [sin.as_array()[0], cos.as_array()[0]].map(f64::from);
            assert!((off[0] - exact.0).abs() < 2e-7 && (off[1] - exact.1).abs() < 2e-7, "{angle}");
        }
    }

    #[test]
    fn sixteen_lanes_warp_as_one() {
        for u in grid() {
            let w = square_to_cosine_hemisphere_x16([f32x16::splat(u.x), f32x16::splat(u.y)]);
            assert_eq!(w.lane(7), square_to_cosine_hemisphere(u), "{u}");
        }
    }

    #[test]
    fn inverses_invert() {
        for i in 0..200 {
            let u = Vec2::new((i as f32 * 0.618_034 + 0.013).fract(), (i as f32 * 0.754_878 + 0.17).fract());
            for (what, v, tolerance) in [
                ("disk", disk_to_square(square_to_disk(u)), 1e-5),
                ("cosine", cosine_hemisphere_to_square(square_to_cosine_hemisphere(u)), 1e-5),
                ("sphere", sphere_to_square(square_to_sphere(u)), 1e-5),
                ("cone", cone_to_square(square_to_cone(u, 0.2), 0.2), 1e-4),
                ("triangle", triangle_to_square(square_to_triangle(u)), 1e-5),
            ] {
                assert!((u - v).abs().max_element() < tolerance, "{what}: {u} became {v}");
            }
            assert!((tent_to_interval(interval_to_tent(u.x)) - u.x).abs() < 1e-5);
        }
    }
}
