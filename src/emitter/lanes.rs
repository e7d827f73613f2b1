//! Emitter sampling for sixteen points at a time.
//!
//! Rectangles, the most frequent emitters, are sampled in parallel lanes; other emitters one lane after the other.

use super::area::RectangleSurface;
use super::spherical_rectangle::{RectanglePointX16, RectangleX16};
use super::{EmitterSample, Light, ShadowTarget};
use crate::color::Rgb;
use crate::math::lanes::{LANES, Vec3x16, bits, f32x16, mask_from_bits};
use crate::math::ray::{end_error_x16, offset_origin_x16};
use crate::math::{Vec2, Vec3};

/// An [`EmitterSample`] in each of sixteen lanes.
#[derive(Clone, Copy, Debug)]
pub struct EmitterSampleX16 {
    /// Unit directions from the receivers.
    pub wi: Vec3x16,
    /// The ends of the shadow rays; undefined for lanes `at_infinity`.
    pub target: Vec3x16,
    /// Mask of the lanes whose shadow ray has no end.
    pub at_infinity: f32x16,
    /// Incident radiance by channel.
    pub radiance: [f32x16; 3],
    /// Densities per unit solid angle.
    pub pdf: f32x16,
    /// Mask of the lanes whose light no other technique can sample.
    pub delta: f32x16,
    /// Mask of the lanes with a sample.
    pub valid: f32x16,
}

impl EmitterSampleX16 {
    /// No sample in any lane.
    pub const NONE: EmitterSampleX16 = EmitterSampleX16 {
        wi: Vec3x16 { x: f32x16::ZERO, y: f32x16::ZERO, z: f32x16::ZERO },
        target: Vec3x16 { x: f32x16::ZERO, y: f32x16::ZERO, z: f32x16::ZERO },
        at_infinity: f32x16::ZERO,
        radiance: [f32x16::ZERO; 3],
        pdf: f32x16::ZERO,
        delta: f32x16::ZERO,
        valid: f32x16::ZERO,
    };

    /// Replaces the sample of one lane.
    fn set_lane(&mut self, i: usize, sample: Option<EmitterSample>) {
        let mask = |set: bool| f32::from_bits(if set { u32::MAX } else { 0 });
        self.valid.as_mut_array()[i] = mask(sample.is_some());
        let Some(sample) = sample else { return };
        let (target, at_infinity) = match sample.target {
            ShadowTarget::Point(p) => (p, false),
            ShadowTarget::Infinity => (Vec3::ZERO, true),
        };
        self.wi.set_lane(i, sample.wi);
        self.target.set_lane(i, target);
        self.at_infinity.as_mut_array()[i] = mask(at_infinity);
        for (channel, value) in self.radiance.iter_mut().zip(sample.radiance.to_array()) {
            channel.as_mut_array()[i] = value;
        }
        self.pdf.as_mut_array()[i] = sample.pdf;
        self.delta.as_mut_array()[i] = mask(sample.delta);
    }
}

/// Rectangular emitters, one in each lane.
struct RectanglesX16 {
    rectangle: RectangleX16,
    normal: Vec3x16,
    error: f32x16,
    inverse_area: f32x16,
    radiance: [f32x16; 3],
}

impl RectanglesX16 {
    fn splat(r: &RectangleSurface, radiance: Rgb) -> Self {
        RectanglesX16 {
            rectangle: RectangleX16::splat(&r.rectangle),
            normal: Vec3x16::splat(r.normal),
            error: f32x16::splat(r.error),
            inverse_area: f32x16::splat(r.inverse_area),
            radiance: radiance.to_array().map(f32x16::splat),
        }
    }

    fn gather(rectangles: [(&RectangleSurface, Rgb); LANES]) -> Self {
        let lanes = |f: &dyn Fn(usize) -> f32| f32x16::new(std::array::from_fn(f));
        let mut normal = Vec3x16::default();
        for (i, (r, _)) in rectangles.iter().enumerate() {
            normal.set_lane(i, r.normal);
        }
        RectanglesX16 {
            rectangle: RectangleX16::gather(rectangles.map(|(r, _)| &r.rectangle)),
            normal,
            error: lanes(&|i| rectangles[i].0.error),
            inverse_area: lanes(&|i| rectangles[i].0.inverse_area),
            radiance: std::array::from_fn(|c| lanes(&|i| rectangles[i].1.to_array()[c])),
        }
    }

    /// Computes [`AreaEmitter::sample`](super::AreaEmitter::sample) in each lane.
    #[inline(always)]
    fn sample(&self, from: Vec3x16, u: [f32x16; 2]) -> EmitterSampleX16 {
        let projection = self.rectangle.projected_from(from);
        let RectanglePointX16 { p, to } = projection.sample(u);
        let distance_squared = to.length_squared();
        let wi = to * (f32x16::ONE / distance_squared.sqrt());
        let cos = -wi.dot(self.normal);
        let mut pdf = f32x16::ONE / projection.solid_angle();
        if !projection.resolved().all() {
            let by_area = self.inverse_area * distance_squared / cos.abs();
            pdf = projection.resolved().select(pdf, by_area);
        }
        EmitterSampleX16 {
            wi,
            target: offset_origin_x16(p, self.error + end_error_x16(to), self.normal, -wi),
            radiance: self.radiance,
            pdf,
            // False if `from` is the point itself.
            valid: cos.simd_gt(f32x16::ZERO),
            ..EmitterSampleX16::NONE
        }
    }
}

/// Returns the surface and radiance of a rectangular emitter.
#[inline]
fn rectangle(light: &Light) -> Option<(&RectangleSurface, Rgb)> {
    match light {
        Light::Area(area) => area.rectangle(),
        _ => None,
    }
}

/// Samples a direction to `lights[i]` as seen from lane `i` of `from`, for the lanes in the mask `active`.
#[inline]
pub fn sample_x16(
    lights: [&Light; LANES],
    from: Vec3x16,
    u: [f32x16; 2],
    time: f32x16,
    active: u32,
) -> EmitterSampleX16 {
    let [first, others @ ..] = lights;
    if others.iter().all(|other| std::ptr::eq(*other, first))
        && let Some((r, radiance)) = rectangle(first)
    {
        return RectanglesX16::splat(r, radiance).sample(from, u);
    }
    let found = lights.map(rectangle);
    let mut others = active;
    let mut samples = EmitterSampleX16::NONE;
    if let Some(any) = found.iter().flatten().next() {
        samples = RectanglesX16::gather(found.map(|r| r.unwrap_or(*any))).sample(from, u);
        let rectangles = (0..LANES).filter(|&i| found[i].is_some()).fold(0, |bits, i| bits | 1 << i);
        samples.valid &= mask_from_bits(rectangles);
        others &= !rectangles;
    }
    for i in bits(others) {
        let u = Vec2::new(u[0].as_array()[i], u[1].as_array()[i]);
        samples.set_lane(i, lights[i].sample(from.lane(i), u, time.as_array()[i]));
    }
    samples
}
