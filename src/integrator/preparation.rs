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

/// The names of the numbers of rays that a preparation has traced: nearest-hit and occlusion queries.
const RAYS: [&str; 2] = ["preparation_rays", "preparation_shadow_rays"];

impl Statistic {
    /// Returns the statistics of the rays of a preparation.
    pub fn of_rays(counters: &Counters) -> [Statistic; 2] {
        let [closest, occlusion] = [counters.closest_rays, counters.occlusion_rays].map(|rays| rays as f64);
        [Statistic { name: RAYS[0], value: closest }, Statistic { name: RAYS[1], value: occlusion }]
    }

    /// Returns the numbers of rays of a preparation, from its statistics.
    pub fn rays(statistics: &[Statistic]) -> Counters {
        let rays =
            |name| statistics.iter().filter(|of| of.name == name).map(|of| of.value as u64).sum::<u64>();
        Counters { closest_rays: rays(RAYS[0]), occlusion_rays: rays(RAYS[1]), ..Counters::default() }
    }

    /// Returns whether it is a number of rays.
    pub fn is_rays(&self) -> bool {
        RAYS.contains(&self.name)
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
