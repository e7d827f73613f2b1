//! What an integrator may compute before the camera's samples are taken.

use super::{Counters, Interrupt, Worker};
use crate::error::{Error, Result};
use crate::memory::Budget;
use crate::sampling::Sampler;
use crate::scene::Scene;
use crate::sensor::Camera;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// What caches and maps are computed from. They must not depend on anything else, least of all on threads.
pub struct Preparation<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// From where it is rendered, and onto which film.
    pub camera: &'a Camera,
    /// The sampler of the render.
    pub sampler: Sampler,
    /// The seed of the render.
    pub seed: u64,
    /// The threads to work with.
    pub pool: &'a rayon::ThreadPool,
    /// Whether to stop early, with whatever there is.
    pub interrupt: &'a Interrupt,
    /// Where to read what was computed before, and else to keep it.
    pub cache: Option<CacheFile>,
    /// What is planned of memory.
    pub memory: &'a Budget,
}

/// A file that holds what a preparation has computed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CacheFile {
    /// Where it is, or is to be.
    pub path: PathBuf,
    /// Hash of the scene that it belongs to, without sensors.
    pub scene: u64,
    /// Hash of the sensor and its film.
    pub view: u64,
}

/// A number that a preparation has to say: how many records, how many seconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Fact {
    /// Its name in `--stats`.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
}

/// One worker for each thread of a pool.
pub struct Workers {
    workers: Vec<Mutex<Worker>>,
}

impl Workers {
    /// Workers for the pool's threads.
    pub fn new(pool: &rayon::ThreadPool, sampler: Sampler, interrupt: &Interrupt) -> Self {
        let worker = |_| Mutex::new(Worker::new(sampler).with_interrupt(interrupt));
        Workers { workers: (0..pool.current_num_threads()).map(worker).collect() }
    }

    /// The same, for rays that all are of one time.
    #[must_use]
    pub fn at_time(mut self, time: Option<f32>) -> Self {
        for worker in &mut self.workers {
            worker.get_mut().unwrap_or_else(PoisonError::into_inner).time = time;
        }
        self
    }

    /// Calls `f` with the worker of the thread that runs it.
    pub fn with<T>(&self, f: impl FnOnce(&mut Worker) -> T) -> T {
        let thread = rayon::current_thread_index().unwrap_or(0) % self.workers.len();
        f(&mut self.workers[thread].lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// The counts of all threads.
    pub fn counters(self) -> Counters {
        let mut sum = Counters::default();
        for worker in self.workers {
            sum.merge(&worker.into_inner().unwrap_or_else(PoisonError::into_inner).counters);
        }
        sum
    }
}

/// Refuses a scene whose surfaces move, for an integrator that keeps light on surfaces without its time.
pub(super) fn refuse_motion(integrator: &str, kept: &str, scene: &Scene) -> Result<()> {
    match scene.needs.motion {
        false => Ok(()),
        true => Err(Error::scene(format!(
            "{integrator}: the scene moves while the shutter is open, and {kept} are not of one time: expected a scene at \
             rest, or one of path, ptracer, sppm and distribution"
        ))),
    }
}
