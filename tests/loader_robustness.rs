//! Broken input of every kind ends in a scene or an error, never in a panic.

use crate::loader::{BOX, Files};
use buffon::loader::LoadOptions;
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever becomes of a scene's text, loading it ends with a scene or an error.
    #[test]
    fn a_mutated_scene_never_panics(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), 0usize..12, "[-0-9a-z<>/\"'=$. é]{0,6}"), 1..6)
    ) {
        let mut text: Vec<char> = BOX.chars().collect();
        for (at, removed, inserted) in edits {
            let at = at.index(text.len());
            let end = (at + removed).min(text.len());
            text.splice(at..end, inserted.chars());
        }
        let files = Files::new(&[("scene.xml", &text.iter().collect::<String>())]);
        if let Err(error) = files.load(&LoadOptions::default()) {
            prop_assert!(!error.to_string().is_empty());
        }
    }
}
