//! The contributions of the pilot's light paths as a function of position and direction at the emitter.

use super::{EmissionDensities, UNGUIDED};
use crate::math::Vec2;
use crate::sampling::Distribution2D;

/// The number of cells along each axis of the unit squares of positions and directions.
const CELLS: usize = 64;
/// A density is either uniform or learned.
const DENSITY_CHOICES: usize = 2;

/// The results of the pilot for one emitter.
#[derive(Default)]
pub struct PilotResults {
    paths: Vec<PilotPath>,
}

/// What the pilot found for one emitter.
pub struct Learned {
    /// The densities that minimise the second moment of the light paths' contributions.
    pub densities: EmissionDensities,
    /// The square root of that moment.
    pub root_of_moment: f64,
    /// The contributions of paths, each with the density that other paths predict for it.
    predicted: Vec<[f64; 2]>,
}

/// A path of the pilot: the random numbers of position and direction, and its contribution in W.
struct PilotPath {
    pairs: [Vec2; 2],
    value: f64,
}

/// The paths in each cell of a unit square: their number and the sum of their squared contributions.
#[derive(Clone, Debug)]
pub struct PathHistogram {
    cells: usize,
    counts: Vec<u32>,
    squares: Vec<f64>,
}

impl PilotResults {
    /// Adds a path with the given random numbers and contribution in W.
    pub fn add(&mut self, pairs: [Vec2; 2], value: f64) {
        self.paths.push(PilotPath { pairs, value });
    }

    /// Returns the densities that minimise the second moment of the light paths' contributions.
    ///
    /// Positions and directions are assumed to be independent. If they are not, one density or none may be better
    /// than both. Each half of the paths tests the densities learned from the other half, because a density tested on
    /// its own paths seems better than it is.
    pub fn best(&self) -> Learned {
        if self.paths.iter().all(|path| path.value == 0.0) {
            return Learned { densities: [None, None], root_of_moment: 0.0, predicted: Vec::new() };
        }
        // For positions and directions, learned from alternate paths.
        let mut halves: [[PathHistogram; 2]; 2] = Default::default();
        for (i, PilotPath { pairs, value }) in self.paths.iter().enumerate() {
            halves[i % 2].iter_mut().zip(pairs).for_each(|(square, u)| square.add(*u, *value));
        }
        let learned =
            halves.each_ref().map(|squares| squares.each_ref().map(|square| [None, square.distribution()]));
        let mut moments = [[0.0; DENSITY_CHOICES]; DENSITY_CHOICES];
        let mut predicted: [[Vec<[f64; 2]>; DENSITY_CHOICES]; DENSITY_CHOICES] = Default::default();
        for (i, &PilotPath { pairs, value }) in
            self.paths.iter().enumerate().filter(|(_, path)| path.value > 0.0)
        {
            let others = &learned[1 - i % 2];
            let [points, directions] = [0, 1].map(|i| {
                others[i].each_ref().map(|choice| match choice {
                    Some(distribution) => f64::from(distribution.pdf(pairs[i])),
                    None => 1.0,
                })
            });
            for (p, point) in points.into_iter().enumerate() {
                for (d, direction) in directions.into_iter().enumerate() {
                    let density = point * direction;
                    moments[p][d] += value * value / (UNGUIDED + (1.0 - UNGUIDED) * density);
                    predicted[p][d].push([value, density]);
                }
            }
        }
        let all = (0..DENSITY_CHOICES * DENSITY_CHOICES).map(|i| (i / DENSITY_CHOICES, i % DENSITY_CHOICES));
        let (point, direction) =
            all.min_by(|a, b| moments[a.0][a.1].total_cmp(&moments[b.0][b.1])).unwrap_or_default();
        let densities = [(0, point), (1, direction)].map(|(i, choice)| {
            let [even, odd] = &halves;
            if choice == 1 { even[i].joined_with(&odd[i]).distribution() } else { None }
        });
        Learned {
            densities,
            root_of_moment: (moments[point][direction] / self.paths.len() as f64).sqrt(),
            predicted: std::mem::take(&mut predicted[point][direction]),
        }
    }
}

impl Learned {
    /// Returns the harmonic mean of the densities of starts with light, given the probabilities of starts without and
    /// with the learned densities. The contribution of a start is divided by its density, so the mean is harmonic.
    pub fn typical_density(&self, unguided: f64, guided: f64) -> f64 {
        let total: f64 = self.predicted.iter().map(|[value, _]| value).sum();
        let divided = self.predicted.iter().map(|[value, density]| value / (unguided + guided * density));
        if total > 0.0 { total / divided.sum::<f64>() } else { unguided + guided }
    }
}

impl Default for PathHistogram {
    fn default() -> Self {
        PathHistogram::new(CELLS)
    }
}

impl PathHistogram {
    fn new(cells: usize) -> Self {
        PathHistogram { cells, counts: vec![0; cells * cells], squares: vec![0.0; cells * cells] }
    }

    /// Adds a path with the given random numbers and contribution.
    pub fn add(&mut self, u: Vec2, value: f64) {
        let [x, y] = (u * self.cells as f32).to_array().map(|x| (x as usize).min(self.cells - 1));
        self.counts[y * self.cells + x] += 1;
        self.squares[y * self.cells + x] += value * value;
    }

    fn joined_with(&self, other: &PathHistogram) -> PathHistogram {
        let counts = self.counts.iter().zip(&other.counts).map(|(a, b)| a + b).collect();
        let squares = self.squares.iter().zip(&other.squares).map(|(a, b)| a + b).collect();
        PathHistogram { cells: self.cells, counts, squares }
    }

    /// Returns a histogram with groups of four cells merged.
    fn coarser(&self) -> PathHistogram {
        let mut coarse = PathHistogram::new(self.cells / 2);
        for (i, (count, squares)) in self.counts.iter().zip(&self.squares).enumerate() {
            let (x, y) = (i % self.cells / 2, i / self.cells / 2);
            coarse.counts[y * coarse.cells + x] += count;
            coarse.squares[y * coarse.cells + x] += squares;
        }
        coarse
    }

    /// Returns a density proportional to the square root of the second moment in each cell, which minimises the
    /// variance. Returns `None` without contributions.
    pub fn distribution(&self) -> Option<Distribution2D> {
        let weights: Vec<f64> = self.moments().into_iter().map(f64::sqrt).collect();
        let found = weights.iter().any(|&weight| weight > 0.0);
        found.then(|| Distribution2D::new(self.cells, self.cells, &weights))
    }

    /// Returns the second moment in each cell, with one additional path whose contribution is that of the group of
    /// four cells. It accounts for light that few paths may have missed.
    fn moments(&self) -> Vec<f64> {
        let around = if self.cells > 1 { self.coarser().moments() } else { vec![0.0] };
        let moment = |(i, (sum, &count)): (usize, (&f64, &u32))| {
            let (x, y) = (i % self.cells / 2, i / self.cells / 2);
            let one = around[y * (self.cells / 2).max(1) + x];
            (sum + one) / f64::from(count + 1)
        };
        self.squares.iter().zip(&self.counts).enumerate().map(moment).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::{combine, mix, to_unit};

    /// Returns the result of paths started uniformly with the contribution `value`.
    fn found(paths: u32, value: impl Fn(Vec2, Vec2) -> f64) -> Learned {
        let mut findings = PilotResults::default();
        for i in 0..paths {
            let u = |k| to_unit(mix(combine(i, k)));
            let pairs = [Vec2::new(u(0), u(1)), Vec2::new(u(2), u(3))];
            findings.add(pairs, value(pairs[0], pairs[1]));
        }
        findings.best()
    }

    #[test]
    fn what_depends_on_the_direction_only_is_learned_of_it_only() {
        let paths = 1 << 17;
        let learned = found(paths, |_, direction| f64::from(direction.x < 0.1));
        let (root, [points, directions]) = (learned.root_of_moment, &learned.densities);
        assert!(points.is_none(), "noise is no density");
        let directions = directions.as_ref().expect("a tenth of all directions brings everything");
        let (inside, outside) = (Vec2::new(0.03, 0.5), Vec2::new(0.5, 0.5));
        assert!((directions.pdf(inside) - 9.0).abs() < 1.0, "{}", directions.pdf(inside));
        assert!(directions.pdf(outside) < 0.02);
        // The second moment is 0.1 without a guide and 0.1 / (1/2 + 1/2 * 10) with the best guide.
        assert!((root * root / (0.1 / 5.5) - 1.0).abs() < 0.1, "{}", root * root);
    }

    #[test]
    fn where_position_and_direction_depend_on_one_another_nothing_is_worse_than_before() {
        let root = found(1 << 15, |point, direction| f64::from((point.x < 0.5) == (direction.x < 0.5)))
            .root_of_moment;
        assert!(root * root <= 0.51, "{}", root * root);
        assert_eq!(found(1000, |_, _| 0.0).root_of_moment, 0.0);
    }

    #[test]
    fn cells_that_few_paths_have_hit_are_not_left_out() {
        let [_, directions] = found(1 << 12, |_, direction| f64::from(direction.x < 0.5)).densities;
        let directions = directions.expect("half of the directions bring everything");
        for x in 0..32 {
            for y in 0..64 {
                let pdf = directions.pdf((Vec2::new(x as f32, y as f32) + 0.5) / 64.0);
                assert!(pdf > 0.5, "{x} {y} {pdf}");
            }
        }
    }

    /// A density learned from a few paths fits these paths, but says nothing about others.
    #[test]
    fn the_typical_density_is_that_of_paths_from_which_nothing_was_learned() {
        let typical = |learned: &Learned| learned.typical_density(UNGUIDED, 1.0 - UNGUIDED);
        let tenth = found(1 << 15, |_, direction| f64::from(direction.x < 0.1));
        assert!((4.5..5.6).contains(&typical(&tenth)), "the best is 5.5: {}", typical(&tenth));
        // About one of 4000 paths, wherever it starts.
        let rare = |point: Vec2, direction: Vec2| {
            let bits = combine(point.x.to_bits() ^ direction.y.to_bits(), direction.x.to_bits());
            f64::from(to_unit(mix(bits)) < 2.5e-4)
        };
        let few = found(1 << 17, rare);
        assert!(few.predicted.len() > 15 && typical(&few) < 1.5, "{} {}", few.predicted.len(), typical(&few));
        assert_eq!(typical(&found(10, |_, _| 0.0)), 1.0);
    }
}
