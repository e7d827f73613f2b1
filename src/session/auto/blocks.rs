//! Comparison of pilots in pixels and blocks of them: what the halves of a pilot cannot show.

use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::render::Rendered;

/// The side of the blocks.
const BLOCK: usize = 8;
/// A block that is brighter by this factor in the pilot of a candidate that may be biased shows that another one lacks
/// light.
const LACKS: f64 = 8.0;
/// The same where the other candidate never finds some light. A smaller difference may be blur.
const MISSES: f64 = 1.25;
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

/// The mean of each channel, and the difference of its halves, whose absolute value is the standard error.
type Means = [[f64; 2]; 3];

/// The pixels and the blocks of a pilot, both by rows.
pub struct Blocks {
    pixels: Vec<Means>,
    blocks: Vec<Means>,
    /// The number of pixels in a row.
    width: usize,
}

impl Blocks {
    /// Returns the blocks of a pilot.
    pub fn of(pilot: &Rendered) -> Self {
        let width = pilot.rect.width as usize;
        let mut pixels = vec![[[0.0; 2]; 3]; pilot.rect.area() as usize];
        for tile in &pilot.tiles {
            for i in 0..tile.pixel_count() {
                let (x, y) = tile.position(i);
                let (x, y) = ((x - pilot.rect.x) as usize, (y - pilot.rect.y) as usize);
                pixels[y * width + x] = [0, 1, 2].map(|c| tile.halves(i, c));
            }
        }
        Self::of_pixels(pixels, width)
    }

    fn of_pixels(pixels: Vec<Means>, width: usize) -> Self {
        let rows = (pixels.len() / width).div_ceil(BLOCK);
        let mut sums = vec![([[0.0; 2]; 3], 0.0); width.div_ceil(BLOCK) * rows];
        for (i, pixel) in pixels.iter().enumerate() {
            let (sum, count): &mut (Means, f64) = &mut sums[block_of(i, width)];
            sum.iter_mut().flatten().zip(pixel.iter().flatten()).for_each(|(sum, value)| *sum += value);
            *count += 1.0;
        }
        let blocks = sums.into_iter().map(|(sum, count)| sum.map(|of_channel| of_channel.map(|x| x / count)));
        Blocks { blocks: blocks.collect(), pixels, width }
    }

    /// Returns the relMSE that the halves of this pilot do not show but another pilot does, as far as it is not a bias
    /// of its expected image.
    pub fn unknown_error(&self, bias: Bias, (other, other_bias): (&Self, Bias)) -> f64 {
        let exact = |bias| bias == Bias::None;
        if other_bias == Bias::Remaining || (bias == Bias::Remaining && exact(other_bias)) {
            return 0.0;
        }
        // No sample of a block has found the light, or too few. If pixels are independent, the variance of a pixel is
        // that of the block times their number. The photons of a block are the same for all of its pixels.
        let of_light = if exact(bias) { (BLOCK * BLOCK) as f64 } else { 1.0 };
        let mut sum = 0.0;
        for (mine, theirs) in self.blocks.iter().flatten().zip(other.blocks.iter().flatten()) {
            let ([mine, my_error], [theirs, their_error]) = (mine, theirs);
            let gap = ((theirs - mine).abs() - DEVIATIONS * (my_error.abs() + their_error.abs())).max(0.0);
            let square = gap * gap / (theirs * theirs + RELATIVE_FLOOR);
            sum += if lacks_light([*mine, *my_error], *theirs) {
                square * of_light
            } else if exact(bias) && exact(other_bias) {
                // Noise has either sign.
                square * of_light * (theirs - mine).signum()
            } else {
                0.0
            };
        }
        (sum / (3 * self.blocks.len()) as f64).max(0.0)
    }

    /// Returns the mean squared relative light that this pilot never finds, but another one does.
    pub fn missing_light(&self, other: &Self) -> f64 {
        let of_channel = |([mine, theirs], [my_error, their_error]): ([f64; 2], [f64; 2])| {
            let gap = (theirs - mine - DEVIATIONS * (my_error.abs() + their_error.abs())).max(0.0);
            if misses_light(mine, theirs) { gap * gap / (theirs * theirs + RELATIVE_FLOOR) } else { 0.0 }
        };
        let channels = self.blocks.iter().flatten().zip(other.blocks.iter().flatten());
        let sum: f64 = channels.map(|(a, b)| of_channel(([a[0], b[0]], [a[1], b[1]]))).sum();
        sum / (3 * self.blocks.len()) as f64
    }

    /// Returns an estimate of the mean squared relative difference of the pixels of the expected image from those of an
    /// unbiased pilot, where that does not lack light. `finds_more` means that the unbiased pilot never finds some of
    /// the light. Each half of this pilot may have the random numbers of the same half of the other.
    pub fn squared_bias_of_pixels(&self, exact: &Self, finds_more: bool) -> f64 {
        let of_pixel = |i: usize| {
            let block = block_of(i, self.width);
            let of_channel = |c: usize| {
                let ([mine, _], theirs) = (self.blocks[block][c], exact.blocks[block][c]);
                if lacks_light(theirs, mine) || (finds_more && misses_light(theirs[0], mine)) {
                    return 0.0;
                }
                let ([mine, my_half], [theirs, their_half]) = (self.pixels[i][c], exact.pixels[i][c]);
                let (difference, of_halves, mean) =
                    (mine - theirs, my_half - their_half, (mine + theirs) / 2.0);
                // The product of the differences of either half.
                (difference * difference - of_halves * of_halves) / (mean * mean + RELATIVE_FLOOR)
            };
            (0..3).map(of_channel).sum::<f64>() / 3.0
        };
        let sum: f64 = (0..self.pixels.len()).map(of_pixel).sum();
        (sum / self.pixels.len() as f64).max(0.0)
    }

    /// Returns an estimate of the mean squared relative difference of the expected image from that of an unbiased
    /// pilot, and its standard error; `None` if there are too few blocks for that. The pilots have independent random
    /// numbers. Without a difference, the expected estimate is 0.
    pub fn squared_bias(&self, exact: &Self) -> Option<[f64; 2]> {
        if self.blocks.len() < FEWEST_BLOCKS {
            return None;
        }
        let of_block = |(mine, theirs): (&Means, &Means)| {
            let of_channel = |c: usize| {
                let ([mine, my_error], [theirs, their_error]) = (mine[c], theirs[c]);
                let difference = theirs - mine;
                // The squares of the standard errors are what noise adds to the square of the difference.
                (difference * difference - my_error * my_error - their_error * their_error)
                    / (theirs * theirs + RELATIVE_FLOOR)
            };
            (0..3).map(of_channel).sum::<f64>() / 3.0
        };
        let squares: Vec<f64> = self.blocks.iter().zip(&exact.blocks).map(of_block).collect();
        let n = squares.len() as f64;
        let mean = squares.iter().sum::<f64>() / n;
        let variance = squares.iter().map(|square| (square - mean) * (square - mean)).sum::<f64>();
        Some([mean, (variance / (n * (n - 1.0))).sqrt()])
    }
}

/// Returns the block of the pixel `i` of an image with rows of `width` pixels.
fn block_of(i: usize, width: usize) -> usize {
    (i / width / BLOCK) * width.div_ceil(BLOCK) + i % width / BLOCK
}

/// Returns whether a block with the given mean and difference of halves lacks light that another pilot has found.
fn lacks_light([mean, difference]: [f64; 2], other: f64) -> bool {
    other > LACKS * (mean + difference.abs())
}

/// Returns whether a block with the given mean misses light that is in the mean of another pilot.
fn misses_light(mean: f64, other: f64) -> bool {
    other > MISSES * mean
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::{pcg3d, to_unit};

    fn grey(values: &[[f64; 2]]) -> Blocks {
        let pixels: Vec<Means> = values.iter().map(|&value| [value; 3]).collect();
        Blocks { blocks: pixels.clone(), width: pixels.len(), pixels }
    }

    /// Returns the unknown error of grey blocks, given by means and standard errors of the means.
    fn unknown(own: &[[f64; 2]], bias: Bias, other: &[[f64; 2]], other_bias: Bias) -> f64 {
        grey(own).unknown_error(bias, (&grey(other), other_bias))
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
    fn a_bias_is_no_unknown_error() {
        let (biased, exact) = ([[1.1, 0.0], [0.9, 0.0]], [[1.0, 0.0], [1.0, 0.0]]);
        for bias in [Bias::Vanishing, Bias::Remaining] {
            assert_eq!(unknown(&biased, bias, &exact, Bias::None), 0.0);
            assert_eq!(unknown(&exact, Bias::None, &biased, bias), 0.0);
            assert_eq!(unknown(&biased, bias, &exact, bias), 0.0);
        }
        // One that remains is no witness.
        assert_eq!(unknown(&[[0.0, 0.0]], Bias::None, &[[1.0, 0.0]], Bias::Remaining), 0.0);
        let [many, of_exact] = [biased, exact].map(|blocks| grey(&blocks.repeat(8)));
        assert!((many.squared_bias(&of_exact).expect("a bias")[0] - 0.01 / 1.01).abs() < 1e-9);
        assert_eq!(grey(&biased).squared_bias(&grey(&exact)), None);
    }

    /// Pixels with a bias of either sign, whose means in blocks are right, and noise that both pilots share in part.
    #[test]
    fn a_bias_of_pixels_is_found_below_noise() {
        const SIDE: usize = 64;
        let noise = |stream: u32, i: usize| {
            let [a, b, c] = pcg3d(stream, i as u32, 7).map(|u| f64::from(to_unit(u)));
            a + b + c - 1.5
        };
        let pilot = |stream: u32, bias: f64| {
            let pixel = |i: usize| {
                let half = |half: u32| 0.2 * (noise(half, i) + noise(2 + 2 * stream + half, i));
                let sign = [1.0, -1.0][i % 2];
                [[1.0 + sign * bias + (half(0) + half(1)) / 2.0, (half(0) - half(1)) / 2.0]; 3]
            };
            Blocks::of_pixels((0..SIDE * SIDE).map(pixel).collect(), SIDE)
        };
        let exact = pilot(0, 0.0);
        for (bias, tolerance) in [(0.0, 1.5e-3), (0.1, 2e-3)] {
            let found = pilot(1, bias).squared_bias_of_pixels(&exact, false);
            assert!((found - bias * bias).abs() < tolerance, "{bias}: {found}");
        }
        // Where the unbiased pilot lacks light, nothing is known.
        let dark = Blocks::of_pixels(vec![[[0.0; 2]; 3]; SIDE * SIDE], SIDE);
        assert_eq!(pilot(1, 0.1).squared_bias_of_pixels(&dark, false), 0.0);
    }

    #[test]
    fn light_that_is_never_found_is_beyond_noise_and_blur() {
        let one = |mine: [f64; 2], theirs: [f64; 2]| grey(&[mine]).missing_light(&grey(&[theirs]));
        assert!((one([1.0, 0.0], [2.0, 0.0]) - 1.0 / 4.01).abs() < 1e-9);
        assert_eq!(one([2.0, 0.0], [1.0, 0.0]), 0.0);
        assert_eq!(one([1.0, 0.0], [1.2, 0.0]), 0.0);
        assert_eq!(one([1.0, 0.1], [2.0, -0.4]), 0.0);
        // It is no bias of the pilot that finds it.
        let [dark, bright] = [1.0, 2.0].map(|mean| grey(&[[mean, 0.0]]));
        assert_eq!(bright.squared_bias_of_pixels(&dark, true), 0.0);
        assert!(bright.squared_bias_of_pixels(&dark, false) > 0.4);
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
