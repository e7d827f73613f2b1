//! Contributions of emitter samples at points in media, sixteen at a time.

use crate::color::Rgb;
use crate::emitter::EmitterSampleX16;
use crate::integrator::flight::{Departure, rays_to_emitters};
use crate::integrator::shadows::ShadowQueue;
use crate::math::lanes::{LANES, bits};
use crate::math::{Vec3x16, f32x16};

/// Points in media from which shadow rays start.
pub struct Origins {
    /// The points.
    pub p: Vec3x16,
    /// The times.
    pub time: f32x16,
    /// The entries of the output.
    pub slots: [u32; LANES],
    /// The starts of the rays.
    pub departures: [Departure; LANES],
}

impl Origins {
    /// Queues the shadow rays of emitter samples that may carry light, for the lanes in the mask `lanes`.
    pub fn queue(
        &self,
        sample: &EmitterSampleX16,
        value: &[f32x16; 3],
        lanes: u32,
        shadows: &mut ShadowQueue,
    ) {
        let [r, g, b] = value.map(|channel| channel.simd_ne(f32x16::ZERO));
        let lanes = lanes & (sample.valid & (r | g | b)).to_bitmask();
        if lanes == 0 {
            return;
        }
        let rays = rays_to_emitters(self.p, sample, self.time).to_rays();
        for i in bits(lanes) {
            let value = Rgb::from(value.map(|channel| channel.as_array()[i]));
            shadows.push_through_media(rays[i], self.slots[i], value, self.departures[i]);
        }
    }
}

/// Returns the contributions by channel of samples with the densities `pdf`, times `factor` and the throughput `beta`.
/// What has no density carries nothing.
#[inline(always)]
pub fn weighted(
    sample: &EmitterSampleX16,
    factor: f32x16,
    pdf: f32x16,
    beta: impl Fn(usize) -> f32x16,
) -> [f32x16; 3] {
    let factor = pdf.simd_gt(f32x16::ZERO).select(factor / pdf, f32x16::ZERO);
    std::array::from_fn(|c| beta(c) * sample.radiance[c] * factor)
}
