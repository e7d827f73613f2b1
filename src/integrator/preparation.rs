//! The input of the computations that an integrator does before the camera's samples.

use super::{Counters, Interrupt, Worker};
use crate::error::{Error, Result};
use crate::memory::Budget;
use crate::sampling::Sampler;
use crate::scene::Scene;
use crate::sensor::Camera;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// The input from which caches and maps are computed. They must depend on nothing else, in particular not on threads.
pub struct Preparation<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The camera and film of the render.
    pub camera: &'a Camera,
    /// The sampler of the render.
    pub sampler: Sampler,
    /// The seed of the render.
    pub seed: u64,
    /// The threads to use.
    pub pool: &'a rayon::ThreadPool,
    /// A request to stop early, with a partial result.
    pub interrupt: &'a Interrupt,
    /// The file from which earlier results are read, or in which new ones are stored.
    pub cache: Option<CacheFile>,
    /// The memory budget.
    pub memory: &'a Budget,
}

/// A file that stores the result of a preparation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CacheFile {
    /// The path of the file.
    pub path: PathBuf,
    /// Hash of the scene without its sensors.
    pub scene: u64,
    /// Hash of the sensor and its film.
    pub view: u64,
}

/// A statistic of a preparation, such as the number of records or seconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistic {
    /// Its name in `--stats`.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
}

/// The name of the number of rays that a preparation has traced.
pub const PREPARATION_RAYS: &str = "preparation_rays";

impl Statistic {
    /// Returns the sum of the values with a name.
    pub fn total(statistics: &[Statistic], name: &str) -> f64 {
        statistics.iter().filter(|statistic| statistic.name == name).map(|statistic| statistic.value).sum()
    }
}

/// One worker for each thread of a pool.
pub struct Workers {
    workers: Vec<Mutex<Worker>>,
}

impl Workers {
    /// Creates one worker for each thread of the pool.
    pub fn new(pool: &rayon::ThreadPool, sampler: Sampler, interrupt: &Interrupt) -> Self {
        let worker = |_| Mutex::new(Worker::new(sampler).with_interrupt(interrupt));
        Workers { workers: (0..pool.current_num_threads()).map(worker).collect() }
    }

    /// Sets the time of all rays, if they share it.
    #[must_use]
    pub fn at_time(mut self, time: Option<f32>) -> Self {
        for worker in &mut self.workers {
            worker.get_mut().unwrap_or_else(PoisonError::into_inner).time = time;
        }
        self
    }

    /// Calls `f` with the worker of the current thread.
    pub fn with<T>(&self, f: impl FnOnce(&mut Worker) -> T) -> T {
        let thread = rayon::current_thread_index().unwrap_or(0) % self.workers.len();
        f(&mut self.workers[thread].lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Returns the sum of the counters of all threads.
    pub fn counters(self) -> Counters {
        let mut sum = Counters::default();
        for worker in self.workers {
            sum.merge(&worker.into_inner().unwrap_or_else(PoisonError::into_inner).counters);
        }
        sum
    }
}

/// Rejects a scene with moving surfaces, for an integrator that stores light on surfaces without its time.
pub(super) fn reject_motion(integrator: &str, kept: &str, scene: &Scene) -> Result<()> {
    match scene.needs.motion {
        false => Ok(()),
        true => Err(Error::scene(format!(
            "{integrator}: expected a scene without motion, because {kept} have no time; for motion blur use path, ptracer, bdpt, vcm, pssmlt, sppm or distribution"
        ))),
    }
}
