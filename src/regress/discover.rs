//! The scene files of a folder.

use crate::error::{Error, Result, counted};
use roxmltree::{Document, ParsingOptions};
use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Component, Path, PathBuf};

/// The extensions of scene files. A bare mesh is not tested as a scene.
const EXTENSIONS: [&str; 3] = ["xml", "gltf", "glb"];

/// The name of the folder of references beside the scenes.
pub(super) const REFERENCES: &str = "refs";

/// A scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundScene {
    /// Its path relative to the folder, with `/` between the parts, which is the name of its test.
    pub name: String,
    /// The file.
    pub path: PathBuf,
}

/// The contents of a folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// The scenes, sorted by name.
    pub scenes: Vec<FoundScene>,
    /// Files with a scene's extension that are not scenes by themselves: their names and the reasons.
    pub skipped: Vec<(String, String)>,
}

/// Finds the scenes below a folder: `.xml`, `.gltf` and `.glb` files whose names (paths from the folder) contain
/// `filter`.
///
/// An XML file is not a scene by itself if its root is not `<scene>`, if another file below the folder includes it, or
/// if neither it nor the files that it includes have a sensor. Folders named `refs` and hidden folders are skipped.
///
/// # Errors
/// If the folder cannot be read or contains no scene.
pub fn discover(folder: &Path, filter: Option<&str>) -> Result<Found> {
    let mut files = Vec::new();
    list(folder, &mut files)?;
    files.sort();
    let xml = files.iter().filter(|f| has_extension(f, "xml"));
    let contents: HashMap<&Path, Content> = xml.map(|f| (f.as_path(), Content::read(f))).collect();
    let included: HashSet<&Path> =
        contents.values().flat_map(|content| &content.includes).map(PathBuf::as_path).collect();
    let mut found = Found::default();
    let mut others = 0;
    for path in &files {
        let name = name_of(path, folder);
        let reason = contents.get(path.as_path()).and_then(|content| {
            if !content.is_scene {
                Some("its root is not <scene>".to_owned())
            } else if included.contains(path.as_path()) {
                Some("a fragment: another scene includes it".to_owned())
            } else {
                (!has_sensor(path, &contents)).then(|| "it has no sensor".to_owned())
            }
        });
        if filter.is_some_and(|filter| !name.contains(filter)) {
            others += usize::from(reason.is_none());
            continue;
        }
        match reason {
            Some(reason) => found.skipped.push((name, reason)),
            None => found.scenes.push(FoundScene { name, path: path.clone() }),
        }
    }
    if found.scenes.is_empty() {
        let message = match filter {
            Some(filter) if others > 0 => format!(
                "none of its {} has a name with \"{filter}\"",
                counted(others as u64, "scene", "scenes")
            ),
            _ => format!("expected scenes (.{}) in it, found none", EXTENSIONS.join(", .")),
        };
        return Err(Error::scene(message).in_file(folder));
    }
    Ok(found)
}

/// Adds the files below a folder that have a scene's extension.
fn list(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    let unreadable = |e: std::io::Error| {
        let message = match e.kind() {
            std::io::ErrorKind::NotFound => "no such folder".to_owned(),
            std::io::ErrorKind::NotADirectory => "expected a folder of scenes, found a file".to_owned(),
            _ => format!("cannot be read: {e}"),
        };
        Error::scene(message).in_file(folder)
    };
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() {
            // Links may form cycles.
            if name != REFERENCES && !name.starts_with('.') && !path.is_symlink() {
                list(&path, files)?;
            }
        } else if EXTENSIONS.iter().any(|e| has_extension(&path, e)) {
            files.push(path);
        }
    }
    Ok(())
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

/// Returns the path relative to the folder, with `/` between the parts.
fn name_of(path: &Path, folder: &Path) -> String {
    let below = path.strip_prefix(folder).unwrap_or(path);
    below.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/")
}

/// The properties of an XML file that decide whether it is a scene. A file that is not well-formed counts as a scene,
/// so that rendering it reports the error.
struct Content {
    is_scene: bool,
    has_sensor: bool,
    /// The included files, as paths without `.` and `..`.
    includes: Vec<PathBuf>,
}

impl Content {
    fn read(path: &Path) -> Content {
        let faulty = Content { is_scene: true, has_sensor: true, includes: Vec::new() };
        let Ok(text) = fs::read_to_string(path) else { return faulty };
        let options = ParsingOptions { allow_dtd: true, ..ParsingOptions::default() };
        let Ok(document) = Document::parse_with_options(&text, options) else { return faulty };
        let elements = || document.descendants().filter(roxmltree::Node::is_element);
        let folder = path.parent().unwrap_or(Path::new(""));
        let named = elements().filter(|e| e.has_tag_name("include")).filter_map(|e| e.attribute("filename"));
        let named: Vec<&str> = named.collect();
        Content {
            is_scene: document.root_element().has_tag_name("scene"),
            // A file name with a parameter may stand for any file.
            has_sensor: elements().any(|e| e.has_tag_name("sensor") || e.has_tag_name("camera"))
                || named.iter().any(|name| name.contains('$')),
            includes: named.iter().map(|name| plain(&folder.join(name))).collect(),
        }
    }
}

/// Returns whether a file, or one that it includes, has a sensor. A file outside the folder is assumed to have one.
fn has_sensor(path: &Path, contents: &HashMap<&Path, Content>) -> bool {
    let mut seen = HashSet::new();
    let mut open = vec![path];
    while let Some(path) = open.pop() {
        match contents.get(path) {
            None => return true,
            Some(content) if content.has_sensor => return true,
            Some(content) if seen.insert(path) => open.extend(content.includes.iter().map(PathBuf::as_path)),
            Some(_) => {}
        }
    }
    false
}

/// Returns the path without `.` and `..`, without access to the file system.
fn plain(path: &Path) -> PathBuf {
    let mut result = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir if matches!(result.components().next_back(), Some(Component::Normal(_))) => {
                result.pop();
            }
            other => result.push(other),
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        dir
    }

    #[test]
    fn fragments_reports_and_references_are_no_scenes() {
        let dir = folder(&[
            ("a/one.xml", "<scene><include filename='../parts/./camera.xml'/></scene>"),
            ("a/two.xml", "<scene><sensor type='perspective'/></scene>"),
            ("a/broken.xml", "<scene>"),
            ("a/any.xml", "<scene><include filename='$camera.xml'/></scene>"),
            ("parts/camera.xml", "<scene><sensor type='perspective'/></scene>"),
            ("parts/unused.xml", "<scene><shape type='sphere'/></scene>"),
            ("junit.xml", "<testsuites/>"),
            ("a/refs/one.xml", "<scene><sensor/></scene>"),
            (".git/one.xml", "<scene><sensor/></scene>"),
            ("b/model.GLB", ""),
            ("b/mesh.ply", ""),
        ]);
        let found = discover(dir.path(), None).unwrap();
        let names: Vec<&str> = found.scenes.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names, ["a/any.xml", "a/broken.xml", "a/one.xml", "a/two.xml", "b/model.GLB"]);
        let skipped: Vec<_> = found.skipped.iter().map(|(n, why)| (n.as_str(), why.as_str())).collect();
        let expected = [
            ("junit.xml", "its root is not <scene>"),
            ("parts/camera.xml", "a fragment: another scene includes it"),
            ("parts/unused.xml", "it has no sensor"),
        ];
        assert_eq!(skipped, expected);
        let found = discover(dir.path(), Some("a/o")).unwrap();
        assert_eq!((found.scenes.len(), found.skipped.len()), (1, 0));
    }

    #[test]
    fn a_folder_without_scenes_is_an_error() {
        let dir = folder(&[("mesh.ply", ""), ("one.xml", "<scene><sensor/></scene>")]);
        let at = dir.path().display();
        let says = |path: &Path, filter| discover(path, filter).unwrap_err().to_string();
        let expected = format!("{at}: none of its 1 scene has a name with \"two\"");
        assert_eq!(says(dir.path(), Some("two")), expected);
        fs::remove_file(dir.path().join("one.xml")).unwrap();
        let expected = format!("{at}: expected scenes (.xml, .gltf, .glb) in it, found none");
        assert_eq!(says(dir.path(), None), expected);
        assert_eq!(says(&dir.path().join("no"), None), format!("{at}/no: no such folder"));
        let file = dir.path().join("mesh.ply");
        assert_eq!(says(&file, None), format!("{at}/mesh.ply: expected a folder of scenes, found a file"));
    }
}
