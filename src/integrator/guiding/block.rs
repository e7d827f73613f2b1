//! Guided sampling at the sixteen points of a block.

use super::directions::Directions;
use super::field::{GuidingField, Place};
use crate::bsdf::{self, BsdfSampleX16};
use crate::integrator::block::ShadingBlock;
use crate::math::lanes::{LANES, bits, f32x16, mask_from_bits};
use crate::math::{Vec2, Vec3x16};
use crate::scene::Scene;

/// The probability with which a direction is sampled with the density of the field.
const GUIDED: f32 = 0.5;

/// The densities of directions at the points of a block.
pub struct GuidedBlock<'a> {
    /// Mask of the lanes with a density.
    pub lanes: u32,
    densities: [Option<&'a Directions>; LANES],
}

impl<'a> GuidedBlock<'a> {
    /// Finds the densities at the points of a block whose surfaces are opaque and have a diffuse lobe. Returns `None`
    /// if there are none.
    pub fn new(field: &'a GuidingField, scene: &Scene, block: &ShadingBlock<'_>) -> Option<Self> {
        let mut guided = GuidedBlock { lanes: 0, densities: [None; LANES] };
        for i in bits(block.finite) {
            if block.bsdfs[i].lobes().diffuse && !scene.materials.get(block.at.material[i]).transmits {
                let place = Place::new(block.at.p.lane(i), block.at.ng.lane(i), -block.rays.d.lane(i));
                guided.densities[i] = field.directions(&place);
                guided.lanes |= u32::from(guided.densities[i].is_some()) << i;
            }
        }
        (guided.lanes != 0).then_some(guided)
    }

    /// Returns the densities with which [`sample`](Self::sample) samples the directions `wi` in the lanes of a mask,
    /// from the densities of the BSDFs. Infinite densities stay so.
    pub fn pdf(&self, block: &ShadingBlock<'_>, wi: &Vec3x16, of_bsdf: f32x16, lanes: u32) -> f32x16 {
        let world = block.at.frame.to_world(*wi);
        let mut pdf = of_bsdf.to_array();
        for i in bits(lanes & self.lanes) {
            if let Some(directions) = self.densities[i].filter(|_| pdf[i].is_finite()) {
                pdf[i] = (1.0 - GUIDED) * pdf[i] + GUIDED * directions.pdf(world.lane(i));
            }
        }
        f32x16::new(pdf)
    }

    /// Samples directions as [`bsdf::lanes::sample_x16`] does, some of them with the densities of the field.
    pub fn sample(&self, block: &ShadingBlock<'_>, u_lobe: f32x16, u: [f32x16; 2]) -> BsdfSampleX16 {
        let one = f32x16::ONE;
        let guided = mask_from_bits(self.lanes).select(f32x16::splat(GUIDED), f32x16::ZERO);
        let by_field = u[0].simd_lt(guided);
        // The rest of the number with which the choice was made.
        let rest = (by_field.select(u[0], u[0] - guided) / by_field.select(guided, one - guided))
            .fast_min(f32x16::splat(1f32.next_down()));
        let by_bsdf = bsdf::lanes::sample_x16(&block.bsdfs, &block.wo, u_lobe, [rest, u[1]], block.active);
        let fields = by_field.to_bitmask();
        let mut world = Vec3x16::default();
        for i in bits(fields) {
            if let Some(directions) = self.densities[i] {
                world.set_lane(i, directions.sample(Vec2::new(rest.as_array()[i], u[1].as_array()[i])));
            }
        }
        let wi = Vec3x16::select(by_field, block.at.frame.to_local(world), by_bsdf.wi);
        let eval = bsdf::lanes::eval_x16(&block.bsdfs, &block.wo, &wi, fields);
        let pdf = self.pdf(block, &wi, by_field.select(eval.pdf, by_bsdf.pdf), block.active);
        // A Dirac delta is sampled by the BSDF alone.
        let finite = pdf.simd_lt(f32x16::splat(f32::INFINITY));
        let ratio = finite.select(by_bsdf.pdf / pdf, one / (one - guided));
        let weight = |c: usize| by_field.select(eval.f[c] * wi.z.abs() / pdf, by_bsdf.weight[c] * ratio);
        BsdfSampleX16 {
            wi,
            weight: [0, 1, 2].map(weight),
            pdf,
            eta: by_field.select(one, by_bsdf.eta),
            valid: by_field.select(pdf.simd_gt(f32x16::ZERO), by_bsdf.valid),
        }
    }
}
