//! Broken image files of every format give an image or an error with both libraries, and never a panic or a crash.
//!
//! The cases run in a separate process, which a crash of a library would end. `BUFFON_FUZZ_CASES` sets their number per
//! file.

use buffon::image::{
    Backend, Compression, Image, SampleFormat, WriteOptions, read_texture_bytes_with, read_texture_with,
    read_with, write_with,
};
use image::{DynamicImage, ImageFormat};
use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestRunner};
use std::cell::RefCell;
use std::fs;
use std::io::Cursor;
use std::path::Path;
use std::process::Command;

/// The default number of cases per file.
const CASES: u32 = 60;

/// A change of a file. Replaced bytes are in the header if the flag is set.
#[derive(Clone, Debug)]
enum Edit {
    Replace(prop::sample::Index, bool, Vec<u8>),
    Remove(prop::sample::Index, usize),
    Truncate(prop::sample::Index),
}

/// The number of bytes at the beginning of a file that count as its header.
const HEADER: usize = 400;

fn edit() -> impl Strategy<Value = Edit> {
    let bytes = prop_oneof![
        prop::collection::vec(any::<u8>(), 1..5),
        prop::sample::select::<Vec<u8>>(vec![
            vec![0xff; 4],
            vec![0; 4],
            vec![0xff, 0xff, 0xff, 0x7f],
            vec![0x7f, 0xff, 0xff, 0xff],
            vec![0, 0, 0, 0x80],
            vec![0xff, 0xff],
            b"99999999".to_vec(),
            b"-1".to_vec(),
        ]),
    ];
    let place = any::<prop::sample::Index>;
    prop_oneof![
        6 => (place(), any::<bool>(), bytes).prop_map(|(at, header, bytes)| Edit::Replace(at, header, bytes)),
        1 => (place(), 1usize..20).prop_map(|(at, n)| Edit::Remove(at, n)),
        1 => place().prop_map(Edit::Truncate),
    ]
}

fn apply(bytes: &mut Vec<u8>, edits: &[Edit]) {
    for edit in edits {
        let length = bytes.len();
        match edit {
            Edit::Replace(at, header, new) => {
                let at = at.index(if *header { length.min(HEADER) } else { length } + 1);
                bytes.splice(at..(at + new.len()).min(length), new.iter().copied());
            }
            Edit::Remove(at, n) => {
                let at = at.index(length + 1);
                bytes.drain(at..(at + n).min(length));
            }
            Edit::Truncate(at) => bytes.truncate(at.index(length + 1)),
        }
    }
}

fn backends() -> Vec<Backend> {
    let mut all = vec![Backend::RustCrates];
    if Backend::default() != Backend::RustCrates {
        all.push(Backend::default());
    }
    all
}

/// Returns files of every format with their names.
fn originals(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    let channels = ["R", "G", "B", "A", "N.X"];
    let mut picture = Image::new(21, 17, &channels);
    picture.data.iter_mut().enumerate().for_each(|(i, v)| *v = (i % 97) as f32 / 97.0);
    let compressions =
        [Compression::None, Compression::Rle, Compression::Zips, Compression::Zip, Compression::Piz];
    for compression in compressions {
        for samples in [SampleFormat::Half, SampleFormat::Float] {
            let options = WriteOptions { compression, samples, ..WriteOptions::default() };
            let path = folder.join("original.exr");
            write_with(Backend::default(), &path, &picture, &options).expect("written");
            files.push((format!("{compression:?}-{samples:?}.exr"), fs::read(&path).expect("bytes")));
        }
    }
    let rgb = picture.select(&["R", "G", "B"]).expect("channels");
    for name in ["a.pfm", "a.npy"] {
        let path = folder.join(name);
        write_with(Backend::default(), &path, &rgb, &WriteOptions::default()).expect("written");
        files.push((name.into(), fs::read(&path).expect("bytes")));
    }
    let codes: Vec<u8> = (0..21 * 17 * 4).map(|i| (i * 17 % 256) as u8).collect();
    let rgba = image::RgbaImage::from_raw(21, 17, codes).map(DynamicImage::ImageRgba8).expect("pixels");
    let floats = DynamicImage::ImageRgb32F(rgba.to_rgb32f());
    let bytes = DynamicImage::ImageRgb8(rgba.to_rgb8());
    let grey = DynamicImage::ImageLuma16(rgba.to_luma16());
    for (name, picture, format) in [
        ("rgba.png", &rgba, ImageFormat::Png),
        ("grey.png", &grey, ImageFormat::Png),
        ("rgb.jpg", &bytes, ImageFormat::Jpeg),
        ("rgb.bmp", &bytes, ImageFormat::Bmp),
        ("rgba.bmp", &rgba, ImageFormat::Bmp),
        ("rgb.tga", &bytes, ImageFormat::Tga),
        ("rgba.tga", &rgba, ImageFormat::Tga),
        ("rgb.hdr", &floats, ImageFormat::Hdr),
    ] {
        let mut file = Cursor::new(Vec::new());
        picture.write_to(&mut file, format).expect("encoded");
        files.push((name.into(), file.into_inner()));
    }
    files
}

/// Reads a file in all ways and returns the number of images.
fn check(path: &Path, bytes: &[u8]) -> Result<u32, TestCaseError> {
    fs::write(path, bytes).expect("written");
    let mut read = 0;
    for backend in backends() {
        let results = [
            read_with(backend, path)
                .map(|image| (image.width * image.height * image.channels.len(), image.data.len())),
            read_texture_with(backend, path).map(|t| (t.width().min(1), t.height().min(1))),
            read_texture_bytes_with(backend, path, bytes)
                .map(|t| (t.color.width().min(1), t.color.height().min(1))),
        ];
        for result in results {
            match result {
                Ok((expected, found)) => {
                    prop_assert!(expected == found && found > 0, "{expected} {found}");
                    read += 1;
                }
                Err(error) => {
                    let text = error.to_string();
                    let sentence = text.strip_prefix(&format!("{}: ", path.display()));
                    prop_assert!(sentence.is_some_and(|s| s.len() > 10 && !s.contains('\n')), "{}", text);
                }
            }
        }
    }
    Ok(read)
}

fn run(cases: u32) {
    let folder = tempfile::tempdir().unwrap();
    let files = originals(folder.path());
    for (name, bytes) in &files {
        assert!(check(&folder.path().join(name), bytes).unwrap() >= 2, "{name}: the valid file is refused");
    }
    // The seed depends on the number of cases, so a larger number gives different cases.
    let rng_seed = RngSeed::Fixed(u64::from(cases));
    let config = ProptestConfig { cases, rng_seed, failure_persistence: None, ..ProptestConfig::default() };
    let read = RefCell::new(0);
    for (name, original) in &files {
        let path = folder.path().join(name);
        println!("{name}");
        let result = TestRunner::new(config.clone()).run(&prop::collection::vec(edit(), 1..4), |edits| {
            let mut bytes = original.clone();
            apply(&mut bytes, &edits);
            *read.borrow_mut() += check(&path, &bytes)?;
            Ok(())
        });
        if let Err(failure) = result {
            panic!("{name}: {failure}");
        }
    }
    let read = read.into_inner();
    println!("{cases} cases of {} files, {read} images read", files.len());
    assert!(read > cases, "only {read} files could be read: nothing is tested");
}

#[test]
#[cfg(target_os = "linux")]
fn mutated_images_end_in_an_image_or_a_sentence() {
    const INSIDE: &str = "BUFFON_FUZZ_INSIDE";
    if std::env::var_os(INSIDE).is_some() {
        let cases = std::env::var("BUFFON_FUZZ_CASES").ok().and_then(|text| text.parse().ok());
        return run(cases.unwrap_or(CASES));
    }
    let output = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "--nocapture", "image_robustness::mutated_images_end_in_an_image_or_a_sentence"])
        .env(INSIDE, "1")
        .output()
        .unwrap();
    let text =
        [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    println!("{text}");
    assert!(output.status.success(), "{}: {text}", output.status);
    assert!(text.contains("images read"), "{text}");
}
