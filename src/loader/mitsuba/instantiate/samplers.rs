//! Samplers: Mitsuba's names, mapped to Buffon's.

use super::{Builder, unknown_plugin};
use crate::error::Result;
use crate::loader::mitsuba::graph::ObjectId;
use crate::loader::mitsuba::props::Props;
use crate::sampling::SamplerKind;

/// Mitsuba's sampler of low discrepancy, which is that of Buffon's default.
const LOW_DISCREPANCY: &str = "ldsampler";
/// Mitsuba's samplers that Buffon does not have, each with the closest that it has.
pub const MAPPED: [(&str, SamplerKind); 3] = [
    ("hammersley", SamplerKind::Sobol),
    (LOW_DISCREPANCY, SamplerKind::Sobol),
    ("orthogonal", SamplerKind::Multijitter),
];

impl Builder<'_> {
    /// Reads a sensor's sampler. The first sensor's sampler is the scene's.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn sampler(&mut self, object: ObjectId, first: bool) -> Result<()> {
        let props = Props::new(self.graph, object);
        let name = props.object.plugin.as_str();
        let mapped = MAPPED.iter().find(|(mitsubas, _)| *mitsubas == name);
        let kind = match (name.parse(), mapped) {
            (Ok(kind), _) => kind,
            (Err(_), Some((_, ours))) => {
                if name != LOW_DISCREPANCY {
                    self.note(format!("the sampler {name} is mapped to {ours}"));
                }
                *ours
            }
            _ => {
                let ours = SamplerKind::ALL.map(SamplerKind::name);
                let supported: Vec<&str> = ours.into_iter().chain(MAPPED.map(|(name, _)| name)).collect();
                return Err(unknown_plugin(props.object, &supported, &[]));
            }
        };
        let count = props.integer("sample_count", 1..=i64::from(u32::MAX))?;
        self.ignore(&props, &["seed"], "the command line's --seed decides");
        self.ignore(&props, &["dimension"], "there are as many dimensions as paths need");
        self.ignore(&props, &["jitter", "strength"], "samples are always jittered");
        self.finish(props);
        if first {
            self.loaded.sampler = Some(kind);
            self.loaded.samples_per_pixel = count.map(|n| n as u32);
        }
        Ok(())
    }
}
