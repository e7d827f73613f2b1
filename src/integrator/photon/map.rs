//! A photon map: photons on surfaces, and the number of light paths that deposited them.

use super::Photon;
use super::kdtree::{BuiltTree, KdTree};
use super::photon::{PackedRgb, PhotonPayload};
use crate::color::Rgb;
use crate::math::Vec3;
use crate::math::lanes::{LANES, f32x16};
use crate::math::octahedral::{decode_octahedral, signed_squared_cosines};

/// Photons in the order of a kd-tree, 24.5 bytes each.
pub struct PhotonMap {
    tree: KdTree,
    /// The powers, in the order of the tree's slots.
    powers: Vec<PackedRgb>,
    /// The encoded directions towards the incident light, in the order of the slots.
    wis: Vec<u16>,
    /// The encoded normals, for each leaf.
    normals: Vec<[u16; LANES]>,
    emitted: u64,
    dropped: u64,
}

impl PhotonMap {
    /// The bytes in memory for each photon, including its part of the tree.
    pub const BYTES_PER_PHOTON: f64 = 24.5;

    /// Builds the map of the photons from `emitted` light paths. Invalid photons, which [`Photon::new`] cannot
    /// create, are dropped and counted.
    ///
    /// The map does not depend on the number of threads. It depends on the order of photons with equal coordinates.
    ///
    /// # Panics
    /// If there are more than [`KdTree::MAX_POINTS`] photons.
    pub fn new(mut photons: Vec<Photon>, emitted: u64) -> Self {
        let all = photons.len();
        photons.retain(Photon::is_valid);
        let dropped = (all - photons.len()) as u64;
        let BuiltTree { tree, order } = KdTree::build(photons.len(), |i| photons[i].position());
        let arrivals = order.iter().map(|&i| photons[i as usize].payload());
        let (powers, wis) = arrivals.clone().map(|payload| (payload.power, payload.wi)).unzip();
        let mut normals = vec![[0; LANES]; order.len().div_ceil(LANES)];
        for (normal, payload) in normals.as_flattened_mut().iter_mut().zip(arrivals) {
            *normal = payload.normal;
        }
        PhotonMap { tree, powers, wis, normals, emitted, dropped }
    }

    /// Returns the photons in the map's order, in which neighbours are close in space.
    pub fn photons(&self) -> impl ExactSizeIterator<Item = Photon> + '_ {
        (0..self.len()).map(|slot| self.photon(slot))
    }

    /// Returns the photon in a slot of the tree.
    ///
    /// # Panics
    /// If the slot is out of range.
    #[inline]
    pub fn photon(&self, slot: usize) -> Photon {
        let (power, wi, normal) = (self.powers[slot], self.wis[slot], self.normals.as_flattened()[slot]);
        Photon::from_parts(self.tree.point(slot), PhotonPayload { power, wi, normal })
    }

    /// Returns the tree of the photons' positions.
    pub fn tree(&self) -> &KdTree {
        &self.tree
    }

    /// Returns the power of the photon in a slot, W, of a light path traced alone.
    #[inline]
    pub(super) fn power_of(&self, slot: usize) -> Rgb {
        self.powers[slot].get()
    }

    /// Returns the direction towards the incident light of the photon in a slot.
    #[inline]
    pub(super) fn wi_of(&self, slot: usize) -> Vec3 {
        decode_octahedral(self.wis[slot])
    }

    /// Returns the squared cosines, with their signs, between a unit vector and the normals of the leaf that begins
    /// with slot `first`.
    #[inline(always)]
    pub(super) fn signed_squared_cosines(&self, first: usize, n: Vec3) -> f32x16 {
        signed_squared_cosines(&self.normals[first / LANES], n)
    }

    /// Returns the number of photons.
    pub fn len(&self) -> usize {
        self.powers.len()
    }

    /// Returns whether there are no photons.
    pub fn is_empty(&self) -> bool {
        self.powers.is_empty()
    }

    /// Returns the number of emitted light paths. A photon's contribution is its power divided by this number.
    pub fn emitted(&self) -> u64 {
        self.emitted
    }

    /// Returns the number of invalid photons that were dropped.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Returns the sum of the powers of all photons, W.
    pub fn power(&self) -> Rgb {
        let sum = self.powers.iter().fold([0.0; 3], |sum: [f64; 3], power| {
            let power = power.get().to_array();
            std::array::from_fn(|c| sum[c] + f64::from(power[c]))
        });
        let paths = self.emitted.max(1) as f64;
        Rgb::from(sum.map(|channel| (channel / paths) as f32))
    }

    /// Returns the bytes on the heap.
    pub fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes()
            + size_of_val(&self.powers[..])
            + size_of_val(&self.wis[..])
            + size_of_val(&self.normals[..])
    }
}
