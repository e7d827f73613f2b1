//! What a pilot's light paths have brought, by where on their emitter and in which direction they began.

use super::{Beginnings, UNGUIDED};
use crate::math::Vec2;
use crate::sampling::Distribution2D;

/// Cells along each axis of the unit squares of positions and directions.
const CELLS: usize = 64;
/// A density is learned or not.
const CHOICES: usize = 2;

/// What the pilot has found out about an emitter.
#[derive(Default)]
pub struct Findings {
    paths: Vec<Pilot>,
}

/// A path of the pilot: where on its emitter and in which direction it began, and how much it has brought, W.
struct Pilot {
    pairs: [Vec2; 2],
    value: f64,
}

/// The paths that began in the cells of a unit square: how many, and the sums of the squares of what they brought.
#[derive(Clone)]
struct Square {
    cells: usize,
    counts: Vec<u32>,
    squares: Vec<f64>,
}

impl Findings {
    /// Counts a path that began there and has brought that much, W.
    pub fn add(&mut self, pairs: [Vec2; 2], value: f64) {
        self.paths.push(Pilot { pairs, value });
    }

    /// The densities that make the second moment of light paths least, and its root then.
    ///
    /// Positions and directions are taken for independent; where they are not, one density or none may be better than both.
    /// Each half of the paths tries what the other half has learned: by its own paths every density looks too good.
    pub fn best(&self) -> (Beginnings, f64) {
        if self.paths.iter().all(|path| path.value == 0.0) {
            return ([None, None], 0.0);
        }
        // Of positions and of directions, by every other path.
        let mut halves: [[Square; 2]; 2] = Default::default();
        for (i, Pilot { pairs, value }) in self.paths.iter().enumerate() {
            halves[i % 2].iter_mut().zip(pairs).for_each(|(square, u)| square.add(*u, *value));
        }
        let learned =
            halves.each_ref().map(|squares| squares.each_ref().map(|square| [None, square.distribution()]));
        let mut moments = [[0.0; CHOICES]; CHOICES];
        for (i, &Pilot { pairs, value }) in self.paths.iter().enumerate().filter(|(_, path)| path.value > 0.0)
        {
            let others = &learned[1 - i % 2];
            let [points, directions] = [0, 1].map(|i| {
                others[i].each_ref().map(|choice| match choice {
                    Some(distribution) => f64::from(distribution.pdf(pairs[i])),
                    None => 1.0,
                })
            });
            for (moments, point) in moments.iter_mut().zip(points) {
                for (moment, direction) in moments.iter_mut().zip(directions) {
                    *moment += value * value / (UNGUIDED + (1.0 - UNGUIDED) * point * direction);
                }
            }
        }
        let all = (0..CHOICES * CHOICES).map(|i| (i / CHOICES, i % CHOICES));
        let (point, direction) =
            all.min_by(|a, b| moments[a.0][a.1].total_cmp(&moments[b.0][b.1])).unwrap_or_default();
        let best = [(0, point), (1, direction)].map(|(i, choice)| {
            let [even, odd] = &halves;
            if choice == 1 { even[i].joined_with(&odd[i]).distribution() } else { None }
        });
        (best, (moments[point][direction] / self.paths.len() as f64).sqrt())
    }
}

impl Default for Square {
    fn default() -> Self {
        Square::new(CELLS)
    }
}

impl Square {
    fn new(cells: usize) -> Self {
        Square { cells, counts: vec![0; cells * cells], squares: vec![0.0; cells * cells] }
    }

    fn add(&mut self, u: Vec2, value: f64) {
        let [x, y] = (u * self.cells as f32).to_array().map(|x| (x as usize).min(self.cells - 1));
        self.counts[y * self.cells + x] += 1;
        self.squares[y * self.cells + x] += value * value;
    }

    fn joined_with(&self, other: &Square) -> Square {
        let counts = self.counts.iter().zip(&other.counts).map(|(a, b)| a + b).collect();
        let squares = self.squares.iter().zip(&other.squares).map(|(a, b)| a + b).collect();
        Square { cells: self.cells, counts, squares }
    }

    /// Each four cells made one.
    fn coarser(&self) -> Square {
        let mut coarse = Square::new(self.cells / 2);
        for (i, (count, squares)) in self.counts.iter().zip(&self.squares).enumerate() {
            let (x, y) = (i % self.cells / 2, i / self.cells / 2);
            coarse.counts[y * coarse.cells + x] += count;
            coarse.squares[y * coarse.cells + x] += squares;
        }
        coarse
    }

    /// In proportion to the root of the second moment in each cell: the density of the least variance. `None` where nothing was
    /// found.
    fn distribution(&self) -> Option<Distribution2D> {
        let weights: Vec<f64> = self.moments().into_iter().map(f64::sqrt).collect();
        let found = weights.iter().any(|&weight| weight > 0.0);
        found.then(|| Distribution2D::new(self.cells, self.cells, &weights))
    }

    /// The second moment in each cell, as if one more path had been there that brought what the four cells around it do:
    /// where few paths were, more of the light may come from than they say.
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

    /// What paths found out that began everywhere and brought what `value` says.
    fn found(paths: u32, value: impl Fn(Vec2, Vec2) -> f64) -> (Beginnings, f64) {
        let mut findings = Findings::default();
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
        let ([points, directions], root) = found(paths, |_, direction| f64::from(direction.x < 0.1));
        assert!(points.is_none(), "noise is no density");
        let directions = directions.expect("a tenth of all directions brings everything");
        let (inside, outside) = (Vec2::new(0.03, 0.5), Vec2::new(0.5, 0.5));
        assert!((directions.pdf(inside) - 9.0).abs() < 1.0, "{}", directions.pdf(inside));
        assert!(directions.pdf(outside) < 0.02);
        // Second moments of 0.1 without a guide, of 0.1 / (1/2 + 1/2 * 10) with the best.
        assert!((root * root / (0.1 / 5.5) - 1.0).abs() < 0.1, "{}", root * root);
    }

    #[test]
    fn where_position_and_direction_depend_on_one_another_nothing_is_worse_than_before() {
        let (_, root) = found(1 << 15, |point, direction| f64::from((point.x < 0.5) == (direction.x < 0.5)));
        assert!(root * root <= 0.51, "{}", root * root);
        let (_, nothing) = found(1000, |_, _| 0.0);
        assert_eq!(nothing, 0.0);
    }

    #[test]
    fn cells_that_few_paths_have_hit_are_not_left_out() {
        let ([_, directions], _) = found(1 << 12, |_, direction| f64::from(direction.x < 0.5));
        let directions = directions.expect("half of the directions bring everything");
        for x in 0..32 {
            for y in 0..64 {
                let pdf = directions.pdf((Vec2::new(x as f32, y as f32) + 0.5) / 64.0);
                assert!(pdf > 0.5, "{x} {y} {pdf}");
            }
        }
    }
}
