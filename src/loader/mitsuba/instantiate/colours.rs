//! Colour properties: numbers, `<rgb>` and `<spectrum>`, checked for the range of their quantity.

use super::Builder;
use crate::color::Rgb;
use crate::color::spectrum::{Quantity, Spectrum, VISIBLE, black_body};
use crate::error::Result;
use crate::loader::mitsuba::graph::{ObjectId, Property, Value};
use crate::loader::mitsuba::props::Props;
use crate::loader::mitsuba::values;
use crate::material::Input;
use crate::util::wording::quoted;
use std::ops::RangeInclusive;

/// A texture with the same value everywhere, which is not converted.
pub const RAW: &str = "rawconstant";

impl Builder<'_> {
    /// Returns a colour property, or the default.
    ///
    /// A number is neutral, also as an emission, for which a constant `<spectrum>` is equal-energy white.
    ///
    /// # Errors
    /// If the type is wrong, there is a texture or a negative channel, or a reflectance is greater than 1.
    pub fn colour(
        &mut self,
        props: &Props,
        name: &'static str,
        quantity: Quantity,
        default: f32,
    ) -> Result<Rgb> {
        if let Some(object) = props.named_child(name) {
            return match self.spectrum_plugin(object, quantity)? {
                Some(rgb) => Ok(rgb),
                None => {
                    Err(self.graph.objects[object]
                        .error("expected the same colour everywhere, found a texture"))
                }
            };
        }
        let Some(property) = props.find(name) else { return Ok(Rgb::splat(default)) };
        let rgb = match &property.value {
            Value::Float(v) => Rgb::splat(*v as f32),
            Value::Integer(v) => Rgb::splat(*v as f32),
            Value::Rgb(v) => v.map(|c| c as f32).into(),
            // As in the plugin `rawconstant`.
            Value::Vector(v) if props.object.plugin == RAW => v.to_array().map(|c| c as f32).into(),
            Value::Spectrum(spectrum) => self.reduce(property, spectrum, quantity),
            Value::SpectrumFile(file) => {
                let Some(spectrum) = self.spectrum_file(property, file)? else {
                    return Ok(Rgb::splat(default));
                };
                self.reduce(property, &spectrum, quantity)
            }
            _ => return Err(property.error(format!("expected a colour, found a {}", property.tag))),
        };
        match out_of_range(rgb, quantity) {
            None => Ok(rgb),
            Some(message) => Err(property.error(message)),
        }
    }

    /// Returns a colour property that may be a texture, or the default.
    ///
    /// # Errors
    /// As for [`colour`](Self::colour), and the errors of the texture.
    pub fn color_input(
        &mut self,
        props: &Props,
        name: &'static str,
        quantity: Quantity,
        default: f32,
    ) -> Result<Input<Rgb>> {
        let Some(object) = props.named_child(name) else {
            return Ok(Input::Constant(self.colour(props, name, quantity, default)?));
        };
        Ok(match self.spectrum_plugin(object, quantity)? {
            Some(rgb) => Input::Constant(rgb),
            None => Input::Texture(self.texture(object)?),
        })
    }

    /// Returns a number in a range that may be a texture, or the default.
    ///
    /// # Errors
    /// If the type is wrong or the number is out of the range, and the errors of the texture.
    pub fn number_input(
        &mut self,
        props: &Props,
        name: &'static str,
        default: f32,
        range: RangeInclusive<f32>,
    ) -> Result<Input<f32>> {
        let spectrum = props.named_child(name);
        let value = if let Some(object) = spectrum {
            match self.spectrum_plugin(object, Quantity::Unbounded)? {
                Some(rgb) => mean(rgb),
                None => return Ok(Input::Texture(self.texture(object)?)),
            }
        } else {
            match props.find(name).map(|property| &property.value) {
                Some(Value::Rgb(_) | Value::Spectrum(_) | Value::SpectrumFile(_)) => {
                    mean(self.colour(props, name, Quantity::Unbounded, default)?)
                }
                _ => props.float(name)?.map_or(default, |v| v as f32),
            }
        };
        if range.contains(&value) {
            return Ok(Input::Constant(value));
        }
        let expected = match (*range.start(), *range.end()) {
            (f32::MIN_POSITIVE, f32::MAX) => "expected a number greater than 0".to_owned(),
            (0.0, f32::MAX) => "expected a number of at least 0".to_owned(),
            (low, high) => format!("expected a number from {low} to {high}"),
        };
        Err(match spectrum {
            Some(object) => self.graph.objects[object].error(format!("{expected}, found {value}")),
            None => props.refusal(name, &expected),
        })
    }

    /// Returns the colour of an object that is a spectrum (`d65`, `blackbody`, ...); `None` if it is a texture.
    fn spectrum_plugin(&mut self, object: ObjectId, quantity: Quantity) -> Result<Option<Rgb>> {
        let props = Props::new(self.graph, object);
        let rgb = match props.object.plugin.as_str() {
            "d65" => {
                let color = self.colour(&props, "color", quantity, 1.0)?;
                color * props.float("scale")?.unwrap_or(1.0) as f32
            }
            RAW => self.required_colour(&props, quantity)?,
            "uniform" => Rgb::splat(props.float("value")?.unwrap_or(1.0) as f32),
            "srgb" | "rgb" => {
                let name = if props.has("value") { "value" } else { "color" };
                self.colour(&props, name, quantity, 0.5)?
            }
            "regular" | "irregular" | "blackbody" => {
                let spectrum = spectrum_samples(&props)?;
                let reduced = spectrum.to_rgb(quantity);
                if let Some(raw) = reduced.out_of_gamut {
                    self.loaded.warnings.push(props.object.error(out_of_gamut(raw)));
                }
                reduced.rgb
            }
            _ => return Ok(None),
        };
        if let Some(message) = out_of_range(rgb, quantity) {
            return Err(props.object.error(message));
        }
        self.finish(props);
        Ok(Some(rgb))
    }

    fn reduce(&mut self, property: &Property, spectrum: &Spectrum, quantity: Quantity) -> Rgb {
        let reduced = spectrum.to_rgb(quantity);
        if let Some(raw) = reduced.out_of_gamut {
            self.loaded.warnings.push(property.error(out_of_gamut(raw)));
        }
        reduced.rgb
    }

    /// Reads a spectrum's file. A missing file is recorded.
    fn spectrum_file(&mut self, property: &Property, file: &str) -> Result<Option<Spectrum>> {
        let Some(path) = self.folders.find(property.spot.file(), file) else {
            self.missing.push(property.error(format!("there is no file {}", quoted(file))));
            return Ok(None);
        };
        let text = crate::loader::read_text(&path, self.memory)?;
        let spectrum = values::spectrum_file(&text).map_err(|(line, message)| {
            let shown = line.checked_sub(1).and_then(|i| text.lines().nth(i)).unwrap_or_default().to_owned();
            let place = crate::error::Place {
                line: line as u32,
                column: 1,
                text: shown,
                ..crate::error::Place::file(&path)
            };
            crate::error::Error::scene(message).at(place)
        })?;
        Ok(Some(spectrum))
    }
}

/// Returns the number that a colour stands for where a number is expected, as in Mitsuba: the mean of its channels.
fn mean(color: Rgb) -> f32 {
    (color.r + color.g + color.b) / 3.0
}

/// Returns the message about a colour that a quantity cannot have.
fn out_of_range(rgb: Rgb, quantity: Quantity) -> Option<String> {
    let expected = match quantity {
        Quantity::Reflectance if rgb.is_valid() && rgb.max_component() <= 1.0 => return None,
        Quantity::Unbounded | Quantity::Emission if rgb.is_valid() => return None,
        Quantity::Index if rgb.to_array().iter().all(|v| v.is_finite()) => return None,
        Quantity::Reflectance => "values from 0 to 1",
        Quantity::Unbounded | Quantity::Emission => "values of at least 0",
        Quantity::Index => "finite values",
    };
    Some(format!("expected {expected}, found {}, {}, {}", rgb.r, rgb.g, rgb.b))
}

fn out_of_gamut(raw: Rgb) -> String {
    format!("the spectrum's colour {:.3}, {:.3}, {:.3} is out of range and clamped", raw.r, raw.g, raw.b)
}

/// Returns the samples of a `regular`, `irregular` or `blackbody` spectrum.
fn spectrum_samples(props: &Props) -> Result<Spectrum> {
    let list = |name: &'static str| -> Result<Vec<f64>> {
        let Some(text) = props.text(name)? else {
            return Err(props.object.error(format!("the property {name} is missing")));
        };
        let words = text.split(|c: char| c == ',' || c.is_whitespace()).filter(|w| !w.is_empty());
        words.map(|w| values::float(w).map_err(|message| props.error(name, &message))).collect()
    };
    let samples = match props.object.plugin.as_str() {
        "regular" => {
            let values = list("values")?;
            let [low, high] = range(props)?;
            let step = (high - low) / (values.len().max(2) - 1) as f64;
            values.into_iter().enumerate().map(|(i, v)| (low + step * i as f64, v)).collect()
        }
        "irregular" => {
            let (nm, values) = (list("wavelengths")?, list("values")?);
            if nm.len() != values.len() {
                let message = format!(
                    "expected as many wavelengths as values, found {} and {}",
                    nm.len(),
                    values.len()
                );
                return Err(props.object.error(message));
            }
            nm.into_iter().zip(values).collect()
        }
        _ => {
            let temperature = f64::from(props.positive("temperature", 5000.0)?);
            let [low, high] = range(props)?;
            black_body(temperature, [low.max(VISIBLE[0]), high.min(VISIBLE[1])])
        }
    };
    Spectrum::from_samples(samples).map_err(|message| props.object.error(message))
}

/// Returns `wavelength_min` and `wavelength_max`, in nm.
fn range(props: &Props) -> Result<[f64; 2]> {
    let low = props.float("wavelength_min")?.unwrap_or(VISIBLE[0]);
    let high = props.float("wavelength_max")?.unwrap_or(VISIBLE[1]);
    match low > 0.0 && high > low && high.is_finite() {
        true => Ok([low, high]),
        false => Err(props
            .object
            .error("expected wavelength_min to be less than wavelength_max, and both positive")),
    }
}
