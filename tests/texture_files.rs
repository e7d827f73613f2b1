//! Files as textures, read by both libraries.

use std::fs;
use std::path::{Path, PathBuf};

use buffon::image::{
    Backend, Image, TextureImage, WriteOptions, from_srgb, read_texture_with, read_with, write,
};
use image::{DynamicImage, ImageBuffer};

/// Returns the libraries that are compiled in.
fn backends() -> Vec<Backend> {
    let mut all = vec![Backend::RustCrates];
    if Backend::default() != Backend::RustCrates {
        all.push(Backend::default());
    }
    all
}

const WIDTH: usize = 5;
const HEIGHT: usize = 3;

fn code(i: usize) -> u8 {
    (i * 17 + 3) as u8
}

/// Returns an image of bytes with 1 to 4 channels.
fn picture(channels: usize) -> DynamicImage {
    let (w, h) = (WIDTH as u32, HEIGHT as u32);
    let codes: Vec<u8> = (0..WIDTH * HEIGHT * channels).map(code).collect();
    match channels {
        1 => DynamicImage::ImageLuma8(ImageBuffer::from_raw(w, h, codes).unwrap()),
        2 => DynamicImage::ImageLumaA8(ImageBuffer::from_raw(w, h, codes).unwrap()),
        3 => DynamicImage::ImageRgb8(ImageBuffer::from_raw(w, h, codes).unwrap()),
        _ => DynamicImage::ImageRgba8(ImageBuffer::from_raw(w, h, codes).unwrap()),
    }
}

/// Checks that every texel is the sRGB code of [`picture`], whatever its alpha.
fn check_codes(texture: &TextureImage, channels: usize, what: &str) {
    assert_eq!((texture.width(), texture.height()), (WIDTH, HEIGHT), "{what}");
    let colours = if channels < 3 { 1 } else { 3 };
    assert_eq!(texture.memory_bytes(), WIDTH * HEIGHT * colours, "{what}: 8 bits stay 8 bits");
    assert!(texture.is_srgb() && texture.is_grey() == (colours == 1), "{what}");
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            let at = (y * WIDTH + x) * channels;
            let value = |c: usize| from_srgb(f64::from(code(at + c.min(colours - 1))) / 255.0) as f32;
            assert_eq!(texture.rgb(x, y), [value(0), value(1), value(2)], "{what} at {x}, {y}");
        }
    }
}

#[test]
fn bytes_of_every_format_are_read_alike() {
    let dir = tempfile::tempdir().unwrap();
    for (extension, kinds) in [("png", vec![1, 2, 3, 4]), ("bmp", vec![1, 3, 4]), ("tga", vec![1, 3, 4])] {
        for channels in kinds {
            let path = dir.path().join(format!("{channels}.{extension}"));
            picture(channels).save(&path).unwrap();
            for backend in backends() {
                let texture = read_texture_with(backend, &path).unwrap();
                let what = format!("{extension} of {channels} by {backend}");
                // Some readers of BMP convert a grey palette to three equal channels.
                if extension == "bmp" && channels == 1 {
                    assert_eq!(
                        texture.rgb(1, 2),
                        [from_srgb(f64::from(code(11)) / 255.0) as f32; 3],
                        "{what}"
                    );
                } else {
                    check_codes(&texture, channels, &what);
                }
                let image = read_with(backend, &path).unwrap();
                assert_eq!((image.width, image.height), (WIDTH, HEIGHT), "{what}");
            }
        }
    }
}

#[test]
fn jpeg_stays_bytes_and_is_near_the_picture() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.jpg");
    DynamicImage::ImageRgb8(ImageBuffer::from_pixel(16, 8, image::Rgb([200, 100, 50]))).save(&path).unwrap();
    for backend in backends() {
        let texture = read_texture_with(backend, &path).unwrap();
        assert_eq!(texture.memory_bytes(), 16 * 8 * 3);
        for (value, code) in texture.rgb(3, 4).into_iter().zip([200, 100, 50]) {
            assert!((value - from_srgb(f64::from(code) / 255.0) as f32).abs() < 0.02, "{backend}: {value}");
        }
    }
}

/// A palette, and samples of one bit.
#[test]
fn palettes_and_bits_are_expanded() {
    let dir = tempfile::tempdir().unwrap();
    let chunk = |kind: &[u8], data: &[u8]| {
        let mut bytes = (data.len() as u32).to_be_bytes().to_vec();
        let body = [kind, data].concat();
        bytes.extend_from_slice(&body);
        bytes.extend_from_slice(&crc(&body).to_be_bytes());
        bytes
    };
    // 2×1 pixels: one row of a filter byte and a byte of samples, in a stored block of deflate.
    let png = |depth: u8, colour: u8, palette: &[u8], sample: u8| {
        let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
        file.extend(chunk(b"IHDR", &[0, 0, 0, 2, 0, 0, 0, 1, depth, colour, 0, 0, 0]));
        if !palette.is_empty() {
            file.extend(chunk(b"PLTE", palette));
        }
        let mut data = vec![0x78, 0x01, 1, 2, 0, 0xfd, 0xff, 0, sample];
        let adler = (u32::from(sample) + 2) << 16 | (u32::from(sample) + 1);
        data.extend_from_slice(&adler.to_be_bytes());
        file.extend(chunk(b"IDAT", &data));
        file.extend(chunk(b"IEND", &[]));
        file
    };
    let path = dir.path().join("a.png");
    let green = from_srgb(128.0 / 255.0) as f32;
    for (file, expected) in [
        (png(1, 3, &[255, 0, 0, 0, 128, 0], 0b0100_0000), [[1.0, 0.0, 0.0], [0.0, green, 0.0]]),
        (png(1, 0, &[], 0b1000_0000), [[1.0; 3], [0.0; 3]]),
    ] {
        fs::write(&path, file).unwrap();
        for backend in backends() {
            let texture = read_texture_with(backend, &path).unwrap();
            assert_eq!([texture.rgb(0, 0), texture.rgb(1, 0)], expected, "{backend}");
        }
    }
}

/// Returns the checksum of a PNG chunk.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |mut crc, &byte| {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xedb8_8320 } else { crc >> 1 };
        }
        crc
    })
}

#[test]
fn sixteen_bits_stay_sixteen_bits() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    ImageBuffer::<image::Rgb<u16>, _>::from_raw(1, 2, vec![20000u16, 40000, 65535, 0, 1, 2])
        .unwrap()
        .save(&path)
        .unwrap();
    for backend in backends() {
        let texture = read_texture_with(backend, &path).unwrap();
        assert_eq!((texture.memory_bytes(), texture.is_srgb()), (12, true));
        // The values of Mitsuba 3.9.1.
        for (value, expected) in texture.rgb(0, 0).into_iter().zip([0.075_830_27, 0.330_774_04, 1.0]) {
            assert!((value - expected).abs() < 1e-6, "{backend}: {value}");
        }
        let raw = texture.as_linear();
        assert!((raw.rgb(0, 0)[0] - 0.305_180_43).abs() < 1e-7 && !raw.is_srgb());
    }
}

#[test]
fn floats_are_linear_and_halves_where_nothing_is_lost() {
    let dir = tempfile::tempdir().unwrap();
    let mut image = Image::new(2, 2, &["R", "G", "B", "A", "albedo.R"]);
    for value in [0.5f32, 0.1] {
        image.pixel_mut(1, 0).copy_from_slice(&[value, 2.0, 3.0, 0.25, 9.0]);
        for (name, grey) in [("a.exr", false), ("y.exr", true), ("a.pfm", false)] {
            let path = dir.path().join(name);
            let mut image = image.clone();
            if grey {
                image = image.select(&["R"]).unwrap();
                image.channels = vec!["Y".into()];
            }
            write(&path, &image, &WriteOptions::default()).unwrap();
            for backend in backends() {
                let texture = read_texture_with(backend, &path).unwrap();
                let expected = if grey { [value; 3] } else { [value, 2.0, 3.0] };
                assert_eq!(texture.rgb(1, 0), expected, "{name} by {backend}");
                let bytes = if value == 0.5 { 2 } else { 4 } * 4 * if grey { 1 } else { 3 };
                assert_eq!(
                    (texture.memory_bytes(), texture.is_srgb()),
                    (bytes, false),
                    "{name} by {backend}"
                );
            }
        }
    }
    let path = dir.path().join("layers.exr");
    write(&path, &Image::new(2, 2, &["N.X", "N.Y"]), &WriteOptions::default()).unwrap();
    for backend in backends() {
        let expected = "expected a base layer (channels R, G and B, or Y), found N.X, N.Y";
        assert_eq!(error(backend, &path), expected);
    }
}

#[test]
fn radiance_files_are_linear() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.hdr");
    let file = fs::File::create(&path).unwrap();
    let pixels = vec![image::Rgb([1e5f32, 0.5, 1e-3]); 64];
    image::codecs::hdr::HdrEncoder::new(file).encode(&pixels, 8, 8).unwrap();
    for backend in backends() {
        let texture = read_texture_with(backend, &path).unwrap();
        assert!((texture.rgb(7, 7)[0] / 1e5 - 1.0).abs() < 0.01 && !texture.is_srgb(), "{backend}");
    }
}

/// Returns the error of reading a texture, without the file's name.
fn error(backend: Backend, path: &Path) -> String {
    let text = read_texture_with(backend, path).expect_err("reading should fail").to_string();
    text.strip_prefix(&format!("{}: ", path.display())).expect("the error names the file first").to_owned()
}

/// Truncated files, and headers with sizes larger than any file.
#[test]
fn short_and_boasting_files_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let damaged = dir.path().join("damaged");
    let save = |name: &str| -> PathBuf {
        let path = dir.path().join(name);
        let codes = (0..64 * 64 * 3).map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        DynamicImage::ImageRgb8(ImageBuffer::from_raw(64, 64, codes).unwrap()).save(&path).unwrap();
        path
    };
    for (name, format) in [("a.png", "PNG"), ("a.jpg", "JPEG"), ("a.bmp", "BMP"), ("a.tga", "TGA")] {
        let bytes = fs::read(save(name)).unwrap();
        for length in [18, 30, 60, bytes.len() / 2, bytes.len() - 100] {
            fs::write(&damaged, &bytes[..length]).unwrap();
            for backend in backends() {
                let found = error(backend, &damaged);
                let start = format!("damaged or truncated {format} file (");
                assert!(found.starts_with(&start), "{name} of {length} by {backend}: {found}");
            }
        }
        // The largest width and height of the format.
        let mut boasting = bytes.clone();
        match format {
            "PNG" => {
                boasting[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
                let checksum = crc(&boasting[12..29]).to_be_bytes();
                boasting[29..33].copy_from_slice(&checksum);
            }
            "BMP" => boasting[18..26].copy_from_slice(&[0, 0, 1, 0, 0, 0, 1, 0]),
            "TGA" => boasting[12..16].copy_from_slice(&[255; 4]),
            _ => {
                let at = bytes.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
                boasting[at + 5..at + 9].copy_from_slice(&[255; 4]);
            }
        }
        fs::write(&damaged, &boasting).unwrap();
        for backend in backends() {
            let found = error(backend, &damaged);
            let start = format!("damaged or truncated {format} file (");
            assert!(found.starts_with(&start), "{name} by {backend}: {found}");
        }
    }
}

/// Damage may remain undetected. The result is a texture or an error.
#[test]
fn damaged_textures_never_bring_the_program_down() {
    let dir = tempfile::tempdir().unwrap();
    let damaged = dir.path().join("damaged");
    let mut state = 5u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as usize
    };
    for (name, channels) in
        [("a.png", 4), ("a.jpg", 3), ("a.bmp", 3), ("b.bmp", 1), ("a.tga", 4), ("b.tga", 1), ("a.hdr", 3)]
    {
        let path = dir.path().join(name);
        if name == "a.hdr" {
            let file = fs::File::create(&path).unwrap();
            let pixels = vec![image::Rgb([1.0f32, 0.5, 0.1]); 64];
            image::codecs::hdr::HdrEncoder::new(file).encode(&pixels, 8, 8).unwrap();
        } else {
            picture(channels).save(&path).unwrap();
        }
        let bytes = fs::read(&path).unwrap();
        for round in 0..150 {
            let mut bytes = bytes.clone();
            for _ in 0..3 {
                // Two of three files have changes in the header only.
                let end = if round % 3 == 0 { bytes.len() } else { bytes.len().min(60) };
                let at = 2 + next() % (end - 2);
                bytes[at] = next() as u8;
            }
            fs::write(&damaged, &bytes).unwrap();
            for backend in backends() {
                if let Ok(texture) = read_texture_with(backend, &damaged) {
                    let (w, h) = (texture.width(), texture.height());
                    assert!(w * h > 0 && texture.rgb(w - 1, h - 1)[0] >= 0.0);
                }
            }
        }
    }
}
