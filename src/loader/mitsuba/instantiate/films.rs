//! Films and reconstruction filters.

use super::{Builder, unknown_plugin};
use crate::error::Result;
use crate::film::{ComponentFormat, FilmSettings, Filter, PixelFormat, PixelRect};
use crate::loader::mitsuba::graph::ObjectId;
use crate::loader::mitsuba::props::Props;

pub const SUPPORTED: [&str; 4] = ["hdrfilm", "ldrfilm", "mfilm", "tiledhdrfilm"];
const MITSUBA: [&str; 1] = ["specfilm"];
pub const SUPPORTED_FILTERS: [&str; 6] = ["box", "catmullrom", "gaussian", "lanczos", "mitchell", "tent"];
/// The longest side of an image, in pixels.
const MAX_SIDE: i64 = 65_536;
/// The greatest number of pixels of an image.
const MAX_PIXELS: u64 = 1 << 28;
/// The greatest radius or standard deviation of a filter, in pixels.
const MAX_FILTER: f32 = 100.0;

impl Builder<'_> {
    /// Returns the film inside a sensor, or the default film.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn film(&mut self, sensor: &Props) -> Result<FilmSettings> {
        let Some(object) = sensor.child("film")? else { return Ok(FilmSettings::default()) };
        let props = Props::new(self.graph, object);
        let for_display = match props.object.plugin.as_str() {
            "hdrfilm" | "tiledhdrfilm" => false,
            "ldrfilm" => true,
            "mfilm" => {
                self.note("mfilm: the output file decides the format of the image");
                self.ignore(&props, &["file_format", "digits", "variable"], "it describes a text file");
                false
            }
            _ => {
                let unknown = Err(unknown_plugin(props.object, &SUPPORTED, &MITSUBA));
                self.or_stand_in(unknown, "read as hdrfilm", |_| false)?
            }
        };
        let default = FilmSettings::default();
        let side = |name, default: u32| Ok(props.integer(name, 1..=MAX_SIDE)?.map_or(default, |v| v as u32));
        let (width, height) = (side("width", default.width)?, side("height", default.height)?);
        if u64::from(width) * u64::from(height) > MAX_PIXELS {
            return Err(props
                .object
                .error(format!("expected at most {MAX_PIXELS} pixels, found {width} x {height}")));
        }
        let filter = match props.child("rfilter")? {
            Some(filter) => {
                let read = self.filter(filter);
                self.or_stand_in(read, "replaced by the default", |_| default.filter)?
            }
            None => default.filter,
        };
        let film = FilmSettings {
            width,
            height,
            crop: crop(&props, width, height)?,
            filter,
            pixel_format: pixel_format(&props)?,
            component_format: component_format(&props)?,
            for_display,
        };
        let formats: &[(&str, ())] = match for_display {
            false => &[("openexr", ()), ("exr", ()), ("rgbe", ()), ("pfm", ())],
            true => &[("png", ()), ("jpeg", ())],
        };
        if props.object.plugin != "mfilm" {
            props.choice("file_format", formats, ())?;
        }
        if for_display {
            for name in ["gamma", "exposure", "tonemap_method", "key", "burn"] {
                if props.find(name).is_some() {
                    self.approximate(format!(
                        "ldrfilm: {name} is ignored: the picture is written with the transfer curve of sRGB, as it is"
                    ));
                }
            }
        }
        if props.object.old {
            if !for_display {
                self.ignore(&props, &["gamma"], "the values of the image are linear");
            }
            self.ignore(&props, &["filename"], "the command line names the image");
        }
        props.find("banner");
        self.ignore(&props, &["sample_border"], "a sample belongs to one pixel, so borders need none");
        self.ignore(&props, &["compensate"], "sums are always compensated");
        self.finish(props);
        Ok(film)
    }

    /// Returns a reconstruction filter.
    fn filter(&mut self, object: ObjectId) -> Result<Filter> {
        let props = Props::new(self.graph, object);
        let width = |name, default| {
            let value = props.positive(name, default)?;
            match value <= MAX_FILTER {
                true => Ok(value),
                false => Err(props.refusal(name, &format!("expected at most {MAX_FILTER} pixels"))),
            }
        };
        let filter = match props.object.plugin.as_str() {
            "box" => Filter::Box { radius: 0.5 },
            "tent" => Filter::Tent { radius: width("radius", 1.0)? },
            "gaussian" => Filter::Gaussian { stddev: width("stddev", 0.5)? },
            "mitchell" => Filter::Mitchell { b: coefficient(&props, "B")?, c: coefficient(&props, "C")? },
            "catmullrom" => Filter::CatmullRom,
            "lanczos" => {
                let lobes = props.integer("lobes", 1..=i64::from(MAX_FILTER as u32))?;
                Filter::Lanczos { lobes: lobes.map_or(3, |n| n as u32) }
            }
            _ => return Err(unknown_plugin(props.object, &SUPPORTED_FILTERS, &[])),
        };
        self.finish(props);
        Ok(filter)
    }
}

/// Returns a coefficient of the Mitchell-Netravali filter; 1/3 by default.
fn coefficient(props: &Props, name: &'static str) -> Result<f32> {
    let value = props.float(name)?.unwrap_or(1.0 / 3.0) as f32;
    match value.is_finite() {
        true => Ok(value),
        false => Err(props.refusal(name, "expected a finite number")),
    }
}

/// Returns the crop window; `None` if it is the whole image.
fn crop(props: &Props, width: u32, height: u32) -> Result<Option<PixelRect>> {
    let get =
        |name, least, default: u32| Ok(props.integer(name, least..=MAX_SIDE)?.map_or(default, |v| v as u32));
    let rect = PixelRect {
        x: get("crop_offset_x", 0, 0)?,
        y: get("crop_offset_y", 0, 0)?,
        width: get("crop_width", 1, width)?,
        height: get("crop_height", 1, height)?,
    };
    if rect.x + rect.width > width || rect.y + rect.height > height {
        let found = format!("{} x {} at {}, {}", rect.width, rect.height, rect.x, rect.y);
        return Err(props
            .object
            .error(format!("expected a crop within the image of {width} x {height}, found {found}")));
    }
    let whole = PixelRect { x: 0, y: 0, width, height };
    Ok((rect != whole).then_some(rect))
}

fn pixel_format(props: &Props) -> Result<PixelFormat> {
    props.choice("pixel_format", &PixelFormat::NAMES, PixelFormat::Rgb)
}

fn component_format(props: &Props) -> Result<ComponentFormat> {
    props.choice("component_format", &ComponentFormat::NAMES, ComponentFormat::Half)
}
