//! The cache of rendered references: its folder and its file names.

use crate::session::SceneFile;
use crate::util::digest;
use std::path::{Path, PathBuf};

/// Returns the digest of everything that determines the image: the scene after the user's choices, with the files that
/// it refers to; its integrator; and Buffon's version. The layout of the scene file has no effect.
pub(super) fn key(file: &SceneFile) -> String {
    let (integrator, version) = (&file.defaults.integrator, env!("BUFFON_VERSION"));
    format!("{:016x}", digest(&(&file.description, file.sensor, integrator, version)))
}

/// Returns the file of a reference, in `$XDG_CACHE_HOME/buffon` or `~/.cache/buffon`; `None` if neither folder is
/// known.
pub(super) fn file(scene: &Path, key: &str) -> Option<PathBuf> {
    let absolute = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let folder = absolute("XDG_CACHE_HOME").or_else(|| Some(absolute("HOME")?.join(".cache")))?;
    let stem = scene.file_stem().unwrap_or_default().to_string_lossy();
    Some(folder.join("buffon").join(format!("{stem}-{key}.exr")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::SceneChoices;

    const SCENE: &str = r#"<scene version="3.0.0"><default name="depth" value="4"/>
        <integrator type="path"><integer name="max_depth" value="$depth"/></integrator>
        <sensor type="perspective"/><shape type="obj"><string name="filename" value="m.obj"/></shape></scene>"#;
    const MESH: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

    fn key_of(scene: &str, mesh: &str, choices: &SceneChoices) -> String {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("s.xml"), scene).expect("a file");
        std::fs::write(folder.path().join("m.obj"), mesh).expect("a file");
        key(&SceneFile::load(&folder.path().join("s.xml"), choices).expect("a scene"))
    }

    #[test]
    fn the_key_depends_on_what_the_picture_depends_on_and_on_nothing_else() {
        let plain = SceneChoices::default();
        let own = key_of(SCENE, MESH, &plain);
        assert_eq!(own, key_of(&SCENE.replace("<sensor", "<!-- more -->\n\n <sensor"), MESH, &plain));
        let mut define = plain.clone();
        define.load.defines.push(("depth".into(), "5".into()));
        let small = SceneChoices { size: Some((8, 8)), ..plain.clone() };
        for other in [
            key_of(SCENE, &MESH.replace("v 0 1 0", "v 0 2 0"), &plain),
            key_of(&SCENE.replace("value=\"4\"", "value=\"6\""), MESH, &plain),
            key_of(SCENE, MESH, &define),
            key_of(SCENE, MESH, &small),
        ] {
            assert_ne!(own, other);
        }
    }
}
