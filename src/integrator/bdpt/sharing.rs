//! Light paths that neighbouring pixels share.

use crate::sampling::SampleKey;
use std::collections::HashMap;
use std::ops::Range;

/// The size of the blocks of pixels whose samples of the same index share light paths, one for each row of the block. A
/// camera path is connected to that of its row. Its first vertex with a finite lobe is connected to all of them.
const WIDTH: u32 = 8;
const ROWS: u32 = 4;

/// The light paths of the camera paths of a wave.
#[derive(Debug, Default)]
pub struct SharedLightPaths {
    /// Their keys. Those of a block are consecutive.
    pub keys: Vec<SampleKey>,
    /// The light path of each camera path.
    own: Vec<u32>,
    /// The number of light paths in a block.
    in_block: u32,
    /// The first light path of each block and sample.
    blocks: HashMap<(u32, u32, u64), u32>,
}

impl SharedLightPaths {
    /// Returns a light path with the same key for each camera path.
    pub fn unshared(keys: &[SampleKey]) -> Self {
        let own = (0..keys.len() as u32).collect();
        SharedLightPaths { keys: keys.to_vec(), own, in_block: 1, ..SharedLightPaths::default() }
    }

    /// Removes all paths.
    pub fn clear(&mut self) {
        self.keys.clear();
        self.own.clear();
        self.blocks.clear();
    }

    /// Adds camera paths: those of a range of samples of the pixel (x, y). `key` returns the key of a sample of a pixel.
    pub fn add(&mut self, (x, y): (u32, u32), samples: Range<u64>, key: impl Fn(u32, u32, u64) -> SampleKey) {
        self.in_block = ROWS;
        let (row, x, y) = (y % ROWS, x - x % WIDTH, y - y % ROWS);
        for sample in samples {
            let first = *self.blocks.entry((x, y, sample)).or_insert_with(|| {
                self.keys.extend((0..ROWS).map(|row| key(x, y + row, sample)));
                self.keys.len() as u32 - ROWS
            });
            self.own.push(first + row);
        }
    }

    /// Returns the number of camera paths.
    pub fn camera_paths(&self) -> usize {
        self.own.len()
    }

    /// Returns the number of light paths to which the first vertex with a finite lobe of a camera path is connected.
    pub fn connected(&self) -> u32 {
        self.in_block
    }

    /// Returns one of the light paths to which a camera path is connected, of which the first is its own.
    pub fn of(&self, camera_path: u32, i: u32) -> usize {
        let own = self.own[camera_path as usize];
        let row = own % self.in_block;
        (own - row + (row + i) % self.in_block) as usize
    }
}
