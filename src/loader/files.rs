//! The search for the files that a scene names.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Folders in which files are searched for, after the folder of the file that names them.
#[derive(Clone, Debug, Default)]
pub struct Folders {
    /// Folders of `<path>` elements, the latest first.
    scene: Vec<PathBuf>,
    /// The folder of the first scene file, then the user's `-a` folders.
    user: Vec<PathBuf>,
    /// What has been found.
    found: Arc<Mutex<Vec<PathBuf>>>,
}

impl Folders {
    /// Creates the list of the scene file's folder and the user's folders.
    pub fn new(scene_file: &Path, search_paths: &[PathBuf]) -> Self {
        let own = scene_file.parent().map(Path::to_path_buf);
        let user = own.into_iter().chain(search_paths.iter().cloned()).collect();
        Folders { user, ..Folders::default() }
    }

    /// Adds the folder of a `<path>` element, which is searched before the folders added earlier.
    pub fn prepend(&mut self, folder: PathBuf) {
        self.scene.insert(0, folder);
    }

    /// Returns the first existing file or folder of a name. An absolute name is used as it is. Any other is searched
    /// for beside the file that names it, then in the scene's folders, then in the user's folders.
    pub fn find(&self, named_in: &Path, name: &str) -> Option<PathBuf> {
        let name = Path::new(name);
        let own = named_in.parent().map(Path::to_path_buf);
        let folders = own.iter().chain(&self.scene).chain(&self.user);
        if name.as_os_str().is_empty() {
            return None;
        }
        let found = folders.map(|folder| folder.join(name)).find(|path| path.exists())?;
        self.found.lock().unwrap_or_else(PoisonError::into_inner).push(found.clone());
        Some(found)
    }

    /// Returns all that has been found.
    pub fn found(&self) -> Vec<PathBuf> {
        self.found.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}
