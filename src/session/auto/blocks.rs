//! Comparison of pilots in blocks of pixels: what the halves of a pilot cannot show.

use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::render::Rendered;

/// The side of the blocks.
const BLOCK: u32 = 8;
/// A block that is brighter by this factor in the pilot of a candidate that may be biased shows that another one lacks
/// light.
const LACKS: f64 = 8.0;
/// The number of standard errors by which a block may be wrong.
const DEVIATIONS: f64 = 2.0;

/// The least number of blocks that show the standard error of a bias.
const FEWEST_BLOCKS: usize = 16;

/// What the expected image of a candidate differs by from the exact one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bias {
    /// Nothing.
    None,
    /// An error that decreases with the number of samples.
    Vanishing,
    /// An error that remains.
    Remaining,
}

/// The blocks of a pilot, by rows: the mean of each channel, and its standard error.
pub struct Blocks(Vec<[[f64; 2]; 3]>);

impl Blocks {
    /// Returns the blocks of a pilot.
    pub fn of(pilot: &Rendered) -> Self {
        let columns = pilot.rect.width.div_ceil(BLOCK) as usize;
        let rows = pilot.rect.height.div_ceil(BLOCK) as usize;
        // Sums of means and of the differences of halves.
        let mut blocks = vec![[[0.0; 2]; 3]; columns * rows];
        let mut pixels = vec![0.0; columns * rows];
        for tile in &pilot.tiles {
            for i in 0..tile.pixel_count() {
                let (x, y) = tile.position(i);
                let (x, y) = ((x - pilot.rect.x) / BLOCK, (y - pilot.rect.y) / BLOCK);
                let block = y as usize * columns + x as usize;
                pixels[block] += 1.0;
                for (c, sums) in blocks[block].iter_mut().enumerate() {
                    let [mean, difference] = tile.halves(i, c);
                    sums[0] += mean;
                    sums[1] += difference;
                }
            }
        }
        for (block, pixels) in blocks.iter_mut().zip(pixels) {
            *block = block.map(|[mean, difference]| [mean / pixels, (difference / pixels).abs()]);
        }
        Blocks(blocks)
    }

    /// Returns the relMSE that the halves of this pilot do not show but another pilot does, as far as it is not a bias
    /// that remains: [`squared_bias`](Self::squared_bias) has that. `scale` is the factor from a squared bias of the
    /// pilot that vanishes to that of the image.
    pub fn unknown_error(&self, bias: Bias, (other, other_bias): (&Self, Bias), scale: f64) -> f64 {
        let exact = |bias| bias == Bias::None;
        if other_bias == Bias::Remaining || (bias == Bias::Remaining && exact(other_bias)) {
            return 0.0;
        }
        // No sample of a block has found the light, or too few. If pixels are independent, the variance of a pixel is
        // that of the block times their number. The photons of a block are the same for all of its pixels.
        let of_light = if exact(bias) { f64::from(BLOCK * BLOCK) } else { 1.0 };
        let mut sum = 0.0;
        for (mine, theirs) in self.0.iter().flatten().zip(other.0.iter().flatten()) {
            let ([mine, my_error], [theirs, their_error]) = (mine, theirs);
            let gap = ((theirs - mine).abs() - DEVIATIONS * (my_error + their_error)).max(0.0);
            let square = gap * gap / (theirs * theirs + RELATIVE_FLOOR);
            sum += if *theirs > LACKS * (mine + my_error) {
                square * of_light
            } else if exact(bias) && exact(other_bias) {
                // Noise has either sign.
                square * of_light * (theirs - mine).signum()
            } else if bias == Bias::Vanishing && exact(other_bias) {
                square * scale
            } else {
                0.0
            };
        }
        (sum / (3 * self.0.len()) as f64).max(0.0)
    }

    /// Returns an estimate of the mean squared relative difference of the expected image from that of an unbiased
    /// pilot, and its standard error; `None` if there are too few blocks for that. The pilots have independent random
    /// numbers. Without a difference, the expected estimate is 0.
    pub fn squared_bias(&self, exact: &Self) -> Option<[f64; 2]> {
        if self.0.len() < FEWEST_BLOCKS {
            return None;
        }
        let of_block = |(mine, theirs): (&[[f64; 2]; 3], &[[f64; 2]; 3])| {
            let of_channel = |c: usize| {
                let ([mine, my_error], [theirs, their_error]) = (mine[c], theirs[c]);
                let difference = theirs - mine;
                // The squares of the standard errors are what noise adds to the square of the difference.
                (difference * difference - my_error * my_error - their_error * their_error)
                    / (theirs * theirs + RELATIVE_FLOOR)
            };
            (0..3).map(of_channel).sum::<f64>() / 3.0
        };
        let squares: Vec<f64> = self.0.iter().zip(&exact.0).map(of_block).collect();
        let n = squares.len() as f64;
        let mean = squares.iter().sum::<f64>() / n;
        let variance = squares.iter().map(|square| (square - mean) * (square - mean)).sum::<f64>();
        Some([mean, (variance / (n * (n - 1.0))).sqrt()])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::{pcg3d, to_unit};

    fn grey(values: &[[f64; 2]]) -> Blocks {
        Blocks(values.iter().map(|&value| [value; 3]).collect())
    }

    /// Returns the unknown error of grey blocks, given by means and standard errors of the means.
    fn unknown(own: &[[f64; 2]], bias: Bias, other: &[[f64; 2]], other_bias: Bias) -> f64 {
        grey(own).unknown_error(bias, (&grey(other), other_bias), 0.25)
    }

    #[test]
    fn light_that_only_others_find_is_an_error_of_all_pixels_of_a_block() {
        let dark = [[1.0, 0.0], [0.0, 0.0]];
        let bright = [[1.0, 0.0], [1.0, 0.1]];
        let expected = 0.5 * 0.64 / 1.01;
        for (bias, other, pixels) in [
            (Bias::None, Bias::None, 64.0),
            (Bias::None, Bias::Vanishing, 64.0),
            (Bias::Vanishing, Bias::None, 1.0),
        ] {
            let found = unknown(&dark, bias, &bright, other);
            assert!((found / (pixels * expected) - 1.0).abs() < 1e-9, "{found}");
            assert_eq!(unknown(&bright, Bias::None, &dark, other), 0.0);
        }
    }

    #[test]
    fn what_halves_do_not_share_and_what_has_either_sign_is_noise() {
        assert_eq!(unknown(&[[0.0, 0.0]], Bias::None, &[[5.0, 2.5]], Bias::None), 0.0);
        let (own, other) = ([[1.2, 0.0], [1.0, 0.0]], [[1.0, 0.0], [1.2, 0.0]]);
        assert_eq!(unknown(&own, Bias::None, &other, Bias::None), 0.0);
    }

    #[test]
    fn a_bias_counts_in_both_directions_but_only_against_exact_images() {
        let (biased, exact) = ([[1.1, 0.0], [0.9, 0.0]], [[1.0, 0.0], [1.0, 0.0]]);
        let found = unknown(&biased, Bias::Vanishing, &exact, Bias::None);
        assert!((found - 0.25 * 0.01 / 1.01).abs() < 1e-9, "{found}");
        assert_eq!(unknown(&exact, Bias::None, &biased, Bias::Vanishing), 0.0);
        assert_eq!(unknown(&biased, Bias::Vanishing, &exact, Bias::Vanishing), 0.0);
        // One that remains is measured by itself, with some blocks at least, and is no witness.
        assert_eq!(unknown(&biased, Bias::Remaining, &exact, Bias::None), 0.0);
        assert_eq!(unknown(&[[0.0, 0.0]], Bias::None, &[[1.0, 0.0]], Bias::Remaining), 0.0);
        let [many, of_exact] = [biased, exact].map(|blocks| grey(&blocks.repeat(8)));
        assert!((many.squared_bias(&of_exact).expect("a bias")[0] - 0.01 / 1.01).abs() < 1e-9);
        assert_eq!(grey(&biased).squared_bias(&grey(&exact)), None);
    }

    /// Blocks with noise of known standard deviation, and standard errors from two halves.
    #[test]
    fn noise_is_no_bias() {
        const N: u32 = 4096;
        let noise = |stream: u32, i: u32| {
            let [a, b, c] = pcg3d(stream, i, 7).map(|u| f64::from(to_unit(u)));
            a + b + c - 1.5
        };
        let blocks = |stream: u32, bias: f64| {
            let block = |i| {
                let [a, b] = [2 * stream, 2 * stream + 1].map(|half| 0.2 * noise(half, i));
                [1.0 + bias + (a + b) / 2.0, ((a - b) / 2.0).abs()]
            };
            grey(&(0..N).map(block).collect::<Vec<_>>())
        };
        for bias in [0.0, 0.05] {
            let [found, error] = blocks(1, bias).squared_bias(&blocks(2, 0.0)).expect("many blocks");
            let expected = bias * bias / 1.01;
            assert!((found - expected).abs() < 4.0 * error + 1e-4, "{bias}: {found} +- {error}");
            assert!(error < 1e-3, "{bias}: {error}");
        }
    }
}
