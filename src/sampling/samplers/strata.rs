//! Strata: random orders of cells, and points in them.

use crate::sampling::hash::to_unit;

/// The image of `i` under a pseudo-random permutation of `0..n`. [Kensler 2013, listing 2]
pub fn permute(i: u32, n: u32, seed: u32) -> u32 {
    let w = n.next_power_of_two() - 1;
    let mut i = i;
    loop {
        i ^= seed;
        i = i.wrapping_mul(0xe170_893d);
        i ^= seed >> 16;
        i ^= (i & w) >> 4;
        i ^= seed >> 8;
        i = i.wrapping_mul(0x0929_eb3f);
        i ^= seed >> 23;
        i ^= (i & w) >> 1;
        i = i.wrapping_mul(1 | (seed >> 27));
        i = i.wrapping_mul(0x6935_fa69);
        i ^= (i & w) >> 11;
        i = i.wrapping_mul(0x74dc_b303);
        i ^= (i & w) >> 2;
        i = i.wrapping_mul(0x9e50_1cc3);
        i ^= (i & w) >> 2;
        i = i.wrapping_mul(0xc860_a3df);
        i &= w;
        i ^= i >> 5;
        if i < n {
            break;
        }
    }
    ((u64::from(i) + u64::from(seed)) % u64::from(n)) as u32
}

/// `(cell + jitter) / cells`, kept below 1 where the division rounds up.
#[inline(always)]
pub fn in_cell(cell: u32, jitter: u32, cells: u32) -> f32 {
    ((cell as f32 + to_unit(jitter)) / cells as f32).min(1.0f32.next_down())
}
