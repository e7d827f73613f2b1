//! The file format of photon maps.
//!
//! All numbers are little-endian. The file begins with `BUFFONPM`, the version (u32), the number of maps (u32), and
//! the hashes of the scene and of all other parameters on which the photons depend (u64 each). For each map follow
//! the kind of light (u32), the replicate (u32), the number of photons and the number of emitted light paths (u64
//! each). The photons of all maps follow, 24 bytes each, and the CRC-32 (as u64) of everything before it.

use super::{Photon, PhotonMap};
use crate::error::{Error, Result, counted};
use crate::sampling::SHARED_REPLICATES;
use crate::util::replace;
use crc32fast::Hasher;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

const MAGIC: [u8; 8] = *b"BUFFONPM";
const VERSION: u32 = 3;
const HEADER_BYTES: u64 = 32;
const ENTRY_BYTES: u64 = 24;
const CHECKSUM_BYTES: u64 = 8;
/// The greatest number of maps of a render.
const MOST_MAPS: u32 = 16;
/// The number of photons read at a time.
const CHUNK: usize = 4096;

/// The input from which the photons of a file were computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapOrigin {
    /// Hash of the scene without its sensors.
    pub scene: u64,
    /// Hash of all other parameters: settings, seed, sampler.
    pub settings: u64,
}

/// The kind of light in a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapKind {
    /// All light except that which arrives directly from emitters.
    Global,
    /// MapKind scattered by Dirac deltas only.
    Caustic,
}

impl MapKind {
    /// Returns the name of the kind.
    pub fn name(self) -> &'static str {
        match self {
            MapKind::Global => "global",
            MapKind::Caustic => "caustic",
        }
    }
}

/// The identification of a map in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapLabel {
    /// The kind of light.
    pub light: MapKind,
    /// The replicate of the samples that uses the map.
    pub replicate: u32,
}

/// The header of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapEntry {
    /// The identification of the map.
    pub label: MapLabel,
    /// The number of photons.
    pub photons: u64,
    /// The number of emitted light paths.
    pub emitted: u64,
}

/// The header of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhotonFileContents {
    /// The input from which the photons were computed.
    pub origin: MapOrigin,
    /// The maps.
    pub maps: Vec<MapEntry>,
}

/// Writes maps to a file. A failed write leaves no partial file.
///
/// # Errors
/// If the file cannot be written.
pub fn save(path: &Path, origin: MapOrigin, maps: &[(MapLabel, &PhotonMap)]) -> Result<()> {
    let photons: usize = maps.iter().map(|(_, map)| map.len()).sum();
    let mut bytes = Vec::with_capacity(photons * Photon::BYTES + 256);
    bytes.extend(MAGIC);
    bytes.extend(VERSION.to_le_bytes());
    bytes.extend((maps.len() as u32).to_le_bytes());
    bytes.extend(origin.scene.to_le_bytes());
    bytes.extend(origin.settings.to_le_bytes());
    for (label, map) in maps {
        bytes.extend((label.light as u32).to_le_bytes());
        bytes.extend(label.replicate.to_le_bytes());
        bytes.extend((map.len() as u64).to_le_bytes());
        bytes.extend(map.emitted().to_le_bytes());
    }
    for photon in maps.iter().flat_map(|(_, map)| map.photons()) {
        bytes.extend(photon.to_words().into_iter().flat_map(u32::to_le_bytes));
    }
    bytes.extend(u64::from(crc32fast::hash(&bytes)).to_le_bytes());
    replace(path, &bytes)
}

/// Reads the maps from a file, which must belong to `origin`.
///
/// # Errors
/// If the file cannot be read, is not a file of photon maps, is damaged, or belongs to another scene or other settings.
pub fn load(path: &Path, origin: MapOrigin) -> Result<Vec<(MapLabel, PhotonMap)>> {
    let mut reader = PhotonFileReader::open(path)?;
    if reader.contents.origin.scene != origin.scene {
        return Err(bad(path, "it holds photons of another scene; remove it, or name another file"));
    }
    if reader.contents.origin.settings != origin.settings {
        let what = "it holds photons of other settings (integrator, sampler or seed); remove it, or name another file";
        return Err(bad(path, what));
    }
    reader.photons()
}

/// Reads the header of a file and checks that the rest is complete.
///
/// # Errors
/// As for [`load`], except for the origin.
pub fn read_contents(path: &Path) -> Result<PhotonFileContents> {
    let mut reader = PhotonFileReader::open(path)?;
    reader.photons()?;
    Ok(reader.contents)
}

/// Returns whether a file begins with the identifier of photon maps.
pub fn is_photon_file(path: &Path) -> bool {
    let mut start = [0; MAGIC.len()];
    path.is_file()
        && File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok()
        && start == MAGIC
}

fn bad(path: &Path, what: impl Into<String>) -> Error {
    Error::output(what).about("photon map").in_file(path)
}

/// A file after its header was read and its length checked against the header.
struct PhotonFileReader<'a> {
    path: &'a Path,
    file: BufReader<File>,
    checksum: Hasher,
    contents: PhotonFileContents,
}

impl<'a> PhotonFileReader<'a> {
    fn open(path: &'a Path) -> Result<Self> {
        let cannot = |e: io::Error| bad(path, format!("cannot be read: {e}"));
        let file = File::open(path).map_err(cannot)?;
        let metadata = file.metadata().map_err(cannot)?;
        if !metadata.is_file() {
            return Err(bad(path, "is not a file"));
        }
        let contents = PhotonFileContents { origin: MapOrigin { scene: 0, settings: 0 }, maps: Vec::new() };
        let mut reader =
            PhotonFileReader { path, file: BufReader::new(file), checksum: Hasher::new(), contents };
        reader.header(metadata.len())?;
        Ok(reader)
    }

    /// Reads everything except the photons. Allocates no more than the file has bytes for.
    fn header(&mut self, length: u64) -> Result<()> {
        let magic: [u8; 8] = self.bytes()?;
        if magic != MAGIC {
            return Err(bad(self.path, "is not a file of photon maps"));
        }
        let [version, count] = [self.u32()?, self.u32()?];
        if version != VERSION {
            return Err(bad(self.path, format!("has version {version}, expected {VERSION}")));
        }
        if count > MOST_MAPS {
            return Err(bad(self.path, format!("has {count} maps, expected at most {MOST_MAPS}")));
        }
        self.contents.origin = MapOrigin { scene: self.u64()?, settings: self.u64()? };
        for _ in 0..count {
            let entry = self.entry()?;
            self.contents.maps.push(entry);
        }
        let photons = self.contents.maps.iter().try_fold(0u64, |sum, map| sum.checked_add(map.photons));
        let expected = photons.and_then(|n| n.checked_mul(Photon::BYTES as u64)).and_then(|bytes| {
            bytes.checked_add(HEADER_BYTES + ENTRY_BYTES * u64::from(count) + CHECKSUM_BYTES)
        });
        match expected {
            Some(expected) if expected == length => Ok(()),
            Some(expected) => {
                let is = counted(length, "byte", "bytes");
                Err(bad(self.path, format!("has {is}, expected {expected} for its photons")))
            }
            None => Err(bad(self.path, "says that it has more photons than a file can hold")),
        }
    }

    fn entry(&mut self) -> Result<MapEntry> {
        let (light, replicate) = (self.u32()?, self.u32()?);
        let light = match light {
            0 => MapKind::Global,
            1 => MapKind::Caustic,
            other => return Err(bad(self.path, format!("has a map of unknown light {other}"))),
        };
        if replicate >= SHARED_REPLICATES {
            let most = SHARED_REPLICATES - 1;
            return Err(bad(
                self.path,
                format!("has a map for replicate {replicate}, expected at most {most}"),
            ));
        }
        Ok(MapEntry { label: MapLabel { light, replicate }, photons: self.u64()?, emitted: self.u64()? })
    }

    fn photons(&mut self) -> Result<Vec<(MapLabel, PhotonMap)>> {
        let mut maps = Vec::new();
        for entry in self.contents.maps.clone() {
            let mut left = entry.photons as usize;
            let mut photons = Vec::with_capacity(left);
            let mut chunk = [0; CHUNK * Photon::BYTES];
            while left > 0 {
                let now = left.min(CHUNK);
                let bytes = &mut chunk[..now * Photon::BYTES];
                self.fill(bytes)?;
                photons.extend(bytes.as_chunks::<{ Photon::BYTES }>().0.iter().map(photon));
                left -= now;
            }
            maps.push((entry, photons));
        }
        let sum = self.checksum.clone().finalize();
        if self.u64()? != u64::from(sum) {
            return Err(bad(self.path, "is damaged: its checksum is not that of its bytes"));
        }
        maps.into_iter().map(|(entry, photons)| self.map(entry, photons)).collect()
    }

    fn map(&self, entry: MapEntry, photons: Vec<Photon>) -> Result<(MapLabel, PhotonMap)> {
        let map = PhotonMap::new(photons, entry.emitted);
        if map.dropped() > 0 || (entry.emitted == 0 && !map.is_empty()) {
            return Err(bad(self.path, "holds photons that no light path has left"));
        }
        Ok((entry.label, map))
    }

    fn fill(&mut self, bytes: &mut [u8]) -> Result<()> {
        self.file.read_exact(bytes).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => bad(self.path, "ends before its header does"),
            _ => bad(self.path, format!("cannot be read: {e}")),
        })?;
        self.checksum.update(bytes);
        Ok(())
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.fill(&mut bytes)?;
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_le_bytes(self.bytes()?))
    }

    fn u64(&mut self) -> Result<u64> {
        Ok(u64::from_le_bytes(self.bytes()?))
    }
}

fn photon(bytes: &[u8; Photon::BYTES]) -> Photon {
    let (words, _) = bytes.as_chunks::<4>();
    Photon::from_words(std::array::from_fn(|i| u32::from_le_bytes(words[i])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::integrator::photon::kdtree::NeighbourBuffer;
    use crate::integrator::photon::{DensityEstimator, Kernel, LookupPoint};
    use crate::math::Vec3;
    use crate::sampling::hash::{combine, to_unit};
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;
    use std::fs;

    const ORIGIN: MapOrigin = MapOrigin { scene: 0x1234_5678_9abc_def0, settings: 7 };

    fn map(n: u32, seed: u32) -> PhotonMap {
        let unit = |i: u32, c: u32| to_unit(combine(combine(seed, i), c));
        let photon = |i: u32| {
            let p = Vec3::new(unit(i, 0), unit(i, 1), (i % 5) as f32);
            let wi = Vec3::new(0.6, 0.0, 0.8);
            Photon::new(p, Rgb::new(unit(i, 2), unit(i, 3), 1.0), wi, Vec3::Z).unwrap()
        };
        PhotonMap::new((0..n).map(photon).collect(), u64::from(n) + 3)
    }

    fn label(light: MapKind, replicate: u32) -> MapLabel {
        MapLabel { light, replicate }
    }

    /// Creates a folder with a file of two maps.
    fn saved() -> (tempfile::TempDir, std::path::PathBuf, [PhotonMap; 2]) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("photons.bpm");
        let maps = [map(1000, 1), map(10, 2)];
        let labels = [label(MapKind::Global, 0), label(MapKind::Caustic, 1)];
        save(&path, ORIGIN, &[(labels[0], &maps[0]), (labels[1], &maps[1])]).unwrap();
        (folder, path, maps)
    }

    #[test]
    fn maps_come_back_as_they_were() {
        let (_folder, path, maps) = saved();
        assert!(is_photon_file(&path) && !is_photon_file(path.parent().unwrap()));
        let loaded = load(&path, ORIGIN).unwrap();
        assert_eq!([loaded[0].0, loaded[1].0], [label(MapKind::Global, 0), label(MapKind::Caustic, 1)]);
        for (map, (_, loaded)) in maps.iter().zip(&loaded) {
            assert!(map.photons().eq(loaded.photons()), "in the same order, too");
            assert_eq!((map.emitted(), map.tree()), (loaded.emitted(), loaded.tree()));
        }
        let contents = read_contents(&path).unwrap();
        assert_eq!((contents.origin, contents.maps[1].photons, contents.maps[1].emitted), (ORIGIN, 10, 13));
    }

    #[test]
    fn a_file_of_another_scene_or_other_settings_is_refused() {
        let (_folder, path, _) = saved();
        let refused = |origin| load(&path, origin).err().unwrap().to_string();
        assert_eq!(
            refused(MapOrigin { scene: 1, ..ORIGIN }),
            format!(
                "{}: photon map: it holds photons of another scene; remove it, or name another file",
                path.display()
            )
        );
        assert_eq!(
            refused(MapOrigin { settings: 8, ..ORIGIN }),
            format!(
                "{}: photon map: it holds photons of other settings (integrator, sampler or seed); remove it, or \
                 name another file",
                path.display()
            )
        );
    }

    #[test]
    fn hostile_files_are_refused_before_anything_is_allocated() {
        let (folder, path, _) = saved();
        let good = fs::read(&path).unwrap();
        let refused = |bytes: &[u8]| {
            let path = folder.path().join("bad.bpm");
            fs::write(&path, bytes).unwrap();
            let error = read_contents(&path).err().unwrap().to_string();
            error.split_once("photon map: ").unwrap().1.to_string()
        };
        let with = |at: usize, new: &[u8]| {
            let mut bytes = good.clone();
            bytes[at..at + new.len()].copy_from_slice(new);
            refused(&bytes)
        };
        assert_eq!(refused(b""), "ends before its header does");
        assert_eq!(refused(&good[..40]), "ends before its header does");
        assert_eq!(with(0, b"PNG"), "is not a file of photon maps");
        assert_eq!(with(8, &[1]), "has version 1, expected 3");
        assert_eq!(with(12, &[255; 4]), "has 4294967295 maps, expected at most 16");
        assert_eq!(with(32, &[9]), "has a map of unknown light 9");
        assert_eq!(with(36, &[8]), "has a map for replicate 8, expected at most 7");
        let most = u64::MAX.to_le_bytes();
        assert_eq!(with(40, &most), "says that it has more photons than a file can hold");
        let many = (1u64 << 40).to_le_bytes();
        assert_eq!(with(40, &many), "has 24328 bytes, expected 26388279066952 for its photons");
        assert_eq!(refused(&good[..good.len() - 1]), "has 24327 bytes, expected 24328 for its photons");
        let damaged = "is damaged: its checksum is not that of its bytes";
        for at in [16, 24, 48, 80, 100, good.len() - 100, good.len() - 1] {
            assert_eq!(with(at, &[good[at] ^ 1]), damaged);
        }
        // A position of NaN, with a correct checksum.
        let mut bytes = good[..good.len() - 8].to_vec();
        bytes[80..84].copy_from_slice(&f32::NAN.to_le_bytes());
        bytes.extend(u64::from(crc32fast::hash(&bytes)).to_le_bytes());
        assert_eq!(refused(&bytes), "holds photons that no light path has left");
        assert!(load(folder.path(), ORIGIN).is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 300,
            rng_seed: RngSeed::Fixed(5),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        /// Reading a mutated file either returns maps that can be queried or fails with an error. The checksum is
        /// corrected in some cases.
        #[test]
        fn mutated_files_are_read_or_refused(
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<[u8; 4]>(), 1usize..=4), 1..4),
            end in prop::option::weighted(0.2, any::<prop::sample::Index>()),
            in_header: bool,
            repaired: bool,
        ) {
            let (_folder, path, _) = saved();
            let mut bytes = fs::read(&path).unwrap();
            bytes.truncate(bytes.len() - 8);
            let reach = if in_header { 80 } else { bytes.len() - 4 };
            for (at, new, length) in edits {
                let at = at.index(reach);
                bytes[at..at + length].copy_from_slice(&new[..length]);
            }
            bytes.extend(if repaired { u64::from(crc32fast::hash(&bytes)) } else { 0 }.to_le_bytes());
            bytes.truncate(end.map_or(bytes.len(), |end| end.index(bytes.len())));
            fs::write(&path, &bytes).unwrap();
            match load(&path, ORIGIN) {
                Ok(maps) => {
                    let estimator = DensityEstimator { kernel: Kernel::Cone, lookup_size: 9, lookup_radius: 0.5 };
                    for (_, map) in maps {
                        let at = LookupPoint { p: Vec3::splat(0.5), n: Vec3::Z };
                        let found = estimator.irradiance(&map, at, &mut NeighbourBuffer::default());
                        prop_assert!(found.radius.is_finite());
                    }
                }
                Err(error) => prop_assert!(error.to_string().contains("photon map: "), "{error}"),
            }
        }
    }
}
