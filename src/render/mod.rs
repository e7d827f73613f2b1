//! Rendering: passes over sample ranges, threads, stop rules, progress, output.

mod adaptive;
pub mod edges;
pub mod job;
pub mod output;
mod passes;
pub mod progress;
mod progressive;
mod splats;
pub mod state;
pub mod stop;
pub mod tracing;

pub use adaptive::Rates;
pub use job::{Job, JobSettings, Rendered, SampleCounts, thread_pool};
pub use passes::TILE;
pub use progress::Progress;
pub use state::{CheckpointSink, PreviewSink, RenderState, Sinks};
pub use stop::{StopReason, StopRules};
