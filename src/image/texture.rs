//! Texture images, whose samples keep the type of the file.

use std::sync::LazyLock;

use exr::prelude::f16;

use super::Image;
use super::srgb::{StoredPixels, StoredSamples, from_srgb};
use crate::error::{Error, Result};
use crate::math::lanes::{LANES, f32x16};

/// The greatest number of values (pixels times channels) of a texture: 16384 x 16384 pixels with four channels.
pub(super) const MAX_TEXTURE_VALUES: u64 = 1 << 30;

/// The linear values of 8-bit samples.
static LINEAR_8: LazyLock<Vec<f32>> = LazyLock::new(|| (0..=255).map(|i| i as f32 / 255.0).collect());
static SRGB_8: LazyLock<Vec<f32>> = LazyLock::new(|| decoded(255));
/// The linear values of 16-bit samples.
static LINEAR_16: LazyLock<Vec<f32>> = LazyLock::new(|| (0..=65535).map(|i| i as f32 / 65535.0).collect());
static SRGB_16: LazyLock<Vec<f32>> = LazyLock::new(|| decoded(65535));

/// Returns the linear values of sRGB samples up to `top`.
fn decoded(top: u32) -> Vec<f32> {
    (0..=top).map(|i| from_srgb(f64::from(i) / f64::from(top)) as f32).collect()
}

/// An image without alpha: grey, or linear Rec.709 RGB after lookup of its samples.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct TextureImage {
    width: usize,
    height: usize,
    /// The number of channels, 1 or 3.
    channels: usize,
    texels: Texels,
}

/// StoredSamples: rows from the top, pixels from the left, with interleaved channels.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
enum Texels {
    Bytes { codes: Vec<u8>, values: &'static [f32] },
    Shorts { codes: Vec<u16>, values: &'static [f32] },
    Halves(Vec<f16>),
    Floats(Vec<f32>),
}

/// The colours and alpha of an image file.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureLayers {
    /// The colours, not premultiplied by alpha.
    pub color: TextureImage,
    /// Alpha as a grey image of linear values; `None` if the file has no alpha.
    pub alpha: Option<TextureImage>,
}

impl TextureLayers {
    /// Separates colour and alpha of a file's samples.
    pub(super) fn from_stored(codes: StoredPixels) -> Self {
        let (width, height, n) = (codes.width, codes.height, codes.channels);
        let alpha = n.is_multiple_of(2).then(|| {
            let texels = match &codes.samples {
                StoredSamples::Bytes(v) => Texels::Bytes { codes: channel(v, n, n - 1), values: &LINEAR_8 },
                StoredSamples::Shorts(v) => {
                    Texels::Shorts { codes: channel(v, n, n - 1), values: &LINEAR_16 }
                }
                StoredSamples::Floats(v) => Texels::of_floats(channel(v, n, n - 1)),
            };
            TextureImage { width, height, channels: 1, texels }
        });
        TextureLayers { color: TextureImage::from_stored(codes), alpha }
    }
}

/// Returns the samples of one channel.
fn channel<T: Copy>(samples: &[T], channels: usize, c: usize) -> Vec<T> {
    samples.iter().skip(c).step_by(channels).copied().collect()
}

impl TextureImage {
    /// Creates an image from linear values, 1 or 3 for each pixel: rows from the top, pixels from the left.
    ///
    /// # Errors
    /// If there are no pixels, the number of channels is not 1 or 3, or the number of values is wrong.
    pub fn from_floats(width: usize, height: usize, channels: usize, values: Vec<f32>) -> Result<Self> {
        check(width, height, channels, values.len())?;
        Ok(TextureImage { width, height, channels, texels: Texels::of_floats(values) })
    }

    /// Creates an image from sRGB-encoded bytes, 1 or 3 for each pixel: rows from the top, pixels from the left.
    ///
    /// # Errors
    /// As [`from_floats`](Self::from_floats).
    pub fn from_bytes(width: usize, height: usize, channels: usize, codes: Vec<u8>) -> Result<Self> {
        check(width, height, channels, codes.len())?;
        Ok(TextureImage { width, height, channels, texels: Texels::Bytes { codes, values: &SRGB_8 } })
    }

    /// Creates an image from the base layer of another: its red, green and blue, or its grey.
    pub(super) fn from_image(image: &Image) -> Result<Self, String> {
        let Some(rgb) = image.rgb_channels() else {
            let found = image.channels.join(", ");
            return Err(format!("expected a base layer (channels R, G and B, or Y), found {found}"));
        };
        let wanted: &[usize] = if rgb[0] == rgb[1] { &rgb[..1] } else { &rgb };
        let (width, height, channels) = (image.width, image.height, wanted.len());
        let found = (width as u64).saturating_mul(height as u64).saturating_mul(channels as u64);
        if found > MAX_TEXTURE_VALUES {
            return Err(format!("expected at most {MAX_TEXTURE_VALUES} values, found {found}"));
        }
        let mut values = Vec::with_capacity(width * height * channels);
        for pixel in image.data.chunks_exact(image.channels.len()) {
            values.extend(wanted.iter().map(|&c| pixel[c]));
        }
        Ok(TextureImage { width, height, channels, texels: Texels::of_floats(values) })
    }

    /// Creates an image from a file's samples.
    pub(super) fn from_stored(codes: StoredPixels) -> Self {
        let StoredPixels { width, height, channels, samples } = codes;
        let texels = match samples {
            StoredSamples::Bytes(v) => Texels::Bytes { codes: without_alpha(v, channels), values: &SRGB_8 },
            StoredSamples::Shorts(v) => {
                Texels::Shorts { codes: without_alpha(v, channels), values: &SRGB_16 }
            }
            StoredSamples::Floats(v) => Texels::of_floats(without_alpha(v, channels)),
        };
        TextureImage { width, height, channels: if channels < 3 { 1 } else { 3 }, texels }
    }

    /// Returns red, green or blue as a grey image; a grey image is returned unchanged.
    ///
    /// # Panics
    /// If `c` is greater than 2.
    pub fn channel(&self, c: usize) -> TextureImage {
        assert!(c < 3, "channel {c} of a picture");
        if self.is_grey() {
            return self.clone();
        }
        let texels = match &self.texels {
            Texels::Bytes { codes, values } => Texels::Bytes { codes: channel(codes, 3, c), values },
            Texels::Shorts { codes, values } => Texels::Shorts { codes: channel(codes, 3, c), values },
            Texels::Halves(values) => Texels::Halves(channel(values, 3, c)),
            Texels::Floats(values) => Texels::Floats(channel(values, 3, c)),
        };
        TextureImage { channels: 1, texels, ..*self }
    }

    /// Returns the number of pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns whether each pixel has one value instead of three.
    pub fn is_grey(&self) -> bool {
        self.channels == 1
    }

    /// Returns whether the samples are sRGB-encoded; otherwise they are linear.
    pub fn is_srgb(&self) -> bool {
        match &self.texels {
            Texels::Bytes { values, .. } => values[1] != LINEAR_8[1],
            Texels::Shorts { values, .. } => values[1] != LINEAR_16[1],
            Texels::Halves(_) | Texels::Floats(_) => false,
        }
    }

    /// Reinterprets the samples as linear: integers become fractions of the maximum.
    pub fn as_linear(mut self) -> Self {
        match &mut self.texels {
            Texels::Bytes { values, .. } => *values = &LINEAR_8,
            Texels::Shorts { values, .. } => *values = &LINEAR_16,
            Texels::Halves(_) | Texels::Floats(_) => {}
        }
        self
    }

    /// Returns the linear colour of a pixel. `(0, 0)` is the top left pixel.
    ///
    /// # Panics
    /// If the pixel is outside the image.
    #[inline]
    pub fn rgb(&self, x: usize, y: usize) -> [f32; 3] {
        assert!(x < self.width, "column {x} of a texture {} wide", self.width);
        let at = (y * self.width + x) * self.channels;
        match &self.texels {
            Texels::Bytes { codes, values } => self.pixel(&codes[at..], |v| values[usize::from(v)]),
            Texels::Shorts { codes, values } => self.pixel(&codes[at..], |v| values[usize::from(v)]),
            Texels::Halves(values) => self.pixel(&values[at..], of_half),
            Texels::Floats(values) => self.pixel(&values[at..], |v| v),
        }
    }

    /// Returns the linear colour between the pixels in two columns and two rows. The weights of the second column and
    /// row are `at`.
    ///
    /// # Panics
    /// If a pixel is outside the image.
    #[inline]
    pub fn bilinear(&self, columns: [usize; 2], rows: [usize; 2], at: [f32; 2]) -> [f32; 3] {
        match &self.texels {
            Texels::Bytes { codes, values } => {
                let values: &[f32; 256] = values[..].try_into().expect("a value for each byte");
                self.bilinear_of(codes, columns, rows, at, |v| values[usize::from(v)])
            }
            Texels::Shorts { codes, values } => {
                self.bilinear_of(codes, columns, rows, at, |v| values[usize::from(v)])
            }
            Texels::Halves(values) => self.bilinear_of(values, columns, rows, at, of_half),
            Texels::Floats(values) => self.bilinear_of(values, columns, rows, at, |v| v),
        }
    }

    /// Computes [`bilinear`](Self::bilinear) for samples of one type.
    #[inline(always)]
    fn bilinear_of<T: Copy>(
        &self,
        samples: &[T],
        [left, right]: [usize; 2],
        [top, bottom]: [usize; 2],
        [s, t]: [f32; 2],
        value: impl Fn(T) -> f32,
    ) -> [f32; 3] {
        assert!(left.max(right) < self.width, "columns {left} and {right} of a texture {} wide", self.width);
        let pixel = |x: usize, y: usize| {
            let start = (y * self.width + x) * self.channels;
            &samples[start..start + self.channels]
        };
        let (a, b, c, d) = (pixel(left, top), pixel(right, top), pixel(left, bottom), pixel(right, bottom));
        let lerp = |a: f32, b: f32, t: f32| a * (1.0 - t) + b * t;
        let channel = |i: usize| {
            let upper = lerp(value(a[i]), value(b[i]), s);
            lerp(upper, lerp(value(c[i]), value(d[i]), s), t)
        };
        if self.channels == 3 { [channel(0), channel(1), channel(2)] } else { [channel(0); 3] }
    }

    /// Computes [`bilinear`](Self::bilinear) in sixteen lanes.
    ///
    /// # Panics
    /// If a pixel is outside the image.
    #[inline]
    pub fn bilinear_x16(
        &self,
        columns: &[[usize; LANES]; 2],
        rows: &[[usize; LANES]; 2],
        at: [f32x16; 2],
    ) -> [f32x16; 3] {
        match &self.texels {
            Texels::Bytes { codes, values } => {
                let values: &[f32; 256] = values[..].try_into().expect("a value for each byte");
                self.bilinear_of_x16(codes, columns, rows, at, |v| values[usize::from(v)])
            }
            Texels::Shorts { codes, values } => {
                self.bilinear_of_x16(codes, columns, rows, at, |v| values[usize::from(v)])
            }
            Texels::Halves(values) => self.bilinear_of_x16(values, columns, rows, at, of_half),
            Texels::Floats(values) => self.bilinear_of_x16(values, columns, rows, at, |v| v),
        }
    }

    /// Computes [`bilinear_x16`](Self::bilinear_x16) for samples of one type.
    #[inline(always)]
    fn bilinear_of_x16<T: Copy>(
        &self,
        samples: &[T],
        columns: &[[usize; LANES]; 2],
        rows: &[[usize; LANES]; 2],
        [s, t]: [f32x16; 2],
        value: impl Fn(T) -> f32,
    ) -> [f32x16; 3] {
        let (width, channels) = (self.width, self.channels);
        assert!(columns.iter().flatten().all(|&x| x < width), "columns of a texture {width} wide");
        // For each corner and channel, a value in each lane.
        let mut texels = [[[0.0; LANES]; 3]; 4];
        for (corner, channel) in texels.iter_mut().enumerate() {
            let (columns, rows) = (&columns[corner & 1], &rows[corner >> 1]);
            for i in 0..LANES {
                let start = (rows[i] * width + columns[i]) * channels;
                for (c, &v) in samples[start..start + channels].iter().enumerate().take(3) {
                    channel[c][i] = value(v);
                }
            }
        }
        let lerp = |a: f32x16, b: f32x16, t: f32x16| a * (f32x16::ONE - t) + b * t;
        let channel = |c: usize| {
            let [a, b, below_a, below_b] = [0, 1, 2, 3].map(|corner: usize| f32x16::new(texels[corner][c]));
            lerp(lerp(a, b, s), lerp(below_a, below_b, s), t)
        };
        if channels == 3 { [channel(0), channel(1), channel(2)] } else { [channel(0); 3] }
    }

    /// Returns the colour of the first pixel in `samples`.
    #[inline]
    fn pixel<T: Copy>(&self, samples: &[T], value: impl Fn(T) -> f32) -> [f32; 3] {
        match *samples {
            [r, g, b, ..] if self.channels == 3 => [value(r), value(g), value(b)],
            _ => [value(samples[0]); 3],
        }
    }

    /// Returns the bytes of the samples.
    pub fn memory_bytes(&self) -> usize {
        match &self.texels {
            Texels::Bytes { codes, .. } => codes.len(),
            Texels::Shorts { codes, .. } => 2 * codes.len(),
            Texels::Halves(values) => 2 * values.len(),
            Texels::Floats(values) => 4 * values.len(),
        }
    }
}

impl Texels {
    /// Stores halves if all values are finite and exactly representable, otherwise floats.
    fn of_floats(values: Vec<f32>) -> Texels {
        if values.iter().all(|v| v.is_finite() && f16::from_f32(*v).to_f32().to_bits() == v.to_bits()) {
            return Texels::Halves(values.into_iter().map(f16::from_f32).collect());
        }
        Texels::Floats(values)
    }
}

/// Returns the value of a finite half, inline, without asking what the processor can do.
#[inline(always)]
fn of_half(half: f16) -> f32 {
    let (sign, magnitude) = (u32::from(half.to_bits() & 0x8000) << 16, u32::from(half.to_bits() & 0x7fff));
    // The bits of a float have five more for the exponent's range: its bias is 112 greater.
    const SCALE: f32 = f32::from_bits((127 + 112) << 23);
    f32::from_bits((f32::from_bits(magnitude << 13) * SCALE).to_bits() | sign)
}

/// Removes the alpha channel, if any.
fn without_alpha<T: Copy>(mut samples: Vec<T>, channels: usize) -> Vec<T> {
    if channels.is_multiple_of(2) {
        let mut index = 0usize;
        samples.retain(|_| {
            index += 1;
            !index.is_multiple_of(channels)
        });
        samples.shrink_to_fit();
    }
    samples
}

/// Checks that an image of the given size has the given number of values.
fn check(width: usize, height: usize, channels: usize, found: usize) -> Result<()> {
    if !matches!(channels, 1 | 3) {
        return Err(Error::internal(format!("expected 1 or 3 channels, found {channels}")));
    }
    let expected = width.checked_mul(height).and_then(|n| n.checked_mul(channels));
    if found == 0 || expected != Some(found) {
        let size = format!("{width}x{height} pixels of {channels}");
        return Err(Error::internal(format!("expected the values of {size}, found {found} values")));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_stay_as_small_as_they_are() {
        let bytes = TextureImage::from_bytes(2, 1, 3, vec![200, 100, 50, 0, 1, 255]).unwrap();
        assert_eq!((bytes.memory_bytes(), bytes.is_srgb(), bytes.is_grey()), (6, true, false));
        assert_eq!(bytes.rgb(0, 0), [200, 100, 50].map(|i| from_srgb(f64::from(i) / 255.0) as f32));
        let raw = bytes.as_linear();
        assert_eq!((raw.memory_bytes(), raw.is_srgb()), (6, false));
        assert_eq!(raw.rgb(1, 0), [0.0, 1.0 / 255.0, 1.0]);
        let halves = TextureImage::from_floats(1, 2, 1, vec![0.5, 65504.0]).unwrap();
        assert_eq!((halves.memory_bytes(), halves.rgb(0, 1)), (4, [65504.0; 3]));
        let floats = TextureImage::from_floats(1, 2, 1, vec![0.1, 65536.0]).unwrap();
        assert_eq!((floats.memory_bytes(), floats.rgb(0, 0)), (8, [0.1; 3]));
    }

    #[test]
    fn halves_have_their_values() {
        for bits in 0..=u16::MAX {
            let half = f16::from_bits(bits);
            if half.is_finite() {
                assert_eq!(of_half(half).to_bits(), half.to_f32().to_bits());
            }
        }
    }

    #[test]
    fn alpha_is_left_out() {
        assert_eq!(without_alpha(vec![1, 2, 3, 4, 5, 6, 7, 8], 4), [1, 2, 3, 5, 6, 7]);
        assert_eq!(without_alpha(vec![1, 2, 3, 4], 2), [1, 3]);
        assert_eq!(without_alpha(vec![1, 2, 3], 3), [1, 2, 3]);
    }

    #[test]
    fn channels_and_alpha_become_pictures_of_their_own() {
        let codes = |channels, bytes| StoredPixels {
            width: 2,
            height: 1,
            channels,
            samples: StoredSamples::Bytes(bytes),
        };
        let layers = TextureLayers::from_stored(codes(4, vec![51, 102, 153, 204, 5, 6, 7, 255]));
        let color = layers.color.as_linear();
        assert_eq!([0, 1, 2].map(|c| color.channel(c).rgb(0, 0)), [[0.2; 3], [0.4; 3], [0.6; 3]]);
        assert_eq!(layers.alpha.map(|a| [a.rgb(0, 0), a.rgb(1, 0)]), Some([[0.8; 3], [1.0; 3]]));
        let grey = TextureLayers::from_stored(codes(1, vec![51, 102]));
        assert_eq!((grey.alpha, grey.color.channel(2)), (None, grey.color));
    }

    #[test]
    fn a_wrong_number_of_values_is_refused() {
        let error = TextureImage::from_floats(2, 2, 3, vec![0.0; 11]).unwrap_err();
        assert_eq!(error.to_string(), "expected the values of 2x2 pixels of 3, found 11 values");
        assert!(TextureImage::from_floats(0, 2, 3, vec![]).is_err());
        assert!(TextureImage::from_bytes(1, 1, 2, vec![0; 2]).is_err());
        assert!(TextureImage::from_floats(usize::MAX, 2, 1, vec![0.0]).is_err());
    }
}
