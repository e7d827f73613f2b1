//! Properties that are colours: numbers, `<rgb>` and `<spectrum>`, checked for what they stand for.

use super::{Builder, unsupported};
use crate::color::Rgb;
use crate::color::spectrum::{Quantity, Spectrum};
use crate::error::Result;
use crate::loader::graph::{Property, Value};
use crate::loader::props::Props;
use crate::loader::values;

impl Builder<'_> {
    /// A colour property, or the default.
    ///
    /// A number is neutral, also as emission (a constant `<spectrum>` is equal-energy white then).
    ///
    /// # Errors
    /// A wrong type, a texture, a negative channel, a reflectance over 1.
    pub fn colour(
        &mut self,
        props: &Props,
        name: &'static str,
        quantity: Quantity,
        default: f32,
    ) -> Result<Rgb> {
        if let Some(object) = props.named_child(name) {
            return Err(unsupported(object));
        }
        let Some(property) = props.find(name) else { return Ok(Rgb::splat(default)) };
        let rgb = match &property.value {
            Value::Float(v) => Rgb::splat(*v as f32),
            Value::Integer(v) => Rgb::splat(*v as f32),
            Value::Rgb(v) => v.map(|c| c as f32).into(),
            Value::Spectrum(spectrum) => self.reduce(property, spectrum, quantity),
            Value::SpectrumFile(file) => {
                let Some(spectrum) = self.spectrum_file(property, file)? else {
                    return Ok(Rgb::splat(default));
                };
                self.reduce(property, &spectrum, quantity)
            }
            _ => return Err(property.error(format!("expected a colour, found a {}", property.tag))),
        };
        let expected = match quantity {
            Quantity::Reflectance if rgb.is_valid() && rgb.max_component() <= 1.0 => return Ok(rgb),
            Quantity::Unbounded | Quantity::Emission if rgb.is_valid() => return Ok(rgb),
            Quantity::Reflectance => "expected values from 0 to 1",
            Quantity::Unbounded | Quantity::Emission => "expected values of at least 0",
        };
        Err(property.error(format!("{expected}, found {}, {}, {}", rgb.r, rgb.g, rgb.b)))
    }

    fn reduce(&mut self, property: &Property, spectrum: &Spectrum, quantity: Quantity) -> Rgb {
        let reduced = spectrum.to_rgb(quantity);
        if let Some(raw) = reduced.out_of_gamut {
            let message = format!(
                "the spectrum's colour {:.3}, {:.3}, {:.3} is out of range and clamped",
                raw.r, raw.g, raw.b
            );
            self.loaded.warnings.push(property.error(message));
        }
        reduced.rgb
    }

    /// Reads a spectrum's file; a missing one is remembered.
    fn spectrum_file(&mut self, property: &Property, file: &str) -> Result<Option<Spectrum>> {
        let Some(path) = self.folders.find(property.spot.file(), file) else {
            self.missing.push(property.error(format!("there is no file {}", values::quoted(file))));
            return Ok(None);
        };
        let text = crate::loader::read_text(&path)?;
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
