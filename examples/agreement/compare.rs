//! Rendering of a scene by all estimators that support it, and comparison of the images.

use crate::node::Node;
use buffon::accel::AccelKind;
use buffon::compare::{ZTest, z_test};
use buffon::error::Error;
use buffon::image::Image;
use buffon::render::{Progress, StopRules};
use buffon::sampling::SamplerKind;
use buffon::session::{Choices, SceneChoices, SceneFile, connected};
use std::collections::BTreeMap;
use std::path::Path;

/// The probability that a correct pair is rendered again with more samples.
const SUSPICIOUS: f64 = 1e-3;
/// The number of samples of each look, as a multiple of the first.
pub const LOOKS: [u64; 3] = [1, 8, 64];
/// Largest ignored difference of the mean of a block, relative to the mean of the image.
const TRIFLE: f64 = 2e-3;
/// Largest accepted difference of the mean of the image for biased estimators, relative.
const BIAS: f64 = 0.1;

/// An estimator of the same image as `path`.
#[derive(Clone, Copy, Debug)]
pub struct Estimator {
    pub integrator: &'static str,
    pub accel: AccelKind,
    /// Number of samples of the first look.
    samples: u64,
    /// Whether the estimator is biased by design. If so, only the mean is compared.
    biased: bool,
    /// Whether the estimator finds all light paths that `path` finds in a scene.
    reaches: fn(&Features) -> bool,
    /// The only supported `max_depth`, if there is one.
    depth: Option<&'static str>,
    /// One of this many scenes is rendered.
    every: u64,
}

/// Features of a scene that limit which paths an estimator can find.
#[derive(Clone, Copy, Debug)]
pub struct Features {
    /// Whether a material has a Dirac delta.
    deltas: bool,
    /// Whether an emitter has no area, or a single direction.
    delta_lights: bool,
}

impl Features {
    pub fn of(scene: &Node) -> Self {
        let is = |node: &Node, tag: &str, plugins: &[&str]| {
            node.tag == tag && node.attribute("type").is_some_and(|kind| plugins.contains(&kind))
        };
        let same_index = |node: &Node| {
            is(node, "bsdf", &["roughdielectric"])
                && node.children.iter().any(|child| child.attribute("name") == Some("ext_ior"))
        };
        let specular = ["conductor", "dielectric", "thindielectric", "plastic", "principledthin", "coating"];
        // Connections pass through holes, except those of emitters, whose whole surface is hit.
        let emits_with_holes = |node: &Node| {
            node.tag == "shape"
                && node.children.iter().any(|child| child.tag == "emitter")
                && node.any(&|part| is(part, "bsdf", &["null", "mask"]))
        };
        Features {
            deltas: scene
                .any(&|node| is(node, "bsdf", &specular) || same_index(node) || emits_with_holes(node)),
            delta_lights: scene.any(&|node| is(node, "emitter", &["point", "spot", "directional"])),
        }
    }

    fn paths_find_all(&self) -> bool {
        !(self.deltas && self.delta_lights)
    }

    fn light_paths_find_all(&self) -> bool {
        !self.deltas
    }
}

fn always(_: &Features) -> bool {
    true
}

/// Returns all estimators. The first one is the reference.
pub fn estimators() -> Vec<Estimator> {
    let native = AccelKind::default();
    let of = |integrator, samples| Estimator {
        integrator,
        accel: native,
        samples,
        biased: false,
        reaches: always,
        depth: None,
        every: 1,
    };
    let mut all = vec![of("path", 256)];
    for &accel in AccelKind::ALL.iter().filter(|accel| **accel != native) {
        all.push(Estimator { accel, ..of("path", 256) });
    }
    all.extend([
        of("distribution", 32),
        Estimator { depth: Some("2"), ..of("direct", 256) },
        Estimator { reaches: Features::light_paths_find_all, ..of("ptracer", 1024) },
        Estimator { reaches: Features::paths_find_all, ..of("bdpt", 256) },
        Estimator { reaches: Features::paths_find_all, ..of("pssmlt", 256) },
        Estimator { reaches: Features::paths_find_all, biased: true, ..of("vcm", 64) },
        Estimator { reaches: Features::paths_find_all, biased: true, ..of("sppm", 64) },
        Estimator { reaches: Features::paths_find_all, biased: true, every: 32, ..of("photonmapper", 32) },
        Estimator { reaches: Features::paths_find_all, biased: true, every: 16, ..of("irrcache", 32) },
    ]);
    all
}

/// A significant difference.
#[derive(Clone, Debug)]
pub struct Finding {
    pub estimator: String,
    pub sentence: String,
    /// The look at which it was found, as a multiple of the samples of the first.
    pub seen: u64,
}

/// The number of comparisons by estimator, and of refused scenes by estimator and error.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    pub compared: BTreeMap<String, u64>,
    pub refused: BTreeMap<String, u64>,
}

impl Tally {
    pub fn merge(&mut self, other: &Tally) {
        for (sum, part) in [(&mut self.compared, &other.compared), (&mut self.refused, &other.refused)] {
            part.iter().for_each(|(key, n)| *sum.entry(key.clone()).or_default() += n);
        }
    }
}

/// Returns the integrator's element.
pub fn integrator(estimator: &Estimator, settings: &[Node], look: u64) -> Node {
    let mut node = Node::plugin("integrator", estimator.integrator);
    if estimator.integrator == "irrcache" {
        let inner = settings.iter().cloned().fold(Node::plugin("integrator", "path"), Node::add);
        return node.add(Node::value("float", "quality", 2)).add(inner);
    }
    if estimator.depth.is_none() {
        node = settings.iter().cloned().fold(node, Node::add);
    } else {
        let rest = settings.iter().filter(|value| value.attribute("name") != Some("max_depth"));
        node = rest.cloned().fold(node, Node::add);
    }
    match estimator.integrator {
        "distribution" => node.add(Node::value("integer", "bsdf_samples", 2)),
        "sppm" | "vcm" => {
            // Later looks use smaller disks, and so have less bias.
            let radius = 0.06 * (look as f64).powf(-0.25);
            if estimator.integrator == "sppm" {
                node = node.add(Node::value("integer", "photon_count", 2000));
            }
            node.add(Node::value("float", "initial_radius", radius))
        }
        "photonmapper" => node.add(Node::value("integer", "global_photons", 20_000)).add(Node::value(
            "integer",
            "caustic_photons",
            20_000,
        )),
        _ => node,
    }
}

/// Compares estimators of scenes. The folder contains the files that scenes refer to.
pub struct Comparer<'a> {
    pub folder: &'a Path,
    /// Upper bound on the number of comparisons in the whole run.
    pub comparisons: u64,
    /// The probability that a run with only correct pairs has any finding.
    pub significance: f64,
}

impl Comparer<'_> {
    fn render(&self, scene: &str, estimator: &Estimator, samples: u64, seed: u64) -> Result<Image, Error> {
        let path = self.folder.join("scene.xml");
        std::fs::write(&path, scene).map_err(|e| Error::output(e.to_string()))?;
        let session = SceneFile::load(&path, &SceneChoices::default())?.compile(estimator.accel, 1)?;
        let choices = Choices {
            sampler: Some(SamplerKind::Sobol),
            stop: StopRules { samples: Some(samples), ..StopRules::default() },
            seed,
            aov: vec!["variance".into()],
            connections: connected(estimator.integrator),
            ..Choices::default()
        };
        let plan = session.plan(&choices)?;
        let rendered = session.render(&plan, &Progress::new())?;
        Ok(session.image(&plan, &rendered))
    }

    /// Compares all estimators of a scene at the first look, and at further looks while they differ. Returns an error
    /// if `path` cannot render the scene.
    pub fn compare(
        &self,
        scene: &Node,
        settings: &[Node],
        number: u64,
        only: Option<(&str, &[u64])>,
        tally: &mut Tally,
    ) -> Result<Vec<Finding>, Error> {
        let all = estimators();
        let features = Features::of(scene);
        let depth = settings.iter().find_map(|node| {
            (node.attribute("name") == Some("max_depth")).then(|| node.attribute("value").unwrap_or(""))
        });
        let mut reference: Vec<Image> = Vec::new();
        let mut findings = Vec::new();
        for estimator in &all[1..] {
            let name = format!("{}-{}", estimator.integrator, estimator.accel);
            let fits = estimator.depth.is_none_or(|only| depth == Some(only));
            let due = number.is_multiple_of(estimator.every) || only.is_some();
            if !(fits && due && (estimator.reaches)(&features)) || only.is_some_and(|(only, _)| only != name)
            {
                continue;
            }
            let looks = only.map_or(&LOOKS[..], |(_, looks)| looks);
            let (mut sentence, mut seen) = (None, 0);
            for (i, &look) in looks.iter().enumerate() {
                if reference.len() <= i {
                    let text = scene.scene(&integrator(&all[0], settings, look));
                    let seed = 1000 + look;
                    reference.push(self.render(&text, &all[0], all[0].samples * look, seed)?);
                }
                let text = scene.scene(&integrator(estimator, settings, look));
                let seed = 2000 + look + 7 * i as u64;
                let image = match self.render(&text, estimator, estimator.samples * look, seed) {
                    Ok(image) => image,
                    Err(error) => {
                        let sentence = error.to_string();
                        let sentence = sentence.lines().next().unwrap_or("").to_string();
                        *tally.refused.entry(format!("{name}: {sentence}")).or_default() += 1;
                        break;
                    }
                };
                if i == 0 {
                    *tally.compared.entry(name.clone()).or_default() += 1;
                }
                sentence = self.difference(estimator, &image, &reference[i], i + 1 == looks.len());
                seen = look;
                if sentence.is_none() {
                    break;
                }
            }
            if let Some(sentence) = sentence {
                findings.push(Finding { estimator: name, sentence, seen });
            }
        }
        Ok(findings)
    }

    /// Returns a description of the difference of two images, if there is one.
    fn difference(
        &self,
        estimator: &Estimator,
        image: &Image,
        reference: &Image,
        last: bool,
    ) -> Option<String> {
        let significance = if last { self.significance / self.comparisons as f64 } else { SUSPICIOUS };
        let test = match z_test(&without_trifles(image, reference), reference, None, significance) {
            Ok(test) => test,
            Err(reason) => return Some(reason.to_string()),
        };
        let [a, b] = [image, reference].map(mean);
        if !(a.is_finite() && b.is_finite()) {
            return Some(format!("mean {a}, by paths {b}"));
        }
        if estimator.biased {
            let far = (a - b).abs() > BIAS * b.abs();
            return (far && !test.is_unbiased()).then(|| format!("mean {a:.5}, by paths {b:.5}"));
        }
        let blocks = test.rejected > 0 && (test.block_probability < significance || test.unequal > 0);
        (blocks || !test.is_unbiased()).then(|| {
            format!(
                "mean {a:.5}, by paths {b:.5}; {} of {} blocks rejected (p {:.0e}), bias p {:.0e}",
                test.rejected, test.blocks, test.block_probability, test.bias_probability
            )
        })
    }
}

/// Returns the image with every block of negligible difference replaced by that of the reference. If light is so rare
/// that one image has none of it, its variance is unknown.
fn without_trifles(image: &Image, reference: &Image) -> Image {
    let mut result = image.clone();
    let place = |image: &Image, name| image.channels.iter().position(|c| c == name);
    let (least, side) = (TRIFLE * mean(reference).abs(), ZTest::SIDE);
    let blocks = (0..image.height).step_by(side);
    for (y0, x0) in blocks.flat_map(|y| (0..image.width).step_by(side).map(move |x| (y, x))) {
        let columns = x0..(x0 + side).min(image.width);
        let rows = y0..(y0 + side).min(image.height);
        let pixels: Vec<usize> =
            rows.flat_map(|y| columns.clone().map(move |x| y * image.width + x)).collect();
        for name in ["R", "G", "B"] {
            let (Some(c), Some(d)) = (place(image, name), place(reference, name)) else { continue };
            let own = |i: usize| i * image.channels.len() + c;
            let other = |i: usize| reference.data[i * reference.channels.len() + d];
            let difference = |i: &usize| f64::from(image.data[own(*i)]) - f64::from(other(*i));
            if pixels.iter().map(difference).sum::<f64>().abs() < least * pixels.len() as f64 {
                pixels.iter().for_each(|&i| result.data[own(i)] = other(i));
            }
        }
    }
    result
}

fn mean(image: &Image) -> f64 {
    let picture = image.select(&["R", "G", "B"]);
    picture.map_or(f64::NAN, |p| p.data.iter().map(|v| f64::from(*v)).sum::<f64>() / p.data.len() as f64)
}
