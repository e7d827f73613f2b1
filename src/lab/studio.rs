//! Rendering for experiments: built-in scenes, images, and their noise.

use super::Options;
use super::moments::Measured;
use crate::error::{Error, Result};
use crate::estimate::metrics;
use crate::image::Image;
use crate::integrator::settings::WhenPays;
use crate::integrator::{Counters, Settings};
use crate::render::{JobSettings, Progress, Rendered, StopRules};
use crate::report::{Picture, Viewer, exposure_of, thumbnail};
use crate::sampling::{Sampler, SamplerKind};
use crate::session::{Plan, SceneChoices, SceneFile, Session};

/// A scene with every effect that a pixel integrates over.
pub const ROOM: &str = include_str!("scenes/room.xml");
/// A lamp that lights the ceiling, and a lamp above a glass ball.
pub const LAMPS: &str = include_str!("scenes/lamps.xml");
/// A mirror, glass and rough metal in a diffuse room.
pub const BALLS: &str = include_str!("scenes/balls.xml");

/// A scene that is ready to be rendered at one size.
pub struct Studio {
    session: Session,
    seed: u64,
}

/// An image and the cost of rendering it.
pub struct Shot {
    /// The image.
    pub image: Image,
    /// The numbers of rays and paths.
    pub counters: Counters,
    /// Wall time of sampling.
    pub seconds: f64,
    /// The expected root mean square error, estimated from the two halves of the samples.
    pub noise: f64,
}

/// The sampler of an image and its number of samples.
#[derive(Clone, Copy, Debug)]
pub struct Sampling {
    /// The sampler.
    pub sampler: Sampler,
    /// Samples per pixel.
    pub spp: u64,
}

impl Sampling {
    /// Creates a sampler for a number of samples per pixel.
    pub fn new(kind: SamplerKind, spp: u64) -> Self {
        Sampling { sampler: Sampler::new(kind, Some(spp)), spp }
    }
}

impl Studio {
    /// Loads a built-in scene at a size.
    ///
    /// # Errors
    /// If a temporary file cannot be written, or the scene has an error.
    pub fn open(xml: &str, size: (u32, u32), options: &Options) -> Result<Studio> {
        Studio::open_with(xml, &[], size, options)
    }

    /// Loads a scene as [`open`](Self::open) does, with files that the scene refers to.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_with(
        xml: &str,
        files: &[(&str, &str)],
        size: (u32, u32),
        options: &Options,
    ) -> Result<Studio> {
        let cannot = |e: std::io::Error| Error::output(format!("cannot write a temporary scene: {e}"));
        let folder = tempfile::tempdir().map_err(cannot)?;
        let path = folder.path().join("scene.xml");
        for (name, text) in files.iter().chain([&("scene.xml", xml)]) {
            std::fs::write(folder.path().join(name), text).map_err(cannot)?;
        }
        let choices = SceneChoices { size: Some(size), ..SceneChoices::default() };
        let file = SceneFile::load(&path, &choices)?;
        Ok(Studio { session: file.compile(options.accel, options.threads)?, seed: options.seed })
    }

    /// Renders one image. Images with different `take`s are independent.
    ///
    /// # Errors
    /// If threads cannot be started.
    pub fn shoot(&self, integrator: &Settings, sampling: Sampling, take: u64) -> Result<Shot> {
        let job = JobSettings {
            sampler: sampling.sampler,
            seed: self.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(take),
            threads: self.session.threads,
            stop: StopRules { samples: Some(sampling.spp), ..StopRules::default() },
            layers: Vec::new(),
            squared_bias: None,
        };
        let plan = Plan {
            decision: None,
            integrator: integrator.clone(),
            target: job.stop.samples,
            job,
            adaptive: WhenPays::Never,
            cache: None,
            first: 0,
        };
        let rendered = self.session.render(&plan, &Progress::new())?;
        Ok(Shot {
            image: self.session.image(&plan, &rendered),
            counters: rendered.counters,
            seconds: (rendered.prepared + rendered.elapsed).as_secs_f64(),
            noise: expected_noise(&rendered),
        })
    }

    /// Returns the root mean square error of an unbiased image, measured without a reference. The interval comes from
    /// `pairs` of takes.
    ///
    /// # Errors
    /// As [`shoot`](Self::shoot).
    pub fn noise(&self, integrator: &Settings, sampling: Sampling, pairs: u64) -> Result<Measured> {
        Ok(Measured::root(&self.squares(integrator, sampling, pairs)?))
    }

    /// Returns the mean squared errors of an unbiased image. Half the mean squared difference of two independent takes
    /// is the variance.
    ///
    /// # Errors
    /// As [`shoot`](Self::shoot).
    pub fn squares(&self, integrator: &Settings, sampling: Sampling, pairs: u64) -> Result<Vec<f64>> {
        let mut squares = Vec::new();
        for pair in 0..pairs {
            let [a, b] = [2 * pair, 2 * pair + 1].map(|take| self.shoot(integrator, sampling, take));
            squares.push(0.5 * metrics::mse(&a?.image.data, &b?.image.data));
        }
        Ok(squares)
    }
}

/// Returns the square root of the mean variance of the pixels' colours.
fn expected_noise(rendered: &Rendered) -> f64 {
    let variances: Vec<f64> = rendered
        .tiles
        .iter()
        .flat_map(|tile| (0..tile.pixel_count()).flat_map(move |i| (0..3).map(move |c| tile.estimate(i, c))))
        .map(|estimate| estimate.variance.unwrap_or(f64::NAN))
        .collect();
    Measured::mean(&variances).value.sqrt()
}

/// Width of the small images on the page, in pixels.
const WIDTH: usize = 320;

/// Creates a small image with its caption. All images of a row need the same `exposure`.
///
/// # Errors
/// If the image has no pixel.
pub fn picture(
    image: &Image,
    exposure: f32,
    title: impl Into<String>,
    note: impl Into<String>,
) -> Result<Picture> {
    Ok(Picture { images: vec![thumbnail(image, WIDTH, exposure)?], title: title.into(), note: note.into() })
}

/// Creates a viewer of images, the last of which is the reference.
///
/// # Errors
/// If sizes differ or there are no images.
pub fn viewer(title: &str, images: Vec<(String, &Image)>) -> Result<crate::report::Html> {
    let reference = images.len().checked_sub(1);
    let exposure = images.last().map_or(0.0, |(_, image)| exposure_of(image));
    Viewer { title: title.into(), images, reference, left: 0, right: reference.unwrap_or(0), exposure }.html()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::AccelKind;
    use crate::integrator::settings::{PathLimits, PathSettings};

    /// The noise of 4 samples is twice that of 16 samples, and is the same for the same seed.
    #[test]
    fn noise_is_measured_without_a_reference() {
        let options = Options { seed: 1, runs: 10, quick: true, threads: 2, accel: AccelKind::default() };
        for scene in [ROOM, BALLS] {
            let studio = Studio::open(scene, (24, 18), &options).expect("the scene is well-formed");
            let path = Settings::Path(PathSettings::independent(PathLimits {
                max_depth: Some(3),
                ..PathLimits::default()
            }));
            let noise = |spp| studio.noise(&path, Sampling::new(SamplerKind::Independent, spp), 4);
            let [few, many] = [4, 16].map(|spp| noise(spp).expect("threads start"));
            let ratio = few.value / many.value;
            assert!((1.6..2.5).contains(&ratio), "{ratio}");
            assert_eq!(noise(4).expect("threads start"), few);
        }
    }
}
