//! Integrators: the plugins of [`integrator`](crate::integrator) read their parameters from objects of the file.

use super::{Builder, ObjectSource, unknown_plugin};
use crate::error::Result;
use crate::integrator::{Settings, Source, aov};
use crate::loader::mitsuba::graph::ObjectId;
use crate::loader::mitsuba::props::Props;

const MITSUBA: [&str; 11] = [
    "batch",
    "direct_projective",
    "prb",
    "prb_basic",
    "prb_projective",
    "prbvolpath",
    "stokes",
    "volpath",
    "volpathmis",
    "volprim_rf_basic",
    "prb_threepoint",
];

impl Builder<'_> {
    /// Returns the settings of an integrator.
    ///
    /// # Errors
    /// As for [`instantiate`](super::instantiate).
    pub fn integrator(&mut self, object: ObjectId) -> Result<Settings> {
        let props = Props::new(self.graph, object);
        let read = Settings::read(&props.object.plugin, &mut ObjectSource { builder: self, props: &props })?;
        let Some(settings) = read else {
            let names = [Settings::NAMES, &[aov::MOMENT]].concat();
            return Err(unknown_plugin(props.object, &names, &MITSUBA));
        };
        self.ignore(&props, &["samples_per_pass", "block_size", "timeout"], "the render job decides");
        self.finish(props);
        Ok(settings)
    }
}

impl Source for ObjectSource<'_, '_> {
    fn integrator(&mut self) -> Result<Option<Settings>> {
        let inner = self.props.child("integrator")?;
        inner.map(|object| self.builder.integrator(object)).transpose()
    }

    fn note(&mut self, text: &str) {
        self.builder.note(text);
    }
}
