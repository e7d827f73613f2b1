//! `buffon diff`: results and exit codes.

use std::path::{Path, PathBuf};

use buffon::cli::diff::{DiffArgs, Outcome, outcome};
use buffon::compare::{ErrorKind, compare, error_map, invalid};
use buffon::error::Kind;
use buffon::image::{Image, WriteOptions, read, write};
use clap::Parser;

/// The arguments of the command line.
#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: DiffArgs,
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Folder(tempfile::tempdir().expect("a folder for temporary files"))
    }

    fn save(&self, name: &str, image: &Image) -> PathBuf {
        let path = self.0.path().join(name);
        write(&path, image, &WriteOptions::default()).unwrap();
        path
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

/// Returns the exit code of `buffon diff A B MORE...`.
fn diff(a: &Path, b: &Path, more: &[&str]) -> u8 {
    said(a, b, more).exit_code
}

/// Returns the outcome of `buffon diff A B MORE...`.
fn said(a: &Path, b: &Path, more: &[&str]) -> Outcome {
    let words = [Path::new("diff"), a, b].map(|p| p.as_os_str().to_owned());
    let line = Line::try_parse_from(words.into_iter().chain(more.iter().map(|w| w.into()))).unwrap();
    outcome(&line.args).unwrap()
}

fn flat(value: f32, channels: &[&str]) -> Image {
    let mut image = Image::new(20, 10, channels);
    image.data.fill(value);
    image
}

const RGB: [&str; 3] = ["R", "G", "B"];

#[test]
fn equal_images_are_the_same_by_every_metric_and_others_are_not() {
    let dir = Folder::new();
    let a = dir.save("a.exr", &flat(0.5, &RGB));
    let b = dir.save("b.exr", &flat(0.51, &RGB));
    let black = dir.save("black.exr", &flat(0.0, &RGB));
    for metric in ["mean", "mse", "rmse", "psnr", "relmse", "trimmed", "max", "ratio", "flip"] {
        assert_eq!(diff(&a, &a, &["--metric", metric]), 0, "{metric}");
        assert_eq!(diff(&black, &black, &["--metric", metric]), 0, "{metric}");
        assert_eq!(diff(&b, &a, &["--metric", metric]), 1, "{metric}");
    }
}

#[test]
fn thresholds_decide() {
    let dir = Folder::new();
    let a = dir.save("a.exr", &flat(0.51, &RGB));
    let r = dir.save("r.exr", &flat(0.5, &RGB));
    // relMSE 1e-4 / 0.26 = 3.846e-4, MSE 1e-4, PSNR 40 dB, ratio 1.02.
    for (metric, passes, fails) in [
        ("relmse", "3.85e-4", "3.84e-4"),
        ("mse", "1.001e-4", "0.999e-4"),
        ("psnr", "39.99", "40.01"),
        ("ratio", "0.0201", "0.0199"),
        ("max", "0.0101", "0.0099"),
    ] {
        assert_eq!(diff(&a, &r, &["--metric", metric, "--fail", passes]), 0, "{metric}");
        assert_eq!(diff(&a, &r, &["--metric", metric, "--fail", fails, "--json"]), 1, "{metric}");
    }
}

/// FLIP is that of the picture, at several exposures unless both files are for displays, and has a map.
#[test]
fn flip_is_what_is_seen() {
    let dir = Folder::new();
    let layers = ["R", "G", "B", "albedo.R", "albedo.G", "albedo.B"];
    let (mut image, reference) = (flat(0.5, &layers), flat(0.5, &layers));
    image.pixel_mut(4, 3)[3] = 9.0;
    let r = dir.save("r.exr", &reference);
    assert_eq!(diff(&dir.save("albedo.exr", &image), &r, &["--metric", "flip"]), 0);
    image.pixel_mut(4, 3)[..3].fill(1.0);
    let (a, map) = (dir.save("a.exr", &image), dir.path("map.exr"));
    let value = |a: &Path, r: &Path, more: &[&str]| {
        let found = said(a, r, &[&["--metric", "flip", "--json"], more].concat());
        let json: serde_json::Value = serde_json::from_str(&found.text).expect("JSON");
        assert_eq!(json["value"], json["layers"][0]["flip"]);
        json["value"].as_f64().expect("a number")
    };
    let high = value(&a, &r, &["-o", map.to_str().unwrap()]);
    assert!(read(&map).unwrap().rgb(4, 3)[0] > read(&map).unwrap().rgb(15, 8)[0]);
    let rgb = |image: &Image| {
        let mut picture = flat(0.0, &RGB);
        picture.data.iter_mut().zip(image.data.chunks(6).flat_map(|p| &p[..3])).for_each(|(to, v)| *to = *v);
        picture
    };
    let (a, r) = (dir.save("a.png", &rgb(&image)), dir.save("r.png", &rgb(&reference)));
    let low = value(&a, &r, &[]);
    assert!(high > 0.0 && low > 0.0 && (high / low - 1.0).abs() > 0.01, "{high} {low}");
    assert_eq!(diff(&a, &r, &["--metric", "flip", "--fail", &format!("{}", low * 1.01)]), 0);
    assert_eq!(diff(&a, &r, &["--metric", "flip", "--fail", &format!("{}", low * 0.99)]), 1);
}

#[test]
fn nan_and_infinity_never_pass() {
    let dir = Folder::new();
    let good = dir.save("good.exr", &flat(0.5, &RGB));
    for bad_value in [f32::NAN, f32::INFINITY] {
        let mut bad = flat(0.5, &RGB);
        bad.pixel_mut(3, 2)[1] = bad_value;
        let path = dir.save("bad.exr", &bad);
        for (a, b) in [(&path, &good), (&good, &path), (&path, &path)] {
            for more in [&["--fail", "inf"][..], &["--metric", "psnr", "--fail=-inf"], &["--json"]] {
                assert_eq!(diff(a, b, more), 1, "{bad_value} {more:?}");
            }
        }
        let found = invalid(&read(&path).unwrap());
        assert_eq!((found.nan, found.inf), if bad_value.is_nan() { (1, 0) } else { (0, 1) });
        assert_eq!(found.first.unwrap().to_string(), "pixel (3, 2), channel G");
    }
}

#[test]
fn other_sizes_and_channels_are_not_comparable() {
    let dir = Folder::new();
    let a = dir.save("a.exr", &flat(0.5, &RGB));
    let small = dir.save("small.exr", &Image::new(4, 4, &RGB));
    let grey = dir.save("grey.exr", &flat(0.5, &["Y"]));
    let normals = dir.save("normals.exr", &flat(0.5, &["N.X"]));
    for other in [&small, &grey, &normals] {
        assert_eq!(diff(&a, other, &[]), 3);
        assert_eq!(diff(&a, other, &["--json"]), 3);
    }
    assert_eq!(diff(&a, &a, &["--z"]), 3);
    let says = |a: &Path, b: &Path| compare(&read(a).unwrap(), &read(b).unwrap()).unwrap_err().to_string();
    assert_eq!(says(&a, &small), "the sizes differ: 20x10 and 4x4");
    assert_eq!(says(&a, &grey), "the channels differ: R, G, B and Y");
}

#[test]
fn what_cannot_be_read_is_an_error_with_exit_code_4() {
    let dir = Folder::new();
    let a = dir.save("a.exr", &flat(0.5, &RGB));
    let line = Line::try_parse_from([Path::new("diff"), &a, &dir.path("missing.exr")]).unwrap();
    let error = outcome(&line.args).unwrap_err();
    assert_eq!(error.kind, Kind::Output);
    assert_eq!(error.kind.exit_code(), 4);
    assert!(error.to_string().ends_with("missing.exr: no such file"), "{error}");
}

#[test]
fn layers_are_judged_apart_and_what_only_one_has_is_named() {
    let mut a = flat(0.5, &["R", "G", "B", "A", "albedo.R", "variance.R", "Z"]);
    let b = flat(0.5, &["R", "G", "B", "A", "albedo.R"]);
    a.pixel_mut(19, 9)[4] = 0.75;
    let found = compare(&a, &b).unwrap();
    let names: Vec<&str> = found.layers.iter().map(|l| l.layer.as_str()).collect();
    assert_eq!(names, ["", "A", "albedo"]);
    assert_eq!(found.ignored, ["Z"]);
    assert_eq!((found.layers[0].max, found.layers[2].max), (0.0, 0.25));
    assert_eq!(found.layers[2].max_at.to_string(), "pixel (19, 9), channel albedo.R");
    let dir = Folder::new();
    assert_eq!(diff(&dir.save("a.exr", &a), &dir.save("b.exr", &b), &[]), 1);
}

#[test]
fn a_heat_map_is_written_in_either_format() {
    let dir = Folder::new();
    let mut image = flat(0.5, &RGB);
    image.pixel_mut(0, 0)[0] = 0.9;
    let (a, b) = (dir.save("a.exr", &image), dir.save("b.exr", &flat(0.5, &RGB)));
    for name in ["heat.exr", "heat.png"] {
        let out = dir.path(name);
        assert_eq!(diff(&a, &b, &["-o", out.to_str().unwrap()]), 1);
        let heat = read(&out).unwrap();
        assert!(heat.rgb(0, 0)[1] > 0.9 && heat.rgb(1, 0)[0] < 0.01, "{name}");
    }
    let map = error_map(&image, &flat(0.5, &RGB), ErrorKind::Absolute).unwrap();
    assert!((map.pixel(0, 0)[0] - 0.4 / 3.0).abs() < 1e-7);
}

#[test]
fn the_z_test_accepts_noise_of_the_stated_variance_and_rejects_bias() {
    let dir = Folder::new();
    let mut a = flat(0.5, &["R", "G", "B", "variance.R", "variance.G", "variance.B"]);
    let mut biased = a.clone();
    let mut state = 12345u32;
    let mut uniform = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    };
    for y in 0..10 {
        for x in 0..20 {
            for c in 0..3 {
                // The sum of 12 uniform random numbers has variance 1 and mean 6.
                let noise = 0.1 * ((0..12).map(|_| uniform()).sum::<f32>() - 6.0);
                a.pixel_mut(x, y)[c] += noise;
                biased.pixel_mut(x, y)[c] += noise + 0.6;
                a.pixel_mut(x, y)[c + 3] = 0.01;
                biased.pixel_mut(x, y)[c + 3] = 0.01;
            }
        }
    }
    let r = dir.save("r.exr", &flat(0.5, &RGB));
    let (a, biased) = (dir.save("a.exr", &a), dir.save("biased.exr", &biased));
    assert!(said(&a, &r, &[]).text.contains("the images contain noise: --z tests"));
    assert!(!said(&a, &r, &["--fail", "1e-9"]).text.contains("--z"));
    assert_eq!(diff(&a, &r, &["--z"]), 0);
    assert_eq!(diff(&a, &r, &["--z", "--json"]), 0);
    assert_eq!(diff(&a, &r, &["--z", "--fail", "1e-9"]), 1);
    let heat = dir.path("z.png");
    assert_eq!(diff(&biased, &r, &["--z", "-o", heat.to_str().unwrap()]), 1);
    assert!(read(&heat).unwrap().rgb(5, 5)[0] > 0.5);
    let variance = dir.save("variance.exr", &flat(1e6, &RGB));
    let more = ["--z", "--variance", variance.to_str().unwrap()];
    assert_eq!(diff(&biased, &r, &more), 0);
}

#[test]
fn the_report_says_what_was_found_as_text_and_as_json() {
    let dir = Folder::new();
    let mut image = flat(0.5, &["R", "G", "B", "Z"]);
    image.pixel_mut(4, 3)[2] = 1.0;
    let (a, r) = (dir.save("a.exr", &image), dir.save("r.exr", &flat(0.5, &RGB)));
    let found = said(&a, &r, &["--metric", "max", "--fail", "0.25"]);
    // One of 600 values differs by 0.5: the MSE is 0.25 / 600, and the relMSE is that divided by 0.26.
    let expected = "\
picture (R, G, B)
  relMSE 1.602564e-3   trimmed 0.000000e0
  MSE 4.166667e-4   RMSE 2.041241e-2   PSNR 33.802 dB
  mean difference 8.333333e-4   ratio of means 1.001667
  largest difference 5.000000e-1 at pixel (4, 3), channel B
only in one image, not compared: Z
different by max with threshold 0.25
";
    assert_eq!((found.text.as_str(), found.exit_code), (expected, 1));
    let json: serde_json::Value = serde_json::from_str(&said(&a, &r, &["--json"]).text).unwrap();
    assert_eq!(json["result"], "different");
    assert_eq!(json["metric"], "relmse");
    assert_eq!(json["layers"][0]["max_at"], serde_json::json!([4, 3]));
    assert!((json["value"].as_f64().unwrap() - 0.25 / 600.0 / 0.26).abs() < 1e-9);

    image.pixel_mut(1, 1)[0] = f32::NAN;
    let bad = dir.save("bad.exr", &image);
    let found = said(&bad, &r, &[]);
    let path = bad.display();
    let first = format!("{path}: 1 NaN and 0 infinite values, the first at pixel (1, 1), channel R\n");
    assert!(found.text.starts_with(&first), "{}", found.text);
    assert!(found.text.ends_with("different: an image with NaN or infinite values never passes\n"));
    let small = dir.save("small.exr", &Image::new(4, 4, &RGB));
    let found = said(&a, &small, &[]);
    assert_eq!(found.text, "not comparable: the sizes differ: 20x10 and 4x4\n");
}
