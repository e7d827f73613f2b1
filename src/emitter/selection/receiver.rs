//! The surface points for which emitters are chosen.

use crate::math::lanes::bits;
use crate::math::{Vec3, Vec3x16, f32x16};

/// The glossy lobe of a BSDF for one viewer, as far as the choice of an emitter depends on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// The unit direction of mirror reflection.
    pub axis: Vec3,
    /// The squared half width of the lobe, in radians.
    pub width_squared: f32,
    /// The part of the scattered light in the lobe, in [0, 1]. The rest is diffuse.
    pub share: f32,
}

impl Gloss {
    /// No lobe.
    pub const NONE: Gloss = Gloss { axis: Vec3::ZERO, width_squared: 1.0, share: 0.0 };
}

/// A [`Gloss`] in each of sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub struct GlossX16 {
    axis: Vec3x16,
    width_squared: f32x16,
    share: f32x16,
}

impl GlossX16 {
    /// No lobe in any lane.
    pub const NONE: GlossX16 = GlossX16 {
        axis: Vec3x16 { x: f32x16::ZERO, y: f32x16::ZERO, z: f32x16::ZERO },
        width_squared: f32x16::ONE,
        share: f32x16::ZERO,
    };

    /// Sets one lane.
    #[inline]
    pub fn set_lane(&mut self, i: usize, gloss: Gloss) {
        self.axis.set_lane(i, gloss.axis);
        self.width_squared.as_mut_array()[i] = gloss.width_squared;
        self.share.as_mut_array()[i] = gloss.share;
    }

    /// Returns one lane.
    #[inline]
    pub fn lane(&self, i: usize) -> Gloss {
        let [width_squared, share] = [self.width_squared, self.share].map(|lanes| lanes.as_array()[i]);
        Gloss { axis: self.axis.lane(i), width_squared, share }
    }

    /// Returns the lobes given by `of` in the lanes of a mask; `None` if they have no lobe.
    #[inline]
    pub fn of_lanes(lanes: u32, of: impl Fn(usize) -> Gloss) -> Option<Self> {
        let mut all = None;
        for i in bits(lanes) {
            let gloss = of(i);
            if gloss.share > 0.0 {
                all.get_or_insert(GlossX16::NONE).set_lane(i, gloss);
            }
        }
        all
    }

    /// Returns how much brighter an emitter makes the surface for the viewer than a diffuse surface of the same albedo.
    /// It is in the direction `to`, at the given squared distance; the squared sine of its angular radius is
    /// `sin_squared`. The lobe falls off as that of the GGX distribution. [Walter 2007, Eq. 33] It is widened
    /// by the angle of the emitter.
    #[inline(always)]
    fn gain(&self, to: Vec3x16, distance_squared: f32x16, sin_squared: f32x16) -> f32x16 {
        let (one, two) = (f32x16::ONE, f32x16::splat(2.0));
        let width_squared = self.width_squared + sin_squared.fast_min(one);
        let cos = to.dot(self.axis) / distance_squared.sqrt();
        // The squared chord is the squared angle for small angles.
        let falloff = one + (two - two * cos).max(f32x16::ZERO) / width_squared;
        let glossy = one / (width_squared * falloff * falloff);
        // Where the position of the emitter is unknown, the lobe says nothing.
        let glossy = cos.simd_ge(f32x16::splat(-2.0)).select(glossy, one);
        one + self.share * (glossy - one)
    }
}

/// A surface point for which an emitter is chosen.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// The point.
    pub p: Vec3,
    /// Its glossy lobe; with a share of 0 if it has none, or if it is unknown.
    pub gloss: Gloss,
}

impl From<Vec3> for Receiver {
    fn from(p: Vec3) -> Self {
        Receiver { p, gloss: Gloss::NONE }
    }
}

/// A [`Receiver`] in each of sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub struct ReceiverX16 {
    /// The points.
    pub p: Vec3x16,
    /// The glossy lobes, if there is any.
    pub gloss: Option<GlossX16>,
}

impl From<Vec3x16> for ReceiverX16 {
    #[inline(always)]
    fn from(p: Vec3x16) -> Self {
        ReceiverX16 { p, gloss: None }
    }
}

impl ReceiverX16 {
    /// Returns the same receiver in every lane.
    #[inline]
    pub fn splat(receiver: Receiver) -> Self {
        let Gloss { axis, width_squared, share } = receiver.gloss;
        let [width_squared, shares] = [width_squared, share].map(f32x16::splat);
        let gloss = GlossX16 { axis: Vec3x16::splat(axis), width_squared, share: shares };
        ReceiverX16 { p: Vec3x16::splat(receiver.p), gloss: (share > 0.0).then_some(gloss) }
    }

    /// Returns one lane.
    #[inline]
    pub fn lane(&self, i: usize) -> Receiver {
        Receiver { p: self.p.lane(i), gloss: self.gloss.as_ref().map_or(Gloss::NONE, |gloss| gloss.lane(i)) }
    }

    /// Returns the factor of the lobes on the importance of emitters; see [`GlossX16::gain`].
    #[inline(always)]
    pub(super) fn gain(
        &self,
        to: Vec3x16,
        distance_squared: f32x16,
        radius_squared: f32x16,
    ) -> Option<f32x16> {
        let gloss = self.gloss.as_ref()?;
        Some(gloss.gain(to, distance_squared, radius_squared / distance_squared))
    }
}
