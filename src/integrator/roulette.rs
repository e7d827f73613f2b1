//! Russian roulette: which paths go on, and with what.

use crate::color::Rgb;
use crate::math::f32x16;
use crate::sampling::hash::{probability_below, probability_below_x16};

/// The most likely survival of a path that may end at an edge, the number of its edges being `edges`.
///
/// A constant limit c < 1 makes light without end die also where nothing is absorbed, but the weights of long paths
/// grow as (ρ/c)^k in a closed room of reflectance ρ, and their variance is infinite where ρ² > c. This limit tends to 1:
/// 1 − 2/(k + 35), 0.95 at the fifth edge. Of paths that lose nothing a share of (38/k)·(39/k) is left after k ≫ 1 edges, so their
/// mean length is finite, and weights grow as k², so that the variance is finite for every ρ < 1.
#[inline]
fn most_survival(edges: u32) -> f32 {
    1.0 - 2.0 / (edges as f32 + 35.0)
}

/// Russian roulette at an edge of a path.
#[derive(Clone, Copy, Debug)]
pub struct Roulette {
    /// The most likely survival.
    most: f32,
}

impl Roulette {
    /// The roulette of paths with so many edges; `None` before `rr_depth`.
    pub fn at(edges: u32, rr_depth: u32) -> Option<Self> {
        (edges >= rr_depth).then(|| Roulette { most: most_survival(edges) })
    }

    /// The throughput of a path that goes on; `None` where the random number `u` ends it. It survives with the
    /// probability of its strongest channel times `importance`, up to a limit.
    #[inline]
    pub fn play(self, beta: Rgb, importance: f32, u: f32) -> Option<Rgb> {
        let survival = probability_below((beta.max_component() * importance).min(self.most));
        // A throughput that is no number lives: the sample is to be counted as invalid.
        if u >= survival { None } else { Some(beta * (1.0 / survival)) }
    }

    /// As [`play`](Self::play), for sixteen paths: their throughputs by channel, and a mask of those that go on.
    #[inline(always)]
    pub fn play_x16(self, beta: [f32x16; 3], importance: f32x16, u: f32x16) -> ([f32x16; 3], f32x16) {
        let strongest = beta[0].fast_max(beta[1]).fast_max(beta[2]);
        let survival = probability_below_x16((strongest * importance).fast_min(f32x16::splat(self.most)));
        let per_survival = f32x16::ONE / survival;
        (beta.map(|channel| channel * per_survival), !u.simd_ge(survival))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::to_unit;

    /// Mean length of lossless paths, and the second moment of the weights in a room of reflectance 0.999.
    #[test]
    fn lossless_paths_end_and_weights_have_a_variance() {
        assert_eq!(most_survival(5), 0.95);
        let (mut left, mut length, mut moment) = (1.0f64, 0.0, 0.0);
        for edges in 5..40_000 {
            left *= f64::from(most_survival(edges));
            length += left;
            moment += 0.999f64.powi(2 * edges as i32) / left;
        }
        assert!((37.9..38.0).contains(&length), "{length}");
        assert!((1e5..1e6).contains(&moment), "{moment}");
    }

    /// However small the throughput is, survivors times their throughputs are what went in.
    #[test]
    fn nothing_is_gained_or_lost() {
        for strongest in [1e-12f32, 1e-10, 1e-7, 1e-6, 1e-3, 0.3, 0.9, 1.0, 7.0] {
            let beta = Rgb::new(strongest, 0.5 * strongest, 0.0);
            let roulette = Roulette::at(9, 5).expect("played from the fifth edge on");
            let on = roulette.play(beta, 1.0, 0.0).expect("the least number lets every path live");
            // The share of the hashes whose number lets the path live.
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
        assert!(Roulette::at(4, 5).is_none());
    }
}
