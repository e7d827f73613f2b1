//! Arguments and lists of names that several subcommands share.

use crate::accel::AccelKind;
use crate::integrator::Settings;
use crate::sampling::SamplerKind;

/// Returns the names of the integrators: "path, direct or aov".
pub fn integrators() -> String {
    one_of(Settings::NAMES)
}

/// Returns the names of the samplers.
pub fn samplers() -> String {
    one_of(SamplerKind::ALL)
}

/// Returns the names of the traversals of this build.
pub fn accels() -> String {
    one_of(AccelKind::CHOICES)
}

/// Returns "a, b or c".
pub fn one_of<T: ToString>(names: impl IntoIterator<Item = T>) -> String {
    let mut names: Vec<String> = names.into_iter().map(|name| name.to_string()).collect();
    let last = names.pop().unwrap_or_default();
    if names.is_empty() { last } else { format!("{} or {last}", names.join(", ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_sentences() {
        assert_eq!(
            [one_of(["a"]), one_of(["a", "b"]), one_of(["a", "b", "c"])],
            ["a", "a or b", "a, b or c"]
        );
    }
}
