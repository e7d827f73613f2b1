//! Patterns of two textures: checkerboards, and grids of lines.

use super::{Texture, TexturePoint};
use crate::color::Rgb;
use crate::math::{Affine2, Vec2};

/// Where a pattern shows its second texture.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub enum Shapes {
    /// On every other square of half a unit: not on that around (¼, ¼).
    Squares,
    /// On lines around the integers, with the given half of their width.
    Lines(f32),
}

/// A pattern of two textures.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Pattern {
    shapes: Shapes,
    textures: Box<[Texture; 2]>,
    to_uv: Affine2,
}

impl Pattern {
    /// Creates a pattern in the coordinates `to_uv` times the texture coordinates. The two textures use the
    /// untransformed coordinates.
    pub fn new(shapes: Shapes, textures: [Texture; 2], to_uv: Affine2) -> Self {
        Pattern { shapes, textures: Box::new(textures), to_uv }
    }

    /// Returns whether a point shows the second texture.
    fn is_second(&self, point: &TexturePoint<'_>) -> bool {
        let uv = self.to_uv.transform_point2(point.uv);
        match self.shapes {
            Shapes::Squares => {
                let upper = (uv - uv.floor()).cmpgt(Vec2::splat(0.5));
                upper.x != upper.y
            }
            Shapes::Lines(half_width) => (uv - uv.round()).abs().min_element() < half_width,
        }
    }

    /// Returns the colour at a point.
    pub fn eval(&self, point: &TexturePoint<'_>) -> Rgb {
        self.textures[usize::from(self.is_second(point))].eval(point)
    }

    /// Returns the texture for scalars: Mitsuba 3.9.1, which defines the scene language, exchanges the two textures
    /// of a checkerboard for scalars.
    fn of_scalars(&self, point: &TexturePoint<'_>) -> &Texture {
        &self.textures[usize::from(self.is_second(point) != (self.shapes == Shapes::Squares))]
    }

    /// Returns the scalar at a point. Of a checkerboard, it is from the first texture where [`eval`](Self::eval) uses
    /// the second, and vice versa.
    pub fn eval_scalar(&self, point: &TexturePoint<'_>) -> f32 {
        self.of_scalars(point).eval_scalar(point)
    }

    /// Returns the derivatives of [`eval_scalar`](Self::eval_scalar) with respect to the texture coordinates, inside
    /// the squares and lines.
    pub fn gradient(&self, point: &TexturePoint<'_>) -> Vec2 {
        self.of_scalars(point).gradient(point)
    }

    /// Returns the means of the two textures, weighted by their areas.
    pub fn mean(&self) -> Rgb {
        let first = match self.shapes {
            Shapes::Squares => 0.5,
            Shapes::Lines(half_width) => (1.0 - 2.0 * half_width).max(0.0).powi(2),
        };
        self.textures[0].mean() * first + self.textures[1].mean() * (1.0 - first)
    }

    /// Returns the bytes of the two textures.
    pub fn memory_bytes(&self) -> usize {
        self.textures.iter().map(Texture::memory_bytes).sum()
    }

    /// Returns the two textures.
    pub(super) fn textures(&self) -> &[Texture; 2] {
        &self.textures
    }

    /// Returns the greatest number of squares, lines or texels along the sides of the unit square.
    pub(super) fn detail(&self) -> Vec2 {
        let [by_u, by_v] = [self.to_uv.matrix2.x_axis, self.to_uv.matrix2.y_axis];
        let across = match self.shapes {
            Shapes::Squares => 2.0,
            Shapes::Lines(half_width) => 0.5 / half_width,
        };
        let shapes = Vec2::new(by_u.abs().max_element(), by_v.abs().max_element()) * across;
        self.textures.iter().fold(shapes, |most, texture| most.max(texture.detail()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::TextureImage;
    use crate::texture::{Bitmap, FilterType, WrapMode};
    use std::sync::Arc;

    /// The expected values are from Mitsuba 3.9.1.
    #[test]
    fn squares_agree_with_the_scene_languages_board() {
        let [first, second] = [Rgb::new(1.0, 0.5, 0.25), Rgb::new(0.1, 0.2, 0.3)];
        let to_uv = Affine2::from_cols_array(&[2.0, 0.0, 0.0, 3.0, 0.1, 0.0]);
        let board = Pattern::new(Shapes::Squares, [first, second].map(Texture::Constant), to_uv);
        for (uv, color, number) in [
            ([0.1, 0.1], first, 0.2),
            ([0.3, 0.1], second, 0.583_333_4),
            ([0.0, 0.0], first, 0.2),
            ([0.2, 0.5 / 3.0], first, 0.2),
            ([0.21, 0.5 / 3.0], second, 0.583_333_4),
            ([0.2, 0.3], second, 0.583_333_4),
            ([-0.1, 0.05], second, 0.583_333_4),
        ] {
            let point = TexturePoint::at(Vec2::from(uv));
            assert_eq!(board.eval(&point), color, "{uv:?}");
            assert!((board.eval_scalar(&point) - number).abs() < 1e-6, "{uv:?}");
            assert_eq!(board.gradient(&point), Vec2::ZERO);
        }
        assert!((board.mean().mean() - 0.391_666_7).abs() < 1e-6);
    }

    #[test]
    fn a_texture_on_the_board_sees_the_coordinates_themselves() {
        let image = TextureImage::from_floats(2, 1, 1, vec![0.0, 1.0]).unwrap();
        let bitmap = Bitmap::new(Arc::new(image), FilterType::Bilinear, WrapMode::Clamp, Affine2::IDENTITY);
        let textures = [Texture::Bitmap(bitmap), Texture::Constant(Rgb::splat(7.0))];
        let board = Pattern::new(Shapes::Squares, textures, Affine2::from_scale(Vec2::splat(0.5)));
        let point = TexturePoint::at(Vec2::new(0.5, 0.5));
        assert_eq!(board.eval(&point), Rgb::splat(0.5));
        assert_eq!(board.eval_scalar(&point), 7.0);
        let point = TexturePoint::at(Vec2::new(0.5, 1.5));
        assert_eq!((board.eval_scalar(&point), board.gradient(&point)), (0.5, Vec2::new(2.0, 0.0)));
        assert_eq!(board.memory_bytes(), 4);
    }

    /// Lines of the given width at the integers, and the background elsewhere.
    #[test]
    fn lines_are_around_the_integers() {
        let [background, lines] = [Rgb::splat(0.2), Rgb::new(0.4, 0.6, 0.8)];
        let to_uv = Affine2::from_scale(Vec2::new(2.0, 1.0));
        let grid = Pattern::new(Shapes::Lines(0.1), [background, lines].map(Texture::Constant), to_uv);
        for (uv, color) in [
            ([0.25, 0.5], background),
            ([0.04, 0.5], lines),
            ([0.06, 0.5], background),
            ([0.46, 0.5], lines),
            ([-0.04, 0.5], lines),
            ([0.25, 0.91], lines),
            ([0.25, 0.89], background),
            ([-0.25, -3.05], lines),
        ] {
            let point = TexturePoint::at(Vec2::from(uv));
            assert_eq!(grid.eval(&point), color, "{uv:?}");
            assert!((grid.eval_scalar(&point) - color.mean()).abs() < 1e-6, "{uv:?}");
        }
        // A fraction of 0.64 is background.
        assert!((grid.mean().r - (0.64 * 0.2 + 0.36 * 0.4)).abs() < 1e-6);
        assert_eq!(grid.detail(), Vec2::new(10.0, 5.0));
    }
}
