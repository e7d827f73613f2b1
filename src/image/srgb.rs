//! Conversion between linear values and 8-bit sRGB samples.

use super::{Image, Metadata, Tonemap};

/// Decodes an sRGB value, both in [0, 1]. [IEC 61966-2-1]
pub fn from_srgb(encoded: f64) -> f64 {
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// Encodes a linear value as sRGB, both in [0, 1]. [IEC 61966-2-1]
pub fn to_srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Pixels as stored in a PNG or JPEG file.
pub(super) struct BytePixels {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Grey, grey + alpha, RGB or RGB + alpha; alpha is not premultiplied.
    pub(super) channels: usize,
    pub(super) bytes: Vec<u8>,
}

/// The type of a decoded file's samples.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum SampleRange {
    /// Integers up to this maximum, given as fractions of it, and sRGB-encoded.
    Integer(u16),
    /// Linear floats.
    Float,
}

/// Decoded pixels of a PNG, JPEG, BMP, TGA or HDR file, with `channels` as in [`BytePixels`].
pub(super) struct Raster {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) channels: usize,
    pub(super) depth: SampleRange,
    pub(super) samples: Vec<f32>,
}

/// StoredSamples as stored in a file.
pub(super) enum StoredSamples {
    /// 8 bits, sRGB-encoded.
    Bytes(Vec<u8>),
    /// 16 bits, sRGB-encoded.
    Shorts(Vec<u16>),
    /// Linear floats.
    Floats(Vec<f32>),
}

/// Pixels with samples as stored in a file, with `channels` as in [`BytePixels`].
pub(super) struct StoredPixels {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) channels: usize,
    pub(super) samples: StoredSamples,
}

impl From<StoredPixels> for Raster {
    fn from(stored: StoredPixels) -> Self {
        let StoredPixels { width, height, channels, samples } = stored;
        let (depth, samples) = match samples {
            StoredSamples::Bytes(v) => (SampleRange::Integer(255), fractions(v, 255.0)),
            StoredSamples::Shorts(v) => (SampleRange::Integer(65535), fractions(v, 65535.0)),
            StoredSamples::Floats(v) => (SampleRange::Float, v),
        };
        Raster { width, height, channels, depth, samples }
    }
}

/// Converts integer samples to fractions of the maximum.
fn fractions<T: Into<f32>>(samples: Vec<T>, top: f32) -> Vec<f32> {
    samples.into_iter().map(|v| v.into() / top).collect()
}

/// Returns the channel names of a file with the given number of channels.
fn names(channels: usize) -> &'static [&'static str] {
    match channels {
        1 => &["Y"],
        2 => &["Y", "A"],
        3 => &["R", "G", "B"],
        _ => &["R", "G", "B", "A"],
    }
}

/// Decodes a file's samples to linear values with premultiplied alpha.
pub(super) fn decode(raster: Raster) -> Image {
    let Raster { width, height, channels, depth, mut samples } = raster;
    let has_alpha = channels % 2 == 0;
    if let SampleRange::Integer(top) = depth {
        let scale = f64::from(top);
        let table: Vec<f32> = (0..=top).map(|i| from_srgb(f64::from(i) / scale) as f32).collect();
        let code = |value: f32| (f64::from(value) * scale).round().clamp(0.0, scale);
        for pixel in samples.chunks_exact_mut(channels) {
            let colours = channels - usize::from(has_alpha);
            let mut alpha = 1.0;
            if has_alpha {
                alpha = (code(pixel[colours]) / scale) as f32;
                pixel[colours] = alpha;
            }
            for value in &mut pixel[..colours] {
                *value = table[code(*value) as usize] * alpha;
            }
        }
    }
    let channels = names(channels).iter().map(|&name| name.to_owned()).collect();
    Image { width, height, channels, data: samples, metadata: Metadata::new() }
}

/// Returns an ordered-dither threshold in (0, 1) from the 8x8 Bayer matrix [Bayer 1973]. It is deterministic and does
/// not change exact 8-bit values.
fn threshold(x: usize, y: usize) -> f64 {
    let (x, y) = (x as u32, y as u32);
    let mixed = x ^ y;
    let rank = (0..3).fold(0, |rank, bit| {
        let (m, v) = ((mixed >> bit) & 1, (y >> bit) & 1);
        (rank << 2) | (m << 1) | v
    });
    (f64::from(rank) + 0.5) / 64.0
}

/// Returns the 8-bit value of an encoded value in [0, 1] with the given dither threshold; NaN becomes 0.
fn quantise(encoded: f64, threshold: f64) -> u8 {
    (encoded.clamp(0.0, 1.0) * 255.0 + threshold).floor() as u8
}

/// Encodes the base layer of an image with 8 bits per channel after scaling by 2^`exposure`. `None` if the image has
/// no base layer. Other layers are omitted.
pub(super) fn encode(image: &Image, exposure: f32, tonemap: Tonemap, keep_alpha: bool) -> Option<BytePixels> {
    let rgb = image.rgb_channels()?;
    let colours: &[usize] = if rgb[0] == rgb[1] { &rgb[..1] } else { &rgb };
    let alpha = image.channel("A").filter(|&a| keep_alpha && !colours.contains(&a));
    let channels = colours.len() + usize::from(alpha.is_some());
    let gain = f64::from(exposure).exp2();
    let mut bytes = Vec::with_capacity(image.width * image.height * channels);
    for y in 0..image.height {
        for x in 0..image.width {
            let pixel = image.pixel(x, y);
            let t = threshold(x, y);
            let a = alpha.map_or(1.0, |a| f64::from(pixel[a]));
            let unmultiply = if a > 0.0 { gain / a } else { 0.0 };
            let encoded = tonemap.encode(rgb.map(|c| f64::from(pixel[c]) * unmultiply));
            bytes.extend(encoded[..colours.len()].iter().map(|v| quantise(*v, t)));
            if alpha.is_some() {
                bytes.push((a.clamp(0.0, 1.0) * 255.0).round() as u8);
            }
        }
    }
    Some(BytePixels { width: image.width, height: image.height, channels, bytes })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transfer_function_has_its_published_values_and_an_inverse() {
        assert!((to_srgb(0.18) - 0.461_356).abs() < 1e-6);
        assert!((from_srgb(0.5) - 0.214_041).abs() < 1e-6);
        for i in 0..=1000 {
            let v = f64::from(i) / 1000.0;
            assert!((to_srgb(from_srgb(v)) - v).abs() < 1e-7, "{v}");
        }
    }

    #[test]
    fn every_code_survives_decoding_and_encoding_at_every_dither_threshold() {
        for code in 0..=255u8 {
            let linear = from_srgb(f64::from(code) / 255.0) as f32;
            for i in 0..64 {
                assert_eq!(quantise(to_srgb(f64::from(linear)), threshold(i % 8, i / 8)), code);
            }
        }
    }

    #[test]
    fn the_dither_uses_each_threshold_once_and_keeps_the_mean() {
        let mut seen: Vec<f64> = (0..64).map(|i| threshold(i % 8, i / 8)).collect();
        seen.sort_by(f64::total_cmp);
        let expected: Vec<f64> = (0..64).map(|i| (f64::from(i) + 0.5) / 64.0).collect();
        assert_eq!(seen, expected);
        let value = 100.3 / 255.0;
        let sum: u32 = (0..64).map(|i| u32::from(quantise(value, threshold(i % 8, i / 8)))).sum();
        assert!((f64::from(sum) / 64.0 - 100.3).abs() < 0.01);
    }

    #[test]
    fn values_out_of_range_and_nan_are_given_the_nearest_code() {
        let mut image = Image::new(4, 1, &["Y"]);
        image.data = vec![f32::NAN, -1.0, 9.0, f32::INFINITY];
        assert_eq!(encode(&image, 0.0, Tonemap::None, true).unwrap().bytes, [0, 0, 255, 255]);
    }

    #[test]
    fn exposure_scales_by_powers_of_two_and_alpha_is_divided_out() {
        let mut image = Image::new(1, 1, &["R", "G", "B", "A"]);
        image.data = vec![0.125, 0.25, 0.0, 0.5];
        let bytes = encode(&image, 1.0, Tonemap::None, true).unwrap();
        assert_eq!(bytes.channels, 4);
        assert_eq!(bytes.bytes, [quantise(to_srgb(0.5), threshold(0, 0)), 255, 0, 128]);
        assert_eq!(encode(&image, 1.0, Tonemap::None, false).unwrap().channels, 3);
    }
}
