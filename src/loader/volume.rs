//! Files of volumes: grids in Mitsuba's `.vol` format.

use crate::error::{Error, Result};
use crate::math::{DAffine3, DVec3};
use crate::medium::Grid;
use crate::memory::Budget;
use crate::shape::{SdfGrid, SdfNormals};
use crate::texture::{FilterType, WrapMode};
use std::path::Path;

/// The bytes before the values: the identifier and version, the encoding, the sizes, and the box.
const HEADER: usize = 4 + 4 + 16 + 24;

/// The content of a file.
struct File {
    /// The number of cells along each axis.
    size: [usize; 3],
    /// The number of values of each cell.
    channels: usize,
    /// The values; x is the fastest axis and z the slowest.
    values: Vec<f32>,
    /// The corners of the box.
    corners: [DVec3; 2],
}

/// Reads a grid, and the transformation from the unit cube to the box that the file names.
///
/// # Errors
/// If the file cannot be read, is malformed, or needs more memory than is left.
pub fn load(path: &Path, filter: FilterType, wrap: WrapMode, memory: &Budget) -> Result<(Grid, DAffine3)> {
    let File { size, channels, values, corners: [min, max] } = read(path, memory)?;
    let grid = Grid::new(size, channels, values, filter, wrap).map_err(|e| e.in_file(path))?;
    Ok((grid, DAffine3::from_translation(min) * DAffine3::from_scale(max - min)))
}

/// Reads signed distances. The box of the file is ignored, as in Mitsuba.
///
/// # Errors
/// As for [`load`], and if the file has several values for each point, or there is no surface.
pub fn load_distances(path: &Path, normals: SdfNormals, memory: &Budget) -> Result<SdfGrid> {
    let File { size, channels, values, .. } = read(path, memory)?;
    if channels != 1 {
        let message = format!("expected one distance for each point, found {channels} values");
        return Err(Error::scene(message).in_file(path));
    }
    SdfGrid::new(size, values, normals).map_err(|e| e.in_file(path))
}

fn read(path: &Path, memory: &Budget) -> Result<File> {
    let (bytes, _reserved) = super::read_bytes(path, memory)?;
    let wrong = |message: String| Error::scene(message).in_file(path);
    if !bytes.starts_with(b"VOL\x03") {
        return Err(wrong("expected a file that begins with VOL and the version 3".into()));
    }
    let (header, body) = bytes
        .split_at_checked(HEADER)
        .ok_or_else(|| wrong(format!("expected a header of {HEADER} bytes, found {} bytes", bytes.len())))?;
    let (words, _) = header[4..].as_chunks::<4>();
    let integer = |i: usize| i32::from_le_bytes(words[i]);
    if integer(0) != 1 {
        return Err(wrong(format!("expected the encoding 1, which is float32, found {}", integer(0))));
    }
    let sizes = [1, 2, 3, 4].map(|i| usize::try_from(integer(i)).unwrap_or(0));
    let [x, y, z, channels] = sizes;
    let count = sizes.iter().try_fold(1usize, |product, n| product.checked_mul(*n));
    let expected = count.and_then(|count| count.checked_mul(4)).filter(|bytes| *bytes > 0);
    if expected != Some(body.len()) {
        return Err(wrong(format!(
            "expected {} x {} x {} cells of {} float32 values after the header, found {} bytes",
            integer(1),
            integer(2),
            integer(3),
            integer(4),
            body.len()
        )));
    }
    let planned = memory
        .reserve(body.len() as u64)
        .map_err(|refusal| wrong(refusal.sentence("its values", "use a smaller grid")))?;
    let (values, _) = body.as_chunks::<4>();
    let values: Vec<f32> = values.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    planned.keep(body.len() as u64);
    let corners = [5, 8].map(|i| {
        let [x, y, z] = [0, 1, 2].map(|axis| f64::from(f32::from_le_bytes(words[i + axis])));
        DVec3::new(x, y, z)
    });
    Ok(File { size: [x, y, z], channels, values, corners })
}
