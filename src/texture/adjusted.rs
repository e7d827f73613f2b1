//! Textures that modify the values of other textures.

use std::sync::Arc;

use super::{Texture, TexturePoint};
use crate::color::Rgb;
use crate::math::Vec2;

/// The values of another texture times a factor plus an offset. With a threshold, the value is 1 at or above it and 0
/// below.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Adjusted {
    /// The texture to modify.
    pub texture: Arc<Texture>,
    /// The factor.
    pub factor: Rgb,
    /// The offset, added to the product.
    pub offset: Rgb,
    /// The least value that becomes 1.
    pub threshold: Option<f32>,
}

impl Adjusted {
    /// Creates a texture times a factor.
    pub fn scaled(texture: Arc<Texture>, factor: Rgb) -> Self {
        Adjusted { texture, factor, offset: Rgb::BLACK, threshold: None }
    }

    fn adjust(&self, value: f32, factor: f32, offset: f32) -> f32 {
        let value = value * factor + offset;
        match self.threshold {
            Some(threshold) => f32::from(u8::from(value >= threshold)),
            None => value,
        }
    }

    fn adjust_color(&self, color: Rgb) -> Rgb {
        let (c, f, o) = (color, self.factor, self.offset);
        Rgb::from([self.adjust(c.r, f.r, o.r), self.adjust(c.g, f.g, o.g), self.adjust(c.b, f.b, o.b)])
    }

    /// Returns whether all channels are treated equally.
    fn is_grey(&self) -> bool {
        let grey = |c: Rgb| c.r == c.g && c.g == c.b;
        grey(self.factor) && grey(self.offset)
    }

    /// Returns the colour at a point.
    pub fn eval(&self, point: &TexturePoint<'_>) -> Rgb {
        self.adjust_color(self.texture.eval(point))
    }

    /// Returns the scalar at a point: the adjusted scalar of the other texture or, if channels are treated
    /// differently, the luminance of the adjusted colour.
    pub fn eval_scalar(&self, point: &TexturePoint<'_>) -> f32 {
        match self.is_grey() {
            true => self.adjust(self.texture.eval_scalar(point), self.factor.r, self.offset.r),
            false => self.eval(point).luminance(),
        }
    }

    /// Returns the derivatives of the scalar with respect to the texture coordinates: those of the other texture
    /// times the luminance of the factor; zero with a threshold.
    pub fn gradient(&self, point: &TexturePoint<'_>) -> Vec2 {
        match self.threshold {
            Some(_) => Vec2::ZERO,
            None if self.is_grey() => self.texture.gradient(point) * self.factor.r,
            None => self.texture.gradient(point) * self.factor.luminance(),
        }
    }

    /// Returns the adjusted mean; with a threshold, an estimate.
    pub fn mean(&self) -> Rgb {
        match self.threshold {
            Some(_) => Rgb::splat(0.5),
            None => self.adjust_color(self.texture.mean()),
        }
    }
}

/// The product of two textures.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Product(pub [Arc<Texture>; 2]);

impl Product {
    /// Returns the colour at a point.
    pub fn eval(&self, point: &TexturePoint<'_>) -> Rgb {
        self.0[0].eval(point) * self.0[1].eval(point)
    }

    /// Returns the product of the scalars at a point.
    pub fn eval_scalar(&self, point: &TexturePoint<'_>) -> f32 {
        self.0[0].eval_scalar(point) * self.0[1].eval_scalar(point)
    }

    /// Returns the derivatives of the scalar with respect to the texture coordinates.
    pub fn gradient(&self, point: &TexturePoint<'_>) -> Vec2 {
        let [a, b] = &self.0;
        a.gradient(point) * b.eval_scalar(point) + b.gradient(point) * a.eval_scalar(point)
    }

    /// Returns the product of the means, which is an estimate.
    pub fn mean(&self) -> Rgb {
        self.0[0].mean() * self.0[1].mean()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::TextureImage;
    use crate::math::Affine2;
    use crate::texture::{Bitmap, FilterType, WrapMode};

    /// A row of two texels with one or three channels.
    fn row(channels: usize) -> Arc<Texture> {
        let values = (1..=2 * channels).map(|i| i as f32 / 8.0).collect();
        let image = Arc::new(TextureImage::from_floats(2, 1, channels, values).unwrap());
        let bitmap = Bitmap::new(image, FilterType::Bilinear, WrapMode::Clamp, Affine2::IDENTITY);
        Arc::new(Texture::Bitmap(bitmap))
    }

    #[test]
    fn values_are_multiplied_moved_and_compared() {
        let point = TexturePoint::at(Vec2::new(0.25, 0.5));
        let colored = Texture::Adjusted(Adjusted {
            offset: Rgb::from([0.5, 0.0, 0.25]),
            ..Adjusted::scaled(row(3), Rgb::from([2.0, 4.0, 8.0]))
        });
        assert_eq!(colored.eval(&point).to_array(), [0.75, 1.0, 3.25]);
        assert_eq!(colored.eval_scalar(&point), colored.eval(&point).luminance());
        let grey = Texture::Adjusted(Adjusted::scaled(row(1), Rgb::splat(3.0)));
        assert_eq!(grey.eval_scalar(&point), 0.375);
        assert_eq!(grey.mean().r, 0.5625);
        let cut = |threshold| {
            let cut = Adjusted { threshold: Some(threshold), ..Adjusted::scaled(row(1), Rgb::splat(3.0)) };
            Texture::Adjusted(cut).eval_scalar(&point)
        };
        assert_eq!([cut(0.375), cut(0.376)], [1.0, 0.0]);
    }

    #[test]
    fn gradients_are_derivatives() {
        let scaled = Arc::new(Texture::Adjusted(Adjusted::scaled(row(1), Rgb::splat(3.0))));
        for texture in [Texture::clone(&scaled), Texture::Product(Product([scaled, row(1)]))] {
            let at = |u: f32| TexturePoint::at(Vec2::new(u, 0.5));
            let difference = (texture.eval_scalar(&at(0.51)) - texture.eval_scalar(&at(0.49))) / 0.02;
            let gradient = texture.gradient(&at(0.5));
            assert!((gradient.x - difference).abs() < 1e-3 && gradient.y == 0.0, "{gradient} {difference}");
        }
    }
}
