//! Medians over runs, and the rate at which the error decreases.

use super::{BenchRow, Measurement, Reference};
use crate::error::counted;
use crate::estimate::convergence::PowerLaw;

/// relMSE against seconds as a power law.
pub type Slope = PowerLaw;

/// A measured error of less than this factor times the reference's own error is marked, and is not fitted.
pub(super) const CLEAR_OF_FLOOR: f64 = 10.0;

/// The greatest width of the 95 % interval of a slope that is reported.
pub const WIDEST_SLOPE: f64 = 1.0;

/// Medians of the runs of one combination with one budget.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Median {
    /// Wall time of preparation and sampling, in seconds.
    pub seconds: f64,
    /// Samples per pixel.
    pub samples_per_pixel: f64,
    /// relMSE against the reference.
    pub relmse: f64,
    /// The least and the greatest relMSE of the runs.
    pub relmse_range: [f64; 2],
    /// relMSE without the worst 0.1 % of the pixels.
    pub trimmed_relmse: f64,
    /// Mean squared error.
    pub mse: f64,
    /// Mean FLIP error.
    pub flip: f64,
    /// Millions of rays per second of wall time.
    pub mrays_per_second: f64,
    /// 1 / (relMSE · seconds), from the medians.
    pub efficiency: f64,
}

impl Median {
    /// Returns the medians of the runs; `None` if there are none.
    pub fn of(runs: &[Measurement]) -> Option<Median> {
        let of = |value: &dyn Fn(&Measurement) -> f64| median(runs.iter().map(value).collect());
        let relmse = of(&|m| m.relmse)?;
        let seconds = of(&|m| m.seconds)?;
        let fold = |start: f64, pick: fn(f64, f64) -> f64| runs.iter().map(|m| m.relmse).fold(start, pick);
        Some(Median {
            seconds,
            samples_per_pixel: of(&|m| m.samples_per_pixel as f64)?,
            relmse,
            relmse_range: [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)],
            trimmed_relmse: of(&|m| m.trimmed_relmse)?,
            mse: of(&|m| m.mse)?,
            flip: of(&|m| m.flip)?,
            mrays_per_second: of(&|m| m.rays_per_second() * 1e-6)?,
            efficiency: 1.0 / (relmse * seconds),
        })
    }

    /// Returns whether the error is too close to the reference's own error.
    pub fn is_near_floor(&self, reference: &Reference) -> bool {
        reference.floor.is_some_and(|floor| self.relmse < CLEAR_OF_FLOOR * floor)
    }
}

impl BenchRow {
    /// Returns the medians for each budget that has runs.
    pub fn medians(&self) -> Vec<Option<Median>> {
        self.cells.iter().map(|runs| Median::of(runs)).collect()
    }

    /// Returns the power law of relMSE over all runs with an error well above the reference's own.
    ///
    /// # Errors
    /// The reason why the slope is unknown: too few runs, or an interval wider than [`WIDEST_SLOPE`].
    pub fn slope(&self, reference: &Reference) -> Result<Slope, String> {
        let limit = reference.floor.map_or(0.0, |floor| CLEAR_OF_FLOOR * floor);
        let runs = || self.cells.iter().flatten().filter(|m| m.relmse >= limit);
        let law = PowerLaw::fit(runs().map(|m| (m.seconds, m.relmse))).ok_or_else(|| {
            let runs = counted(runs().count() as u64, "render", "renders");
            format!("{runs} with an error clear of the reference's, at least 3 of different times are needed")
        })?;
        let width = law.interval[1] - law.interval[0];
        if width <= WIDEST_SLOPE {
            return Ok(law);
        }
        Err(format!("its 95 % interval is {width:.1} wide, of at most {WIDEST_SLOPE}; more runs narrow it"))
    }

    /// Returns the millions of rays per second and thread inside the traversal, over all runs, for closest-hit and
    /// occlusion queries. NaN without such queries.
    pub fn mrays_per_thread_second(&self) -> [f64; 2] {
        std::array::from_fn(|i| {
            let runs = || self.cells.iter().flatten();
            let seconds = runs().map(|m| m.thread_seconds[i]).sum::<f64>();
            runs().map(|m| m.rays[i] as f64).sum::<f64>() * 1e-6 / seconds
        })
    }
}

/// Returns the middle value, or the mean of the two middle values; `None` if there are no values.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => None,
        _ if n % 2 == 1 => Some(values[n / 2]),
        _ => Some(f64::midpoint(values[n / 2 - 1], values[n / 2])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_are_in_the_middle() {
        assert_eq!(median(vec![]), None);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), Some(2.5));
    }

    #[test]
    fn a_median_is_of_each_figure_by_itself() {
        let run = |seconds, relmse| Measurement {
            seed: 0,
            seconds,
            samples_per_pixel: 16,
            relmse,
            trimmed_relmse: relmse / 2.0,
            mse: 1.0,
            flip: 0.0,
            relmse_estimate: None,
            rays: [1_000_000, 3_000_000],
            thread_seconds: [0.5, 1.0],
            invalid_samples: 0,
        };
        let m = Median::of(&[run(1.0, 0.3), run(2.0, 0.1), run(4.0, 0.2)]).expect("three runs");
        assert_eq!((m.seconds, m.relmse, m.relmse_range), (2.0, 0.2, [0.1, 0.3]));
        assert_eq!((m.efficiency, m.mrays_per_second), (2.5, 2.0));
        assert_eq!(Median::of(&[]), None);
    }

    #[test]
    fn a_slope_is_stated_if_its_interval_is_narrow() {
        let run = |seconds: f64, relmse: f64| Measurement {
            seed: 0,
            seconds,
            samples_per_pixel: 16,
            relmse,
            trimmed_relmse: relmse,
            mse: relmse,
            flip: 0.0,
            relmse_estimate: None,
            rays: [1, 1],
            thread_seconds: [1.0, 1.0],
            invalid_samples: 0,
        };
        let slope = |points: &[(f64, f64)], floor: f64| {
            let combination = super::super::Combination {
                integrator: "path".into(),
                sampler: crate::sampling::SamplerKind::Sobol,
                accel: crate::accel::AccelKind::Auto,
            };
            let cells = vec![points.iter().map(|&(s, e)| run(s, e)).collect()];
            let image = crate::image::Image::new(1, 1, &["R", "G", "B"]);
            let reference = Reference { image, file: None, made: String::new(), floor: Some(floor) };
            BenchRow { combination, failure: None, cells, image: None }.slope(&reference)
        };
        let law = [(1.0, 1.0), (2.0, 0.51), (4.0, 0.25), (8.0, 0.125)];
        assert!(slope(&law, 0.0).is_ok_and(|law| (law.exponent + 1.0).abs() < 0.02));
        // Times that are almost equal.
        let wide = slope(&[(1.0, 1.0), (1.01, 0.5), (1.02, 0.9)], 0.0).unwrap_err();
        assert!(wide.starts_with("its 95 % interval is ") && wide.contains(" wide, of at most 1;"), "{wide}");
        let few = slope(&law, 0.05).unwrap_err();
        assert!(few.starts_with("2 renders with an error clear of the reference's, at least 3 "), "{few}");
    }
}
