//! Work that does not fit into memory is refused with an error before the memory is allocated.

use crate::support::cli::{Folder, Run, SCENE, program};
use buffon::image::{Backend, Image, WriteOptions, read, read_texture_with, read_with, write};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::fs::{self, File};
use std::io::Write;
use std::path::Path;

/// More than the memory of the program itself, and less than the tests need.
const LIMIT: &str = "--memory-limit 110M";

/// Runs the program, which must refuse with this exit code, and returns its error.
#[track_caller]
fn refused(folder: &Folder, arguments: &str, code: i32) -> String {
    let Run { code: found, stdout, stderr } = folder.run(arguments);
    assert_eq!((found, stdout.as_str()), (code, ""), "{arguments}: {stderr}");
    stderr.trim_end().strip_prefix("buffon: ").expect("the program's name comes first").to_owned()
}

/// Checks the beginning and the end of a sentence. Amounts between them depend on the system.
#[track_caller]
fn says(sentence: &str, start: &str, end: &str) {
    assert!(sentence.starts_with(start) && sentence.ends_with(end), "{sentence}");
    assert_eq!(sentence.lines().count(), 1, "{sentence}");
}

/// Returns a minimal scene with the given elements.
fn scene(inside: &str) -> Folder {
    Folder::with(&format!(
        r#"<scene version="3.0.0"><integrator type="path"/>
           <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="8"/>
             <integer name="height" value="8"/></film></sensor>
           {inside}<emitter type="constant"/></scene>"#
    ))
}

#[test]
fn an_image_that_does_not_fit_is_the_fault_of_who_asks_for_it() {
    let folder = Folder::new();
    let text = refused(&folder, &format!("render s.xml --size 4000x4000 -t 1 {LIMIT}"), 2);
    let end = "of 110.0 MiB are left (--memory-limit): ask for fewer pixels or layers, or give a larger --memory-limit";
    says(&text, "--size: rendering 4000x4000 pixels would take 1.8 GiB of memory, but ", end);
    let large = SCENE.replace("\"width\" value=\"40\"", "\"width\" value=\"16000\"");
    folder
        .write("large.xml", large.replace("\"height\" value=\"30\"", "\"height\" value=\"1000\"").as_bytes());
    let text = refused(&folder, &format!("render large.xml -t 1 {LIMIT}"), 3);
    says(
        &text,
        "large.xml: rendering 16000x1000 pixels would take 1.8 GiB",
        "or give a larger --memory-limit",
    );
    // The render needs 477 MiB, and the file another 137 MiB.
    let text = refused(&folder, "render s.xml -q --size 2000x2000 -t 1 --memory-limit 590M", 4);
    says(
        &text,
        "s.exr: rendering and encoding 2000x2000 pixels would take ",
        "or give a larger --memory-limit",
    );
    assert_eq!(folder.files(), ["large.xml", "s.xml"]);
    // The render needs 477 MiB, the file another 92 MiB instead of 229 MiB for the copies of a viewer.
    let options = "-o s.pfm --display-server 127.0.0.1:9 --memory-limit 700M";
    let text = refused(&folder, &format!("render s.xml -q --size 2000x2000 -t 1 {options}"), 4);
    says(
        &text,
        "--display-server: rendering 2000x2000 pixels and copies of them would take 7",
        "ask for fewer pixels, or leave out --display-server, or give a larger --memory-limit",
    );
    folder.render("large.xml --crop 0,0,20,20 --memory-limit 110M --spp 1 -q -t 1");
}

#[test]
fn without_a_limit_that_of_the_machine_holds() {
    let folder = Folder::new();
    // The sums and pixels need 500 GB.
    let text = refused(&folder, "render s.xml --size 65535x65535", 2);
    says(&text, "--size: rendering 65535x65535 pixels would take 4", "");
    assert!(text.contains("the free memory of this machine") || text.contains("the limit of "), "{text}");
    let run = folder.run("render s.xml --size 100000x100000");
    assert_eq!(run.code, 2, "{run:?}");
    assert!(run.stderr.contains("expected WIDTHxHEIGHT in pixels, each from 1 to 65535"), "{run:?}");
}

#[test]
fn a_limit_that_suffices_changes_no_bit() {
    let folder = Folder::new();
    for accel in ["auto", "obvhs"] {
        folder.render(&format!("s.xml -o a.exr --spp 4 --accel {accel} --stats a.json -q -t 2"));
        folder.render(&format!("s.xml -o b.exr --spp 4 --accel {accel} --stats b.json -q -t 2 {LIMIT}"));
        let [a, b] = ["a.exr", "b.exr"].map(|name| read(&folder.path(name)).expect("it was written").data);
        assert!(a.iter().map(|v| v.to_bits()).eq(b.iter().map(|v| v.to_bits())), "{accel}");
    }
    let stats: serde_json::Value = serde_json::from_slice(&folder.read("b.json")).expect("JSON");
    assert_eq!(stats["memory_limit_bytes"], 110 << 20);
    let planned = stats["planned_memory_bytes"].as_u64().expect("a number");
    assert!((1 << 20..110 << 20).contains(&planned), "{planned}");
    let error = folder.run("render s.xml --memory-limit 4X");
    assert!(error.stderr.contains("expected an amount of memory such as 4G, 512M or 1.5G"), "{error:?}");
}

/// Writes a PNG of grey pixels. The file is much smaller than the decoded image.
fn grey_png(path: &Path, side: u32) {
    image::GrayImage::new(side, side).save(path).expect("it can be written");
}

#[test]
fn a_texture_is_refused_by_its_header() {
    let texture = |file: &str| {
        format!(
            r#"<shape type="rectangle"><bsdf type="diffuse"><texture name="reflectance" type="bitmap">
               <string name="filename" value="{file}"/></texture></bsdf></shape>"#
        )
    };
    let folder = scene(&texture("t.png"));
    grey_png(&folder.path("t.png"), 8000);
    let text = refused(&folder, &format!("render s.xml {LIMIT}"), 3);
    let end = "are left (--memory-limit): use a smaller image, or give a larger --memory-limit";
    says(&text, "t.png: decoding 8000x8000 pixels of 2 channels would take 244.1 MiB of memory, but ", end);
    // A file of one kilobyte cannot contain 3.6 billion pixels.
    let mut bytes = folder.read("t.png")[..1000].to_vec();
    set_png_size(&mut bytes, 60_000);
    folder.write("t.png", &bytes);
    let text = refused(&folder, "render s.xml", 3);
    let start = "t.png: damaged or truncated PNG file (expected at least 3488430 bytes for 60000x60000 pixels, found 1000 bytes)";
    says(&text, start, "");
    // An environment map needs additional memory for its sampling tables.
    let folder = Folder::with(&SCENE.replace(
        r#"<emitter type="constant"><rgb name="radiance" value="0.2"/></emitter>"#,
        r#"<emitter type="envmap"><string name="filename" value="sky.png"/></emitter>"#,
    ));
    grey_png(&folder.path("sky.png"), 3500);
    let text = refused(&folder, &format!("render s.xml {LIMIT}"), 3);
    assert!(text.contains("sampling an environment map of 3500x3500 pixels would take"), "{text}");
}

/// Writes a different size into the header of a PNG.
fn set_png_size(bytes: &mut [u8], side: u32) {
    bytes[16..20].copy_from_slice(&side.to_be_bytes());
    bytes[20..24].copy_from_slice(&side.to_be_bytes());
    let mut checksum = !0u32;
    for byte in &bytes[12..29] {
        checksum ^= u32::from(*byte);
        for _ in 0..8 {
            checksum = (checksum >> 1) ^ (0xedb8_8320 & (checksum & 1).wrapping_neg());
        }
    }
    bytes[29..33].copy_from_slice(&(!checksum).to_be_bytes());
}

#[test]
fn a_mesh_is_refused_by_its_header() {
    let folder = Folder::new();
    let ply = |encoding: &str, vertices: u64, faces: u64, body: u64| {
        let text = format!(
            "ply\nformat {encoding} 1.0\nelement vertex {vertices}\nproperty uchar x\nproperty uchar y\nproperty uchar z\n\
             element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
        );
        folder.write("m.ply", text.as_bytes());
        // A sparse file of zeros takes no space on the disk.
        let file = File::options().write(true).open(folder.path("m.ply")).expect("it was written");
        file.set_len(text.len() as u64 + body).expect("a file may have holes");
    };
    let end = "are left (--memory-limit): use a mesh of fewer triangles, or give a larger --memory-limit";
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for count in [1u64 << 31, (1 << 32) - 1] {
            ply(encoding, count, 1, 1000);
            let text = refused(&folder, "render m.ply", 3);
            let start =
                format!("m.ply: malformed PLY file: the file is too short for {count} of element vertex");
            says(&text, &start, "");
            ply(encoding, 0, count, 1000);
            let text = refused(&folder, "render m.ply", 3);
            says(&text, &start.replace("vertex", "face"), "");
        }
    }
    ply("binary_little_endian", 10_000_000, 1, 30_000_013);
    let text = refused(&folder, &format!("render m.ply {LIMIT}"), 3);
    says(&text, "m.ply: its mesh would take 114.4 MiB of memory, but ", end);
    ply("binary_little_endian", 10_000_000, 1, 200_000_000);
    let text = refused(&folder, &format!("render m.ply {LIMIT}"), 3);
    says(
        &text,
        "m.ply: reading the file would take 190.7 MiB of memory, but ",
        "use a smaller one, or give a larger --memory-limit",
    );
}

#[test]
fn meshes_of_other_formats_are_refused_as_they_grow() {
    // Each line refers to a new vertex.
    let folder = Folder::new();
    let lines = "vt 0 0\nvn 0 0 1\nv 0 0 0\nf -1/1/1 -1/1/1 -1/1/1\n".repeat(700_000);
    folder.write("m.obj", lines.as_bytes());
    let text = refused(&folder, "render m.obj --memory-limit 90M", 3);
    let end = "are left (--memory-limit): use a mesh of fewer triangles, or give a larger --memory-limit";
    says(&text, "m.obj: its mesh would take ", end);
    // A line without an end.
    folder.write("m.obj", " ".repeat(120_000_000).as_bytes());
    let text = refused(&folder, &format!("render m.obj {LIMIT}"), 3);
    says(&text, "m.obj: its mesh would take ", end);
    // A file a thousand times smaller than its contents.
    let folder = scene(r#"<shape type="serialized"><string name="filename" value="m"/></shape>"#);
    let mut file = ZlibEncoder::new(vec![0x1c, 4, 3, 0], Compression::fast());
    file.write_all(&[0; 4]).unwrap();
    file.write_all(&[10_000_000u64.to_le_bytes(), 1u64.to_le_bytes()].concat()).unwrap();
    file.write_all(&vec![0; 120_000_012]).unwrap();
    folder.write("m", &file.finish().unwrap());
    let text = refused(&folder, &format!("render s.xml {LIMIT}"), 3);
    says(&text, "m: its mesh would take 114.4 MiB of memory, but ", end);
    // An accessor of zeros needs no bytes in the file.
    let folder = Folder::new();
    let gltf = |count: u64| {
        let text = format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
            "accessors":[{{"componentType":5126,"type":"VEC3","count":{count},"min":[0,0,0],"max":[0,0,0],"sparse":{{"count":1,
              "indices":{{"bufferView":0,"componentType":5123}},"values":{{"bufferView":1}}}}}}],
            "bufferViews":[{{"buffer":0,"byteLength":4}},{{"buffer":0,"byteOffset":4,"byteLength":12}}],
            "buffers":[{{"byteLength":16,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAAAAAA=="}}]}}"#
        );
        folder.write("m.gltf", text.as_bytes());
    };
    gltf(1 << 24);
    let text = refused(&folder, &format!("render m.gltf {LIMIT}"), 3);
    let start = "m.gltf: accessors[0]: its 16777216 elements would take 192.0 MiB of memory, but ";
    says(&text, start, "are left (--memory-limit): use a smaller scene, or give a larger --memory-limit");
    gltf(1 << 31);
    let text = refused(&folder, "render m.gltf", 3);
    assert!(
        text.contains("expected at most 16777216 elements without a bufferView, found 2147483648"),
        "{text}"
    );
}

#[test]
fn acceleration_structures_and_photon_maps_are_refused() {
    let folder = Folder::new();
    // The mesh of this grid fits into memory, but its acceleration structure does not.
    let n = 700u32;
    let mut ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        n * n,
        2 * (n - 1) * (n - 1)
    )
    .into_bytes();
    for i in 0..n * n {
        ply.extend([i % n, i / n, (i * 7) % 5].map(|v| (v as f32).to_le_bytes()).concat());
    }
    for i in (0..n * (n - 1)).filter(|i| i % n < n - 1) {
        for corners in [[i, i + 1, i + n], [i + 1, i + n + 1, i + n]] {
            ply.push(3);
            ply.extend(corners.map(u32::to_le_bytes).concat());
        }
    }
    folder.write("m.ply", &ply);
    let text = refused(&folder, &format!("render m.ply -q --size 8x8 --accel obvhs {LIMIT}"), 3);
    says(
        &text,
        "building the BVH of 977202 primitives would take ",
        "use fewer of them, or give a larger --memory-limit",
    );
    #[cfg(feature = "embree")]
    {
        let text = refused(&folder, "render m.ply -q --size 8x8 --accel embree --memory-limit 90M", 3);
        let start = "Embree: one more part of the acceleration structure would take ";
        says(&text, start, "use fewer triangles, or give a larger --memory-limit");
    }
    let lit = SCENE.replace(
        r#"<integrator type="path"><integer name="max_depth" value="6"/></integrator>"#,
        r#"<integrator type="photonmapper"><integer name="global_photons" value="1000000"/></integrator>"#,
    );
    folder.write("s.xml", lit.as_bytes());
    let text = refused(&folder, &format!("render s.xml -q -t 1 {LIMIT}"), 3);
    let end = "are left (--memory-limit): ask for fewer photons, or give a larger --memory-limit";
    says(&text, "photonmapper: maps of 1000000 global and ", end);
    let sppm = lit.replace("\"photonmapper\"", "\"sppm\"").replace("global_photons", "photon_count");
    folder.write("s.xml", sppm.as_bytes());
    let text = refused(&folder, &format!("render s.xml -q -t 1 {LIMIT}"), 3);
    says(
        &text,
        "sppm: the photons of 1000000 light paths would take 286.1 MiB",
        "or give a larger --memory-limit",
    );
}

#[test]
fn info_says_what_a_scene_takes_and_what_is_left() {
    let folder = Folder::new();
    let run = folder.run("info s.xml --memory-limit 110M");
    assert_eq!(run.code, 0, "{run:?}");
    let line = |name: &str| {
        let line = run.stdout.lines().find_map(|line| line.strip_prefix(name));
        line.unwrap_or_else(|| panic!("{name}: {run:?}")).trim().to_owned()
    };
    assert!(line("memory").ends_with("iB with textures and the program itself"), "{run:?}");
    assert!(line("to render").starts_with("film 131.2 KiB, image 14.1 KiB; "), "{run:?}");
    assert!(line("to render").ends_with(" MiB of 110.0 MiB are left"), "{run:?}");
}

/// Returns the libraries that are compiled in.
fn backends() -> Vec<Backend> {
    let mut all = vec![Backend::RustCrates];
    if Backend::default() != Backend::RustCrates {
        all.push(Backend::default());
    }
    all
}

/// Writes an OpenEXR file of 4×4 pixels and returns it with a data window up to the column and row `last`.
fn boasting_exr(path: &Path, last: [i32; 2]) -> Vec<u8> {
    write(path, &Image::new(4, 4, &["R", "G", "B"]), &WriteOptions::default()).expect("it can be written");
    let mut bytes = fs::read(path).expect("it was written");
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = bytes.windows(name.len()).position(|w| w == name).expect("it has one") + name.len() + 4 + 8;
        bytes[at..at + 8].copy_from_slice(&last.map(i32::to_le_bytes).concat());
    }
    bytes
}

/// Headers with sizes larger than any file or memory are refused.
#[test]
fn images_that_boast_are_refused_before_anything_is_allocated() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image");
    let most = i32::MAX.to_le_bytes();
    let exr = |last| boasting_exr(&folder.path().join("a.exr"), last);
    let mut png = Vec::new();
    image::RgbImage::new(4, 4)
        .write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png)
        .expect("it can be encoded");
    set_png_size(&mut png, i32::MAX as u32);
    let bmp = [&b"BM"[..], &[0; 12], &40u32.to_le_bytes(), &most, &most, &[1, 0, 24, 0], &[0; 24]].concat();
    let tga = [&[0, 0, 2][..], &[0; 9], &[255; 4], &[24, 0], &[0; 30]].concat();
    let hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2147483647 +X 2147483647\n12345678".to_vec();
    let pfm = b"PF\n2147483647 2147483647\n-1.0\n12345678".to_vec();
    for (name, bytes, start) in [
        ("OpenEXR", exr([i32::MAX - 1, i32::MAX - 1]), "expected at least "),
        ("OpenEXR", exr([i32::MAX - 1, 3]), "expected at least "),
        ("OpenEXR", exr([3, i32::MAX - 1]), "expected at least "),
        ("OpenEXR", exr([59_999, 59_999]), "expected at least "),
        ("PNG", png, "expected at least "),
        ("BMP", bmp, "expected at least "),
        ("TGA", tga, "expected at least "),
        ("Radiance HDR", hdr, "expected at least "),
        ("PFM", pfm, "expected a size of at least 1x1"),
    ] {
        fs::write(&path, bytes).unwrap();
        for backend in backends() {
            let found = [
                read_with(backend, &path).expect_err("reading should fail").to_string(),
                read_texture_with(backend, &path).expect_err("reading should fail").to_string(),
            ];
            let start = format!("{}: damaged or truncated {name} file ({start}", path.display());
            for text in found {
                assert!(text.starts_with(&start), "{backend}: {text}");
            }
        }
    }
}

/// The limit of the address space is respected, and the error names it.
#[test]
#[cfg(target_os = "linux")]
fn an_address_space_that_is_too_small_is_named() {
    let folder = Folder::new();
    grey_png(&folder.path("large.png"), 10_000);
    let run = |arguments: &str| {
        let output = std::process::Command::new("sh")
            .arg("-c")
            .arg(format!("ulimit -v 1500000 && exec \"$0\" {arguments}"))
            .arg(program())
            // Every thread needs address space.
            .envs([("MALLOC_ARENA_MAX", "1"), ("RAYON_NUM_THREADS", "2")])
            .current_dir(folder.path("."))
            .output()
            .expect("the program starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, text) = run("info large.png");
    assert_eq!(code, Some(4), "{text}");
    assert!(text.contains("decoding 10000x10000 pixels of 2 channels would take "), "{text}");
    assert!(text.contains("(the limit of ulimit -v): use a smaller image, or raise that limit"), "{text}");
    let (code, text) = run("render s.xml --size 6000x6000");
    assert_eq!(code, Some(2), "{text}");
    assert!(text.contains("--size: rendering 6000x6000 pixels would take "), "{text}");
    let (code, text) = run("render s.xml --spp 1 -q -t 1");
    assert_eq!(code, Some(0), "{text}");
}
