//! Instructions for a sample of hot paths: `cargo bench --bench instructions`, or `make bench-check`.
//!
//! Timings of a change of a few percent are lost in the noise of a machine. Instructions are not: valgrind counts those
//! of a render with one thread, twice, with N and with 2N samples per pixel. The difference is that of N samples, so
//! loading, building and pilots do not count. Valgrind's CPU has AVX2 and no AVX-512, whatever the machine's. Counts of
//! two runs differ by up to 1.5 %, because waiting threads count, too.
//!
//! The counts are compared with those of `benches/instructions.toml`. A row that needs 3 % more fails. After a change
//! that is worth it, and for another compiler, `cargo bench --bench instructions -- --update` writes the file.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, ExitCode};

/// The greatest relative increase that passes.
const TOLERANCE: f64 = 0.03;
const BASELINES: &str = "benches/instructions.toml";
/// The size of the images in pixels.
const SIZE: [u64; 2] = [48, 36];

/// What is rendered: a scene, an integrator, and the number of samples per pixel.
const ROWS: [(&str, &str, u64); 10] = [
    ("cornell-box/cornell-box.xml", "path", 16),
    ("environment/environment.xml", "path", 16),
    ("spheres/spheres.xml", "path", 16),
    ("interior/interior.xml", "path", 8),
    ("glass/cornell-glass.xml", "path", 16),
    ("speed/boards.xml", "path", 16),
    ("cornell-box/cornell-box.xml", "direct", 16),
    ("cornell-box/cornell-box.xml", "bdpt", 8),
    ("caustics/glass-sphere.xml", "vcm", 8),
    ("plugins/medium/homogeneous.xml", "volpath", 16),
];

/// Returns the instructions of a render.
fn instructions(scene: &Path, integrator: &str, samples: u64, folder: &Path) -> Result<u64, String> {
    let out = folder.join("callgrind.out");
    let run = Command::new("valgrind")
        .args(["--tool=callgrind", "--quiet"])
        .arg(format!("--callgrind-out-file={}", out.display()))
        .arg(env!("CARGO_BIN_EXE_buffon"))
        .args(["render", "--quiet", "--threads", "1", "--adaptive=never", "--integrator", integrator])
        .args(["--spp", &samples.to_string(), "--size", &format!("{}x{}", SIZE[0], SIZE[1]), "-o"])
        .arg(folder.join("image.exr"))
        .arg(scene)
        .output()
        .map_err(|e| format!("valgrind cannot be run: {e}"))?;
    if !run.status.success() {
        return Err(String::from_utf8_lossy(&run.stderr).into_owned());
    }
    let text = std::fs::read_to_string(&out).map_err(|e| format!("{}: {e}", out.display()))?;
    let total = text.lines().rev().find_map(|line| line.strip_prefix("totals: "));
    total.and_then(|n| n.trim().parse().ok()).ok_or_else(|| "callgrind wrote no total".to_owned())
}

fn run() -> Result<bool, String> {
    let update = std::env::args().any(|argument| argument == "--update");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let known: BTreeMap<String, u64> = match std::fs::read_to_string(root.join(BASELINES)) {
        Ok(text) => toml::from_str(&text).map_err(|e| format!("{BASELINES}: {e}"))?,
        Err(_) => BTreeMap::new(),
    };
    let folder = tempfile::tempdir().map_err(|e| e.to_string())?;
    let mut counts = BTreeMap::new();
    let mut passed = true;
    println!("{:<45} {:>12} {:>12}  change", "instructions for a sample", "found", "known");
    for (scene, integrator, samples) in ROWS {
        let path = root.join("scenes").join(scene);
        let count = |samples| instructions(&path, integrator, samples, folder.path());
        let difference = count(2 * samples)?.saturating_sub(count(samples)?);
        let found = difference / (samples * SIZE[0] * SIZE[1]);
        let name = format!("{integrator} {scene}");
        let (known, change) = match known.get(&name) {
            Some(known) => (known.to_string(), found as f64 / *known as f64 - 1.0),
            None => ("-".to_owned(), 0.0),
        };
        let slower = change > TOLERANCE;
        passed &= !slower;
        let verdict = if slower { "  SLOWER" } else { "" };
        println!("{name:<45} {found:>12} {known:>12}  {:+.1} %{verdict}", 100.0 * change);
        counts.insert(name, found);
    }
    if update {
        let lines = counts.iter().map(|(name, count)| format!("\"{name}\" = {count}\n"));
        let text =
            format!("# Instructions for a sample: see instructions.rs.\n{}", lines.collect::<String>());
        std::fs::write(root.join(BASELINES), text).map_err(|e| format!("{BASELINES}: {e}"))?;
        println!("written to {BASELINES}");
    }
    Ok(passed || update)
}

fn main() -> ExitCode {
    match run() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}
