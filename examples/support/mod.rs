//! Noise for generated scenes.

use buffon::sampling::hash::{combine, to_unit};

/// Returns smooth noise in [0, 1): random values of the integer points, interpolated with a quintic.
pub fn noise(x: f32, y: f32, seed: u32) -> f32 {
    let (i, j) = (x.floor(), y.floor());
    let fade = |t: f32| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(x - i), fade(y - j));
    let at = |di: i32, dj: i32| random((i as i32 + di) as u32, (j as i32 + dj) as u32, seed);
    let (a, b) = (at(0, 0) + u * (at(1, 0) - at(0, 0)), at(0, 1) + u * (at(1, 1) - at(0, 1)));
    a + v * (b - a)
}

/// Returns a random number in [0, 1) for a pair of integers.
pub fn random(x: u32, y: u32, seed: u32) -> f32 {
    to_unit(combine(combine(seed, x), y))
}
