//! Image files: both libraries read and write the same values, and report errors.

use std::fs;
use std::path::{Path, PathBuf};

use buffon::image::{
    Backend, Compression, Image, Metadata, SampleFormat, Value, WriteOptions, backend, read, read_with,
    write, write_with,
};

/// Returns the libraries that are compiled in.
fn backends() -> Vec<Backend> {
    let mut all = vec![Backend::RustCrates];
    if Backend::default() != Backend::RustCrates {
        all.push(Backend::default());
    }
    all
}

/// A sequence of 32-bit random numbers. [Steele et al. 2014, splitmix]
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        ((z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb) >> 32) as u32
    }

    /// Returns a number in [0, 1).
    fn unit(&mut self) -> f32 {
        (self.next() >> 8) as f32 / (1u32 << 24) as f32
    }
}

/// Returns a smooth image with some noise.
fn picture(width: usize, height: usize, channels: &[&str]) -> Image {
    let mut numbers = Numbers(1);
    let mut image = Image::new(width, height, channels);
    for (i, value) in image.data.iter_mut().enumerate() {
        *value = (i % 97) as f32 / 97.0 + 0.01 * numbers.unit();
    }
    image
}

/// Returns an image of values of all kinds, which use all bits.
fn hard_values(width: usize, height: usize, channels: &[&str]) -> Image {
    let special = [
        0.0,
        -0.0,
        1.0,
        -1.5,
        f32::MIN_POSITIVE,
        -f32::MIN_POSITIVE,
        f32::from_bits(1),
        f32::from_bits(0x807f_ffff),
        f32::MAX,
        f32::MIN,
        65504.0,
        65520.0,
        1e-8,
        f32::INFINITY,
        f32::NEG_INFINITY,
    ];
    let mut numbers = Numbers(2);
    let mut image = Image::new(width, height, channels);
    for (i, value) in image.data.iter_mut().enumerate() {
        let any = f32::from_bits(numbers.next());
        *value = if i % 3 == 0 {
            special[i / 3 % special.len()]
        } else if any.is_nan() {
            0.5
        } else {
            any
        };
    }
    image
}

fn bits(image: &Image) -> Vec<u32> {
    image.data.iter().map(|v| v.to_bits()).collect()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a folder for temporary files")
}

/// Returns the names of the files in a folder.
fn files(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|f| f.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// Returns the error of reading a file, without the path.
fn read_error(backend: Backend, path: &Path) -> String {
    let error = read_with(backend, path).expect_err("reading should fail");
    assert_eq!(error.kind, buffon::error::Kind::Output);
    let text = error.to_string();
    text.strip_prefix(&format!("{}: ", path.display())).expect("the error names the file first").to_owned()
}

/// Reads an image with the crate `exr`: the names and bits of the channels.
fn by_exr_crate(path: &Path) -> Vec<(String, Vec<u32>)> {
    use exr::prelude::*;
    let file = read_first_flat_layer_from_file(path).expect("the exr crate reads it");
    let channels = file.layer_data.channel_data.list.iter();
    channels
        .map(|c| match &c.sample_data {
            FlatSamples::F32(samples) => (c.name.to_string(), samples.iter().map(|v| v.to_bits()).collect()),
            other => panic!("expected float samples, found {other:?}"),
        })
        .collect()
}

const MANY: [&str; 14] = [
    "R",
    "G",
    "B",
    "A",
    "Z",
    "N.X",
    "N.Y",
    "N.Z",
    "albedo.R",
    "albedo.G",
    "albedo.B",
    "variance.R",
    "variance.G",
    "variance.B",
];

#[test]
fn the_backend_is_named() {
    let name = backend();
    match Backend::default() {
        Backend::RustCrates => assert_eq!(name, "exr/image crates"),
        #[cfg(feature = "oiio")]
        Backend::OpenImageIo => {
            assert!(name.starts_with("OpenImageIO 2.") || name.starts_with("OpenImageIO 3."))
        }
    }
}

#[test]
fn float_exr_is_read_back_bit_for_bit_by_the_exr_crate() {
    let dir = folder();
    let image = hard_values(37, 29, &MANY);
    for backend in backends() {
        for compression in
            [Compression::None, Compression::Rle, Compression::Zips, Compression::Zip, Compression::Piz]
        {
            let path = dir.path().join("hard.exr");
            let options = WriteOptions { compression, ..WriteOptions::default() };
            let report = write_with(backend, &path, &image, &options).unwrap();
            assert_eq!(report.clamped_half, 0);
            let found = by_exr_crate(&path);
            assert_eq!(found.len(), MANY.len());
            for (name, samples) in found {
                let expected = image.select(&[&name]).expect("a channel of ours");
                assert!(samples == bits(&expected), "{backend} {compression:?} {name}");
            }
        }
    }
}

#[test]
fn each_library_reads_what_each_writes() {
    let dir = folder();
    let path = dir.path().join("image.exr");
    let mut image = hard_values(33, 17, &MANY);
    image.metadata = metadata();
    for writer in backends() {
        write_with(writer, &path, &image, &WriteOptions::default()).unwrap();
        for reader in backends() {
            let found = read_with(reader, &path).unwrap();
            assert_eq!(found.channels, MANY, "{writer} to {reader}");
            assert!(bits(&found) == bits(&image), "{writer} to {reader}");
            let names: Vec<&str> = found.metadata.iter().map(|(name, _)| name).collect();
            assert_eq!(names, sorted_names(), "{writer} to {reader}");
            for (name, value) in image.metadata.iter() {
                assert_eq!(found.metadata.get(name), Some(value), "{writer} to {reader}: {name}");
            }
        }
    }
}

fn metadata() -> Metadata {
    let matrix = |start: i32| Value::Matrix(std::array::from_fn(|i| (start + i as i32) as f32 * 0.5));
    Metadata::new()
        .with("Software", Value::Text("Buffon 0.1.0".into()))
        .with("samplesPerPixel", Value::Int(4096))
        .with("renderTimeSeconds", Value::Float(12.75))
        .with("worldToCamera", matrix(-7))
        .with("worldToNDC", matrix(3))
        .with("buffon:seed", Value::Text("18446744073709551615".into()))
        .with("buffon:integrator", Value::Text("path".into()))
        .with("buffon:stop", Value::Text("samples".into()))
        .with("buffon:relmse", Value::Float(1.5e-3))
        .with("comments", Value::Text("a comment".into()))
        .with("owner", Value::Text("somebody".into()))
}

fn sorted_names() -> Vec<String> {
    let mut names: Vec<String> = metadata().iter().map(|(name, _)| name.to_owned()).collect();
    names.sort();
    names
}

#[test]
fn metadata_has_the_standard_names_in_the_file() {
    use exr::prelude::{AttributeValue, MetaData, Text};
    let dir = folder();
    let path = dir.path().join("image.exr");
    let mut image = picture(4, 4, &["R", "G", "B"]);
    image.metadata = metadata();
    for backend in backends() {
        write_with(backend, &path, &image, &WriteOptions::default()).unwrap();
        let header = &MetaData::read_from_file(&path, false).unwrap().headers[0];
        let own = &header.own_attributes;
        assert!(own.world_to_camera.is_some() && own.world_to_normalized_device.is_some(), "{backend}");
        assert_eq!(own.comments.as_ref().map(Text::to_string).as_deref(), Some("a comment"), "{backend}");
        assert_eq!(own.other.get(&b"samplesPerPixel"[..]), Some(&AttributeValue::I32(4096)), "{backend}");
        assert_eq!(
            own.other.get(&b"Software"[..]),
            Some(&AttributeValue::Text("Buffon 0.1.0".into())),
            "{backend}"
        );
    }
}

#[test]
fn half_values_are_rounded_alike_and_clamped_values_counted() {
    let dir = folder();
    let path = dir.path().join("half.exr");
    let mut image = picture(16, 16, &["R", "G", "B"]);
    image.data[..6].copy_from_slice(&[65504.0, 65505.0, -1e9, f32::MAX, f32::INFINITY, 65519.0]);
    let options = WriteOptions { samples: SampleFormat::Half, ..WriteOptions::default() };
    let mut seen: Option<Image> = None;
    for backend in backends() {
        let report = write_with(backend, &path, &image, &options).unwrap();
        assert_eq!(report.clamped_half, 4, "{backend}");
        let found = read_with(backend, &path).unwrap();
        assert_eq!(
            found.data[..6],
            [65504.0, 65504.0, -65504.0, 65504.0, f32::INFINITY, 65504.0],
            "{backend}"
        );
        let furthest =
            found.data[6..].iter().zip(&image.data[6..]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(furthest <= 2.0f32.powi(-12), "{backend}: {furthest}");
        if let Some(seen) = &seen {
            assert!(bits(seen) == bits(&found), "{backend}");
        }
        seen = Some(found);
    }
}

/// Halves would round variances to zero, and counts and positions coarsely.
#[test]
fn beside_a_half_picture_layers_are_floats() {
    let dir = folder();
    let path = dir.path().join("layers.exr");
    let mut image = Image::new(5, 3, &["R", "G", "B", "samples.Y", "variance.R"]);
    for (i, pixel) in image.data.chunks_exact_mut(5).enumerate() {
        let i = i as f32;
        pixel.copy_from_slice(&[0.1 + i, 70000.0, 0.0, 16_777_213.0 - i, 1.5e-12 * i]);
    }
    let options = WriteOptions { samples: SampleFormat::Half, ..WriteOptions::default() };
    for writer in backends() {
        let report = write_with(writer, &path, &image, &options).unwrap();
        assert_eq!(report.clamped_half, 15, "{writer}");
        for reader in backends() {
            let found = read_with(reader, &path).unwrap();
            let found = found.select(&image.channels).expect("all channels");
            for (found, image) in found.data.chunks_exact(5).zip(image.data.chunks_exact(5)) {
                assert_eq!((found[1], &found[3..]), (65504.0, &image[3..]), "{writer}, {reader}");
                assert!(
                    found[0] != image[0] && (found[0] / image[0] - 1.0).abs() < 5e-4,
                    "{writer}, {reader}"
                );
            }
        }
    }
}

#[test]
fn parts_and_integer_channels_are_joined_by_name() {
    use exr::prelude::{
        AnyChannel, AnyChannels, Blocks, Compression as Theirs, Encoding, FlatSamples, Image as ExrImage,
        ImageAttributes, IntegerBounds, Layer, LayerAttributes, LineOrder, WritableImage,
    };
    let dir = folder();
    let path = dir.path().join("parts.exr");
    let layer = |part: &str, channel: &str, samples: FlatSamples| {
        let channels = AnyChannels::sort([AnyChannel::new(channel, samples)].into_iter().collect());
        let encoding = Encoding {
            compression: Theirs::ZIP16,
            blocks: Blocks::ScanLines,
            line_order: LineOrder::Increasing,
        };
        Layer::new((2, 2), LayerAttributes::named(part), encoding, channels)
    };
    let layers = vec![
        layer("left", "Y", FlatSamples::F32(vec![0.0, 1.0, 2.0, 3.0])),
        layer("ids", "id", FlatSamples::U32(vec![0, 1, 70_000, 16_777_216])),
    ];
    let attributes = ImageAttributes::new(IntegerBounds::from_dimensions((2, 2)));
    ExrImage::from_layers(attributes, layers).write().to_file(&path).unwrap();
    for backend in backends() {
        let image = read_with(backend, &path).unwrap();
        assert_eq!(image.channels, ["ids.id", "left.Y"], "{backend}");
        assert_eq!(image.data, [0.0, 0.0, 1.0, 1.0, 70_000.0, 2.0, 16_777_216.0, 3.0], "{backend}");
    }
}

#[test]
fn png_keeps_codes_and_alpha_and_is_the_same_by_either_library() {
    let dir = folder();
    for channels in [&["Y"][..], &["Y", "A"], &["R", "G", "B"], &["R", "G", "B", "A"]] {
        let image = picture(40, 30, channels);
        let mut seen: Option<Image> = None;
        for writer in backends() {
            let path = dir.path().join("first.png");
            let again = dir.path().join("again.png");
            write_with(writer, &path, &image, &WriteOptions::default()).unwrap();
            for reader in backends() {
                let found = read_with(reader, &path).unwrap();
                assert_eq!(found.channels, channels);
                if let Some(seen) = &seen {
                    assert!(bits(seen) == bits(&found), "{writer} to {reader} {channels:?}");
                }
                write_with(writer, &again, &found, &WriteOptions::default()).unwrap();
                let twice = read_with(reader, &again).unwrap();
                assert!(bits(&found) == bits(&twice), "{writer} to {reader} {channels:?}");
                seen = Some(found);
            }
        }
        let largest =
            seen.unwrap().data.iter().zip(&image.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(channels.contains(&"A") || largest < 0.01, "{largest}");
    }
}

#[test]
fn a_sixteen_bit_png_is_decoded_with_all_its_bits() {
    let dir = folder();
    let path = dir.path().join("deep.png");
    let samples: Vec<u16> = (0..64 * 3).map(|i| (i * 341) as u16).collect();
    image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(8, 8, samples.clone()).unwrap().save(&path).unwrap();
    for backend in backends() {
        let found = read_with(backend, &path).unwrap();
        for (value, sample) in found.data.iter().zip(&samples) {
            let expected = buffon::image::from_srgb(f64::from(*sample) / 65535.0) as f32;
            assert_eq!(*value, expected, "{backend} {sample}");
        }
    }
}

#[test]
fn hdr_files_are_read_alike() {
    let dir = folder();
    let path = dir.path().join("sky.hdr");
    let pixels: Vec<image::Rgb<f32>> =
        (0..64).map(|i| image::Rgb([i as f32 * 10.0, 1.0 / (i + 1) as f32, 1e-3])).collect();
    let file = fs::File::create(&path).unwrap();
    image::codecs::hdr::HdrEncoder::new(file).encode(&pixels, 8, 8).unwrap();
    let images: Vec<Image> = backends().into_iter().map(|b| read_with(b, &path).unwrap()).collect();
    for found in &images {
        assert_eq!(found.channels, ["R", "G", "B"]);
        assert!(bits(found) == bits(&images[0]));
        assert!((found.pixel(7, 7)[0] / 630.0 - 1.0).abs() < 0.01);
    }
}

#[test]
fn jpeg_is_near_the_picture() {
    let dir = folder();
    let path = dir.path().join("picture.jpg");
    let mut image = Image::new(64, 64, &["R", "G", "B", "albedo.R"]);
    for y in 0..64 {
        for x in 0..64 {
            image.pixel_mut(x, y).copy_from_slice(&[x as f32 / 63.0, y as f32 / 63.0, 0.25, 9.0]);
        }
    }
    for writer in backends() {
        write_with(writer, &path, &image, &WriteOptions::default()).unwrap();
        for reader in backends() {
            let found = read_with(reader, &path).unwrap();
            let expected = image.select(&["R", "G", "B"]).unwrap();
            let largest =
                found.data.iter().zip(&expected.data).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(largest < 0.04, "{writer} to {reader}: {largest}");
        }
    }
}

#[test]
fn pfm_keeps_every_bit_of_the_picture() {
    let dir = folder();
    for channels in [&["R", "G", "B"][..], &["Y"]] {
        let path = dir.path().join("picture.pfm");
        let image = hard_values(7, 5, channels);
        write(&path, &image, &WriteOptions::default()).unwrap();
        let found = read(&path).unwrap();
        assert_eq!(found.channels, channels);
        assert!(bits(&found) == bits(&image));
    }
}

#[test]
fn content_decides_and_not_the_extension() {
    let dir = folder();
    let image = picture(8, 8, &["R", "G", "B"]);
    let png = dir.path().join("picture.png");
    write(&png, &image, &WriteOptions::default()).unwrap();
    let disguised = dir.path().join("picture.exr");
    fs::copy(&png, &disguised).unwrap();
    for backend in backends() {
        assert_eq!(read_with(backend, &disguised).unwrap(), read_with(backend, &png).unwrap());
    }
}

#[test]
fn what_cannot_be_read_is_said() {
    let dir = folder();
    let file = |name: &str, content: &[u8]| -> PathBuf {
        let path = dir.path().join(name);
        fs::write(&path, content).unwrap();
        path
    };
    let expected = "expected an image (OpenEXR, PNG, JPEG, BMP, TGA, Radiance HDR, PFM or a NumPy array), found something else";
    for backend in backends() {
        assert_eq!(read_error(backend, &dir.path().join("missing.exr")), "no such file");
        assert_eq!(read_error(backend, dir.path()), "expected an image, found a folder");
        assert_eq!(read_error(backend, &file("empty.exr", b"")), "expected an image, found an empty file");
        assert_eq!(read_error(backend, &file("text.exr", b"hello, world")), expected);
        assert_eq!(read_error(backend, &file("scene.xml", b"<scene/>")), expected);
        let cut = read_error(backend, &file("cut.pfm", b"PF\n2 2\n-1.0\nabc"));
        assert_eq!(cut, "damaged or truncated PFM file (expected 48 bytes of pixels, found 3)");
    }
}

#[test]
fn files_cut_short_are_refused_by_name() {
    let dir = folder();
    let image = picture(64, 64, &["R", "G", "B"]);
    let formats =
        [("a.exr", "OpenEXR"), ("a.png", "PNG"), ("a.jpg", "JPEG"), ("a.pfm", "PFM"), ("a.npy", "NumPy")];
    for (name, format) in formats {
        let whole = dir.path().join(name);
        write(&whole, &image, &WriteOptions::default()).unwrap();
        let bytes = fs::read(&whole).unwrap();
        for length in [6, 40, bytes.len() / 3, bytes.len() / 2, bytes.len() - 100] {
            let cut = dir.path().join(format!("cut-{name}"));
            fs::write(&cut, &bytes[..length]).unwrap();
            for backend in backends() {
                let error = read_error(backend, &cut);
                let start = format!("damaged or truncated {format} file (");
                assert!(error.starts_with(&start) && error.ends_with(')'), "{backend} {length}: {error}");
                assert!(!error.contains('\n'), "{error}");
            }
        }
    }
}

#[test]
fn damaged_files_never_bring_the_program_down() {
    let dir = folder();
    let image = picture(24, 16, &["R", "G", "B"]);
    let mut numbers = Numbers(3);
    for name in ["a.exr", "a.png", "a.jpg", "a.pfm", "a.npy"] {
        let whole = dir.path().join(name);
        write(&whole, &image, &WriteOptions::default()).unwrap();
        let bytes = fs::read(&whole).unwrap();
        let damaged = dir.path().join(format!("damaged-{name}"));
        for _ in 0..60 {
            let mut bytes = bytes.clone();
            for _ in 0..3 {
                let at = 4 + numbers.next() as usize % (bytes.len() - 4);
                bytes[at] = numbers.next() as u8;
            }
            fs::write(&damaged, &bytes).unwrap();
            for backend in backends() {
                // Damage may remain undetected. The result is an image or an error.
                let _ = read_with(backend, &damaged);
            }
        }
    }
}

#[test]
fn what_cannot_be_written_is_said() {
    let dir = folder();
    let good = picture(2, 2, &["R", "G", "B"]);
    let says = |name: &str, image: &Image| {
        let path = dir.path().join(name);
        let mut sentences: Vec<String> = backends()
            .into_iter()
            .map(|b| write_with(b, &path, image, &WriteOptions::default()).unwrap_err().to_string())
            .collect();
        sentences.dedup();
        assert_eq!(sentences.len(), 1, "{sentences:?}");
        sentences[0].replace(&dir.path().display().to_string(), "DIR")
    };
    let extensions = "expected the extension .exr, .png, .jpg, .jpeg, .pfm or .npy";
    assert_eq!(says("a.tiff", &good), format!("DIR/a.tiff: {extensions}, found .tiff"));
    assert_eq!(says("a", &good), format!("DIR/a: {extensions}, found none"));
    assert_eq!(
        says("no/such/a.exr", &good),
        "DIR/no/such/a.exr: cannot be written: the folder \"DIR/no/such\" does not exist"
    );
    fs::create_dir(dir.path().join("folder.exr")).unwrap();
    assert_eq!(says("folder.exr", &good), "DIR/folder.exr: cannot be written: it is a folder");
    assert_eq!(
        says("a.exr", &Image::new(0, 4, &["R"])),
        "DIR/a.exr: expected an image of at least one pixel and channel, this one has 0x4 pixels, 1 channels"
    );
    let short = Image { data: vec![0.0; 5], ..good.clone() };
    assert_eq!(says("a.exr", &short), "DIR/a.exr: expected 2x2 pixels with 3 channels, found 5 values");
    let twice = Image::new(1, 1, &["R", "R"]);
    assert_eq!(says("a.exr", &twice), "DIR/a.exr: expected unique channel names, found \"R\" twice");
    let wide = Image::new(65_501, 1, &["Y"]);
    assert_eq!(says("a.jpg", &wide), "DIR/a.jpg: JPEG: expected at most 65500x65500 pixels, found 65501x1");
    let normals = Image::new(1, 1, &["N.X", "N.Y", "N.Z"]);
    assert_eq!(
        says("a.png", &normals),
        "DIR/a.png: a PNG file holds the channels R, G, B or Y, this image has N.X, N.Y, N.Z"
    );
    let mut noted = good.clone();
    noted.metadata.set("note", Value::Text("a\0b".into()));
    assert_eq!(
        says("a.exr", &noted),
        "DIR/a.exr: expected a metadata name of 1 to 255 bytes and no NUL, found \"note\" = \"a\\0b\""
    );
    assert_eq!(files(dir.path()), ["folder.exr"]);
}

#[cfg(unix)]
#[test]
fn an_output_has_ordinary_permissions_and_links_are_written_through() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let dir = folder();
    let image = picture(3, 3, &["R", "G", "B"]);
    let plain = dir.path().join("plain");
    fs::write(&plain, b"").unwrap();
    let ordinary = fs::metadata(&plain).unwrap().permissions().mode();
    let (target, link) = (dir.path().join("target.exr"), dir.path().join("link.exr"));
    for backend in backends() {
        write_with(backend, &target, &image, &WriteOptions::default()).unwrap();
        assert_eq!(fs::metadata(&target).unwrap().permissions().mode(), ordinary, "{backend}");
        _ = fs::remove_file(&link);
        symlink(&target, &link).unwrap();
        let other = picture(4, 3, &["R", "G", "B"]);
        write_with(backend, &link, &other, &WriteOptions::default()).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink(), "{backend}");
        assert_eq!(read_with(backend, &target).unwrap().width, 4, "{backend}");
    }
}

#[test]
fn the_same_image_gives_the_same_bytes() {
    let dir = folder();
    let mut image = picture(50, 40, &MANY);
    image.metadata = metadata();
    for backend in backends() {
        for name in ["a.exr", "a.png", "a.jpg", "a.pfm", "a.npy"] {
            let path = dir.path().join(name);
            write_with(backend, &path, &image, &WriteOptions::default()).unwrap();
            let first = fs::read(&path).unwrap();
            write_with(backend, &path, &image, &WriteOptions::default()).unwrap();
            assert!(first == fs::read(&path).unwrap(), "{backend} {name}");
        }
    }
}
