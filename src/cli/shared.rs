//! Arguments and lists of names that several subcommands share.

use super::values;
use crate::accel::AccelKind;
use crate::error::{Error, Result};
use crate::image::{self, Tonemap};
use crate::integrator::Settings;
use crate::integrator::settings::{AUTO, WhenPays};
use crate::loader::{LoadOptions, Tolerance};
use crate::memory::Limit;
use crate::sampling::SamplerKind;
use crate::session::{Costs, default_threads};
use crate::util::wording::did_you_mean;
use clap::Args;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// The options for loading a scene, of any command.
#[derive(Clone, Debug, Args)]
pub struct SceneArgs {
    /// Set the value of a default of the scene
    #[arg(short = 'D', value_name = "NAME=VALUE", value_parser = values::definition)]
    pub define: Vec<(String, String)>,
    /// Folders to search for the scene's files, besides its own; several are separated by ';'
    #[arg(short = 'a', long, value_name = "DIR", value_delimiter = ';')]
    pub search_path: Vec<PathBuf>,
    /// The most memory that the program may use (4G, 512M); a scene or render that needs more is refused beforehand
    /// [default: the available memory]
    #[arg(long, value_name = "SIZE", value_parser = values::memory)]
    pub memory_limit: Option<Limit>,
    /// Render a scene without the plugins and elements that Buffon does not have: an unknown BSDF is grey and diffuse,
    /// an unknown film is hdrfilm, an unknown integrator is path, an unknown shape, emitter, sensor or element is left
    /// out
    #[arg(long)]
    pub skip_unknown: bool,
    /// Number of threads, which changes the speed but not the pixels [default: all cores]
    #[arg(short, long, visible_alias = "nthreads", value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub threads: Option<u32>,
}

impl SceneArgs {
    /// Returns the options for loading the scene. `integrator` replaces the one of the file.
    pub fn load_options(&self, integrator: Option<&str>) -> LoadOptions {
        LoadOptions {
            defines: self.define.clone(),
            search_paths: self.search_path.clone(),
            memory: self.memory_limit.unwrap_or_default(),
            integrator: integrator.map(str::to_owned),
            replaces_sampler: false,
            sensor: None,
            tolerance: if self.skip_unknown { Tolerance::Unsupported } else { Tolerance::Nothing },
        }
    }

    /// Returns the number of threads.
    pub fn threads(&self) -> usize {
        self.threads.map_or_else(default_threads, |n| n as usize)
    }
}

/// The options for the choice of an integrator by pilots.
#[derive(Clone, Debug, Args)]
pub struct AutoArgs {
    /// Let --integrator auto choose irrcache or photonmapper, too, if their bias in a pilot is at most this (0.01 is
    /// 1 %: a root mean square of relative differences). The bias is part of the error that is reported
    #[arg(long, value_name = "BIAS", allow_negative_numbers = true, value_parser = values::fraction)]
    pub allow_bias: Option<f64>,
    /// What a ray of each integrator costs, for --integrator auto: a file that `buffon bench --calibrate` has written
    /// [default: a table of the program]
    #[arg(long, value_name = "FILE")]
    pub auto_costs: Option<PathBuf>,
    /// Whether bdpt connects paths: auto, always; auto: if pilots find that it pays, else camera paths alone (path or
    /// volpath) render the image [default: the scene's, or auto]
    #[arg(long, value_name = "WHEN", value_parser = values::connections)]
    pub bdpt_connections: Option<WhenPays>,
}

impl AutoArgs {
    /// Returns the costs of integrators.
    ///
    /// # Errors
    /// As [`Costs::read`].
    pub fn costs(&self) -> Result<Option<Costs>> {
        self.auto_costs.as_deref().map(Costs::read).transpose()
    }
}

/// The options for rendering a scene.
#[derive(Clone, Debug, Args)]
pub struct MethodArgs {
    /// The integrator.
    #[arg(long, value_name = "NAME", help = format!("The integrator: {} [default: the scene's]", integrators()))]
    pub integrator: Option<String>,
    /// The sampler.
    #[arg(long, value_name = "NAME", help = sampler_help(), long_help = format!("{}\n\n{SAMPLERS}", sampler_help()))]
    pub sampler: Option<SamplerArg>,
    /// The ray traversal.
    #[arg(long, value_name = "NAME", help = accel_help())]
    pub accel: Option<AccelKind>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
}

/// The choice of a sampler on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SamplerArg {
    /// The scene's, or the default if the scene has none or `independent`.
    Auto,
    /// The scene's.
    Scene,
    /// This one.
    Kind(SamplerKind),
}

impl FromStr for SamplerArg {
    type Err = String;

    fn from_str(name: &str) -> std::result::Result<Self, String> {
        Ok(match name {
            "auto" => SamplerArg::Auto,
            "scene" => SamplerArg::Scene,
            _ => match SamplerKind::ALL.into_iter().find(|kind| kind.name() == name) {
                Some(kind) => SamplerArg::Kind(kind),
                None => {
                    let kinds = SamplerKind::ALL.into_iter().map(SamplerKind::name);
                    let near = did_you_mean(name, kinds.chain(["auto", "scene"]));
                    return Err(format!("unknown sampler \"{name}\"{near}; there are {}", sampler_names()));
                }
            },
        })
    }
}

impl MethodArgs {
    /// Returns the sampler, if the command line names one.
    pub fn sampler(&self) -> Option<SamplerKind> {
        match self.sampler {
            Some(SamplerArg::Kind(kind)) => Some(kind),
            _ => None,
        }
    }

    /// Returns whether the default sampler replaces `independent` in a scene; `default` is for no choice.
    pub fn replaces_independent(&self, default: bool) -> bool {
        self.sampler.map_or(default, |sampler| sampler == SamplerArg::Auto)
    }
}

/// The options for the view.
#[derive(Clone, Debug, Args)]
pub struct ViewArgs {
    /// Index of the sensor in the scene, from 0
    #[arg(short, long, value_name = "N", default_value_t = 0)]
    pub sensor: usize,
    /// Size of the full image, instead of the scene's (a crop in the scene is ignored)
    #[arg(long, value_name = "WxH", value_parser = values::size)]
    pub size: Option<(u32, u32)>,
}

/// The options for images with 8 bits per channel.
#[derive(Clone, Debug, Args)]
pub struct DisplayArgs {
    /// Scale .png and .jpg images by 2^E
    #[arg(long, value_name = "E", default_value_t = 0.0, allow_negative_numbers = true, value_parser = values::exposure)]
    pub exposure: f32,
    /// The tone curve of .png and .jpg images.
    #[arg(long, value_name = "NAME", default_value_t = Tonemap::None, help = tonemap_help())]
    pub tonemap: Tonemap,
}

impl DisplayArgs {
    /// Refuses the options if no output is an image with 8 bits per channel.
    ///
    /// # Errors
    /// If one of the options is given without such an output.
    pub fn check<'a>(&self, outputs: impl IntoIterator<Item = &'a Path>) -> Result<()> {
        let option = match (self.exposure != 0.0, self.tonemap) {
            (true, _) => "--exposure",
            (false, Tonemap::None) => return Ok(()),
            (false, _) => "--tonemap",
        };
        match outputs.into_iter().any(image::is_display_format) {
            true => Ok(()),
            false => Err(Error::usage(format!(
                "{option}: only .png and .jpg images have it, and no output is one"
            ))),
        }
    }
}

fn tonemap_help() -> String {
    format!("The tone curve of .png and .jpg images: {}", one_of(Tonemap::ALL.map(Tonemap::name)))
}

/// The description of the samplers.
const SAMPLERS: &str = "auto: the scene's; but sobol, with a note, if the scene names independent, which most exporters \
    write. scene: the scene's. independent: uniform random numbers, what the others are measured against. \
    stratified, multijitter: one sample in each cell of a grid, and with multijitter one in each narrow row and \
    column; they fill all of their cells at some numbers of samples only, of which every power of two is one. \
    halton, sobol: scrambled sequences that may stop at any number of samples, halton best at 12, 72 or 432, sobol \
    at powers of two. zsobol: one Sobol sequence over the whole screen, so that the error is blue noise; it needs \
    a power of two. fixed: the same Sobol points in every pixel, so that the error shows as structure.";

fn sampler_names() -> String {
    one_of(["auto", "scene"].into_iter().chain(SamplerKind::ALL.map(SamplerKind::name)))
}

fn sampler_help() -> String {
    format!("The sampler: {} [default: auto; of regress: scene]", sampler_names())
}

/// Returns the help of the traversal.
pub fn accel_help() -> String {
    format!(
        "The ray traversal: {} [default: auto, a list of a few surfaces, in front of a tree if there are more]",
        accels()
    )
}

/// Returns the names of the integrators: "auto, path or aov".
pub fn integrators() -> String {
    one_of(std::iter::once(&AUTO).chain(Settings::NAMES))
}

/// Returns the names of the samplers.
pub fn samplers() -> String {
    one_of(SamplerKind::ALL)
}

/// Returns the names of the traversals of this build.
pub fn accels() -> String {
    one_of(AccelKind::CHOICES)
}

/// Returns "a, b or c".
pub fn one_of<T: ToString>(names: impl IntoIterator<Item = T>) -> String {
    let mut names: Vec<String> = names.into_iter().map(|name| name.to_string()).collect();
    let last = names.pop().unwrap_or_default();
    if names.is_empty() { last } else { format!("{} or {last}", names.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_sentences() {
        assert_eq!(
            [one_of(["a"]), one_of(["a", "b"]), one_of(["a", "b", "c"])],
            ["a", "a or b", "a, b or c"]
        );
    }
}
