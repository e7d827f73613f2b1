//! Broken mesh files end in a mesh or an error: never in a panic, and never in memory that the file's length does not
//! justify.
//!
//! The cases run in a process of their own with a limit on its memory. `BUFFON_FUZZ_CASES` says how many there are of
//! each format.

use buffon::loader::{LoadOptions, load};
use buffon::shape::Shape;
use flate2::{Compression, write::ZlibEncoder};
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Command;

/// Cases of each format, unless the environment says otherwise.
const CASES: u32 = 200;
/// Address space of the process that runs them.
const LIMIT_KB: u64 = 4 << 20;
/// Bytes by which its resident memory may grow: a block of text, what is parsed from it, and what the allocator keeps.
const GROWTH: u64 = 100 << 20;

/// A change to a file.
#[derive(Clone, Debug)]
enum Edit {
    Replace(prop::sample::Index, Vec<u8>),
    Insert(prop::sample::Index, Vec<u8>),
    Remove(prop::sample::Index, usize),
    Truncate(prop::sample::Index),
    /// The next digit that is there becomes another.
    Digit(prop::sample::Index, u8),
    /// A stretch from elsewhere in the file.
    Copy(prop::sample::Index, prop::sample::Index, usize),
}

fn edit() -> impl Strategy<Value = Edit> {
    let place = any::<prop::sample::Index>;
    let words = prop::sample::select::<&'static str>(vec![
        "-1",
        "0",
        "4294967295",
        "2147483648",
        "99999999999999999999",
        "nan",
        "-inf",
        "1e999",
        "#",
        "/",
        "//",
        "\n",
        "\r\n",
        " ",
        "",
        "f",
        "v",
        "vt",
        "vn",
        "1/1/1",
        "list",
        "uchar",
        "double",
        "element",
        "property",
        "\u{b}",
        "é",
    ]);
    let bytes = prop_oneof![
        words.prop_map(|word| word.as_bytes().to_vec()),
        proptest::collection::vec(any::<u8>(), 1..9),
        prop::sample::select::<Vec<u8>>(vec![
            vec![0; 8],
            vec![0xff; 8],
            vec![0xff; 4],
            vec![0xff, 0xff, 0xff, 0x7f],
            vec![0, 0, 0, 0x80]
        ]),
    ];
    prop_oneof![
        1 => (place(), bytes.clone()).prop_map(|(at, bytes)| Edit::Replace(at, bytes)),
        1 => (place(), bytes).prop_map(|(at, bytes)| Edit::Insert(at, bytes)),
        1 => (place(), 1usize..20).prop_map(|(at, n)| Edit::Remove(at, n)),
        1 => place().prop_map(Edit::Truncate),
        4 => (place(), b'0'..=b'9').prop_map(|(at, digit)| Edit::Digit(at, digit)),
        1 => (place(), place(), 1usize..40).prop_map(|(from, to, n)| Edit::Copy(from, to, n)),
    ]
}

fn apply(bytes: &mut Vec<u8>, edits: &[Edit]) {
    for edit in edits {
        let length = bytes.len();
        let place = |at: &prop::sample::Index| at.index(length + 1);
        match edit {
            Edit::Replace(at, new) => {
                let at = place(at);
                bytes.splice(at..(at + new.len()).min(length), new.iter().copied());
            }
            Edit::Insert(at, new) => {
                let at = place(at);
                bytes.splice(at..at, new.iter().copied());
            }
            Edit::Remove(at, n) => {
                let at = place(at);
                bytes.drain(at..(at + n).min(length));
            }
            Edit::Truncate(at) => bytes.truncate(place(at)),
            Edit::Digit(at, digit) => {
                let found = bytes[place(at)..].iter_mut().find(|b| b.is_ascii_digit());
                found.into_iter().for_each(|b| *b = *digit);
            }
            Edit::Copy(from, to, n) => {
                let (from, to) = (place(from), place(to));
                let copy = bytes[from..(from + n).min(length)].to_vec();
                bytes.splice(to..to, copy);
            }
        }
    }
}

const OBJ: &str = "# a square\nmtllib m.mtl\nv 0 0 0\nv 1 0 0\r\nv 1 1 0\nv 0 1 0.5 1\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nvn 0 1 0\n\
    g a\nusemtl b\nf 1/1/1 2/2/1 3/3/1\nf -4/1/2 -2/3/2 -1/2/2 # the rest\nf 1/1/1 2/2/1 3/3/1 4/3/2\nl 1 2\n";

const PLY_HEADER: &str = " 1.0\ncomment a square\nelement vertex 4\nproperty float x\nproperty double y\nproperty float z\n\
    property float nx\nproperty float ny\nproperty float nz\nproperty float s\nproperty float t\nproperty uchar red\n\
    property ushort green\nproperty half blue\nelement other 1\nproperty list ushort char many\nelement face 2\n\
    property float heat_0\nproperty list uchar int vertex_indices\nend_header\n";

/// A square of two triangles, or of a triangle and a square.
fn ply(encoding: &str, triangles: bool) -> Vec<u8> {
    let mut bytes = format!("ply\nformat {encoding}{PLY_HEADER}").into_bytes();
    let last: &[i32] = if triangles { &[0, 2, 3] } else { &[0, 1, 2, 3] };
    if encoding == "ascii" {
        let text = "0 0 0 0 0 1 0 0 255 65535 1\n1 0 0 0 0 1 1 0 255 7 0\n1 1 0 0 0 1 1 1 3 2 1\n0 1 0.5 0 0 1 0 1 0 0 0.5\n\
            2 -7 8\n0.5 3 0 1 2\n";
        let last: Vec<_> = last.iter().map(i32::to_string).collect();
        return [&bytes[..], text.as_bytes(), format!("1.5 {} {}\n", last.len(), last.join(" ")).as_bytes()]
            .concat();
    }
    let big = encoding == "binary_big_endian";
    let mut push = |mut number: Vec<u8>| {
        if big {
            number.reverse();
        }
        bytes.extend(number);
    };
    for i in 0..4u16 {
        push(f32::from(i % 2).to_le_bytes().to_vec());
        push(f64::from(i / 2).to_le_bytes().to_vec());
        (0..6).for_each(|k| push(f32::from(i + k).to_le_bytes().to_vec()));
        push(vec![200]);
        push((1000 * i).to_le_bytes().to_vec());
        push(0x3c00u16.to_le_bytes().to_vec());
    }
    push(2u16.to_le_bytes().to_vec());
    push(vec![1]);
    push(vec![2]);
    for corners in [&[0, 1, 2], last] {
        push(0.5f32.to_le_bytes().to_vec());
        push(vec![corners.len() as u8]);
        corners.iter().for_each(|c| push(c.to_le_bytes().to_vec()));
    }
    bytes
}

/// Two triangles with everything a file may have, before compression.
fn serialized_data() -> Vec<u8> {
    let mut data = 0x100bu32.to_le_bytes().to_vec();
    data.extend(b"name\0");
    data.extend([4u64.to_le_bytes(), 2u64.to_le_bytes()].concat());
    (0..4 * 11).for_each(|i| data.extend((i as f32).to_le_bytes()));
    data.extend([0u32, 1, 2, 0, 2, 3].map(u32::to_le_bytes).concat());
    data
}

fn serialized(data: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(vec![0x1c, 0x04, 4, 0], Compression::fast());
    encoder.write_all(data).unwrap();
    let mut file = encoder.finish().unwrap();
    file.extend([0u64.to_le_bytes(), 0u64.to_le_bytes()].concat());
    file.extend(2u32.to_le_bytes());
    file
}

/// The valid files: their extension, and their bytes.
fn originals() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("obj", OBJ.into()),
        ("ply", ply("ascii", false)),
        ("ply", ply("binary_little_endian", true)),
        ("ply", ply("binary_little_endian", false)),
        ("ply", ply("binary_big_endian", true)),
        ("serialized", serialized(&serialized_data())),
    ]
}

/// Writes a mesh and a scene of it, and loads them. Also checks what the renderer relies on.
fn check(directory: &Path, extension: &str, bytes: &[u8]) -> Result<bool, TestCaseError> {
    fs::write(directory.join("m"), bytes).unwrap();
    let scene = directory.join(format!("{extension}.xml"));
    let loaded = match load(&scene, &LoadOptions::default()) {
        Ok(loaded) => loaded,
        Err(error) => {
            prop_assert!(error.to_string().contains('m'), "{}", error);
            return Ok(false);
        }
    };
    let Shape::Mesh(mesh) = &loaded.description.shapes[0].shape else { panic!("no mesh") };
    let vertices = mesh.positions.len();
    prop_assert!(mesh.indices.as_flattened().iter().all(|i| (*i as usize) < vertices));
    prop_assert_eq!(mesh.normals.len(), vertices);
    prop_assert!(mesh.uvs.is_empty() || mesh.uvs.len() == vertices);
    prop_assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3), "{:?}", mesh.normals);
    for attribute in &mesh.attributes {
        let n = if attribute.is_per_face() { mesh.indices.len() } else { vertices };
        prop_assert_eq!(attribute.values.len(), n * attribute.channels, "{}", &attribute.name);
    }
    Ok(true)
}

/// Largest resident memory of this process so far, bytes.
fn peak() -> u64 {
    let text = fs::read_to_string("/proc/self/status").unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches("kB").trim().parse::<u64>().unwrap() << 10
}

/// Runs the cases.
fn run(cases: u32) {
    let directory = tempfile::tempdir().unwrap();
    for (extension, _) in originals() {
        let text = format!(
            "<scene version='3.0.0'><sensor type='perspective'/>\
             <shape type='{extension}'><string name='filename' value='m'/></shape></scene>"
        );
        fs::write(directory.path().join(format!("{extension}.xml")), text).unwrap();
    }
    for (extension, bytes) in originals() {
        assert!(
            check(directory.path(), extension, &bytes).unwrap(),
            "{extension}: the valid file is refused"
        );
    }
    let before = peak();
    let config = ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() };
    let edits = || proptest::collection::vec(edit(), 1..4);
    let mut read = 0;
    for (extension, original) in originals() {
        let mut good = 0;
        let run = |edits: Vec<Edit>| {
            let mut bytes = original.clone();
            apply(&mut bytes, &edits);
            good += u32::from(check(directory.path(), extension, &bytes)?);
            Ok(())
        };
        run_all(&config, edits(), run);
        read += good;
    }
    run_all(&config, edits(), |edits| {
        let mut data = serialized_data();
        apply(&mut data, &edits);
        read += u32::from(check(directory.path(), "serialized", &serialized(&data))?);
        Ok(())
    });
    let growth = peak() - before;
    println!("{cases} cases of each format, {read} of all read; memory grew by {} MB", growth >> 20);
    assert!(growth < GROWTH, "memory grew by {growth} bytes");
    assert!(read > cases / 2, "only {read} files could be read: nothing is tested");
}

fn run_all<S: Strategy>(
    config: &ProptestConfig,
    strategy: S,
    test: impl FnMut(S::Value) -> Result<(), TestCaseError>,
) {
    let test = std::cell::RefCell::new(test);
    let result = TestRunner::new(config.clone()).run(&strategy, |value| (test.borrow_mut())(value));
    if let Err(failure) = result {
        panic!("{failure}");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn mutated_meshes_end_in_a_mesh_or_an_error() {
    const INSIDE: &str = "BUFFON_FUZZ_INSIDE";
    if std::env::var_os(INSIDE).is_some() {
        let cases = std::env::var("BUFFON_FUZZ_CASES").ok().and_then(|text| text.parse().ok());
        return run(cases.unwrap_or(CASES));
    }
    let output = Command::new("sh")
        .arg("-c")
        .arg(format!("ulimit -v {LIMIT_KB} && exec \"$0\" --exact --nocapture \"$1\""))
        .arg(std::env::current_exe().unwrap())
        .arg("mesh_robustness::mutated_meshes_end_in_a_mesh_or_an_error")
        .env(INSIDE, "1")
        .output()
        .unwrap();
    let text =
        [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    println!("{text}");
    assert!(output.status.success(), "{text}");
    assert!(text.contains("cases of each format"), "{text}");
}
