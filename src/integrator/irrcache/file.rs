//! The file format of irradiance caches.
//!
//! All numbers are little-endian. The file begins with `BUFFONIC`, the version (u32), and the hashes of the scene and
//! of the settings on which records depend (u64 each). Then follow the number of views that the records serve (u32)
//! and the hash of each (u64), the number of replicates (u32), and the number of records in each of their caches (the
//! fine ones, then the coarse ones; u64 each). The records follow, 28 numbers (f32) each, and the CRC-32 (as u64) of
//! everything before it.

use super::hemisphere::Gradient;
use super::record::Record;
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::sampling::SHARED_REPLICATES;
use crate::util::replace;
use std::path::Path;

const MAGIC: &[u8; 8] = b"BUFFONIC";
const VERSION: u32 = 3;
/// The number of `f32` values in a record.
const NUMBERS: usize = 28;

/// The content of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CacheContents {
    /// Hash of the scene without its sensors.
    pub scene: u64,
    /// Hash of the settings on which records depend.
    pub settings: u64,
    /// Hashes of the views for which the records were computed.
    pub views: Vec<u64>,
    /// The fine records of each replicate.
    pub fine: Vec<Vec<Record>>,
    /// The coarse records of each replicate.
    pub coarse: Vec<Vec<Record>>,
}

impl CacheContents {
    fn caches(&self) -> impl Iterator<Item = &Vec<Record>> {
        self.fine.iter().chain(&self.coarse)
    }
}

/// Writes caches to a file. A failed write leaves no partial file.
///
/// # Errors
/// If the file cannot be written.
pub fn save(path: &Path, contents: &CacheContents) -> Result<()> {
    let count: usize = contents.caches().map(Vec::len).sum();
    let mut bytes = Vec::with_capacity(count * NUMBERS * 4 + 128);
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend(contents.scene.to_le_bytes());
    bytes.extend(contents.settings.to_le_bytes());
    bytes.extend((contents.views.len() as u32).to_le_bytes());
    contents.views.iter().for_each(|view| bytes.extend(view.to_le_bytes()));
    bytes.extend((contents.fine.len() as u32).to_le_bytes());
    contents.caches().for_each(|records| bytes.extend((records.len() as u64).to_le_bytes()));
    for record in contents.caches().flatten() {
        numbers(record).iter().for_each(|number| bytes.extend(number.to_le_bytes()));
    }
    bytes.extend(checksum(&bytes).to_le_bytes());
    replace(path, &bytes)
}

/// Reads the caches from a file.
///
/// # Errors
/// If the file cannot be read, has another format, or is damaged.
pub fn load(path: &Path) -> Result<CacheContents> {
    let cannot = |e: std::io::Error| refuse(path, &format!("cannot be read: {e}"));
    if !std::fs::metadata(path).map_err(cannot)?.is_file() {
        return Err(refuse(path, "is not a file"));
    }
    let bytes = std::fs::read(path).map_err(cannot)?;
    let Some(rest) = bytes.strip_prefix(MAGIC) else {
        return Err(refuse(
            path,
            "is no file of irradiance records; another name, or its removal, would help",
        ));
    };
    let damaged = || refuse(path, "is damaged; remove it, and it will be made anew");
    let (body, sum) = bytes.split_last_chunk::<8>().ok_or_else(damaged)?;
    let mut reader = RecordReader(rest);
    let version = reader.u32().ok_or_else(damaged)?;
    if version != VERSION {
        return Err(refuse(
            path,
            &format!("has version {version}, expected {VERSION}; remove it, and it will be made anew"),
        ));
    }
    if checksum(body) != u64::from_le_bytes(*sum) {
        return Err(damaged());
    }
    reader.contents().ok_or_else(damaged)
}

fn refuse(path: &Path, what: &str) -> Error {
    Error::output(format!("--cache {}: it {what}", path.display()))
}

/// Reads the caches from a file that must belong to the given scene and settings.
///
/// # Errors
/// As for [`load`], and if the file belongs to another scene or other settings.
pub fn load_for(path: &Path, scene: u64, settings: u64) -> Result<CacheContents> {
    let contents = load(path)?;
    let stale =
        |what| Err(refuse(path, &format!("holds records of {what}; remove it, or name another file")));
    if contents.scene != scene {
        return stale("another scene");
    }
    if contents.settings != settings {
        return stale("other settings of the integrator");
    }
    Ok(contents)
}

fn checksum(bytes: &[u8]) -> u64 {
    u64::from(crc32fast::hash(bytes))
}

fn numbers(record: &Record) -> [f32; NUMBERS] {
    let gradient = |g: &Gradient| g.along.map(Rgb::to_array);
    let mut all = record.p.to_array().into_iter().chain(record.n.to_array());
    let mut light = record.irradiance.to_array().into_iter().chain([record.radius]);
    let mut changes =
        [gradient(&record.rotation), gradient(&record.translation)].into_iter().flatten().flatten();
    std::array::from_fn(|_| {
        all.next().or_else(|| light.next()).or_else(|| changes.next()).unwrap_or_default()
    })
}

/// Converts the numbers of a record; `None` if they are invalid.
fn record(n: &[f32; NUMBERS]) -> Option<Record> {
    let vector = |i: usize| Vec3::new(n[i], n[i + 1], n[i + 2]);
    let colour = |i: usize| Rgb::new(n[i], n[i + 1], n[i + 2]);
    let gradient = |i: usize| Gradient { along: [colour(i), colour(i + 3), colour(i + 6)] };
    let sound = n.iter().all(|number| number.is_finite()) && n[9] > 0.0;
    sound.then(|| Record {
        p: vector(0),
        n: vector(3),
        irradiance: colour(6),
        radius: n[9],
        rotation: gradient(10),
        translation: gradient(19),
    })
}

struct RecordReader<'a>(&'a [u8]);

impl RecordReader<'_> {
    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*first)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Reads everything after the version. Allocates no more than the file has bytes for.
    fn contents(&mut self) -> Option<CacheContents> {
        let mut contents =
            CacheContents { scene: self.u64()?, settings: self.u64()?, ..CacheContents::default() };
        for _ in 0..self.u32()? {
            contents.views.push(self.u64()?);
        }
        let replicates = self.u32().filter(|n| *n <= SHARED_REPLICATES)?;
        let counts = (0..2 * replicates).map(|_| self.u64()).collect::<Option<Vec<u64>>>()?;
        let (fine, coarse) = counts.split_at(replicates as usize);
        contents.fine = fine.iter().map(|&count| self.records(count)).collect::<Option<_>>()?;
        contents.coarse = coarse.iter().map(|&count| self.records(count)).collect::<Option<_>>()?;
        (self.0.len() == 8).then_some(contents)
    }

    fn records(&mut self, count: u64) -> Option<Vec<Record>> {
        let mut records = Vec::new();
        for _ in 0..count {
            let bytes = self.array::<{ NUMBERS * 4 }>()?;
            let words = bytes.as_chunks::<4>().0;
            records.push(record(&std::array::from_fn(|i| f32::from_le_bytes(words[i])))?);
        }
        Some(records)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::irrcache::interpolation::Interpolation;
    use crate::math::Bounds;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    fn contents() -> CacheContents {
        let record = |i: u32| {
            let along = |k: u32| [0, 1, 2].map(|c| Rgb::splat((i + k + c) as f32));
            Record {
                p: Vec3::new(i as f32, 1.0, 2.0),
                n: Vec3::Z,
                irradiance: Rgb::new(0.1, 0.2, 0.3),
                radius: 0.5 + i as f32,
                rotation: Gradient { along: along(7) },
                translation: Gradient { along: along(70) },
            }
        };
        let caches = |counts: [u32; 2]| counts.map(|n| (0..n).map(record).collect()).to_vec();
        CacheContents {
            scene: 1,
            settings: 2,
            views: vec![10, 11],
            fine: caches([3, 0]),
            coarse: caches([5, 1]),
        }
    }

    #[test]
    fn what_is_kept_is_what_comes_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("cache");
        save(&path, &contents()).expect("written");
        assert_eq!(load_for(&path, 1, 2), Ok(contents()));
    }

    #[test]
    fn stale_foreign_and_damaged_files_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("cache");
        save(&path, &contents()).expect("written");
        let said = |scene, settings| load_for(&path, scene, settings).expect_err("refused").message;
        assert!(said(7, 2).contains("another scene"));
        assert!(said(1, 7).contains("other settings"));
        let whole = std::fs::read(&path).expect("bytes");
        for (i, what) in
            [(0, "is no file of irradiance"), (8, "has version"), (20, "is damaged"), (200, "is damaged")]
        {
            let mut bytes = whole.clone();
            bytes[i] ^= 0x40;
            std::fs::write(&path, &bytes).expect("written");
            let message = said(1, 2);
            assert!(message.contains(what), "{message}");
        }
        for length in [0, 7, 8, 11, 40, whole.len() - 1] {
            std::fs::write(&path, &whole[..length]).expect("written");
            load(&path).expect_err("refused");
        }
        // A count that exceeds the file's length, with a correct checksum.
        let mut bytes = whole[..whole.len() - 8].to_vec();
        bytes[52 + 7] = 0xff;
        let sum = checksum(&bytes);
        bytes.extend(sum.to_le_bytes());
        std::fs::write(&path, &bytes).expect("written");
        load(&path).expect_err("refused");
    }

    #[test]
    fn what_is_not_a_file_is_not_read() {
        let folder = tempfile::tempdir().expect("a folder");
        for path in [folder.path(), Path::new("/dev/zero")] {
            assert!(load(path).expect_err("refused").message.ends_with("it is not a file"));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 300,
            rng_seed: RngSeed::Fixed(5),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        /// Reading a mutated file either returns records that can be interpolated or fails with an error. The
        /// checksum is corrected in some cases.
        #[test]
        fn mutated_files_are_read_or_refused(
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<[u8; 4]>(), 1usize..=4), 1..4),
            end in prop::option::weighted(0.2, any::<prop::sample::Index>()),
            in_header: bool,
            repaired: bool,
        ) {
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join("cache");
            save(&path, &contents()).expect("written");
            let mut bytes = std::fs::read(&path).expect("bytes");
            bytes.truncate(bytes.len() - 8);
            let reach = if in_header { 80 } else { bytes.len() - 4 };
            for (at, new, length) in edits {
                let at = at.index(reach);
                bytes[at..at + length].copy_from_slice(&new[..length]);
            }
            let sum = if repaired { checksum(&bytes) } else { 0 };
            bytes.extend(sum.to_le_bytes());
            bytes.truncate(end.map_or(bytes.len(), |end| end.index(bytes.len())));
            std::fs::write(&path, &bytes).expect("written");
            match load(&path) {
                Ok(contents) => {
                    let bounds = Bounds { min: Vec3::ZERO, max: Vec3::splat(2.0) };
                    for records in contents.caches() {
                        let cache = Interpolation::new(records, bounds, 1.0);
                        for p in records.iter().map(|record| record.p).chain([Vec3::ONE, Vec3::splat(-9.0)]) {
                            // Extrapolation of a distant record may give an invalid colour; a render drops and counts
                            // it.
                            let _ = cache.irradiance(p, Vec3::Z, Vec3::Z);
                        }
                    }
                }
                Err(error) => prop_assert!(error.message.starts_with("--cache "), "{error}"),
            }
        }
    }
}
