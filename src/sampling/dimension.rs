//! The dimensions of a sample, laid out once.
//!
//! A sample is a point of infinitely many dimensions. Its first ones belong to the camera, then each bounce
//! has a block of its own. A number or a pair of numbers is drawn for a [`Dimension`]; samplers stratify
//! within a dimension and scramble each dimension independently.

/// A dimension (or pair of dimensions) of the sample space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dimension(pub u32);

impl Dimension {
    /// Position in the pixel (a pair).
    pub const PIXEL: Dimension = Dimension(0);
    /// Position on the aperture (a pair).
    pub const LENS: Dimension = Dimension(1);
    /// Time within the shutter interval.
    pub const TIME: Dimension = Dimension(2);
    /// Which emitter a light path begins on.
    pub const LIGHT: Dimension = Dimension(3);
    /// Where on the emitter a light path begins (a pair).
    pub const LIGHT_POINT: Dimension = Dimension(4);
    /// In which direction a light path begins (a pair).
    pub const LIGHT_DIRECTION: Dimension = Dimension(5);
    const BOUNCES: u32 = 8;
    const PER_BOUNCE: u32 = 8;

    /// Which emitter to sample at a bounce.
    pub const fn emitter_choice(bounce: u32) -> Dimension {
        Dimension::of_bounce(bounce, 0)
    }

    /// Where on the emitter (a pair).
    pub const fn emitter_point(bounce: u32) -> Dimension {
        Dimension::of_bounce(bounce, 1)
    }

    /// Which lobe of the BSDF.
    pub const fn bsdf_lobe(bounce: u32) -> Dimension {
        Dimension::of_bounce(bounce, 2)
    }

    /// Direction within the lobe (a pair).
    pub const fn bsdf_direction(bounce: u32) -> Dimension {
        Dimension::of_bounce(bounce, 3)
    }

    /// Russian roulette.
    pub const fn roulette(bounce: u32) -> Dimension {
        Dimension::of_bounce(bounce, 4)
    }

    /// The same dimension of the `i`-th of several samples that one path draws at one place.
    pub const fn repeat(self, i: u32) -> Dimension {
        Dimension(self.0.wrapping_add(i.wrapping_mul(0x0100_0000)))
    }

    const fn of_bounce(bounce: u32, offset: u32) -> Dimension {
        Dimension(Self::BOUNCES + bounce * Self::PER_BOUNCE + offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn no_two_uses_share_a_dimension() {
        let camera = [Dimension::PIXEL, Dimension::LENS, Dimension::TIME];
        let light = [Dimension::LIGHT, Dimension::LIGHT_POINT, Dimension::LIGHT_DIRECTION];
        let mut seen: HashSet<u32> = camera.into_iter().chain(light).map(|d| d.0).collect();
        assert_eq!(seen.len(), 6);
        for bounce in 0..1000 {
            for d in [
                Dimension::emitter_choice(bounce),
                Dimension::emitter_point(bounce),
                Dimension::bsdf_lobe(bounce),
                Dimension::bsdf_direction(bounce),
                Dimension::roulette(bounce),
            ] {
                assert!(seen.insert(d.0));
                assert!(seen.insert(d.repeat(1).0));
            }
        }
    }
}
