//! Broken input of every kind ends in a scene or an error, never in a panic.

use crate::loader::{BOX, Files, TRIANGLE};
use buffon::loader::{LoadOptions, load};
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

    /// The same for meshes.
    #[test]
    fn a_mutated_mesh_never_panics(
        edits in proptest::collection::vec((any::<prop::sample::Index>(), 0usize..4, "[-0-9a-z/. \n]{0,4}"), 1..5)
    ) {
        let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
            element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
        for (name, text) in [("m.obj", TRIANGLE), ("m.ply", ply)] {
            let mut text: Vec<char> = text.chars().collect();
            for (at, removed, inserted) in &edits {
                let at = at.index(text.len().max(1));
                let end = (at + removed).min(text.len());
                text.splice(at..end, inserted.chars());
            }
            let files = Files::new(&[(name, &text.iter().collect::<String>())]);
            let _ = load(&files.path().join(name), &LoadOptions::default());
        }
    }
}
