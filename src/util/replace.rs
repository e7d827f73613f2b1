//! Atomic replacement of files.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Writes a file to a temporary name in the same folder, `name.XXXXXX.part.ext`, and renames it when it is complete.
/// An existing file is therefore replaced only by a complete one, and is unchanged if writing fails. A symbolic link
/// is followed. What is not a regular file, such as a pipe or `/dev/null`, is written to.
///
/// # Errors
/// If the folder is missing, full or not writable, or if there is a folder with the file's name.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<()> {
    replace_with(path, |file| file.write_all(bytes))
}

/// Computes [`replace`] for content that `write` writes incrementally.
///
/// # Errors
/// As [`replace`].
pub fn replace_with(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let fail = |message: String| failure(path, &message);
    if is_special(path) {
        let fill = || {
            let mut file = BufWriter::new(File::options().write(true).open(path)?);
            write(&mut file)?;
            file.flush()
        };
        return fill().map_err(|e: io::Error| fail(e.to_string()));
    }
    let (target, mut part) = begin(path)?;
    part.fill(write).map_err(|e| fail(e.to_string()))?;
    part.path.persist(&target).map_err(|e| fail(e.error.to_string()))
}

/// Checks whether [`replace`] can start, so that a long computation does not fail at its end.
///
/// # Errors
/// As [`replace`].
pub fn check_replaceable(path: &Path) -> Result<()> {
    if is_special(path) { Ok(()) } else { begin(path).map(drop) }
}

/// Returns whether two paths name the same file, which need not exist.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    let whole = |path: &Path| {
        let folder = path.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."));
        let place = || Some(std::fs::canonicalize(folder).ok()?.join(path.file_name()?));
        std::fs::canonicalize(path).ok().or_else(place).unwrap_or_else(|| path.to_owned())
    };
    whole(a) == whole(b)
}

/// Returns whether there is something that is neither a file nor a folder.
fn is_special(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|file| !file.is_file() && !file.is_dir())
}

fn failure(path: &Path, message: &str) -> Error {
    Error::output(format!("cannot be written: {message}")).in_file(path)
}

/// Resolves symbolic links and creates a temporary file in the target's folder. Removes temporary files of the same
/// target that killed writers left there.
fn begin(path: &Path) -> Result<(PathBuf, TemporaryFile)> {
    let fail = |message: String| failure(path, &message);
    let target = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    if target.is_dir() {
        return Err(fail("it is a folder".into()));
    }
    let folder = match target.parent() {
        Some(parent) if parent != Path::new("") => parent.to_owned(),
        _ => PathBuf::from("."),
    };
    if !folder.is_dir() {
        return Err(fail(format!("the folder \"{}\" does not exist", folder.display())));
    }
    let name = TemporaryName::of(&target);
    name.remove_abandoned(&folder);
    let part = TemporaryFile::new(&name, &folder).map_err(fail)?;
    Ok((target, part))
}

/// The name pattern of a file's temporary files.
struct TemporaryName {
    prefix: String,
    suffix: String,
}

/// The number of random characters in a temporary name.
const RANDOM: usize = 6;

impl TemporaryName {
    fn of(target: &Path) -> Self {
        let stem = target.file_stem().unwrap_or_default().to_string_lossy();
        let extension = target.extension().unwrap_or_default().to_string_lossy();
        TemporaryName { prefix: format!("{stem}."), suffix: format!(".part.{extension}") }
    }

    fn matches(&self, name: &str) -> bool {
        name.strip_prefix(&self.prefix)
            .and_then(|rest| rest.strip_suffix(&self.suffix))
            .is_some_and(|random| random.len() == RANDOM && random.bytes().all(|b| b.is_ascii_alphanumeric()))
    }

    /// Removes the temporary files of dead writers, which hold no lock.
    fn remove_abandoned(&self, folder: &Path) {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let named = entries.filter(|entry| entry.file_name().to_str().is_some_and(|n| self.matches(n)));
        for entry in named.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file())) {
            // A failure to remove it is ignored.
            if let Ok(file) = File::open(entry.path())
                && file.try_lock().is_ok()
            {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// A temporary file, which is removed when dropped. It is locked while its writer lives.
struct TemporaryFile {
    file: File,
    path: tempfile::TempPath,
}

impl TemporaryFile {
    /// Creates an empty file in the folder.
    fn new(name: &TemporaryName, folder: &Path) -> Result<Self, String> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(&name.prefix).suffix(&name.suffix).rand_bytes(RANDOM);
        // The file has default permissions. Error messages omit the temporary name.
        let create = |path: &Path| File::options().read(true).write(true).create_new(true).open(path);
        loop {
            let part = builder.make_in(folder, create).map_err(|e| e.to_string())?;
            let (file, path) = part.into_parts();
            // File systems without locks are accepted.
            let _ = file.lock();
            // Another writer may have removed it as abandoned before it was locked.
            if path.exists() {
                return Ok(TemporaryFile { file, path });
            }
        }
    }

    /// Writes the content and waits until it is on disk, so that the rename cannot happen first.
    fn fill(&mut self, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
        let mut buffered = BufWriter::new(&self.file);
        write(&mut buffered)?;
        buffered.flush()?;
        drop(buffered);
        self.file.sync_all()
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    #[cfg(target_os = "linux")]
    fn what_cannot_be_made_is_named_as_it_was_asked_for() {
        // Files cannot be created there.
        let error = replace(Path::new("/proc/image.exr"), b"").unwrap_err().to_string();
        assert!(error.contains("cannot be written") && !error.contains(".part"), "{error}");
    }

    #[test]
    fn a_new_file_takes_the_place_of_the_old_and_leaves_nothing_beside_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("image.exr");
        for content in ["old", "new and longer"] {
            replace(&path, content.as_bytes()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), content);
            assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        }
    }

    #[test]
    fn what_dead_writers_left_is_removed_and_what_living_ones_write_stays() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("image.exr");
        let (_, living) = begin(&path).unwrap();
        let others = ["image.abc.part.exr", "image.abcdef.part.png", "image2.abcdef.part.exr", "image.exr"];
        let abandoned = dir.path().join("image.aBcD01.part.exr");
        fs::write(&abandoned, "half").unwrap();
        others.iter().for_each(|name| fs::write(dir.path().join(name), "").unwrap());
        check_replaceable(&path).unwrap();
        assert!(!abandoned.exists() && living.path.exists());
        assert!(others.iter().all(|name| dir.path().join(name).exists()));
        drop(living);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), others.len());
    }

    #[test]
    fn pipes_are_written_to_and_not_replaced() {
        use std::os::unix::fs::FileTypeExt;
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        let reader = std::thread::spawn({
            let path = path.clone();
            move || fs::read_to_string(path).unwrap()
        });
        check_replaceable(&path).unwrap();
        replace(&path, b"text").unwrap();
        assert_eq!(reader.join().unwrap(), "text");
        assert!(fs::metadata(&path).unwrap().file_type().is_fifo());
    }

    #[test]
    fn the_same_file_is_recognised_by_other_paths() {
        let dir = tempfile::tempdir().unwrap();
        let (file, other) = (dir.path().join("a"), dir.path().join("b"));
        fs::write(&file, "").unwrap();
        std::os::unix::fs::symlink(&file, &other).unwrap();
        assert!(is_same_file(&file, &dir.path().join("./a")) && is_same_file(&file, &other));
        assert!(is_same_file(&dir.path().join("new"), &dir.path().join("./new")));
        assert!(!is_same_file(&file, &dir.path().join("new")));
        assert!(is_same_file(Path::new("new"), Path::new("./new")));
    }

    /// Runs this test in a process whose files are limited to 8 KiB.
    #[test]
    fn a_full_disk_leaves_the_older_file_and_nothing_else() {
        const WHERE: &str = "BUFFON_TEST_FULL_DISK";
        if let Some(path) = std::env::var_os(WHERE) {
            let error = replace(Path::new(&path), &[0; 100_000]).unwrap_err().to_string();
            let expected = Path::new(&path).display();
            assert_eq!(error, format!("{expected}: cannot be written: file too large"));
            return;
        }
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("image.exr");
        fs::write(&path, "old").unwrap();
        let name = "util::replace::tests::a_full_disk_leaves_the_older_file_and_nothing_else";
        let status = std::process::Command::new("sh")
            .args(["-c", "trap '' XFSZ; ulimit -f 16; exec \"$0\" --exact \"$1\" >/dev/null"])
            .arg(std::env::current_exe().unwrap())
            .arg(name)
            .env(WHERE, &path)
            .status();
        assert!(status.unwrap().success());
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
