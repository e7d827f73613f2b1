//! NumPy arrays: what `buffon render` writes for other programs, and what is read of theirs.

use crate::support::cli::Folder;
use buffon::image::{Image, WriteOptions, read, write};
use serde_json::Value as Json;

/// Returns the header of an array, and its values.
fn array(bytes: &[u8]) -> (&str, Vec<f32>) {
    let header = std::str::from_utf8(&bytes[10..128]).expect("a header").trim_end();
    (header, bytes[128..].as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect())
}

/// An array has the values of the EXR that is written beside it. The statistics have the names of its channels.
#[test]
fn an_array_has_all_layers_and_the_statistics_their_names() {
    let folder = Folder::new();
    folder.render("s.xml -q --spp 2 --aov albedo,variance -o a.exr -o a.npy --stats s.json");
    let exr = read(&folder.path("a.exr")).expect("an image");
    let bytes = folder.read("a.npy");
    let (header, values) = array(&bytes);
    let stats: Json = serde_json::from_slice(&folder.read("s.json")).expect("JSON");
    let names: Vec<&str> =
        stats["channels"].as_array().expect("names").iter().filter_map(Json::as_str).collect();
    let shape = format!("(30, 40, {})", names.len());
    assert_eq!(header, format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}"));
    assert!(names.len() == exr.channels.len() && names.starts_with(&["R", "G", "B"]), "{names:?}");
    let image =
        Image { channels: names.into_iter().map(String::from).collect(), data: values, ..exr.clone() };
    for channel in image.channels.iter().filter(|name| name.contains('.')) {
        let [found, expected] =
            [&image, &exr].map(|image| image.select(&[channel]).expect("the channel").data);
        assert_eq!(found, expected, "{channel}");
    }
    let run = folder.run("diff a.npy a.exr");
    let expected = "damaged or truncated NumPy file (expected a shape of (height, width) or (height, width, channels) \
                    with 1, 3 or 4 channels, because an array has no names of layers, found";
    assert_eq!((run.code, run.stderr), (4, format!("buffon: a.npy: {expected} {shape})\n")));
}

/// A picture survives the way through an array.
#[test]
fn an_array_is_read_as_a_picture() {
    let folder = Folder::new();
    let path = folder.path("a.npy");
    for channels in [&["R", "G", "B"][..], &["R", "G", "B", "A"], &["Y"]] {
        let mut image = Image::new(7, 5, channels);
        image.data.iter_mut().enumerate().for_each(|(i, v)| *v = i as f32 / 16.0 - 1.0);
        write(&path, &image, &WriteOptions::default()).expect("written");
        assert_eq!(array(&folder.read("a.npy")).1, image.data);
        assert_eq!(read(&path).expect("an image"), image);
    }
    folder.render("s.xml -q --spp 2 -o b.pfm -o b.npy");
    assert_eq!(folder.run("diff b.pfm b.npy").code, 0);
    assert_eq!(folder.run("convert b.npy c.npy").code, 0);
    assert!(folder.read("b.npy") == folder.read("c.npy"));
}
