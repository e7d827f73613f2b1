//! The memory of a render in addition to the scene, and its reservation.

use super::{Plan, Session};
use crate::error::{Error, Kind, Result};
use crate::film::{FilmSettings, PixelFormat, Tile};
use crate::image;
use crate::integrator::Integrator;
use crate::memory::{Budget, Reservation};
use crate::render::JobSettings;
use std::path::Path;

/// The bytes of a thread's waves and of its allocator caches.
const THREAD: u64 = 4 << 20;

/// The memory of a render in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RenderMemory {
    /// The sums of samples.
    pub film: u64,
    /// The image with float values.
    pub image: u64,
    /// The data of the threads.
    pub threads: u64,
}

impl RenderMemory {
    /// Returns the total.
    pub fn total(&self) -> u64 {
        self.film.saturating_add(self.image).saturating_add(self.threads)
    }

    /// Returns the memory of a render without layers.
    pub fn least(film: &FilmSettings) -> Self {
        let pixels = film.rect().area();
        let channels = 3 + usize::from(film.pixel_format.has_alpha());
        RenderMemory {
            film: pixels.saturating_mul(Tile::bytes_per_pixel(channels, 2) as u64),
            image: pixels.saturating_mul(4 * image_channels(film.pixel_format)),
            threads: 0,
        }
    }

    /// Returns the memory of a job.
    /// `films` is the number of copies of the sums.
    pub fn of(film: &FilmSettings, job: &JobSettings, films: u64) -> Self {
        let pixels = film.rect().area();
        let count = |sampled: bool| {
            let layers = job.layers.iter().filter(|layer| !sampled || layer.aov.is_sampled());
            layers.map(|layer| layer.aov.channels().len()).sum::<usize>()
        };
        let sums = 3 + usize::from(film.pixel_format.has_alpha()) + count(true);
        let values = image_channels(film.pixel_format) + count(false) as u64;
        let film = Tile::bytes_per_pixel(sums, job.sampler.replicates() as usize) as u64;
        RenderMemory {
            film: pixels.saturating_mul(film * films),
            image: pixels.saturating_mul(4 * values),
            threads: THREAD * job.threads as u64,
        }
    }
}

/// Returns the number of channels of an image without layers.
fn image_channels(format: PixelFormat) -> u64 {
    match format {
        PixelFormat::Luminance => 1,
        PixelFormat::LuminanceAlpha => 2,
        PixelFormat::Rgb | PixelFormat::Xyz => 3,
        PixelFormat::Rgba | PixelFormat::Xyza => 4,
    }
}

/// Reserves the memory of a render.
///
/// # Errors
/// If it exceeds the limit. The error is one of the command line if the size comes from there (`of_user`), otherwise
/// one of the scene.
pub(super) fn reserve(
    path: &Path,
    film: &FilmSettings,
    of_user: bool,
    needed: RenderMemory,
    memory: &Budget,
) -> Result<Reservation> {
    memory.reserve(needed.total()).map_err(|refusal| {
        let rect = film.rect();
        let what = format!("rendering {}x{} pixels", rect.width, rect.height);
        match of_user {
            true => Error::usage(refusal.sentence(&what, "ask for fewer pixels or layers")).about("--size"),
            false => {
                let change = "use --size or --crop, or fewer layers";
                Error::scene(refusal.sentence(&what, change)).in_file(path)
            }
        }
    })
}

impl Session {
    /// Returns the memory of a render in addition to the scene.
    pub fn render_memory(&self, plan: &Plan) -> RenderMemory {
        // A pass that is interrupted is discarded if light paths contribute to all pixels.
        let films = if plan.integrator.create().traces_light_paths() { 2 } else { 1 };
        RenderMemory::of(&self.camera().film, &plan.job, films)
    }

    /// Reserves the memory of a render.
    pub(super) fn reserve(&self, plan: &Plan) -> Result<Reservation> {
        let needed = self.render_memory(plan);
        reserve(&self.path, &self.camera().film, self.sized_by_user, needed, &self.memory)
    }

    /// Reserves the copy of the sums that is needed with light paths, if the preparation of the integrator has decided
    /// to trace them.
    pub(super) fn reserve_copy(&self, plan: &Plan, prepared: &dyn Integrator) -> Result<Option<Reservation>> {
        if !prepared.traces_light_paths() || plan.integrator.create().traces_light_paths() {
            return Ok(None);
        }
        let RenderMemory { film, .. } = self.render_memory(plan);
        let needed = RenderMemory { film, ..RenderMemory::default() };
        reserve(&self.path, &self.camera().film, self.sized_by_user, needed, &self.memory).map(Some)
    }

    /// Reserves the memory of layers that are added to the image of a plan, beside `others` bytes.
    ///
    /// # Errors
    /// If there is not enough, with the kind [`Output`](Kind::Output).
    pub(super) fn reserve_layers(
        &self,
        plan: &Plan,
        others: u64,
        channels: usize,
        what: &str,
    ) -> Result<Reservation> {
        let pixels = self.camera().film.rect().area();
        // The new values, and the image with and without them.
        let bytes = 2 * size_of::<f32>() as u64 * pixels * channels as u64 + self.render_memory(plan).image;
        self.memory
            .reserve(bytes.saturating_add(others))
            .map_err(|refusal| Error::new(Kind::Output, refusal.sentence(what, "ask for fewer pixels")))
    }

    /// Checks that there is memory for writing the image to a file while the render's sums are still in memory.
    ///
    /// # Errors
    /// If there is not, with the kind [`Output`](Kind::Output).
    pub fn check_output(&self, plan: &Plan, target: &Path) -> Result<()> {
        let rect = self.camera().film.rect();
        let needed = self.render_memory(plan);
        let channels = needed.image / (4 * rect.area()).max(1);
        let encoding = image::encoding_bytes(target, rect.area(), channels);
        let fits = self.memory.reserve(needed.total().saturating_add(encoding));
        fits.map(drop).map_err(|refusal| {
            let what = format!("rendering and encoding {}x{} pixels", rect.width, rect.height);
            let message = refusal.sentence(&what, "ask for fewer pixels or layers");
            Error::new(Kind::Output, message).in_file(target)
        })
    }
}
