//! Light paths that neighbouring pixels share.

use crate::sampling::SampleKey;
use crate::sampling::hash::pcg3d;
use std::collections::HashMap;
use std::ops::Range;

/// The side of the cells of pixels whose samples of the same index share light paths.
const SIDE: u32 = 16;
/// The number of groups into which the light paths of a cell are divided. The first vertex with a finite lobe of a
/// camera path is connected to a light path of each group, its later vertices to the first of these.
const GROUPS: u32 = 4;
/// The number of light paths in a group: one for each eight pixels in all.
const IN_GROUP: u32 = 8;
/// Selects the random numbers of the choice of light paths.
const STREAM: u32 = 0x6c70;
/// Stands for a light path that no camera path needs.
const NONE: u32 = u32::MAX;

/// The light paths of the camera paths of a wave.
#[derive(Debug, Default)]
pub struct SharedLightPaths {
    /// Their keys.
    pub keys: Vec<SampleKey>,
    /// The light paths to which each camera path is connected.
    of_camera: Vec<[u32; GROUPS as usize]>,
    /// The light paths of each cell and sample, by their number in the cell; none if nothing is shared.
    cells: HashMap<(u32, u32, u64), [u32; (GROUPS * IN_GROUP) as usize]>,
}

impl SharedLightPaths {
    /// Returns a light path with the same key for each camera path.
    pub fn unshared(keys: &[SampleKey]) -> Self {
        let of_camera = (0..keys.len() as u32).map(|own| [own; GROUPS as usize]).collect();
        SharedLightPaths { keys: keys.to_vec(), of_camera, ..SharedLightPaths::default() }
    }

    /// Removes all paths.
    pub fn clear(&mut self) {
        self.keys.clear();
        self.of_camera.clear();
        self.cells.clear();
    }

    /// Adds camera paths: those of a range of samples of the pixel (x, y). `key` returns the key of a pixel's sample.
    ///
    /// The pixel chooses its light paths at random from those of the cell, so that the noise that pixels share has no
    /// pattern. It chooses the same ones for all samples, so they are those of a few pixels, and are stratified.
    pub fn add(&mut self, (x, y): (u32, u32), samples: Range<u64>, key: impl Fn(u32, u32, u64) -> SampleKey) {
        let [random, first, _] = pcg3d(x, y, STREAM);
        let place = |k: u32| ((first >> 16) + k) % GROUPS * IN_GROUP + (random >> (8 * k)) % IN_GROUP;
        let (x, y) = (x - x % SIDE, y - y % SIDE);
        for sample in samples {
            let cell = self.cells.entry((x, y, sample)).or_insert([NONE; _]);
            self.of_camera.push(std::array::from_fn(|k| {
                let place = place(k as u32);
                let path = &mut cell[place as usize];
                if *path == NONE {
                    *path = self.keys.len() as u32;
                    self.keys.push(key(x + place % SIDE, y + place / SIDE, sample));
                }
                *path
            }));
        }
    }

    /// Adds `count` camera paths with the light paths of another one.
    pub fn repeat(&mut self, camera_path: usize, count: u32) {
        let of_path = self.of_camera[camera_path];
        self.of_camera.extend((0..count).map(|_| of_path));
    }

    /// Returns the number of camera paths.
    pub fn camera_paths(&self) -> usize {
        self.of_camera.len()
    }

    /// Returns the number of light paths to which the first vertex with a finite lobe of a camera path is connected.
    pub fn connected(&self) -> u32 {
        if self.cells.is_empty() { 1 } else { GROUPS }
    }

    /// Returns light path `k` of a camera path.
    pub fn of(&self, camera_path: u32, k: u32) -> usize {
        self.of_camera[camera_path as usize][k as usize] as usize
    }
}
