//! Densities of directions: quadtrees over the unit square. [Müller 2017, 3.2]

use crate::math::{Vec2, Vec3};
use crate::sampling::warp;

/// A cell of the square is divided if it has more than this share of the flux, and at least this number of photons.
const LEAST_SHARE: f32 = 0.01;
const LEAST_PHOTONS: usize = 8;
/// The greatest number of divisions. The least cells are 1/1024 of a turn wide.
const MOST_LEVELS: u32 = 10;

/// The direction from which a photon came, and its flux.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// The direction as a position in a cell of the unit square; at first, in the whole square.
    square: Vec2,
    flux: f32,
}

impl Arrival {
    /// Creates the arrival of a photon from the unit direction `wi`.
    pub fn new(wi: Vec3, flux: f32) -> Self {
        Arrival { square: square_of(wi), flux }
    }
}

/// A cell of the square that is divided into quarters.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Node {
    /// The shares of the quarters in the cell's probability.
    shares: [f32; 4],
    /// The indices of the quarters' nodes; 0 for quarters of constant density.
    children: [u16; 4],
}

/// A piecewise constant density over the sphere of directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Directions {
    nodes: Vec<Node>,
}

/// Returns the position of a unit direction in the square, with coordinates in [0, 1).
#[inline]
fn square_of(wi: Vec3) -> Vec2 {
    warp::sphere_to_square(wi).min(Vec2::splat(1f32.next_down()))
}

/// Returns the index of the quarter of a cell in which a position is, and the position relative to the quarter.
#[inline]
fn quarter(position: Vec2) -> (usize, Vec2) {
    let [right, upper] = [position.x >= 0.5, position.y >= 0.5].map(usize::from);
    (right + 2 * upper, 2.0 * position - Vec2::new(right as f32, upper as f32))
}

/// Chooses the first or the second of two alternatives with probabilities in proportion to the weights. Returns the
/// choice with what remains of the random number `u` in [0, 1).
#[inline]
fn choose(first: f32, second: f32, u: f32) -> (usize, f32) {
    let split = first / (first + second);
    if u < split { (0, u / split) } else { (1, (u - split) / (1.0 - split)) }
}

impl Directions {
    /// Creates the density in proportion to the flux of the arrivals, which are reordered. Returns `None` if their
    /// flux is not positive and finite.
    pub fn new(arrivals: &mut [Arrival]) -> Option<Self> {
        let flux: f32 = arrivals.iter().map(|arrival| arrival.flux).sum();
        let mut directions = Directions { nodes: Vec::new() };
        (flux > 0.0 && flux.is_finite()).then(|| {
            directions.divide(arrivals, LEAST_SHARE * flux, 1);
            directions
        })
    }

    /// Adds the node of a cell. Returns its index.
    fn divide(&mut self, arrivals: &mut [Arrival], least: f32, level: u32) -> u16 {
        let index = self.nodes.len();
        self.nodes.push(Node { shares: [0.0; 4], children: [0; 4] });
        arrivals.sort_by_key(|arrival| quarter(arrival.square).0);
        let mut sums = [0.0; 4];
        for part in arrivals.chunk_by_mut(|a, b| quarter(a.square).0 == quarter(b.square).0) {
            let (i, _) = quarter(part[0].square);
            sums[i] = part.iter().map(|arrival| arrival.flux).sum();
            if level < MOST_LEVELS && sums[i] > least && part.len() >= LEAST_PHOTONS {
                part.iter_mut().for_each(|arrival| arrival.square = quarter(arrival.square).1);
                self.nodes[index].children[i] = self.divide(part, least, level + 1);
            }
        }
        let sum: f32 = sums.iter().sum();
        self.nodes[index].shares = sums.map(|part| part / sum);
        index as u16
    }

    /// Returns the density of a unit direction, sr⁻¹.
    #[inline]
    pub fn pdf(&self, wi: Vec3) -> f32 {
        let (mut position, mut density, mut index) = (square_of(wi), warp::SQUARE_TO_SPHERE_PDF, 0);
        loop {
            let (i, rest) = quarter(position);
            let Node { shares, children } = &self.nodes[index];
            (position, density, index) = (rest, 4.0 * density * shares[i], usize::from(children[i]));
            if index == 0 {
                return density;
            }
        }
    }

    /// Samples a unit direction with two random numbers in [0, 1).
    #[inline]
    pub fn sample(&self, mut u: Vec2) -> Vec3 {
        let (mut corner, mut side, mut index) = (Vec2::ZERO, 1.0, 0);
        loop {
            let Node { shares: [a, b, c, d], children } = self.nodes[index];
            let (upper, y) = choose(a + b, c + d, u.y);
            let (right, x) = if upper == 0 { choose(a, b, u.x) } else { choose(c, d, u.x) };
            u = Vec2::new(x, y);
            side *= 0.5;
            corner += side * Vec2::new(right as f32, upper as f32);
            index = usize::from(children[right + 2 * upper]);
            if index == 0 {
                return warp::square_to_sphere((corner + side * u).min(Vec2::splat(1f32.next_down())));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::{combine, to_unit};

    fn random(i: u32) -> Vec2 {
        Vec2::new(to_unit(combine(1, i)), to_unit(combine(2, i)))
    }

    /// Directions around two poles, one of them ten times as bright and narrow.
    fn density() -> Directions {
        let arrival = |i: u32| {
            let spread = if i.is_multiple_of(2) { 0.02 } else { 0.5 };
            let wi = warp::square_to_cone(random(i), spread);
            if i.is_multiple_of(2) { Arrival::new(wi, 10.0) } else { Arrival::new(-wi, 1.0) }
        };
        Directions::new(&mut (0..4000).map(arrival).collect::<Vec<_>>()).expect("flux is positive")
    }

    #[test]
    fn density_integrates_to_one() {
        let density = density();
        let n = 1 << 20;
        let sum: f64 = (0..n)
            .map(|i| {
                let u = Vec2::new(((i >> 10) as f32 + 0.5) / 1024.0, ((i & 1023) as f32 + 0.5) / 1024.0);
                f64::from(density.pdf(warp::square_to_sphere(u)))
            })
            .sum();
        let integral = sum / f64::from(n) / f64::from(warp::SQUARE_TO_SPHERE_PDF);
        assert!((integral - 1.0).abs() < 1e-4, "{integral}");
    }

    /// The frequencies of samples in 32 × 32 cells; the greatest of 1024 deviations is below 5σ for 99.9 % of seeds.
    #[test]
    fn samples_have_the_density() {
        let density = density();
        let (side, n) = (32, 1 << 20);
        let mut counts = vec![0.0; side * side];
        let mut expected = vec![0.0; side * side];
        for i in 0..n {
            let p = square_of(density.sample(random(i)));
            counts[(p.y * side as f32) as usize * side + (p.x * side as f32) as usize] += 1.0;
            // Two points for each of 1024 x 1024 cells would be exact; the density is constant in each.
            let p = Vec2::new(((i >> 10) as f32 + 0.5) / 1024.0, ((i & 1023) as f32 + 0.5) / 1024.0);
            expected[(p.y * side as f32) as usize * side + (p.x * side as f32) as usize] +=
                f64::from(density.pdf(warp::square_to_sphere(p)) / warp::SQUARE_TO_SPHERE_PDF);
        }
        for (count, expected) in counts.iter().zip(&expected) {
            let deviation: f64 = count - expected;
            assert!(deviation.abs() < 5.0 * (expected + 4.0).sqrt(), "{count} instead of {expected}");
        }
    }

    #[test]
    fn flux_must_be_positive() {
        assert_eq!(Directions::new(&mut []), None);
        assert_eq!(Directions::new(&mut [Arrival::new(Vec3::Z, 0.0)]), None);
        assert_eq!(Directions::new(&mut [Arrival::new(Vec3::Z, f32::INFINITY)]), None);
        let one = Directions::new(&mut [Arrival::new(-Vec3::Z, 1.0)]).expect("flux is positive");
        assert!(one.sample(random(3)).z < 0.0 && one.pdf(Vec3::Z) == 0.0);
    }
}
