//! FLIP: the difference that a viewer sees when two images alternate. [Andersson 2020; Andersson 2021]
//!
//! Both images are blurred by the contrast sensitivity of the eye at a given number of pixels per degree. The
//! difference of the colours is raised where edges or points differ. For images with a high dynamic range (HDR), the
//! largest error at several exposures counts. The errors agree with those of NVIDIA's tool, version 1.7, to 10⁻⁴.

use super::NotComparable;
use crate::image::Image;
use rayon::prelude::*;

/// The range of the values of two images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DynamicRange {
    /// Linear values from 0 to 1, as a display shows them.
    Low,
    /// Linear radiance.
    High,
}

/// Pixels per degree of visual angle: a display of 0.7 m with 3840 pixels, seen from 0.7 m.
const PIXELS_PER_DEGREE: f32 = 0.7 * (3840.0 / 0.7) * (std::f32::consts::PI / 180.0);
/// The exponent of colour differences, and of feature differences. [Andersson 2020]
const COLOR_EXPONENT: f32 = 0.7;
const FEATURE_EXPONENT: f32 = 0.5;
/// The part of the largest colour difference up to which differences use the part [0, `PERCEPTUAL_TO`] of the range.
const PERCEPTUAL_FROM: f32 = 0.4;
const PERCEPTUAL_TO: f32 = 0.95;
/// The width of the feature detector in degrees. [Andersson 2020]
const FEATURE_WIDTH: f32 = 0.082;
/// The sums of Gaussians that are the contrast sensitivity of the achromatic, red-green and blue-yellow channels, as
/// pairs of amplitude and scale in degrees². [Andersson 2020, table 1]
const SENSITIVITIES: [&[[f32; 2]]; 3] = [&[[1.0, 0.0047]], &[[1.0, 0.0053]], &[[34.1, 0.04], [13.5, 0.025]]];
/// The greatest of these scales, which determines the radius of the blur.
const LARGEST_SCALE: f32 = 0.04;
/// The white of the colour spaces, as XYZ: D65.
const WHITE: [f32; 3] = [0.950_428_55, 1.0, 1.088_900_3];
/// The factors from linear sRGB to XYZ.
const TO_XYZ: [[f32; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];
/// The factors from XYZ to linear sRGB.
const FROM_XYZ: [[f32; 3]; 3] = [
    [3.241_003_3, -1.537_398_9, -0.498_615_86],
    [-0.969_224_33, 1.875_930_1, 0.041_554_224],
    [0.055_639_423, -0.204_011_2, 1.057_148_9],
];
/// The tone curve (ax² + bx) / (cx² + dx + e) of images with a high dynamic range: a fit of ACES. [Andersson 2021]
const TONE_CURVE: [f32; 5] = [0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14];
/// The magnitude of a value beyond which the curve is constant. Squares of much larger ones would overflow.
const SATURATED: f32 = 1e6;
/// The tone-mapped value that the brightest pixel has at the first exposure, and the median at the last one.
const BRIGHT: f32 = 0.85;

/// A plane of values, by rows.
type Plane = Vec<f32>;

/// Returns the FLIP error of each pixel, in [0, 1], by rows from the top. The base layers of both images have one or
/// three channels.
///
/// # Errors
/// If the sizes differ, an image has no picture, or one has NaN or infinite values.
pub fn flip(test: &Image, reference: &Image, range: DynamicRange) -> Result<Vec<f32>, NotComparable> {
    let size = [test.width, test.height];
    if size != [reference.width, reference.height] {
        return Err(NotComparable::Size(size, [reference.width, reference.height]));
    }
    let colors = |image: &Image| {
        let channels = image.rgb_channels()?;
        let colors = image.data.chunks_exact(image.channels.len());
        Some(colors.map(|pixel| channels.map(|c| pixel[c])).collect::<Vec<[f32; 3]>>())
    };
    let (Some(a), Some(b)) = (colors(test), colors(reference)) else {
        return Err(NotComparable::Channels(test.channels.clone(), reference.channels.clone()));
    };
    if [&a, &b].into_iter().flatten().flatten().any(|value| !value.is_finite()) {
        return Err(NotComparable::Invalid);
    }
    if range == DynamicRange::Low {
        return Ok(flip_of_display([&a, &b].map(|image| image.iter().map(|c| clamped(*c)).collect()), size));
    }
    let mut largest = vec![0.0; a.len()];
    for exposure in exposures(&b) {
        let shown = |image: &Vec<[f32; 3]>| image.iter().map(|color| tone_mapped(*color, exposure)).collect();
        let errors = flip_of_display([&a, &b].map(shown), size);
        largest
            .iter_mut()
            .zip(errors)
            .for_each(|(largest, error): (&mut f32, f32)| *largest = largest.max(error));
    }
    Ok(largest)
}

/// Returns the mean of FLIP errors.
pub fn mean_flip(errors: &[f32]) -> f64 {
    errors.iter().map(|error| f64::from(*error)).sum::<f64>() / errors.len() as f64
}

fn clamped(color: [f32; 3]) -> [f32; 3] {
    color.map(|c| c.clamp(0.0, 1.0))
}

/// Returns the factors of the exposures at which images are compared. [Andersson 2021]
fn exposures(reference: &[[f32; 3]]) -> Vec<f32> {
    let [a, b, c, d, e] = TONE_CURVE;
    // The value that the curve maps to `BRIGHT`.
    let (square, linear, constant) = (a - BRIGHT * c, b - BRIGHT * d, -BRIGHT * e);
    let half = -0.5 * linear / square;
    let bright = half + (half * half - constant / square).max(0.0).sqrt();
    let mut luminance: Vec<f32> =
        reference.iter().map(|color| TO_XYZ[1].iter().zip(color).map(|(k, c)| k * c).sum()).collect();
    luminance.sort_by(f32::total_cmp);
    let least = 1e-16;
    let median = luminance[luminance.len() / 2].max(least);
    let brightest = luminance[luminance.len() - 1].max(least);
    let (first, last) = ((bright / brightest).log2(), (bright / median).log2());
    let count = (last - first).ceil().max(2.0);
    (0..count as u32).map(|i| (first + (last - first) * i as f32 / (count - 1.0)).exp2()).collect()
}

fn tone_mapped(color: [f32; 3], exposure: f32) -> [f32; 3] {
    let [a, b, c, d, e] = TONE_CURVE;
    clamped(color.map(|value| {
        let x = (value * exposure).clamp(-SATURATED, SATURATED);
        (x * x * a + x * b) / (x * x * c + x * d + e)
    }))
}

/// Returns the FLIP errors of two images of linear values in [0, 1].
fn flip_of_display(images: [Vec<[f32; 3]>; 2], size: [usize; 2]) -> Vec<f32> {
    let opponent = images.map(|image| {
        let opponent: Vec<[f32; 3]> = image.into_par_iter().map(opponent_of_linear).collect();
        [0, 1, 2].map(|c| opponent.iter().map(|color| color[c]).collect::<Plane>())
    });
    let lab = opponent.each_ref().map(|planes| blurred(planes, size));
    let [of_test, of_reference] = opponent.map(|[achromatic, _, _]| features(&achromatic, size));
    let largest = hyab(adjusted([0.0, 1.0, 0.0]), adjusted([0.0, 0.0, 1.0])).powf(COLOR_EXPONENT);
    let error = |i: usize| {
        let difference = hyab(lab[0][i], lab[1][i]).powf(COLOR_EXPONENT);
        let limit = PERCEPTUAL_FROM * largest;
        let color = match difference < limit {
            true => PERCEPTUAL_TO / limit * difference,
            false => PERCEPTUAL_TO + (difference - limit) / (largest - limit) * (1.0 - PERCEPTUAL_TO),
        };
        let ([edge, point], [other_edge, other_point]) = (of_test[i], of_reference[i]);
        let feature = (edge - other_edge).abs().max((point - other_point).abs());
        let feature = (feature * std::f32::consts::FRAC_1_SQRT_2).powf(FEATURE_EXPONENT).clamp(0.0, 1.0);
        color.min(1.0).powf(1.0 - feature)
    };
    (0..size[0] * size[1]).into_par_iter().map(error).collect()
}

fn transformed(matrix: &[[f32; 3]; 3], v: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Converts linear sRGB to the linear opponent space YCxCz.
fn opponent_of_linear(color: [f32; 3]) -> [f32; 3] {
    let xyz = transformed(&TO_XYZ, color);
    let [x, y, z] = [0, 1, 2].map(|c| xyz[c] / WHITE[c]);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// Inverts [`opponent_of_linear`].
fn linear_of_opponent([achromatic, red_green, blue_yellow]: [f32; 3]) -> [f32; 3] {
    let y = (achromatic + 16.0) / 116.0;
    let relative = [y + red_green / 500.0, y, y - blue_yellow / 200.0];
    transformed(&FROM_XYZ, [0, 1, 2].map(|c| relative[c] * WHITE[c]))
}

/// Converts linear sRGB to CIELAB, with colours that count less where it is dark, as Hunt found. [Andersson 2020]
fn adjusted(linear: [f32; 3]) -> [f32; 3] {
    let delta = 6.0f32 / 29.0;
    let xyz = transformed(&TO_XYZ, linear);
    let [x, y, z] = [0, 1, 2].map(|c| {
        let t = xyz[c] / WHITE[c];
        if t > delta.powi(3) { t.cbrt() } else { t / (3.0 * delta * delta) + 4.0 / 29.0 }
    });
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// Returns the distance HyAB of two colours: in lightness plus in the other coordinates. [Andersson 2020]
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// Blurs an image of opponent colours by contrast sensitivity. Returns the adjusted colours that a display can show.
fn blurred(planes: &[Plane; 3], size: [usize; 2]) -> Vec<[f32; 3]> {
    let pi = std::f32::consts::PI;
    let radius = (3.0 * (LARGEST_SCALE / (2.0 * pi * pi)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let blurred = [0, 1, 2].map(|c| {
        // A sum of Gaussians in the plane is a sum of products of their values along the axes.
        let parts = SENSITIVITIES[c].iter().map(|[amplitude, scale]| {
            let along: Vec<f32> = (-radius..=radius)
                .map(|i| (-(pi * i as f32 / PIXELS_PER_DEGREE).powi(2) / scale).exp())
                .collect();
            let sum: f32 = along.iter().sum();
            (amplitude * (pi / scale).sqrt() * sum * sum, along.iter().map(|v| v / sum).collect::<Vec<_>>())
        });
        let parts: Vec<(f32, Vec<f32>)> = parts.collect();
        let total: f32 = parts.iter().map(|(weight, _)| weight).sum();
        let mut plane = vec![0.0; planes[c].len()];
        for (weight, along) in parts {
            let blurred = filtered(&planes[c], size, [&along, &along]);
            plane.iter_mut().zip(blurred).for_each(|(sum, v)| *sum += weight / total * v);
        }
        plane
    });
    let color =
        |i: usize| adjusted(clamped(linear_of_opponent([blurred[0][i], blurred[1][i], blurred[2][i]])));
    (0..planes[0].len()).into_par_iter().map(color).collect()
}

/// Returns the magnitudes of edges and of points in the achromatic channel. [Andersson 2020]
fn features(achromatic: &[f32], size: [usize; 2]) -> Vec<[f32; 2]> {
    let plane: Plane = achromatic.iter().map(|y| (y + 16.0) / 116.0).collect();
    let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
    let radius = (3.0 * deviation).ceil() as i32;
    let along = |f: &dyn Fn(f32) -> f32| -> Vec<f32> { (-radius..=radius).map(|i| f(i as f32)).collect() };
    let gaussian = |x: f32| (-x * x / (2.0 * deviation * deviation)).exp();
    // The positive values of a derivative sum to 1, and the negative ones to −1.
    let balanced = |values: Vec<f32>| -> Vec<f32> {
        let sum = |sign: f32| -> f32 { values.iter().map(|v| (sign * v).max(0.0)).sum() };
        let (above, below) = (sum(1.0), sum(-1.0));
        values.iter().map(|v| if *v > 0.0 { v / above } else { v / below }).collect()
    };
    let blur = along(&gaussian);
    let sum: f32 = blur.iter().sum();
    let blur: Vec<f32> = blur.iter().map(|v| v / sum).collect();
    let edge = balanced(along(&|x| -x * gaussian(x)));
    let point = balanced(along(&|x| (x * x / (deviation * deviation) - 1.0) * gaussian(x)));
    let magnitudes = [edge, point].map(|kernel| {
        let [along_x, along_y] = [[&kernel, &blur], [&blur, &kernel]].map(|k| filtered(&plane, size, k));
        along_x.into_iter().zip(along_y).map(|(x, y): (f32, f32)| x.hypot(y)).collect::<Plane>()
    });
    let [edges, points] = magnitudes;
    edges.into_iter().zip(points).map(|(edge, point)| [edge, point]).collect()
}

/// Returns a plane filtered with kernels along x and y, of odd lengths. Beyond the border, its values continue.
fn filtered(plane: &[f32], [width, height]: [usize; 2], [along_x, along_y]: [&Vec<f32>; 2]) -> Plane {
    let filter =
        |from: &[f32], to: &mut [f32], kernel: &[f32], n: usize, at: &(dyn Fn(usize) -> usize + Sync)| {
            let radius = kernel.len() / 2;
            for (i, to) in to.iter_mut().enumerate().take(n) {
                *to = kernel
                    .iter()
                    .enumerate()
                    .map(|(k, weight)| weight * from[at((i + k).saturating_sub(radius).min(n - 1))])
                    .sum();
            }
        };
    let mut rows = vec![0.0; plane.len()];
    rows.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(to, from)| {
        filter(from, to, along_x, width, &|i| i);
    });
    let mut result = vec![0.0; plane.len()];
    let radius = along_y.len() / 2;
    result.par_chunks_mut(width).enumerate().for_each(|(y, to)| {
        for (k, weight) in along_y.iter().enumerate() {
            let row = (y + k).saturating_sub(radius).min(height - 1);
            to.iter_mut().zip(&rows[row * width..]).for_each(|(to, from)| *to += weight * from);
        }
    });
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [usize; 2] = [64, 48];

    /// A picture with waves and an edge, of values `exp(s·v + o)` if `[s, o]` are given, and one beside it.
    fn pair(scale: Option<[f32; 2]>, noise: f32) -> [Image; 2] {
        let [width, height] = SIZE;
        let mut pair = [(); 2].map(|()| Image::new(width, height, &["R", "G", "B"]));
        for y in 0..height {
            for x in 0..width {
                let (u, v) = (x as f32, y as f32);
                let step = if x >= 40 { 0.8 } else { 0.1 };
                let base =
                    [0.5 + 0.4 * (u / 7.0).sin() * (v / 5.0).cos(), 0.5 + 0.3 * ((u + v) / 9.0).sin(), step];
                for (c, base) in base.into_iter().enumerate() {
                    let angle = 12.9898 * x as f64 + 78.233 * y as f64 + c as f64;
                    let noise = noise * angle.sin() as f32;
                    for (image, noise) in pair.iter_mut().zip([noise, 0.0]) {
                        image.data[3 * (y * width + x) + c] = match scale {
                            None => (base + noise).clamp(0.0, 1.0),
                            Some([s, o]) => (s * base + o + noise).exp(),
                        };
                    }
                }
            }
        }
        pair
    }

    /// Mean, maximum and one pixel are those of NVIDIA's tool (flip-evaluator 1.7) for the same images: one pair for
    /// displays, and two of radiance, with two and three exposures.
    #[test]
    fn the_errors_are_those_of_nvidias_tool() {
        let range_of = |scale: Option<[f32; 2]>| scale.map_or(DynamicRange::Low, |_| DynamicRange::High);
        for (scale, noise, expected) in [
            (None, 0.15, [0.068309, 0.399344, 0.068213]),
            (Some([3.0, -2.0]), 0.3, [0.051691, 0.255587, 0.054094]),
            (Some([8.0, -4.0]), 0.5, [0.104361, 0.454075, 0.145847]),
        ] {
            let [test, reference] = pair(scale, noise);
            let errors = flip(&test, &reference, range_of(scale)).expect("images of one size");
            let mean = errors.iter().sum::<f32>() / errors.len() as f32;
            let largest = errors.iter().copied().fold(0.0, f32::max);
            let found = [mean, largest, errors[20 * SIZE[0] + 10]];
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-4, "{scale:?}: {found} {expected}");
            }
            assert!(
                flip(&reference, &reference, range_of(scale)).expect("one size").iter().all(|e| *e == 0.0)
            );
        }
    }

    #[test]
    fn black_single_pixels_and_other_sizes() {
        let black = Image::new(1, 1, &["R", "G", "B"]);
        let white = Image { data: vec![1.0; 3], ..black.clone() };
        for range in [DynamicRange::Low, DynamicRange::High] {
            assert_eq!(flip(&black, &black, range).expect("one size"), [0.0]);
            let error = flip(&white, &black, range).expect("one size")[0];
            assert!((0.9..=1.0).contains(&error), "{error}");
        }
        for bright in [5000.0, 1e25] {
            let bright = Image { data: vec![bright; 3], ..black.clone() };
            assert!(flip(&bright, &black, DynamicRange::High).expect("one size")[0] > 0.9);
            assert!(flip(&black, &bright, DynamicRange::High).expect("one size")[0] > 0.5);
        }
        for invalid in [f32::NAN, f32::INFINITY] {
            let invalid = Image { data: vec![invalid; 3], ..black.clone() };
            assert_eq!(flip(&black, &invalid, DynamicRange::High), Err(NotComparable::Invalid));
        }
        let wide = Image::new(2, 1, &["R", "G", "B"]);
        assert!(matches!(flip(&black, &wide, DynamicRange::Low), Err(NotComparable::Size(..))));
        let normals = Image::new(1, 1, &["N.X", "N.Y"]);
        assert!(matches!(flip(&normals, &normals, DynamicRange::Low), Err(NotComparable::Channels(..))));
    }
}
