//! Independent uniform numbers from a hash, the baseline for all other samplers. [Jarzynski and Olano 2020]

use super::SampleKey;
use crate::sampling::hash::{pcg3d, to_unit};

pub fn fill_1d(d: u32, keys: &[SampleKey], out: &mut [f32]) {
    for (key, u) in keys.iter().zip(out) {
        *u = to_unit(pcg3d(key.scramble, key.index, d)[0]);
    }
}

pub fn fill_2d(d: u32, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
    for ((key, x), y) in keys.iter().zip(x).zip(y) {
        let h = pcg3d(key.scramble, key.index, d);
        (*x, *y) = (to_unit(h[0]), to_unit(h[1]));
    }
}
