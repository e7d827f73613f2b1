//! Photons on surfaces, and how many light paths brought them.

use super::Photon;
use super::kdtree::{Built, KdTree};
use super::photon::{Arrival, PackedRgb};
use crate::color::Rgb;
use crate::math::Vec3;
use crate::math::lanes::{LANES, f32x16};
use crate::math::octahedral::{decode_octahedral, signed_squared_cosines};

/// The photons that so many light paths have left on surfaces: 24.5 bytes each, in the order of a kd-tree.
pub struct PhotonMap {
    tree: KdTree,
    /// By slot of the tree.
    powers: Vec<PackedRgb>,
    /// Where the light came from, by slot, in code words.
    wis: Vec<u16>,
    /// The normals, by leaf, in code words.
    normals: Vec<[u16; LANES]>,
    emitted: u64,
    dropped: u64,
}

impl PhotonMap {
    /// Bytes in memory for each photon: its coordinates and its share of the tree, and what it brings.
    pub const BYTES_PER_PHOTON: f64 = 24.5;

    /// The map of the photons that `emitted` light paths have left. Photons that [`Photon::new`] could not have made
    /// are dropped and counted.
    ///
    /// The map does not depend on the number of threads, but on the order of the photons where they tie.
    ///
    /// # Panics
    /// If there are more than [`KdTree::MOST`] photons.
    pub fn new(mut photons: Vec<Photon>, emitted: u64) -> Self {
        let all = photons.len();
        photons.retain(Photon::is_valid);
        let dropped = (all - photons.len()) as u64;
        let Built { tree, order } = KdTree::build(photons.len(), |i| photons[i].position());
        let arrivals = order.iter().map(|&i| photons[i as usize].arrival());
        let (powers, wis) = arrivals.clone().map(|arrival| (arrival.power, arrival.wi)).unzip();
        let mut normals = vec![[0; LANES]; order.len().div_ceil(LANES)];
        for (normal, arrival) in normals.as_flattened_mut().iter_mut().zip(arrivals) {
            *normal = arrival.normal;
        }
        PhotonMap { tree, powers, wis, normals, emitted, dropped }
    }

    /// The photons, in the map's order: neighbours in it are neighbours in space.
    pub fn photons(&self) -> impl ExactSizeIterator<Item = Photon> + '_ {
        (0..self.len()).map(|slot| self.photon(slot))
    }

    /// The photon in a slot of the tree.
    ///
    /// # Panics
    /// If there are not so many.
    #[inline]
    pub fn photon(&self, slot: usize) -> Photon {
        let (power, wi, normal) = (self.powers[slot], self.wis[slot], self.normals.as_flattened()[slot]);
        Photon::from_parts(self.tree.point(slot), Arrival { power, wi, normal })
    }

    /// The tree of the photons' positions.
    pub fn tree(&self) -> &KdTree {
        &self.tree
    }

    /// The power of the photon in a slot, W, if its light path is the only one.
    #[inline]
    pub(super) fn power_of(&self, slot: usize) -> Rgb {
        self.powers[slot].get()
    }

    /// Where the light of the photon in a slot came from.
    #[inline]
    pub(super) fn wi_of(&self, slot: usize) -> Vec3 {
        decode_octahedral(self.wis[slot])
    }

    /// The cosines of the normals in a leaf, which begins with that slot, to a unit vector, with their signs, squared.
    #[inline(always)]
    pub(super) fn signed_squared_cosines(&self, first: usize, n: Vec3) -> f32x16 {
        signed_squared_cosines(&self.normals[first / LANES], n)
    }

    /// How many photons there are.
    pub fn len(&self) -> usize {
        self.powers.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.powers.is_empty()
    }

    /// How many light paths were begun to get them: a photon's share of the light is its power over this.
    pub fn emitted(&self) -> u64 {
        self.emitted
    }

    /// How many photons were dropped because they were none.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// What all photons together bring, W.
    pub fn power(&self) -> Rgb {
        let sum = self.powers.iter().fold([0.0; 3], |sum: [f64; 3], power| {
            let power = power.get().to_array();
            std::array::from_fn(|c| sum[c] + f64::from(power[c]))
        });
        let paths = self.emitted.max(1) as f64;
        Rgb::from(sum.map(|channel| (channel / paths) as f32))
    }

    /// Bytes on the heap.
    pub fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes()
            + size_of_val(&self.powers[..])
            + size_of_val(&self.wis[..])
            + size_of_val(&self.normals[..])
    }
}
