//! Samplers: Mitsuba's names, mapped to Buffon's.

use super::{Builder, unknown_plugin};
use crate::error::Result;
use crate::loader::graph::ObjectId;
use crate::loader::props::Props;
use crate::sampling::SamplerKind;

const SUPPORTED: [&str; 6] = ["independent", "stratified", "multijitter", "orthogonal", "ldsampler", "sobol"];

impl Builder<'_> {
    /// A sensor's sampler; the first sensor's is the scene's.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn sampler(&mut self, object: ObjectId, first: bool) -> Result<()> {
        let props = Props::new(self.graph, object);
        let name = props.object.plugin.as_str();
        let (kind, mapped) = match name {
            "independent" => (SamplerKind::Independent, None),
            "stratified" => (SamplerKind::Stratified, None),
            "sobol" => (SamplerKind::Sobol, None),
            "multijitter" => (SamplerKind::Stratified, Some("stratified")),
            "orthogonal" | "ldsampler" => (SamplerKind::Sobol, Some("sobol")),
            _ => return Err(unknown_plugin(props.object, &SUPPORTED, &[])),
        };
        if let Some(ours) = mapped {
            self.note(format!("the sampler {name} is mapped to {ours}"));
        }
        let count = props.integer("sample_count", 1..=i64::from(u32::MAX))?;
        self.ignore(&props, &["seed"], "the command line's --seed decides");
        self.ignore(&props, &["jitter", "strength"], "samples are always jittered");
        self.finish(props);
        if first {
            self.loaded.sampler = Some(kind);
            self.loaded.samples_per_pixel = count.map(|n| n as u32);
        }
        Ok(())
    }
}
