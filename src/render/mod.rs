//! Rendering a scene: passes over sample ranges, threads, stop rules, progress, the account of it all.

pub mod job;
pub mod output;
pub mod progress;
mod splats;
pub mod stop;
pub mod tracing;

pub use job::{Job, JobSettings, Rendered};
pub use progress::Progress;
pub use stop::{StopReason, StopRules};
