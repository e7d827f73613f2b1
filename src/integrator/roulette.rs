//! Russian roulette.

use crate::color::Rgb;
use crate::math::f32x16;
use crate::sampling::hash::{probability_below, probability_below_x16};

/// Returns the upper limit of the survival probability at an edge, where `edges` is the number of edges of the path.
///
/// A constant limit c < 1 terminates paths even if nothing is absorbed. In a closed room of reflectance ρ, however,
/// the weights of long paths grow as (ρ/c)^k, and their variance is infinite for ρ² > c. This limit tends to 1: it is
/// 1 − 2/(k + 35), which is 0.95 at the fifth edge. Of paths without absorption, a fraction of (38/k)·(39/k) remains
/// after k ≫ 1 edges. Their mean length is therefore finite; weights grow as k², so the variance is finite for every
/// ρ < 1.
#[inline]
fn survival_limit(edges: u32) -> f32 {
    1.0 - 2.0 / (edges as f32 + 35.0)
}

/// Russian roulette at one edge of a path.
#[derive(Clone, Copy, Debug)]
pub struct Roulette {
    /// The upper limit of the survival probability.
    limit: f32,
    /// Whether the survivors get equal throughputs.
    equalizes: bool,
}

impl Roulette {
    /// Returns the roulette for paths with the given number of edges; `None` before `rr_depth`.
    pub fn at(edges: u32, rr_depth: u32) -> Option<Self> {
        (edges >= rr_depth).then(|| Roulette { limit: survival_limit(edges), equalizes: false })
    }

    /// Returns the roulette for photons, as [`at`](Self::at). All survivors get the same power, because the variance
    /// of a density estimate is least for photons of equal power.
    pub fn for_photons(edges: u32, rr_depth: u32) -> Option<Self> {
        Roulette::at(edges, rr_depth).map(|roulette| Roulette { equalizes: true, ..roulette })
    }

    /// Returns the throughput of a surviving path, or `None` if the random number `u` terminates it. The survival
    /// probability is the fourth root of `s`, the largest channel of `beta` times `importance`, up to the limit.
    ///
    /// In a room of reflectance ρ, the throughput then tends to ρ⁴ and the survival probability to ρ. With the
    /// probability `s` itself, which photons have, the first roulette ends most paths, and the few survivors bear all
    /// the variance of the light that comes after it.
    #[inline]
    pub fn play(self, beta: Rgb, importance: f32, u: f32) -> Option<Rgb> {
        let strongest = beta.max_component() * importance;
        let survival = if self.equalizes { strongest } else { strongest.sqrt().sqrt() };
        let survival = probability_below(survival.min(self.limit));
        // A path with NaN throughput survives, so that the sample is counted as invalid.
        if u >= survival { None } else { Some(beta * (1.0 / survival)) }
    }

    /// Computes [`play`](Self::play) for sixteen paths. Returns their throughputs by channel and a mask of the
    /// surviving paths.
    #[inline(always)]
    pub fn play_x16(self, beta: [f32x16; 3], importance: f32x16, u: f32x16) -> ([f32x16; 3], f32x16) {
        let strongest = beta[0].fast_max(beta[1]).fast_max(beta[2]);
        let strongest = strongest * importance;
        let survival = if self.equalizes { strongest } else { strongest.sqrt().sqrt() };
        survivors(beta, survival.fast_min(f32x16::splat(self.limit)), u)
    }
}

/// Returns the throughputs by channel of sixteen paths with the given survival probabilities, and a mask of the
/// survivors.
#[inline(always)]
fn survivors(beta: [f32x16; 3], survival: f32x16, u: f32x16) -> ([f32x16; 3], f32x16) {
    let survival = probability_below_x16(survival);
    let per_survival = f32x16::ONE / survival;
    (beta.map(|channel| channel * per_survival), !u.simd_ge(survival))
}

/// Plays the roulette of [`Roulette::at`] for sixteen paths with the given numbers of edges. Returns their throughputs
/// by channel and a mask of the surviving paths.
#[inline(always)]
pub fn play_each_x16(
    edges: f32x16,
    rr_depth: u32,
    beta: [f32x16; 3],
    importance: f32x16,
    u: f32x16,
) -> ([f32x16; 3], f32x16) {
    let limit = f32x16::ONE - f32x16::splat(2.0) / (edges + f32x16::splat(35.0));
    let strongest = beta[0].fast_max(beta[1]).fast_max(beta[2]) * importance;
    let (played, on) = survivors(beta, strongest.sqrt().sqrt().fast_min(limit), u);
    let before = edges.simd_lt(f32x16::splat(rr_depth as f32));
    (std::array::from_fn(|c| before.select(beta[c], played[c])), on | before)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::to_unit;

    /// Tests the mean length of lossless paths, and the second moment of the weights in a room of reflectance 0.999.
    #[test]
    fn lossless_paths_end_and_weights_have_a_variance() {
        assert_eq!(survival_limit(5), 0.95);
        let (mut left, mut length, mut moment) = (1.0f64, 0.0, 0.0);
        for edges in 5..40_000 {
            left *= f64::from(survival_limit(edges));
            length += left;
            moment += 0.999f64.powi(2 * edges as i32) / left;
        }
        assert!((37.9..38.0).contains(&length), "{length}");
        assert!((1e5..1e6).contains(&moment), "{moment}");
    }

    /// The expected throughput is conserved for throughputs of any size.
    #[test]
    fn nothing_is_gained_or_lost() {
        for strongest in [1e-12f32, 1e-10, 1e-7, 1e-6, 1e-3, 0.3, 0.9, 1.0, 7.0] {
            let beta = Rgb::new(strongest, 0.5 * strongest, 0.0);
            for roulette in [Roulette::at(9, 5), Roulette::for_photons(9, 5)] {
                let roulette = roulette.expect("played from the fifth edge on");
                let on = roulette.play(beta, 1.0, 0.0).expect("the least number lets every path live");
                // The fraction of hashes whose number lets the path survive.
                let (mut low, mut high) = (0u64, 1u64 << 32);
                while low < high {
                    let middle = (low + high) / 2;
                    let lives = roulette.play(beta, 1.0, to_unit(middle as u32)).is_some();
                    if lives { low = middle + 1 } else { high = middle }
                }
                let mean = low as f64 / 2f64.powi(32) * f64::from(on.r);
                assert!((mean / f64::from(strongest) - 1.0).abs() < 3e-7, "{strongest}: {mean}");
                let (sixteen, alive) =
                    roulette.play_x16(beta.to_array().map(f32x16::splat), f32x16::ONE, f32x16::ZERO);
                assert_eq!((sixteen[0].as_array()[2], alive.to_bitmask()), (on.r, 0xffff));
            }
        }
        assert!(Roulette::at(4, 5).is_none());
    }
}
