//! The choice among a few emitters: each has an interval of random numbers whose ends are multiples of 1/steps.
//!
//! The number of steps is a power of two. A Sobol sequence has equally many numbers in all intervals of such sizes, so
//! no variance comes from the choice once there are as many points as steps. The remaining digits of the random number
//! are a random number for the position on the emitter; a hash adds the digits that they lack.

use super::bounds::LightBoundsX16;
use super::receiver::{Receiver, ReceiverX16};
use super::{ChoiceX16, LEAST_FRACTION};
use crate::math::{LANES, f32x16};
use crate::sampling::hash;

/// Steps per emitter, at least. One step of each emitter is independent of its irradiance.
const STEPS: usize = 8;

/// A few emitters.
pub struct Few {
    /// Indices of the emitters: those with a place, then those at infinity.
    emitters: Vec<u32>,
    /// Bounds of the emitters with a place.
    bounds: LightBoundsX16,
    /// The number of emitters with a place.
    finite: usize,
    /// The irradiance of each emitter at infinity relative to their sum.
    infinite: Vec<f32>,
    /// The sum of the irradiance of the emitters at infinity.
    infinite_sum: f32,
    /// The number of steps.
    steps: f32,
}

/// The interval of an emitter in each lane, in steps.
#[derive(Clone, Copy, Default)]
struct Interval {
    low: f32x16,
    size: f32x16,
}

impl Few {
    /// Creates the choice among emitters with bounds and emitters at infinity with an irradiance.
    ///
    /// # Panics
    /// If more than sixteen emitters have bounds.
    pub fn new(emitters: Vec<u32>, bounds: LightBoundsX16, infinite: &[f32]) -> Self {
        let finite = emitters.len() - infinite.len();
        assert!(finite <= LANES);
        let infinite_sum: f32 = infinite.iter().sum();
        let part = |irradiance: &f32| match infinite_sum > 0.0 {
            true => irradiance / infinite_sum,
            false => 1.0 / infinite.len() as f32,
        };
        Few {
            steps: (STEPS * emitters.len()).next_power_of_two() as f32,
            emitters,
            bounds,
            finite,
            infinite: infinite.iter().map(part).collect(),
            infinite_sum,
        }
    }

    /// Calls `visit` with the position and the interval of each emitter in order, for sixteen points. `importance`
    /// returns that of an emitter with bounds.
    #[inline(always)]
    fn intervals(&self, importance: impl Fn(usize) -> f32x16, mut visit: impl FnMut(usize, Interval)) {
        let (zero, one) = (f32x16::ZERO, f32x16::ONE);
        let mut weights = [zero; LANES];
        let mut total = zero;
        for (i, weight) in weights[..self.finite].iter_mut().enumerate() {
            *weight = importance(i);
            total += *weight;
        }
        let lit = total.simd_gt(zero);
        let least = f32x16::splat(LEAST_FRACTION as f32);
        let sum = f32x16::splat(self.infinite_sum);
        let share = match (self.infinite.len(), self.finite) {
            (0, _) => zero,
            (_, 0) => one,
            _ => lit.select((sum / (sum + total)).max(least), one).min(one - least),
        };
        // If no emitter with bounds is seen, all of them are equal.
        let equal = one / f32x16::splat(self.finite.max(1) as f32);
        let total = lit.select(total, one);
        let spread = f32x16::splat(self.steps - self.emitters.len() as f32);
        let (mut below, mut low) = (zero, zero);
        let finite = weights[..self.finite].iter().map(|w| (one - share) * lit.select(*w / total, equal));
        let infinite = self.infinite.iter().map(|part| share * f32x16::splat(*part));
        for (i, fraction) in finite.chain(infinite).enumerate() {
            below += fraction;
            let end = f32x16::splat(i as f32 + 1.0) + (below * spread).round();
            let end = if i + 1 == self.emitters.len() { f32x16::splat(self.steps) } else { end };
            visit(i, Interval { low, size: end - low });
            low = end;
        }
    }

    /// Chooses an emitter for each point with a random number in [0, 1).
    #[inline]
    pub fn sample_x16(&self, at: &ReceiverX16, u: f32x16) -> ChoiceX16 {
        let target = u * f32x16::splat(self.steps);
        let mut chosen = f32x16::ZERO;
        let mut interval = Interval::default();
        self.intervals(
            |i| self.bounds.splat_lane(i).importance(at),
            |i, next| {
                let inside = target.simd_ge(next.low);
                chosen = inside.select(f32x16::splat(self.emitters[i] as f32), chosen);
                interval.low = inside.select(next.low, interval.low);
                interval.size = inside.select(next.size, interval.size);
            },
        );
        let digits = hash::lower_digits_x16(u, at.p) * f32x16::splat(self.steps);
        let rest = (target - interval.low + digits) / interval.size;
        let rest = rest.fast_min(f32x16::splat(1f32.next_down()));
        ChoiceX16 {
            emitters: chosen.to_array().map(|i| i as usize),
            pmf: interval.size / f32x16::splat(self.steps),
            u: rest,
        }
    }

    /// Returns the probability with which an emitter is chosen for each point.
    pub fn pmf_x16(&self, emitter: usize, at: &ReceiverX16) -> f32x16 {
        let mut size = f32x16::ZERO;
        self.intervals(
            |i| self.bounds.splat_lane(i).importance(at),
            |i, interval| {
                if self.emitters[i] as usize == emitter {
                    size = interval.size;
                }
            },
        );
        size / f32x16::splat(self.steps)
    }

    /// Returns the probability with which an emitter is chosen for a point.
    pub fn pmf(&self, emitter: usize, at: Receiver) -> f32 {
        let importance = self.bounds.importance(&ReceiverX16::splat(at)).to_array();
        let mut size = 0.0;
        self.intervals(
            |i| f32x16::splat(importance[i]),
            |i, interval| {
                if self.emitters[i] as usize == emitter {
                    size = interval.size.as_array()[0];
                }
            },
        );
        size / self.steps
    }
}
