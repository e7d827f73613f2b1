//! The binary files of the crate: caches, photon maps and checkpoints.
//!
//! All numbers are little-endian. A file begins with the eight bytes of its format, the version and the length of the
//! header in bytes (u32 each). The header is JSON; it says what follows. The body are the bytes that the format
//! defines, and at the end stands the CRC-32 (u32) of everything before it.

use super::replace_with;
use crate::error::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;

/// The longest header, bytes.
const LONGEST_HEADER: u32 = 1 << 20;
/// Bytes before the header.
const PREFIX: u64 = 16;
/// Bytes of the checksum.
const CHECKSUM: u64 = 4;

/// A kind of file.
#[derive(Clone, Copy, Debug)]
pub struct Format {
    /// The first bytes of a file.
    pub magic: [u8; 8],
    /// The version that is written, and the only one that is read.
    pub version: u32,
    /// What a file is, in messages: "a checkpoint".
    pub name: &'static str,
}

impl Format {
    /// Returns whether a file begins as one of this format does.
    pub fn is_of(&self, path: &Path) -> bool {
        let mut magic = [0; 8];
        path.is_file()
            && File::open(path).and_then(|mut file| file.read_exact(&mut magic)).is_ok()
            && magic == self.magic
    }

    /// Writes a file, whole or not at all: its header, and the body that `write` writes.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(
        &self,
        path: &Path,
        header: &impl Serialize,
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<()> {
        let header = serde_json::to_vec(header)
            .map_err(|e| Error::internal(format!("the header of {}: {e}", self.name)))?;
        replace_with(path, |file| {
            let mut file = Checked::new(file);
            file.write_all(&self.magic)?;
            file.write_all(&self.version.to_le_bytes())?;
            file.write_all(&(header.len() as u32).to_le_bytes())?;
            file.write_all(&header)?;
            write(&mut file)?;
            let Checked { file, checksum } = file;
            file.write_all(&checksum.finalize().to_le_bytes())
        })
    }

    /// Opens a file and reads its header. Nothing is allocated for bytes that the file does not have.
    ///
    /// # Errors
    /// Says what is wrong, to follow the name of the file: it cannot be read, is of another format or version, or is
    /// damaged.
    pub fn open<H: DeserializeOwned>(&self, path: &Path) -> Result<(H, Body), String> {
        let file = File::open(path).map_err(unreadable)?;
        let metadata = file.metadata().map_err(unreadable)?;
        if !metadata.is_file() {
            return Err("is not a file".into());
        }
        let mut file = Checked::new(BufReader::new(file));
        let mut prefix = [0; PREFIX as usize];
        let other = || format!("is not {}", self.name);
        file.read_exact(&mut prefix).map_err(|_| other())?;
        let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| prefix[at + i]));
        if prefix[..8] != self.magic {
            return Err(other());
        }
        if word(8) != self.version {
            return Err(format!("has version {}, expected {}", word(8), self.version));
        }
        let length = u64::from(word(12));
        let left = metadata.len().saturating_sub(PREFIX + CHECKSUM);
        if length > u64::from(LONGEST_HEADER) || length > left {
            return Err("is truncated: its header is incomplete".into());
        }
        let mut bytes = vec![0; length as usize];
        file.read_exact(&mut bytes).map_err(unreadable)?;
        let header = serde_json::from_slice(&bytes).map_err(|e| format!("is damaged: its header: {e}"))?;
        Ok((header, Body { file, length: left - length }))
    }
}

/// What follows the header of a file.
#[derive(Debug)]
pub struct Body {
    file: Checked<BufReader<File>>,
    length: u64,
}

impl Body {
    /// Checks that the body has as many bytes as the header says; `None` is more than a file can have.
    ///
    /// # Errors
    /// If it has not.
    pub fn expect_length(&self, bytes: Option<u64>) -> Result<(), String> {
        match bytes {
            Some(bytes) if bytes == self.length => Ok(()),
            Some(bytes) => {
                Err(format!("is damaged: it has {} bytes after its header, expected {bytes}", self.length))
            }
            None => Err("is damaged: its header asks for more bytes than a file can have".into()),
        }
    }

    /// Reads the next bytes.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn read(&mut self, bytes: &mut [u8]) -> Result<(), String> {
        self.file.read_exact(bytes).map_err(unreadable)
    }

    /// Checks the checksum, after the whole body was read.
    ///
    /// # Errors
    /// If it is not that of the bytes.
    pub fn finish(self) -> Result<(), String> {
        let Checked { mut file, checksum } = self.file;
        let mut sum = [0; CHECKSUM as usize];
        file.read_exact(&mut sum).map_err(unreadable)?;
        if checksum.finalize() == u32::from_le_bytes(sum) {
            Ok(())
        } else {
            Err("is damaged: its checksum is wrong".into())
        }
    }
}

fn unreadable(error: io::Error) -> String {
    format!("cannot be read: {error}")
}

/// A file whose checksum is computed while it is read or written.
#[derive(Debug)]
struct Checked<F> {
    file: F,
    checksum: crc32fast::Hasher,
}

impl<F> Checked<F> {
    fn new(file: F) -> Self {
        Checked { file, checksum: crc32fast::Hasher::new() }
    }
}

impl<F: Write> Write for Checked<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.checksum.update(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl<F: Read> Read for Checked<F> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(bytes)?;
        self.checksum.update(&bytes[..read]);
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use std::fs;

    const FORMAT: Format = Format { magic: *b"BUFFTEST", version: 7, name: "a test file" };

    fn read(path: &Path) -> Result<(Vec<u64>, [u8; 5]), String> {
        let (header, mut body) = FORMAT.open(path)?;
        body.expect_length(Some(5))?;
        let mut bytes = [0; 5];
        body.read(&mut bytes)?;
        body.finish()?;
        Ok((header, bytes))
    }

    fn saved() -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        FORMAT.save(&path, &vec![1u64, u64::MAX], |body| body.write_all(b"12345")).unwrap();
        (folder, path)
    }

    #[test]
    fn a_file_is_read_as_it_was_written() {
        let (folder, path) = saved();
        assert_eq!(read(&path), Ok((vec![1, u64::MAX], *b"12345")));
        assert!(FORMAT.is_of(&path) && !FORMAT.is_of(folder.path()) && !FORMAT.is_of(Path::new("none")));
        let file = fs::read(&path).unwrap();
        let (before, sum) = file.split_last_chunk::<4>().unwrap();
        let expected = b"BUFFTEST\x07\0\0\0\x18\0\0\0[1,18446744073709551615]12345";
        assert_eq!(before, expected);
        // A stored value: files of older builds stay readable.
        assert_eq!(u32::from_le_bytes(*sum), crc32fast::hash(expected));
    }

    #[test]
    fn damaged_and_foreign_files_are_refused() {
        let (folder, path) = saved();
        let good = fs::read(&path).unwrap();
        let refused = |bytes: &[u8]| {
            let path = folder.path().join("bad");
            fs::write(&path, bytes).unwrap();
            read(&path).unwrap_err()
        };
        let with = |at: usize, new: &[u8]| {
            let mut bytes = good.clone();
            bytes[at..at + new.len()].copy_from_slice(new);
            refused(&bytes)
        };
        assert_eq!(refused(b""), "is not a test file");
        assert_eq!(with(0, b"PNG"), "is not a test file");
        assert_eq!(with(8, &[9]), "has version 9, expected 7");
        assert_eq!(with(12, &[255; 4]), "is truncated: its header is incomplete");
        assert_eq!(refused(&good[..30]), "is truncated: its header is incomplete");
        assert!(with(17, b"!").starts_with("is damaged: its header: "));
        let short = "is damaged: it has 4 bytes after its header, expected 5";
        assert_eq!(refused(&good[..good.len() - 1]), short);
        let damaged = "is damaged: its checksum is wrong";
        assert_eq!(with(good.len() - 6, b"!"), damaged);
        assert_eq!(with(good.len() - 1, &[good[good.len() - 1] ^ 1]), damaged);
        let (_, body) = FORMAT.open::<Vec<u64>>(&path).unwrap();
        let endless = "is damaged: its header asks for more bytes than a file can have";
        assert_eq!(body.expect_length(None).unwrap_err(), endless);
    }

    #[test]
    fn what_is_not_a_file_is_not_read() {
        let folder = tempfile::tempdir().unwrap();
        for path in [folder.path(), Path::new("/dev/zero")] {
            assert_eq!(read(path).unwrap_err(), "is not a file");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 300,
            rng_seed: RngSeed::Fixed(5),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        #[test]
        fn mutated_files_are_refused(at in any::<prop::sample::Index>(), bit in 0u32..8, end in any::<prop::sample::Index>()) {
            let (_folder, path) = saved();
            let mut bytes = fs::read(&path).unwrap();
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
            fs::write(&path, &bytes).unwrap();
            prop_assert!(read(&path).is_err());
            bytes[at] ^= 1 << bit;
            fs::write(&path, &bytes[..end.index(bytes.len())]).unwrap();
            prop_assert!(read(&path).is_err());
        }
    }
}
