//! Reflected radiance from the photons around a point.

use crate::bsdf::Bsdf;
use crate::color::Rgb;
use crate::integrator::block::ShadingBlock;
use crate::integrator::photon::{GridPhoton, PhotonGrid, PhotonSurface};
use crate::scene::Scene;
use std::f32::consts::PI;

/// Photons and the scale of the kernel.
pub(super) struct PhotonGather<'a> {
    scene: &'a Scene,
    grid: &'a PhotonGrid,
    /// The kernel at distance 0 divided by the number of light paths, per unit area.
    scale: f32,
    inverse_radius_squared: f32,
}

/// The selection of photons at a point.
#[derive(Clone, Copy)]
pub(super) struct PhotonFilter {
    /// The greatest number of edges from the emitter.
    pub max_edges: u32,
    /// Whether photons scattered by finite lobes are included.
    pub indirect: bool,
}

impl<'a> PhotonGather<'a> {
    /// Prepares the lookup of the photons from `emitted` light paths.
    pub fn new(scene: &'a Scene, grid: &'a PhotonGrid, emitted: u64) -> Self {
        let squared = grid.radius() * grid.radius();
        PhotonGather {
            scene,
            grid,
            scale: 2.0 / (PI * squared * emitted as f32),
            inverse_radius_squared: 1.0 / squared,
        }
    }

    /// Returns the radiance that the finite lobes of lane `i` scatter towards the ray's origin: the sum over photons
    /// of `f·Φ·K`, with the kernel `K = 2/(πr²)·(1 − d²/r²)` (Epanechnikov's in two dimensions), which minimises the
    /// mean squared error. [Silverman 1986, 4.2]
    pub fn radiance(&self, block: &ShadingBlock<'_>, i: usize, filter: PhotonFilter) -> Rgb {
        let at = block.at.lane(i);
        let (bsdf, wo): (&Bsdf<'_>, _) = (block.bsdfs[i], block.wo.lane(i));
        let surface = PhotonSurface::at(self.scene, &at);
        let mut sum = Rgb::BLACK;
        self.grid.within(at.p, |photon: &GridPhoton, squared| {
            let matches = (filter.indirect || photon.is_caustic())
                && photon.edges() <= filter.max_edges
                && photon.surface().matches(surface);
            if matches {
                let f = bsdf.eval(wo, at.frame.to_local(photon.wi)).f;
                sum += f * photon.power * (1.0 - squared * self.inverse_radius_squared);
            }
        });
        if sum.is_black() { sum } else { sum * self.scale }
    }
}
