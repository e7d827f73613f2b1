//! Samplers as point sets: strata at natural sample counts, uniformity, independence, convergence, and the spectrum of
//! the error.

use buffon::sampling::{Dimension, SampleKey, Sampler, SamplerKind};

const PAIR: Dimension = Dimension::emitter_point(1);
const NUMBER: Dimension = Dimension::roulette(2);

fn pairs(sampler: Sampler, dimension: Dimension, keys: &[SampleKey]) -> Vec<[f32; 2]> {
    let (mut x, mut y) = (vec![0.0; keys.len()], vec![0.0; keys.len()]);
    sampler.fill_2d(dimension, keys, &mut x, &mut y);
    x.into_iter().zip(y).map(|(x, y)| [x, y]).collect()
}

fn numbers(sampler: Sampler, dimension: Dimension, keys: &[SampleKey]) -> Vec<f32> {
    let mut out = vec![0.0; keys.len()];
    sampler.fill_1d(dimension, keys, &mut out);
    out
}

/// Returns the first `n` points of a half of pixel (x, y).
fn half(sampler: Sampler, seed: u64, (x, y): (u32, u32), half: u64, n: u64) -> Vec<SampleKey> {
    (0..n).map(|i| sampler.key(seed, x, y, 2 * i + half)).collect()
}

/// Returns the interval, of n, that contains a number. The number may be a rounding below an end that is no `f32`.
fn interval(u: f32, n: usize) -> usize {
    (f64::from(u) * (1.0 + 0.375 * f64::from(f32::EPSILON)) * n as f64) as usize
}

/// Returns the number of points in each box of a regular partition.
fn counts(points: &[[f32; 2]], columns: usize, rows: usize) -> Vec<usize> {
    let mut counts = vec![0; columns * rows];
    for [x, y] in points {
        counts[interval(*y, rows) * columns + interval(*x, columns)] += 1;
    }
    counts
}

/// Checks that every elementary interval of area 2^−m contains one of 2^m points.
fn assert_net(points: &[[f32; 2]], what: &str) {
    let m = points.len().ilog2();
    assert_eq!(points.len(), 1 << m);
    for k in 0..=m {
        let counts = counts(points, 1 << k, 1 << (m - k));
        assert!(counts.iter().all(|&c| c == 1), "{what}: 2^{m} points, {k} bits along x");
    }
}

/// Checks that every one of n intervals contains one of n numbers.
fn assert_strata(numbers: impl Iterator<Item = f32>, n: usize, what: &str) {
    let mut cells: Vec<_> = numbers.map(|u| interval(u, n)).collect();
    cells.sort_unstable();
    assert!(cells.into_iter().eq(0..n), "{what}: {n} intervals");
}

#[test]
fn sobol_points_are_nets_in_every_block_of_a_power_of_two() {
    for kind in [SamplerKind::Sobol, SamplerKind::Fixed, SamplerKind::Zsobol] {
        for (m, seed) in [(0, 1), (1, 2), (3, 3), (6, 1 << 40), (9, 4)] {
            let n = 1usize << m;
            let sampler = Sampler::new(kind, Some(2 * n as u64));
            let keys = half(sampler, seed, (3, 5), 1, 3 * n as u64);
            for dimension in [PAIR, Dimension::PIXEL, Dimension::bsdf_direction(400).repeat(300)] {
                let points = pairs(sampler, dimension, &keys);
                points.chunks(n).for_each(|block| assert_net(block, &format!("{kind}, {dimension}")));
            }
            for block in numbers(sampler, NUMBER, &keys).chunks(n) {
                assert_strata(block.iter().copied(), n, kind.name());
            }
        }
    }
}

/// All pixels of an aligned square form one net for any power of two of samples, also after the end of the sequence.
#[test]
fn zsobol_squares_of_pixels_are_nets() {
    for (m, log2_side) in [(0, 3), (1, 2), (2, 2), (5, 1)] {
        let n = 1u64 << m;
        let sampler = Sampler::new(SamplerKind::Zsobol, Some(2 * n));
        let side = 1u32 << log2_side;
        for (x0, y0) in [(0, 0), (5 * side, 1023 * side), (u32::MAX - side + 1, 0)] {
            for block in [0, 3, 1 << 50] {
                let pixels = (0..side * side).map(|i| (x0 + i % side, y0 + i / side));
                let keys: Vec<_> = pixels
                    .flat_map(|(x, y)| (0..n).map(move |i| sampler.key(7, x, y, 2 * (block * n + i))))
                    .collect();
                assert_net(
                    &pairs(sampler, PAIR, &keys),
                    &format!("{side} x {side} from {x0}, {y0}, block {block}"),
                );
            }
        }
    }
}

#[test]
fn strata_hold_one_point_of_every_block() {
    for kind in [SamplerKind::Stratified, SamplerKind::Multijitter] {
        for (n, columns, rows) in
            [(1, 1, 1), (2, 2, 1), (6, 3, 2), (32, 8, 4), (36, 6, 6), (50, 10, 5), (128, 16, 8)]
        {
            let sampler = Sampler::new(kind, Some(2 * n as u64));
            let keys = half(sampler, 1 << 33, (3, 5), 0, 4 * n as u64);
            for block in pairs(sampler, PAIR, &keys).chunks(n) {
                assert!(counts(block, columns, rows).iter().all(|&c| c == 1), "{kind}: {columns} x {rows}");
                if kind == SamplerKind::Multijitter {
                    for axis in 0..2 {
                        assert_strata(block.iter().map(|p| p[axis]), n, &format!("{kind}, axis {axis}"));
                    }
                }
            }
            let numbers = numbers(sampler, NUMBER, &keys);
            for block in numbers.chunks(n) {
                assert_strata(block.iter().copied(), n, kind.name());
            }
            assert_ne!(numbers[..n], numbers[n..2 * n], "{kind}: a new block is a new one");
        }
    }
}

/// Boxes of 1/2^a by 1/3^b, with a and b up to k, contain equally many of 6^k points. The sequence restarts after 6^6.
#[test]
fn halton_points_are_shared_evenly_by_boxes() {
    let sampler = Sampler::new(SamplerKind::Halton, None);
    let keys = half(sampler, 5, (3, 5), 1, 3 * 216);
    for dimension in [PAIR, Dimension::LENS] {
        let points = pairs(sampler, dimension, &keys);
        for k in 0..=3 {
            for block in points.chunks(6usize.pow(k)) {
                for (a, b) in (0..=k).flat_map(|a| (0..=k).map(move |b| (a, b))) {
                    let (columns, rows) = (2usize.pow(a), 3usize.pow(b));
                    let each = block.len() / (columns * rows);
                    assert!(
                        counts(block, columns, rows).iter().all(|&c| c == each),
                        "6^{k}: {columns} x {rows}"
                    );
                }
            }
        }
    }
    let late: Vec<_> = (0..36).map(|i| sampler.key(5, 3, 5, 2 * (46_656 + i) + 1)).collect();
    let late = pairs(sampler, PAIR, &late);
    assert!(counts(&late, 4, 9).iter().all(|&c| c == 1));
    assert_ne!(late, pairs(sampler, PAIR, &keys[..36]));
    let all = half(sampler, 5, (0, 0), 0, 46_656);
    assert!(counts(&pairs(sampler, PAIR, &all), 64, 729).iter().all(|&c| c == 1));
}

/// Returns the pair and the number of one sample for each of many seeds. They are independent of each other.
fn over_seeds(kind: SamplerKind, n: u64, pixel: (u32, u32), sample: u64) -> (Vec<[f32; 2]>, Vec<f32>) {
    let sampler = Sampler::new(kind, Some(24));
    let keys: Vec<_> = (0..n).map(|s| sampler.key(s << 20, pixel.0, pixel.1, sample)).collect();
    (pairs(sampler, PAIR, &keys), numbers(sampler, NUMBER, &keys))
}

/// Returns the deviation of the chi² statistic of equally likely cells in standard deviations.
fn chi2_excess(counts: &[usize]) -> f64 {
    let expected = counts.iter().sum::<usize>() as f64 / counts.len() as f64;
    let chi2: f64 = counts.iter().map(|&c| (c as f64 - expected).powi(2) / expected).sum();
    let freedom = counts.len() as f64 - 1.0;
    (chi2 - freedom) / (2.0 * freedom).sqrt()
}

/// All seeds are fixed, so the result is always the same. A correct sampler deviates by more than five standard
/// deviations (of a chi² with 255 degrees of freedom) with a probability below 10^−5 in one test, and below 10^−3 in
/// any of about a hundred tests.
const SIGMAS: f64 = 5.0;

#[test]
fn any_point_is_uniform_over_seeds() {
    for kind in SamplerKind::ALL {
        for sample in [0, 1, 6, 24, 1001] {
            let (points, numbers) = over_seeds(kind, 40_960, (13, 6), sample);
            let excess = chi2_excess(&counts(&points, 16, 16));
            assert!(excess.abs() < SIGMAS, "{kind}: pair of sample {sample}: {excess}");
            let numbers: Vec<_> = numbers.into_iter().map(|u| [u, 0.0]).collect();
            let excess = chi2_excess(&counts(&numbers, 256, 1));
            assert!(excess.abs() < SIGMAS, "{kind}: number of sample {sample}: {excess}");
        }
    }
}

/// Halves, dimensions and axes are independent of each other, and pixels too except for `zsobol` and `fixed`.
#[test]
fn halves_dimensions_and_pixels_are_independent_over_seeds() {
    for kind in SamplerKind::ALL {
        let n = 40_960;
        let (a, number) = over_seeds(kind, n, (13, 6), 10);
        let (b, _) = over_seeds(kind, n, (13, 6), 11);
        let (other, _) = over_seeds(kind, n, (14, 6), 10);
        let sampler = Sampler::new(kind, Some(24));
        let keys: Vec<_> = (0..n).map(|s| sampler.key(s << 20, 13, 6, 10)).collect();
        let c = pairs(sampler, Dimension::bsdf_direction(1), &keys);
        let repeated = pairs(sampler, PAIR.repeat(1), &keys);
        let mut joint = vec![("axes", a.clone())];
        let against =
            |q: &[[f32; 2]], i: usize, j: usize| a.iter().zip(q).map(|(p, q)| [p[i], q[j]]).collect();
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            joint.push(("halves", against(&b, i, j)));
            joint.push(("dimensions", against(&c, i, j)));
            joint.push(("repetitions", against(&repeated, i, j)));
            if !matches!(kind, SamplerKind::Zsobol | SamplerKind::Fixed) {
                joint.push(("pixels", against(&other, i, j)));
            }
        }
        joint.push(("number", a.iter().zip(number).map(|(p, u)| [p[0], u]).collect()));
        for (what, points) in joint {
            let excess = chi2_excess(&counts(&points, 16, 16));
            assert!(excess.abs() < SIGMAS, "{kind}: {what}: {excess}");
        }
    }
}

/// The points of one half are independent of those of the other half and of another dimension. The test is the
/// correlation of estimates over seeds.
#[test]
fn estimates_of_halves_are_uncorrelated() {
    for kind in SamplerKind::ALL {
        let n = 24;
        let sampler = Sampler::new(kind, Some(2 * n));
        let estimate = |seed: u64, which: u64, dimension: Dimension| {
            let points = pairs(sampler, dimension, &half(sampler, seed, (3, 5), which, n));
            points.iter().map(|[x, y]| f64::from(x * y)).sum::<f64>() / n as f64 - 0.25
        };
        let runs = 4000;
        let sums = (0..runs).fold([0.0; 5], |sums: [f64; 5], seed| {
            let (a, b) = (estimate(seed, 0, PAIR), estimate(seed, 1, PAIR));
            let c = estimate(seed, 0, Dimension::LENS);
            [sums[0] + a * a, sums[1] + b * b, sums[2] + c * c, sums[3] + a * b, sums[4] + a * c]
        });
        for (what, correlation) in [
            ("halves", sums[3] / (sums[0] * sums[1]).sqrt()),
            ("dimensions", sums[4] / (sums[0] * sums[2]).sqrt()),
        ] {
            assert!(
                correlation.abs() * f64::from(runs as u32).sqrt() < SIGMAS,
                "{kind}: {what}: {correlation}"
            );
        }
    }
}

#[test]
fn a_number_does_not_depend_on_its_wave() {
    for kind in SamplerKind::ALL {
        let sampler = Sampler::new(kind, Some(50));
        let keys: Vec<_> =
            (0..300u32).map(|i| sampler.key(9, i * 7 % 64, i % 5, u64::from(i * i % 211))).collect();
        let (whole_pairs, whole_numbers) = (pairs(sampler, PAIR, &keys), numbers(sampler, NUMBER, &keys));
        for length in [1, 3, 16, 17, 299] {
            let parts: Vec<_> = keys.chunks(length).flat_map(|keys| pairs(sampler, PAIR, keys)).collect();
            assert_eq!(parts, whole_pairs, "{kind}, {length} at a time");
            let parts: Vec<_> = keys.chunks(length).flat_map(|keys| numbers(sampler, NUMBER, keys)).collect();
            assert_eq!(parts, whole_numbers, "{kind}, {length} at a time");
        }
    }
}

/// Seeds and sample numbers of more than 32 bits, and the last possible pixels and samples.
#[test]
fn nothing_is_too_large_and_nothing_repeats() {
    let large = [1 << 17, (1 << 32) - 1, 1 << 33, (1 << 33) + 2, 1 << 50, u64::MAX - 1, u64::MAX];
    for kind in SamplerKind::ALL {
        for spp in [None, Some(1), Some(7), Some(4096), Some(u64::MAX)] {
            let sampler = Sampler::new(kind, spp);
            assert_eq!(sampler.kind(), kind);
            let near = sampler.key(3, 9, 9, 0);
            let mut keys = vec![near, sampler.key(3 + (1 << 32), 9, 9, 0), sampler.key(4, 9, 9, 0)];
            keys.extend(large.map(|sample| sampler.key(3, 9, 9, sample)));
            if kind != SamplerKind::Fixed {
                keys.extend(
                    [(u32::MAX, u32::MAX), (u32::MAX, 0), (9, u32::MAX)]
                        .map(|(x, y)| sampler.key(3, x, y, 0)),
                );
            }
            let points = pairs(sampler, PAIR, &keys);
            assert!(points.iter().flatten().all(|u| (0.0..1.0).contains(u)), "{kind} {spp:?}: {points:?}");
            for (i, p) in points.iter().enumerate() {
                assert!(points[..i].iter().all(|q| q != p), "{kind} {spp:?}: {:?}", keys[i]);
            }
        }
    }
}

/// Evaluates a smooth function on the unit square with the integral 1.
fn smooth([x, y]: [f32; 2]) -> f64 {
    let (x, y) = (f64::from(x), f64::from(y));
    (x + y * y).exp() / ((1f64.exp() - 1.0) * 1.462_651_745_907_181_6)
}

/// Returns the variance of the mean of n points of a half, over seeds.
fn variance(kind: SamplerKind, n: u64, runs: u64) -> f64 {
    let sampler = Sampler::new(kind, Some(2 * n));
    let squares = (0..runs).map(|seed| {
        let points = pairs(sampler, PAIR, &half(sampler, seed, (3, 5), 0, n));
        (points.into_iter().map(smooth).sum::<f64>() / n as f64 - 1.0).powi(2)
    });
    squares.sum::<f64>() / runs as f64
}

/// The slope of log variance against log n, fitted to natural sample counts from 4 to 256.
#[test]
fn variance_falls_with_the_slope_of_the_sampler() {
    for (kind, least, most) in [
        (SamplerKind::Independent, -1.1, -0.9),
        (SamplerKind::Stratified, -2.2, -1.8),
        (SamplerKind::Multijitter, -2.1, -1.6),
        (SamplerKind::Halton, -3.3, -2.3),
        (SamplerKind::Sobol, -3.3, -2.5),
        (SamplerKind::Zsobol, -3.3, -2.5),
        (SamplerKind::Fixed, -3.3, -2.5),
    ] {
        let counts: &[u64] = if kind == SamplerKind::Halton { &[6, 36, 216] } else { &[4, 16, 64, 256] };
        let logs: Vec<_> = counts.iter().map(|&n| ((n as f64).ln(), variance(kind, n, 400).ln())).collect();
        let mean = |f: &dyn Fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / logs.len() as f64;
        let (x, y) = (mean(&|l| l.0), mean(&|l| l.1));
        let slope = mean(&|l| (l.0 - x) * (l.1 - y)) / mean(&|l| (l.0 - x).powi(2));
        println!("{kind}: variance falls as n^{slope:.2}");
        assert!((least..most).contains(&slope), "{kind}: n^{slope:.2}");
    }
}

const SIDE: usize = 64;

/// Returns the error of every pixel of a square image, with both halves, if every pixel integrates the same function.
fn error_image(kind: SamplerKind, spp: u64, seed: u64) -> Vec<f64> {
    let sampler = Sampler::new(kind, Some(spp));
    let pixels = (0..SIDE * SIDE).map(|i| ((i % SIDE) as u32 + 37, (i / SIDE) as u32 + 11));
    let keys: Vec<_> = pixels.flat_map(|(x, y)| (0..spp).map(move |s| sampler.key(seed, x, y, s))).collect();
    let points = pairs(sampler, PAIR, &keys);
    points
        .chunks(spp as usize)
        .map(|points| points.iter().map(|p| smooth(*p)).sum::<f64>() / spp as f64 - 1.0)
        .collect()
}

/// Returns the fraction of an image's energy in frequencies up to a quarter of the largest, relative to that of white
/// noise.
fn low_frequencies(image: &[f64]) -> f64 {
    let total: f64 = image.iter().map(|v| v * v).sum::<f64>() * (SIDE * SIDE) as f64;
    let quarter = SIDE as i32 / 8;
    let (mut energy, mut count) = (0.0, 0u32);
    for ky in -quarter..=quarter {
        let turn = |k: i32, i: usize| 2.0 * std::f64::consts::PI * f64::from(k) * i as f64 / SIDE as f64;
        // Sums over y for each column.
        let columns: Vec<(f64, f64)> = (0..SIDE)
            .map(|x| {
                (0..SIDE).fold((0.0, 0.0), |(re, im), y| {
                    let (sin, cos) = turn(ky, y).sin_cos();
                    (re + image[y * SIDE + x] * cos, im - image[y * SIDE + x] * sin)
                })
            })
            .collect();
        for kx in -quarter..=quarter {
            let (re, im) = columns.iter().enumerate().fold((0.0, 0.0), |(re, im), (x, (a, b))| {
                let (sin, cos) = turn(kx, x).sin_cos();
                (re + a * cos + b * sin, im + b * cos - a * sin)
            });
            energy += re * re + im * im;
            count += 1;
        }
    }
    energy / total * f64::from((SIDE * SIDE) as u32) / f64::from(count)
}

/// Returns the RMS of the means of all squares of 4×4 pixels, relative to independent errors of the same size.
fn after_blur(image: &[f64]) -> f64 {
    let rms = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
    let blurred: Vec<f64> = (0..(SIDE - 3) * (SIDE - 3))
        .map(|i| {
            let (x, y) = (i % (SIDE - 3), i / (SIDE - 3));
            (0..16).map(|k| image[(y + k / 4) * SIDE + x + k % 4]).sum::<f64>() / 16.0
        })
        .collect();
    4.0 * rms(&blurred) / rms(image)
}

/// The error of `zsobol` is blue noise: it is as large as that of `sobol`, but mostly at high frequencies.
#[test]
fn zsobol_spreads_its_error_as_blue_noise() {
    let rms = |image: &[f64]| (image.iter().map(|v| v * v).sum::<f64>() / image.len() as f64).sqrt();
    for spp in [2, 8, 32] {
        let (white, blue) =
            (error_image(SamplerKind::Sobol, spp, 1), error_image(SamplerKind::Zsobol, spp, 1));
        let (low, blurred) = (low_frequencies(&blue), after_blur(&blue));
        println!(
            "{spp} spp: low frequencies {:.3} sobol, {low:.3} zsobol; after a blur {:.3}, {blurred:.3}; RMS {:.2e}, {:.2e}",
            low_frequencies(&white),
            after_blur(&white),
            rms(&white),
            rms(&blue)
        );
        assert!((0.8..1.2).contains(&low_frequencies(&white)) && (0.85..1.15).contains(&after_blur(&white)));
        assert!(low < 0.35 && blurred < 0.7, "{spp} spp: {low}, {blurred}");
        assert!((0.8..1.25).contains(&(rms(&blue) / rms(&white))), "{spp} spp");
    }
}

/// The error of `fixed` is the same in all pixels with the same integrand.
#[test]
fn fixed_errs_alike_in_every_pixel() {
    let image = error_image(SamplerKind::Fixed, 8, 1);
    assert!(image.iter().all(|v| *v == image[0]) && image[0] != 0.0);
    assert_ne!(image[0], error_image(SamplerKind::Fixed, 8, 2)[0]);
}
