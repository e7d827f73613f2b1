//! Images: pixels with named channels and metadata, and image files.
//!
//! Values are linear Rec.709 RGB. The base layer has the channels `R`, `G`, `B` (or `Y`). The channels of other
//! layers have names with a dot, such as `albedo.R`, as in OpenEXR. Alpha is premultiplied. PNG and JPEG files are
//! sRGB-encoded; this module encodes and decodes them.
//!
//! OpenImageIO (feature `oiio`) or the crates `exr` and `image` read and write files. Both give the same results;
//! [`backend`] names the one in use.

mod exr_header;
mod format;
mod header;
mod metadata;
mod npy;
#[cfg(feature = "oiio")]
#[allow(unsafe_code)]
mod oiio;
mod pfm;
mod pure;
mod read;
mod srgb;
mod texture;
mod tonemap;
mod write;

pub(crate) use format::Difference;
pub use format::{Backend, backend, set_threads};
pub use metadata::{Metadata, Value};
pub use read::{
    has_high_range, read, read_texture, read_texture_bytes, read_texture_bytes_with,
    read_texture_bytes_within, read_texture_with, read_texture_within, read_with,
};
pub use srgb::{from_srgb, to_srgb};
pub use texture::{TextureImage, TextureLayers};
pub use tonemap::Tonemap;
pub use write::{
    Compression, SampleFormat, WriteOptions, WriteReport, check_output, encoding_bytes, is_display_format,
    write, write_with,
};

/// An image in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// The number of pixels in a row.
    pub width: usize,
    /// The number of rows.
    pub height: usize,
    /// The names of the channels, in the order of a pixel's values.
    pub channels: Vec<String>,
    /// `width * height * channels.len()` values: rows from the top, pixels from the left, with interleaved channels.
    pub data: Vec<f32>,
    /// The metadata.
    pub metadata: Metadata,
}

impl Image {
    /// Creates a black image.
    pub fn new(width: usize, height: usize, channels: &[&str]) -> Self {
        Image {
            width,
            height,
            channels: channels.iter().map(|&c| c.to_owned()).collect(),
            data: vec![0.0; width * height * channels.len()],
            metadata: Metadata::new(),
        }
    }

    /// Returns the values of a pixel, one for each channel. `(0, 0)` is the top left pixel.
    ///
    /// # Panics
    /// If the pixel is outside the image.
    #[inline]
    pub fn pixel(&self, x: usize, y: usize) -> &[f32] {
        assert!(x < self.width, "column {x} of an image {} wide", self.width);
        let n = self.channels.len();
        &self.data[(y * self.width + x) * n..][..n]
    }

    /// Returns the values of a pixel for modification.
    ///
    /// # Panics
    /// If the pixel is outside the image.
    #[inline]
    pub fn pixel_mut(&mut self, x: usize, y: usize) -> &mut [f32] {
        assert!(x < self.width, "column {x} of an image {} wide", self.width);
        let n = self.channels.len();
        &mut self.data[(y * self.width + x) * n..][..n]
    }

    /// Adds channels. `values` has one value of each new channel for each pixel, interleaved.
    ///
    /// # Panics
    /// If the number of values is wrong.
    pub fn append(&mut self, channels: Vec<String>, values: &[f32]) {
        let (before, added) = (self.channels.len(), channels.len());
        assert_eq!(values.len(), self.width * self.height * added, "one value for each pixel and channel");
        let mut data = Vec::with_capacity(self.data.len() + values.len());
        for (pixel, new) in self.data.chunks_exact(before).zip(values.chunks_exact(added)) {
            data.extend_from_slice(pixel);
            data.extend_from_slice(new);
        }
        self.data = data;
        self.channels.extend(channels);
    }

    /// Returns the index of a channel in a pixel.
    pub fn channel(&self, name: &str) -> Option<usize> {
        self.channels.iter().position(|c| c == name)
    }

    /// Returns the indices of red, green and blue. They are equal for a grey image (`Y`, or a single channel). `None`
    /// without a base layer.
    pub fn rgb_channels(&self) -> Option<[usize; 3]> {
        if let (Some(r), Some(g), Some(b)) = (self.channel("R"), self.channel("G"), self.channel("B")) {
            return Some([r, g, b]);
        }
        let grey = self.channel("Y").or((self.channels.len() == 1).then_some(0))?;
        Some([grey; 3])
    }

    /// Returns the colour of a pixel; black if the image has no base layer.
    ///
    /// # Panics
    /// If the pixel is outside the image.
    pub fn rgb(&self, x: usize, y: usize) -> [f32; 3] {
        let pixel = self.pixel(x, y);
        self.rgb_channels().map_or([0.0; 3], |c| c.map(|c| pixel[c]))
    }

    /// Returns the interleaved red, green and blue of all pixels; black if the image has no base layer.
    pub fn colours(&self) -> Vec<f32> {
        let rgb = self.rgb_channels();
        let pixels = self.data.chunks_exact(self.channels.len().max(1));
        pixels.flat_map(|pixel| rgb.map_or([0.0; 3], |c| c.map(|c| pixel[c]))).collect()
    }

    /// Returns an image of some of the channels, in the given order, with the same metadata; `None` if one is
    /// missing.
    pub fn select(&self, names: &[impl AsRef<str>]) -> Option<Image> {
        let indices: Vec<usize> = names.iter().map(|n| self.channel(n.as_ref())).collect::<Option<_>>()?;
        Some(self.select_indices(&indices))
    }

    /// Returns the names of the layers beside the base layer, in the order of their first channels.
    pub fn layers(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for (name, _) in self.channels.iter().filter_map(|channel| channel.rsplit_once('.')) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        names
    }

    /// Returns a layer as the base layer of an image; `None` if there is none of the name. Three channels with other
    /// names, such as X, Y and Z, become R, G and B, and a single one becomes Y.
    pub fn layer(&self, name: &str) -> Option<Image> {
        let of_layer = |channel: &&String| channel.rsplit_once('.').is_some_and(|(layer, _)| layer == name);
        let channels: Vec<&String> = self.channels.iter().filter(of_layer).collect();
        let mut image = self.select(&channels).filter(|image| !image.channels.is_empty())?;
        let names: Vec<&str> =
            channels.iter().filter_map(|channel| Some(channel.rsplit_once('.')?.1)).collect();
        let is_colour = ["R", "G", "B"].iter().all(|c| names.contains(c));
        image.channels = match names.len() {
            1 => vec!["Y".into()],
            3 if !is_colour => ["R", "G", "B"].map(String::from).to_vec(),
            _ => names.into_iter().map(String::from).collect(),
        };
        Some(image)
    }

    /// Returns an image of the channels with the given indices.
    fn select_indices(&self, indices: &[usize]) -> Image {
        let mut data = Vec::with_capacity(self.width * self.height * indices.len());
        for pixel in self.data.chunks_exact(self.channels.len().max(1)) {
            data.extend(indices.iter().map(|&c| pixel[c]));
        }
        Image {
            width: self.width,
            height: self.height,
            channels: indices.iter().map(|&c| self.channels[c].clone()).collect(),
            data,
            metadata: self.metadata.clone(),
        }
    }

    /// Returns the region of the image with the top left corner `(x, y)`; `None` if it is not inside the image.
    pub fn crop(&self, x: usize, y: usize, width: usize, height: usize) -> Option<Image> {
        if x.checked_add(width)? > self.width || y.checked_add(height)? > self.height {
            return None;
        }
        let n = self.channels.len();
        let mut data = Vec::with_capacity(width * height * n);
        for row in y..y + height {
            data.extend_from_slice(&self.data[(row * self.width + x) * n..][..width * n]);
        }
        Some(Image { width, height, channels: self.channels.clone(), data, metadata: self.metadata.clone() })
    }

    /// Sorts the channels in the order that every reader returns: the base layer first (R or Y, G, B, A, then others
    /// by name), then the layers by name, each in the same order.
    fn sort_channels(self) -> Image {
        let mut indices: Vec<usize> = (0..self.channels.len()).collect();
        indices.sort_by_key(|&i| {
            let name = self.channels[i].as_str();
            let (layer, channel) = name.rsplit_once('.').unwrap_or(("", name));
            let rank = match channel {
                "R" => 0,
                "Y" if layer.is_empty() => 0,
                "G" => 1,
                "B" => 2,
                "A" => 3,
                _ => 4,
            };
            (layer, rank, channel)
        });
        if indices.iter().enumerate().all(|(to, &from)| to == from) {
            self
        } else {
            self.select_indices(&indices)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 3x2 pixels whose value identifies their position: 100·channel + 10·y + x.
    fn ramp(channels: &[&str]) -> Image {
        let mut image = Image::new(3, 2, channels);
        for y in 0..2 {
            for x in 0..3 {
                for (c, v) in image.pixel_mut(x, y).iter_mut().enumerate() {
                    *v = (100 * c + 10 * y + x) as f32;
                }
            }
        }
        image
    }

    #[test]
    fn pixels_channels_and_colours_are_where_they_belong() {
        let image = ramp(&["Z", "B", "G", "R"]);
        assert_eq!(image.pixel(2, 1), [12.0, 112.0, 212.0, 312.0]);
        assert_eq!(image.rgb(2, 1), [312.0, 212.0, 112.0]);
        assert_eq!(image.colours()[15..], [312.0, 212.0, 112.0]);
        assert_eq!(image.channel("G"), Some(2));
        assert_eq!(ramp(&["Y"]).rgb(1, 0), [1.0; 3]);
        assert_eq!(ramp(&["depth"]).rgb(1, 0), [1.0; 3]);
        assert_eq!(ramp(&["N.X", "N.Y"]).rgb_channels(), None);
    }

    #[test]
    fn select_reorders_and_crop_cuts() {
        let image = ramp(&["R", "G", "B"]);
        assert_eq!(image.select(&["B", "R"]).unwrap().pixel(1, 1), [211.0, 11.0]);
        assert!(image.select(&["A"]).is_none());
        let cut = image.crop(1, 1, 2, 1).unwrap();
        assert_eq!((cut.width, cut.height, cut.pixel(0, 0)), (2, 1, image.pixel(1, 1)));
        assert!(image.crop(2, 0, 2, 1).is_none());
        assert!(image.crop(usize::MAX, 0, 2, 1).is_none());
    }

    #[test]
    fn channels_are_sorted_picture_first() {
        let image = ramp(&["albedo.G", "Z", "B", "A", "albedo.R", "R", "G"]).sort_channels();
        assert_eq!(image.channels, ["R", "G", "B", "A", "Z", "albedo.R", "albedo.G"]);
        assert_eq!(image.pixel(0, 0), [500.0, 600.0, 200.0, 300.0, 100.0, 400.0, 0.0]);
    }
}
