//! What samples, records and photons belong to, as hashes that files keep.

use crate::scene::description::Description;
use crate::util::digest;
use std::fmt;

/// The scene and the view of a render, as hashes of their data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneHashes {
    /// Hash of the scene, without sensors.
    pub scene: u64,
    /// Hash of the sensor with its film, without the crop.
    pub view: u64,
}

impl SceneHashes {
    /// The origin of what a sensor of a scene sees.
    pub fn of(description: &Description, sensor: usize) -> Self {
        let mut sensor = description.sensors[sensor].clone();
        sensor.film.crop = None;
        SceneHashes { scene: scene(description), view: digest(&sensor) }
    }
}

impl fmt::Display for SceneHashes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}{:016x}", self.scene, self.view)
    }
}

/// Returns the hash of a scene without its sensors. Positions in the scene file do not count, and media only if there
/// are any.
fn scene(description: &Description) -> u64 {
    let Description {
        shapes,
        groups,
        instances,
        materials,
        material_names: _,
        textures,
        media,
        emitters,
        sensors: _,
    } = description;
    let surfaces = (shapes, groups, instances, materials, textures, emitters);
    if media.is_empty() { digest(&surfaces) } else { digest(&(surfaces, media)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loader::{LoadOptions, Loaded, load};
    use serde_json::Value;
    use std::collections::BTreeSet;
    use std::path::{Path, PathBuf};

    /// The scene files of a folder, and of those in it.
    fn scenes(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            match path.extension() {
                _ if path.is_dir() => scenes(&path, found),
                Some(extension) if extension == "xml" => found.push(path),
                _ => {}
            }
        }
    }

    /// The names of fields in what `{:?}` makes of a value: words before a colon, outside of texts.
    fn debugged(text: &str) -> BTreeSet<String> {
        let outside = text.split('"').step_by(2).collect::<Vec<_>>().join("");
        let word =
            |part: &str| part.rsplit(|c: char| !c.is_alphanumeric() && c != '_').next().map(str::to_owned);
        outside
            .split(": ")
            .filter_map(word)
            .filter(|word| word.starts_with(|c: char| c.is_ascii_lowercase()))
            .collect()
    }

    fn encoded(value: &Value, names: &mut BTreeSet<String>) {
        match value {
            Value::Object(fields) => fields.iter().for_each(|(name, value)| {
                names.insert(name.clone());
                encoded(value, names);
            }),
            Value::Array(values) if !values.first().is_some_and(Value::is_number) => {
                values.iter().for_each(|value| encoded(value, names));
            }
            _ => {}
        }
    }

    /// Every field of every scene of the repository is in what is hashed, but for positions in the scene file and what
    /// follows from other fields.
    #[test]
    fn every_field_counts() {
        let mut paths = Vec::new();
        scenes(&Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes"), &mut paths);
        // Files of `terrain` and `speed` are generated.
        const OTHERS: [&str; 4] = ["hard", "terrain", "speed", "parts"];
        paths.retain(|path| !path.iter().any(|part| OTHERS.iter().any(|other| part == *other)));
        let (mut hashed, mut all) = (BTreeSet::new(), BTreeSet::new());
        for path in paths {
            let Loaded { description, integrator, .. } =
                load(&path, &LoadOptions::default()).expect("a scene");
            all.extend(debugged(&format!("{description:?} {integrator:?}")));
            encoded(&serde_json::to_value(&description).expect("JSON"), &mut hashed);
            encoded(&serde_json::to_value(&integrator).expect("JSON"), &mut hashed);
        }
        let left_out: Vec<_> = all.difference(&hashed).collect();
        // A place has a file, a line, a column and a text. Matrices are arrays in the encoding. The bounds of a medium
        // have a local and a world-space box. Names of materials are not in the pixels. A pane is passed in compiled
        // scenes only.
        let expected = [
            "bounds",
            "column",
            "file",
            "line",
            "local",
            "material_names",
            "matrix2",
            "matrix3",
            "passed",
            "place",
            "text",
            "translation",
            "world",
            "x_axis",
            "y_axis",
            "z_axis",
        ];
        assert_eq!(left_out, expected);
        assert!(all.len() > 100, "{all:?}");
    }

    /// Hashes are stored in files. They must not change with compilers or libraries, only with the types of the
    /// description: then the versions of the files must change, too.
    #[test]
    fn the_hash_of_a_scene_is_the_stored_one() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box/cornell-box.xml");
        let scene = load(&path, &LoadOptions::default()).expect("a scene");
        let SceneHashes { scene, view } = SceneHashes::of(&scene.description, 0);
        assert_eq!(format!("{scene:016x} {view:016x}"), "5ae20a2f3125e818 cdfb20eaa2cc0fd6");
    }
}
