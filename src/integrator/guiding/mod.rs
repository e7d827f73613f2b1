//! Path guiding: directions are sampled where scattered light comes from. [after Jensen 1995; Müller 2017]
//!
//! Photons are traced before the render. A tree divides the surfaces into cells by their positions and normals, and
//! each cell has a density of directions in proportion to the flux of its photons, that is, to incident radiance ×
//! cosine. At surfaces with a diffuse lobe, paths sample one half of their directions with this density and the other
//! half with the BSDF, and weight them by the density of both. So the image is unbiased, whatever the photons missed.
//!
//! Cells in which light comes from all sides have no density, because the BSDF samples them as well. What remains are
//! caustics: light that mirrors and glass concentrate, which the BSDF would find as rare bright samples.

mod block;
mod directions;
mod field;

pub use block::GuidedBlock;
pub use field::GuidingField;

use self::field::{LearnedPhoton, Place};
use super::Preparation;
use super::photon::{
    Deposit, EmissionGuide, LightPathTracer, PathLimit, PathSequence, PhotonPaths, VisibleSurfaces,
};
use super::settings::PathLimits;

/// The limits of the light paths from which the field is learned, and their stream of random numbers.
const LEARNED: PathLimit = PathLimit { paths: 1 << 20, kept: Some(1 << 18) };
const STREAM: u32 = 5;

impl GuidingField {
    /// Learns the field from photons near the visible surfaces, for paths within the limits. Light that was not
    /// scattered before is left out, because emitter samples find it. Returns `None` if nothing was learned.
    pub fn learn(preparation: &Preparation<'_>, limits: PathLimits) -> Option<Self> {
        let Preparation { scene, sampler, seed, pool, interrupt, .. } = *preparation;
        let visible = VisibleSurfaces::of(preparation);
        let guide = EmissionGuide::towards(&visible, preparation, limits);
        let tracer = LightPathTracer { scene, sampler, guide: guide.as_ref(), pool, interrupt, time: None };
        let learn = |deposit: &Deposit, _| {
            let Deposit { p, wi, surface, .. } = *deposit;
            (!surface.transmits && visible.contains(p)).then(|| LearnedPhoton {
                place: Place::new(p, surface.ng, wi),
                wi,
                flux: deposit.shading_power().max_component(),
            })
        };
        let sequence = PathSequence { seed, stream: STREAM, number: 0, first: 0 };
        let mut photons = tracer.cast(&PhotonPaths::scattered(limits), sequence, LEARNED, learn).kept;
        let field = GuidingField::new(&mut photons);
        (!field.is_empty()).then_some(field)
    }
}
