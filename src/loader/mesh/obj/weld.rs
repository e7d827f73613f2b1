//! Vertices from corners: corners with the same three indices share one vertex.

use std::collections::HashMap;

/// The value of an index that a vertex lacks, and the end of a chain.
pub const NONE: u32 = u32::MAX;
/// The greatest number of vertices of one position in a chain. Further ones are in a hash map.
const LONGEST_CHAIN: usize = 32;

/// The bytes of an entry of the hash map. The factor 2 allows for its empty slots.
const OTHER: usize = 2 * (size_of::<Key>() + size_of::<u32>() + 1);

/// The indices of a position, a texture coordinate and a normal.
pub type Key = [u32; 3];

/// The vertices, in the order of their first use.
#[derive(Debug, Default)]
pub struct Weld {
    keys: Vec<Key>,
    /// For each vertex, the previous vertex in its chain.
    older: Vec<u32>,
    /// For each position, the newest vertex in its chain.
    newest: Vec<u32>,
    /// The vertices that are in no chain, because the position comes later in the file or the chain is full.
    others: HashMap<Key, u32>,
}

impl Weld {
    /// The bytes of a vertex in the arrays.
    pub const VERTEX_BYTES: u64 = (size_of::<Key>() + 3 * size_of::<u32>()) as u64;

    /// Sets the number of positions.
    pub fn set_positions(&mut self, count: usize) {
        self.newest.resize(count, NONE);
    }

    /// Returns the number of the vertex with these indices, and adds it if it is new. The indices are not checked.
    #[inline]
    pub fn vertex(&mut self, key: Key) -> u32 {
        let mut at = self.newest.get(key[0] as usize).copied().unwrap_or(NONE);
        let mut steps = 0;
        while at != NONE && steps < LONGEST_CHAIN {
            if self.keys[at as usize] == key {
                return at;
            }
            at = self.older[at as usize];
            steps += 1;
        }
        self.add(key, steps)
    }

    /// Returns the number of a vertex that the search of its chain did not find, and adds it if it is new. `steps` is
    /// the number of vertices that the search compared.
    #[cold]
    fn add(&mut self, key: Key, steps: usize) -> u32 {
        if let Some(vertex) = self.others.get(&key) {
            return *vertex;
        }
        let vertex = self.keys.len() as u32;
        self.keys.push(key);
        match self.newest.get_mut(key[0] as usize) {
            Some(newest) if steps < LONGEST_CHAIN => {
                self.older.push(*newest);
                *newest = vertex;
            }
            _ => {
                self.older.push(NONE);
                self.others.insert(key, vertex);
            }
        }
        vertex
    }

    /// Returns the number of vertices.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Returns the bytes of the arrays and of the hash map.
    pub fn memory_bytes(&self) -> usize {
        let lists = size_of::<Key>() * self.keys.capacity();
        lists
            + size_of::<u32>() * (self.older.capacity() + self.newest.capacity())
            + OTHER * self.others.capacity()
    }

    /// Returns the indices of every vertex.
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// Returns the indices of every vertex, as [`keys`](Self::keys) does, without a copy.
    pub fn into_keys(self) -> Vec<Key> {
        self.keys
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_are_numbered_by_first_use() {
        let mut weld = Weld::default();
        weld.set_positions(2);
        let keys = [[1, 0, 0], [0, 0, 0], [1, 0, 1], [1, 0, 0], [7, 0, 0], [7, 0, 0], [0, 0, 0]];
        assert_eq!(keys.map(|key| weld.vertex(key)), [0, 1, 2, 0, 3, 3, 1]);
        weld.set_positions(8);
        assert_eq!([[7, 0, 0], [7, 1, 0], [7, 1, 0]].map(|key| weld.vertex(key)), [3, 4, 4]);
        assert_eq!(weld.into_keys(), [[1, 0, 0], [0, 0, 0], [1, 0, 1], [7, 0, 0], [7, 1, 0]]);
    }

    #[test]
    fn many_vertices_of_one_position_stay_apart() {
        let mut weld = Weld::default();
        weld.set_positions(1);
        for _ in 0..2 {
            for i in 0..1000 {
                assert_eq!(weld.vertex([0, i, 0]), i);
            }
        }
    }
}
