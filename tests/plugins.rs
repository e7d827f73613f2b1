//! The scenes under `scenes/plugins`, one for each plugin and more for some, against references of many samples.
//!
//! The references are Buffon's own, and stored after the scene was verified as docs/plugins.md says. To make one anew,
//! delete it and run `cargo test --release plugins -- --ignored`.

use assert_cmd::Command;
use buffon::image::{Image, read, z_test};
use std::fs;
use std::path::{Path, PathBuf};

/// The probability that a right program fails: all seeds are fixed, so it passes always once it passes.
const SIGNIFICANCE: f64 = 0.01;
/// Samples per pixel of a reference, and of a test.
const SPP: [u32; 2] = [2048, 64];
/// Their seeds.
const SEEDS: [u32; 2] = [1, 2];
/// How far the mean of a layer may be off, relative to that of its magnitude: layers have no variance.
const LAYER_TOLERANCE: f64 = 0.02;

/// All scenes, in order of their names.
fn scenes() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/plugins");
    let files = |folder: &Path| -> Vec<PathBuf> {
        fs::read_dir(folder).expect("a folder can be read").flatten().map(|entry| entry.path()).collect()
    };
    let families = files(&root).into_iter().filter(|path| path.is_dir() && !path.ends_with("parts"));
    let mut scenes: Vec<PathBuf> = families.flat_map(|family| files(&family)).collect();
    scenes.retain(|path| path.extension().is_some_and(|e| e == "xml"));
    scenes.sort();
    scenes
}

fn reference(scene: &Path) -> PathBuf {
    let name = scene.file_stem().expect("a scene has a name");
    scene.with_file_name("refs").join(name).with_extension("exr")
}

fn render(scene: &Path, which: usize, out: &Path) {
    fs::create_dir_all(out.parent().expect("a folder")).expect("a folder can be made");
    Command::new(env!("CARGO_BIN_EXE_buffon"))
        .args(["render", "--strict", "--quiet", "--aov", "variance"])
        .args(["--spp", &SPP[which].to_string(), "--seed", &SEEDS[which].to_string(), "-o"])
        .arg(out)
        .arg(scene)
        .assert()
        .success();
}

/// What is wrong with a rendering, if anything.
fn fault(image: &Image, reference: &Image, significance: f64) -> Option<String> {
    let test = match z_test(image, reference, None, significance) {
        Ok(test) => test,
        Err(error) => return Some(error.to_string()),
    };
    if !test.passes() {
        let at = &test.max_at;
        return Some(format!(
            "{:.2} % of the blocks accepted, rms {:.2}, bias {:.2} with probability {:.1e}, |z| {:.1} at {}, {}",
            100.0 * test.accepted,
            test.rms,
            test.bias,
            test.bias_probability,
            test.max,
            at.x,
            at.y
        ));
    }
    if image.channels != reference.channels {
        return Some(format!("channels {:?} instead of {:?}", image.channels, reference.channels));
    }
    let layers = reference.channels.iter().filter(|c| c.contains('.') && !c.starts_with("variance."));
    let mut off = layers.filter_map(|layer| {
        let [x, r] = [image, reference].map(|i| i.select(&[layer]).expect("a channel is there").data);
        let difference: f64 = x.iter().zip(&r).map(|(x, r)| f64::from(*x) - f64::from(*r)).sum();
        let magnitude: f64 = r.iter().map(|r| f64::from(r.abs())).sum();
        let share = difference.abs() / magnitude;
        (share.is_nan() || share > LAYER_TOLERANCE).then(|| format!("the layer {layer} is off by {share}"))
    });
    off.next()
}

#[test]
fn every_plugin_renders_its_reference() {
    let scenes = scenes();
    assert!(scenes.len() >= 90, "{} scenes", scenes.len());
    // Šidák: the share of each scene.
    let each = -((-SIGNIFICANCE).ln_1p() / scenes.len() as f64).exp_m1();
    let mut faults = Vec::new();
    for scene in &scenes {
        let family = scene.parent().and_then(Path::file_name).expect("a family");
        let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("plugins").join(family);
        let out = out.join(scene.file_stem().expect("a name")).with_extension("exr");
        render(scene, 1, &out);
        let image = read(&out).expect("what was rendered can be read");
        let reference = reference(scene);
        let fault = match read(&reference) {
            Ok(reference) => fault(&image, &reference, each),
            Err(error) => Some(error.to_string()),
        };
        faults.extend(fault.map(|fault| format!("{}: {fault}\n  {}", scene.display(), out.display())));
    }
    assert!(faults.is_empty(), "{} of {} scenes:\n{}", faults.len(), scenes.len(), faults.join("\n"));
}

#[test]
#[ignore = "renders the references that are missing"]
fn missing_references_are_made() {
    for scene in scenes() {
        let reference = reference(&scene);
        if !reference.exists() {
            render(&scene, 0, &reference);
        }
    }
}
