//! The output of `buffon info` for an image.

use std::fmt::Write;

use crate::compare::invalid;
use crate::error::counted;
use crate::image::Image;

/// The least, mean and greatest finite value of a channel, and the number of values that are not finite.
struct Range {
    min: f32,
    mean: f64,
    max: f32,
    nan: usize,
    inf: usize,
}

fn range(image: &Image, channel: usize) -> Range {
    let mut range = Range { min: f32::INFINITY, mean: 0.0, max: f32::NEG_INFINITY, nan: 0, inf: 0 };
    let mut finite = 0u64;
    for &v in image.data.iter().skip(channel).step_by(image.channels.len()) {
        if v.is_nan() {
            range.nan += 1;
        } else if v.is_infinite() {
            range.inf += 1;
        } else {
            finite += 1;
            range.mean += f64::from(v);
            (range.min, range.max) = (range.min.min(v), range.max.max(v));
        }
    }
    range.mean /= finite as f64;
    range
}

/// Returns the size, metadata and range of each channel as lines of text.
pub fn describe(image: &Image) -> String {
    let mut text = format!(
        "{}x{} pixels, {}\n",
        image.width,
        image.height,
        counted(image.channels.len() as u64, "channel", "channels")
    );
    let bad = invalid(image);
    if bad.any() {
        _ = writeln!(text, "invalid: {bad}");
    }
    let column = image.channels.iter().map(|c| c.chars().count()).max().unwrap_or(0).max("channel".len());
    let header = ["channel", "min", "mean", "max", "NaN", "Inf"];
    let row = |cells: [String; 6]| {
        let [name, min, mean, max, nan, inf] = cells;
        format!("{name:<column$} {min:>13} {mean:>13} {max:>13} {nan:>8} {inf:>8}\n")
    };
    text += &row(header.map(String::from));
    for (c, name) in image.channels.iter().enumerate() {
        let r = range(image, c);
        let cells = if r.min <= r.max {
            [format!("{:.6}", r.min), format!("{:.6}", r.mean), format!("{:.6}", r.max)]
        } else {
            ["-", "-", "-"].map(String::from)
        };
        let [min, mean, max] = cells;
        text += &row([name.clone(), min, mean, max, r.nan.to_string(), r.inf.to_string()]);
    }
    for (name, value) in image.metadata.iter() {
        _ = writeln!(text, "{name}: {value}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Value;

    #[test]
    fn size_ranges_and_metadata_are_listed() {
        let mut image = Image::new(2, 1, &["R", "albedo.R"]);
        image.data = vec![0.5, f32::NAN, -1.5, f32::INFINITY];
        image.metadata.set("samplesPerPixel", Value::Int(64));
        assert_eq!(
            describe(&image),
            "2x1 pixels, 2 channels\n\
             invalid: 1 NaN and 1 infinite values, the first at pixel (0, 0), channel albedo.R\n\
             channel            min          mean           max      NaN      Inf\n\
             R            -1.500000     -0.500000      0.500000        0        0\n\
             albedo.R             -             -             -        1        1\n\
             samplesPerPixel: 64\n"
        );
    }
}
