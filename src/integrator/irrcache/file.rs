//! The file format of irradiance caches.
//!
//! A [container](crate::util::container). Its header has the hashes of the scene, of the settings that records depend
//! on and of the views that the records serve, and how many records the fine and the coarse cache of each replicate
//! have. Its body is the records, fine ones first, 28 numbers (f32) each.

use super::hemisphere::Gradient;
use super::record::Record;
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::sampling::SHARED_REPLICATES;
use crate::util::container::{Body, Format};
use serde::{Deserialize, Serialize};
use std::path::Path;

const FORMAT: Format = Format { magic: *b"BUFFONIC", version: 4, name: "a file of irradiance records" };
/// Numbers of a record.
const NUMBERS: usize = 28;
const RECORD_BYTES: usize = 4 * NUMBERS;

#[derive(Serialize, Deserialize)]
struct Header {
    scene: u64,
    settings: u64,
    views: Vec<u64>,
    /// Numbers of records.
    fine: Vec<u64>,
    coarse: Vec<u64>,
}

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
pub fn save(path: &Path, kept: &CacheContents) -> Result<()> {
    let counts = |caches: &[Vec<Record>]| caches.iter().map(|records| records.len() as u64).collect();
    let header = Header {
        scene: kept.scene,
        settings: kept.settings,
        views: kept.views.clone(),
        fine: counts(&kept.fine),
        coarse: counts(&kept.coarse),
    };
    FORMAT.save(path, &header, |body| {
        let numbers = kept.caches().flatten().flat_map(numbers);
        numbers.into_iter().try_for_each(|number| body.write_all(&number.to_le_bytes()))
    })
}

/// Reads the caches from a file.
///
/// # Errors
/// If the file cannot be read, holds something else, or is damaged.
pub fn load(path: &Path) -> Result<CacheContents> {
    read(path).map_err(|why| refuse(path, &format!("{why}; remove it, or name another file")))
}

fn read(path: &Path) -> Result<CacheContents, String> {
    let (header, mut body) = FORMAT.open::<Header>(path)?;
    let Header { scene, settings, views, fine, coarse } = header;
    let replicates = fine.len();
    if replicates > SHARED_REPLICATES as usize || coarse.len() != replicates {
        return Err("is damaged: its header has an impossible number of replicates".into());
    }
    let count = fine.iter().chain(&coarse).try_fold(0u64, |sum, count| sum.checked_add(*count));
    body.expect_length(count.and_then(|count| count.checked_mul(RECORD_BYTES as u64)))?;
    let mut caches = |counts: Vec<u64>| counts.into_iter().map(|count| records(&mut body, count)).collect();
    let (fine, coarse): (Result<_, String>, Result<_, String>) = (caches(fine), caches(coarse));
    let kept = CacheContents { scene, settings, views, fine: fine?, coarse: coarse? };
    body.finish()?;
    Ok(kept)
}

fn records(body: &mut Body, count: u64) -> Result<Vec<Record>, String> {
    let mut records = Vec::with_capacity(count as usize);
    let mut bytes = [0; RECORD_BYTES];
    for _ in 0..count {
        body.read(&mut bytes)?;
        let words = bytes.as_chunks::<4>().0;
        let numbers = std::array::from_fn(|i| f32::from_le_bytes(words[i]));
        records.push(record(&numbers).ok_or("is damaged: it has numbers that are those of no record")?);
    }
    Ok(records)
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
    fn stale_and_damaged_files_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("cache");
        save(&path, &contents()).expect("written");
        let said = |scene, settings| load_for(&path, scene, settings).expect_err("refused").message;
        assert!(said(7, 2).contains("another scene"));
        assert!(said(1, 7).contains("other settings"));
        let mut header =
            Header { scene: 1, settings: 2, views: vec![], fine: vec![1 << 40], coarse: vec![0] };
        let message = |header: &Header, number: f32| {
            FORMAT
                .save(&path, header, |body| body.write_all(&number.to_le_bytes().repeat(NUMBERS)))
                .expect("written");
            said(1, 2).split_once("it ").expect("a sentence").1.to_string()
        };
        let end = "; remove it, or name another file";
        let many = "is damaged: it has 112 bytes after its header, expected 123145302310912";
        assert_eq!(message(&header, 1.0), format!("{many}{end}"));
        header.fine = vec![u64::MAX];
        header.coarse = vec![2];
        let endless = "is damaged: its header asks for more bytes than a file can have";
        assert_eq!(message(&header, 1.0), format!("{endless}{end}"));
        header.fine = vec![1; 2];
        let replicates = "is damaged: its header has an impossible number of replicates";
        assert_eq!(message(&header, 1.0), format!("{replicates}{end}"));
        (header.fine, header.coarse) = (vec![1], vec![0]);
        let numbers = "is damaged: it has numbers that are those of no record";
        assert_eq!(message(&header, f32::NAN), format!("{numbers}{end}"));
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 300,
            rng_seed: RngSeed::Fixed(5),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        /// Records with any finite numbers can be interpolated among.
        #[test]
        fn mutated_records_are_read_or_refused(
            edits in prop::collection::vec((0..9 * RECORD_BYTES - 4, any::<[u8; 4]>()), 1..4),
        ) {
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join("cache");
            let all = contents();
            let numbers = all.caches().flatten().flat_map(numbers);
            let mut bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
            for (at, new) in edits {
                bytes[at..at + 4].copy_from_slice(&new);
            }
            let (fine, coarse) = (vec![3, 0], vec![5, 1]);
            let header = Header { scene: 1, settings: 2, views: vec![], fine, coarse };
            FORMAT.save(&path, &header, |body| body.write_all(&bytes)).expect("written");
            match load(&path) {
                Ok(contents) => {
                    let bounds = Bounds { min: Vec3::ZERO, max: Vec3::splat(2.0) };
                    for records in contents.caches() {
                        let cache = Interpolation::new(records, bounds);
                        for p in records.iter().map(|record| record.p).chain([Vec3::ONE, Vec3::splat(-9.0)]) {
                            // Extrapolation of a distant record may give an invalid colour; a render drops and counts
                            // it.
                            let _ = cache.irradiance(p, Vec3::Z, Vec3::Z);
                        }
                    }
                }
                Err(error) => prop_assert!(error.message.contains("those of no record"), "{error}"),
            }
        }
    }
}
