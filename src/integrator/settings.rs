//! The settings of integrators, and the table of all integrators.
//!
//! An integrator's file has its parameters, their defaults and how they are read ([`Plugin`]). The table at the end
//! of this file names the integrators.

use super::aov::NoImage;
use super::{
    AmbientOcclusion, Bdpt, DepthIntegrator, DirectIntegrator, DistributionIntegrator, Integrator,
    IrradianceCache, PathIntegrator, Photonmapper, Pssmlt, Ptracer, Sppm, Vcm, VolpathIntegrator,
    WhittedIntegrator, aov,
};
use crate::error::{Error, Result};
pub use crate::util::parameters::{Parameters, Read};

pub use super::ao::AoSettings;
pub use super::aov::{Aov, AovSettings, Layer};
pub use super::bdpt::BdptSettings;
pub use super::bdpt::technique::{Technique, Techniques, techniques_with_edges};
pub use super::depth::DepthSettings;
pub use super::direct::DirectSettings;
pub use super::distribution::DistributionSettings;
pub use super::irrcache::IrrcacheSettings;
pub use super::path::PathSettings;
pub use super::photon::mapper::{PhotonDebug, PhotonmapperSettings};
pub use super::sppm::SppmSettings;
pub use super::vcm::{Combined, VcmSettings};
pub use super::when_pays::WhenPays;
pub use super::whitted::WhittedSettings;

/// The name that stands for the integrator that pilots find to be the best.
pub const AUTO: &str = "auto";
/// The greatest number of samples of one kind at a surface point.
pub const MAX_SAMPLES: u32 = 65_536;
/// The greatest number of light paths in a pass, and of photons in a map.
pub const MAX_PHOTONS: u32 = 100_000_000;

/// How pilots choose the integrator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutoSettings {
    /// The greatest root mean square of relative bias of an integrator; only those without a bias that remains if
    /// `None`.
    pub allow_bias: Option<f64>,
}

impl AutoSettings {
    /// Reads the parameters, and the limits of paths.
    ///
    /// # Errors
    /// If a parameter has another type or is out of range.
    pub fn read(source: &mut dyn Source) -> Result<(Self, PathLimits)> {
        let allow_bias = source.float("allow_bias")?;
        if allow_bias.is_some_and(|bias| !(bias > 0.0 && bias < 1.0)) {
            return Err(source.refusal("allow_bias", "expected a number between 0 and 1"));
        }
        Ok((AutoSettings { allow_bias }, PathLimits::read(source)?))
    }
}

/// An object of a scene file that describes an integrator.
pub trait Source: Parameters {
    /// Reads the integrator inside the object.
    ///
    /// # Errors
    /// As for all that read; if there are several.
    fn integrator(&mut self) -> Result<Option<Settings>>;

    /// Tells the user how the object is rendered.
    fn note(&mut self, text: &str);
}

/// What an integrator finds of [hidden light](crate::scene::Scene::has_hidden_light).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum HiddenLight {
    /// Nothing.
    Missed,
    /// Where the camera sees it neither in mirrors nor through glass.
    Direct,
    /// All that belongs in its image.
    Found,
}

/// An integrator of the scene language.
pub trait Plugin {
    /// Its name in the scene language.
    const NAME: &'static str;
    /// What it finds of hidden light.
    const HIDDEN_LIGHT: HiddenLight = HiddenLight::Found;
    /// Its parameters.
    type Settings;

    /// Reads its parameters.
    ///
    /// # Errors
    /// If a parameter has another type, is out of range or missing.
    fn read(source: &mut dyn Source) -> Result<Self::Settings>;

    /// Returns its default parameters with the given limits.
    fn with_limits(limits: PathLimits) -> Self::Settings;

    /// Returns the limits of its paths, as far as it has any.
    fn limits(settings: &Self::Settings) -> PathLimits;

    /// Creates it.
    fn create(settings: &Self::Settings) -> Box<dyn Integrator>;
}

/// The paths that an integrator follows, and whether the camera sees emitters. These are all settings of path tracing
/// [Kajiya 1986; Veach 1997] and of light tracing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct PathLimits {
    /// Greatest number of edges of a path from camera to emitter: 1 shows emitters only, 2 adds direct light; `None`
    /// is unbounded.
    pub max_depth: Option<u32>,
    /// Depth from which Russian roulette may terminate a path.
    pub rr_depth: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl PathLimits {
    /// Reads the limits.
    ///
    /// # Errors
    /// If a parameter has another type or is out of range.
    pub fn read(source: &mut dyn Source) -> Result<Self> {
        let default = PathLimits::default();
        let max_depth = source.integer("max_depth", -1..=i64::from(u32::MAX))?;
        Ok(PathLimits {
            max_depth: max_depth.map_or(default.max_depth, |depth| u32::try_from(depth).ok()),
            rr_depth: source.count("rr_depth", 1..=u32::MAX, default.rr_depth)?,
            hide_emitters: source.boolean("hide_emitters", default.hide_emitters)?,
        })
    }

    /// Returns the maximum depth for an integrator whose cost is exponential in the depth: at most `most`.
    pub(super) fn depth_within(&self, most: u32) -> u32 {
        self.max_depth.map_or(most, |depth| depth.min(most))
    }

    /// Returns whether a path may have so many edges.
    #[inline]
    pub fn allows(&self, edges: u32) -> bool {
        self.max_depth.is_none_or(|max| edges <= max)
    }
}

impl Default for PathLimits {
    fn default() -> Self {
        PathLimits { max_depth: None, rr_depth: 5, hide_emitters: false }
    }
}

/// Declares [`Settings`] from the table of integrators.
macro_rules! integrators {
    ($($(#[$meta:meta])* $name:ident($plugin:ty),)*) => {
        /// An integrator and its parameters.
        #[derive(Clone, Debug, PartialEq, serde::Serialize)]
        pub enum Settings {
            $($(#[$meta])* $name(<$plugin as Plugin>::Settings),)*
        }

        impl Settings {
            /// The names of all integrators.
            pub const NAMES: &[&str] = &[$(<$plugin as Plugin>::NAME),*];

            /// Reads the parameters of an integrator; `None` if there is none of the name.
            ///
            /// # Errors
            /// As for [`Plugin::read`].
            pub fn read(name: &str, source: &mut dyn Source) -> Result<Option<Self>> {
                Ok(match name {
                    $(<$plugin as Plugin>::NAME => Some(Settings::$name(<$plugin as Plugin>::read(source)?)),)*
                    aov::MOMENT => Some(Settings::Aov(aov::read_moment(source)?)),
                    _ => None,
                })
            }

            /// Returns an integrator's default settings with the given limits; `None` if there is none of the name.
            /// Trees of rays, whose cost is exponential in the depth, are no deeper than by default. `aov` has no
            /// layers and no image.
            pub fn by_name(name: &str, limits: PathLimits) -> Option<Self> {
                Some(match name {
                    $(<$plugin as Plugin>::NAME => Settings::$name(<$plugin as Plugin>::with_limits(limits)),)*
                    _ => return None,
                })
            }

            /// Returns the limits of the paths, as far as the integrator has any.
            pub fn limits(&self) -> PathLimits {
                match self { $(Settings::$name(settings) => <$plugin as Plugin>::limits(settings),)* }
            }

            /// Returns the settings of path tracing, also of the image inside `aov`.
            pub fn path_mut(&mut self) -> Option<&mut PathSettings> {
                match self {
                    Settings::Path(path) => Some(path),
                    Settings::Aov(AovSettings { image: Some(image), .. }) => image.path_mut(),
                    _ => None,
                }
            }

            /// Returns the integrator's name in the scene language.
            pub fn name(&self) -> &'static str {
                match self { $(Settings::$name(_) => <$plugin as Plugin>::NAME,)* }
            }

            /// Returns what the integrator finds of hidden light.
            pub fn hidden_light(&self) -> HiddenLight {
                match self { $(Settings::$name(_) => <$plugin as Plugin>::HIDDEN_LIGHT,)* }
            }

            /// Creates the integrator. The render job handles the layers of `aov`.
            pub fn create(&self) -> Box<dyn Integrator> {
                match self { $(Settings::$name(settings) => <$plugin as Plugin>::create(settings),)* }
            }
        }
    };
}

integrators! {
    /// Path tracing.
    Path(PathIntegrator),
    /// Path tracing in participating media.
    Volpath(VolpathIntegrator),
    /// Direct illumination.
    Direct(DirectIntegrator),
    /// Light tracing.
    Ptracer(Ptracer),
    /// Photon maps and final gathering.
    Photonmapper(Photonmapper),
    /// Stochastic progressive photon mapping.
    Sppm(Sppm),
    /// Hard shadows, mirrors and glass.
    Whitted(WhittedIntegrator),
    /// Distribution ray tracing.
    Distribution(DistributionIntegrator),
    /// Irradiance caching.
    Irrcache(IrradianceCache),
    /// Ambient occlusion.
    Ao(AmbientOcclusion),
    /// Distance to the first surface.
    Depth(DepthIntegrator),
    /// Layers of surface features, optionally in addition to the image of another integrator.
    Aov(NoImage),
    /// Bidirectional path tracing.
    Bdpt(Bdpt),
    /// Vertex connection and merging.
    Vcm(Vcm),
    /// Metropolis light transport in primary sample space.
    Pssmlt(Pssmlt),
}

/// The least limit on the edges of paths at which rays pass thin panes: light of longer paths is weak.
const MANY_EDGES: u32 = 16;

impl Settings {
    /// Returns whether rays pass thin panes as they pass holes, without a bounce. Only integrators whose paths are long
    /// do so: a short path counts each passage as an edge, and a tree of rays follows the reflection and the
    /// transmission. Hidden emitters would be hidden behind panes, too. A file of a cache does not tell whether panes
    /// were passed, so integrators with such files do not pass them.
    pub fn passes_panes(&self) -> bool {
        let limits = match self {
            Settings::Path(_)
            | Settings::Volpath(_)
            | Settings::Bdpt(_)
            | Settings::Vcm(_)
            | Settings::Pssmlt(_)
            | Settings::Ptracer(_)
            | Settings::Sppm(_) => self.limits(),
            Settings::Aov(aov) => return aov.image.as_ref().is_some_and(|image| image.passes_panes()),
            _ => return false,
        };
        !limits.hide_emitters && limits.max_depth.is_none_or(|edges| edges >= MANY_EDGES)
    }

    /// Returns whether the image shows participating media.
    pub fn renders_media(&self) -> bool {
        match self {
            Settings::Volpath(_) | Settings::Bdpt(_) => true,
            Settings::Vcm(vcm) => vcm.combined == Combined::Connections,
            Settings::Aov(aov) => aov.image.as_ref().is_some_and(|image| image.renders_media()),
            _ => false,
        }
    }

    /// Refuses media that the integrator neither renders nor ignores.
    ///
    /// # Errors
    /// If that is so; the message tells what to use instead.
    pub fn check_media(&self) -> Result<()> {
        match self {
            Settings::Aov(AovSettings { image: Some(image), .. }) => image.check_media(),
            _ if self.renders_media() || self.ignores_media() => Ok(()),
            _ => Err(Error::scene(format!(
                "{} does not render the scene's media: use volpath or bdpt, or path for the scene without them",
                self.name()
            ))),
        }
    }

    /// Returns whether every medium is vacuum for the integrator, as for that of the same name in Mitsuba 3.
    pub fn ignores_media(&self) -> bool {
        match self {
            Settings::Path(_)
            | Settings::Direct(_)
            | Settings::Ptracer(_)
            | Settings::Ao(_)
            | Settings::Depth(_) => true,
            Settings::Aov(aov) => aov.image.as_ref().is_none_or(|image| image.ignores_media()),
            _ => false,
        }
    }
}

impl Default for Settings {
    fn default() -> Self {
        Settings::Path(PathSettings::default())
    }
}
