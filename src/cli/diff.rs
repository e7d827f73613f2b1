//! `buffon diff`: the differences of two images, and their comparison with a threshold.

use std::fmt::Write;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::{Value as Json, json};

use crate::compare::{
    Comparison, DynamicRange, ErrorKind, HeatScale, Invalid, LayerComparison, NotComparable, ZTest, compare,
    error_map, flip, heat, mean_flip, z_test,
};
use crate::error::{Error, Result};
use crate::image::{Image, WriteOptions, check_output, has_high_range, read, write};
use crate::util::is_same_file;

/// The exit code for images that are equal within the threshold.
const SAME: u8 = 0;
/// The exit code for images that differ.
const DIFFERENT: u8 = 1;
/// The exit code for images that cannot be compared.
const NOT_COMPARABLE: u8 = 3;

/// Compare an image with a reference.
///
/// Exit code: 0 same within the threshold, 1 different, 3 not comparable (size, channels), 4 unreadable. An
/// image with NaN or infinite values never passes.
#[derive(Clone, Debug, Args)]
pub struct DiffArgs {
    /// The image to test
    pub a: PathBuf,
    /// The reference
    pub b: PathBuf,
    /// Write a false-colour image of the error (.exr, .png, .jpg, .pfm, .npy); brighter is worse, a step of the scale
    /// is a power of ten (with flip, the scale is linear from 0 to 1), cyan is NaN or infinite
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// The largest error that passes (for psnr, the smallest value that does) [default: images must be equal
    /// by the metric; with --z, the test alone decides]
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    pub fail: Option<f64>,
    /// The metric that decides
    #[arg(long, value_name = "NAME", value_enum, default_value_t = Metric::Relmse)]
    pub metric: Metric,
    /// Test whether both images can be estimates of the same image, with the variance layers of either: in blocks of
    /// 4x4 pixels (significance 0.01 over all blocks; 99.75 % of the blocks must pass), and for a bias of each
    /// channel's mean over the whole image. Images whose pixels share noise (caches, photons, light paths) state so in
    /// their metadata; their layer block_variance is used. Differences within the rounding of the file format are
    /// ignored. In blocks without variance, values must not differ by more than 0.1 %
    #[arg(long)]
    pub z: bool,
    /// With --z, an image with the variances of B
    #[arg(long, value_name = "FILE", requires = "z")]
    pub variance: Option<PathBuf>,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// The metric of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Metric {
    /// Mean absolute difference
    Mean,
    /// Mean squared error
    Mse,
    /// Root of the mean squared error
    Rmse,
    /// Peak signal-to-noise ratio in dB
    Psnr,
    /// Mean of (x - r)^2 / (r^2 + 0.01)
    Relmse,
    /// relMSE without the 0.1 % worst pixels
    Trimmed,
    /// Largest absolute difference
    Max,
    /// Distance of the ratio of the means from 1
    Ratio,
    /// Mean FLIP error of the picture: what a viewer sees when the images alternate, at 67 pixels per degree, from 0 to
    /// 1; at several exposures unless both files are for displays (PNG, JPEG, BMP, TGA)
    Flip,
}

impl Metric {
    fn name(self) -> String {
        self.to_possible_value().map(|v| v.get_name().to_owned()).unwrap_or_default()
    }

    fn of(self, layer: &LayerComparison) -> f64 {
        match self {
            Metric::Mean => layer.mean_absolute,
            Metric::Mse => layer.mse,
            Metric::Rmse => layer.rmse,
            Metric::Psnr => layer.psnr,
            Metric::Relmse => layer.relmse,
            Metric::Trimmed => layer.trimmed_relmse,
            Metric::Max => layer.max,
            // Two black images have no ratio, but are equal.
            Metric::Ratio if layer.max == 0.0 => 0.0,
            Metric::Ratio => (layer.mean_ratio - 1.0).abs(),
            Metric::Flip => layer.flip.unwrap_or(f64::NAN),
        }
    }

    /// Returns whether a layer passes. Equal images pass with any metric.
    fn passes(self, layer: &LayerComparison, threshold: f64) -> bool {
        let value = self.of(layer);
        match self {
            Metric::Psnr => value >= threshold,
            // If an image has one pixel, that pixel is not trimmed.
            Metric::Trimmed if value.is_nan() => layer.relmse <= threshold,
            // Other layers have no FLIP.
            Metric::Flip if layer.flip.is_none() => true,
            _ => value <= threshold,
        }
    }

    /// Returns the default threshold, which is the value of equal images.
    fn exact(self) -> f64 {
        if self == Metric::Psnr { f64::INFINITY } else { 0.0 }
    }
}

/// The result of a comparison and its consequence.
struct Verdict {
    comparison: Comparison,
    /// The FLIP error of each pixel, if it is the metric.
    flip: Option<Image>,
    z: Option<ZTest>,
    threshold: Option<f64>,
    same: bool,
    /// Whether a z-test was not requested but is possible.
    z_is_possible: bool,
}

/// Runs the comparison, prints the result on standard output and returns the exit code.
///
/// # Errors
/// If an image cannot be read or the image of the error cannot be written.
pub fn run(args: &DiffArgs) -> Result<u8> {
    let outcome = outcome(args)?;
    super::print(&outcome.text)?;
    Ok(outcome.exit_code)
}

/// The text of a comparison and its exit code.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Lines of text, or of JSON if requested.
    pub text: String,
    /// 0 same, 1 different, 3 not comparable.
    pub exit_code: u8,
}

/// Runs the comparison without printing.
///
/// # Errors
/// As [`run`].
pub fn outcome(args: &DiffArgs) -> Result<Outcome> {
    if args.fail.is_some_and(f64::is_nan) {
        return Err(Error::usage("expected a number, found NaN").about("--fail"));
    }
    if args.fail.is_some_and(|fail| fail < 0.0) && args.metric != Metric::Psnr {
        return Err(Error::usage("expected a number of at least 0").about("--fail"));
    }
    if let Some(output) = &args.output {
        check_output(output)?;
    }
    if let Some(output) = &args.output
        && [&args.a, &args.b].into_iter().any(|image| is_same_file(image, output))
    {
        return Err(Error::usage(format!("-o {}: it is one of the images", output.display())));
    }
    let (a, b) = (read(&args.a)?, read(&args.b)?);
    let range = dynamic_range([&args.a, &args.b])?;
    let variance = args.variance.as_deref().map(read).transpose()?;
    match judge(args, [&a, &b], range, variance.as_ref()) {
        Ok(verdict) => {
            if let Some(path) = &args.output {
                let picture = picture(&a, &b, &verdict).map_err(|e| Error::internal(e.to_string()))?;
                write(path, &picture, &WriteOptions::default())?;
            }
            let text = if args.json { to_json(args, &verdict) } else { to_text(args, &verdict) };
            Ok(Outcome { text, exit_code: if verdict.same { SAME } else { DIFFERENT } })
        }
        Err(why) => {
            let reason = why.to_string();
            let text = if args.json {
                let (a, b) = (&args.a, &args.b);
                json!({ "a": a, "b": b, "result": "not comparable", "reason": reason }).to_string() + "\n"
            } else {
                format!("not comparable: {reason}\n")
            };
            Ok(Outcome { text, exit_code: NOT_COMPARABLE })
        }
    }
}

/// Returns the range of files that are compared: low if all of them are for displays.
///
/// # Errors
/// If a file cannot be read, or is no image.
pub(super) fn dynamic_range<'a>(files: impl IntoIterator<Item = &'a PathBuf>) -> Result<DynamicRange> {
    for file in files {
        if has_high_range(file)? {
            return Ok(DynamicRange::High);
        }
    }
    Ok(DynamicRange::Low)
}

/// Significance of the z-test over the whole image.
const Z_SIGNIFICANCE: f64 = 0.01;

fn judge(
    args: &DiffArgs,
    [a, b]: [&Image; 2],
    range: DynamicRange,
    variance: Option<&Image>,
) -> std::result::Result<Verdict, NotComparable> {
    let mut comparison = compare(a, b)?;
    let flip = match args.metric == Metric::Flip && !comparison.has_invalid() {
        true => {
            let map = Image { data: flip(a, b, range)?, ..Image::new(a.width, a.height, &["FLIP"]) };
            if let Some(picture) = comparison.layers.first_mut() {
                picture.flip = Some(mean_flip(&map.data));
            }
            Some(map)
        }
        false => None,
    };
    let z = args.z.then(|| z_test(a, b, variance, Z_SIGNIFICANCE)).transpose()?;
    let threshold = args.fail.or((!args.z).then(|| args.metric.exact()));
    let within = threshold.is_none_or(|t| comparison.layers.iter().all(|l| args.metric.passes(l, t)));
    let same = !comparison.has_invalid() && within && z.as_ref().is_none_or(ZTest::passes);
    // Noisy images are never equal, so that the default threshold says nothing about them.
    let z_is_possible =
        !same && !args.z && args.fail.is_none() && z_test(a, b, variance, Z_SIGNIFICANCE).is_ok();
    Ok(Verdict { comparison, flip, z, threshold, same, z_is_possible })
}

/// Returns the false-colour image: |z| of a z-test on a linear scale up to 5, FLIP on a linear scale up to 1, otherwise
/// the relative squared error on a logarithmic scale over six decades.
fn picture(a: &Image, b: &Image, verdict: &Verdict) -> std::result::Result<Image, NotComparable> {
    let Some(z) = &verdict.z else {
        if let Some(flip) = &verdict.flip {
            return Ok(heat(flip, HeatScale::Linear { max: 1.0 }));
        }
        let map = error_map(a, b, ErrorKind::RelativeSquared)?;
        let max = map.data.iter().filter(|v| v.is_finite()).fold(0.0f32, |max, v| max.max(*v));
        return Ok(heat(&map, HeatScale::Log { max: f64::from(max), decades: 6.0 }));
    };
    let mut map = Image::new(z.scores.width, z.scores.height, &["z"]);
    for (to, from) in map.data.iter_mut().zip(z.scores.data.chunks_exact(z.scores.channels.len())) {
        // `f32::max` would ignore a NaN.
        *to = from.iter().fold(0.0, |max, z| if z.abs() > max || z.is_nan() { z.abs() } else { max });
    }
    Ok(heat(&map, HeatScale::Linear { max: 5.0 }))
}

fn to_text(args: &DiffArgs, verdict: &Verdict) -> String {
    let mut text = String::new();
    for (path, invalid) in
        [(&args.a, &verdict.comparison.invalid_a), (&args.b, &verdict.comparison.invalid_b)]
    {
        if invalid.any() {
            _ = writeln!(text, "{}: {invalid}", path.display());
        }
    }
    for layer in &verdict.comparison.layers {
        let name = if layer.layer.is_empty() { "picture" } else { &layer.layer };
        _ = writeln!(text, "{name} ({})", layer.channels.join(", "));
        _ = writeln!(text, "  relMSE {:.6e}   trimmed {:.6e}", layer.relmse, layer.trimmed_relmse);
        _ = writeln!(text, "  MSE {:.6e}   RMSE {:.6e}   PSNR {:.3} dB", layer.mse, layer.rmse, layer.psnr);
        _ = writeln!(
            text,
            "  mean difference {:.6e}   ratio of means {:.6}",
            layer.mean_absolute, layer.mean_ratio
        );
        _ = writeln!(text, "  largest difference {:.6e} at {}", layer.max, layer.max_at);
        if let Some(flip) = layer.flip {
            _ = writeln!(text, "  FLIP {flip:.6}");
        }
    }
    if !verdict.comparison.ignored.is_empty() {
        _ = writeln!(text, "only in one image, not compared: {}", verdict.comparison.ignored.join(", "));
    }
    if let Some(z) = &verdict.z {
        let accepted = 100.0 * z.accepted;
        _ = writeln!(
            text,
            "z-test at significance {}: {accepted:.3} % of the blocks accepted",
            z.significance
        );
        _ = writeln!(
            text,
            "  mean z {:.4}   rms z {:.4}   bias {:.2} deviations   largest {:.3} at {}",
            z.mean, z.rms, z.bias, z.max, z.max_at
        );
        if z.without_variance > 0 {
            let (without, share) = (z.without_variance, 100.0 * ZTest::SAME);
            _ = write!(text, "  {without} of {} blocks have no variance", z.blocks);
            _ = match z.unequal_at.as_ref().filter(|_| z.unequal > 0) {
                None => writeln!(text, "; their values differ by {share} % at most"),
                Some((worst, at)) => {
                    let worst = 100.0 * worst;
                    writeln!(
                        text,
                        "; {} differ by more than {share} %, up to {worst:.3} % at {at}",
                        z.unequal
                    )
                }
            };
        }
    }
    let result = if verdict.same { "same" } else { "different" };
    _ = match (verdict.threshold, verdict.comparison.has_invalid()) {
        (_, true) => writeln!(text, "{result}: an image with NaN or infinite values never passes"),
        (Some(t), false) => writeln!(text, "{result} by {} with threshold {t}", args.metric.name()),
        (None, false) => writeln!(text, "{result} by the z-test"),
    };
    if verdict.z_is_possible {
        _ = writeln!(text, "the images contain noise: --z tests whether they differ by more than that");
    }
    text
}

/// Returns a layer's numbers; null for NaN and infinite values, which JSON cannot represent.
fn layer_json(layer: &LayerComparison) -> Json {
    json!({
        "layer": layer.layer, "channels": layer.channels,
        "mean": layer.mean_absolute, "mse": layer.mse, "rmse": layer.rmse, "psnr": layer.psnr,
        "relmse": layer.relmse, "trimmed": layer.trimmed_relmse, "mean_ratio": layer.mean_ratio,
        "max": layer.max, "max_at": [layer.max_at.x, layer.max_at.y], "max_channel": layer.max_at.channel,
        "flip": layer.flip,
    })
}

fn invalid_json(invalid: &Invalid) -> Json {
    let first = invalid.first.as_ref().map(|at| json!({ "x": at.x, "y": at.y, "channel": at.channel }));
    json!({ "nan": invalid.nan, "inf": invalid.inf, "first": first })
}

fn to_json(args: &DiffArgs, verdict: &Verdict) -> String {
    let comparison = &verdict.comparison;
    let z = verdict.z.as_ref().map(|z| {
        json!({
            "significance": z.significance, "accepted": z.accepted, "mean": z.mean, "rms": z.rms, "bias": z.bias,
            "bias_probability": z.bias_probability,
            "max": z.max, "max_at": [z.max_at.x, z.max_at.y], "without_variance": z.without_variance,
            "unequal": z.unequal,
            "passes": z.passes(),
        })
    });
    json!({
        "a": args.a, "b": args.b,
        "result": if verdict.same { "same" } else { "different" },
        "metric": args.metric.name(),
        "value": comparison.layers.first().map(|layer| args.metric.of(layer)),
        "threshold": verdict.threshold,
        "invalid_a": invalid_json(&comparison.invalid_a),
        "invalid_b": invalid_json(&comparison.invalid_b),
        "layers": comparison.layers.iter().map(layer_json).collect::<Vec<_>>(),
        "not_compared": comparison.ignored,
        "z": z,
        "backend": crate::image::backend(),
    })
    .to_string()
        + "\n"
}
