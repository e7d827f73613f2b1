//! The side-by-side viewer: two images with a divider between them, and the values of their pixels.
//!
//! The pixels are in the page as halves, which `page.js` unpacks and shows. Without a script, or in a browser that
//! cannot unpack them, the thumbnails remain.

use super::html::{Html, add, escape};
use super::pixels::{HEAT_DECADES, HEAT_MAX, packed, thumbnail};
use crate::compare::{HeatScale, heat};
use crate::error::{Error, Result};
use crate::image::{Image, to_srgb};

/// Images of one size, shown beside each other.
#[derive(Clone, Debug, Default)]
pub struct Viewer<'a> {
    /// The caption.
    pub title: String,
    /// The images with their names.
    pub images: Vec<(String, &'a Image)>,
    /// Index of the reference for the errors, if there is one.
    pub reference: Option<usize>,
    /// Index of the image that is initially on the left.
    pub left: usize,
    /// Index of the image that is initially on the right.
    pub right: usize,
    /// The initial exposure: the images are scaled by 2^exposure.
    pub exposure: f32,
}

/// The greatest number of pixels of all images in the viewers of a page. It limits the memory of the browser.
pub const MOST_PIXELS: usize = 24_000_000;
/// The width of the thumbnails, in pixels.
const THUMBNAIL: usize = 200;
/// The number of colours in the legend of the heat map.
const STOPS: usize = 16;

impl Viewer<'_> {
    /// Returns the viewer.
    ///
    /// # Errors
    /// If there is no image, sizes differ, or an index is out of range.
    pub fn html(&self) -> Result<Html> {
        self.check()?;
        let first = self.images[0].1;
        let title = escape(&self.title);
        let mut text = format!(
            "<figure class=\"viewer\" data-width=\"{}\" data-height=\"{}\" data-left=\"{}\" data-right=\"{}\" \
             data-reference=\"{}\" data-exposure=\"{}\" data-heat-max=\"{HEAT_MAX}\" \
             data-heat-decades=\"{HEAT_DECADES}\">\n<figcaption>{title}</figcaption>\n",
            first.width,
            first.height,
            self.left,
            self.right,
            self.reference.map_or_else(String::new, |r| r.to_string()),
            self.exposure
        );
        text.push_str(CONTROLS);
        add(
            &mut text,
            format_args!(
                "<div class=\"stage\" hidden>\n<canvas tabindex=\"0\" role=\"img\" aria-label=\"{title}\"></canvas>\n"
            ),
        );
        text.push_str(STAGE);
        add(&mut text, format_args!("{}<ol class=\"images\">\n", heat_legend()));
        for (name, image) in &self.images {
            let address = thumbnail(image, THUMBNAIL, self.exposure)?;
            add(
                &mut text,
                format_args!(
                    "<li><button type=\"button\"><img src=\"{address}\" alt=\"\"><span>{}</span></button></li>\n",
                    escape(name)
                ),
            );
        }
        text.push_str("</ol>\n");
        for (_, image) in &self.images {
            let pixels = packed(image)?;
            add(&mut text, format_args!("<script type=\"text/plain\" class=\"pixels\">{pixels}</script>\n"));
        }
        text.push_str("</figure>\n");
        Ok(Html::raw(text))
    }

    fn check(&self) -> Result<()> {
        let Some((_, first)) = self.images.first() else {
            return Err(Error::internal(format!("the viewer \"{}\" has no image", self.title)));
        };
        let (width, height) = (first.width, first.height);
        if let Some((name, image)) = self.images.iter().find(|(_, i)| (i.width, i.height) != (width, height))
        {
            return Err(Error::internal(format!(
                "the viewer \"{}\": expected {width}x{height} pixels, \"{name}\" has {}x{}",
                self.title, image.width, image.height
            )));
        }
        let indices = [Some(self.left), Some(self.right), self.reference];
        match indices.into_iter().flatten().find(|&i| i >= self.images.len()) {
            Some(i) => Err(Error::internal(format!(
                "the viewer \"{}\": there is no image {i}, there are {}",
                self.title,
                self.images.len()
            ))),
            None => Ok(()),
        }
    }
}

/// Returns an exposure, in steps of ½, at which most of an image is neither black nor white: the 80th percentile of
/// luminance becomes 0.4. Returns 0 if that percentile is 0, or from 0.1 to 1.5.
pub fn exposure_of(image: &Image) -> f32 {
    let colours = image.colours();
    let mut luminances: Vec<f32> =
        colours.chunks_exact(3).map(|c| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]).collect();
    luminances.sort_unstable_by(f32::total_cmp);
    let Some(&bright) = luminances.get(luminances.len() * 4 / 5) else { return 0.0 };
    if !(bright.is_finite() && bright > 0.0) || (0.1..=1.5).contains(&bright) {
        return 0.0;
    }
    ((0.4 / bright).log2() * 2.0).round().clamp(-20.0, 20.0) / 2.0
}

/// Returns the legend of the heat maps: the colours, with their errors.
fn heat_legend() -> String {
    let mut ramp = Image::new(STOPS, 1, &["Y"]);
    (0..STOPS).for_each(|i| ramp.data[i] = i as f32 / (STOPS - 1) as f32);
    let coloured = heat(&ramp, HeatScale::Linear { max: 1.0 });
    let stops: Vec<String> = (0..STOPS)
        .map(|i| coloured.rgb(i, 0).map(|v| (to_srgb(f64::from(v)) * 255.0).round() as u8))
        .map(|[r, g, b]| format!("rgb({r},{g},{b})"))
        .collect();
    let end = super::scale::number(HEAT_MAX);
    let start = super::scale::number(HEAT_MAX / 10f64.powf(HEAT_DECADES));
    format!(
        "<p class=\"heat\"><span>relative squared error: {start}</span>\
         <i style=\"background:linear-gradient(90deg,{})\"></i><span>{end} and more</span></p>\n",
        stops.join(",")
    )
}

const CONTROLS: &str = "<div class=\"controls\" hidden>
<label>Left <select class=\"pick-left\"></select></label>
<label>Right <select class=\"pick-right\"></select></label>
<label class=\"range\">Exposure <input class=\"exposure\" type=\"range\" min=\"-12\" max=\"12\" step=\"0.25\">
<output class=\"ev\"></output></label>
<span class=\"zoom\" role=\"group\" aria-label=\"Zoom\"><button type=\"button\" class=\"out\" aria-label=\"Zoom out\">−</button>
<output class=\"scale\"></output><button type=\"button\" class=\"in\" aria-label=\"Zoom in\">+</button>
<button type=\"button\" class=\"fit\">Fit</button><button type=\"button\" class=\"one\">1:1</button></span>
</div>
";

const STAGE: &str = "<span class=\"name at-left\"></span><span class=\"name at-right\"></span>
<div class=\"divider\" role=\"slider\" tabindex=\"0\" aria-label=\"Divider between left and right\"
 aria-valuemin=\"0\" aria-valuemax=\"100\" aria-valuenow=\"50\"></div>
</div>
<p class=\"readout\" hidden></p>
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_viewers_are_refused_with_a_sentence() {
        let (a, b) = (Image::new(4, 3, &["R", "G", "B"]), Image::new(3, 3, &["Y"]));
        let viewer = |images| Viewer { title: "v".into(), images, ..Viewer::default() };
        let message = |viewer: Viewer<'_>| viewer.html().expect_err("refused").to_string();
        assert_eq!(message(viewer(vec![])), "the viewer \"v\" has no image");
        let both = viewer(vec![("a".into(), &a), ("b".into(), &b)]);
        assert_eq!(message(both), "the viewer \"v\": expected 4x3 pixels, \"b\" has 3x3");
        let far = Viewer { right: 1, ..viewer(vec![("a".into(), &a)]) };
        assert_eq!(message(far), "the viewer \"v\": there is no image 1, there are 1");
    }

    #[test]
    fn names_are_escaped_and_each_image_is_there() {
        let image = Image::new(4, 3, &["R", "G", "B"]);
        let images = vec![("</script><b>".to_string(), &image), ("b".to_string(), &image)];
        let viewer = Viewer { images, reference: Some(0), right: 1, ..Viewer::default() };
        let html = viewer.html().expect("a viewer");
        assert_eq!(html.as_str().matches("class=\"pixels\"").count(), 2);
        assert_eq!(html.as_str().matches("<img ").count(), 2);
        assert!(!html.as_str().contains("<b>"));
    }

    #[test]
    fn exposure_brings_most_pixels_into_sight() {
        let mut image = Image::new(10, 1, &["Y"]);
        assert_eq!(exposure_of(&image), 0.0);
        for (value, exposure) in [(0.5, 0.0), (0.02, 4.5), (100.0, -8.0)] {
            image.data.fill(value);
            assert_eq!(exposure_of(&image), exposure, "{value}");
        }
    }
}
