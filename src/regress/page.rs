//! The output for failed tests: images, heat maps and a page with viewers.

use super::{RegressRow, Report, Status};
use crate::compare::{ErrorKind, HeatScale, error_map, heat};
use crate::error::{Error, Result};
use crate::image::{self, Image, WriteOptions};
use crate::report::{Align, Html, Page, Picture, Table, Viewer, exposure_of, gallery, thumbnail};
use std::path::Path;

/// The |z| of the last colour of the heat maps.
const Z_MAX: f64 = 5.0;
/// Width of the heat maps on the page, in pixels.
const WIDTH: usize = 400;

/// The images of a failed test.
pub(super) struct Shown {
    /// The names of the images.
    pub names: [String; 2],
    /// The tested image, and the image that it is compared with.
    pub images: [Image; 2],
    /// |z| of each pixel, if the variances are known.
    pub scores: Option<Image>,
}

impl Shown {
    /// Writes the images below a folder, as `SCENE.exr` (`SCENE-NAME.exr` if the second image is not a reference) and
    /// `SCENE-heat.png`. Returns a viewer of them.
    pub fn write(&self, folder: &Path, name: &str, message: &str) -> Result<Html> {
        let base = folder.join(Path::new(name).with_extension(""));
        if let Some(folder) = base.parent() {
            std::fs::create_dir_all(folder)
                .map_err(|e| Error::output(format!("the folder cannot be made: {e}")).in_file(folder))?;
        }
        let beside = |suffix: &str| {
            let mut path = base.clone().into_os_string();
            path.push(suffix);
            std::path::PathBuf::from(path)
        };
        for (name, image) in self.names.iter().zip(&self.images) {
            image::write(&beside(&format!("-{name}.exr")), image, &WriteOptions::default())?;
        }
        let (what, map) = self.heat();
        let mut html = Html::paragraph(message);
        let [a, b] = &self.images;
        if (a.width, a.height) == (b.width, b.height) {
            let images = self.names.iter().cloned().zip(&self.images).collect();
            let viewer = Viewer {
                title: name.to_owned(),
                images,
                reference: Some(1),
                left: 0,
                right: 1,
                exposure: exposure_of(b),
            };
            html.push(&viewer.html()?);
        }
        if let Some(map) = map {
            image::write(&beside("-heat.png"), &map, &WriteOptions::default())?;
            let images = vec![thumbnail(&map, WIDTH, 0.0)?];
            html.push(&gallery(&[Picture { images, title: what.to_owned(), note: String::new() }]));
        }
        Ok(html)
    }

    /// Returns the heat map and its description.
    fn heat(&self) -> (&'static str, Option<Image>) {
        if let Some(scores) = &self.scores {
            return (
                "|z| of blocks, 0 to 5; cyan: no number",
                Some(heat(scores, HeatScale::Linear { max: Z_MAX })),
            );
        }
        let [a, b] = &self.images;
        let map = error_map(a, b, ErrorKind::RelativeSquared).ok().map(|map| {
            let max = map.data.iter().filter(|v| v.is_finite()).fold(0.0f32, |max, v| max.max(*v));
            heat(&map, HeatScale::Log { max: f64::from(max), decades: 6.0 })
        });
        ("relative squared error, six powers of ten; cyan: no number", map)
    }
}

/// Writes a page with a viewer of each failed test, and a table of all tests.
///
/// # Errors
/// If it cannot be written.
pub fn write_page(path: &Path, title: &str, summary: &str, report: &Report) -> Result<()> {
    let mut page = Page::new(title);
    page.lead(&Html::paragraph(summary));
    for row in &report.rows {
        if let Some(shown) = &row.shown {
            page.section(format!("{} {}", row.status.word(), row.name), shown.clone());
        }
    }
    page.section("Scenes", table(&report.rows).html());
    page.circumstances();
    page.write(path)
}

/// Returns a table of all rows; rows that did not pass come first.
fn table(rows: &[RegressRow]) -> Table {
    let columns = [
        ("", Align::Left),
        ("scene", Align::Left),
        ("spp", Align::Right),
        ("seconds", Align::Right),
        ("", Align::Left),
    ];
    let mut table = Table::new(columns);
    let (good, bad): (Vec<&RegressRow>, Vec<&RegressRow>) =
        rows.iter().partition(|row| row.status == Status::Pass);
    for row in bad.into_iter().chain(good) {
        table.row([
            row.status.word().to_owned(),
            row.name.clone(),
            row.samples_per_pixel.to_string(),
            format!("{:.2}", row.elapsed.as_secs_f64()),
            row.message.clone(),
        ]);
    }
    table
}
