//! Assembles a mesh from the entries of a file and the triangles whose corners refer to them.

use super::weld::{Key, NONE, Weld};
use super::{MOST, Stop, Survey};
use crate::math::{Vec2, Vec3};
use crate::memory::Reservation;
use crate::shape::Mesh;
use rayon::prelude::*;

/// The part of a mesh that has been read.
#[derive(Debug, Default)]
pub struct Assembly {
    pub survey: Survey,
    pub positions: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub normals: Vec<Vec3>,
    /// The vertices, as indices of positions, texture coordinates and normals.
    pub weld: Weld,
    /// The triangles, as indices of vertices.
    pub indices: Vec<[u32; 3]>,
}

impl Assembly {
    /// Returns the bytes of all arrays.
    fn memory_bytes(&self) -> u64 {
        let vectors = size_of::<Vec3>() * (self.positions.capacity() + self.normals.capacity());
        let others =
            size_of::<Vec2>() * self.uvs.capacity() + size_of::<[u32; 3]>() * self.indices.capacity();
        (vectors + others + self.weld.memory_bytes()) as u64 + self.survey.memory_bytes()
    }

    /// Reserves the memory of all arrays.
    ///
    /// # Errors
    /// [`Stop::Memory`] if they do not fit into memory. [`Stop::Unusual`] if the vertices of a further piece might
    /// exceed the range of `u32`.
    pub fn plan(&self, planned: &mut Reservation) -> Result<(), Stop> {
        if self.weld.len() >= MOST {
            return Err(Stop::Unusual);
        }
        Ok(planned.grow_to(self.memory_bytes())?)
    }

    /// Returns the mesh, with the position, texture coordinate and normal of each vertex, and the survey.
    ///
    /// # Errors
    /// [`Stop::Unusual`] if a vertex refers to an entry that does not exist. [`Stop::Memory`] if the mesh does not fit
    /// into memory.
    pub fn finish(mut self, planned: &mut Reservation) -> Result<(Mesh, Survey), Stop> {
        let used = self.survey.used();
        let lengths = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let is_there = |key: &Key| {
            (key[0] as usize) < lengths[0]
                && (1..3).all(|i| key[i] == NONE || lengths[i] == 0 || (key[i] as usize) < lengths[i])
        };
        if !self.weld.keys().par_iter().all(is_there) {
            return Err(Stop::Unusual);
        }
        let vertex =
            [true, used[0], used[1]].into_iter().zip([12, 8, 12]).filter_map(|(is, size)| is.then_some(size));
        let vertices = self.weld.len() as u64;
        planned.grow_to(self.memory_bytes() + vertices * vertex.sum::<u64>())?;
        let differs = |key: &Key| (0..2).any(|i| !used[i] && key[i + 1] != NONE);
        if self.weld.keys().par_iter().any(differs) {
            planned.grow(vertices * Weld::VERTEX_BYTES)?;
            self.drop_unused(used);
        }
        let keys = self.weld.into_keys();
        let positions = gather(&keys, 0, self.positions);
        let uvs = if used[0] { gather(&keys, 1, self.uvs) } else { Vec::new() };
        let normals = if used[1] { gather(&keys, 2, self.normals) } else { Vec::new() };
        Ok((Mesh { positions, normals, uvs, indices: self.indices, attributes: Vec::new() }, self.survey))
    }

    /// Merges the vertices that differ only in unused indices. The vertices stay in the order of their first use.
    fn drop_unused(&mut self, used: [bool; 2]) {
        let mut weld = Weld::default();
        weld.set_positions(self.positions.len());
        let kept =
            |key: &Key| [key[0], if used[0] { key[1] } else { NONE }, if used[1] { key[2] } else { NONE }];
        let merged: Vec<u32> = self.weld.keys().iter().map(|key| weld.vertex(kept(key))).collect();
        self.indices.par_iter_mut().for_each(|triangle| *triangle = triangle.map(|i| merged[i as usize]));
        self.weld = weld;
    }
}

/// Returns the entry of each vertex. `kind` is 0 for positions, 1 for texture coordinates and 2 for normals.
fn gather<T: Copy + Send + Sync>(keys: &[Key], kind: usize, entries: Vec<T>) -> Vec<T> {
    if keys.len() == entries.len() && keys.par_iter().enumerate().all(|(i, key)| key[kind] as usize == i) {
        return entries;
    }
    keys.par_iter().map(|key| entries[key[kind] as usize]).collect()
}
