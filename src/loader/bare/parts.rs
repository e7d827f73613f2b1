//! Splits a mesh into parts, one for each of its materials.

use crate::error::{Error, Result};
use crate::loader::mesh::Named;
use crate::memory::Budget;
use crate::shape::Mesh;
use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;

/// The triangles of one material.
#[derive(Debug)]
pub struct Part {
    /// The material, and the line of its first use; `None` for triangles before the first `usemtl`.
    pub material: Option<Named>,
    /// The triangles, in the order of the file, and their vertices.
    pub mesh: Mesh,
}

/// Splits a mesh by material. Each entry of `uses` is the index of a triangle and the material from that triangle on.
/// The parts are in the order of first use. They keep the vertex normals of the whole mesh, so smooth shading
/// continues across parts.
///
/// # Errors
/// If the parts do not fit into memory beside the whole mesh.
pub fn split(mesh: Mesh, uses: &[(usize, Named)], path: &Path, memory: &Budget) -> Result<Vec<Part>> {
    let mut parts: Vec<(Option<&Named>, Vec<Range<usize>>)> = Vec::new();
    let mut by_name = HashMap::new();
    let starts = std::iter::once((0, None)).chain(uses.iter().map(|(first, named)| (*first, Some(named))));
    let ends = uses.iter().map(|(first, _)| *first).chain([mesh.indices.len()]);
    for ((start, named), end) in starts.zip(ends).filter(|((start, _), end)| start < end) {
        let i = *by_name.entry(named.map(|named| &named.name)).or_insert_with(|| {
            parts.push((named, Vec::new()));
            parts.len() - 1
        });
        parts[i].1.push(start..end);
    }
    if let [(named, _)] = &parts[..] {
        return Ok(vec![Part { material: named.cloned(), mesh }]);
    }
    let whole = mesh.memory_bytes();
    let seam = size_of::<u32>() as u64 * mesh.positions.len() as u64;
    let reserved = memory.reserve(2 * whole + seam).map_err(|refusal| {
        let sentence = refusal.sentence("its mesh in parts", "use a mesh of fewer triangles");
        Error::scene(sentence).in_file(path)
    })?;
    let mut numbers = vec![u32::MAX; mesh.positions.len()];
    let made: Vec<Part> = parts
        .into_iter()
        .map(|(named, ranges)| Part { material: named.cloned(), mesh: part(&mesh, &ranges, &mut numbers) })
        .collect();
    reserved.keep(made.iter().map(|part| part.mesh.memory_bytes()).sum());
    memory.refund(whole);
    Ok(made)
}

/// Returns a mesh of the triangles in some ranges. `numbers` maps the vertices of the whole mesh to those of the part;
/// before and after the call, all of its entries are `u32::MAX`.
fn part(mesh: &Mesh, ranges: &[Range<usize>], numbers: &mut [u32]) -> Mesh {
    let triangles = || ranges.iter().flat_map(|range| &mesh.indices[range.clone()]);
    let mut vertices = Vec::new();
    let mut indices = Vec::with_capacity(ranges.iter().map(Range::len).sum());
    for triangle in triangles() {
        indices.push(triangle.map(|vertex| {
            let number = &mut numbers[vertex as usize];
            if *number == u32::MAX {
                *number = vertices.len() as u32;
                vertices.push(vertex);
            }
            *number
        }));
    }
    vertices.iter().for_each(|vertex| numbers[*vertex as usize] = u32::MAX);
    fn taken<T: Copy>(entries: &[T], vertices: &[u32]) -> Vec<T> {
        if entries.is_empty() {
            return Vec::new();
        }
        vertices.iter().map(|vertex| entries[*vertex as usize]).collect()
    }
    Mesh {
        positions: taken(&mesh.positions, &vertices),
        normals: taken(&mesh.normals, &vertices),
        uvs: taken(&mesh.uvs, &vertices),
        indices,
        attributes: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn parts_have_the_triangles_of_their_material_in_order() {
        let positions = (0..6).map(|i| Vec3::splat(i as f32)).collect();
        let indices = vec![[0, 1, 2], [2, 1, 3], [5, 4, 3], [3, 4, 0]];
        let mesh = Mesh { positions, indices, ..Mesh::default() };
        let named = |line, name: &str| Named { line, name: name.into() };
        let uses = [(1, named(7, "a")), (2, named(8, "b")), (2, named(9, "a")), (3, named(10, "b"))];
        let memory = Budget::unlimited();
        let parts = split(mesh.clone(), &uses, Path::new("m.obj"), &memory).unwrap();
        let first: Vec<_> = parts.iter().map(|part| part.material.clone()).collect();
        assert_eq!(first, [None, Some(named(7, "a")), Some(named(10, "b"))]);
        let indices: Vec<_> = parts.iter().map(|part| part.mesh.indices.clone()).collect();
        assert_eq!(indices, [vec![[0, 1, 2]], vec![[0, 1, 2], [3, 4, 2]], vec![[0, 1, 2]]]);
        assert_eq!(parts[1].mesh.positions, [2, 1, 3, 5, 4].map(|i| Vec3::splat(i as f32)));
        let whole = split(mesh.clone(), &uses[3..], Path::new("m.obj"), &memory).unwrap();
        assert_eq!(whole.len(), 2);
        let whole = split(mesh.clone(), &[(0, named(1, "a"))], Path::new("m.obj"), &memory).unwrap();
        assert_eq!((whole.len(), &whole[0].mesh), (1, &mesh));
    }
}
