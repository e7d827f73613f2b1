//! Shared samples as seen from the vertices of a group: densities, throughput, and rays.

use crate::bsdf::{Bsdf, BsdfX16};
use crate::color::Rgb;
use crate::emitter::{Gloss, GlossX16, ReceiverX16};
use crate::integrator::lighting::TechniqueCounts;
use crate::math::lanes::{LANES, bits, mask_from_bits};
use crate::math::ray::{end_error_x16, offset_origin, offset_origin_x16};
use crate::math::{Frame, FrameX16, Ray, RayX16, Vec3, Vec3x16, f32x16};
use crate::sampling::mis::weighted_power_heuristic;
use crate::scene::{Scene, SurfaceInteraction};
use std::ops::Range;

/// The vertex of a path at which it samples the direction to the point that the group shares.
#[derive(Clone, Copy)]
pub(super) struct Vertex<'a> {
    pub p: Vec3,
    pub error: f32,
    pub ng: Vec3,
    pub frame: Frame,
    pub wo: Vec3,
    pub bsdf: &'a Bsdf<'a>,
    pub beta: Rgb,
    pub gloss: Gloss,
}

/// Where a shared sample is.
#[derive(Clone, Copy)]
pub(super) enum Place<'a> {
    Surface(SurfacePoint<'a>),
    /// Beyond the scene, in a unit direction.
    Infinity(Vec3),
}

/// A shared point of a surface.
#[derive(Clone, Copy)]
pub(super) struct SurfacePoint<'a> {
    pub p: Vec3,
    pub error: f32,
    pub ng: Vec3,
    pub frame: Frame,
    pub bsdf: &'a Bsdf<'a>,
    /// Whether the path arrived on the front side of the shading normal.
    pub front: bool,
    /// The index of the point among those that emit.
    pub emitting: Option<u32>,
}

/// The vertices of a group.
pub(super) struct Receivers<'a> {
    pub p: Vec3x16,
    pub error: f32x16,
    pub ng: Vec3x16,
    pub frame: FrameX16,
    pub wo: Vec3x16,
    pub bsdf: BsdfX16<'a>,
    pub beta: [f32x16; 3],
    pub gloss: Option<GlossX16>,
    pub lanes: u32,
    /// The range of the group's emitters in the batch.
    pub distant: Range<usize>,
}

/// A shared point as seen from the vertices of its group.
pub(super) struct Link {
    pub group: u32,
    /// The index of the vertices in the batch.
    pub receivers: usize,
    pub slot: u32,
    /// Directions to the vertices in the local frame of the shared point.
    pub wo: Vec3x16,
    /// Densities per unit area; per unit solid angle at infinity.
    pub density: f32x16,
    /// Densities per unit solid angle.
    pub pdf: f32x16,
    /// Throughput of the pixels up to the shared point, in the measure of area.
    pub flux: [f32x16; 3],
    /// Mask of the vertices to which a ray is traced.
    pub traced: u32,
    /// The lane of the path that found the point.
    pub own: usize,
}

/// The light of an emitter at infinity along the rays of a group that hit nothing, by member.
pub(super) struct DistantLight {
    pub radiance: [f32x16; 3],
    /// Densities per unit solid angle, if the emitter has been chosen.
    pub density: f32x16,
    /// The probabilities with which the emitter is chosen at the vertices.
    pub pmf: f32x16,
}

impl Receivers<'_> {
    /// Returns the vertices as emitters were chosen for them.
    fn receivers(&self) -> ReceiverX16 {
        ReceiverX16 { p: self.p, gloss: self.gloss }
    }

    /// Links a shared sample with the vertices, and adds rays to all but the vertex `own` of the path that found it.
    pub fn link(&self, place: &Place<'_>, own: usize, rays: &mut Vec<Ray>) -> Link {
        let (to, w, per_area) = match place {
            Place::Infinity(d) => (Vec3x16::splat(*d), Vec3x16::splat(*d), f32x16::ONE),
            Place::Surface(point) => {
                let to = Vec3x16::splat(point.p) - self.p;
                let w = to.normalize_or_zero();
                (to, w, Vec3x16::splat(point.ng).dot(w).abs() / to.length_squared())
            }
        };
        let wi = self.frame.to_local(w);
        let eval = self.bsdf.eval(&self.wo, &wi);
        let density = eval.pdf * per_area;
        let mut some = density.simd_gt(f32x16::ZERO)
            & density.simd_lt(f32x16::splat(f32::INFINITY))
            & mask_from_bits(self.lanes);
        let o = offset_origin_x16(self.p, self.error, self.ng, w);
        let (mut wo, mut t_max, mut d) = (Vec3x16::default(), f32x16::splat(f32::INFINITY), w);
        if let Place::Surface(point) = place {
            let Frame { s, t, n } = point.frame;
            wo =
                Vec3x16::new(-Vec3x16::splat(s).dot(w), -Vec3x16::splat(t).dot(w), -Vec3x16::splat(n).dot(w));
            let front = wo.z.simd_gt(f32x16::ZERO);
            some &= if point.front { front } else { !front };
            let error = f32x16::splat(point.error) + end_error_x16(to);
            let target = offset_origin_x16(Vec3x16::splat(point.p), error, Vec3x16::splat(point.ng), -w);
            (t_max, d) = (f32x16::ONE, target - o);
        }
        let factor = wi.z.abs() * per_area;
        let flux = std::array::from_fn(|c| (self.beta[c] * eval.f[c] * factor) & some);
        let traced = some.to_bitmask() & !(1 << own);
        if traced != 0 {
            let all = RayX16 { o, t_max, d, time: f32x16::ZERO }.to_rays();
            rays.extend(bits(traced).map(|i| all[i]));
        }
        let (density, pdf) = (density & some, eval.pdf);
        Link { group: 0, receivers: 0, slot: 0, wo, density, pdf, flux, traced, own }
    }

    /// Returns the light of each distant emitter in the directions of the members.
    pub fn distant(&self, scene: &Scene, directions: &Vec3x16) -> impl Iterator<Item = DistantLight> {
        let selection = TechniqueCounts::ONE_EACH.selection(scene);
        scene.distant_emitters().map(move |emitter| {
            let (radiance, density) = scene.distant_x16(selection, emitter, directions);
            let pmf = scene.distant_pmf_x16(selection, emitter, &self.receivers(), LANES);
            DistantLight { radiance, density, pmf }
        })
    }

    /// Returns the radiance that a surface point emits, and its weights against emitter samples at the vertices of the
    /// mask `lanes`; zero where it emits to the other side. `pdf` are the densities of the directions to the point.
    pub fn emitted(&self, scene: &Scene, at: &SurfaceInteraction, pdf: f32x16, lanes: u32) -> (Rgb, f32x16) {
        let mut weights = [0.0; LANES];
        let Some(emitter) = scene.emitter_at(at) else { return (Rgb::BLACK, f32x16::ZERO) };
        let selection = TechniqueCounts::ONE_EACH.selection(scene);
        for i in bits(lanes) {
            let from = self.p.lane(i);
            let w = at.p - from;
            if w.dot(at.ng) < 0.0 {
                let origin = offset_origin(from, self.error.as_array()[i], self.ng.lane(i), w);
                let receiver = self.receivers().lane(i);
                let other = scene.emitter_pdf(selection, emitter, receiver, origin, at);
                weights[i] = weighted_power_heuristic(1.0, pdf.as_array()[i], 1.0, other);
            }
        }
        (scene.emitted(emitter, at), f32x16::new(weights))
    }
}
