//! The layout of a sample's dimensions.
//!
//! A sample is a point with infinitely many dimensions. The first ones belong to the camera and to the start of a
//! light path. After these, each bounce has its own block. A number or a pair of numbers is drawn for a
//! [`Dimension`]. Samplers stratify within a dimension and scramble each dimension independently.

use super::Domain;
use std::fmt;

/// A dimension (or pair of dimensions) of the sample space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Dimension(pub u64);

/// Names and domains of the dimensions before the bounces.
const FIRST: [(&str, Domain); 6] = [
    ("pixel", Domain::Pixel),
    ("lens", Domain::Lens),
    ("time", Domain::Time),
    ("light", Domain::Light),
    ("light_point", Domain::Light),
    ("light_direction", Domain::Light),
];
/// Names of the dimensions of a bounce, by their offset in its block.
const OF_BOUNCE: [&str; 8] = [
    "unused",
    "emitter_point",
    "bsdf_lobe",
    "bsdf_direction",
    "roulette",
    "free_flight",
    "connection",
    "equiangular",
];

impl Dimension {
    /// Position in the pixel (a pair).
    pub const PIXEL: Dimension = Dimension(0);
    /// Position on the aperture (a pair).
    pub const LENS: Dimension = Dimension(1);
    /// Time within the shutter interval.
    pub const TIME: Dimension = Dimension(2);
    /// Choice of the emitter at which a light path starts.
    pub const LIGHT: Dimension = Dimension(3);
    /// Position on the emitter at which a light path starts (a pair).
    pub const LIGHT_POINT: Dimension = Dimension(4);
    /// Direction in which a light path starts (a pair).
    pub const LIGHT_DIRECTION: Dimension = Dimension(5);
    const BOUNCES: u64 = 8;
    const PER_BOUNCE: u64 = 8;
    /// The lowest bit of the repetition count.
    const REPEAT_SHIFT: u32 = 36;

    /// Choice of the emitter to sample at a bounce, and position on it (a pair).
    pub const fn emitter_point(bounce: u32) -> Dimension {
        Dimension::of_bounce(bounce, 1)
    }

    /// Choice of the BSDF's lobe.
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

    /// Choice of the channel and the optical depth of a flight through participating media (a pair).
    pub const fn free_flight(bounce: u32) -> Dimension {
        Dimension::of_bounce(bounce, 5)
    }

    /// Choice of the vertex of a light path to which a camera path is connected.
    pub const fn connection(bounce: u32) -> Dimension {
        Dimension::of_bounce(bounce, 6)
    }

    /// Distance of a point near an emitter in a participating medium.
    pub const fn equiangular(bounce: u32) -> Dimension {
        Dimension::of_bounce(bounce, 7)
    }

    /// Returns the same dimension for the `i`-th of several samples (at most 2^28) that a path draws at one vertex.
    pub const fn repeat(self, i: u32) -> Dimension {
        Dimension(self.0.wrapping_add((i as u64) << Self::REPEAT_SHIFT))
    }

    const fn of_bounce(bounce: u32, offset: u64) -> Dimension {
        Dimension(Self::BOUNCES + bounce as u64 * Self::PER_BOUNCE + offset)
    }

    /// Returns the word with which samplers scramble.
    pub(super) const fn word(self) -> u32 {
        self.0 as u32 ^ ((self.0 >> 32) as u32).wrapping_mul(0x9e37_79b9)
    }

    /// Returns the index of the repetition.
    const fn repetition(self) -> u64 {
        self.0 >> Self::REPEAT_SHIFT
    }

    /// Returns the bounce and the offset in its block; before the bounces, the dimension's own number.
    const fn place(self) -> Result<(u64, usize), usize> {
        let base = self.0 & ((1 << Self::REPEAT_SHIFT) - 1);
        match base.checked_sub(Self::BOUNCES) {
            None => Err(base as usize),
            Some(base) => Ok((base / Self::PER_BOUNCE, (base % Self::PER_BOUNCE) as usize)),
        }
    }

    /// Returns the domain of integration; numbers that no bounce uses belong to any domain.
    pub fn domain(self) -> Domain {
        match self.place() {
            Err(i) => FIRST.get(i).map_or(Domain::Hemisphere, |(_, domain)| *domain),
            Ok((_, 0 | 1)) => Domain::Light,
            Ok((0, 2 | 3)) => Domain::Bsdf,
            Ok((_, 4)) => Domain::Roulette,
            Ok(_) => Domain::Hemisphere,
        }
    }
}

/// Writes the name: `pixel`, `emitter_point[3]` at the fourth bounce, `emitter_point[0] of sample 2` for a
/// repetition.
impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unused = "unused";
        match self.place() {
            Err(i) => f.write_str(FIRST.get(i).map_or(unused, |(name, _)| name))?,
            Ok((bounce, i)) => write!(f, "{}[{bounce}]", OF_BOUNCE.get(i).unwrap_or(&unused))?,
        }
        match self.repetition() {
            0 => Ok(()),
            i => write!(f, " of sample {i}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    fn of_bounce(bounce: u32) -> [Dimension; 7] {
        [
            Dimension::emitter_point(bounce),
            Dimension::bsdf_lobe(bounce),
            Dimension::bsdf_direction(bounce),
            Dimension::roulette(bounce),
            Dimension::free_flight(bounce),
            Dimension::connection(bounce),
            Dimension::equiangular(bounce),
        ]
    }

    const CAMERA: [Dimension; 3] = [Dimension::PIXEL, Dimension::LENS, Dimension::TIME];
    const LIGHT: [Dimension; 3] = [Dimension::LIGHT, Dimension::LIGHT_POINT, Dimension::LIGHT_DIRECTION];

    #[test]
    fn no_two_uses_share_a_dimension_a_name_or_a_word() {
        let all: Vec<_> = (0..1000).chain([u32::MAX]).flat_map(of_bounce).collect();
        let all = CAMERA.into_iter().chain(LIGHT).chain(all);
        let (mut seen, mut names, mut words) = (HashSet::new(), HashSet::new(), HashSet::new());
        for d in all {
            for i in [0, 1, 255, 256, 70_000] {
                let d = d.repeat(i);
                assert!(seen.insert(d), "{d}");
                assert!(names.insert(d.to_string()), "{d}");
                assert!(words.insert(d.word()), "{d}");
            }
        }
    }

    #[test]
    fn names_and_domains_are_those_of_the_uses() {
        let first = CAMERA.into_iter().chain(LIGHT).map(|d| format!("{d} {}", d.domain()));
        let expected =
            "pixel pixel, lens lens, time time, light light, light_point light, light_direction light";
        assert_eq!(first.collect::<Vec<_>>().join(", "), expected);
        let domains = of_bounce(0).map(|d| format!("{d} {}", d.domain())).join(", ");
        let expected = "emitter_point[0] light, bsdf_lobe[0] bsdf, \
                        bsdf_direction[0] bsdf, roulette[0] roulette, free_flight[0] hemisphere, \
                        connection[0] hemisphere, equiangular[0] hemisphere";
        assert_eq!(domains, expected);
        assert_eq!(Dimension::bsdf_direction(3).domain(), Domain::Hemisphere);
        assert_eq!(Dimension::emitter_point(3).repeat(2).to_string(), "emitter_point[3] of sample 2");
        assert_eq!(Dimension::emitter_point(3).repeat(2).domain(), Domain::Light);
    }
}
