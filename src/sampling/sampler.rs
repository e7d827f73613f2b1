//! Samplers: point sets keyed by (seed, pixel, sample, dimension) and by nothing else.
//!
//! Every number is computed from a [`SampleKey`] and a [`Dimension`]; there is no state. Dimensions are drawn
//! for a whole wave at a time, in loops over plain integers that the compiler turns into SIMD.
//!
//! The samples of a pixel form two halves: sample `i` is point `i div 2` of half `i mod 2`, and the halves are
//! scrambled independently, so that their difference estimates the error of any sampler.

use super::Dimension;
use super::hash::{combine, pcg3d, to_unit};
use std::fmt;
use std::str::FromStr;

/// A sampler by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum SamplerKind {
    /// Independent uniform numbers.
    Independent,
    /// Jittered strata in each dimension.
    Stratified,
    /// Padded Owen-scrambled Sobol pairs.
    #[default]
    Sobol,
}

impl SamplerKind {
    /// All samplers.
    pub const ALL: [SamplerKind; 3] = [SamplerKind::Independent, SamplerKind::Stratified, SamplerKind::Sobol];

    /// The name in scene files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            SamplerKind::Independent => "independent",
            SamplerKind::Stratified => "stratified",
            SamplerKind::Sobol => "sobol",
        }
    }
}

impl fmt::Display for SamplerKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for SamplerKind {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        SamplerKind::ALL
            .into_iter()
            .find(|k| k.name() == s)
            .ok_or_else(|| format!("unknown sampler \"{s}\"; there are independent, stratified and sobol"))
    }
}

/// One sample of one pixel: the hash of (seed, pixel, half) and the index within the half.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleKey {
    /// Hash of seed, pixel and half.
    pub scramble: u32,
    /// Index of the point within its half.
    pub index: u32,
}

impl SampleKey {
    /// The key of sample `sample` of pixel (x, y), counted over the full image.
    #[inline]
    pub fn new(seed: u64, x: u32, y: u32, sample: u64) -> Self {
        let half = (sample & 1) as u32;
        let index = sample >> 1;
        let h = combine(combine(seed as u32, (seed >> 32) as u32), x);
        // Indices past 2^32 begin a new, independently scrambled sequence.
        let h = combine(combine(h, y), half.wrapping_add(((index >> 32) as u32) << 1));
        SampleKey { scramble: h, index: index as u32 }
    }
}

/// A sampler with its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampler {
    /// Independent uniform numbers by hashing. [Jarzynski and Olano 2020]
    Independent,
    /// Blocks of `side`² points, one jittered point in each cell of a `side` × `side` grid (pairs) or each of
    /// `side`² intervals (single numbers), in random order.
    Stratified {
        /// Cells per axis.
        side: u32,
    },
    /// The first two dimensions of the Sobol sequence, shuffled and Owen-scrambled independently for every
    /// dimension and pixel; re-seeded every 2^32 points. [Burley 2020]
    Sobol,
}

impl Sampler {
    /// The sampler of a kind for about `samples_per_pixel` samples (only strata depend on that number;
    /// `None` takes 8 × 8).
    pub fn new(kind: SamplerKind, samples_per_pixel: Option<u64>) -> Self {
        match kind {
            SamplerKind::Independent => Sampler::Independent,
            SamplerKind::Sobol => Sampler::Sobol,
            SamplerKind::Stratified => {
                let per_half = samples_per_pixel.map_or(64, |n| n.div_ceil(2)).min(1 << 20);
                Sampler::Stratified { side: (per_half as f64).sqrt().floor().max(1.0) as u32 }
            }
        }
    }

    /// Its kind.
    pub fn kind(self) -> SamplerKind {
        match self {
            Sampler::Independent => SamplerKind::Independent,
            Sampler::Stratified { .. } => SamplerKind::Stratified,
            Sampler::Sobol => SamplerKind::Sobol,
        }
    }

    /// One number in [0, 1) for each key.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn fill_1d(self, dimension: Dimension, keys: &[SampleKey], out: &mut [f32]) {
        assert_eq!(keys.len(), out.len());
        let d = combine(0x1d, dimension.0);
        match self {
            Sampler::Independent => {
                for (key, u) in keys.iter().zip(out) {
                    *u = to_unit(pcg3d(key.scramble, key.index, d)[0]);
                }
            }
            Sampler::Sobol => {
                for (key, u) in keys.iter().zip(out) {
                    *u = to_unit(sobol_1d(key.index, key.scramble ^ d));
                }
            }
            Sampler::Stratified { side } => {
                for (key, u) in keys.iter().zip(out) {
                    *u = stratified_1d(*key, d, side);
                }
            }
        }
    }

    /// A pair of numbers in [0, 1) for each key.
    ///
    /// # Panics
    /// If the slices differ in length.
    pub fn fill_2d(self, dimension: Dimension, keys: &[SampleKey], x: &mut [f32], y: &mut [f32]) {
        assert!(keys.len() == x.len() && keys.len() == y.len());
        let d = combine(0x2d, dimension.0);
        match self {
            Sampler::Independent => {
                for ((key, x), y) in keys.iter().zip(x).zip(y) {
                    let h = pcg3d(key.scramble, key.index, d);
                    (*x, *y) = (to_unit(h[0]), to_unit(h[1]));
                }
            }
            Sampler::Sobol => {
                for ((key, x), y) in keys.iter().zip(x).zip(y) {
                    let h = sobol_2d(key.index, key.scramble ^ d);
                    (*x, *y) = (to_unit(h[0]), to_unit(h[1]));
                }
            }
            Sampler::Stratified { side } => {
                for ((key, x), y) in keys.iter().zip(x).zip(y) {
                    [*x, *y] = stratified_2d(*key, d, side);
                }
            }
        }
    }
}

/// Owen scrambling of `x` with its bits reversed: bit i of the result depends on bits 0..=i of `x` only.
/// [Laine and Karras 2011; constants of Vegdahl 2021]
#[inline(always)]
fn owen_reversed(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^ x.wrapping_mul(0x53a2_2864)
}

/// The second Sobol dimension of `index` with its bits reversed: the Pascal matrix modulo 2, applied in
/// five steps of the fast zeta transform.
#[inline(always)]
fn pascal_reversed(mut index: u32) -> u32 {
    index ^= (index & 0xaaaa_aaaa) >> 1;
    index ^= (index & 0xcccc_cccc) >> 2;
    index ^= (index & 0xf0f0_f0f0) >> 4;
    index ^= (index & 0xff00_ff00) >> 8;
    index ^ (index >> 16)
}

/// A random order of the points: nested uniform shuffling of the index. [Burley 2020, section 3.2]
#[inline(always)]
fn shuffle(index: u32, seed: u32) -> u32 {
    owen_reversed(index.reverse_bits(), seed).reverse_bits()
}

#[inline(always)]
fn sobol_1d(index: u32, seed: u32) -> u32 {
    let seeds = pcg3d(seed, 0x68bc_21eb, 0x02e5_be93);
    owen_reversed(shuffle(index, seeds[0]), seeds[1]).reverse_bits()
}

#[inline(always)]
fn sobol_2d(index: u32, seed: u32) -> [u32; 2] {
    let seeds = pcg3d(seed, 0x967a_889b, 0x368c_c8b7);
    let i = shuffle(index, seeds[0]);
    [owen_reversed(i, seeds[1]).reverse_bits(), owen_reversed(pascal_reversed(i), seeds[2]).reverse_bits()]
}

/// The image of `i` under a pseudo-random permutation of `0..n`. [Kensler 2013, listing 2]
fn permute(i: u32, n: u32, seed: u32) -> u32 {
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
fn in_cell(cell: u32, jitter: u32, cells: u32) -> f32 {
    ((cell as f32 + to_unit(jitter)) / cells as f32).min(1.0f32.next_down())
}

fn stratified_1d(key: SampleKey, d: u32, side: u32) -> f32 {
    let n = side * side;
    let block = combine(key.scramble ^ d, key.index / n);
    in_cell(permute(key.index % n, n, block), pcg3d(key.scramble, key.index, d)[0], n)
}

fn stratified_2d(key: SampleKey, d: u32, side: u32) -> [f32; 2] {
    let n = side * side;
    let block = combine(key.scramble ^ d, key.index / n);
    let cell = permute(key.index % n, n, block);
    let jitter = pcg3d(key.scramble, key.index, d);
    [in_cell(cell % side, jitter[0], side), in_cell(cell / side, jitter[1], side)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(seed: u64, n: u64) -> Vec<SampleKey> {
        (0..n).map(|i| SampleKey::new(seed, 3, 5, 2 * i)).collect()
    }

    fn pairs(sampler: Sampler, keys: &[SampleKey], d: Dimension) -> Vec<[f32; 2]> {
        let (mut x, mut y) = (vec![0.0; keys.len()], vec![0.0; keys.len()]);
        sampler.fill_2d(d, keys, &mut x, &mut y);
        x.into_iter().zip(y).map(|(x, y)| [x, y]).collect()
    }

    /// Every elementary interval of area 1/n holds exactly one of the first n points: a (0, m, 2)-net.
    #[test]
    fn sobol_pairs_are_nets_for_every_power_of_two_and_every_block() {
        for dimension in [0, 17, 8 * 999] {
            let points = pairs(Sampler::Sobol, &keys(1, 4096), Dimension(dimension));
            for m in 0..=8u32 {
                let n = 1usize << m;
                for block in points.chunks(n).take(8) {
                    for k in 0..=m {
                        let (nx, ny) = (1u32 << k, 1u32 << (m - k));
                        let mut seen = vec![false; n];
                        for p in block {
                            let cell = (p[0] * nx as f32) as u32 * ny + (p[1] * ny as f32) as u32;
                            assert!(!std::mem::replace(&mut seen[cell as usize], true), "m {m} k {k}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn sobol_numbers_are_stratified_and_past_65536_nothing_repeats() {
        let keys: Vec<_> = (0..1u64 << 18).map(|i| SampleKey::new(9, 0, 0, 2 * i)).collect();
        let mut u = vec![0.0; keys.len()];
        Sampler::Sobol.fill_1d(Dimension::roulette(3), &keys, &mut u);
        let mut cells = vec![0u8; keys.len()];
        u.iter().for_each(|u| cells[(u * keys.len() as f32) as usize] += 1);
        assert!(cells.iter().all(|&c| c == 1));
    }

    #[test]
    fn stratified_pairs_fill_every_cell_of_every_block() {
        for side in [1u32, 3, 8] {
            let sampler = Sampler::Stratified { side };
            let n = (side * side) as usize;
            let points = pairs(sampler, &keys(4, 3 * n as u64), Dimension::emitter_point(1));
            for block in points.chunks(n) {
                let mut seen = vec![false; n];
                for p in block {
                    let cell = (p[1] * side as f32) as usize * side as usize + (p[0] * side as f32) as usize;
                    assert!(!std::mem::replace(&mut seen[cell], true));
                }
            }
            let mut u = vec![0.0; 3 * n];
            sampler.fill_1d(Dimension::roulette(0), &keys(4, 3 * n as u64), &mut u);
            for block in u.chunks(n) {
                let mut cells: Vec<_> = block.iter().map(|u| (u * n as f32) as usize).collect();
                cells.sort_unstable();
                assert!(cells.into_iter().eq(0..n));
            }
        }
    }

    /// Means over many independently scrambled short sequences lie within five standard errors of 1/2, and
    /// different dimensions, pixels and halves are uncorrelated.
    #[test]
    fn samplers_are_unbiased_and_their_dimensions_uncorrelated() {
        for sampler in [Sampler::Independent, Sampler::Stratified { side: 2 }, Sampler::Sobol] {
            let n = 40_000u32;
            let keys: Vec<_> =
                (0..n).map(|i| SampleKey::new(2, i % 200, i / 200, u64::from(i % 8))).collect();
            let a = pairs(sampler, &keys, Dimension::emitter_point(0));
            let b = pairs(sampler, &keys, Dimension::bsdf_direction(0));
            let centred = |v: f32| f64::from(v) - 0.5;
            let bound = 5.0 / f64::from(n).sqrt();
            let mean = a.iter().map(|p| centred(p[0])).sum::<f64>() / f64::from(n);
            assert!(mean.abs() < bound * 0.289, "{sampler:?} mean {mean}");
            for (what, c) in [
                ("x y", a.iter().map(|p| centred(p[0]) * centred(p[1])).sum::<f64>()),
                ("dimensions", a.iter().zip(&b).map(|(p, q)| centred(p[0]) * centred(q[0])).sum()),
                ("neighbours", a.windows(2).map(|w| centred(w[0][1]) * centred(w[1][1])).sum()),
            ] {
                let correlation = c / f64::from(n) * 12.0;
                assert!(correlation.abs() < bound, "{sampler:?} {what}: {correlation}");
            }
        }
    }

    #[test]
    fn sample_indices_past_two_to_the_33_start_new_sequences() {
        let near = SampleKey::new(1, 2, 3, 0);
        let far = SampleKey::new(1, 2, 3, 1 << 33);
        assert_eq!(near.index, far.index);
        assert_ne!(near.scramble, far.scramble);
    }

    #[test]
    fn names_round_trip_and_unknown_ones_are_refused() {
        for kind in SamplerKind::ALL {
            assert_eq!(kind.name().parse(), Ok(kind));
        }
        assert_eq!(
            "halten".parse::<SamplerKind>(),
            Err("unknown sampler \"halten\"; there are independent, stratified and sobol".into())
        );
    }
}
