//! Grids for generated scenes.

use std::path::Path;

/// Writes a grid, x fastest. Its box is 1 × 1 × 2; scenes that do not ask for the box put the grid into the unit cube.
pub fn volume(
    path: &Path,
    size: [i32; 3],
    channels: i32,
    values: impl Iterator<Item = f32>,
) -> std::io::Result<()> {
    let header = [1, size[0], size[1], size[2], channels].map(i32::to_le_bytes);
    let floats = [0.0, 0.0, 0.0, 1.0, 1.0, 2.0].into_iter().chain(values).map(f32::to_le_bytes);
    let words: Vec<[u8; 4]> = header.into_iter().chain(floats).collect();
    std::fs::write(path, [b"VOL\x03", words.as_flattened()].concat())
}
