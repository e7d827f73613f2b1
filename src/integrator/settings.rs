//! The parameters of integrators, as given in a scene file or on the command line.

use super::photon::Kernel;

/// A feature of the first surface that a camera ray hits, written as an image layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum Aov {
    /// Directional albedo under uniform white illumination.
    Albedo,
    /// Geometric normal in world space.
    GeometricNormal,
    /// Shading normal in world space.
    ShadingNormal,
    /// Position in world space.
    Position,
    /// Distance from the camera along the ray.
    Depth,
    /// Texture coordinates.
    Uv,
    /// Index of the triangle within its shape.
    PrimitiveIndex,
    /// Index of the shape within the scene.
    ShapeIndex,
    /// Variance of the pixel's mean, estimated from the replicates: two (one degree of freedom), or eight if pixels
    /// share noise.
    Variance,
    /// Standard error of the pixel's mean: the square root of its variance.
    StandardError,
    /// Variance of the sum over the pixel's block of 4 x 4 pixels, divided by the number of its pixels. Blocks are
    /// counted from the image's first pixel. It includes the error that pixels share.
    BlockVariance,
    /// Number of samples of the pixel.
    Samples,
    /// Weighted mean radius of the irradiance records that apply at the surface.
    RecordRadius,
}

/// An image layer: its name in the file and its content.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Layer {
    /// Prefix of the channel names.
    pub name: String,
    /// Content.
    pub aov: Aov,
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

/// Direct illumination only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct DirectSettings {
    /// Samples of the emitters at each shading point.
    pub emitter_samples: u32,
    /// Samples of the BSDF at each shading point.
    pub bsdf_samples: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl Default for DirectSettings {
    fn default() -> Self {
        DirectSettings { emitter_samples: 1, bsdf_samples: 1, hide_emitters: false }
    }
}

/// Hard shadows, mirrors and glass. [Whitted 1980]
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct WhittedSettings {
    /// Greatest number of edges of a path from camera to emitter: 1 shows emitters only, 2 adds direct light (ray
    /// casting). At most [`MAX_DEPTH`](Self::MAX_DEPTH).
    pub max_depth: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl WhittedSettings {
    /// The upper limit of `max_depth`: glass doubles the number of rays at every level.
    pub const MAX_DEPTH: u32 = 20;
    /// The greatest number of rays at the last level of a camera ray's tree.
    pub const MAX_RAYS: u64 = 1 << 20;
}

impl Default for WhittedSettings {
    fn default() -> Self {
        WhittedSettings { max_depth: 8, hide_emitters: false }
    }
}

/// Distribution ray tracing. [Cook 1984]
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct DistributionSettings {
    /// Greatest number of edges of a path from camera to emitter: 1 shows emitters only, 2 adds direct light.
    pub max_depth: u32,
    /// Samples of the emitters at each surface.
    pub emitter_samples: u32,
    /// BSDF samples at each surface, at least 1; each Dirac delta gets one.
    pub bsdf_samples: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl DistributionSettings {
    /// The greatest number of rays at the last level of a camera ray's tree. If Dirac deltas would exceed it, each
    /// surface continues with one ray.
    pub const MAX_RAYS: u64 = 1 << 20;

    /// Returns the greatest number of rays at the last level of a camera ray's tree, Dirac deltas excepted.
    pub fn rays_at_last_level(&self) -> u64 {
        u64::from(self.bsdf_samples).saturating_pow(self.max_depth.saturating_sub(1))
    }
}

impl Default for DistributionSettings {
    fn default() -> Self {
        DistributionSettings { max_depth: 4, emitter_samples: 4, bsdf_samples: 4, hide_emitters: false }
    }
}

/// Irradiance caching around another integrator. [Ward 1988]
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct IrrcacheSettings {
    /// Number of elevation strata of a record's hemisphere, at least 2; there are π times as many azimuth strata.
    /// Each of the eight replicates has its own records.
    pub resolution: u32,
    /// Accuracy, positive. The radii of records are inversely proportional to it, so their number grows with its
    /// square.
    pub quality: f32,
    /// Whether interpolation uses the records' gradients.
    pub gradients: bool,
    /// Whether a record's radius is limited by its neighbours' radii. [Křivánek 2006]
    pub clamp_neighbor: bool,
    /// Whether the radii of records are clamped to a range in pixels.
    pub clamp_screen: bool,
    /// Whether an overture pass creates records over the image. Otherwise records come only from a cache file.
    pub overture: bool,
    /// Factor on the quality when the cache is used, in (0, 1]; a smaller factor averages more records.
    pub quality_adjustment: f32,
    /// Whether only the light from the cache is shown.
    pub indirect_only: bool,
    /// Whether the positions of records are drawn over the image.
    pub debug: bool,
    /// The integrator of the light that records gather.
    pub child: Box<Settings>,
}

impl Default for IrrcacheSettings {
    fn default() -> Self {
        IrrcacheSettings {
            resolution: 9,
            quality: 1.0,
            gradients: true,
            clamp_neighbor: true,
            clamp_screen: true,
            overture: true,
            quality_adjustment: 0.7,
            indirect_only: false,
            debug: false,
            child: Box::default(),
        }
    }
}

/// Photon maps and final gathering. [Jensen 2001]
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PhotonmapperSettings {
    /// The paths from the camera and from emitters.
    pub limits: PathLimits,
    /// Emitter samples at the first surface that is not specular, at least 1.
    pub direct_samples: u32,
    /// BSDF samples at that surface if all its lobes are glossy, at least 1.
    pub glossy_samples: u32,
    /// BSDF samples at that surface if it has a diffuse lobe, at least 1: the final gather.
    pub gather_samples: u32,
    /// Number of photons in each global map.
    pub global_photons: u32,
    /// Number of photons in each caustic map.
    pub caustic_photons: u32,
    /// Maximum lookup radius in the global map, relative to the radius of the scene; positive.
    pub global_lookup_radius: f32,
    /// Maximum lookup radius in the caustic map, relative to the radius of the scene; positive.
    pub caustic_lookup_radius: f32,
    /// Number of photons in a lookup, at least 2.
    pub lookup_size: u32,
    /// The kernel that weights photons by their distance.
    pub kernel: Kernel,
    /// The debug image to show instead of the rendered image.
    pub debug: PhotonDebug,
}

/// The output of a photon mapper.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum PhotonDebug {
    /// The rendered image.
    #[default]
    None,
    /// The photons of the global map as coloured points.
    Photons,
    /// The radiance estimate of the global map at the first surface, without direct sampling or final gathering.
    Radiance,
}

impl Default for PhotonmapperSettings {
    fn default() -> Self {
        PhotonmapperSettings {
            limits: PathLimits::default(),
            direct_samples: 1,
            glossy_samples: 1,
            gather_samples: 4,
            global_photons: 250_000,
            caustic_photons: 500_000,
            global_lookup_radius: 0.05,
            caustic_lookup_radius: 0.0125,
            lookup_size: 120,
            kernel: Kernel::Epanechnikov,
            debug: PhotonDebug::None,
        }
    }
}

/// Stochastic progressive photon mapping. [Hachisuka and Jensen 2009; Knaus and Zwicker 2011]
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct SppmSettings {
    /// The paths from the camera and from emitters.
    pub limits: PathLimits,
    /// Light paths in each pass, with one pass for each sample of the pixels; 0 selects one for each pixel of the
    /// full image.
    pub photon_count: u32,
    /// Radius of the first pass in scene units; 0 selects three pixel widths.
    pub initial_radius: f32,
    /// Whether a pilot pass learns how to emit light paths whose photons are visible.
    pub guided: bool,
    /// Parameter of the radius reduction, in (0, 1]; 1 keeps the radius, and its blur, constant.
    pub alpha: f32,
}

impl Default for SppmSettings {
    fn default() -> Self {
        SppmSettings {
            limits: PathLimits::default(),
            photon_count: 0,
            initial_radius: 0.0,
            guided: true,
            alpha: 0.7,
        }
    }
}

/// An integrator and its parameters.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub enum Settings {
    /// Path tracing.
    Path(PathLimits),
    /// Direct illumination.
    Direct(DirectSettings),
    /// Hard shadows, mirrors and glass.
    Whitted(WhittedSettings),
    /// Distribution ray tracing.
    Distribution(DistributionSettings),
    /// Distance to the first surface.
    Depth,
    /// Light tracing.
    Ptracer(PathLimits),
    /// Irradiance caching.
    Irrcache(IrrcacheSettings),
    /// Photon maps and final gathering.
    Photonmapper(PhotonmapperSettings),
    /// Stochastic progressive photon mapping.
    Sppm(SppmSettings),
    /// Layers of surface features, optionally in addition to the image of another integrator.
    Aov {
        /// The layers in file order.
        layers: Vec<Layer>,
        /// The integrator of the image; `None` for a black image.
        image: Option<Box<Settings>>,
    },
}

impl Default for Settings {
    fn default() -> Self {
        Settings::Path(PathLimits::default())
    }
}

impl Settings {
    /// The names of all integrators.
    pub const NAMES: [&str; 10] = [
        "path",
        "direct",
        "ptracer",
        "photonmapper",
        "sppm",
        "whitted",
        "distribution",
        "irrcache",
        "depth",
        "aov",
    ];

    /// Returns an integrator's default settings with the given limits; `None` if there is none of the name. Trees of
    /// rays, whose cost is exponential in the depth, are no deeper than by default. `aov` has no layers and no image.
    pub fn by_name(name: &str, limits: PathLimits) -> Option<Self> {
        let hide_emitters = limits.hide_emitters;
        let depth = |default: u32| limits.max_depth.map_or(default, |depth| depth.min(default));
        Some(match name {
            "path" => Settings::Path(limits),
            "ptracer" => Settings::Ptracer(limits),
            "photonmapper" => Settings::Photonmapper(PhotonmapperSettings { limits, ..Default::default() }),
            "sppm" => Settings::Sppm(SppmSettings { limits, ..Default::default() }),
            "direct" => Settings::Direct(DirectSettings { hide_emitters, ..Default::default() }),
            "whitted" => {
                let max_depth = depth(WhittedSettings::default().max_depth);
                Settings::Whitted(WhittedSettings { max_depth, hide_emitters })
            }
            "distribution" => {
                let default = DistributionSettings::default();
                let max_depth = depth(default.max_depth);
                Settings::Distribution(DistributionSettings { max_depth, hide_emitters, ..default })
            }
            "irrcache" => {
                let child = Box::new(Settings::Path(limits));
                Settings::Irrcache(IrrcacheSettings { child, ..Default::default() })
            }
            "depth" => Settings::Depth,
            "aov" => Settings::Aov { layers: Vec::new(), image: None },
            _ => return None,
        })
    }

    /// Returns the limits of the paths, as far as the integrator has any.
    pub fn limits(&self) -> PathLimits {
        let default = PathLimits::default();
        match self {
            Settings::Path(limits) | Settings::Ptracer(limits) => *limits,
            Settings::Photonmapper(settings) => settings.limits,
            Settings::Sppm(settings) => settings.limits,
            Settings::Direct(direct) => PathLimits { hide_emitters: direct.hide_emitters, ..default },
            Settings::Whitted(WhittedSettings { max_depth, hide_emitters })
            | Settings::Distribution(DistributionSettings { max_depth, hide_emitters, .. }) => {
                PathLimits { max_depth: Some(*max_depth), hide_emitters: *hide_emitters, ..default }
            }
            Settings::Irrcache(irrcache) => match irrcache.child.as_ref() {
                Settings::Path(limits) => *limits,
                _ => default,
            },
            Settings::Depth | Settings::Aov { .. } => default,
        }
    }

    /// Returns the integrator's name in the scene language.
    pub fn name(&self) -> &'static str {
        match self {
            Settings::Path(_) => "path",
            Settings::Direct(_) => "direct",
            Settings::Whitted(_) => "whitted",
            Settings::Distribution(_) => "distribution",
            Settings::Depth => "depth",
            Settings::Ptracer(_) => "ptracer",
            Settings::Irrcache(_) => "irrcache",
            Settings::Photonmapper(_) => "photonmapper",
            Settings::Sppm(_) => "sppm",
            Settings::Aov { .. } => "aov",
        }
    }
}
