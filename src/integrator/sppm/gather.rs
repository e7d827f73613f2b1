//! Reflected radiance from photons around a point.

use crate::bsdf::Bsdf;
use crate::color::Rgb;
use crate::integrator::block::Block;
use crate::integrator::photon::{GridPhoton, PhotonGrid};
use std::f32::consts::PI;

/// Photons whose surface leans more than this against that of the point (the cosine) lie around a corner.
const LEAST_COSINE: f32 = 0.7;

/// Photons to gather from, and how to weight them.
pub(super) struct Gather<'a> {
    grid: &'a PhotonGrid,
    /// The kernel at distance 0 over the number of light paths, per unit area.
    scale: f32,
    inverse_radius_squared: f32,
}

/// Which photons are wanted at a point.
#[derive(Clone, Copy)]
pub(super) struct Wanted {
    /// The most edges from the emitter.
    pub max_edges: u32,
    /// Whether photons are wanted that finite lobes have scattered.
    pub indirect: bool,
}

impl<'a> Gather<'a> {
    /// Gathers from the photons that `emitted` light paths have left.
    pub fn new(grid: &'a PhotonGrid, emitted: u64) -> Self {
        let squared = grid.radius() * grid.radius();
        Gather { grid, scale: 2.0 / (PI * squared * emitted as f32), inverse_radius_squared: 1.0 / squared }
    }

    /// Radiance that lane `i` of the block reflects towards its ray, by finite lobes: the sum over photons of `f·Φ·K`, with
    /// the kernel `K = 2/(πr²)·(1 − d²/r²)` (Epanechnikov's in two dimensions), which has the least error of all.
    /// [Silverman 1986, 4.2]
    pub fn radiance(&self, block: &Block<'_>, i: usize, wanted: Wanted) -> Rgb {
        let at = block.at.lane(i);
        let (bsdf, wo): (&Bsdf<'_>, _) = (block.bsdfs[i], block.wo.lane(i));
        let mut sum = Rgb::BLACK;
        self.grid.within(at.p, |photon: &GridPhoton, squared| {
            let matches = (wanted.indirect || photon.is_caustic())
                && photon.edges() <= wanted.max_edges
                && photon.normal().dot(at.ng).abs() > LEAST_COSINE;
            if matches {
                let f = bsdf.eval(wo, at.frame.to_local(photon.wi)).f;
                sum += f * photon.power * (1.0 - squared * self.inverse_radius_squared);
            }
        });
        if sum.is_black() { sum } else { sum * self.scale }
    }
}
