//! Images in a page: thumbnails as PNG, and pixel values as packed halves.

use crate::compare::{HeatScale, heat};
use crate::error::{Error, Result};
use crate::estimate::metrics::relative_by_pixel;
use crate::image::{Image, to_srgb};
use ::image::ImageEncoder;
use ::image::codecs::png::PngEncoder;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use half::f16;
use std::io::Write;

/// The relative squared error with the last colour of the heat maps.
pub const HEAT_MAX: f64 = 1.0;
/// The number of powers of ten that the heat maps span.
pub const HEAT_DECADES: f64 = 5.0;

/// Returns the pixel values in Base64, for a script to unpack: the deflated planes of red, green and blue as halves. In
/// each plane, all low bytes precede all high bytes, which compresses best. A half has 11 significant bits;
/// values beyond its range become infinite.
pub(super) fn packed(image: &Image) -> Result<String> {
    let mut planes = Vec::with_capacity(6 * image.width * image.height);
    let colours = image.colours();
    for channel in 0..3 {
        let bytes = || colours.chunks_exact(3).map(|rgb| f16::from_f32(rgb[channel]).to_le_bytes());
        planes.extend(bytes().map(|[low, _]| low));
        planes.extend(bytes().map(|[_, high]| high));
    }
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    let deflated = encoder.write_all(&planes).and_then(|()| encoder.finish());
    let deflated = deflated.map_err(|e| Error::internal(format!("cannot pack an image: {e}")))?;
    Ok(STANDARD.encode(deflated))
}

/// Returns the image scaled by 2^exposure and reduced to a width of at most `width` pixels, as the data URI of a PNG.
///
/// # Errors
/// If the image has no pixel.
pub fn thumbnail(image: &Image, width: usize, exposure: f32) -> Result<String> {
    let small = reduced(image, width);
    png(&small, exposure)
}

/// Returns the relative squared error of each pixel in false colours, reduced like a [`thumbnail`]: a colour is that of
/// the mean error.
///
/// # Errors
/// If the image has no pixel.
///
/// # Panics
/// If the sizes differ.
pub fn error_thumbnail(image: &Image, reference: &Image, width: usize) -> Result<String> {
    let mut errors = Image::new(image.width, image.height, &["Y"]);
    let by_pixel = relative_by_pixel(&image.colours(), &reference.colours(), 3);
    errors.data = by_pixel.into_iter().map(|e| e as f32).collect();
    let scale = HeatScale::Log { max: HEAT_MAX, decades: HEAT_DECADES };
    png(&heat(&reduced(&errors, width), scale), 0.0)
}

/// Reduces the image to a width of at most `width`: means over boxes of pixels. The last box of a row or column may be
/// smaller.
fn reduced(image: &Image, width: usize) -> Image {
    let step = image.width.div_ceil(width.max(1)).max(1);
    let (columns, rows) = (image.width.div_ceil(step), image.height.div_ceil(step));
    let mut small = Image::new(columns, rows, &["R", "G", "B"]);
    let colours = image.colours();
    for y in 0..rows {
        for x in 0..columns {
            let (mut sum, mut n) = ([0.0f64; 3], 0.0);
            for v in y * step..((y + 1) * step).min(image.height) {
                for u in x * step..((x + 1) * step).min(image.width) {
                    let at = 3 * (v * image.width + u);
                    (0..3).for_each(|c| sum[c] += f64::from(colours[at + c]));
                    n += 1.0;
                }
            }
            small.pixel_mut(x, y).copy_from_slice(&sum.map(|s| (s / n) as f32));
        }
    }
    small
}

/// Returns the data URI of a PNG in sRGB.
fn png(image: &Image, exposure: f32) -> Result<String> {
    let scale = f64::from(exposure).exp2();
    let encode = |v: f32| (to_srgb(f64::from(v) * scale).clamp(0.0, 1.0) * 255.0).round() as u8;
    let codes: Vec<u8> = image.colours().into_iter().map(encode).collect();
    let mut bytes = Vec::new();
    let size = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    PngEncoder::new(&mut bytes)
        .write_image(&codes, size(image.width), size(image.height), ::image::ExtendedColorType::Rgb8)
        .map_err(|e| Error::internal(format!("cannot encode a PNG: {e}")))?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    fn ramp(width: usize, height: usize) -> Image {
        let mut image = Image::new(width, height, &["R", "G", "B", "Z"]);
        image.data.iter_mut().enumerate().for_each(|(i, v)| *v = i as f32 * 0.125);
        image
    }

    #[test]
    fn packed_pixels_unpack_to_the_halves() {
        let image = ramp(5, 3);
        let deflated = STANDARD.decode(packed(&image).expect("packs")).expect("Base64");
        let mut planes = Vec::new();
        flate2::read::ZlibDecoder::new(&deflated[..]).read_to_end(&mut planes).expect("deflated");
        let n = 15;
        assert_eq!(planes.len(), 6 * n);
        for (i, pixel) in image.data.chunks_exact(4).enumerate() {
            for c in 0..3 {
                let half = f16::from_le_bytes([planes[2 * c * n + i], planes[(2 * c + 1) * n + i]]);
                assert_eq!(half.to_f32(), pixel[c]);
            }
        }
    }

    #[test]
    fn thumbnails_keep_the_mean_and_fit_the_width() {
        let image = ramp(10, 7);
        let small = reduced(&image, 4);
        assert_eq!((small.width, small.height), (4, 3));
        assert_eq!(
            small.rgb(0, 0)[0],
            (0..3).flat_map(|y| (0..3).map(move |x| (y * 10 + x) as f32 * 0.5)).sum::<f32>() / 9.0
        );
        assert_eq!(reduced(&image, 100).rgb(9, 6), image.rgb(9, 6));
        assert!(thumbnail(&image, 4, 0.0).expect("a PNG").starts_with("data:image/png;base64,iVBOR"));
        assert!(error_thumbnail(&image, &image, 4).is_ok());
        assert!(thumbnail(&Image::new(0, 0, &["R"]), 4, 0.0).is_err());
    }
}
