//! Objects of a scene file as sources of parameters for plugins.

use super::Builder;
use crate::error::{Error, Result};
use crate::loader::mitsuba::props::Props;
use crate::util::parameters::Parameters;
use std::ops::RangeInclusive;

/// An object of the file, from which a plugin reads its parameters.
pub struct ObjectSource<'b, 'g> {
    /// The scene under construction.
    pub builder: &'b mut Builder<'g>,
    /// The object's properties.
    pub props: &'b Props<'g>,
}

impl Parameters for ObjectSource<'_, '_> {
    fn has(&self, name: &'static str) -> bool {
        self.props.has(name)
    }

    fn boolean(&mut self, name: &'static str, default: bool) -> Result<bool> {
        self.props.boolean(name, default)
    }

    fn integer(&mut self, name: &'static str, range: RangeInclusive<i64>) -> Result<Option<i64>> {
        self.props.integer(name, range)
    }

    fn float(&mut self, name: &'static str) -> Result<Option<f64>> {
        self.props.float(name)
    }

    fn text(&mut self, name: &'static str) -> Result<Option<String>> {
        Ok(self.props.text(name)?.map(str::to_owned))
    }

    fn ignore(&mut self, names: &[&'static str], why: &str) {
        self.builder.ignore(self.props, names, why);
    }

    fn refusal(&self, name: &'static str, expected: &str) -> Error {
        self.props.refusal(name, expected)
    }

    fn error(&self, name: &'static str, message: &str) -> Error {
        self.props.error(name, message)
    }

    fn object_error(&self, message: &str) -> Error {
        self.props.object.error(message)
    }
}
