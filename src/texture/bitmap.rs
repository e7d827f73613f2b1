//! Bitmap textures.

use std::sync::Arc;

use super::TexturePoint;
use crate::color::Rgb;
use crate::image::TextureImage;
use crate::math::{Affine2, Vec2};

/// The interpolation between the centres of texels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum FilterType {
    /// Bilinear interpolation of the four nearest texels.
    #[default]
    Bilinear,
    /// The texel that contains the point.
    Nearest,
}

/// The extension of the image outside the unit square.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub enum WrapMode {
    /// Copies of the image.
    #[default]
    Repeat,
    /// Copies of the image, alternately mirrored.
    Mirror,
    /// The colours of the image's border.
    Clamp,
}

impl WrapMode {
    /// Returns the column or row, of `n`, for an index outside the image.
    #[inline]
    pub fn wrap(self, i: i64, n: usize) -> usize {
        let n = n as i64;
        // Most indices are inside, and a division takes long.
        if (0..n).contains(&i) {
            return i as usize;
        }
        let wrapped = match self {
            WrapMode::Repeat => i.rem_euclid(n),
            WrapMode::Clamp => i.clamp(0, n - 1),
            WrapMode::Mirror => {
                let twice = i.rem_euclid(2 * n);
                twice.min(2 * n - 1 - twice)
            }
        };
        wrapped as usize
    }
}

/// An image over the unit square. Its first row is at v = 0, its first column at u = 0, and the centre of texel (i,
/// j) is at ((i + ½)/width, (j + ½)/height).
#[derive(Clone, Debug, serde::Serialize)]
pub struct Bitmap {
    image: Arc<TextureImage>,
    filter_type: FilterType,
    /// The wrap modes along u and v.
    wrap_modes: [WrapMode; 2],
    to_uv: Affine2,
    mean: Rgb,
}

impl Bitmap {
    /// Creates a texture that evaluates an image at `to_uv` times the texture coordinates. Values that are not
    /// colours need an image read [`as_linear`](TextureImage::as_linear).
    pub fn new(
        image: Arc<TextureImage>,
        filter_type: FilterType,
        wrap_mode: WrapMode,
        to_uv: Affine2,
    ) -> Self {
        let mut sum = [0.0f64; 3];
        for y in 0..image.height() {
            for x in 0..image.width() {
                for (sum, value) in sum.iter_mut().zip(image.rgb(x, y)) {
                    *sum += f64::from(value);
                }
            }
        }
        let texels = image.width() as f64 * image.height() as f64;
        let mean = Rgb::from(sum.map(|s| (s / texels) as f32));
        Bitmap { image, filter_type, wrap_modes: [wrap_mode; 2], to_uv, mean }
    }

    /// Sets separate wrap modes along u and v.
    pub fn wrapped(self, wrap_modes: [WrapMode; 2]) -> Self {
        Bitmap { wrap_modes, ..self }
    }

    /// Returns the column of an index inside or outside the image.
    #[inline]
    fn column(&self, x: i64) -> usize {
        self.wrap_modes[0].wrap(x, self.image.width())
    }

    /// Returns the row of an index inside or outside the image.
    #[inline]
    fn row(&self, y: i64) -> usize {
        self.wrap_modes[1].wrap(y, self.image.height())
    }

    /// Returns the numbers of columns and rows of the image.
    pub fn size(&self) -> [usize; 2] {
        [self.image.width(), self.image.height()]
    }

    /// Returns the image's size.
    fn resolution(&self) -> Vec2 {
        Vec2::new(self.image.width() as f32, self.image.height() as f32)
    }

    /// Returns the columns and rows of the four texels around a point, and the weights of the second column and row.
    #[inline]
    fn around(&self, uv: Vec2) -> ([usize; 2], [usize; 2], Vec2) {
        let p = self.to_uv.transform_point2(uv) * self.resolution() - 0.5;
        let low = p.floor();
        let (x, y) = (index(low.x), index(low.y));
        ([self.column(x), self.column(x + 1)], [self.row(y), self.row(y + 1)], p - low)
    }

    /// Returns the colour at a point.
    pub fn eval(&self, point: &TexturePoint<'_>) -> Rgb {
        if self.filter_type == FilterType::Nearest {
            let p = (self.to_uv.transform_point2(point.uv) * self.resolution()).floor();
            return Rgb::from(self.image.rgb(self.column(index(p.x)), self.row(index(p.y))));
        }
        let (columns, rows, at) = self.around(point.uv);
        Rgb::from(self.image.bilinear(columns, rows, at.to_array()))
    }

    /// Returns the scalar of a colour: its luminance, or the value of a grey image.
    fn scalar(&self, color: Rgb) -> f32 {
        if self.image.is_grey() { color.r } else { color.luminance() }
    }

    /// Returns the scalar at a point.
    pub fn eval_scalar(&self, point: &TexturePoint<'_>) -> f32 {
        self.scalar(self.eval(point))
    }

    /// Returns the derivatives of [`eval_scalar`](Self::eval_scalar) with respect to the texture coordinates; 0
    /// without interpolation.
    pub fn gradient(&self, point: &TexturePoint<'_>) -> Vec2 {
        if self.filter_type == FilterType::Nearest {
            return Vec2::ZERO;
        }
        let (columns, rows, at) = self.around(point.uv);
        let texel = |x: usize, y: usize| self.scalar(Rgb::from(self.image.rgb(columns[x], rows[y])));
        let (f00, f10, f01, f11) = (texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1));
        let by_texel = Vec2::new(
            (1.0 - at.y) * (f10 - f00) + at.y * (f11 - f01),
            (1.0 - at.x) * (f01 - f00) + at.x * (f11 - f10),
        );
        self.to_uv.matrix2.transpose() * (by_texel * self.resolution())
    }

    /// Returns the mean of the texels.
    pub fn mean(&self) -> Rgb {
        self.mean
    }

    /// Returns the bytes of the texels.
    pub fn memory_bytes(&self) -> usize {
        self.image.memory_bytes()
    }

    /// Returns the greatest number of texels along the sides of the unit square.
    pub(super) fn detail(&self) -> Vec2 {
        let [by_u, by_v] = [self.to_uv.matrix2.x_axis, self.to_uv.matrix2.y_axis];
        let size = self.resolution();
        Vec2::new((by_u.abs() * size).max_element(), (by_v.abs() * size).max_element())
    }
}

/// Converts a whole number to an index. Far from the image it is imprecise, but does not overflow.
#[inline]
fn index(v: f32) -> i64 {
    i64::from(v as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image of 4 by 3 pixels.
    fn image(grey: bool) -> Arc<TextureImage> {
        let channels = if grey { 1 } else { 3 };
        let values = (0..12 * channels).map(|i| ((i * 37) % 23) as f32 / 16.0).collect();
        Arc::new(TextureImage::from_floats(4, 3, channels, values).unwrap())
    }

    /// A scale by (1.5, −2) and a translation by (0.1, 0.3).
    fn moved() -> Affine2 {
        Affine2::from_cols_array(&[1.5, 0.0, 0.0, -2.0, 0.1, 0.3])
    }

    const POINTS: [[f32; 2]; 4] = [[0.3, 0.4], [0.01, 0.98], [-1.37, 2.71], [1.9, -0.45]];

    /// The result of Mitsuba 3.9.1 at a point: colour, scalar, gradient.
    type Expected = ([f32; 3], f32, [f32; 2]);

    fn check(what: &str, bitmap: &Bitmap, expected: [Expected; 4]) {
        for (uv, (color, number, gradient)) in POINTS.into_iter().zip(expected) {
            let point = TexturePoint::at(Vec2::from(uv));
            let found = bitmap.eval(&point).to_array();
            assert!(found.iter().zip(color).all(|(a, b)| (a - b).abs() < 1e-5), "{what} {uv:?}: {found:?}");
            let found = bitmap.eval_scalar(&point);
            assert!((found - number).abs() < 1e-5, "{what} {uv:?}: {found}");
            let found = bitmap.gradient(&point);
            assert!((found - Vec2::from(gradient)).length() < 1e-4, "{what} {uv:?}: {found}");
        }
    }

    #[test]
    fn colours_and_gradients_agree_with_the_scene_languages_textures() {
        use FilterType::{Bilinear, Nearest};
        use WrapMode::{Clamp, Mirror, Repeat};
        let still = Affine2::IDENTITY;
        let rgb = |filter, wrap, to_uv| Bitmap::new(image(false), filter, wrap, to_uv);
        let grey = |filter, wrap, to_uv| Bitmap::new(image(true), filter, wrap, to_uv);
        check(
            "bilinear, repeat",
            &rgb(Bilinear, Repeat, still),
            [
                ([0.433125, 1.00625, 0.44375], 0.843768, [-0.63314, 0.6705]),
                ([0.43595, 0.5853, 0.74845], 0.565312, [-0.02346, -0.39452]),
                ([0.74, 1.083125, 0.520625], 0.969557, [-1.0, 0.39536]),
                ([0.927812, 0.681562, 0.140625], 0.694894, [1.34374, 0.17866]),
            ],
        );
        check(
            "bilinear, mirror, moved",
            &rgb(Bilinear, Mirror, moved()),
            [
                ([1.01875, 0.8875, 0.325], 0.874818, [0.33429, 1.63899]),
                ([0.2275, 1.1025, 0.54], 0.875818, [0.0, -2.625]),
                ([0.875, 0.3125, 1.1875], 0.495275, [0.0, 0.0]),
                ([0.225, 0.95625, 0.39375], 0.760139, [0.0, 0.79071]),
            ],
        );
        check(
            "bilinear, clamp",
            &rgb(Bilinear, Clamp, still),
            [
                ([0.433125, 1.00625, 0.44375], 0.843768, [-0.63314, 0.6705]),
                ([0.875, 0.3125, 1.1875], 0.495275, [0.0, 0.0]),
                ([0.875, 0.3125, 1.1875], 0.495275, [0.0, 0.0]),
                ([0.6875, 0.125, 1.0], 0.307775, [0.0, 0.0]),
            ],
        );
        let flat = |color: [f32; 3], number: f32| (color, number, [0.0; 2]);
        check(
            "nearest, repeat, moved",
            &rgb(Nearest, Repeat, moved()),
            [
                flat([1.375, 0.8125, 0.25], 0.891532),
                flat([0.4375, 1.3125, 0.75], 1.085818),
                flat([0.875, 0.3125, 1.1875], 0.495275),
                flat([0.6875, 0.125, 1.0], 0.307775),
            ],
        );
        check(
            "nearest, mirror",
            &rgb(Nearest, Mirror, still),
            [
                flat([0.1875, 1.0625, 0.5], 0.835818),
                flat([0.875, 0.3125, 1.1875], 0.495275),
                flat([0.375, 1.25, 0.6875], 1.023318),
                flat([0.4375, 1.3125, 0.75], 1.085818),
            ],
        );
        check(
            "grey, mirror",
            &grey(Bilinear, Mirror, still),
            [
                ([0.345625; 3], 0.345625, [-0.525, -1.14375]),
                ([1.25; 3], 1.25, [0.0, 0.0]),
                ([0.432487; 3], 0.432487, [1.3725, -2.35125]),
                ([0.53125; 3], 0.53125, [0.0, -1.875]),
            ],
        );
        check(
            "grey, repeat, moved",
            &grey(Bilinear, Repeat, moved()),
            [
                ([0.675; 3], 0.675, [5.25, 2.2875]),
                ([0.3426; 3], 0.3426, [-2.64, -3.405]),
                ([1.0594; 3], 1.0594, [0.2925, 4.74]),
                ([0.793125; 3], 0.793125, [-6.2625, 2.2875]),
            ],
        );
        assert!((rgb(Bilinear, Repeat, still).mean().luminance() - 0.684149).abs() < 1e-5);
        assert!((grey(Nearest, Clamp, moved()).mean().g - 0.619791).abs() < 1e-5);
    }

    /// Bytes are decoded before interpolation. The expected values are from Mitsuba 3.9.1.
    #[test]
    fn bytes_are_interpolated_in_linear_light() {
        let codes = vec![200, 100, 50, 10, 20, 30, 255, 0, 128, 64, 32, 16];
        let image = TextureImage::from_bytes(2, 2, 3, codes).unwrap();
        let point = TexturePoint::at(Vec2::new(0.4, 0.6));
        for (image, color, number, mean) in [
            (image.clone(), [0.622332, 0.0304247, 0.114726], 0.16239, 0.118179),
            (image.as_linear(), [0.710941, 0.115765, 0.310902], 0.256424, 0.232719),
        ] {
            let bitmap =
                Bitmap::new(Arc::new(image), FilterType::Bilinear, WrapMode::Repeat, Affine2::IDENTITY);
            let found = bitmap.eval(&point).to_array();
            assert!(found.iter().zip(color).all(|(a, b)| (a - b).abs() < 2e-6), "{found:?}");
            assert!((bitmap.eval_scalar(&point) - number).abs() < 2e-6);
            assert!((bitmap.mean().luminance() - mean).abs() < 2e-6);
            assert_eq!(bitmap.memory_bytes(), 12);
        }
    }

    /// Includes transforms that mix the axes of an image that is not square.
    #[test]
    fn gradients_are_derivatives() {
        let to_uv = Affine2::from_cols_array(&[0.7, -1.1, 0.4, 0.9, 0.1, 0.2]);
        let bitmap = Bitmap::new(image(false), FilterType::Bilinear, WrapMode::Mirror, to_uv);
        const H: f32 = 1e-3;
        for uv in [[0.31, 0.42], [0.02, 0.98], [-0.4, 0.3]].map(Vec2::from) {
            let at = |dx: f32, dy: f32| bitmap.eval_scalar(&TexturePoint::at(uv + Vec2::new(dx, dy)));
            let differences = Vec2::new(at(H, 0.0) - at(-H, 0.0), at(0.0, H) - at(0.0, -H)) / (2.0 * H);
            let gradient = bitmap.gradient(&TexturePoint::at(uv));
            assert!((gradient - differences).length() < 5e-3, "{uv}: {gradient} {differences}");
        }
    }

    #[test]
    fn coordinates_without_a_place_do_no_harm() {
        for wrap in [WrapMode::Repeat, WrapMode::Mirror, WrapMode::Clamp] {
            for filter in [FilterType::Bilinear, FilterType::Nearest] {
                let bitmap = Bitmap::new(image(false), filter, wrap, Affine2::IDENTITY);
                for v in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e30, 3e9] {
                    for uv in [Vec2::new(v, 0.5), Vec2::new(0.5, v)] {
                        let _ = bitmap.eval(&TexturePoint::at(uv));
                        let _ = bitmap.gradient(&TexturePoint::at(uv));
                    }
                }
            }
        }
    }
}
