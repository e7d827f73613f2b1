//! Paths as seen from a folder.

use std::path::{Component, Path, PathBuf};

/// Returns the path as seen from a folder: `../scenes/s.xml`. A path is returned as it is if it or the folder does not
/// exist, or if they have no root in common.
pub fn relative(path: &Path, folder: &Path) -> PathBuf {
    let (Ok(from), Ok(to)) = (folder.canonicalize(), path.canonicalize()) else { return path.to_owned() };
    let common = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return path.to_owned();
    }
    let up = from.components().skip(common).map(|_| Component::ParentDir);
    up.chain(to.components().skip(common)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_go_up_and_down() {
        let root = tempfile::tempdir().expect("a folder");
        let (scenes, page) = (root.path().join("scenes"), root.path().join("out/bench"));
        std::fs::create_dir_all(&scenes).expect("a folder");
        std::fs::create_dir_all(&page).expect("a folder");
        std::fs::write(scenes.join("s.xml"), "").expect("a file");
        assert_eq!(relative(&scenes.join("s.xml"), &page), Path::new("../../scenes/s.xml"));
        assert_eq!(relative(&page, root.path()), Path::new("out/bench"));
        assert_eq!(relative(Path::new("none.xml"), &page), Path::new("none.xml"));
    }
}
