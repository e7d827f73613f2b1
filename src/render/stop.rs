//! Stop rules: the first that fires ends the render.

use std::fmt;
use std::time::Duration;

/// When to stop. Without any rule a render goes on until it is interrupted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StopRules {
    /// Samples per pixel.
    pub samples: Option<u64>,
    /// Time for sampling.
    pub time: Option<Duration>,
    /// Estimated relMSE of the image.
    pub error: Option<f64>,
}

/// Which rule ended a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// All samples were taken.
    Samples,
    /// The next pass would have passed the time.
    Time,
    /// The estimated error fell below the target.
    Error,
    /// The user or the system asked for it.
    Interrupted,
}

impl fmt::Display for StopReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            StopReason::Samples => "samples",
            StopReason::Time => "time",
            StopReason::Error => "error",
            StopReason::Interrupted => "interrupted",
        })
    }
}

/// Largest pass: estimates and stop rules are looked at once a pass.
const LARGEST_PASS: u64 = 64;
/// An error estimate from fewer samples is not trusted to stop a render.
const FEWEST_FOR_ERROR: u64 = 16;

impl StopRules {
    /// Why to stop after `done` samples per pixel, if any rule says so. `elapsed` is the time so far, `error`
    /// the estimated relMSE.
    pub fn reached(&self, done: u64, elapsed: Duration, error: Option<f64>) -> Option<StopReason> {
        if self.samples.is_some_and(|n| done >= n) {
            return Some(StopReason::Samples);
        }
        if done >= FEWEST_FOR_ERROR
            && let (Some(target), Some(error)) = (self.error, error)
            && error <= target
        {
            return Some(StopReason::Error);
        }
        (done > 0 && self.time.is_some_and(|_| self.pass_within_time(done, elapsed) == 0))
            .then_some(StopReason::Time)
    }

    /// Samples per pixel of the next pass: as many as before, up to a limit, and no more than the rules leave.
    pub fn next_pass(&self, done: u64, elapsed: Duration) -> u64 {
        let pass = done.clamp(2, LARGEST_PASS);
        let left = self.samples.map_or(u64::MAX, |n| n - done.min(n));
        let in_time =
            if done > 0 && self.time.is_some() { self.pass_within_time(done, elapsed) } else { u64::MAX };
        pass.min(left).min(in_time)
    }

    /// How many more samples per pixel fit the time, at the speed so far; an even number, to keep the halves equal.
    fn pass_within_time(&self, done: u64, elapsed: Duration) -> u64 {
        let Some(time) = self.time else { return u64::MAX };
        let left = time.saturating_sub(elapsed).as_secs_f64();
        let per_sample = elapsed.as_secs_f64().max(1e-9) / done as f64;
        ((left / per_sample) as u64) & !1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn passes_double_and_end_at_the_sample_count() {
        let rules = StopRules { samples: Some(77), ..StopRules::default() };
        let mut done = 0;
        let mut passes = Vec::new();
        while rules.reached(done, SECOND, None).is_none() {
            passes.push(rules.next_pass(done, SECOND));
            done += passes[passes.len() - 1];
        }
        assert_eq!(passes, [2, 2, 4, 8, 16, 32, 13]);
        assert_eq!(rules.reached(done, SECOND, None), Some(StopReason::Samples));
    }

    #[test]
    fn time_allows_what_fits_and_always_one_pass() {
        let rules = StopRules { time: Some(10 * SECOND), ..StopRules::default() };
        assert_eq!(rules.reached(0, 20 * SECOND, None), None);
        assert_eq!(rules.next_pass(32, 8 * SECOND), 8);
        assert_eq!(rules.reached(32, 10 * SECOND, None), Some(StopReason::Time));
    }

    #[test]
    fn the_error_rule_waits_for_enough_samples() {
        let rules = StopRules { error: Some(1e-3), ..StopRules::default() };
        assert_eq!(rules.reached(8, SECOND, Some(1e-4)), None);
        assert_eq!(rules.reached(16, SECOND, Some(1e-4)), Some(StopReason::Error));
        assert_eq!(rules.reached(16, SECOND, Some(1e-2)), None);
    }
}
