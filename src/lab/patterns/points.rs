//! Patterns of points in the unit square.

use crate::lab::random::Stream;

/// A pattern of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// The centres of a square grid.
    Regular,
    /// Independent uniform points.
    Random,
    /// One uniform point in each cell of a square grid.
    Jittered,
    /// Each point is the one of several uniform candidates that is farthest from the points before it, on the torus.
    /// Few pairs are close, as in a Poisson-disk pattern. [Mitchell 1991]
    BestCandidate,
}

/// The number of candidates for each point.
const CANDIDATES: u32 = 20;

impl Pattern {
    /// All patterns.
    pub const ALL: [Pattern; 4] =
        [Pattern::Regular, Pattern::Random, Pattern::Jittered, Pattern::BestCandidate];

    /// Returns the pattern's name.
    pub fn name(self) -> &'static str {
        match self {
            Pattern::Regular => "regular",
            Pattern::Random => "random",
            Pattern::Jittered => "jittered",
            Pattern::BestCandidate => "Poisson-disk-like",
        }
    }

    /// Creates `side`² points.
    pub fn points(self, side: u32, stream: &mut Stream) -> Vec<[f64; 2]> {
        let cells = (0..side * side).map(|i| [f64::from(i % side), f64::from(i / side)]);
        let in_cell =
            |[x, y]: [f64; 2], [u, v]: [f64; 2]| [(x + u) / f64::from(side), (y + v) / f64::from(side)];
        match self {
            Pattern::Regular => cells.map(|cell| in_cell(cell, [0.5; 2])).collect(),
            Pattern::Random => cells.map(|_| [stream.uniform(), stream.uniform()]).collect(),
            Pattern::Jittered => {
                cells.map(|cell| in_cell(cell, [stream.uniform(), stream.uniform()])).collect()
            }
            Pattern::BestCandidate => best_candidates(side * side, stream),
        }
    }
}

/// Returns the squared distance on the torus.
pub fn distance_squared(a: [f64; 2], b: [f64; 2]) -> f64 {
    [0, 1].map(|k| (a[k] - b[k]).abs()).map(|d| d.min(1.0 - d).powi(2)).iter().sum()
}

fn best_candidates(n: u32, stream: &mut Stream) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = Vec::with_capacity(n as usize);
    for _ in 0..n {
        let (mut best, mut farthest) = ([0.0; 2], -1.0);
        for _ in 0..CANDIDATES {
            let candidate = [stream.uniform(), stream.uniform()];
            let nearest =
                points.iter().map(|&p| distance_squared(p, candidate)).fold(f64::INFINITY, f64::min);
            if nearest > farthest {
                (best, farthest) = (candidate, nearest);
            }
        }
        points.push(best);
    }
    points
}

/// Returns the L2 star discrepancy: the root mean square, over all boxes from the origin, of the fraction of the points
/// in the box minus its area. [Warnock 1972]
pub fn discrepancy(points: &[[f64; 2]]) -> f64 {
    let n = points.len() as f64;
    let single: f64 = points.iter().map(|[x, y]| (1.0 - x * x) * (1.0 - y * y)).sum();
    let pairs: f64 = points
        .iter()
        .flat_map(|a| points.iter().map(move |b| (1.0 - a[0].max(b[0])) * (1.0 - a[1].max(b[1]))))
        .sum();
    (1.0 / 9.0 - single / (2.0 * n) + pairs / (n * n)).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// For one point at (x, y), ∫∫ ([x ≤ s, y ≤ t] − st)² is integrated by hand.
    #[test]
    fn discrepancy_of_one_point() {
        assert!((discrepancy(&[[0.0, 0.0]]).powi(2) - (1.0 / 9.0 - 0.5 + 1.0)).abs() < 1e-12);
        assert!((discrepancy(&[[1.0, 1.0]]).powi(2) - 1.0 / 9.0).abs() < 1e-12);
    }

    #[test]
    fn patterns_are_what_they_are_called() {
        let nearest = |points: &[[f64; 2]]| {
            let pairs =
                points.iter().enumerate().flat_map(|(i, &a)| points[..i].iter().map(move |&b| (a, b)));
            pairs.map(|(a, b)| distance_squared(a, b)).fold(f64::INFINITY, f64::min).sqrt()
        };
        for pattern in Pattern::ALL {
            let points = pattern.points(8, &mut Stream::new(1, 0, 0));
            assert_eq!(points.len(), 64);
            assert!(points.iter().flatten().all(|v| (0.0..1.0).contains(v)));
            let mut cells: Vec<u32> =
                points.iter().map(|p| (p[0] * 8.0) as u32 + 8 * (p[1] * 8.0) as u32).collect();
            cells.sort_unstable();
            cells.dedup();
            assert_eq!(
                cells.len() == 64,
                matches!(pattern, Pattern::Regular | Pattern::Jittered),
                "{pattern:?}"
            );
        }
        let [random, disk] = [Pattern::Random, Pattern::BestCandidate]
            .map(|pattern| nearest(&pattern.points(8, &mut Stream::new(1, 0, 0))));
        assert!(disk > 4.0 * random && disk > 0.5 / 8.0, "{disk} {random}");
    }
}
