//! Blocks of sixteen consecutive paths of a wave at the surfaces that they hit.

use crate::accel::Hit;
use crate::bsdf::Bsdf;
use crate::emitter::{Gloss, GlossX16, ReceiverX16};
use crate::math::lanes::each_lane;
use crate::math::{LANES, Ray, RayX16, Vec3, Vec3x16};
use crate::scene::{Scene, SurfaceInteractionX16};
use bumpalo::Bump;

/// Up to sixteen surface points of a wave, prepared for scattering.
pub struct ShadingBlock<'a> {
    /// The index of the block's first path in the wave.
    pub first: usize,
    /// Mask of the active lanes, from the lowest.
    pub active: u32,
    /// The rays that hit the surfaces.
    pub rays: RayX16,
    /// The surface points.
    pub at: SurfaceInteractionX16,
    /// The BSDFs at the surface points.
    pub bsdfs: [&'a Bsdf<'a>; LANES],
    /// Mask of the active lanes whose BSDF has a finite lobe.
    pub finite: u32,
    /// The directions towards the rays' origins, in the local frames.
    pub wo: Vec3x16,
    /// The glossy lobes for the choice of emitters, if they have been [found](Self::find_gloss).
    pub gloss: Option<GlossX16>,
}

impl<'a> ShadingBlock<'a> {
    /// Creates the block that starts at index `first` of a wave in which every ray has a hit.
    ///
    /// # Panics
    /// If a ray has no hit.
    #[inline(always)]
    pub fn new(scene: &'a Scene, arena: &'a Bump, rays: &[Ray], hits: &[Option<Hit>], first: usize) -> Self {
        ShadingBlock::of(scene, arena, rays, hits, first, true)
    }

    /// Creates a block as [`new`](Self::new) does, for light paths: the origin of the ray is not the viewer's
    /// position.
    pub fn of_light(
        scene: &'a Scene,
        arena: &'a Bump,
        rays: &[Ray],
        hits: &[Option<Hit>],
        first: usize,
    ) -> Self {
        ShadingBlock::of(scene, arena, rays, hits, first, false)
    }

    #[inline(always)]
    fn of(
        scene: &'a Scene,
        arena: &'a Bump,
        rays: &[Ray],
        hits: &[Option<Hit>],
        first: usize,
        from_viewer: bool,
    ) -> Self {
        let count = (hits.len() - first).min(LANES);
        let active = (1 << count) - 1;
        let rays = RayX16::load(rays, first);
        let hits = &hits[first..first + count];
        // Inactive lanes repeat the last hit.
        let last = hits[count - 1].expect("rays without a hit were removed");
        let mut all = [last; LANES];
        for (lane, hit) in all.iter_mut().zip(hits) {
            *lane = hit.expect("rays without a hit were removed");
        }
        // Its parts are filled in place, because a move of a block is a call of `memcpy`.
        let mut block = ShadingBlock {
            first,
            active,
            at: scene.interactions(&rays, &all),
            rays,
            bsdfs: [&Bsdf::Null; LANES],
            finite: 0,
            wo: Vec3x16::default(),
            gloss: None,
        };
        block.wo = block.at.frame.to_local(-block.rays.d);
        block.bsdfs = match scene.needs.varying_materials {
            false => each_lane(|i| scene.constant_bsdf(block.at.material[i])),
            true => scene.bsdfs(&block.at, from_viewer.then_some(&block.wo), arena),
        };
        let mut is_finite = false;
        for (i, bsdf) in block.bsdfs.iter().enumerate() {
            if i == 0 || !std::ptr::eq(*bsdf, block.bsdfs[i - 1]) {
                is_finite = !bsdf.is_specular();
            }
            block.finite |= u32::from(is_finite) << i;
        }
        block.finite &= active;
        block
    }

    /// Finds the glossy lobes, so that emitters are chosen for them, if the scene may have any.
    pub fn find_gloss(&mut self, scene: &Scene) {
        if !scene.needs.gloss {
            return;
        }
        self.gloss = GlossX16::of_lanes(self.finite, |i| {
            let wo = self.wo.lane(i);
            self.bsdfs[i].gloss(wo).map_or(Gloss::NONE, |(alpha, share)| Gloss {
                axis: self.at.frame.lane(i).to_world(Vec3::new(-wo.x, -wo.y, wo.z)),
                // The lobe of a facet has twice its width.
                width_squared: 4.0 * alpha * alpha,
                share,
            })
        });
    }

    /// Returns the points for which emitters are chosen.
    #[inline(always)]
    pub fn receivers(&self) -> ReceiverX16 {
        ReceiverX16 { p: self.at.p, gloss: self.gloss }
    }

    /// Returns the blocks of a wave in which every ray has a hit.
    pub fn all(
        scene: &'a Scene,
        arena: &'a Bump,
        rays: &[Ray],
        hits: &[Option<Hit>],
    ) -> impl Iterator<Item = ShadingBlock<'a>> {
        (0..hits.len()).step_by(LANES).map(move |first| ShadingBlock::new(scene, arena, rays, hits, first))
    }
}
