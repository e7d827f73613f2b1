//! The picture that a page gets.
//!
//! Four integers of 32 bits: the number of the picture, its width and height, and the number of planes. Then the planes
//! of red, green, blue and the relative standard error, as halves. All is little-endian.

use crate::estimate::metrics::RELATIVE_FLOOR;
use crate::film::Tile;
use crate::image::Image;
use crate::render::Rendered;
use half::f16;

const PLANES: usize = 4;
const HEADER: usize = 16;

/// Returns the bytes of a picture in addition to the image.
pub fn bytes(pixels: u64) -> u64 {
    pixels.saturating_mul(2 * PLANES as u64).saturating_add(HEADER as u64)
}

/// Encodes a picture.
pub fn encode(number: u32, image: &Image, rendered: &Rendered) -> Vec<u8> {
    let (width, height) = (image.width, image.height);
    let area = width * height;
    let mut bytes = Vec::with_capacity(HEADER + 2 * PLANES * area);
    for value in [number, width as u32, height as u32, PLANES as u32] {
        bytes.extend(value.to_le_bytes());
    }
    let pixels = || image.data.chunks_exact(image.channels.len().max(1));
    for channel in image.rgb_channels().map_or([None; 3], |channels| channels.map(Some)) {
        bytes.extend(pixels().flat_map(|pixel| half(channel.map_or(0.0, |c| pixel[c]))));
    }
    bytes.resize(HEADER + 2 * PLANES * area, 0);
    let errors = &mut bytes[HEADER + 2 * (PLANES - 1) * area..];
    for tile in &rendered.tiles {
        for i in 0..tile.pixel_count() {
            let (x, y) = tile.position(i);
            let [x, y] = [x - rendered.rect.x, y - rendered.rect.y].map(|v| v as usize);
            errors[2 * (y * width + x)..][..2].copy_from_slice(&half(relative_standard_error(tile, i)));
        }
    }
    bytes
}

/// Returns the root of a pixel's part of the relMSE: of the mean over red, green and blue of variance / (mean² + 0.01).
/// NaN if the variance is unknown.
fn relative_standard_error(tile: &Tile, i: usize) -> f32 {
    let parts = [0, 1, 2].map(|c| {
        let estimate = tile.estimate(i, c);
        estimate.variance.map_or(f64::NAN, |v| v / (estimate.mean * estimate.mean + RELATIVE_FLOOR))
    });
    (parts.iter().sum::<f64>() / 3.0).sqrt() as f32
}

/// Returns the half next to a value. A finite value stays finite.
fn half(value: f32) -> [u8; 2] {
    let most = f16::MAX.to_f32();
    f16::from_f32(if value.is_finite() { value.clamp(-most, most) } else { value }).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_infinite_values_become_infinite() {
        let of = |value: f32| f16::from_le_bytes(half(value)).to_f32();
        assert_eq!([0.5, 1e9, -1e9, f32::INFINITY].map(of), [0.5, 65504.0, -65504.0, f32::INFINITY]);
        assert!(of(f32::NAN).is_nan());
    }
}
