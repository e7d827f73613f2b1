//! Arbitrary output variables: image layers of surface features at the first hit.

use super::settings::Aov;
use super::{Integrator, Radiance, RadianceQuery, Wave, Worker};
use crate::accel::Hit;
use crate::bsdf::Bsdf;
use crate::math::Ray;
use crate::scene::Scene;
use bumpalo::Bump;

/// The image of an `aov` integrator without a child: black, with alpha 0 where rays hit nothing.
pub struct NoImage;

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
            Aov::PrimitiveIndex | Aov::ShapeIndex => &["I"],
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
    pub const NAMES: [&'static str; 13] = [
        "albedo",
        "N",
        "geo_normal",
        "P",
        "Z",
        "uv",
        "prim_index",
        "shape_index",
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
            Aov::Variance | Aov::StandardError | Aov::BlockVariance => {}
            Aov::Samples | Aov::RecordRadius => {}
        }
    }
}
