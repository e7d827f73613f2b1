//! What a scene file or the command line says about an integrator.

use super::photon::Kernel;

/// A feature of the first surface that a camera ray meets, written as an image layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum Aov {
    /// Share of the light that a diffuse white illumination would send back.
    Albedo,
    /// Geometric normal in the world.
    GeometricNormal,
    /// Shading normal in the world.
    ShadingNormal,
    /// Position in the world.
    Position,
    /// Distance from the camera along the ray.
    Depth,
    /// Texture coordinates.
    Uv,
    /// Index of the triangle within its shape.
    PrimitiveIndex,
    /// Index of the shape within the scene.
    ShapeIndex,
    /// Variance of the pixel's mean, from the replicates: two, so with one degree of freedom, or eight where pixels
    /// share noise.
    Variance,
    /// Standard error of the pixel's mean: the root of its variance.
    StandardError,
    /// Variance of the sum over the block of 4 x 4 pixels that the pixel is in, counted from the image's first pixel,
    /// over the number of its pixels. It knows what the pixels share.
    BlockVariance,
    /// Number of samples of the pixel.
    Samples,
    /// Radius of the irradiance records that reach the surface, by their weights.
    RecordRadius,
}

/// An image layer: its name in the file and what it holds.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Layer {
    /// Prefix of the channel names.
    pub name: String,
    /// Content.
    pub aov: Aov,
}

/// Path integrator. [Kajiya 1986; Veach 1997]
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct PathSettings {
    /// Longest path in edges, camera to light: 1 shows emitters only, 2 direct light; `None` is unbounded.
    pub max_depth: Option<u32>,
    /// Depth from which Russian roulette may end a path.
    pub rr_depth: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl Default for PathSettings {
    fn default() -> Self {
        PathSettings { max_depth: None, rr_depth: 5, hide_emitters: false }
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
    /// Longest path in edges, camera to light: 1 shows emitters only, 2 direct light (ray casting). At most
    /// [`MAX_DEPTH`](Self::MAX_DEPTH).
    pub max_depth: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl WhittedSettings {
    /// The longest path there may be: glass doubles the rays at every level.
    pub const MAX_DEPTH: u32 = 20;
    /// The most rays that a camera ray may have at the last level of its tree.
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
    /// Longest path in edges, camera to light: 1 shows emitters only, 2 direct light.
    pub max_depth: u32,
    /// Samples of the emitters at each surface.
    pub emitter_samples: u32,
    /// Rays into the BSDF at each surface, at least 1; Dirac deltas get one each.
    pub bsdf_samples: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl DistributionSettings {
    /// The most rays that a camera ray may have at the last level of its tree. Where more would come of Dirac deltas,
    /// one ray goes on from each surface.
    pub const MAX_RAYS: u64 = 1 << 20;

    /// The most rays that a camera ray has at the last level of its tree, but for Dirac deltas.
    pub fn rays_at_last_level(&self) -> u64 {
        u64::from(self.bsdf_samples).saturating_pow(self.max_depth.saturating_sub(1))
    }
}

impl Default for DistributionSettings {
    fn default() -> Self {
        DistributionSettings { max_depth: 4, emitter_samples: 4, bsdf_samples: 4, hide_emitters: false }
    }
}

/// Light tracing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct PtracerSettings {
    /// Longest path in edges, camera to light: 1 shows emitters only, 2 direct light; `None` is unbounded.
    pub max_depth: Option<u32>,
    /// Depth from which Russian roulette may end a path.
    pub rr_depth: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
}

impl Default for PtracerSettings {
    fn default() -> Self {
        PtracerSettings { max_depth: None, rr_depth: 5, hide_emitters: false }
    }
}

/// Irradiance caching around another integrator. [Ward 1988]
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct IrrcacheSettings {
    /// Rings of elevation of a record's hemisphere, at least 2; there are π times as many sectors of azimuth. Each of
    /// the eight replicates has records of its own.
    pub resolution: u32,
    /// Accuracy, positive: radii of records fall as its reciprocal, so their number rises as its square.
    pub quality: f32,
    /// Whether records change between their places by their gradients.
    pub gradients: bool,
    /// Whether a record reaches no farther than a neighbour of it would have it. [Křivánek 2006]
    pub clamp_neighbor: bool,
    /// Whether distances between records are bounded in pixels, from below and from above.
    pub clamp_screen: bool,
    /// Whether the image is searched for places that need records. Without, only a cache file brings any.
    pub overture: bool,
    /// Factor on the quality when the cache is read, in (0, 1]: less averages over more records.
    pub quality_adjustment: f32,
    /// Whether only what the cache serves is shown.
    pub indirect_only: bool,
    /// Whether the places of records are drawn over the image.
    pub debug: bool,
    /// Traces the light that records gather.
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
    /// Longest path in edges, camera to light: 1 shows emitters only, 2 direct light; `None` is unbounded.
    pub max_depth: Option<u32>,
    /// Depth from which Russian roulette may end a path, of the camera or of light.
    pub rr_depth: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
    /// Samples of the emitters at the first surface that is not specular, at least 1.
    pub direct_samples: u32,
    /// Rays into the BSDF there if it has glossy lobes only, at least 1.
    pub glossy_samples: u32,
    /// Rays into the BSDF there if it has a diffuse part, at least 1: the final gather.
    pub gather_samples: u32,
    /// Photons of each global map.
    pub global_photons: u32,
    /// Photons of each caustic map.
    pub caustic_photons: u32,
    /// How far photons of the global map are searched for, over the radius of the scene; positive.
    pub global_lookup_radius: f32,
    /// How far those of the caustic map are.
    pub caustic_lookup_radius: f32,
    /// How many photons are searched for, at least 2.
    pub lookup_size: u32,
    /// How photons count by their distance.
    pub kernel: Kernel,
    /// What is shown instead of the picture.
    pub debug: PhotonDebug,
}

/// What a photon mapper shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum PhotonDebug {
    /// The picture.
    #[default]
    None,
    /// The photons of the global map as points of their colours.
    Photons,
    /// The radiance that these make of the first surface, without direct sampling or final gathering.
    Radiance,
}

impl Default for PhotonmapperSettings {
    fn default() -> Self {
        PhotonmapperSettings {
            max_depth: None,
            rr_depth: 5,
            hide_emitters: false,
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
    /// Longest path in edges, camera to light: 1 shows emitters only, 2 direct light; `None` is unbounded.
    pub max_depth: Option<u32>,
    /// Depth from which Russian roulette may end a path, of the camera or of light.
    pub rr_depth: u32,
    /// Whether emitters are invisible to the camera.
    pub hide_emitters: bool,
    /// Light paths of each pass, one pass for each sample of the pixels; 0 takes one for each pixel of the full image.
    pub photon_count: u32,
    /// Radius of the first pass in scene units; 0 takes three widths of a pixel.
    pub initial_radius: f32,
    /// Whether a pilot learns where light paths should begin so that their photons are seen.
    pub guided: bool,
    /// How slowly radii shrink, in (0, 1]: 1 keeps them, and keeps the blur.
    pub alpha: f32,
}

impl Default for SppmSettings {
    fn default() -> Self {
        SppmSettings {
            max_depth: None,
            rr_depth: 5,
            hide_emitters: false,
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
    Path(PathSettings),
    /// Direct illumination.
    Direct(DirectSettings),
    /// Hard shadows, mirrors and glass.
    Whitted(WhittedSettings),
    /// Distribution ray tracing.
    Distribution(DistributionSettings),
    /// Distance to the first surface.
    Depth,
    /// Light tracing.
    Ptracer(PtracerSettings),
    /// Irradiance caching.
    Irrcache(IrrcacheSettings),
    /// Photon maps and final gathering.
    Photonmapper(PhotonmapperSettings),
    /// Stochastic progressive photon mapping.
    Sppm(SppmSettings),
    /// Layers of surface features, beside the image of another integrator if there is one.
    Aov {
        /// The layers in file order.
        layers: Vec<Layer>,
        /// The integrator that makes the image; `None` for a black image.
        image: Option<Box<Settings>>,
    },
}

impl Default for Settings {
    fn default() -> Self {
        Settings::Path(PathSettings::default())
    }
}

impl Settings {
    /// The integrator's name in the scene language.
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
