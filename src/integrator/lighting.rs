//! Direct lighting at a surface point: emitter samples and BSDF samples, weighted against each other.

use crate::accel::Hit;
use crate::bsdf::Bsdf;
use crate::color::Rgb;
use crate::math::{Ray, Vec2, Vec3};
use crate::sampling::mis::weighted_power_heuristic;
use crate::scene::{Scene, SurfaceInteraction};

/// How many samples each technique draws at a point, for the weights.
#[derive(Clone, Copy, Debug)]
pub struct TechniqueCounts {
    /// Emitter samples.
    pub emitter: f32,
    /// BSDF samples.
    pub bsdf: f32,
}

impl TechniqueCounts {
    /// One sample of each.
    pub const ONE_EACH: TechniqueCounts = TechniqueCounts { emitter: 1.0, bsdf: 1.0 };
}

/// One emitter sample: a shadow ray, and what it brings (over the number of emitter samples) if it is free.
#[inline]
pub fn sample_emitter(
    scene: &Scene,
    at: &SurfaceInteraction,
    bsdf: &Bsdf,
    wo_local: Vec3,
    (u_choice, u_point): (f32, Vec2),
    counts: TechniqueCounts,
    time: f32,
) -> Option<(Ray, Rgb)> {
    let sample = scene.sample_emitter(at.p, u_choice, u_point)?;
    let wi = at.frame.to_local(sample.wi);
    let scattered = bsdf.eval(wo_local, wi);
    if scattered.f.is_black() || sample.pdf <= 0.0 {
        return None;
    }
    let weight = if sample.delta {
        1.0
    } else {
        weighted_power_heuristic(counts.emitter, sample.pdf, counts.bsdf, scattered.pdf)
    };
    let value = scattered.f * sample.radiance * (wi.z.abs() * weight / (sample.pdf * counts.emitter));
    Some((scene.shadow_ray(at, &sample, time), value))
}

/// The weighted radiance that a ray of density `pdf` (per unit solid angle; infinite for delta lobes and the
/// camera) finds at the emitter it hit, seen from the ray's origin. Black where nothing is emitted.
#[inline]
pub fn emitted_at(
    scene: &Scene,
    at: &SurfaceInteraction,
    from: Vec3,
    pdf: f32,
    counts: TechniqueCounts,
) -> Rgb {
    let Some(emitter) = scene.emitter_at(at) else {
        return Rgb::BLACK;
    };
    let radiance = scene.emitted(emitter);
    if pdf.is_infinite() {
        return radiance;
    }
    let other = scene.emitter_pdf(emitter, from, at);
    radiance * weighted_power_heuristic(counts.bsdf, pdf, counts.emitter, other)
}

/// The weighted radiance that a ray finds when it leaves the scene.
#[inline]
pub fn environment(scene: &Scene, pdf: f32, counts: TechniqueCounts) -> Rgb {
    let Some(emitter) = scene.environment else {
        return Rgb::BLACK;
    };
    let radiance = scene.emitted(emitter);
    if pdf.is_infinite() {
        return radiance;
    }
    let other = scene.environment_pdf(emitter);
    radiance * weighted_power_heuristic(counts.bsdf, pdf, counts.emitter, other)
}

/// What a ray found: the surface point, if any.
#[inline]
pub fn interaction(scene: &Scene, ray: &Ray, hit: &Option<Hit>) -> Option<SurfaceInteraction> {
    hit.as_ref().map(|hit| scene.interaction(ray, hit))
}
