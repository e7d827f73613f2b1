//! Comparison of the images of different traversals.

use super::runner::{Outcome, Picture, Runner};
use super::{FoundScene, Status, page};
use crate::accel::AccelKind;
use crate::compare::{NotComparable, compare, z_test};
use crate::error::{Error, Result};
use crate::image::Image;

/// The relative difference, with respect to the larger value, up to which values are equal. Traversals round
/// differently.
const ROUNDING: f32 = 1e-5;
/// The largest accepted relMSE between the images and between the layers.
const RELMSE: f64 = 1e-3;
/// The largest accepted difference between the ratio of the means and 1.
const MEAN: f64 = 1e-3;
/// The largest accepted root mean square of z. It is 1 for images with different random numbers.
const RMS: f64 = 0.5;

/// Renders a scene on each traversal with the same random numbers, and compares the images with that of obvhs.
pub(super) fn test(runner: &Runner<'_>, scene: &FoundScene, warnings: &mut Vec<Error>) -> Result<Outcome> {
    let mut file = runner.load(scene, &[], warnings)?;
    file.pass_panes(runner.options.choices.integrator.as_deref());
    let mut pictures: Vec<(&str, Picture)> = Vec::new();
    let mut holes = false;
    for &kind in AccelKind::CHOICES.iter().rev() {
        let session = file.clone().compile(kind, runner.options.threads)?;
        let name = session.scene.accel.name();
        if pictures.iter().any(|(known, _)| *known == name) {
            continue;
        }
        holes |= session.scene.needs.holes;
        let plan = runner.plan(&session, runner.samples(&session), runner.options.choices.seed)?;
        let Some(picture) = runner.render(&session, &plan)? else {
            return Ok(Outcome::new(Status::NotRun, "interrupted"));
        };
        pictures.push((name, picture));
    }
    let (expected_name, expected) = pictures.remove(0);
    let samples_per_pixel = expected.samples_per_pixel;
    let mut all_figures = Vec::new();
    for (name, picture) in pictures {
        let dropped = [&picture, &expected].into_iter().find_map(|p| p.dropped.clone());
        let (faults, figures) =
            differences(&picture.image, &expected.image, runner.rules.significance, holes)
                .map_err(|e| Error::internal(e.to_string()))?;
        let faults: Vec<String> = faults.into_iter().chain(dropped).collect();
        if !faults.is_empty() {
            let names = [name, expected_name].map(str::to_owned);
            let shown = Some(page::Shown { names, images: [picture.image, expected.image], scores: None });
            let message = format!("{name}: {}", faults.join("; "));
            return Ok(Outcome { samples_per_pixel, shown, ..Outcome::new(Status::Fail, message) });
        }
        all_figures.push(format!("{name}: {figures}"));
    }
    if all_figures.is_empty() {
        all_figures.push(format!("all traversals of this build are {expected_name}"));
    }
    Ok(Outcome { samples_per_pixel, ..Outcome::new(Status::Pass, all_figures.join("; ")) })
}

/// Returns the differences that exceed their limits, and a summary of all figures.
///
/// A hash of the ray decides whether it passes a hole, so rounding changes some of these decisions. Images of scenes
/// with holes are therefore compared by their noise only.
fn differences(
    a: &Image,
    b: &Image,
    significance: f64,
    holes: bool,
) -> Result<(Vec<String>, String), NotComparable> {
    let comparison = compare(a, b)?;
    let test = z_test(&rounded(a, b), b, None, significance)?;
    let picture = &comparison.layers[0];
    let off = (picture.mean_ratio - 1.0).abs();
    let rms = if test.without_variance == test.blocks { 0.0 } else { test.rms };
    let mut faults = Vec::new();
    if comparison.has_invalid() {
        faults.push(format!("NaN or infinite values: {}; {}", comparison.invalid_a, comparison.invalid_b));
    }
    if test.rejected > test.unequal {
        faults.push(format!(
            "{} of {} blocks differ by more than their noise, the worst at {}",
            test.rejected - test.unequal,
            test.blocks,
            test.max_at
        ));
    }
    if let Some((_, at)) = test.unequal_at.as_ref().filter(|_| test.unequal > 0) {
        faults.push(format!(
            "{} of {} blocks without noise differ, the worst at {at}",
            test.unequal, test.without_variance
        ));
    }
    if rms > RMS {
        faults.push(format!("the pictures differ by {rms:.2} of their noise, of at most {RMS}"));
    }
    if !test.is_unbiased() {
        faults.push(format!("the means differ by {:.1} deviations of their noise", test.bias));
    }
    if !holes && picture.max > 0.0 && (off.is_nan() || off > MEAN) {
        faults.push(format!("the means differ by {:.3} %, of at most {} %", 100.0 * off, 100.0 * MEAN));
    }
    let judged = if holes { &[] } else { &comparison.layers[..] };
    for layer in judged.iter().filter(|l| l.relmse.is_nan() || l.relmse > RELMSE) {
        let name = if layer.layer.is_empty() { "the picture" } else { &layer.layer };
        faults.push(format!(
            "relMSE {:.1e} of at most {RELMSE:.0e} in {name}, largest difference {:.1e} at {}",
            layer.relmse, layer.max, layer.max_at
        ));
    }
    let figures = format!(
        "relMSE {:.1e}, largest difference {:.1e}, {rms:.3} of the noise",
        picture.relmse, picture.max
    );
    Ok((faults, figures))
}

/// Returns the first image, with the second image's value wherever they differ by rounding only.
fn rounded(a: &Image, b: &Image) -> Image {
    let mut rounded = a.clone();
    for (x, r) in rounded.data.iter_mut().zip(&b.data) {
        if (*x - *r).abs() <= ROUNDING * x.abs().max(r.abs()) {
            *x = *r;
        }
    }
    rounded
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat() -> Image {
        let mut image = Image::new(16, 16, &["R", "G", "B", "variance.R", "variance.G", "variance.B"]);
        image.data.chunks_exact_mut(6).for_each(|p| p.copy_from_slice(&[0.5, 0.5, 0.5, 0.01, 0.01, 0.01]));
        image
    }

    #[test]
    fn rounding_is_no_difference_and_a_hole_is_one() {
        let a = flat();
        let mut b = flat();
        b.data.iter_mut().for_each(|v| *v *= 1.000_001);
        assert!(differences(&b, &a, 0.001, false).unwrap().0.is_empty());
        for x in 4..8 {
            (4..8).for_each(|y| b.pixel_mut(x, y)[0] = 0.0);
        }
        let faults = differences(&b, &a, 0.001, false).unwrap().0;
        let worst = "1 of 48 blocks differ by more than their noise, the worst at pixel (4, 4), channel R";
        assert_eq!(faults[0], worst);
        assert!(
            faults.iter().any(|f| f.starts_with("relMSE 2.0e-2 of at most 1e-3 in the picture")),
            "{faults:?}"
        );
    }
}
