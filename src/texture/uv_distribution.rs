//! Sampling densities over the unit square of texture coordinates, for textured emitters.

use super::{Texture, TexturePoint};
use crate::color::Rgb;
use crate::math::Vec2;
use crate::sampling::Distribution2D;

/// The greatest number of cells along a side of the square.
const MAX_CELLS: usize = 512;
/// The greatest number of points along a side of a cell at which the texture is evaluated.
const MAX_POINTS: usize = 8;
/// The minimum density of a cell relative to the mean, so that no emission between the points is missed.
const FLOOR: f64 = 0.01;

impl Texture {
    /// Returns a distribution over the unit square of texture coordinates that is proportional to the mean luminance
    /// of its cells. It includes repetition and the transform of the texture. The density is positive wherever the
    /// texture is not black; a black texture has an empty distribution. Returns `None` for a constant, which needs no
    /// distribution, and for a texture that reads a mesh attribute.
    pub fn uv_distribution(&self) -> Option<Distribution2D> {
        if self.is_constant() || self.needs_mesh() {
            return None;
        }
        // Two points for each texel, whose mean is the mean of a bilinear function; one point if there are too many
        // texels.
        let axis = |detail: f32| {
            let texels = (detail.ceil() as usize).max(1);
            let cells = texels.min(MAX_CELLS);
            (cells, if texels <= MAX_CELLS { 2 } else { texels.div_ceil(cells).min(MAX_POINTS) })
        };
        let detail = self.detail();
        let ((width, along_x), (height, along_y)) = (axis(detail.x), axis(detail.y));
        let mut weights = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                weights.push(self.mean_of_cell([x, y], [width, height], [along_x, along_y]));
            }
        }
        let mean = weights.iter().sum::<f64>() / weights.len() as f64;
        let floor = FLOOR * mean.max(brightness(self.mean()));
        weights.iter_mut().for_each(|w| *w += floor);
        Some(Distribution2D::new(width, height, &weights))
    }

    /// Returns the mean brightness of a cell at `points` equally spaced points along its sides.
    fn mean_of_cell(&self, cell: [usize; 2], cells: [usize; 2], points: [usize; 2]) -> f64 {
        let at = |axis: usize, i: usize| {
            ((cell[axis] as f64 + (i as f64 + 0.5) / points[axis] as f64) / cells[axis] as f64) as f32
        };
        let mut sum = 0.0;
        for j in 0..points[1] {
            for i in 0..points[0] {
                sum += brightness(self.eval(&TexturePoint::at(Vec2::new(at(0, i), at(1, j)))));
            }
        }
        sum / (points[0] * points[1]) as f64
    }
}

/// Returns the luminance of the absolute values of a colour's channels, or 0 if it is not finite.
fn brightness(color: Rgb) -> f64 {
    let luminance = color.map(f32::abs).luminance();
    if luminance.is_finite() { f64::from(luminance) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::TextureImage;
    use crate::math::Affine2;
    use crate::texture::{Bitmap, FilterType, MeshAttribute, Pattern, Shapes, WrapMode};
    use std::sync::Arc;

    fn bitmap(size: [usize; 2], values: Vec<f32>, filter: FilterType, to_uv: Affine2) -> Texture {
        let image = TextureImage::from_floats(size[0], size[1], 1, values).unwrap();
        Texture::Bitmap(Bitmap::new(Arc::new(image), filter, WrapMode::Repeat, to_uv))
    }

    fn ramp(n: usize) -> Vec<f32> {
        (0..n).map(|i| (i * 37 % 23) as f32).collect()
    }

    #[test]
    fn what_needs_no_distribution_has_none() {
        assert!(Texture::Constant(Rgb::WHITE).uv_distribution().is_none());
        let attribute = Texture::MeshAttribute(MeshAttribute { name: "vertex_a".into(), scale: 1.0 });
        assert!(attribute.uv_distribution().is_none());
        let textures = [attribute, Texture::Constant(Rgb::WHITE)];
        let board = Pattern::new(Shapes::Squares, textures, Affine2::IDENTITY);
        assert!(Texture::Pattern(board).uv_distribution().is_none());
    }

    #[test]
    fn a_black_texture_cannot_be_sampled() {
        let black = bitmap([3, 2], vec![0.0; 6], FilterType::Bilinear, Affine2::IDENTITY);
        assert!(black.uv_distribution().unwrap().is_empty());
    }

    #[test]
    fn texels_are_drawn_by_their_brightness() {
        let texture = bitmap([5, 4], ramp(20), FilterType::Nearest, Affine2::IDENTITY);
        let d = texture.uv_distribution().unwrap();
        let mean = texture.mean().g;
        for (i, value) in ramp(20).into_iter().enumerate() {
            let at = Vec2::new(((i % 5) as f32 + 0.5) / 5.0, ((i / 5) as f32 + 0.5) / 4.0);
            let expected = (value / mean + 0.01) / 1.01;
            assert!((d.pdf(at) - expected).abs() < 1e-5, "{i}: {} {expected}", d.pdf(at));
        }
    }

    /// Estimates of the texture's integral have the correct expected value.
    #[test]
    fn estimates_are_unbiased_whatever_the_transform() {
        let turned = Affine2::from_cols_array(&[1.7, 0.6, -0.9, 2.3, 0.2, 0.4]);
        let of_bitmap = |shapes| {
            let image = bitmap([5, 4], ramp(20), FilterType::Bilinear, Affine2::IDENTITY);
            Texture::Pattern(Pattern::new(shapes, [image, Texture::Constant(Rgb::BLACK)], turned))
        };
        for texture in [
            bitmap([5, 4], ramp(20), FilterType::Bilinear, turned),
            bitmap([700, 2], ramp(1400), FilterType::Nearest, Affine2::IDENTITY),
            bitmap([5, 4], ramp(20), FilterType::Nearest, Affine2::from_scale(Vec2::splat(400.0))),
            of_bitmap(Shapes::Squares),
            of_bitmap(Shapes::Lines(0.1)),
        ] {
            let d = texture.uv_distribution().unwrap();
            let (mut estimate, mut integral) = (0.0, 0.0);
            for i in 1..=500_000 {
                // A low-discrepancy sequence, which has no resonance with a grid.
                let u = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
                let u =
                    Vec2::from(u.map(|a: f64| (a * f64::from(i)).fract() as f32)).min(Vec2::splat(0.999_999));
                integral += f64::from(texture.eval(&TexturePoint::at(u)).g);
                let (p, pdf) = d.sample(u).unwrap();
                let value = texture.eval(&TexturePoint::at(p)).g;
                assert!(pdf > 0.0 && (d.pdf(p) / pdf - 1.0).abs() < 1e-4, "{p}");
                estimate += f64::from(value / pdf);
            }
            assert!((estimate / integral - 1.0).abs() < 0.02, "{estimate} {integral}");
        }
    }

    #[test]
    fn a_single_lit_texel_of_many_is_found() {
        let mut values = vec![0.0; 1500 * 900];
        values[321 * 1500 + 1234] = 5.0;
        for filter in [FilterType::Nearest, FilterType::Bilinear] {
            let d = bitmap([1500, 900], values.clone(), filter, Affine2::IDENTITY).uv_distribution().unwrap();
            let lit = Vec2::new(1234.5 / 1500.0, 321.5 / 900.0);
            assert!(d.pdf(lit) > 1e4, "{}", d.pdf(lit));
            assert!(d.pdf(Vec2::splat(0.1)) > 0.0);
        }
    }
}
