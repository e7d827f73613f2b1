//! Files that appear whole or not at all.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Writes a file under another name in the same folder and renames it when it is complete, so that an older
/// file of that name is whole until the new one is, and stays if writing fails. A symbolic link is written
/// through.
///
/// `fill` gets the temporary path, `name.XXXXXX.part.ext`: the extension stays last because libraries choose
/// the format by it. The file exists there, empty. Its error is the reason alone, without the file.
///
/// # Errors
/// If the folder is missing or cannot be written to, if there is a folder of that name, or if `fill` fails.
pub fn replace(path: &Path, fill: impl FnOnce(&Path) -> Result<(), String>) -> Result<()> {
    let fail = |message: String| failure(path, &message);
    let (target, part) = begin(path)?;
    fill(&part).map_err(fail)?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_failed_write_leaves_the_older_file_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("image.exr");
        replace(&path, |part| fs::write(part, "old").map_err(|e| e.to_string())).unwrap();
        let error = replace(&path, |part| {
            let name = part.file_name().unwrap().to_string_lossy().into_owned();
            assert!(name.starts_with("image.") && name.ends_with(".part.exr"), "{name}");
            assert_eq!(fs::read_to_string(&path).unwrap(), "old");
            fs::write(part, "ne").unwrap();
            Err("the disk is full".into())
        });
        let expected = format!("{}: cannot be written: the disk is full", path.display());
        assert_eq!(error.unwrap_err().to_string(), expected);
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_panic_leaves_no_temporary_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("image.exr");
        let run = || replace(&path, |_| panic!("a defect"));
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_err());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}
