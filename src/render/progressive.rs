//! Rendering with integrators that prepare each sample separately.

use super::edges::TileEdges;
use super::job::Job;
use super::splats;
use super::tracing::CameraWorker;
use crate::film::Tile;
use crate::integrator::{Preparation, PreparedPass, Progressive, SamplePass};
use crate::memory::Budget;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Takes the given samples of every pixel, unless the render is interrupted. Returns the counts of the preparation of
/// the samples.
pub fn render(
    job: &Job<'_>,
    progressive: &dyn Progressive,
    pool: &rayon::ThreadPool,
    workers: &[Mutex<CameraWorker>],
    tiles: &mut [Tile],
    samples: Range<u64>,
) -> PreparedPass {
    // The memory for passes was already reserved when the integrator prepared.
    let memory = Budget::unlimited();
    let preparation = Preparation {
        scene: job.scene,
        camera: job.camera,
        sampler: job.settings.sampler,
        seed: job.settings.seed,
        pool,
        interrupt: job.progress.interrupt_flag(),
        cache: None,
        memory: &memory,
    };
    let mut sum = PreparedPass::default();
    for sample in samples {
        if job.progress.is_interrupted() {
            break;
        }
        let begun = progressive.begin_sample(&SamplePass {
            preparation: &preparation,
            sample,
            margin: job.filter.radius(),
        });
        sum.counters.merge(&begun.counters);
        sum.invalid += begun.invalid;
        pool.install(|| {
            tiles.par_iter_mut().for_each(|tile| {
                let thread = rayon::current_thread_index().unwrap_or(0);
                let mut worker = workers[thread].lock().unwrap_or_else(PoisonError::into_inner);
                worker.worker.time = begun.time;
                worker.render_tile(job, tile, TileEdges::default(), sample..sample + 1);
            });
        });
        let replicate = job.settings.sampler.replicate(sample) as usize;
        sum.invalid += pool.install(|| splats::add(job, tiles, replicate, begun.splats));
    }
    sum
}
