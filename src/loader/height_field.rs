//! Height fields of Mitsuba 0.6: images whose pixels are the heights of the points of a grid.

use crate::error::{Error, Result};
use crate::image::TextureImage;
use crate::math::{Vec2, Vec3};
use crate::memory::Budget;
use crate::shape::Mesh;
use std::path::Path;

/// The bytes of a vertex with its normal and texture coordinates, and of the two triangles of its cell.
const POINT_BYTES: u64 = (2 * size_of::<Vec3>() + size_of::<Vec2>() + 2 * size_of::<[u32; 3]>()) as u64;

/// Returns the surface over [−1, 1]² whose height along z is `scale` times the luminance of the pixels. The first
/// pixel is at (−1, −1). Each cell between four pixels is two triangles. `smooth` adds vertex normals.
///
/// # Errors
/// If the image has less than two rows or columns, a height is not finite, or the mesh does not fit into memory.
pub fn mesh(path: &Path, image: &TextureImage, scale: f32, smooth: bool, memory: &Budget) -> Result<Mesh> {
    let (width, height) = (image.width(), image.height());
    let wrong = |message: String| Error::scene(message).in_file(path);
    if width < 2 || height < 2 {
        return Err(wrong(format!("expected at least 2 x 2 heights, found {width} x {height}")));
    }
    let points = width as u64 * height as u64;
    if points > u64::from(u32::MAX) {
        return Err(wrong(format!("expected at most {} heights, found {points}", u32::MAX)));
    }
    let planned = memory
        .reserve(points * POINT_BYTES)
        .map_err(|refusal| wrong(refusal.sentence("its mesh", "use a smaller image")))?;
    let z = |x: usize, y: usize| scale * crate::color::Rgb::from(image.rgb(x, y)).luminance();
    let cell = Vec2::new(2.0 / (width - 1) as f32, 2.0 / (height - 1) as f32);
    let grid = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let mut mesh = Mesh::default();
    for (x, y) in grid() {
        let p = Vec2::new(x as f32, y as f32) * cell;
        mesh.positions.push((p - 1.0).extend(z(x, y)));
        mesh.uvs.push(0.5 * p);
    }
    if mesh.positions.iter().any(|p| !p.is_finite()) {
        return Err(wrong("expected finite heights".into()));
    }
    for (x, y) in grid().filter(|&(x, y)| x + 1 < width && y + 1 < height) {
        let [a, b] = [y, y + 1].map(|y| (y * width + x) as u32);
        mesh.indices.extend([[a, a + 1, b], [a + 1, b + 1, b]]);
    }
    if smooth {
        let at = |x: usize, y: usize| mesh.positions[y * width + x].z;
        // The mean of the unit normals of the cells around the point, each at its corner.
        let normal = |(x, y): (usize, usize)| {
            let mut sum = Vec3::ZERO;
            for (left, top) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (Some(x0), Some(y0)) = (x.checked_sub(left), y.checked_sub(top)) else { continue };
                if x0 + 1 < width && y0 + 1 < height {
                    let slope = Vec2::new(at(x0 + 1, y) - at(x0, y), at(x, y0 + 1) - at(x, y0)) / cell;
                    sum += (-slope).extend(1.0).normalize();
                }
            }
            sum.normalize()
        };
        mesh.normals = grid().map(normal).collect();
    }
    planned.keep(mesh.memory_bytes());
    Ok(mesh)
}
