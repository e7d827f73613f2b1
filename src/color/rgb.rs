//! Linear Rec.709 RGB triples.

use std::ops::{Add, AddAssign, Div, Index, Mul, MulAssign, Sub};

/// A linear Rec.709 RGB triple: a radiance, a reflectance or a weight, depending on its use.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
#[repr(C)]
pub struct Rgb {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
}

impl Rgb {
    /// Zero in every channel.
    pub const BLACK: Rgb = Rgb::splat(0.0);
    /// One in every channel.
    pub const WHITE: Rgb = Rgb::splat(1.0);

    /// Creates a triple.
    #[inline]
    pub const fn new(r: f32, g: f32, b: f32) -> Self {
        Rgb { r, g, b }
    }

    /// Creates a triple with the same value in every channel.
    #[inline]
    pub const fn splat(v: f32) -> Self {
        Rgb { r: v, g: v, b: v }
    }

    /// Returns the channels in order.
    #[inline]
    pub fn to_array(self) -> [f32; 3] {
        [self.r, self.g, self.b]
    }

    /// Applies `f` to each channel.
    #[inline]
    pub fn map(self, f: impl Fn(f32) -> f32) -> Self {
        Rgb::new(f(self.r), f(self.g), f(self.b))
    }

    /// Applies `f` to each pair of channels.
    #[inline]
    pub fn zip(self, other: Rgb, f: impl Fn(f32, f32) -> f32) -> Self {
        Rgb::new(f(self.r, other.r), f(self.g, other.g), f(self.b, other.b))
    }

    /// Returns the largest channel.
    #[inline]
    pub fn max_component(self) -> f32 {
        self.r.max(self.g).max(self.b)
    }

    /// Returns the mean of the channels.
    #[inline]
    pub fn mean(self) -> f32 {
        (self.r + self.g + self.b) * (1.0 / 3.0)
    }

    /// Returns the relative luminance: the Y of Rec.709.
    #[inline]
    pub fn luminance(self) -> f32 {
        0.212_671 * self.r + 0.715_16 * self.g + 0.072_169 * self.b
    }

    /// Returns whether every channel is zero.
    #[inline]
    pub fn is_black(self) -> bool {
        self.r == 0.0 && self.g == 0.0 && self.b == 0.0
    }

    /// Returns whether every channel is finite and not negative.
    #[inline]
    pub fn is_valid(self) -> bool {
        let ok = |v: f32| (0.0..f32::INFINITY).contains(&v);
        ok(self.r) && ok(self.g) && ok(self.b)
    }
}

impl From<[f32; 3]> for Rgb {
    fn from([r, g, b]: [f32; 3]) -> Self {
        Rgb { r, g, b }
    }
}

impl Index<usize> for Rgb {
    type Output = f32;

    fn index(&self, i: usize) -> &f32 {
        match i {
            0 => &self.r,
            1 => &self.g,
            2 => &self.b,
            _ => panic!("an RGB triple has no channel {i}"),
        }
    }
}

/// Implements an operator between triples, channel by channel, and with a scalar on the right.
macro_rules! channelwise {
    ($trait:ident, $method:ident, $op:tt) => {
        impl $trait for Rgb {
            type Output = Rgb;
            #[inline]
            fn $method(self, o: Rgb) -> Rgb {
                Rgb::new(self.r $op o.r, self.g $op o.g, self.b $op o.b)
            }
        }
        impl $trait<f32> for Rgb {
            type Output = Rgb;
            #[inline]
            fn $method(self, o: f32) -> Rgb {
                self $op Rgb::splat(o)
            }
        }
    };
}

channelwise!(Add, add, +);
channelwise!(Sub, sub, -);
channelwise!(Mul, mul, *);
channelwise!(Div, div, /);

impl Mul<Rgb> for f32 {
    type Output = Rgb;
    #[inline]
    fn mul(self, o: Rgb) -> Rgb {
        o * self
    }
}

impl AddAssign for Rgb {
    #[inline]
    fn add_assign(&mut self, o: Rgb) {
        *self = *self + o;
    }
}

impl MulAssign<Rgb> for Rgb {
    #[inline]
    fn mul_assign(&mut self, o: Rgb) {
        *self = *self * o;
    }
}

impl MulAssign<f32> for Rgb {
    #[inline]
    fn mul_assign(&mut self, o: f32) {
        *self = *self * o;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arithmetic_is_channelwise() {
        let a = Rgb::new(1.0, 2.0, 3.0);
        assert_eq!(a * Rgb::splat(2.0) - a, a);
        assert_eq!(2.0 * a / 2.0, a);
        assert_eq!(a.max_component(), 3.0);
        assert_eq!(a[1], 2.0);
        assert!((Rgb::WHITE.luminance() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn invalid_values_are_seen() {
        assert!(Rgb::BLACK.is_valid());
        for bad in [f32::NAN, f32::INFINITY, -1e-30] {
            assert!(!Rgb::new(0.0, bad, 0.0).is_valid());
        }
    }
}
