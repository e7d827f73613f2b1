//! The groups of pixels whose paths are reused for each other.
//!
//! The image is divided into cells of 8 × 8 or 4 × 4 pixels, counted from its top left corner. The pixels of a cell are
//! divided at random into groups of sixteen, which are the same for all samples, so that each member contributes all
//! of its low-discrepancy sequence. In cells of 8 × 8, neighbours are mostly in different groups: their noise is
//! independent, and the mean of a few neighbours is more exact than a pixel. A cell of 4 × 4 is one group, whose pixels
//! are more alike, but its noise is a block.

use crate::film::PixelRect;
use crate::integrator::{Group, NO_RAY};
use crate::math::LANES;
use crate::sampling::hash::combine;

/// The side of a cell in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellSide {
    /// Four pixels.
    Four = 4,
    /// Eight pixels.
    Eight = 8,
}

/// The pixels that are traced together for a region of the image, and their groups.
#[derive(Clone, Debug, Default)]
pub struct PixelGroups {
    /// The pixels outside the region that share a cell with pixels inside, as (x, y) in the full image.
    pub outside: Vec<(u32, u32)>,
    /// The groups of pixels. A pixel of the region has its index there, by rows; the first one outside comes after the
    /// last one inside.
    groups: Vec<Group>,
}

impl PixelGroups {
    /// Returns the groups of a region of an image with the given size.
    pub fn new(side: CellSide, seed: u64, [width, height]: [u32; 2], region: PixelRect) -> Self {
        let side = side as u32;
        let mut groups = PixelGroups::default();
        let PixelRect { x: left, y: top, .. } = region;
        let (right, bottom) = (left + region.width, top + region.height);
        for y in (top - top % side..bottom).step_by(side as usize) {
            for x in (left - left % side..right).step_by(side as usize) {
                let pixels = cell(side, seed, [width, height], (x, y));
                let first = groups.groups.len();
                let count = pixels.len().div_ceil(LANES);
                groups.groups.resize(first + count, [NO_RAY; LANES]);
                for (i, (x, y)) in pixels.into_iter().enumerate() {
                    let inside = (left..right).contains(&x) && (top..bottom).contains(&y);
                    let index = match inside {
                        true => (y - top) * region.width + (x - left),
                        false => {
                            groups.outside.push((x, y));
                            (region.area() + groups.outside.len() as u64 - 1) as u32
                        }
                    };
                    groups.groups[first + i % count][i / count] = index;
                }
            }
        }
        groups
    }

    /// Returns the pixels of one of the groups in the 8 × 8 pixels from `first` on, which are one or four cells. The
    /// group is chosen by a hash of `number` and its place.
    pub fn one_of(
        side: CellSide,
        seed: u64,
        [width, height]: [u32; 2],
        (x, y): (u32, u32),
        number: u64,
    ) -> Vec<(u32, u32)> {
        let hash = combine(combine(number as u32, (number >> 32) as u32), combine(x, y));
        let within = |first: u32, end: u32, half: u32| {
            let second = first + side as u32 * (half & 1);
            if side == CellSide::Four && second < end { second } else { first }
        };
        let first = (within(x, width, hash), within(y, height, hash >> 1));
        let pixels = cell(side as u32, seed, [width, height], first);
        let count = pixels.len().div_ceil(LANES);
        pixels.into_iter().skip((hash >> 2) as usize % count).step_by(count).collect()
    }

    /// Sets the groups of a wave in which every pixel has the given number of consecutive samples.
    pub fn of_wave(&self, samples: u32, wave: &mut Vec<Group>) {
        wave.clear();
        for group in &self.groups {
            let ray = |pixel: u32, sample| if pixel == NO_RAY { NO_RAY } else { pixel * samples + sample };
            wave.extend((0..samples).map(|sample| group.map(|pixel| ray(pixel, sample))));
        }
    }
}

/// Returns the pixels of the cell at (x, y) in random order.
fn cell(side: u32, seed: u64, [width, height]: [u32; 2], (x, y): (u32, u32)) -> Vec<(u32, u32)> {
    let (right, bottom) = ((x + side).min(width), (y + side).min(height));
    let mut pixels: Vec<_> = (y..bottom).flat_map(|y| (x..right).map(move |x| (x, y))).collect();
    let mut hash = combine(combine(combine(0x6772_6f75, seed as u32), (seed >> 32) as u32), combine(x, y));
    for i in (1..pixels.len()).rev() {
        hash = combine(hash, i as u32);
        pixels.swap(i, ((u64::from(hash) * (i as u64 + 1)) >> 32) as usize);
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn positions(side: CellSide, region: PixelRect) -> Vec<BTreeSet<(u32, u32)>> {
        let groups = PixelGroups::new(side, 5, [30, 20], region);
        let inside = (0..region.height).flat_map(|y| (0..region.width).map(move |x| (x, y)));
        let inside = inside.map(|(x, y)| (region.x + x, region.y + y));
        let all: Vec<_> = inside.chain(groups.outside.iter().copied()).collect();
        let members =
            |group: &Group| group.iter().filter(|&&i| i != NO_RAY).map(|&i| all[i as usize]).collect();
        groups.groups.iter().map(members).collect()
    }

    /// Groups of a crop are those of the whole image, and every pixel is in one group.
    #[test]
    fn groups_do_not_depend_on_the_crop() {
        for side in [CellSide::Four, CellSide::Eight] {
            let whole = positions(side, PixelRect { x: 0, y: 0, width: 30, height: 20 });
            assert_eq!(whole.iter().map(BTreeSet::len).sum::<usize>(), 600);
            assert_eq!(whole.iter().flatten().collect::<BTreeSet<_>>().len(), 600);
            assert!(whole.iter().all(|group| (8..=16).contains(&group.len())), "{whole:?}");
            for region in [(3, 5, 9, 6), (0, 0, 1, 1), (29, 19, 1, 1), (8, 8, 8, 8)] {
                let (x, y, width, height) = region;
                for group in positions(side, PixelRect { x, y, width, height }) {
                    assert!(whole.contains(&group), "{region:?}: {group:?}");
                }
            }
        }
    }

    #[test]
    fn rays_of_a_group_have_the_same_sample() {
        let groups =
            PixelGroups::new(CellSide::Eight, 5, [16, 8], PixelRect { x: 0, y: 0, width: 16, height: 8 });
        let mut wave = Vec::new();
        groups.of_wave(3, &mut wave);
        assert_eq!(wave.len(), 24);
        let rays: BTreeSet<u32> = wave.iter().flatten().copied().collect();
        assert_eq!(rays, (0..384).collect());
        assert!(wave.iter().all(|group| group.iter().all(|ray| ray % 3 == group[0] % 3)));
    }
}
