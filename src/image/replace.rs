//! Files that appear whole or not at all.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Writes a file under another name in the same folder, `name.XXXXXX.part.ext`, and renames it when it is
/// complete, so that an older file of that name is whole until the new one is, and stays if writing fails. A
/// symbolic link is written through.
///
/// # Errors
/// If the folder is missing, full or cannot be written to, or if there is a folder of that name.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<()> {
    let fail = |message: String| failure(path, &message);
    let (target, part) = begin(path)?;
    fill(&part, bytes).map_err(|e| fail(reason(e)))?;
    part.persist(&target).map_err(|e| fail(reason(e.error)))
}

/// Whether [`replace`] could begin there: a long computation should not fail at its end.
///
/// # Errors
/// As those of [`replace`].
pub fn check_replaceable(path: &Path) -> Result<()> {
    begin(path).map(drop)
}

fn failure(path: &Path, message: &str) -> Error {
    Error::output(format!("cannot be written: {message}")).in_file(path)
}

/// The file behind symbolic links, and a temporary one beside it.
fn begin(path: &Path) -> Result<(PathBuf, tempfile::TempPath)> {
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
        return Err(fail(format!("there is no folder \"{}\"", folder.display())));
    }
    let part = temporary(&target, &folder).map_err(fail)?;
    Ok((target, part))
}

/// Writes a file and waits until it is on the disk: a rename must not overtake it.
fn fill(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = std::fs::OpenOptions::new().write(true).open(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

/// A new, empty file in the folder, which is removed when dropped.
fn temporary(target: &Path, folder: &Path) -> Result<tempfile::TempPath, String> {
    let stem = target.file_stem().unwrap_or_default().to_string_lossy();
    let extension = target.extension().unwrap_or_default().to_string_lossy();
    let (prefix, suffix) = (format!("{stem}."), format!(".part.{extension}"));
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(&suffix);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Those of an ordinary file; the umask is taken from them.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    Ok(builder.tempfile_in(folder).map_err(reason)?.into_temp_path())
}

/// The reason without the temporary name, which means nothing to anybody.
fn reason(error: std::io::Error) -> String {
    error.raw_os_error().map_or(error, std::io::Error::from_raw_os_error).to_string()
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::fs;

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

    /// Runs itself in a process whose files may not be longer than 8 KiB.
    #[test]
    fn a_full_disk_leaves_the_older_file_and_nothing_else() {
        const WHERE: &str = "BUFFON_TEST_FULL_DISK";
        if let Some(path) = std::env::var_os(WHERE) {
            let error = replace(Path::new(&path), &[0; 100_000]).unwrap_err().to_string();
            let expected = Path::new(&path).display();
            assert_eq!(error, format!("{expected}: cannot be written: File too large (os error 27)"));
            return;
        }
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("image.exr");
        fs::write(&path, "old").unwrap();
        let name = "image::replace::tests::a_full_disk_leaves_the_older_file_and_nothing_else";
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
