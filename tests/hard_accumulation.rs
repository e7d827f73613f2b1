//! Hard cases of sums: very many samples, very different values in one pixel, and values out of the range of a file.

use crate::support::cli::Folder;
use buffon::film::{PixelRect, Tile};
use buffon::image::{Backend, Image, SampleFormat, WriteOptions, read, read_with, write_with};

const MANY: usize = 1 << 24;

fn pixel() -> Tile {
    Tile::new(PixelRect { x: 0, y: 0, width: 1, height: 1 }, 3, 2)
}

/// Returns a pixel with `samples` values, in alternating halves.
fn filled(samples: usize, value: impl Fn(usize) -> [f32; 3]) -> Tile {
    let mut tile = pixel();
    for i in 0..samples {
        tile.add(0, i & 1, &value(i));
    }
    tile
}

/// A sum in `f32` would stop growing at 2^24, and a sum of 1/3 would lose digits long before.
#[test]
fn the_mean_of_16_million_samples_is_exact() {
    let value = [1.0f32, 1.0 / 3.0, 1e-30];
    let naive = (0..MANY + 4).fold([0.0f32; 2], |sum, _| [sum[0] + value[0], sum[1] + value[1]]);
    assert!(naive[0] == MANY as f32 && (naive[1] / MANY as f32 - value[1]).abs() > 1e-3, "{naive:?}");
    let tile = filled(MANY + 4, |_| value);
    for (c, value) in value.into_iter().enumerate() {
        let estimate = tile.estimate(0, c);
        assert_eq!(estimate.mean as f32, value);
        let exact = f64::from(value);
        assert!((estimate.mean / exact - 1.0).abs() < 1e-12, "{}", estimate.mean);
        assert!(estimate.variance.expect("two halves") <= (1e-12 * exact).powi(2), "{estimate:?}");
    }
    assert_eq!(tile.count(0), MANY as u64 + 4);
}

/// A firefly of 10⁹ among samples of 1, a 1 among fireflies, and 10⁻⁹ with a firefly: at any position in the sequence
/// the mean is exact.
#[test]
fn a_dynamic_range_of_a_billion_loses_nothing() {
    const N: usize = 1 << 20;
    let n = N as f64;
    for firefly in [0, 1, N / 2, N - 1] {
        let tile = filled(N, |i| match i == firefly {
            true => [1e9, 1.0, 1e9],
            false => [1.0, 1e9, 1e-9],
        });
        let exact =
            [(1e9 + n - 1.0) / n, (1.0 + 1e9 * (n - 1.0)) / n, (1e9 + f64::from(1e-9f32) * (n - 1.0)) / n];
        for (c, exact) in exact.into_iter().enumerate() {
            let estimate = tile.estimate(0, c);
            assert_eq!(estimate.mean as f32, exact as f32, "channel {c}, at {firefly}");
            assert!((estimate.mean / exact - 1.0).abs() < 1e-12, "channel {c}: {} {exact}", estimate.mean);
            // One half contains the whole firefly.
            let wanted = (1e9 - 1.0) / n;
            let [_, difference] = tile.halves(0, c);
            assert!(
                (difference.abs() / wanted - 1.0).abs() < 1e-6,
                "channel {c}: {difference}, not {wanted}"
            );
            assert!((estimate.variance.expect("two halves") / (wanted * wanted) - 1.0).abs() < 1e-5);
        }
        assert!(tile.error_sums().estimate(2).expect("a pixel").relmse.is_finite());
    }
}

/// Large values that cancel each other, as with negative filter lobes, leave the exact remainder.
#[test]
fn what_cancels_out_leaves_the_rest() {
    const N: usize = 3 << 20;
    let tile = filled(N, |i| match i / 2 % 3 {
        0 => [1e9, f32::MAX, 3e38],
        1 => [-1e9, -f32::MAX, 1.0],
        _ => [3.0, 3.0, -3e38],
    });
    assert_eq!(tile.estimate(0, 0).mean, 1.0);
    // Beside the largest `f32`, `f64` cannot represent 1, but nothing overflows.
    for c in 1..3 {
        let mean = tile.estimate(0, c).mean;
        assert!(mean.is_finite() && mean.abs() < 1e-6 * f64::from(f32::MAX), "{mean}");
    }
}

/// Radiance of 10⁹ in a file of halves is clamped, counted and reported; a file of floats keeps it.
#[test]
fn values_beyond_a_half_are_clamped_and_counted() {
    let scene = |format: &str, radiance: f32| {
        format!(
            r#"<scene version="3.0.0"><integrator type="path"/>
            <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="4"/>
            <integer name="height" value="3"/><rfilter type="box"/>
            <string name="component_format" value="{format}"/></film></sensor>
            <emitter type="constant"><rgb name="radiance" value="{radiance}"/></emitter></scene>"#
        )
    };
    let sentence = "36 values clamped to the range of half floats; component_format float32 keeps them";
    let values = |folder: &Folder| read(&folder.path("a.exr")).expect("an image").data;
    let folder = Folder::with(&scene("float16", 1e9));
    let run = folder.run("render s.xml --spp 4 -o a.exr");
    assert!(run.code == 0 && run.stderr.contains(sentence), "{run:?}");
    assert_eq!(values(&folder), [65504.0; 36]);
    let run = folder.run("render s.xml --spp 4 -o a.exr --strict -q");
    assert!(run.code == 5 && run.stderr.contains(sentence), "{run:?}");
    let folder = Folder::with(&scene("float32", 1e9));
    folder.render("s.xml --spp 4 -q -o a.exr --strict");
    assert_eq!(values(&folder), [1e9; 36]);
    let folder = Folder::with(&scene("float16", 65504.0));
    folder.render("s.xml --spp 4 -q -o a.exr --strict");
    assert_eq!(values(&folder), [65504.0; 36]);
}

/// No library turns a value between the largest half and the largest float into infinity.
#[test]
fn no_finite_value_becomes_infinite_in_a_file_of_halves() {
    let folder = Folder::new();
    let path = folder.path("half.exr");
    let mut image = Image::new(8, 1, &["Y"]);
    let values = [65503.9, 65504.0, 65504.004, 65519.996, 65520.0, 1e9, f32::MAX, 6e-8];
    let backends = [Backend::default(), Backend::RustCrates];
    for backend in backends {
        for sign in [1.0, -1.0] {
            image.data = values.map(|v: f32| v * sign).to_vec();
            let options = WriteOptions { samples: SampleFormat::Half, ..WriteOptions::default() };
            let report = write_with(backend, &path, &image, &options).expect("written");
            assert_eq!(report.clamped_half, 5, "{backend}");
            let found = read_with(backend, &path).expect("an image").data;
            assert_eq!(found[..7], [65504.0 * sign; 7], "{backend}");
            assert!((found[7] / (6e-8 * sign) - 1.0).abs() < 0.01, "{backend}: {}", found[7]);
        }
    }
}
