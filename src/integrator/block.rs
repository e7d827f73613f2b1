//! Sixteen neighbours of a wave at the surfaces that they hit.

use crate::accel::Hit;
use crate::bsdf::Bsdf;
use crate::math::{LANES, Ray, RayX16, Vec3x16};
use crate::scene::{Scene, SurfaceInteractionX16};
use bumpalo::Bump;

/// Up to sixteen surface points of a wave, ready for scattering.
pub struct Block<'a> {
    /// The place of the first in the wave.
    pub first: usize,
    /// Bits: the lanes in use, from the lowest.
    pub active: u32,
    /// The rays that hit.
    pub rays: RayX16,
    /// The surface points.
    pub at: SurfaceInteractionX16,
    /// What scatters there.
    pub bsdfs: [&'a Bsdf<'a>; LANES],
    /// Bits: the lanes in use whose BSDF has a finite lobe.
    pub finite: u32,
    /// Where the rays came from, in the local frames.
    pub wo: Vec3x16,
}

impl<'a> Block<'a> {
    /// The block from place `first` of a wave of rays of which each hits something.
    ///
    /// # Panics
    /// If a ray hits nothing.
    #[inline(always)]
    pub fn new(scene: &'a Scene, arena: &'a Bump, rays: &[Ray], hits: &[Option<Hit>], first: usize) -> Self {
        Block::of(scene, arena, rays, hits, first, true)
    }

    /// As [`new`](Self::new), for rays of light: where they came from is not where their viewer is.
    pub fn of_light(
        scene: &'a Scene,
        arena: &'a Bump,
        rays: &[Ray],
        hits: &[Option<Hit>],
        first: usize,
    ) -> Self {
        Block::of(scene, arena, rays, hits, first, false)
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
        // The lanes not in use repeat the last hit.
        let hit = |i: usize| hits[i.min(count - 1)].expect("rays without a hit are squeezed out");
        let hits = match hits.first_chunk::<LANES>() {
            Some(chunk) => chunk.map(|hit| hit.expect("rays without a hit are squeezed out")),
            None => std::array::from_fn(hit),
        };
        let at = scene.interactions(&rays, &hits);
        let wo = at.frame.to_local(-rays.d);
        let bsdfs = match scene.needs.varying_materials {
            false => at.material.map(|material| scene.constant_bsdf(material)),
            true => std::array::from_fn(|i| {
                let viewer = from_viewer.then(|| wo.lane(i));
                scene.bsdf(&at.lane(i), viewer, arena)
            }),
        };
        let finite = bsdfs.iter().enumerate().fold(0, |bits, (i, b)| bits | u32::from(!b.is_specular()) << i);
        Block { first, active, rays, at, bsdfs, finite: finite & active, wo }
    }

    /// The blocks of a wave of rays of which each hits something.
    pub fn all(
        scene: &'a Scene,
        arena: &'a Bump,
        rays: &[Ray],
        hits: &[Option<Hit>],
    ) -> impl Iterator<Item = Block<'a>> {
        (0..hits.len()).step_by(LANES).map(move |first| Block::new(scene, arena, rays, hits, first))
    }
}
