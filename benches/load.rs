//! Seconds, MB/s and memory of loading meshes: `cargo bench --bench load [-- FILTER]`.
//!
//! Each row is a height field of triangles with half as many vertices, written to a temporary directory, so that it is
//! read from the system's cache. There are two million triangles, or as many as the name of the row says: `1m` is a
//! million, and `10m` ten million, which takes minutes and is left out unless `BUFFON_LOAD_LARGE` is set. Rows with
//! `tobj` in their name start with a line that the fast path for OBJ files does not read.
//!
//! A load is the whole of `loader::load`, from the file to the description of a scene with vertex normals, in a process
//! of its own. The row shows the median of the runs. Memory is the largest resident set of the process minus the one at
//! its start; beside it is the size of the final arrays.
//!
//! `cargo bench --bench load -- --keep DIRECTORY` writes the files there and keeps them, for other programs to load.

use buffon::loader::{LoadOptions, load};
use buffon::shape::Shape;
use flate2::{Compression, write::ZlibEncoder};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Numbers of squares along each side for two million triangles, for a million and for ten million.
const SIDE: u32 = 1000;
const MILLION: u32 = 707;
const TEN_MILLION: u32 = 2236;
const RUNS: usize = 5;

/// Returns position, normal and texture coordinates of vertex `i` of a field with `side` squares along each side.
fn vertex(i: u32, side: u32) -> [f32; 8] {
    let coordinate = |i: u32| 2.0 * i as f32 / side as f32 - 1.0;
    let (x, y) = (coordinate(i % (side + 1)), coordinate(i / (side + 1)));
    let z = 0.2 * (7.0 * x).sin() * (5.0 * y).cos();
    let (dx, dy) = (1.4 * (7.0 * x).cos() * (5.0 * y).cos(), -(7.0 * x).sin() * (5.0 * y).sin());
    let length = (dx * dx + dy * dy + 1.0).sqrt();
    [x, y, z, -dx / length, -dy / length, 1.0 / length, 0.5 + 0.5 * x, 0.5 + 0.5 * y]
}

fn vertices_of(side: u32) -> impl Iterator<Item = [f32; 8]> {
    (0..(side + 1) * (side + 1)).map(move |i| vertex(i, side))
}

fn triangles_of(side: u32) -> impl Iterator<Item = [u32; 3]> {
    let squares = (0..side * side).map(move |i| (i / side) * (side + 1) + i % side);
    squares.flat_map(move |a| [[a, a + 1, a + side + 2], [a, a + side + 2, a + side + 1]])
}

fn vertices() -> impl Iterator<Item = [f32; 8]> {
    vertices_of(SIDE)
}

fn triangles() -> impl Iterator<Item = [u32; 3]> {
    triangles_of(SIDE)
}

fn ply(encoding: &str, columns: &[usize]) -> Vec<u8> {
    const NAMES: [&str; 8] = ["x", "y", "z", "nx", "ny", "nz", "u", "v"];
    let mut file =
        format!("ply\nformat {encoding} 1.0\nelement vertex {}\n", vertices().count()).into_bytes();
    columns.iter().for_each(|c| file.extend(format!("property float {}\n", NAMES[*c]).bytes()));
    file.extend(
        format!("element face {}\nproperty list uchar int vertex_index\nend_header\n", 2 * SIDE * SIDE)
            .bytes(),
    );
    if encoding == "ascii" {
        let mut text = String::new();
        for vertex in vertices() {
            let numbers: Vec<_> = columns.iter().map(|c| vertex[*c].to_string()).collect();
            let _ = writeln!(text, "{}", numbers.join(" "));
        }
        triangles().for_each(|[a, b, c]| {
            let _ = writeln!(text, "3 {a} {b} {c}");
        });
        file.extend(text.bytes());
        return file;
    }
    vertices().for_each(|vertex| columns.iter().for_each(|c| file.extend(vertex[*c].to_le_bytes())));
    for triangle in triangles() {
        file.push(3);
        file.extend(triangle.map(u32::to_le_bytes).concat());
    }
    file
}

/// Returns an OBJ file with six decimals, as most programs write.
fn obj(all: bool, side: u32) -> Vec<u8> {
    let mut text = String::new();
    for [x, y, z, ..] in vertices_of(side) {
        let _ = writeln!(text, "v {x:.6} {y:.6} {z:.6}");
    }
    if all {
        for [.., u, v] in vertices_of(side) {
            let _ = writeln!(text, "vt {u:.6} {v:.6}");
        }
        for [_, _, _, x, y, z, ..] in vertices_of(side) {
            let _ = writeln!(text, "vn {x:.6} {y:.6} {z:.6}");
        }
    }
    for triangle in triangles_of(side) {
        let [a, b, c] = triangle.map(|i| i + 1);
        let _ = match all {
            true => writeln!(text, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}"),
            false => writeln!(text, "f {a} {b} {c}"),
        };
    }
    text.into_bytes()
}

/// As [`obj`], after a line that only tobj skips.
fn obj_for_tobj(all: bool, side: u32) -> Vec<u8> {
    [b"vp 0 0\n".to_vec(), obj(all, side)].concat()
}

fn serialized() -> Vec<u8> {
    let mut data = 0x1003u32.to_le_bytes().to_vec();
    data.extend(b"height field\0");
    data.extend((vertices().count() as u64).to_le_bytes());
    data.extend((triangles().count() as u64).to_le_bytes());
    for columns in [0..3, 3..6, 6..8] {
        vertices()
            .for_each(|vertex| data.extend(vertex[columns.clone()].iter().flat_map(|v| v.to_le_bytes())));
    }
    triangles().for_each(|triangle| data.extend(triangle.map(u32::to_le_bytes).concat()));
    let mut encoder = ZlibEncoder::new(vec![0x1c, 0x04, 4, 0], Compression::default());
    encoder.write_all(&data).expect("memory is written");
    let mut file = encoder.finish().expect("memory is written");
    file.extend(0u64.to_le_bytes());
    file.extend(1u32.to_le_bytes());
    file
}

/// Makes the contents of a file.
type Contents = fn() -> Vec<u8>;

/// Returns name and contents of the files.
fn files() -> Vec<(&'static str, Contents)> {
    vec![
        ("ply-normals.ply", || ply("binary_little_endian", &[0, 1, 2, 3, 4, 5])),
        ("ply-plain.ply", || ply("binary_little_endian", &[0, 1, 2])),
        ("ply-text.ply", || ply("ascii", &[0, 1, 2, 3, 4, 5])),
        ("obj-all.obj", || obj(true, SIDE)),
        ("obj-plain.obj", || obj(false, SIDE)),
        ("obj-all-1m.obj", || obj(true, MILLION)),
        ("obj-plain-1m.obj", || obj(false, MILLION)),
        ("obj-all-1m-tobj.obj", || obj_for_tobj(true, MILLION)),
        ("obj-plain-1m-tobj.obj", || obj_for_tobj(false, MILLION)),
        ("obj-all-10m.obj", || obj(true, TEN_MILLION)),
        ("obj-plain-10m.obj", || obj(false, TEN_MILLION)),
        ("obj-all-10m-tobj.obj", || obj_for_tobj(true, TEN_MILLION)),
        ("obj-plain-10m-tobj.obj", || obj_for_tobj(false, TEN_MILLION)),
        ("serialized-all.serialized", serialized),
    ]
}

/// Returns an entry of `/proc/self/status` in kB.
fn status(name: &str) -> u64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'));
    line.and_then(|line| line.trim().trim_end_matches("kB").trim().parse().ok()).unwrap_or_default()
}

/// Loads the scene and prints seconds, peak memory in bytes and the size of the arrays in bytes.
fn measure(scene: &Path) {
    let before = status("VmRSS");
    let start = Instant::now();
    let loaded = load(scene, &LoadOptions::default()).expect("a scene");
    let seconds = start.elapsed().as_secs_f64();
    let peak = status("VmHWM").saturating_sub(before) << 10;
    let Shape::Mesh(mesh) = &loaded.description.shapes[0].shape else { panic!("no mesh") };
    let arrays = size_of_val(&mesh.positions[..])
        + size_of_val(&mesh.normals[..])
        + size_of_val(&mesh.uvs[..])
        + size_of_val(&mesh.indices[..]);
    println!("{seconds} {peak} {arrays}");
}

/// Loads a mesh in a process of its own.
fn run(scene: &Path) -> [f64; 3] {
    let program = std::env::current_exe().expect("this program");
    let output = Command::new(program).arg("--measure").arg(scene).output().expect("a process");
    let text = String::from_utf8_lossy(&output.stdout);
    let mut words = text.split_whitespace().map(|word| word.parse().expect("a number"));
    std::array::from_fn(|_| words.next().expect("three numbers"))
}

fn bench(directory: &Path, name: &str, contents: Contents) {
    let contents = contents();
    let megabytes = contents.len() as f64 * 1e-6;
    std::fs::write(directory.join(name), contents).expect("a file");
    let plugin = Path::new(name).extension().expect("an extension").to_string_lossy();
    let scene = directory.join(format!("{name}.xml"));
    let text = format!(
        "<scene version='3.0.0'><sensor type='perspective'/><shape type='{plugin}'><string name='filename' value='{name}'/></shape></scene>"
    );
    std::fs::write(&scene, text).expect("a file");
    let mut runs: Vec<[f64; 3]> = (0..RUNS).map(|_| run(&scene)).collect();
    runs.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let [seconds, peak, arrays] = runs[RUNS / 2];
    println!(
        "{name:<28} {megabytes:>7.1} {seconds:>8.3} {:>8.0} {:>8.1} {:>8.1} {:>6.2}",
        megabytes / seconds,
        peak * 1e-6,
        arrays * 1e-6,
        peak / arrays
    );
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    if let [flag, scene] = &arguments[..]
        && flag == "--measure"
    {
        return measure(Path::new(scene));
    }
    let temporary = tempfile::tempdir().expect("a directory");
    let (directory, filter) = match &arguments[..] {
        [flag, directory, filter @ ..] if flag == "--keep" => (PathBuf::from(directory), filter),
        filter => (temporary.path().to_path_buf(), filter),
    };
    println!(
        "{:<28} {:>7} {:>8} {:>8} {:>8} {:>8} {:>6}",
        "file", "MB", "seconds", "MB/s", "peak MB", "arrays", "ratio"
    );
    let large = std::env::var_os("BUFFON_LOAD_LARGE").is_some();
    for (name, contents) in files() {
        if name.contains("-10m") && !large {
            continue;
        }
        if filter.is_empty() || filter.iter().any(|f| name.contains(f.as_str())) {
            bench(&directory, name, contents);
        }
    }
}
