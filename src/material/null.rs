//! `null`: no surface, light passes.

use super::{Context, Materials, Plugin, Prepared, Sampling, Scattering, Source};
use crate::bsdf::Bsdf;
use crate::error::Result;
use crate::texture::TexturePoint;

/// No surface: light passes.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Null;

impl Plugin for Null {
    const NAME: &'static str = "null";

    fn read(_: &mut dyn Source) -> Result<Self> {
        Ok(Null)
    }

    fn transmits(&self) -> bool {
        true
    }

    fn has_holes(&self) -> bool {
        true
    }

    fn opacity(&self, _: &Materials, _: &TexturePoint<'_>, _: f32) -> f32 {
        0.0
    }

    /// Returns no lobes. On an emitter the surface is a hole.
    fn sampling(&self, _: &Prepared, _: &Materials) -> Sampling {
        Sampling::default()
    }

    fn scattering<'a>(&'a self, _: &'a Prepared, _: &Context<'a>) -> Scattering<'a> {
        Scattering { bsdf: Bsdf::Null, opacity: 0.0 }
    }
}
