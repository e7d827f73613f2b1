//! What happens to paths between the surfaces that they meet: media.

use crate::color::Rgb;
use crate::ids::MediumId;
use crate::integrator::block::ShadingBlock;
use crate::integrator::flight::{Departure, medium_after, stream};
use crate::integrator::path_wave::{Continuation, InMedia, PathWave};
use crate::integrator::shadows::ShadowQueue;
use crate::integrator::{Radiance, Worker};
use crate::math::lanes::{bits, f32x16};
use crate::math::{Ray, RayX16, Vec3x16};
use crate::scene::{Scene, SceneMedia};

/// The transport of a wave of paths between surfaces.
pub trait Between<'a> {
    /// Returns the media in which the paths are.
    fn sides(&self) -> Sides<'a>;

    /// Follows the paths of a wave to the worker's hits, before they are shaded. Paths that end, or that wait to
    /// [rejoin](Self::rejoin) the wave, have no hit and no throughput afterwards.
    fn advance(&mut self, depth: u32, worker: &mut Worker, out: &mut [Radiance]);

    /// Returns whether camera rays pass hidden emitters in [`advance`](Self::advance). If not, the rays and hits at
    /// depth 0 are those behind them.
    fn passes_hidden(&self) -> bool;

    /// Adds the paths to the wave that are scattered without a surface.
    fn rejoin(&mut self, paths: &mut PathWave);
}

/// The media on the sides of the surfaces at which paths are scattered.
#[derive(Clone, Copy)]
pub struct Sides<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Its media.
    pub media: &'a SceneMedia,
}

impl Sides<'_> {
    /// Updates the media of paths that a block scatters into `next`, for the lanes in the mask `lanes`. The paths of
    /// the block are the first ones of `in_media`.
    #[inline(never)]
    pub fn enter(&self, block: &ShadingBlock<'_>, next: &Continuation, lanes: u32, in_media: &mut [InMedia]) {
        for i in bits(lanes) {
            let medium = self.after(block, i, &next.rays.d, in_media[i].medium);
            in_media[i] = InMedia { events: in_media[i].events, ..InMedia::in_medium(medium) };
        }
    }

    /// Queues those shadow rays of a block that start in media, and returns a mask of the others. The rays have the
    /// directions `wi`.
    #[inline(never)]
    pub fn queue_inside(
        &self,
        block: &ShadingBlock<'_>,
        paths: &PathWave,
        depth: u32,
        (wi, rays, value): (&Vec3x16, &RayX16, &[f32x16; 3]),
        lanes: u32,
        shadows: &mut ShadowQueue,
    ) -> u32 {
        let mut clear = lanes;
        for i in bits(lanes) {
            let path = block.first + i;
            let medium = self.after(block, i, wi, paths.in_media[path].medium);
            if medium.is_some() || self.media.has_passed() {
                clear &= !(1 << i);
                let (t_max, time) = (rays.t_max.as_array()[i], rays.time.as_array()[i]);
                let ray = Ray { o: rays.o.lane(i), t_max, d: rays.d.lane(i), time };
                let value = Rgb::from(value.map(|channel| channel.as_array()[i]));
                let departure = Departure { medium, random: stream(paths.keys[path], depth, 1) };
                shadows.push_through_media(ray, paths.slots[path], value, departure);
            }
        }
        clear
    }

    /// Returns the medium in which light starts in the direction `wi` at the surface of lane `i`.
    fn after(
        &self,
        block: &ShadingBlock<'_>,
        i: usize,
        wi: &Vec3x16,
        before: Option<MediumId>,
    ) -> Option<MediumId> {
        if !self.media.is_boundary(block.at.shape(i)) {
            return before;
        }
        let directions = (block.rays.d.lane(i), wi.lane(i));
        medium_after(self.scene, self.media, block.at.facet(i), directions, before)
    }
}
