//! Where rendered references are kept, and by which name.

use crate::session::SceneFile;
use std::fmt::{self, Write};
use std::hash::{DefaultHasher, Hasher};
use std::path::{Path, PathBuf};

/// Hashes what is written to it.
struct HashWriter(DefaultHasher);

impl Write for HashWriter {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.write(text.as_bytes());
        Ok(())
    }
}

/// What a picture depends on: the scene as its file, the files that this refers to, and the user's choices make it, how the file
/// wants it rendered, and Buffon's version. Where things stand in the file does not count.
pub(super) fn key(file: &mut SceneFile) -> String {
    let description = &mut file.description;
    let mut shapes: Vec<_> =
        description.shapes.iter_mut().chain(description.groups.iter_mut().flatten()).collect();
    let places: Vec<_> = shapes.iter_mut().map(|shape| shape.place.take()).collect();
    let instances: Vec<_> = description.instances.iter_mut().map(|instance| instance.place.take()).collect();
    let mut writer = HashWriter(DefaultHasher::new());
    let (integrator, version) = (&file.defaults.integrator, env!("BUFFON_VERSION"));
    // Nothing can fail: neither the writer nor the derived formats do.
    let _ = write!(writer, "{:?} {} {integrator:?} {version}", file.description, file.sensor);
    let description = &mut file.description;
    let shapes = description.shapes.iter_mut().chain(description.groups.iter_mut().flatten());
    shapes.zip(places).for_each(|(shape, place)| shape.place = place);
    description.instances.iter_mut().zip(instances).for_each(|(instance, place)| instance.place = place);
    format!("{:016x}", writer.0.finish())
}

/// The file of a reference: `$XDG_CACHE_HOME/buffon` or `~/.cache/buffon`; `None` where there is neither.
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
        key(&mut SceneFile::load(&folder.path().join("s.xml"), choices).expect("a scene"))
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
