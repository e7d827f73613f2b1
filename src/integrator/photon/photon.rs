//! Photons: the compact representation of light deposited on a surface.

use crate::color::Rgb;
use crate::math::Vec3;
use crate::math::octahedral::{decode_octahedral, encode_octahedral};
use bytemuck::{Pod, Zeroable};

/// Light deposited on a surface, in 24 bytes: the position in full precision, the power with 18 bits for each channel
/// and a shared exponent, the directions with an error of about half a degree.
///
/// The power is that of a light path traced alone, in W. It is to be divided by the number of emitted light paths,
/// which [`PhotonMap`](super::PhotonMap) does.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Photon {
    position: [f32; 3],
    payload: PhotonPayload,
}

/// The data of a photon besides its position.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct PhotonPayload {
    pub power: PackedRgb,
    pub wi: u16,
    pub normal: u16,
}

/// Three channels of 18 bits and a shared exponent.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct PackedRgb([u32; 2]);

/// The bits of one channel of the power.
const MANTISSA: i32 = 18;
/// The least exponent of a power. Values below 2^(−100 − 18 − 1) W become black.
const LEAST_EXPONENT: i32 = -100;
/// The exponent of the greatest `f32`.
const GREATEST_EXPONENT: i32 = 128;

impl Photon {
    /// The bytes of a photon.
    pub const BYTES: usize = size_of::<Photon>();

    /// Creates the photon of `power` (W) that arrived at `position`. The unit vector `wi` points away from the
    /// surface towards the incident light. `normal` is the geometric normal of unit length on either side; it is
    /// stored for the side of `wi`.
    ///
    /// Returns `None` if the position is not finite, a direction is not of unit length, or the power is black,
    /// negative or not finite.
    pub fn new(position: Vec3, power: Rgb, wi: Vec3, normal: Vec3) -> Option<Photon> {
        let unit = |v: Vec3| (v.length_squared() - 1.0).abs() < 1e-3;
        if !(position.is_finite() && power.is_valid() && unit(wi) && unit(normal)) {
            return None;
        }
        let normal = if wi.dot(normal) < 0.0 { -normal } else { normal };
        let power = PackedRgb::new(power);
        let (wi, normal) = (encode_octahedral(wi), encode_octahedral(normal));
        let payload = PhotonPayload { power, wi, normal };
        (!power.is_black()).then_some(Photon { position: position.to_array(), payload })
    }

    pub(super) fn from_parts(position: Vec3, payload: PhotonPayload) -> Photon {
        Photon { position: position.to_array(), payload }
    }

    /// Returns the bits for a file.
    pub(super) fn to_words(self) -> [u32; 6] {
        let Photon {
            position: [x, y, z],
            payload: PhotonPayload { power: PackedRgb([low, high]), wi, normal },
        } = self;
        [x.to_bits(), y.to_bits(), z.to_bits(), low, high, u32::from(wi) | u32::from(normal) << 16]
    }

    /// Creates a photon from its bits; it may be invalid.
    pub(super) fn from_words([x, y, z, low, high, directions]: [u32; 6]) -> Self {
        let payload = PhotonPayload {
            power: PackedRgb([low, high]),
            wi: directions as u16,
            normal: (directions >> 16) as u16,
        };
        Photon { position: [x, y, z].map(f32::from_bits), payload }
    }

    #[inline]
    pub(super) fn payload(&self) -> PhotonPayload {
        self.payload
    }

    /// Returns the position.
    #[inline]
    pub fn position(&self) -> Vec3 {
        Vec3::from_array(self.position)
    }

    /// Returns the power in W of a light path traced alone.
    #[inline]
    pub fn power(&self) -> Rgb {
        self.payload.power.get()
    }

    /// Returns the unit direction away from the surface, towards the incident light.
    #[inline]
    pub fn wi(&self) -> Vec3 {
        decode_octahedral(self.payload.wi)
    }

    /// Returns the geometric unit normal on the side of the incident light.
    #[inline]
    pub fn normal(&self) -> Vec3 {
        decode_octahedral(self.payload.normal)
    }

    /// Returns whether [`Photon::new`] can create this photon.
    pub(super) fn is_valid(&self) -> bool {
        let PhotonPayload { power, wi, normal } = self.payload;
        let coordinates = [wi & 255, wi >> 8, normal & 255, normal >> 8];
        self.position().is_finite() && power.is_valid() && coordinates.iter().all(|&c| c < 255)
    }
}

impl PackedRgb {
    pub const BLACK: PackedRgb = PackedRgb([0; 2]);

    /// Packs a colour with rounding to nearest: the error of a channel is at most 2^−18 times the largest channel.
    /// Channels must be finite and not negative.
    pub fn new(rgb: Rgb) -> Self {
        let bits = |exponent: i32| {
            let scale = 2f64.powi(MANTISSA - exponent);
            rgb.to_array().map(|channel| (f64::from(channel) * scale).round() as u64)
        };
        // The exponent for which the largest channel is in [1/2, 1) times the power of two.
        let mut exponent = ((rgb.max_component().to_bits() >> 23) as i32 - 126).max(LEAST_EXPONENT);
        let mut mantissas = bits(exponent);
        if mantissas.iter().any(|m| m >> MANTISSA != 0) {
            exponent = (exponent + 1).min(GREATEST_EXPONENT);
            mantissas = bits(exponent).map(|m| m.min((1 << MANTISSA) - 1));
        }
        let [r, g, b] = mantissas;
        if r | g | b == 0 {
            return PackedRgb::BLACK;
        }
        let word =
            ((exponent - LEAST_EXPONENT) as u64) << (3 * MANTISSA) | r << (2 * MANTISSA) | g << MANTISSA | b;
        PackedRgb([word as u32, (word >> 32) as u32])
    }

    /// Returns the channels.
    #[inline]
    pub fn get(self) -> Rgb {
        let word = self.word();
        let exponent = (word >> (3 * MANTISSA)) as i32 + LEAST_EXPONENT;
        let scale = f32::from_bits(((exponent - MANTISSA + 127) as u32) << 23);
        let channel = |shift: i32| ((word >> shift) as u32 & ((1 << MANTISSA) - 1)) as f32 * scale;
        Rgb::new(channel(2 * MANTISSA), channel(MANTISSA), channel(0))
    }

    fn word(self) -> u64 {
        let PackedRgb([low, high]) = self;
        u64::from(low) | u64::from(high) << 32
    }

    fn is_black(self) -> bool {
        self == PackedRgb::BLACK
    }

    /// Returns whether the colour is not black and the exponent is valid.
    fn is_valid(self) -> bool {
        !self.is_black() && self.word() >> (3 * MANTISSA) <= (GREATEST_EXPONENT - LEAST_EXPONENT) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_photon_is_what_was_put_in() {
        let (p, n) = (Vec3::new(1.5, -1e6, 3e-9), Vec3::new(1.0, 2.0, -2.0) / 3.0);
        let wi = Vec3::new(-0.6, 0.0, 0.8);
        let photon = Photon::new(p, Rgb::new(3.0, 0.25, 0.0), wi, n).unwrap();
        assert_eq!((photon.position(), photon.power()), (p, Rgb::new(3.0, 0.25, 0.0)));
        assert!((photon.wi() - wi).length() < 0.0115 && (photon.normal() + n).length() < 0.0115);
        assert!(photon.is_valid());
        assert_eq!(Photon::BYTES, 24);
    }

    #[test]
    fn powers_of_all_sizes_keep_eighteen_bits() {
        for exponent in -98..128 {
            for mantissa in [1.0, 1.0 + f32::EPSILON, 1.337, 2.0 - f32::EPSILON] {
                let strongest = mantissa * 2f32.powi(exponent);
                for share in [1.0, 0.7, 1e-3, 0.0] {
                    let power = Rgb::new(share * strongest, strongest, 0.31 * strongest);
                    let photon = Photon::new(Vec3::ZERO, power, Vec3::Z, Vec3::Z).unwrap();
                    for c in 0..3 {
                        let error = (photon.power()[c] - power[c]).abs();
                        assert!(error <= strongest * 2f32.powi(-18), "{power:?}: {:?}", photon.power());
                    }
                    assert!(photon.is_valid());
                }
            }
        }
        let tiny = Photon::new(Vec3::ZERO, Rgb::splat(1e-36), Vec3::Z, Vec3::Z);
        assert_eq!(tiny, None);
    }

    #[test]
    fn what_is_no_photon_is_refused() {
        let made = |p: f32, power: f32, wi: f32| {
            Photon::new(Vec3::splat(p), Rgb::splat(power), Vec3::Z * wi, Vec3::Y).is_some()
        };
        assert!(made(0.0, 1.0, 1.0));
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(!made(bad, 1.0, 1.0) && !made(0.0, bad, 1.0) && !made(0.0, 1.0, bad));
        }
        assert!(!made(0.0, -1.0, 1.0) && !made(0.0, 0.0, 1.0) && !made(0.0, 1.0, 0.0));
    }
}
