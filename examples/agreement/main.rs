//! Renders random scenes on which all estimators must agree: `cargo run --release --example agreement -- 300`.
//!
//! Generates this many scenes and renders each with every integrator that supports it, on every traversal. An image
//! that differs from that of `path` is rendered again with 8 and then 64 times as many samples. A difference that
//! remains is a finding. The probability that a run of correct images has any is `--significance` (0.01), divided by
//! the number of comparisons. Estimators that are biased by design are compared by the means of their images, to 10 %.
//! The scene of each finding is simplified as long as the images differ, and written.
//!
//! Options: `--seed N`, `--first N` (the number of the first scene), `--threads N`, `--out FOLDER` (for findings),
//! `--oracle FOLDER` (write all scenes for another renderer, without rendering them), `--significance P`.

mod compare;
mod generate;
mod node;

use compare::{Comparer, Finding, LOOKS, Tally, estimators};
use generate::Random;
use node::Node;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// The maximum number of simpler scenes that are rendered for a finding.
const TRIES: usize = 300;

struct Options {
    scenes: u64,
    first: u64,
    seed: u64,
    threads: usize,
    significance: f64,
    out: PathBuf,
    oracle: Option<PathBuf>,
}

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let options = options()?;
    if let Some(folder) = &options.oracle {
        return write_all(folder, &options);
    }
    std::fs::create_dir_all(&options.out)?;
    let next = AtomicU64::new(options.first);
    let (tally, found) = (Mutex::new(Tally::default()), Mutex::new(0u64));
    let work = || -> std::io::Result<()> {
        let folder = tempfile::tempdir()?;
        write_assets(folder.path())?;
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= options.first + options.scenes {
                return Ok(());
            }
            let findings = look_at(number, folder.path(), &options, &tally)?;
            *found.lock().expect("no thread panics") += findings;
        }
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..options.threads).map(|_| scope.spawn(work)).collect();
        threads.into_iter().try_for_each(|thread| thread.join().expect("no thread panics"))
    })?;
    let tally = tally.into_inner().expect("no thread panics");
    println!("compared with path:");
    tally.compared.iter().for_each(|(name, n)| println!("  {n:>6}  {name}"));
    if !tally.refused.is_empty() {
        println!("refused:");
        tally.refused.iter().for_each(|(name, n)| println!("  {n:>6}  {name}"));
    }
    let found = found.into_inner().expect("no thread panics");
    println!("{} scenes, {found} findings (significance {} over all)", options.scenes, options.significance);
    if found > 0 { Err("estimators differ".into()) } else { Ok(()) }
}

fn options() -> Result<Options, Failure> {
    let mut options = Options {
        scenes: 300,
        first: 0,
        seed: 1,
        threads: std::thread::available_parallelism()?.get(),
        significance: 0.01,
        out: "out/agreement".into(),
        oracle: None,
    };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument}: expected a value"));
        match argument.as_str() {
            "--seed" => options.seed = value()?.parse()?,
            "--first" => options.first = value()?.parse()?,
            "--threads" => options.threads = value()?.parse()?,
            "--significance" => options.significance = value()?.parse()?,
            "--out" => options.out = value()?.into(),
            "--oracle" => options.oracle = Some(value()?.into()),
            number => {
                options.scenes =
                    number.parse().map_err(|_| format!("{number}: expected a number of scenes"))?
            }
        }
    }
    Ok(options)
}

/// Returns the scene with a number, and the settings of its integrators.
fn scene(options: &Options, number: u64) -> (Node, Vec<Node>) {
    let mut random = Random::new(options.seed, number);
    let settings = generate::settings(&mut random);
    (generate::scene(&mut random), settings)
}

/// Writes the files that scenes refer to.
fn write_assets(folder: &Path) -> std::io::Result<()> {
    std::fs::write(folder.join("octahedron.obj"), generate::MESH)?;
    let sky = image::RgbImage::from_fn(16, 8, |x, y| {
        let bright = |k: u32| 40 + ((x * (3 + k) + y * 5) * 37 % 200) as u8;
        image::Rgb([bright(0), bright(1), bright(2)])
    });
    sky.save(folder.join("sky.png")).map_err(std::io::Error::other)
}

fn write_all(folder: &Path, options: &Options) -> Result<(), Failure> {
    std::fs::create_dir_all(folder)?;
    write_assets(folder)?;
    for number in options.first..options.first + options.scenes {
        let (scene, settings) = scene(options, number);
        let text = scene.scene(&compare::integrator(&estimators()[0], &settings, 1));
        std::fs::write(folder.join(format!("{number}.xml")), text)?;
    }
    Ok(())
}

/// Compares the estimators of a scene, writes the findings and returns their number.
fn look_at(number: u64, folder: &Path, options: &Options, sums: &Mutex<Tally>) -> std::io::Result<u64> {
    let comparisons = options.scenes * estimators().len() as u64;
    let comparer = Comparer { folder, comparisons, significance: options.significance };
    let (scene, settings) = scene(options, number);
    let mut tally = Tally::default();
    let findings = match comparer.compare(&scene, &settings, number, None, &mut tally) {
        Ok(findings) => findings,
        Err(error) => {
            let sentence = error.to_string();
            *tally.refused.entry(format!("path: {}", sentence.lines().next().unwrap_or(""))).or_default() +=
                1;
            Vec::new()
        }
    };
    sums.lock().expect("no thread panics").merge(&tally);
    for finding in &findings {
        let Finding { estimator, sentence, .. } = finding;
        println!("scene {number}, {estimator}: {sentence}");
        let (smallest, sentence) = simplest(&comparer, scene.clone(), &settings, number, finding);
        let name = format!("{number}-{estimator}.xml");
        let kind = estimators().into_iter().find(|e| estimator.starts_with(e.integrator));
        let text = smallest.scene(&compare::integrator(&kind.expect("an estimator"), &settings, 1));
        std::fs::write(options.out.join(&name), text)?;
        println!("  simplest: {} ({sentence})", options.out.join(name).display());
    }
    Ok(findings.len() as u64)
}

/// Returns the simplest scene in which an estimator still differs, and the difference.
fn simplest(
    comparer: &Comparer<'_>,
    mut scene: Node,
    settings: &[Node],
    number: u64,
    finding: &Finding,
) -> (Node, String) {
    let mut sentence = finding.sentence.clone();
    let mut unused = Tally::default();
    // The first look that shows the difference is used, because it has the fewest samples.
    let differs = |scene: &Node, look: u64, unused: &mut Tally| {
        let only = Some((finding.estimator.as_str(), &[look][..]));
        comparer.compare(scene, settings, number, only, unused).ok().and_then(|mut found| found.pop())
    };
    let looks = LOOKS.into_iter().find(|look| differs(&scene, *look, &mut unused).is_some());
    let look = looks.unwrap_or(finding.seen);
    let mut tries = 0..TRIES;
    'again: loop {
        for simpler in scene.simpler() {
            if tries.next().is_none() {
                break;
            }
            if let Some(still) = differs(&simpler, look, &mut unused) {
                (scene, sentence) = (simpler, still.sentence);
                continue 'again;
            }
        }
        return (scene, sentence);
    }
}
