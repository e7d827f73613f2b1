//! Mitsuba's `.serialized` files: binary meshes, each compressed by zlib, and a table of their offsets at the end.

use crate::error::{Error, Result, counted};
use crate::math::{Vec2, Vec3};
use crate::memory::Reservation;
use crate::shape::Mesh;
use crate::texture::Attribute;
use flate2::read::ZlibDecoder;
use std::io::Read;
use std::path::Path;

const MAGIC: [u8; 2] = 0x041cu16.to_le_bytes();
/// The bytes before the compressed data of a mesh.
const HEADER: usize = 4;
const NORMALS: u32 = 0x1;
const UVS: u32 = 0x2;
const COLORS: u32 = 0x8;
const FACE_NORMALS: u32 = 0x10;
const DOUBLE: u32 = 0x2000;
/// The greatest number of bytes that one compressed byte expands to.
const MOST_EXPANSION: u64 = 1032;
/// The bytes that are decompressed at once: a multiple of the size of every vector and of a triangle.
const BLOCK: usize = 48 * 1024;
/// The greatest length of a mesh's name, in bytes.
const LONGEST_NAME: usize = 1 << 16;

/// A mesh, and whether the file marks it as faceted.
#[derive(Debug)]
pub struct Serialized {
    pub mesh: Mesh,
    pub face_normals: bool,
}

/// Reads the mesh with the index `shape_index`.
///
/// # Errors
/// As for [`load`](super::load), and if there is no such mesh.
pub fn parse(path: &Path, bytes: &[u8], shape_index: usize, planned: &mut Reservation) -> Result<Serialized> {
    read(bytes, shape_index, planned).map_err(|message| Error::scene(message).in_file(path))
}

fn read(bytes: &[u8], shape_index: usize, planned: &mut Reservation) -> Result<Serialized, String> {
    let version = version(bytes)?;
    let start = match shape_index {
        0 => 0,
        i => start(bytes, version, i)?,
    };
    let from = bytes.get(start..).unwrap_or_default();
    self::version(from)?;
    let mut data = Data { from: ZlibDecoder::new(&from[HEADER..]) };
    let flags = data.u32()?;
    if version == 4 {
        data.name()?;
    }
    let (vertices, triangles) = (data.u64()?, data.u64()?);
    let count = u32::try_from(vertices).map_err(|_| format!("the mesh has too many vertices: {vertices}"))?;
    let has = |flag: u32| flags & flag != 0;
    let numbers = 3 + 3 * u64::from(has(NORMALS)) + 2 * u64::from(has(UVS)) + 3 * u64::from(has(COLORS));
    let vertex_size = numbers * if has(DOUBLE) { 8 } else { 4 };
    let size = triangles.checked_mul(12).and_then(|size| size.checked_add(vertices * vertex_size));
    if size.is_none_or(|size| size / MOST_EXPANSION > from.len() as u64) {
        let vertices = counted(vertices, "vertex", "vertices");
        return Err(malformed(&format!(
            "it is too short for {vertices} and {}",
            counted(triangles, "triangle", "triangles")
        )));
    }
    let kept = triangles.saturating_mul(12).saturating_add(4 * numbers * vertices);
    planned.grow(kept).map_err(|refusal| refusal.sentence("its mesh", "use a mesh of fewer triangles"))?;
    let (n, double) = (count as usize, has(DOUBLE));
    let mut mesh = Mesh { positions: data.vectors::<3, Vec3>(n, double)?, ..Mesh::default() };
    if has(NORMALS) {
        mesh.normals = data.vectors::<3, Vec3>(n, double)?;
    }
    if has(UVS) {
        mesh.uvs = data.vectors::<2, Vec2>(n, double)?;
    }
    if has(COLORS) {
        let values = data.vectors::<3, [f32; 3]>(n, double)?.into_flattened();
        mesh.attributes.push(Attribute { name: "vertex_color".to_owned(), channels: 3, values });
    }
    mesh.indices = data.triangles(triangles as usize)?;
    let outside = |t: &[u32; 3]| t.iter().position(|i| *i >= count).map(|corner| t[corner]);
    if let Some((i, bad)) = mesh.indices.iter().enumerate().find_map(|(i, t)| Some((i, outside(t)?))) {
        return Err(format!("face {i}: there is no vertex {bad}; the mesh has {count}"));
    }
    Ok(Serialized { mesh, face_normals: has(FACE_NORMALS) })
}

fn malformed(message: &str) -> String {
    format!("malformed serialized file: {message}")
}

/// Returns the format version of the mesh that starts with `bytes`.
fn version(bytes: &[u8]) -> Result<u8, String> {
    match *bytes {
        [a, b, version @ (3 | 4), 0, ..] if [a, b] == MAGIC => Ok(version),
        [a, b, low, high, ..] if [a, b] == MAGIC => {
            let version = u16::from_le_bytes([low, high]);
            Err(malformed(&format!("expected version 3 or 4, found {version}")))
        }
        _ => Err(malformed("a mesh does not start with the bytes 1c 04")),
    }
}

/// Returns the offset of a mesh, from the table at the end of the file.
fn start(bytes: &[u8], version: u8, shape_index: usize) -> Result<usize, String> {
    let (before, count) = bytes.split_last_chunk().ok_or_else(|| malformed("it ends early"))?;
    let count = u32::from_le_bytes(*count) as usize;
    let entry = if version == 4 { 8 } else { 4 };
    let table = count.checked_mul(entry).and_then(|size| before.len().checked_sub(size));
    let table = &before[table.ok_or_else(|| malformed("its table of meshes is too short"))?..];
    if shape_index >= count {
        let meshes = counted(count as u64, "mesh", "meshes");
        return Err(format!(
            "there is no mesh with the index {shape_index}; the file has {meshes}, counted from 0"
        ));
    }
    let entry = &table[shape_index * entry..][..entry];
    let mut wide = [0; 8];
    wide[..entry.len()].copy_from_slice(entry);
    usize::try_from(u64::from_le_bytes(wide)).map_err(|_| malformed("a mesh starts after its end"))
}

/// The decompressed data of a mesh.
struct Data<'a> {
    from: ZlibDecoder<&'a [u8]>,
}

impl Data<'_> {
    fn fill(&mut self, bytes: &mut [u8]) -> Result<(), String> {
        self.from
            .read_exact(bytes)
            .map_err(|_| malformed("the compressed data of the mesh is damaged or ends early"))
    }

    fn u32(&mut self) -> Result<u32, String> {
        let mut bytes = [0; 4];
        self.fill(&mut bytes)?;
        Ok(u32::from_le_bytes(bytes))
    }

    fn u64(&mut self) -> Result<u64, String> {
        let mut bytes = [0; 8];
        self.fill(&mut bytes)?;
        Ok(u64::from_le_bytes(bytes))
    }

    /// Skips the name of the mesh.
    fn name(&mut self) -> Result<(), String> {
        let mut byte = [0];
        for _ in 0..LONGEST_NAME {
            self.fill(&mut byte)?;
            if byte == [0] {
                return Ok(());
            }
        }
        Err(malformed("the name of the mesh does not end"))
    }

    /// Decodes `n` items of `size` bytes. Memory grows with the data that exist, not with `n`.
    fn decode<T>(&mut self, n: usize, size: usize, one: impl Fn(&[u8]) -> T) -> Result<Vec<T>, String> {
        let mut things = Vec::new();
        let mut block = [0; BLOCK];
        let mut left = n;
        while left > 0 {
            let count = left.min(BLOCK / size);
            let block = &mut block[..count * size];
            self.fill(block)?;
            things.extend(block.chunks_exact(size).map(&one));
            left -= count;
        }
        things.shrink_to_fit();
        Ok(things)
    }

    fn vectors<const N: usize, T: From<[f32; N]>>(
        &mut self,
        n: usize,
        double: bool,
    ) -> Result<Vec<T>, String> {
        match double {
            true => self.decode(n, 8 * N, |bytes| {
                let (numbers, _) = bytes.as_chunks();
                T::from(std::array::from_fn(|i| f64::from_le_bytes(numbers[i]) as f32))
            }),
            false => self.decode(n, 4 * N, |bytes| {
                let (numbers, _) = bytes.as_chunks();
                T::from(std::array::from_fn(|i| f32::from_le_bytes(numbers[i])))
            }),
        }
    }

    fn triangles(&mut self, n: usize) -> Result<Vec<[u32; 3]>, String> {
        self.decode(n, 12, |bytes| {
            let (numbers, _) = bytes.as_chunks();
            std::array::from_fn(|i| u32::from_le_bytes(numbers[i]))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::ZlibEncoder;
    use std::io::Write;

    fn planned() -> Reservation {
        crate::memory::Budget::unlimited().nothing()
    }

    const CORNERS: [[f32; 3]; 3] = [[0.0, 0.0, 0.5], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]];

    fn compressed(version: u8, data: &[u8]) -> Vec<u8> {
        let mut encoder = ZlibEncoder::new(vec![0x1c, 0x04, version, 0], Compression::default());
        encoder.write_all(data).unwrap();
        encoder.finish().unwrap()
    }

    /// Returns the data of a triangle: flags, name, counts and arrays.
    fn data(version: u8, flags: u32, triangle: [u32; 3]) -> Vec<u8> {
        let mut data = flags.to_le_bytes().to_vec();
        if version == 4 {
            data.extend(b"a name\0");
        }
        data.extend([3u64.to_le_bytes(), 1u64.to_le_bytes()].concat());
        let mut push = |v: f32| match flags & DOUBLE {
            0 => data.extend(v.to_le_bytes()),
            _ => data.extend(f64::from(v).to_le_bytes()),
        };
        CORNERS.as_flattened().iter().for_each(|v| push(*v));
        for (flag, n) in [(NORMALS, 9), (UVS, 6), (COLORS, 9)] {
            if flags & flag != 0 {
                (0..n).for_each(|i| push(i as f32));
            }
        }
        data.extend(triangle.map(u32::to_le_bytes).concat());
        data
    }

    /// Returns a file of several meshes.
    fn file(version: u8, meshes: &[Vec<u8>]) -> Vec<u8> {
        let mut file = Vec::new();
        let mut table = Vec::new();
        for mesh in meshes {
            match version {
                4 => table.extend((file.len() as u64).to_le_bytes()),
                _ => table.extend((file.len() as u32).to_le_bytes()),
            }
            file.extend(compressed(version, mesh));
        }
        file.extend(table);
        file.extend((meshes.len() as u32).to_le_bytes());
        file
    }

    #[test]
    fn both_versions_and_precisions_are_read() {
        for version in [3, 4] {
            for precision in [0x1000, DOUBLE] {
                let all = data(version, NORMALS | UVS | COLORS | precision, [2, 0, 1]);
                let bytes = file(version, &[data(version, precision, [0, 1, 2]), all]);
                let first = read(&bytes, 0, &mut planned()).unwrap();
                assert_eq!(first.mesh.positions, CORNERS.map(Vec3::from));
                assert!(first.mesh.normals.is_empty() && first.mesh.uvs.is_empty() && !first.face_normals);
                let second = read(&bytes, 1, &mut planned()).unwrap().mesh;
                assert_eq!(second.positions, CORNERS.map(Vec3::from));
                assert_eq!(second.normals[2], Vec3::new(6.0, 7.0, 8.0));
                assert_eq!(second.uvs[1], Vec2::new(2.0, 3.0));
                assert_eq!(second.indices, [[2, 0, 1]]);
                let color = &second.attributes[0];
                assert_eq!((color.name.as_str(), color.channels, color.values[8]), ("vertex_color", 3, 8.0));
            }
        }
        assert!(read(&file(4, &[data(4, FACE_NORMALS, [0, 1, 2])]), 0, &mut planned()).unwrap().face_normals);
    }

    #[test]
    fn broken_files_are_refused() {
        let good = file(4, &[data(4, 0, [0, 1, 2]), data(4, 0, [0, 1, 3])]);
        let message = |bytes: &[u8], i| read(bytes, i, &mut planned()).unwrap_err();
        assert_eq!(message(&good, 1), "face 0: there is no vertex 3; the mesh has 3");
        assert_eq!(
            message(&good, 2),
            "there is no mesh with the index 2; the file has 2 meshes, counted from 0"
        );
        assert_eq!(message(b"", 0), "malformed serialized file: a mesh does not start with the bytes 1c 04");
        assert_eq!(
            message(&[0x1c, 4, 9, 0], 0),
            "malformed serialized file: expected version 3 or 4, found 9"
        );
        assert_eq!(
            message(&good[..40], 0),
            "malformed serialized file: the compressed data of the mesh is damaged or ends early"
        );
        assert_eq!(message(&good[..40], 1), "malformed serialized file: its table of meshes is too short");
        let mut huge = data(4, 0, [0, 1, 2]);
        huge[11..19].copy_from_slice(&0xffff_fff0u64.to_le_bytes());
        assert_eq!(
            message(&file(4, &[huge]), 0),
            "malformed serialized file: it is too short for 4294967280 vertices and 1 triangle"
        );
    }
}
