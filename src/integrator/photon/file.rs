//! The file format of photon maps.
//!
//! A [container](crate::util::container). Its header is [`PhotonFileContents`]; its body is the photons of all maps,
//! 24 bytes each.

use super::{Photon, PhotonMap};
use crate::error::{Error, Result};
use crate::sampling::SHARED_REPLICATES;
use crate::util::container::{Body, Format};
use serde::{Deserialize, Serialize};
use std::path::Path;

const FORMAT: Format = Format { magic: *b"BUFFONPM", version: 4, name: "a file of photon maps" };
/// Photons that are read at once.
const CHUNK: usize = 4096;

/// What the photons of a file depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MapOrigin {
    /// Hash of the scene, without sensors.
    pub scene: u64,
    /// Hash of all other parameters: settings, seed, sampler.
    pub settings: u64,
}

/// Which light a map holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MapKind {
    /// All light but what comes from the emitters directly.
    Global,
    /// Light scattered by Dirac deltas only.
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

/// Which map of a file it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MapLabel {
    /// Which light it holds.
    pub light: MapKind,
    /// For which replicate of the samples.
    pub replicate: u32,
}

/// What a file says of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MapEntry {
    /// Which map it is.
    pub label: MapLabel,
    /// How many photons there are.
    pub photons: u64,
    /// The number of emitted light paths.
    pub emitted: u64,
}

/// What a file says of itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PhotonFileContents {
    /// What the photons depend on.
    pub origin: MapOrigin,
    /// The maps.
    pub maps: Vec<MapEntry>,
}

/// Writes maps to a file. A failed write leaves no partial file.
///
/// # Errors
/// If the file cannot be written.
pub fn save(path: &Path, origin: MapOrigin, maps: &[(MapLabel, &PhotonMap)]) -> Result<()> {
    let entry = |(label, map): &(MapLabel, &PhotonMap)| MapEntry {
        label: *label,
        photons: map.len() as u64,
        emitted: map.emitted(),
    };
    let contents = PhotonFileContents { origin, maps: maps.iter().map(entry).collect() };
    FORMAT.save(path, &contents, |body| {
        let mut photons = maps.iter().flat_map(|(_, map)| map.photons());
        photons.try_for_each(|photon| body.write_all(bytemuck::bytes_of(&photon.to_words().map(u32::to_le))))
    })
}

/// Reads the maps from a file, which must belong to `origin`.
///
/// # Errors
/// If the file cannot be read, is not a file of photon maps, is damaged, or belongs to another scene or other settings.
pub fn load(path: &Path, origin: MapOrigin) -> Result<Vec<(MapLabel, PhotonMap)>> {
    let (contents, body) = open(path)?;
    if contents.origin.scene != origin.scene {
        return Err(bad(path, "it holds photons of another scene; remove it, or name another file"));
    }
    if contents.origin.settings != origin.settings {
        let what = "it holds photons of other settings (integrator, sampler or seed); remove it, or name another file";
        return Err(bad(path, what));
    }
    read(&contents, body).map_err(|why| bad(path, why))
}

/// Reads what a file says of itself, and checks the rest of it.
///
/// # Errors
/// As those of [`load`], but for the origin.
pub fn read_contents(path: &Path) -> Result<PhotonFileContents> {
    let (contents, body) = open(path)?;
    read(&contents, body).map_err(|why| bad(path, why))?;
    Ok(contents)
}

/// Returns whether a file begins as one of photon maps does.
pub fn is_photon_file(path: &Path) -> bool {
    FORMAT.is_of(path)
}

/// Reads a header, and checks it before anything is allocated for the photons.
fn open(path: &Path) -> Result<(PhotonFileContents, Body)> {
    let (contents, body) = FORMAT.open::<PhotonFileContents>(path).map_err(|why| bad(path, why))?;
    if let Some(map) = contents.maps.iter().find(|map| map.label.replicate >= SHARED_REPLICATES) {
        let (replicate, most) = (map.label.replicate, SHARED_REPLICATES - 1);
        return Err(bad(path, format!("has a map for replicate {replicate}, expected at most {most}")));
    }
    let photons = contents.maps.iter().try_fold(0u64, |sum, map| sum.checked_add(map.photons));
    body.expect_length(photons.and_then(|n| n.checked_mul(Photon::BYTES as u64)))
        .map_err(|why| bad(path, why))?;
    Ok((contents, body))
}

fn read(contents: &PhotonFileContents, mut body: Body) -> Result<Vec<(MapLabel, PhotonMap)>, String> {
    let mut maps = Vec::new();
    let mut chunk = [0; CHUNK * Photon::BYTES];
    for entry in &contents.maps {
        let mut left = entry.photons as usize;
        let mut photons = Vec::with_capacity(left);
        while left > 0 {
            let now = left.min(CHUNK);
            let bytes = &mut chunk[..now * Photon::BYTES];
            body.read(bytes)?;
            photons.extend(bytes.as_chunks::<{ Photon::BYTES }>().0.iter().map(photon));
            left -= now;
        }
        maps.push((entry, photons));
    }
    body.finish()?;
    maps.into_iter().map(|(entry, photons)| map(entry, photons)).collect()
}

fn map(entry: &MapEntry, photons: Vec<Photon>) -> Result<(MapLabel, PhotonMap), String> {
    let map = PhotonMap::new(photons, entry.emitted);
    if map.dropped() > 0 || (entry.emitted == 0 && !map.is_empty()) {
        return Err("is damaged: it has an invalid photon".into());
    }
    Ok((entry.label, map))
}

fn bad(path: &Path, what: impl Into<String>) -> Error {
    Error::output(what).about("photon map").in_file(path)
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
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("photons.bpm");
        let refused = |photons: &[u64], replicate: u32, emitted: u64, body: &[u8]| {
            let entry =
                |&photons: &u64| MapEntry { label: label(MapKind::Global, replicate), photons, emitted };
            let contents = PhotonFileContents { origin: ORIGIN, maps: photons.iter().map(entry).collect() };
            FORMAT.save(&path, &contents, |file| file.write_all(body)).unwrap();
            let error = read_contents(&path).err().unwrap().to_string();
            error.split_once("photon map: ").unwrap().1.to_string()
        };
        let photon = [0; Photon::BYTES];
        assert_eq!(refused(&[1], 8, 1, &photon), "has a map for replicate 8, expected at most 7");
        let endless = "is damaged: its header asks for more bytes than a file can have";
        assert_eq!(refused(&[u64::MAX], 0, 1, &photon), endless);
        assert_eq!(refused(&[u64::MAX, 1], 0, 1, &photon), endless);
        let short = "is damaged: it has 24 bytes after its header, expected 26388279066624";
        assert_eq!(refused(&[1 << 40], 0, 1, &photon), short);
        let unsent = "is damaged: it has an invalid photon";
        assert_eq!(refused(&[1], 0, 0, &photon), unsent);
        assert_eq!(refused(&[1], 0, 1, &f32::NAN.to_le_bytes().repeat(6)), unsent);
        assert!(load(folder.path(), ORIGIN).is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 300,
            rng_seed: RngSeed::Fixed(5),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        /// Maps of photons with any numbers can be searched, or are refused.
        #[test]
        fn mutated_photons_are_read_or_refused(
            edits in prop::collection::vec((0..10 * Photon::BYTES - 4, any::<[u8; 4]>()), 1..4),
        ) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("photons.bpm");
            let mut bytes: Vec<u8> =
                map(10, 2).photons().flat_map(|photon| photon.to_words().map(u32::to_le_bytes)).flatten().collect();
            for (at, new) in edits {
                bytes[at..at + 4].copy_from_slice(&new);
            }
            let entry = MapEntry { label: label(MapKind::Global, 0), photons: 10, emitted: 13 };
            let contents = PhotonFileContents { origin: ORIGIN, maps: vec![entry] };
            FORMAT.save(&path, &contents, |file| file.write_all(&bytes)).unwrap();
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
