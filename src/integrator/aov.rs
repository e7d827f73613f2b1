//! Arbitrary output variables: image layers of surface features at the first hit.

use super::settings::{PathLimits, Plugin, Settings, Source};
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::accel::Hit;
use crate::bsdf::Bsdf;
use crate::error::Result;
use crate::math::Ray;
use crate::scene::Scene;
use crate::util::wording::{did_you_mean, quoted};
use bumpalo::Bump;

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
    /// Index of the material within the scene.
    MaterialIndex,
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

/// The settings of an `aov` integrator.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct AovSettings {
    /// The layers in file order.
    pub layers: Vec<Layer>,
    /// The integrator of the image; `None` for a black image.
    pub image: Option<Box<Settings>>,
}

/// The name of an `aov` integrator in the scene language whose only layer is the variance.
pub const MOMENT: &str = "moment";

/// The layers that a scene file can name.
const IN_FILES: [(&str, Aov); 8] = [
    ("albedo", Aov::Albedo),
    ("depth", Aov::Depth),
    ("position", Aov::Position),
    ("uv", Aov::Uv),
    ("geo_normal", Aov::GeometricNormal),
    ("sh_normal", Aov::ShadingNormal),
    ("prim_index", Aov::PrimitiveIndex),
    ("shape_index", Aov::ShapeIndex),
];
const UNSUPPORTED: [&str; 5] = ["dp_du", "dp_dv", "duv_dx", "duv_dy", "boundary_test"];
/// What the layers of an `aov` integrator look like.
const PAIRS: &str = "expected name:kind pairs such as dd.y:depth";

/// The image of an `aov` integrator without a child: black, with alpha 0 where rays hit nothing.
pub struct NoImage;

impl Plugin for NoImage {
    const NAME: &'static str = "aov";
    type Settings = AovSettings;

    fn read(source: &mut dyn Source) -> Result<AovSettings> {
        let image = source.integrator()?.map(Box::new);
        Ok(AovSettings { layers: read_layers(source)?, image })
    }

    fn with_limits(_: PathLimits) -> AovSettings {
        AovSettings::default()
    }

    fn limits(settings: &AovSettings) -> PathLimits {
        settings.image.as_ref().map_or_else(PathLimits::default, |image| image.limits())
    }

    fn create(settings: &AovSettings) -> Box<dyn Integrator> {
        match &settings.image {
            Some(image) => image.create(),
            None => Box::new(NoImage),
        }
    }
}

/// Reads a `moment` integrator.
///
/// # Errors
/// As for [`Plugin::read`].
pub fn read_moment(source: &mut dyn Source) -> Result<AovSettings> {
    let Some(image) = source.integrator()? else {
        return Err(source.object_error("expected an integrator inside it"));
    };
    source.note("moment: the second moments of its layers are written as the variance of the image");
    let layers = vec![Layer { name: "variance".to_owned(), aov: Aov::Variance }];
    Ok(AovSettings { layers, image: Some(Box::new(image)) })
}

/// Reads layers: `name:kind` pairs with commas or spaces between them.
fn read_layers(source: &mut dyn Source) -> Result<Vec<Layer>> {
    let Some(text) = source.text("aovs")? else {
        return Err(source.object_error("the property aovs is missing"));
    };
    let refuse = |message: String| source.error("aovs", &message);
    let mut layers: Vec<Layer> = Vec::new();
    for word in text.split(|c: char| c == ',' || c.is_whitespace()).filter(|w| !w.is_empty()) {
        let pair = word.split_once(':').filter(|(name, kind)| !name.is_empty() && !kind.is_empty());
        let (name, kind) = pair.ok_or_else(|| source.refusal("aovs", PAIRS))?;
        if UNSUPPORTED.contains(&kind) {
            return Err(refuse(format!("the layer kind {} is not supported", quoted(kind))));
        }
        let (_, aov) = IN_FILES.iter().find(|(known, _)| *known == kind).ok_or_else(|| {
            let near = did_you_mean(kind, IN_FILES.iter().map(|(known, _)| *known));
            refuse(format!("unknown layer kind {}{near}", quoted(kind)))
        })?;
        if layers.iter().any(|layer| layer.name == name) {
            return Err(refuse(format!("two layers are named {}", quoted(name))));
        }
        layers.push(Layer { name: name.to_owned(), aov: *aov });
    }
    match layers.is_empty() {
        true => Err(source.refusal("aovs", PAIRS)),
        false => Ok(layers),
    }
}

impl Integrator for NoImage {
    fn name(&self) -> &'static str {
        "aov"
    }

    fn li(
        &self,
        scene: &Scene,
        wave: Wave<'_>,
        _query: RadianceQuery,
        worker: &mut Worker,
        out: &mut [Radiance],
    ) {
        worker.intersect(scene, wave.rays, wave.coherence);
        for (out, hit) in out.iter_mut().zip(&worker.hits) {
            *out = Radiance { distance: hit.map_or(f32::INFINITY, |h| h.t), ..Radiance::NONE };
        }
    }
}

impl Aov {
    /// Returns the suffixes of the layer's channels.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Aov::Albedo | Aov::Variance | Aov::StandardError | Aov::BlockVariance => &["R", "G", "B"],
            Aov::GeometricNormal | Aov::ShadingNormal | Aov::Position => &["X", "Y", "Z"],
            Aov::Uv => &["U", "V"],
            Aov::Depth => &["T"],
            Aov::PrimitiveIndex | Aov::ShapeIndex | Aov::MaterialIndex => &["I"],
            Aov::Samples => &["N"],
            Aov::RecordRadius => &["R"],
        }
    }

    /// Returns the layer with the given name on the command line.
    pub fn by_name(name: &str) -> Option<Aov> {
        Some(match name {
            "albedo" => Aov::Albedo,
            "N" | "sh_normal" => Aov::ShadingNormal,
            "geo_normal" => Aov::GeometricNormal,
            "P" | "position" => Aov::Position,
            "Z" | "depth" => Aov::Depth,
            "uv" => Aov::Uv,
            "prim_index" => Aov::PrimitiveIndex,
            "shape_index" => Aov::ShapeIndex,
            "material_index" => Aov::MaterialIndex,
            "variance" => Aov::Variance,
            "standard_error" => Aov::StandardError,
            "block_variance" => Aov::BlockVariance,
            "samples" => Aov::Samples,
            "record_radius" => Aov::RecordRadius,
            _ => return None,
        })
    }

    /// Returns the layer's name, as accepted by [`by_name`](Self::by_name).
    pub fn name(self) -> &'static str {
        let mut names = Self::NAMES.into_iter();
        names.find(|name| Self::by_name(name) == Some(self)).unwrap_or_default()
    }

    /// The names accepted by [`by_name`](Self::by_name), one for each layer.
    pub const NAMES: [&'static str; 14] = [
        "albedo",
        "N",
        "geo_normal",
        "P",
        "Z",
        "uv",
        "prim_index",
        "shape_index",
        "material_index",
        "variance",
        "standard_error",
        "block_variance",
        "samples",
        "record_radius",
    ];

    /// Returns whether the layer is averaged over the samples of a pixel; otherwise the film computes it.
    pub fn is_sampled(self) -> bool {
        !matches!(self, Aov::Variance | Aov::StandardError | Aov::BlockVariance | Aov::Samples)
    }

    /// Evaluates the layer at the hit of a camera ray, one number for each channel; zero if there is no hit.
    pub fn evaluate(self, scene: &Scene, ray: &Ray, hit: Option<&Hit>, out: &mut [f32]) {
        out.fill(0.0);
        let Some(hit) = hit else { return };
        let at = scene.interaction(ray, hit);
        match self {
            Aov::Albedo => {
                let arena = Bump::new();
                let wo = at.frame.to_local(-ray.d);
                out.copy_from_slice(&scene.bsdf(&at, Some(wo), &arena).albedo().to_array());
            }
            Aov::GeometricNormal => out.copy_from_slice(&at.ng.to_array()),
            Aov::ShadingNormal => {
                let arena = Bump::new();
                // As in Mitsuba, a normal or bump map applies only if it is the outermost BSDF.
                let n = match scene.bsdf(&at, Some(at.frame.to_local(-ray.d)), &arena) {
                    Bsdf::Tilted(tilted) => at.frame.to_world(tilted.frame.n),
                    _ => at.frame.n,
                };
                out.copy_from_slice(&n.to_array());
            }
            Aov::Position => out.copy_from_slice(&at.p.to_array()),
            Aov::Depth => out[0] = hit.t,
            Aov::Uv => out.copy_from_slice(&scene.uv(&at).to_array()),
            Aov::PrimitiveIndex => out[0] = hit.primitive as f32,
            Aov::ShapeIndex => out[0] = hit.geometry as f32,
            Aov::MaterialIndex => out[0] = scene.shapes[hit.geometry as usize].described.index() as f32,
            Aov::Variance | Aov::StandardError | Aov::BlockVariance => {}
            Aov::Samples | Aov::RecordRadius => {}
        }
    }
}
