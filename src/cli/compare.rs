//! `buffon compare`: a page with images beside each other.

use super::convert::read_layer;
use super::diff::dynamic_range;
use crate::compare::{compare, flip, mean_flip};
use crate::error::{Error, Kind, Result};
use crate::image::Image;
use crate::report::{Align, MOST_PIXELS, Page, Table, Viewer, exposure_of, number};
use crate::util;
use clap::Args;
use std::path::PathBuf;

/// Make a page that shows images beside each other.
///
/// The page is one file. Any two of the images, or of their errors relative to the first one, are shown with a divider
/// between them, with exposure, zoom and the values of pixels. A table has the errors, and maps show FLIP: what a
/// viewer sees when an image and the first one alternate.
#[derive(Clone, Debug, Args)]
pub struct CompareArgs {
    /// The reference, and the images to compare with it, all of the same size
    #[arg(required = true, num_args = 2.., value_name = "IMAGE")]
    pub images: Vec<PathBuf>,
    /// The page to write
    #[arg(short, long, value_name = "FILE", default_value = "compare.html")]
    pub output: PathBuf,
    /// The layer to show instead of the picture, such as albedo
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
}

/// Writes the page.
///
/// # Errors
/// If an image cannot be read, has no such layer, or cannot be compared with the first, the images are too large for a
/// page, or the page cannot be written.
pub fn run(args: &CompareArgs) -> Result<u8> {
    if args.output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("html")) {
        let message = format!("-o {}: expected the extension .html", args.output.display());
        return Err(Error::usage(message));
    }
    util::check_replaceable(&args.output)?;
    let read = |path: &PathBuf| Ok((path.display().to_string(), read_layer(path, args.layer.as_deref())?));
    let images: Vec<(String, Image)> = args.images.iter().map(read).collect::<Result<_>>()?;
    let flip = flip_maps(&args.images, &images)?;
    let errors = errors(&images, &flip)?;
    let mut page = Page::new(images.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", "));
    page.section("Side by side", viewer(&images)?.html()?);
    let pixels = |images: &[(String, Image)]| images.iter().map(|(_, i)| i.width * i.height).sum::<usize>();
    if !flip.is_empty() && pixels(&images) + pixels(&flip) <= MOST_PIXELS {
        let maps = Viewer {
            title: format!("from 0 (black) to 1 (white), relative to {}", images[0].0),
            images: flip.iter().map(|(name, map)| (name.clone(), map)).collect(),
            right: flip.len() - 1,
            ..Viewer::default()
        };
        page.section("FLIP", maps.html()?);
    }
    page.section("Errors", errors.html());
    page.circumstances();
    page.write(&args.output)?;
    super::print(&format!("{}\n{}\n", errors.text(), args.output.display()))
}

/// Returns the viewer, which shows the second image beside the first.
fn viewer(images: &[(String, Image)]) -> Result<Viewer<'_>> {
    let pixels: usize = images.iter().map(|(_, image)| image.width * image.height).sum();
    if pixels > MOST_PIXELS {
        let [all, most] = [pixels, MOST_PIXELS].map(|pixels| pixels as f64 * 1e-6);
        return Err(Error::usage(format!(
            "the images have {all:.1} megapixels together, and a page holds {most:.0} at most"
        )));
    }
    Ok(Viewer {
        title: format!("errors are relative to {}", images[0].0),
        images: images.iter().map(|(name, image)| (name.clone(), image)).collect(),
        reference: Some(0),
        left: 1,
        right: 0,
        exposure: exposure_of(&images[0].1),
    })
}

/// Returns maps of FLIP of the images relative to the first one, without images that are no pictures or have NaN or
/// infinite values.
fn flip_maps(files: &[PathBuf], images: &[(String, Image)]) -> Result<Vec<(String, Image)>> {
    let range = dynamic_range(files)?;
    let (_, reference) = &images[0];
    let map = |(name, image): &(String, Image)| {
        let errors = flip(image, reference, range).ok()?;
        let map = Image { data: errors, ..Image::new(image.width, image.height, &["Y"]) };
        Some((name.clone(), map))
    };
    Ok(images[1..].iter().filter_map(map).collect())
}

/// Returns the errors of all images but the first, relative to that one. `flip` are their maps of FLIP, if there are
/// any.
fn errors(images: &[(String, Image)], flip: &[(String, Image)]) -> Result<Table> {
    let figures =
        ["relMSE", "trimmed", "PSNR", "mean difference", "ratio of means", "largest difference", "FLIP"];
    let columns = figures.map(|title| (title, Align::Right));
    let mut table = Table::new([("image", Align::Left)].into_iter().chain(columns));
    let (_, reference) = &images[0];
    for (name, image) in &images[1..] {
        let comparison = compare(image, reference).map_err(|why| {
            Error::new(Kind::Scene, format!("not comparable with {}: {why}", images[0].0)).about(name)
        })?;
        let mean = |(_, map): &(String, Image)| number(mean_flip(&map.data));
        let flip = flip.iter().find(|(of, _)| of == name).map_or_else(|| "–".to_owned(), mean);
        for layer in comparison.layers.iter().take(1) {
            let figures = [
                layer.relmse,
                layer.trimmed_relmse,
                layer.psnr,
                layer.mean_absolute,
                layer.mean_ratio,
                layer.max,
            ];
            table.row([name.clone()].into_iter().chain(figures.map(number)).chain([flip.clone()]));
        }
    }
    Ok(table)
}
