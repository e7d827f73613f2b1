//! Checkerboard textures.

use super::{Texture, TexturePoint};
use crate::color::Rgb;
use crate::math::{Affine2, Vec2};

/// A checkerboard of two textures, with squares of half a unit; the square around (¼, ¼) shows the first.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Checkerboard {
    colors: Box<[Texture; 2]>,
    to_uv: Affine2,
}

impl Checkerboard {
    /// Creates a checkerboard in the coordinates `to_uv` times the texture coordinates. The two textures use the
    /// untransformed coordinates.
    pub fn new(color0: Texture, color1: Texture, to_uv: Affine2) -> Self {
        Checkerboard { colors: Box::new([color0, color1]), to_uv }
    }

    /// Returns whether a point is on a square of the second texture.
    fn is_second(&self, point: &TexturePoint<'_>) -> bool {
        let uv = self.to_uv.transform_point2(point.uv);
        let upper = (uv - uv.floor()).cmpgt(Vec2::splat(0.5));
        upper.x != upper.y
    }

    /// Returns the colour at a point.
    pub fn eval(&self, point: &TexturePoint<'_>) -> Rgb {
        self.colors[usize::from(self.is_second(point))].eval(point)
    }

    /// Returns the texture for scalars: Mitsuba 3.9.1, which defines the scene language, exchanges the two textures
    /// for scalars.
    fn of_scalars(&self, point: &TexturePoint<'_>) -> &Texture {
        &self.colors[usize::from(!self.is_second(point))]
    }

    /// Returns the scalar at a point: from the first texture where [`eval`](Self::eval) uses the second, and vice
    /// versa.
    pub fn eval_scalar(&self, point: &TexturePoint<'_>) -> f32 {
        self.of_scalars(point).eval_scalar(point)
    }

    /// Returns the derivatives of [`eval_scalar`](Self::eval_scalar) with respect to the texture coordinates, inside
    /// the squares.
    pub fn gradient(&self, point: &TexturePoint<'_>) -> Vec2 {
        self.of_scalars(point).gradient(point)
    }

    /// Returns the mean of the two textures' means.
    pub fn mean(&self) -> Rgb {
        (self.colors[0].mean() + self.colors[1].mean()) * 0.5
    }

    /// Returns the bytes of the two textures.
    pub fn memory_bytes(&self) -> usize {
        self.colors.iter().map(Texture::memory_bytes).sum()
    }

    /// Returns whether one of the textures reads a mesh attribute.
    pub(super) fn needs_mesh(&self) -> bool {
        self.colors.iter().any(Texture::needs_mesh)
    }

    /// Returns the greatest number of squares or texels along the sides of the unit square.
    pub(super) fn detail(&self) -> Vec2 {
        let [by_u, by_v] = [self.to_uv.matrix2.x_axis, self.to_uv.matrix2.y_axis];
        let squares = Vec2::new(by_u.abs().max_element(), by_v.abs().max_element()) * 2.0;
        self.colors.iter().fold(squares, |most, texture| most.max(texture.detail()))
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
        let board = Checkerboard::new(Texture::Constant(first), Texture::Constant(second), to_uv);
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
        let board = Checkerboard::new(
            Texture::Bitmap(bitmap),
            Texture::Constant(Rgb::splat(7.0)),
            Affine2::from_scale(Vec2::splat(0.5)),
        );
        let point = TexturePoint::at(Vec2::new(0.5, 0.5));
        assert_eq!(board.eval(&point), Rgb::splat(0.5));
        assert_eq!(board.eval_scalar(&point), 7.0);
        let point = TexturePoint::at(Vec2::new(0.5, 1.5));
        assert_eq!((board.eval_scalar(&point), board.gradient(&point)), (0.5, Vec2::new(2.0, 0.0)));
        assert_eq!(board.memory_bytes(), 4);
    }
}
