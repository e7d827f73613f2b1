//! `--stats`: machine-readable statistics of a render.

use crate::error::Result;
use crate::render::Rendered;
use crate::session::{Plan, Session};
use crate::util::replace;
use cpu_time::ProcessTime;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Wall time of the steps of a run, in seconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seconds {
    /// Reading the scene and its files.
    pub load: f64,
    /// Building the accelerator.
    pub build: f64,
    /// Preparing the integrator.
    pub prepare: f64,
    /// Sampling alone.
    pub render: f64,
    /// Rendering the layers of `--cryptomatte` and of techniques.
    pub layers: f64,
    /// Writing the image.
    pub write: f64,
    /// The whole run.
    pub total: f64,
}

/// The data of the statistics.
pub struct Account<'a> {
    /// The scene.
    pub session: &'a Session,
    /// The plan of the render.
    pub plan: &'a Plan,
    /// The render.
    pub rendered: &'a Rendered,
    /// The names of the image's channels, in their order.
    pub channels: &'a [String],
    /// The times of the run.
    pub seconds: Seconds,
}

impl Account<'_> {
    /// Writes the statistics to a file, or to standard output for "-".
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let text = format!("{:#}\n", self.json());
        if path == Path::new("-") {
            return super::print(&text).map(drop);
        }
        replace(path, text.as_bytes())
    }

    fn json(&self) -> Value {
        let Account { session, plan, rendered, channels, seconds } = self;
        let Session { scene, report, .. } = session;
        let counters = &rendered.counters;
        let needs: Map<String, Value> =
            scene.needs.list().into_iter().map(|(name, used)| (name.to_string(), used.into())).collect();
        json!({
            "version": env!("BUFFON_VERSION"),
            "scene": session.path.display().to_string(),
            "integrator": plan.integrator.name(),
            "auto": plan.decision,
            "sampler": plan.job.sampler.kind().name(),
            "accel": scene.accel.name(),
            "image_library": crate::image::backend(),
            "seed": plan.job.seed,
            "threads": plan.job.threads,
            "width": rendered.rect.width,
            "height": rendered.rect.height,
            "channels": channels,
            "spp": rendered.samples_per_pixel,
            "adaptive": rendered.adaptive,
            "samples": {
                "least": rendered.counts.least,
                "mean": rendered.counts.mean,
                "most": rendered.counts.most,
            },
            "stop_reason": rendered.stop_reason.to_string(),
            "seconds": {
                "load": seconds.load,
                "build": seconds.build,
                "prepare": seconds.prepare,
                "render": seconds.render,
                "layers": seconds.layers,
                "write": seconds.write,
                "total": seconds.total,
            },
            "prepared": rendered.statistics.iter().map(|f| (f.name.to_owned(), f.value.into())).collect::<Map<_, _>>(),
            "cpu_seconds": ProcessTime::now().as_duration().as_secs_f64(),
            "accel_thread_seconds": {
                "closest": counters.closest_time.as_secs_f64(),
                "occlusion": counters.occlusion_time.as_secs_f64(),
            },
            "rays": { "closest": counters.closest_rays, "occlusion": counters.occlusion_rays },
            "paths": counters.paths,
            "invalid_samples": rendered.invalid_count,
            "relmse_estimate": rendered.relmse,
            "relmse_interval": rendered.relmse_interval,
            "bias": plan.job.squared_bias.map(f64::sqrt),
            "peak_memory_bytes": peak_memory(),
            "planned_memory_bytes": session.memory.peak(),
            "memory_limit_bytes": session.memory.limit(),
            "accel_memory_bytes": scene.accel.memory_bytes(),
            "mesh_memory_bytes": scene.mesh_bytes(),
            "film_memory_bytes": rendered.tiles.iter().map(|t| t.memory_bytes()).sum::<usize>(),
            "triangles": scene.triangle_count(),
            "dropped_primitives": report.dropped_primitives,
            "needs": needs,
        })
    }
}

/// Returns the peak resident memory of the process; `None` if the system does not provide it.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}
