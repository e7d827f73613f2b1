//! The film: image size, crop, reconstruction filter, and the sums of samples.

pub mod filter;
pub mod tile;

pub use filter::{FilterSample, FilterSampler};
pub use tile::Tile;

/// A reconstruction filter; radii and standard deviations are in pixels.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Filter {
    /// Constant over `|x| < radius`.
    Box {
        /// Half the width.
        radius: f32,
    },
    /// Linear from 1 at the centre to 0 at `radius`.
    Tent {
        /// Half the width.
        radius: f32,
    },
    /// A Gaussian minus its value at four standard deviations, where it is zero.
    Gaussian {
        /// Standard deviation.
        stddev: f32,
    },
    /// A cubic with negative lobes, of radius 2. [Mitchell and Netravali 1988]
    Mitchell {
        /// B: blur.
        b: f32,
        /// C: ringing.
        c: f32,
    },
    /// The interpolating cubic, of radius 2. [Catmull and Rom 1974]
    CatmullRom,
    /// A windowed sinc.
    Lanczos {
        /// Half the width.
        lobes: u32,
    },
}

/// The channels of an image file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum PixelFormat {
    /// Luminance only.
    Luminance,
    /// Luminance and alpha.
    LuminanceAlpha,
    /// Red, green, blue.
    Rgb,
    /// Red, green, blue and alpha (the fraction of samples that hit something).
    Rgba,
    /// CIE XYZ.
    Xyz,
    /// CIE XYZ and alpha.
    Xyza,
}

/// The sample type of an EXR file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum ComponentFormat {
    /// 16-bit floats; values beyond their range are clamped and counted.
    Half,
    /// 32-bit floats.
    Float,
}

/// A rectangle of pixels. x points to the right and y downwards from the image's top left corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct PixelRect {
    /// Leftmost column.
    pub x: u32,
    /// Topmost row.
    pub y: u32,
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
}

/// The film of a scene description.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct FilmSettings {
    /// Number of columns of the full image.
    pub width: u32,
    /// Number of rows of the full image.
    pub height: u32,
    /// The region to render; `None` for the whole image.
    pub crop: Option<PixelRect>,
    /// The reconstruction filter.
    pub filter: Filter,
    /// The channels of the output.
    pub pixel_format: PixelFormat,
    /// The sample type of the output.
    pub component_format: ComponentFormat,
    /// Whether the image is intended for display; the default format is then PNG.
    pub for_display: bool,
}

impl PixelFormat {
    /// The names in the scene language and in files.
    pub const NAMES: [(&str, PixelFormat); 6] = [
        ("luminance", PixelFormat::Luminance),
        ("luminance_alpha", PixelFormat::LuminanceAlpha),
        ("rgb", PixelFormat::Rgb),
        ("rgba", PixelFormat::Rgba),
        ("xyz", PixelFormat::Xyz),
        ("xyza", PixelFormat::Xyza),
    ];

    /// Returns whether the image has an alpha channel.
    pub fn has_alpha(self) -> bool {
        matches!(self, PixelFormat::LuminanceAlpha | PixelFormat::Rgba | PixelFormat::Xyza)
    }
}

impl ComponentFormat {
    /// The names in the scene language and in files.
    pub const NAMES: [(&str, ComponentFormat); 2] =
        [("float16", ComponentFormat::Half), ("float32", ComponentFormat::Float)];
}

/// As `--crop` takes it: x,y,width,height.
impl std::fmt::Display for PixelRect {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{},{},{},{}", self.x, self.y, self.width, self.height)
    }
}

impl PixelRect {
    /// Returns the number of pixels in the rectangle.
    pub fn area(self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// Returns whether the rectangles have a common pixel.
    pub fn overlaps(self, other: PixelRect) -> bool {
        let along = |start: u32, length: u32, other_start: u32, other_length: u32| {
            start < other_start + other_length && other_start < start + length
        };
        along(self.x, self.width, other.x, other.width) && along(self.y, self.height, other.y, other.height)
    }

    /// Returns the least rectangle that contains both.
    #[must_use]
    pub fn union(self, other: PixelRect) -> PixelRect {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width).max(other.x + other.width);
        let bottom = (self.y + self.height).max(other.y + other.height);
        PixelRect { x, y, width: right - x, height: bottom - y }
    }

    /// Divides the rectangle into at most `count` bands, whose edges are at multiples of `side` rows in the full image.
    pub fn bands(self, count: u64, side: u32) -> Vec<PixelRect> {
        let end = self.y + self.height;
        let (first, last) = (u64::from(self.y / side), u64::from(end.div_ceil(side)));
        let count = count.clamp(1, last - first);
        let edge = |i: u64| {
            let cell = first + (last - first) * i / count;
            (cell as u32 * side).clamp(self.y, end)
        };
        (0..count).map(|i| PixelRect { y: edge(i), height: edge(i + 1) - edge(i), ..self }).collect()
    }

    /// Divides the rectangle, by rows, into cells whose edges are at multiples of `side` in the full image. Cells at
    /// the border may be smaller. So the cells of a crop are parts of those of the image.
    pub fn cells(self, side: u32) -> impl Iterator<Item = PixelRect> {
        let along = move |start: u32, length: u32| {
            let end = start + length;
            (start / side..end.div_ceil(side)).map(move |i| (i * side).max(start)..((i + 1) * side).min(end))
        };
        along(self.y, self.height).flat_map(move |y| {
            along(self.x, self.width).map(move |x| PixelRect {
                x: x.start,
                y: y.start,
                width: x.end - x.start,
                height: y.end - y.start,
            })
        })
    }
}

impl FilmSettings {
    /// Returns the whole image.
    pub fn full_rect(&self) -> PixelRect {
        PixelRect { x: 0, y: 0, width: self.width, height: self.height }
    }

    /// Returns the number of pixels of the whole image.
    pub fn full_area(&self) -> u64 {
        self.full_rect().area()
    }

    /// Returns the region of the image to render.
    pub fn rect(&self) -> PixelRect {
        self.crop.unwrap_or(self.full_rect())
    }
}

impl Default for FilmSettings {
    /// Returns the defaults of Mitsuba's `hdrfilm`.
    fn default() -> Self {
        FilmSettings {
            width: 768,
            height: 576,
            crop: None,
            filter: Filter::Gaussian { stddev: 0.5 },
            pixel_format: PixelFormat::Rgb,
            component_format: ComponentFormat::Half,
            for_display: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_the_rectangle_in_order() {
        let rect = PixelRect { x: 3, y: 5, width: 7, height: 60 };
        let edges =
            |count| rect.bands(count, 16).iter().map(|band| (band.y, band.height)).collect::<Vec<_>>();
        assert_eq!(edges(1), [(5, 60)]);
        assert_eq!(edges(2), [(5, 27), (32, 33)]);
        let five = [(5, 11), (16, 16), (32, 16), (48, 16), (64, 1)];
        assert_eq!((edges(5).as_slice(), edges(1000).as_slice()), (&five[..], &five[..]));
        assert!(rect.bands(3, 16).into_iter().reduce(PixelRect::union) == Some(rect));
        assert!(rect.bands(2, 16).windows(2).all(|pair| !pair[0].overlaps(pair[1])));
        assert!(rect.overlaps(PixelRect { x: 9, y: 64, width: 1, height: 1 }));
        assert!(!rect.overlaps(PixelRect { x: 10, y: 64, width: 1, height: 1 }));
    }

    #[test]
    fn cells_cover_the_rectangle_once() {
        for (x, y, width, height) in [(0, 0, 1, 1), (5, 7, 33, 16), (0, 0, 16_384, 1)] {
            let rect = PixelRect { x, y, width, height };
            assert_eq!(rect.cells(16).map(PixelRect::area).sum::<u64>(), rect.area());
            assert!(rect.cells(16).all(|t| {
                t.x >= x && t.y >= y && t.x + t.width <= x + width && t.y + t.height <= y + height
            }));
        }
    }
}
