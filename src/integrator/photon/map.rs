//! Photons on surfaces, and how many light paths brought them.

use super::Photon;

/// The photons that so many light paths have left on surfaces.
pub struct PhotonMap {
    photons: Vec<Photon>,
    emitted: u64,
    dropped: u64,
}

impl PhotonMap {
    /// The map of the photons that `emitted` light paths have left. Photons that [`Photon::new`] could not have made
    /// are dropped and counted.
    ///
    /// The map does not depend on the number of threads, but on the order of the photons where they tie.
    pub fn new(mut photons: Vec<Photon>, emitted: u64) -> Self {
        let all = photons.len();
        photons.retain(Photon::is_valid);
        let dropped = (all - photons.len()) as u64;
        PhotonMap { photons, emitted, dropped }
    }

    /// The photons, in the map's order.
    pub fn photons(&self) -> impl ExactSizeIterator<Item = Photon> + '_ {
        self.photons.iter().copied()
    }

    /// How many photons there are.
    pub fn len(&self) -> usize {
        self.photons.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.photons.is_empty()
    }

    /// How many light paths were begun to get them: a photon's share of the light is its power over this.
    pub fn emitted(&self) -> u64 {
        self.emitted
    }

    /// How many photons were dropped because they were none.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}
