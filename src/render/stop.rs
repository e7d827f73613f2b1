//! Stop rules: the first that fires ends the render.

use crate::estimate::replicates::ErrorEstimate;
use std::fmt;
use std::time::Duration;

/// When to stop. Without any rule a render goes on until it is interrupted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StopRules {
    /// Samples per pixel.
    pub samples: Option<u64>,
    /// Time for sampling.
    pub time: Option<Duration>,
    /// What the relMSE of the image must not exceed: the upper end of the estimate's interval decides.
    pub error: Option<f64>,
}

/// Which rule ended a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// All samples were taken.
    Samples,
    /// The next pass would have passed the time.
    Time,
    /// The upper end of the estimated error's interval fell to the target.
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
/// An error estimate from fewer samples is not trusted to stop a render: calibration finds intervals that hold what
/// they promise from here on.
const FEWEST_FOR_ERROR: u64 = 16;
/// A pass towards the target takes this share of the samples that seem to be missing, while they are many: the error of
/// low-discrepancy samplers falls faster than one over their number.
const CAUTION: f64 = 0.75;
/// They are many above this share of those that are done.
const MANY: f64 = 0.125;

impl StopRules {
    /// Why to stop after `done` samples per pixel, if any rule says so. `elapsed` is the time so far, `error`
    /// the estimated relMSE.
    pub fn reached(&self, done: u64, elapsed: Duration, error: Option<ErrorEstimate>) -> Option<StopReason> {
        if self.samples.is_some_and(|n| done >= n) {
            return Some(StopReason::Samples);
        }
        if done >= FEWEST_FOR_ERROR
            && let (Some(target), Some(error)) = (self.error, error)
            && error.interval[1] <= target
        {
            return Some(StopReason::Error);
        }
        (done > 0 && self.time.is_some_and(|_| self.pass_within_time(done, elapsed) == 0))
            .then_some(StopReason::Time)
    }

    /// Samples per pixel of the next pass: as many as before, up to a limit, and no more than the rules leave or
    /// the target seems to need.
    pub fn next_pass(&self, done: u64, elapsed: Duration, error: Option<ErrorEstimate>) -> u64 {
        let pass = done.clamp(2, LARGEST_PASS);
        let left = self.samples.map_or(u64::MAX, |n| n - done.min(n));
        let in_time =
            if done > 0 && self.time.is_some() { self.pass_within_time(done, elapsed) } else { u64::MAX };
        pass.min(left).min(in_time).min(self.pass_to_target(done, error))
    }

    /// How many more samples per pixel seem to be missing for the target; an even number.
    fn pass_to_target(&self, done: u64, error: Option<ErrorEstimate>) -> u64 {
        let (Some(target), Some(error)) = (self.error, error) else { return u64::MAX };
        if done < FEWEST_FOR_ERROR {
            return FEWEST_FOR_ERROR - done;
        }
        // The error falls about as one over the number of samples.
        let missing = (error.interval[1] / target - 1.0).max(0.0) * done as f64;
        let pass = if missing > MANY * done as f64 { CAUTION * missing } else { missing };
        (pass.ceil() as u64).saturating_add(1).max(2) & !1
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
            passes.push(rules.next_pass(done, SECOND, None));
            done += passes[passes.len() - 1];
        }
        assert_eq!(passes, [2, 2, 4, 8, 16, 32, 13]);
        assert_eq!(rules.reached(done, SECOND, None), Some(StopReason::Samples));
    }

    #[test]
    fn time_allows_what_fits_and_always_one_pass() {
        let rules = StopRules { time: Some(10 * SECOND), ..StopRules::default() };
        assert_eq!(rules.reached(0, 20 * SECOND, None), None);
        assert_eq!(rules.next_pass(32, 8 * SECOND, None), 8);
        assert_eq!(rules.reached(32, 10 * SECOND, None), Some(StopReason::Time));
    }

    /// An estimate with 10 % on either side.
    fn about(relmse: f64) -> Option<ErrorEstimate> {
        Some(ErrorEstimate { relmse, interval: [relmse / 1.1, relmse * 1.1] })
    }

    #[test]
    fn the_error_rule_waits_for_enough_samples_and_for_the_upper_end() {
        let rules = StopRules { error: Some(1e-3), ..StopRules::default() };
        assert_eq!(rules.reached(8, SECOND, about(1e-4)), None);
        assert_eq!(rules.reached(16, SECOND, about(1e-4)), Some(StopReason::Error));
        assert_eq!(rules.reached(16, SECOND, about(0.95e-3)), None);
        assert_eq!(rules.reached(16, SECOND, None), None);
    }

    #[test]
    fn passes_towards_a_target_do_not_overshoot() {
        let rules = StopRules { error: Some(1e-3), ..StopRules::default() };
        for per_sample in [1e-3, 0.07, 0.0801, 0.3, 2.2] {
            let mut done = 0;
            while rules.reached(done, SECOND, about(per_sample / done as f64)).is_none() {
                let pass = rules.next_pass(done, SECOND, about(per_sample / done.max(1) as f64));
                assert!(pass.is_multiple_of(2) && pass > 0, "{pass}");
                done += pass;
            }
            let needed = (1.1 * per_sample / 1e-3).max(16.0);
            assert!(done as f64 <= needed + 4.0, "{done} instead of {needed}");
        }
    }
}
