//! Image files with the crates `exr` and `image`.

use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Seek};
use std::path::Path;

use ::image::codecs::jpeg::JpegEncoder;
use ::image::codecs::png::PngEncoder;
use ::image::{
    DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat, ImageReader, Limits,
};
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Blocks, Encoding, FlatSamples, Image as ExrImage,
    ImageAttributes, IntegerBounds, Layer, LayerAttributes, LineOrder, MetaData, ReadChannels, ReadLayers,
    Text, WritableImage, f16, read,
};

use super::exr_header::sort_attributes;
use super::format::{ExrOutput, Format, ImagePart, MAX_VALUES, preserved_metadata};
use super::srgb::{BytePixels, Raster, StoredPixels, StoredSamples};
use super::{Compression, Image, Metadata, SampleFormat, Value};

/// Reads all parts of an OpenEXR file.
pub(super) fn read_exr(path: &Path) -> Result<Vec<ImagePart>, String> {
    let headers = MetaData::read_from_file(path, false).map_err(|e| e.to_string())?.headers;
    let values: u64 = headers
        .iter()
        .map(|h| (h.layer_size.area() as u64).saturating_mul(h.channels.list.len() as u64))
        .fold(0, u64::saturating_add);
    if values > MAX_VALUES {
        return Err(format!("expected at most {MAX_VALUES} values, found {values}"));
    }
    let file = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_file(path)
        .map_err(|e| e.to_string())?;
    let shared = file.attributes;
    file.layer_data.into_iter().map(|layer| part(layer, &shared)).collect()
}

/// Converts a layer, which is the crate's name of a part.
fn part(layer: Layer<AnyChannels<FlatSamples>>, shared: &ImageAttributes) -> Result<ImagePart, String> {
    let (width, height) = (layer.size.x(), layer.size.y());
    let list = &layer.channel_data.list;
    if let Some(channel) = list.iter().find(|c| c.sample_data.len() != width * height) {
        return Err(format!("channel {} is subsampled, which is not supported", channel.name));
    }
    let mut data = vec![0.0; width * height * list.len()];
    for (c, channel) in list.iter().enumerate() {
        let values = data.iter_mut().skip(c).step_by(list.len());
        match &channel.sample_data {
            FlatSamples::F16(samples) => values.zip(samples).for_each(|(to, v)| *to = v.to_f32()),
            FlatSamples::F32(samples) => values.zip(samples).for_each(|(to, v)| *to = *v),
            FlatSamples::U32(samples) => values.zip(samples).for_each(|(to, v)| *to = *v as f32),
        }
    }
    let channels = list.iter().map(|c| c.name.to_string()).collect();
    let name = layer.attributes.layer_name.as_ref().map(Text::to_string).unwrap_or_default();
    let metadata = metadata_of(layer.attributes, shared);
    Ok(ImagePart { name, image: Image { width, height, channels, data, metadata } })
}

/// Returns the metadata of a layer and of its file.
fn metadata_of(layer: LayerAttributes, shared: &ImageAttributes) -> Metadata {
    let mut metadata = Metadata::new();
    let texts = [("comments", layer.comments), ("owner", layer.owner), ("software", layer.software_name)];
    for (name, text) in texts {
        if let Some(text) = text {
            metadata.set(name, Value::Text(text.to_string()));
        }
    }
    let matrices =
        [("worldToCamera", layer.world_to_camera), ("worldToNDC", layer.world_to_normalized_device)];
    for (name, matrix) in matrices {
        if let Some(matrix) = matrix {
            metadata.set(name, Value::Matrix(matrix));
        }
    }
    for (name, value) in shared.other.iter().chain(&layer.other) {
        let value = match value {
            AttributeValue::I32(value) => Value::Int(*value),
            AttributeValue::F32(value) => Value::Float(*value),
            AttributeValue::Text(value) => Value::Text(value.to_string()),
            AttributeValue::Matrix4x4(value) => Value::Matrix(*value),
            _ => continue,
        };
        metadata.set(name.to_string(), value);
    }
    preserved_metadata(metadata)
}

/// Encodes a single-part OpenEXR file.
pub(super) fn encode_exr(output: &ExrOutput) -> Result<Vec<u8>, String> {
    let image = output.image;
    let count = image.channels.len();
    let mut list = Vec::with_capacity(count);
    for (c, name) in image.channels.iter().enumerate() {
        let values = output.data.iter().skip(c).step_by(count).copied();
        let samples = match output.samples[c] {
            SampleFormat::Half => FlatSamples::F16(values.map(f16::from_f32).collect()),
            SampleFormat::Float => FlatSamples::F32(values.collect()),
        };
        list.push(AnyChannel::new(text(name)?, samples));
    }
    let mut attributes = LayerAttributes::default();
    for (name, value) in image.metadata.iter() {
        put(&mut attributes, name, value)?;
    }
    let encoding = Encoding {
        compression: compression(output.compression),
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let size = (image.width, image.height);
    let layer = Layer::new(size, attributes, encoding, AnyChannels::sort(list.into_iter().collect()));
    let window = IntegerBounds::from_dimensions(size);
    let file = ExrImage { attributes: ImageAttributes::new(window), layer_data: layer };
    let mut bytes = Cursor::new(Vec::new());
    file.write().to_buffered(&mut bytes).map_err(|e| e.to_string())?;
    let mut bytes = bytes.into_inner();
    sort_attributes(&mut bytes);
    Ok(bytes)
}

/// Returns the crate's equivalent of a compression.
fn compression(ours: Compression) -> exr::prelude::Compression {
    use exr::prelude::Compression as Theirs;
    match ours {
        Compression::None => Theirs::Uncompressed,
        Compression::Rle => Theirs::RLE,
        Compression::Zips => Theirs::ZIP1,
        Compression::Zip => Theirs::ZIP16,
        Compression::Piz => Theirs::PIZ,
    }
}

/// Converts text for the crate, which accepts Latin-1: UTF-8 is passed byte for byte.
fn text(text: &str) -> Result<Text, String> {
    Text::new_or_none(text).ok_or_else(|| format!("\"{text}\" cannot be written as OpenEXR text"))
}

/// Stores a metadata value in the crate's structures.
fn put(attributes: &mut LayerAttributes, name: &str, value: &Value) -> Result<(), String> {
    let value = match (name, value) {
        ("worldToCamera", Value::Matrix(m)) => {
            attributes.world_to_camera = Some(*m);
            return Ok(());
        }
        ("worldToNDC", Value::Matrix(m)) => {
            attributes.world_to_normalized_device = Some(*m);
            return Ok(());
        }
        ("comments", Value::Text(t)) => {
            attributes.comments = Some(text(t)?);
            return Ok(());
        }
        ("owner", Value::Text(t)) => {
            attributes.owner = Some(text(t)?);
            return Ok(());
        }
        (_, Value::Int(value)) => AttributeValue::I32(*value),
        (_, Value::Float(value)) => AttributeValue::F32(*value),
        (_, Value::Text(value)) => AttributeValue::Text(text(value)?),
        (_, Value::Matrix(value)) => AttributeValue::Matrix4x4(*value),
    };
    attributes.other.insert(text(name)?, value);
    Ok(())
}

/// Returns the crate's equivalent of a format.
fn image_format(format: Format) -> ImageFormat {
    match format {
        Format::Png => ImageFormat::Png,
        Format::Jpeg => ImageFormat::Jpeg,
        Format::Bmp => ImageFormat::Bmp,
        Format::Tga => ImageFormat::Tga,
        Format::Hdr => ImageFormat::Hdr,
        Format::OpenExr | Format::Pfm | Format::Npy => {
            unreachable!("these formats are read by other modules")
        }
    }
}

/// Reads the samples of a PNG, JPEG, BMP, TGA or HDR file.
pub(super) fn read_raster(path: &Path, format: Format) -> Result<Raster, String> {
    read_stored(path, format, MAX_VALUES).map(Raster::from)
}

/// Reads the stored samples of a PNG, JPEG, BMP, TGA or HDR file, if there are at most `most`.
pub(super) fn read_stored(path: &Path, format: Format, most: u64) -> Result<StoredPixels, String> {
    stored(BufReader::new(File::open(path).map_err(|e| e.to_string())?), format, most)
}

/// Decodes a file in memory as [`read_stored`] does.
pub(super) fn decode_stored(bytes: &[u8], format: Format, most: u64) -> Result<StoredPixels, String> {
    stored(Cursor::new(bytes), format, most)
}

/// Reads the samples of a file.
fn stored(file: impl BufRead + Seek, format: Format, most: u64) -> Result<StoredPixels, String> {
    let mut reader = ImageReader::with_format(file, image_format(format));
    let mut limits = Limits::default();
    limits.max_alloc = Some(4 * most);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    let values = u64::from(width) * u64::from(height) * u64::from(decoder.color_type().channel_count());
    if values == 0 || values > most {
        return Err(format!("expected at least one and at most {most} values, found {values}"));
    }
    let decoded = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?;
    let (width, height) = (width as usize, height as usize);
    let (channels, samples) = match decoded {
        DynamicImage::ImageLuma8(i) => (1, StoredSamples::Bytes(i.into_raw())),
        DynamicImage::ImageLumaA8(i) => (2, StoredSamples::Bytes(i.into_raw())),
        DynamicImage::ImageRgb8(i) => (3, StoredSamples::Bytes(i.into_raw())),
        DynamicImage::ImageRgba8(i) => (4, StoredSamples::Bytes(i.into_raw())),
        DynamicImage::ImageLuma16(i) => (1, StoredSamples::Shorts(i.into_raw())),
        DynamicImage::ImageLumaA16(i) => (2, StoredSamples::Shorts(i.into_raw())),
        DynamicImage::ImageRgb16(i) => (3, StoredSamples::Shorts(i.into_raw())),
        DynamicImage::ImageRgba16(i) => (4, StoredSamples::Shorts(i.into_raw())),
        other => (3, StoredSamples::Floats(other.into_rgb32f().into_raw())),
    };
    Ok(StoredPixels { width, height, channels, samples })
}

/// Encodes a PNG or JPEG file.
pub(super) fn encode_bytes(format: Format, pixels: &BytePixels, quality: u8) -> Result<Vec<u8>, String> {
    let mut file = Vec::new();
    let (width, height) = (pixels.width as u32, pixels.height as u32);
    let colour = match pixels.channels {
        1 => ExtendedColorType::L8,
        2 => ExtendedColorType::La8,
        3 => ExtendedColorType::Rgb8,
        _ => ExtendedColorType::Rgba8,
    };
    match format {
        Format::Jpeg => JpegEncoder::new_with_quality(&mut file, quality).write_image(
            &pixels.bytes,
            width,
            height,
            colour,
        ),
        _ => PngEncoder::new(&mut file).write_image(&pixels.bytes, width, height, colour),
    }
    .map_err(|e| e.to_string())?;
    Ok(file)
}
